#!/usr/bin/python3
"""The Python client by pip, from the source tree into a new environment, without network: its wheel has the libraries of a
build, and needs nothing else of shearbus.

python_wheel.py --source DIR --libraries DIR   (root of the sources; build/lib)

Exits with 77 where this Python has no pip, venv or wheel."""
import argparse
import importlib.util
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

DURABLE = """import pathlib, sys
import shearbus
from shearbus import _library
assert pathlib.Path(shearbus.__file__).is_relative_to(sys.prefix), shearbus.__file__
assert str(_library.library()._name).startswith(sys.prefix), _library.library()
with shearbus.open(sys.argv[1], nodes=[1], state_dir="states") as bus:
    bus.step(1e-9, jump=100.0, pressure=11.2e9)
    bus.leave()
with shearbus.resume(bus.ticket, state_dir="states") as bus:
    assert bus.step(1e-9, jump=100.0, pressure=11.2e9).state_version == 2
"""


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--source", required=True, type=pathlib.Path)
    parser.add_argument("--libraries", required=True, type=pathlib.Path)
    options = parser.parse_args()
    if missing := [name for name in ("pip", "venv", "ensurepip", "setuptools", "wheel") if not importlib.util.find_spec(name)]:
        print(f"this Python has no {', '.join(missing)}")
        return 77
    environment = {name: value for name, value in os.environ.items() if not name.startswith(("SHEARBUS_", "PYTHON"))}

    def run(*command, **more):
        done = subprocess.run([str(word) for word in command], capture_output=True, text=True, check=False, cwd=directory,
                              env={**environment, **more}, timeout=250)
        assert done.returncode == 0, f"{command}:\n{done.stdout}{done.stderr}"
        return done.stdout

    with tempfile.TemporaryDirectory(prefix="shearbus-") as directory:
        examples = options.source / "client/examples"
        package = pathlib.Path(directory, "package")  # not in the tree, where a build leaves files
        shutil.copytree(options.source / "client/python", package, ignore=shutil.ignore_patterns("__pycache__", "build", "*.egg-info"))
        run(sys.executable, "-m", "venv", "--system-site-packages", "new")  # for numpy and wheel
        python = pathlib.Path(directory, "new/bin/python")
        run(python, "-m", "pip", "install", "--no-index", "--no-build-isolation", "--no-deps", package,
            SHEARBUS_LIBRARY=str(options.libraries))
        said = run(python, "-W", "ignore", examples / "host.py")
        assert "[V] 92.183880 m/s  exact 92.183880" in said, said
        run(python, "-W", "ignore", "-c", DURABLE, examples / "paper_velocity_driven.toml")
        run(python, "-m", "shearbus.conformity", "--help")
    print("a wheel with its libraries runs hosts in a new environment")
    return 0


if __name__ == "__main__":
    sys.exit(main())
