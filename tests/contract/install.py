#!/usr/bin/python3
"""Installs the build into a scratch prefix, builds the example hosts from there as a user would, by CMake and by pkg-config, in C, C++17,
C++20 and Fortran, and runs each against the installed server and with the server in its own process. Then two copies of the library live
in one process, and a process with the server in it loads no HDF5 without a state directory. The installed pages have no dead link."""
import argparse
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "tests/support"), str(ROOT / "deploy/docs")]
import installed
import mpi
import stage

CONSUMER = """cmake_minimum_required(VERSION 3.20)
project(consumer LANGUAGES C CXX Fortran)
set(CMAKE_EXPORT_NO_PACKAGE_REGISTRY ON)
find_package(shearbus 0.1 REQUIRED COMPONENTS c cxx fortran embedded)
add_executable(c host.c)
target_link_libraries(c PRIVATE shearbus::c m)
add_executable(cxx17 host.cpp)
target_link_libraries(cxx17 PRIVATE shearbus::cxx)
add_executable(cxx20 host.cpp)
target_link_libraries(cxx20 PRIVATE shearbus::cxx)
target_compile_features(cxx20 PRIVATE cxx_std_20)
add_executable(fortran host.f90)
target_link_libraries(fortran PRIVATE shearbus::fortran)
"""
MPI_CONSUMER = """
set(MPI_CXX_SKIP_MPICXX ON)
find_package(shearbus REQUIRED COMPONENTS mpi)
find_package(MPI REQUIRED)
add_executable(mpi_cxx host_mpi.cpp)
target_link_libraries(mpi_cxx PRIVATE shearbus::cxx shearbus::mpi MPI::MPI_CXX)
add_executable(mpi_fortran host_mpi.f90)
target_link_libraries(mpi_fortran PRIVATE shearbus::mpi_fortran MPI::MPI_Fortran)
set_target_properties(mpi_fortran PROPERTIES Fortran_MODULE_DIRECTORY mpi_modules)
"""
WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Werror"]


def run(*command, **options):
    return installed.run(*command, **options).stdout


def build_by_cmake(work, prefix, examples, with_mpi):
    source = work / "consumer"
    shutil.copytree(examples, source)
    (source / "CMakeLists.txt").write_text(CONSUMER + (MPI_CONSUMER if with_mpi else ""))
    run("cmake", "-S", source, "-B", source / "build", "-G", "Ninja", f"-DCMAKE_PREFIX_PATH={prefix}")
    run("ninja", "-C", source / "build", "-j2")
    return [source / "build" / name for name in ("c", "cxx17", "cxx20", "fortran")]


def check_components(work, prefix):
    """A component that is not there, or cannot be used, is refused with a reason."""
    for languages, component, reason in (("C", "no_such", "component no_such is none of this installation"),
                                         ("C", "fortran", "component fortran needs a project with the language Fortran")):
        source = work / f"component_{component}"
        source.mkdir()
        (source / "CMakeLists.txt").write_text(f"cmake_minimum_required(VERSION 3.20)\nproject(p LANGUAGES {languages})\n"
                                               f"find_package(shearbus REQUIRED COMPONENTS {component})\n")
        done = subprocess.run(["cmake", "-S", source, "-B", source / "build", f"-DCMAKE_PREFIX_PATH={prefix}"], capture_output=True, text=True)
        if done.returncode == 0 or reason not in " ".join(done.stderr.split()):
            sys.exit(f"find_package(shearbus COMPONENTS {component}) is not refused with a reason: {done.stderr}")


def run_on_ranks(mpiexec, build, scene, endpoint, work, environment):
    """The MPI hosts print the same on any number of ranks, with a session each or one on root, and after a restart."""
    dump = [work / "dump"]
    for program, runs in (("mpi_cxx", [(1,), (3,), (3, *dump, 35), (2, *dump)]), ("mpi_fortran", [(1,), (3,), (2, "root")])):
        texts = [run(*mpi.mpiexec(mpiexec, ranks), build / program, scene, endpoint, *words, env=environment) for ranks, *words in runs]
        different = set(texts) - {""}  # the run up to the dump prints nothing
        if len(different) != 1 or "[V]  92.183880" not in texts[0].replace("[V] 92", "[V]  92"):
            sys.exit(f"{program} does not print the same on any number of ranks: {different}")


def build_by_pkg_config(work, prefix, examples):
    (config,) = prefix.rglob("shearbus.pc")
    environment = {**os.environ, "PKG_CONFIG_PATH": str(config.parent)}
    words = lambda *flags: run("pkg-config", *flags, "shearbus", env=environment).split()
    flags, libraries = words("--cflags"), words("--libs")
    (module,) = words("--variable=fortran_source")
    programs = []
    for name, compiler, sources in (("pc_c", ["gcc", "-std=c99"], ["host.c"]), ("pc_cxx17", ["g++", "-std=c++17"], ["host.cpp"]),
                                    ("pc_fortran", ["gfortran", "-std=f2008", f"-J{work}"], [module, "host.f90"])):
        warnings = [] if compiler[0] == "gfortran" else WARNINGS
        run(*compiler, *warnings, *flags, *(examples / source for source in sources), *libraries, "-lm", "-o", work / name)
        programs.append(work / name)
    return programs


def check_pages(work, pages):
    """The stage of the site ends the test at a link or a section that the installed pages do not have."""
    site = stage.Site(pages, work / "site")
    if not {"README.md", "client/README.md", "deploy/docs/pages/howto/adapter.md"} <= site.pages:
        sys.exit(f"pages are not installed; there are {sorted(site.pages)}")
    for page in site.pages:
        site.stage(page)


