#!/usr/bin/python3
"""Checks the tree against its design: which room may include which (the table in server/ARCHITECTURE.md), the contents of the top level,
that every source is built, that references to pages and their headings resolve, that Python programs read numbers by the one reader, and
that no file names a machine. With --self-test each rule must fail on a tree made for it.

A reference to a page of the tree is `PAGE.md` or `PAGE.md, "Heading"`; in a page it may be a link, [text](PAGE.md#heading). The TOML files
of TABLES are pages too, whose headings are the groups and titles of their parts."""
import argparse
import bisect
import json
import pathlib
import re
import sys
import tempfile
import tomllib

TOP_LEVEL = {"CMakeLists.txt", "README.md", "proto", "server", "client", "hydro_stub", "tests", "deploy"}
SOURCES = ("proto", "server", "client", "hydro_stub")
LIBRARIES = {  # library of the table -> pattern of its headers
    "protobuf": r"google/protobuf/.*|(shearbus/v1|hydro_stub)/.*\.pb\.h",
    "tomlplusplus": r"toml\+\+/.*|toml\.hpp",
    "xxhash": r"xxhash\.h",
    "HDF5": r"hdf5\.h|H5.*",
    "cppzmq": r"zmq.*",
    "Eigen": r"Eigen/.*",
    "utfcpp": r"utf8\.h|utf8/.*",
    "nlohmann-json": r"nlohmann/.*",
    "prometheus-cpp": r"prometheus/.*",
    "fmt": r"fmt/.*",
    "spdlog": r"spdlog/.*",
    "CLI11": r"CLI/.*",
    "MPI": r"mpi\.h",
}
STANDARD = re.compile(r"[a-z0-9_]+(\.h)?|experimental/simd|(sys|netinet|arpa|linux)/[a-z0-9_]+\.h")
MACHINE = re.compile(r"/(?:home|root|wor[k]|far[m]|Users)/|[.]pyen[v]|\bTOD[O]\b|\bFIXM[E]\b")
NUMBER = re.compile(r"\btype=(?:int|float)\b")
INCLUDE = re.compile(r'^\s*#\s*include\s*([<"])([^>"]+)[>"]', re.M)
# References are searched in comments and texts of these files, except in the corpora of fuzzing.
REFERRING = {".md", ".cpp", ".hpp", ".h", ".py", ".proto", ".cmake", ".txt", ".toml"}
COMMENT = re.compile(r"^\s*(?://+|#)\s?")
TABLES = ("tests/measured.toml", "deploy/docs/pages/howto/host_errors.toml")  # deploy/docs/stage.py makes pages of them
PAGE = re.compile(r'(?<![\w/.*<-])((?:[\w.-]+/)*[\w-]+\.md|tests/measured\.toml)\b(?:,? \\?"([^"\\]+)\\?")?')
NUMBERED = re.compile(r"\b[Ss]ections? \d|(?<=\.md)[,:]? \d")
FOREIGN = re.compile(r"\b(?:DLP|hydrodynamics|RFC)\b[^.]{0,40}$")  # sections of a publication have numbers
LINK = re.compile(r"\]\(([^)\s]+)\)")


def table(page):
    """Returns room -> allowed includes, from the table of the page server/ARCHITECTURE.md."""
    rows = {}
    section = page.split("## Who may include whom", 1)[1].split("\n## ", 1)[0]
    for line in section.splitlines():
        cells = [c.strip().strip("`") for c in line.strip().strip("|").split("|")]
        if len(cells) == 2 and cells[0] != "room" and not set(cells[0]) <= {"-"}:
            rows[cells[0]] = [c.strip().strip("`") for c in cells[1].split(",")]
    return rows


def below(path, prefix):
    return path == prefix or path.startswith((prefix + "/", prefix + "."))


def include_faults(root, rows):
    for path in sorted(p for house in SOURCES for p in (root / house).rglob("*") if p.suffix in {".cpp", ".hpp", ".h"}):
        name = path.relative_to(root).as_posix()
        owners = [room for room in rows if below(name, room)]
        if not owners:
            yield f"{name}: belongs to no room of the table in server/ARCHITECTURE.md"
            continue
        room = max(owners, key=len)
        if rows[room] == ["anything"]:
            continue
        for bracket, header in INCLUDE.findall(path.read_text()):
            target = "client/include/" + header if header.startswith("shearbus/") and ".pb." not in header else header
            library = next((lib for lib, pattern in LIBRARIES.items() if re.fullmatch(pattern, target)), None)
            if library:
                allowed = library in rows[room]
            elif bracket == "<" and not target.startswith("client/include/"):
                allowed = bool(STANDARD.fullmatch(target))
            else:
                # A room nested in an allowed room (client/replay inside client) does not belong to it.
                owner = max((r for r in rows if below(target, r)), key=len, default="")
                allowed = owner == room or any(below(target, entry) and len(owner) <= len(entry) for entry in rows[room])
            if not allowed:
                yield f"{name}: room {room} may not include {header} (allowed: {', '.join(rows[room])})"


