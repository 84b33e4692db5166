#!/usr/bin/python3
"""What a newcomer has after deploy/run must be enough for every page and for the installation.

after_run.py --configured BUILD     of a build directory configured without tests, as deploy/run has it, nothing built: what its install
                                    scripts take and what the pages name is among what the targets of deploy/run make
after_run.py --clone DIR [--no-unity]   a copy of the tree in DIR, as git would clone it: deploy/run, then each of these. By ccache where it
                                    is there; minutes without. --no-unity compiles each file alone, as a build with tests for daily work
                                    does, whose cache then serves
after_run.py --self-test            a program on a page and an installed file that nothing builds are noticed"""
import argparse
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
TARGETS = ("run", "programs")  # of deploy/run
FENCE = re.compile(r"^(```+)[^\n]*\n.*?^\1|^ {4}.*$|`[^`\n]+`", re.M | re.S)
# Programs in code of the pages, and the libraries of their link lines. Those of the tests are built by deploy/test, and pages say so.
PROGRAM = re.compile(r"(?<![\w/.-])(?:build/bin/)?(shearbus-(?!tests\b|bench\b|fuzz\b)[a-z]+)\b(?![-.\w])")
LIBRARY = re.compile(r"-l(shearbus[\w-]*)|lib(shearbus[\w-]*)\.so")


# A script that begins a line of code, or an inline command: a reader types it as it stands.
SCRIPT = re.compile(r"(?:^|`)(?: {4})?((?:tests|client|deploy|hydro_stub)/[\w/]+(?:\.py|\.sh)?)(?= |\n|$)", re.M)


def not_executable(root):
    """Returns the faults of scripts that the pages run by their name."""
    faults = []
    for page in pages(root):
        for code in FENCE.finditer(page.read_text()):
            scripts = {root / name for name in SCRIPT.findall(code[0])}
            faults += [f"{page.relative_to(root)}: {script.relative_to(root)} is run by its name and is not executable"
                       for script in sorted(scripts) if script.is_file() and script.read_bytes()[:2] == b"#!" and not os.access(script, os.X_OK)]
    return faults


def pages(root):
    return sorted(p for p in root.rglob("*.md") if not re.match(r"build|out/", p.relative_to(root).as_posix()) and "corpus" not in p.parts)


def packages(root):
    """Returns names of packages, which are no programs."""
    named = re.findall(r"PACKAGE_NAME (\S+)\)", (root / "deploy/cmake/packages.cmake").read_text())
    return set(named) - {"shearbus-server"}


def named_on_pages(root):
    """Returns {file of the build: page} of the programs and libraries that the pages name."""
    found = {}
    for page in pages(root):
        for code in FENCE.finditer(page.read_text()):
            for name in PROGRAM.findall(code[0]):
                found.setdefault(f"bin/{name}", page.relative_to(root).as_posix())
            for names in LIBRARY.findall(code[0]):
                found.setdefault(f"lib/lib{names[0] or names[1]}.so", page.relative_to(root).as_posix())
    return {file: page for file, page in found.items() if pathlib.Path(file).name not in packages(root)}


def installed(build):
    """Returns {file of the build: install script} of the files that `cmake --install` must have."""
    found = {}
    for script in build.rglob("cmake_install.cmake"):
        for call in re.findall(r"file\(INSTALL (.*?)\)\n", script.read_text(), re.S):
            files = re.findall(rf'"{re.escape(str(build))}/([^"]+)"', call)
            found.update({file: script.relative_to(build).as_posix() for file in files if " OPTIONAL " not in call})
    return found


def made(build):
    """Returns what the targets make, and what that is made of."""
    edges = {}  # output -> (outputs, inputs) of its build line
    for line in re.sub(r"\$\n *", "", (build / "build.ninja").read_text()).splitlines():
        if match := re.match(r"build (.*?): \S+ ?(.*)$", line.replace("${cmake_ninja_workdir}", "")):
            outputs, inputs = ([word for word in part.split() if word.strip("|")] for part in match.groups())
            edges.update({output: (outputs, inputs) for output in outputs})
    found, left = set(), list(TARGETS)
    while left:
        outputs, inputs = edges.get(left.pop(), ([], []))
        if not found.issuperset(outputs):
            found.update(outputs)
            left += inputs
    return found


def configured_faults(build, root):
    wanted, has = {**named_on_pages(root), **installed(build)}, made(build)
    print(f"{len(wanted)} files are named or installed")
    faults = [f"{file} is not what deploy/run makes: {place}" for file, place in sorted(wanted.items()) if file not in has and not (build / file).exists()]
    faults += not_executable(root)
    return faults if len(wanted) > 15 else [*faults, f"{len(wanted)} files were found on pages and in install scripts, expected more"]