def check_tables(work, prefix, scene):
    """The installed shearbus-replay reads, writes and compares tables of text by the installed part in Python."""
    if not (prefix / "share/shearbus/replay/tables.py").is_file():
        sys.exit("the tables of shearbus-replay are not installed")
    table = work / "table.csv"
    table.write_text("time [us],pressure [GPa],velocity_jump [m/s]\n1,11,100\n2,11,99\n")
    for result in ("result.h5", "result.csv"):
        run(prefix / "bin/shearbus-replay", table, "--steps", "--scene", scene, "--out", work / result)
    run(prefix / "bin/shearbus-replay", "compare", work / "result.h5", work / "result.csv")


def check_hdf5(work, prefix, source, scene):
    """A process with the server in it loads HDF5 for a state directory only, and withstands a host with an HDF5 of its own."""
    (config,), (library,) = prefix.rglob("shearbus.pc"), prefix.rglob("libshearbus.so.1")
    flags = run("pkg-config", "--cflags", "--libs", "shearbus", env={**os.environ, "PKG_CONFIG_PATH": str(config.parent)}).split()
    names = run("nm", "-D", "--undefined-only", library.with_name("libshearbus-checkpoint.so.1"))
    called = sorted(set(re.findall(r" U (H5\w+)@", names)) - {"H5get_libversion"})
    if len(called) < 10:
        sys.exit(f"expected libshearbus-checkpoint.so.1 to need functions of HDF5, found {called}")
    other = "\n".join(["#include <stdlib.h>", "int H5get_libversion(unsigned* a, unsigned* b, unsigned* c) { return *a = 2, *b = 3, *c = 4, 0; }",
                       *(f"void {name}(void) {{ abort(); }}" for name in called)])
    run("gcc", "-shared", "-fPIC", "-x", "c", "-", "-o", work / "libhdf5_other.so", input=other)
    host = ["gcc", "-std=c99", *WARNINGS, source, *flags]
    run(*host, "-o", work / "plain")
    run(*host, "-Wl,--no-as-needed", work / "libhdf5_other.so", f"-Wl,-rpath,{work}", "-o", work / "other")
    loaded = lambda program, *words: sorted(run(work / program, scene, *words, env={**os.environ, "LD_LIBRARY_PATH": str(library.parent)}).split())
    found = loaded("plain"), loaded("other"), [name for name in loaded("plain", work / "states") if name.startswith("libhdf5_serial.so")]
    if found[:2] != ([], ["libhdf5_other.so"]) or len(found[2]) != 1:
        sys.exit(f"HDF5 libraries of a plain host, of one with another HDF5, and with a state directory: {found}")
    refused = subprocess.run([work / "other", scene, work / "more_states"], capture_output=True, text=True,
                             env={**os.environ, "LD_LIBRARY_PATH": str(library.parent)})
    if refused.returncode != 1 or "the host has loaded HDF5 2.3.4" not in refused.stderr:
        sys.exit(f"a state directory with another HDF5: exit code {refused.returncode}, {refused.stderr}")


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--build", type=pathlib.Path, required=True)
    parser.add_argument("--mpiexec", help="also build the MPI hosts, and run them with this command")
    parser.add_argument("--two-copies", type=pathlib.Path, required=True, help="source of the program with two copies")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="shearbus-") as scratch:
        work = pathlib.Path(scratch)
        prefix = work / "prefix"
        installed.install(options.build, prefix, "server", "runtime", "development")
        stray = [str(p) for p in prefix.rglob("*") if p.is_file() and "proto" in p.parts]
        if stray:
            sys.exit(f"headers of the wire are installed: {stray}")
        installed.install(options.build, prefix, "doc")
        check_pages(work, prefix / "share/doc/shearbus")
        examples = prefix / "share/shearbus/examples"
        scene = examples / "constant_friction.toml"
        (library,) = prefix.rglob("libshearbus.so.1")
        environment = {**os.environ, "LD_LIBRARY_PATH": str(library.parent)}
        programs = build_by_cmake(work, prefix, examples, options.mpiexec) + build_by_pkg_config(work, prefix, examples)

        check_components(work, prefix)
        check_tables(work, prefix, ROOT / "client/examples/paper_velocity_driven_graded.toml")
        check_hdf5(work, prefix, options.two_copies.with_name("embedded_hdf5.c"), scene)
        with installed.serving(prefix, work / "bus") as endpoint:
            answers = set()
            for program in programs:
                for where in (endpoint, "embedded"):
                    text = run(program, scene, where, env=environment)
                    answers.add(text.split("[V]")[5].split()[0] + " m/s, exact " + text.split("exact")[5].split()[0])
            if answers != {"92.183880 m/s, exact 92.183880"}:
                sys.exit(f"the hosts do not agree on node 5: {answers}")
            if options.mpiexec:
                run_on_ranks(options.mpiexec, work / "consumer/build", scene, endpoint, work, environment)
            copy = work / "copy"
            shutil.copytree(library.parent, copy, symlinks=False, ignore=shutil.ignore_patterns("cmake", "pkgconfig"))
            (include,) = run("pkg-config", "--cflags", "shearbus", env={**os.environ, "PKG_CONFIG_PATH": str(library.parent / "pkgconfig")}).split()
            run("gcc", "-std=c99", *WARNINGS, include, options.two_copies, "-ldl", "-o", work / "two_copies")
            print(run(work / "two_copies", library.resolve(), copy / library.resolve().name, scene, endpoint, "embedded"), end="")
    print(f"{len(programs)} hosts built from the installed tree give the exact answer, by a server and embedded")


if __name__ == "__main__":
    main()