def top_level_faults(root):
    for entry in root.iterdir():
        if not entry.name.startswith(".") and entry.name not in TOP_LEVEL and not re.fullmatch(r"build.*|out", entry.name):
            yield f"{entry.name}: the top level holds only {', '.join(sorted(TOP_LEVEL))} and dotfiles"


def machine_faults(root):
    for house in TOP_LEVEL:
        for path in sorted([root / house] if (root / house).is_file() else (root / house).rglob("*")):
            if path.is_file() and path.suffix not in {".png", ".pyc", ".bin"} and path.name != pathlib.Path(__file__).name:
                for number, line in enumerate(path.read_text(errors="replace").splitlines(), 1):
                    if MACHINE.search(line):
                        yield f"{path.relative_to(root)}:{number}: names a machine or leaves a loose end: {line.strip()[:80]}"


def number_faults(root):
    """Options of Python programs whose numbers argparse reads by int or float: those take nan, inf, 1_0 and " 1"."""
    for path in sorted(root.rglob("*.py")):
        if not path.relative_to(root).parts[0].startswith("build"):
            for number, line in enumerate(path.read_text(errors="replace").splitlines(), 1):
                if NUMBER.search(line):
                    yield f"{path.relative_to(root)}:{number}: reads a number by argparse; use the readers of client/report/terminal.py"


def headings(page):
    """Returns heading -> the anchor that GitHub makes of it."""
    text = page.read_text()
    if page.suffix == ".toml":
        found = [part[key] for part in tomllib.loads(text)["part"] for key in ("group", "title") if key in part]
    else:
        found = re.findall(r"^#+ (.+)$", re.sub(r"^```.*?^```", "", text, flags=re.M | re.S), re.M)
    found = [re.sub(r"[`*]", "", h).strip() for h in found]
    return {h: re.sub(r"[^\w\- ]", "", h.lower()).replace(" ", "-") for h in found}


def joined(text):
    """Returns the text with its lines joined and without comment marks, and the offset of each line's beginning."""
    starts, parts, at = [], [], 0
    for line in text.splitlines():
        line = COMMENT.sub("", line).strip() + " "
        starts.append(at)
        parts.append(line)
        at += len(line)
    return "".join(parts), starts


def page_named(name, path, root, pages):
    """Returns the page that a reference names: in the file's directory or the nearest one above, or the only page whose path ends so."""
    for directory in path.resolve().parents:
        if (directory / name).is_file():
            return directory / name
        if directory == root.resolve():
            break
    ending = [p for p in pages if p.as_posix().endswith("/" + name)]
    return ending[0] if len(ending) == 1 else None


def reference_faults(root):
    files = sorted(p for house in {*TOP_LEVEL, ".github"} for p in ([root / house] if (root / house).is_file() else (root / house).rglob("*"))
                   if p.suffix in REFERRING and "corpus" not in p.parts and p.name != pathlib.Path(__file__).name)
    pages = {p.resolve(): headings(p) for p in files if p.suffix == ".md" or p.relative_to(root).as_posix() in TABLES}
    for path in files:
        text, starts = joined(path.read_text(errors="replace"))
        place = lambda match: f"{path.relative_to(root)}:{bisect.bisect_right(starts, match.start())}"
        for match in PAGE.finditer(text):
            page = page_named(match[1], path, root, pages)
            if not page:
                yield f"{place(match)}: names a page that does not exist: {match[1]}"
            elif match[2] and match[2] not in pages.get(page, {}):
                yield f'{place(match)}: {match[1]} has no heading "{match[2]}"'
        for match in NUMBERED.finditer(text):
            if not FOREIGN.search(text[max(0, match.start() - 60) : match.start()]):
                yield f"{place(match)}: refers to a section by number; name the page and its heading: {text[max(0, match.start() - 40) : match.end() + 5]!r}"
        for match in LINK.finditer(text) if path.suffix == ".md" else ():
            target, _, anchor = match[1].partition("#")
            if "://" in target:
                continue
            page = (path.parent / target).resolve() if target else path.resolve()
            if not page.exists():
                yield f"{place(match)}: link to a file that does not exist: {match[1]}"
            elif anchor and anchor not in pages.get(page, {}).values():
                yield f"{place(match)}: link to a heading that does not exist: {match[1]}"


def sources_of(compiled):
    """The source files that a compiled file stands for: itself, or those that CMake has put into one (SHEARBUS_UNITY)."""
    if compiled.parent.name != "Unity" or not compiled.is_file():
        return [compiled]
    return [pathlib.Path(name) for name in re.findall(r'^#include "(.+)"$', compiled.read_text(), re.MULTILINE)]