def run(words, timeout, **options):
    print("$", *words, flush=True)
    done = subprocess.run([str(word) for word in words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=timeout, stdin=subprocess.DEVNULL, **options)
    print(done.stdout[-1500:], flush=True)
    return [] if done.returncode == 0 else [f"{' '.join(map(str, words))} ended with {done.returncode}"]


def clone_faults(directory, root, unity=True):
    """Does what the pages say in a copy of the tree. Returns what failed."""
    shutil.rmtree(directory, ignore_errors=True)
    tree, prefix = directory / "tree", directory / "prefix"
    listed = subprocess.run(["git", "-C", root, "ls-files", "-co", "--exclude-standard"], capture_output=True, text=True, check=True).stdout.split("\n")
    for name in filter(None, listed):
        if (root / name).is_file():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(root / name, tree / name, follow_symlinks=False)
    environment = {name: value for name, value in os.environ.items() if not name.startswith("SHEARBUS_") and name != "CI"}
    if shutil.which("ccache"):
        environment.update({f"CMAKE_{language}_COMPILER_LAUNCHER": "ccache" for language in ("C", "CXX")}, CCACHE_BASEDIR=str(tree))
    options = {"cwd": tree, "env": environment}
    if not unity and (faults := run(["cmake", "-C", "deploy/cmake/presets/release.cmake", "-S", ".", "-B", "build", "-G", "Ninja",
                                     "-DSHEARBUS_TESTS=OFF", "-DSHEARBUS_UNITY=OFF", "-DSHEARBUS_WARNINGS_AS_ERRORS=ON"], 300, **options)):
        return faults
    # A problem of a second: what is built does not depend on the scene.
    if faults := run(["deploy/run", "hydro_stub/problems/two_half_spaces.toml"], 5400, **options):
        return faults
    faults = run(["cmake", "--install", "build", "--prefix", prefix], 300, **options)
    faults += run(["/usr/bin/python3", "-B", "tests/docs/commands.py", "--build", "build"], 1800, **options)
    faults += run(["deploy/docs/build"], 900, **options)
    faults += run(["tests/study/paper_figures.py", "-o", "paper", "--coarse"], 1200, **options)
    faults += run(["deploy/build", "programs"], 600, **options)
    for file in ("include/shearbus/shearbus.h", "bin/shearbus-ctl", "lib/python3/dist-packages/shearbus/__init__.py"):
        if not (prefix / file).is_file():
            faults.append(f"the installation has no {file}")
    return faults


def self_test():
    faults = []
    with tempfile.TemporaryDirectory() as scratch:
        root = pathlib.Path(scratch, "root")
        build = pathlib.Path(scratch, "build")
        (root / "deploy/cmake").mkdir(parents=True)
        build.mkdir()
        (root / "deploy/cmake/packages.cmake").write_text("set(CPACK_DEBIAN_DOC_PACKAGE_NAME shearbus-doc)\n")
        (root / ("page" + ".md")).write_text("`shearbus-made`, `shearbus-gone x`, `shearbus-doc`, `libshearbus-dev`\n```sh\ncc host.c -L build/lib -lshearbus\n```\n")
        (build / "build.ninja").write_text("build bin/shearbus-made: link made.o\nbuild lib/libshearbus.so.1: link\nbuild lib/libshearbus.so | ${cmake_ninja_workdir}x: "
                                           "names lib/libshearbus.so.1\nbuild run: phony bin/shearbus-made\nbuild programs: phony run || $\n  lib/libshearbus.so\n"
                                           "build lib/none.so: link\n")
        (build / "cmake_install.cmake").write_text(f'file(INSTALL DESTINATION "x" TYPE FILE FILES "{build}/made.txt")\nfile(INSTALL DESTINATION "x" TYPE FILE FILES "{build}/lib/none.so")\n'
                                                   f'file(INSTALL DESTINATION "x" TYPE FILE OPTIONAL FILES "{build}/manual.gz")\n')
        (build / "made.txt").write_text("")
        (root / "tests").mkdir()
        (root / "tests/script.py").write_text("#!/usr/bin/python3\n")
        (root / ("other" + ".md")).write_text("Run:\n\n    tests/script.py --out DIR\n")
        found = configured_faults(build, root)[:-1]  # the last: too few
        if [fault.split(" ")[0] for fault in found[:2]] != ["bin/shearbus-gone", "lib/none.so"] or len(found) != 3 or "not executable" not in found[2]:
            faults.append(f"self-test: {found}")
    return faults


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--configured", type=pathlib.Path)
    parser.add_argument("--clone", type=pathlib.Path)
    parser.add_argument("--no-unity", action="store_true")
    parser.add_argument("--self-test", action="store_true")
    options = parser.parse_args()
    if options.self_test:
        faults = self_test()
    else:
        faults = clone_faults(options.clone.resolve(), ROOT, not options.no_unity) if options.clone else configured_faults(options.configured.resolve(), ROOT)
    print("\n".join(faults) or "nothing is missing")
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
