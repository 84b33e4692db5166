"""What a shared library exports, beside the Debian package's list of symbols."""
import pathlib
import subprocess

SYMBOLS = pathlib.Path(__file__).resolve().parents[2] / "deploy/packaging/runtime/symbols"


def exported(library):
    printed = subprocess.run(["nm", "-D", "--defined-only", library], check=True, capture_output=True, text=True).stdout
    return {line.split()[-1].split("@")[0] for line in printed.splitlines()}


def listed(text):
    """Returns library -> its symbols."""
    found, library = {}, None
    for line in text.splitlines():
        if line.startswith(" "):
            found[library].add(line.split("@")[0].strip())
        else:
            library = line.split()[0]
            found[library] = set()
    return found


def symbol_faults(library, text):
    """Compares a library, whose file may have any version, with a list of symbols."""
    symbols = next((symbols for name, symbols in listed(text).items() if name.split(".so")[0] == library.name.split(".so")[0]), None)
    if symbols is None:
        yield f"{library.name}: not in deploy/packaging/runtime/symbols"
        return
    here = exported(library)
    for symbol in sorted(symbols - here):
        yield f"{library.name}: {symbol} is gone, so the library needs another name (SOVERSION)"
    for symbol in sorted(here - symbols):
        yield f"{library.name}: {symbol} is not in deploy/packaging/runtime/symbols; add it with this version"