def unbuilt_faults(root, compile_commands):
    compiled = [pathlib.Path(entry["file"]) for entry in compile_commands]
    built = {source.resolve() for file in compiled for source in sources_of(file)}
    installed = root / "tests/contract/install.py"  # builds the example hosts that it names from the installed tree
    hosts = installed.read_text() if installed.is_file() else ""
    for house in (*SOURCES, "tests"):
        for path in sorted((root / house).rglob("*.cpp")):
            is_host = path.parent == root / "client/examples" and path.name in hosts
            if path.resolve() not in built and not is_host:
                yield f"{path.relative_to(root)}: no target builds it"


def faults(root, compile_commands):
    yield from include_faults(root, table((root / "server/ARCHITECTURE.md").read_text()))
    yield from top_level_faults(root)
    yield from machine_faults(root)
    yield from number_faults(root)
    yield from reference_faults(root)
    yield from unbuilt_faults(root, compile_commands)


def self_test():
    """Checks that a tree with one violation of every rule gives exactly these faults."""
    with tempfile.TemporaryDirectory() as scratch:
        root = pathlib.Path(scratch)
        for house in ("proto", "server/physics/layer", "server/service", "client", "hydro_stub", "tests", "deploy", "extra"):
            (root / house).mkdir(parents=True)
        (root / "server/ARCHITECTURE.md").write_text(
            "## Who may include whom\n\n| room | may include |\n|---|---|\n| server/physics | Eigen |\n"
            "| server/service | server/physics/material |\n| tests | anything |\n")
        (root / "CMakeLists.txt").write_text("# from " + "/ho" + "me/someone/shearbus\n")
        (root / "server/physics/layer/heat.cpp").write_text('#include <zmq.hpp>\n#include <vector>\n#include <Eigen/Core>\n'
                                                            '#include "server/physics/layer/grid.hpp"\n')
        (root / "server/service/handle.cpp").write_text('#include "server/physics/material/material.hpp"\n'
                                                        '#include "server/physics/layer/grid.hpp"\n')
        (root / "client/stray.cpp").write_text("")
        (root / "server/MODEL.md").write_text("# Model\n\n## Heat of `q`\n\n```sh\n# no heading\n```\n")
        (root / "server/physics/layer/layer.hpp").write_text(
            '// Sound: server/MODEL.md, "Heat\n// of q", MODEL.md and DLP section 6.3. Not: MODEL.md, "no\n// heading"; server/MODEL.md section 3;\n'
            "// METHODS.md.\n")
        (root / "server/physics/layer/page.md").write_text(
            "[sound](../../MODEL.md#heat-of-q), [file](../../GONE.txt), [heading](../../MODEL.md#no-heading), section 4b\n")
        (root / "tests/measured.toml").write_text('[[part]]\ngroup = "Physics"\ntitle = "Two `half-spaces`"\n')
        (root / "tests/page.md").write_text("[sound](measured.toml#two-half-spaces), [table](measured.toml#gone)\n")
        (root / "tests/bound.hpp").write_text('// Sound: tests/measured.toml, "Physics". Not: tests/measured.toml, "Chemistry".\n')
        (root / ".github").mkdir()
        (root / ".github/security.md").write_text("[file](../GONE.txt)\n")
        (root / "tests/program.py").write_text('parser.add_argument("--steps", ' + 'type=' + 'int)\n')
        built = [{"file": str(root / f)} for f in ("server/physics/layer/heat.cpp", "server/service/handle.cpp")]
        found = "\n".join(faults(root, built))
        expected = ["may not include zmq.hpp", "service may not include server/physics/layer/grid.hpp", "extra: the top level",
                    "CMakeLists.txt:1: names a machine", "program.py:1: reads a number by argparse", "stray.cpp: belongs to no room", "stray.cpp: no target builds it",
                    'layer.hpp:2: MODEL.md has no heading "no heading"', "layer.hpp:3: refers to a section by number",
                    "layer.hpp:4: names a page that does not exist: METHODS.md", "page.md:1: link to a file that does not exist",
                    "page.md:1: link to a heading that does not exist", "page.md:1: refers to a section by number",
                    "security.md:1: link to a file that does not exist", "tests/page.md:1: link to a heading that does not exist: measured.toml#gone",
                    'bound.hpp:1: tests/measured.toml has no heading "Chemistry"']
        missed = [e for e in expected if e not in found]
        return [f"self-test: rule did not fire: {m}" for m in missed] + (
            [] if len(found.splitlines()) == len(expected) else [f"self-test: expected {len(expected)} faults, found:\n{found}"])


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--root", type=pathlib.Path, default=pathlib.Path(__file__).resolve().parents[2])
    parser.add_argument("--build", type=pathlib.Path, help="build directory with compile_commands.json")
    parser.add_argument("--self-test", action="store_true")
    options = parser.parse_args()
    found = self_test() if options.self_test else list(
        faults(options.root, json.loads((options.build / "compile_commands.json").read_text())))
    print("\n".join(found) if found else "the tree is as designed")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
