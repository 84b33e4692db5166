#!/usr/bin/python3
"""Checks what a shared library of the project shows to the process that loads it: it exports the C functions of the header and nothing
else, which are those of the Debian package's list of symbols, and needs only the libraries that are named here. The options of a session in all languages are those of the header."""
import argparse
import pathlib
import re
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import exports


def output_of(*command):
    return subprocess.run(command, check=True, capture_output=True, text=True).stdout


def library_faults(library, header, allowed):
    exported = exports.exported(library)
    declared = set(re.findall(r"\b(shearbus_\w+)\s*\(", re.sub(r"/\*.*?\*/|//[^\n]*", "", header, flags=re.S)))
    declared -= set(re.findall(r"typedef[^;]*\(\*\s*(shearbus_\w+)", header))
    for name in sorted(exported - declared):
        yield f"{library.name} exports {name}, which its header does not declare"
    for name in sorted(declared - exported):
        yield f"{library.name} does not export {name}, which its header declares"
    yield from exports.symbol_faults(library, exports.SYMBOLS.read_text())
    for name in re.findall(r"\(NEEDED\).*\[(.*)\]", output_of("readelf", "-d", str(library))):
        if name.split(".so")[0] not in allowed:
            yield f"{library.name} needs {name} (allowed: {', '.join(sorted(allowed))})"


def option_faults(header, client):
    """Every option of C is one of C++, Fortran and Python, of the same name but for its unit."""
    members = re.search(r"typedef struct shearbus_options \{(.*?)\} shearbus_options;", re.sub(r"/\*.*?\*/", "", header, flags=re.S), re.S)[1]
    options = set(re.findall(r"(\w+);", members)) - {"size", "log", "log_user", "interrupted", "interrupted_user"}
    options -= {"scene_name", "ignore_environment"}  # for programs with a command line
    cxx = re.search(r"\nstruct Options \{(.*?)\n\};", (client / "include/shearbus/client.hpp").read_text(), re.S)[1]
    fortran = re.search(r"subroutine open_64\((.*?)\)", (client / "fortran/shearbus.f90").read_text(), re.S)[1]
    python = re.search(r"\ndef open\((.*?)\):", (client / "python/shearbus/session.py").read_text(), re.S)[1]
    own = {"Python": {"scene_file": "scene", "scene_text": "scene"}, "Fortran": {"scene_file": "scene"}, "C++": {}}
    for language, text in (("C++", cxx), ("Fortran", fortran), ("Python", python)):
        for option in sorted(options):
            name = own[language].get(option, option if language == "C++" else option.removesuffix("_s"))
            if not re.search(rf"\b{name}\b", text):
                yield f"{language} has no option {name}, which shearbus.h has"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--library", type=pathlib.Path, required=True)
    parser.add_argument("--header", type=pathlib.Path, required=True)
    parser.add_argument("--needs", required=True, help="names of the allowed libraries, comma-separated, without .so")
    options = parser.parse_args()
    header = options.header.read_text()
    faults = list(library_faults(options.library, header, set(options.needs.split(","))))
    if "shearbus_options" in header:
        faults += option_faults(header, options.header.parents[2])
    print("\n".join(faults) if faults else f"{options.library.name} shows what its header says")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
