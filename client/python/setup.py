"""Puts the libraries of a build into the wheel, so that the installed package needs nothing else of shearbus: those next to
the file that SHEARBUS_LIBRARY names, or of ../../build/lib. Without them the wheel has none, and the package finds an
installed libshearbus. The rest of the package is described in pyproject.toml."""
import os
import pathlib
import shutil

from setuptools import setup
from setuptools.command.build_py import build_py

try:
    from setuptools.command.bdist_wheel import bdist_wheel
except ImportError:  # before setuptools 70
    from wheel.bdist_wheel import bdist_wheel

LIBRARIES = ("libshearbus.so.1", "libshearbus-embedded.so.1", "libshearbus-checkpoint.so.1")
named = pathlib.Path(os.environ.get("SHEARBUS_LIBRARY") or pathlib.Path(__file__).resolve().parents[2] / "build/lib")
found = [file for name in LIBRARIES if (file := (named.parent if named.is_file() else named) / name).exists()]


class BuildWithLibraries(build_py):
    def run(self):
        super().run()
        for file in found:
            shutil.copyfile(file, pathlib.Path(self.build_lib, "shearbus", file.name))


class Wheel(bdist_wheel):
    """A wheel of this machine's architecture and any Python, where it has the libraries."""

    def finalize_options(self):
        super().finalize_options()
        self.root_is_pure = not found

    def get_tag(self):
        return ("py3", "none", super().get_tag()[2])


setup(cmdclass={"build_py": BuildWithLibraries, "bdist_wheel": Wheel})
