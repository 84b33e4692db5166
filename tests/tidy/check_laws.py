#!/usr/bin/python3
"""Holds every registered law to its list of edits in server/ARCHITECTURE.md, "Adding a flow law" and "Adding a friction law": each row
names a file, or a directory, that must mention the law by its class, its word or its enumerator; each constant of a flow law is a row
and a key. Run with --self-test to see each rule fail on a tree made for it."""
import argparse
import pathlib
import re
import sys
import tempfile

LIST = "server/physics/material/flow_law_list.hpp"
FRICTION_LIST = "server/physics/interface/friction_laws.hpp"
SCHEMA = "proto/shearbus/v1/scene.proto"
CONSTANTS = "server/physics/material/material.cpp"


def laws(root, kind, path):
    """Classes in the order of the list."""
    text = re.sub(r"//.*", "", (root / path).read_text())
    return re.search(rf"{kind}Laws\s*=\s*{kind}LawList<([^>]*)>", text).group(1).replace(" ", "").replace("\n", "").split(",")


def word_of(law):
    return re.sub(r"(?<!^)(?=[A-Z])", "_", law).lower()


def rows(root, kind):
    """Paths of the table of edits; <law> stands for the word of the law."""
    page = (root / "server/ARCHITECTURE.md").read_text()
    section = page.split(f"### Adding a {kind.lower()} law", 1)[1].split("\n## ", 1)[0].split("\n### ", 1)[0]
    return re.findall(r"^\| \d+ \| `([^`]+)`", section, re.M)


def registered_row(root, path):
    """The row of the page's table that names a list, and the files of the laws there are."""
    return next((line for line in (root / "server/ARCHITECTURE.md").read_text().splitlines()
                 if line.startswith("|") and f"`{path.removeprefix('server/')}` | `" in line), "")


def mentions(path, names):
    files = [path] if path.is_file() else [p for p in path.rglob("*") if p.is_file()]
    return any(name in p.read_text(errors="replace") for p in files for name in names)


def list_faults(root, kind, path, schema):
    """Faults of one list of laws against its table of edits and its enum."""
    places = rows(root, kind)
    if len(places) < 5:
        yield f"server/ARCHITECTURE.md: the list of edits of a {kind.lower()} law is missing"
    for place, law in enumerate(laws(root, kind, path)):
        # The law with a constant coefficient is called "constant" in a scene; the twin and the draws have only its coefficient.
        word, enumerator = word_of(law), "CONSTANT" if law == "ConstantFriction" else word_of(law).upper()
        file = "coulomb" if law == "ConstantFriction" else word
        names = (law, word, f"{kind.upper()}_LAW_{enumerator}", *(["friction_coefficient"] if law == "ConstantFriction" else []))
        if f"`{file}.hpp`" not in registered_row(root, path):
            yield f"server/ARCHITECTURE.md: the laws there are lack {file}.hpp"
        for row in places:
            target = root / row.replace("<law>", file)
            if not target.exists():
                yield f"{row}: {law} has no such file"
            elif not mentions(target, names):
                yield f"{row}: does not mention {law}"
        if not re.search(rf"\b{kind.upper()}_LAW_{enumerator} = {place + 1};", schema):
            yield f"{SCHEMA}: {law} is not number {place + 1} of the enum {kind}Law"


def constant_faults(root, schema):
    """Each constant of a flow law has a row of material_fields() and a key used_with the law."""
    constants = (root / CONSTANTS).read_text()
    for law in laws(root, "Flow", LIST):
        word = word_of(law)
        header = root / f"server/physics/material/{word}.hpp"
        own = re.search(r"kConstants = \{(.*?)\};", header.read_text(), re.S) if header.exists() else None
        for member in re.findall(r"&Material::(\w+)", own.group(1)) if own else []:
            key = re.search(rf'MaterialField\{{"(\w+)", &Material::{member},', constants)
            if not key:
                yield f"{CONSTANTS}: no row for the constant {member} of {law}"
            elif not re.search(rf'\b{key.group(1)} = \d+\s*\[\(rule\) = {{[^}}]*used_with: "flow_law=[^"]*\b{word}\b', schema):
                yield f"{SCHEMA}: {key.group(1)} is not used_with flow_law={word}"


def faults(root):
    schema = (root / SCHEMA).read_text()
    yield from list_faults(root, "Flow", LIST, schema)
    yield from list_faults(root, "Friction", FRICTION_LIST, schema)
    yield from constant_faults(root, schema)


def self_test():
    """A tree with a sound law and one that lacks everything must give exactly the faults of the second."""
    with tempfile.TemporaryDirectory() as scratch:
        root = pathlib.Path(scratch)
        files = {
            LIST: "using FlowLaws = FlowLawList<SoundLaw,  // one line each\n  BareLaw>;\n",
            FRICTION_LIST: "using FrictionLaws = FrictionLawList<SoundLaw, BareRubbing>;\n",
            SCHEMA: 'FLOW_LAW_SOUND_LAW = 1;\nFRICTION_LAW_SOUND_LAW = 1;\noptional double a_pa = 1 [(rule) = {used_with: "flow_law=sound_law"}];\n'
                    'optional double b_pa = 2 [(rule) = {unit: "Pa"}];\n',
            CONSTANTS: 'MaterialField{"a_pa", &Material::a, true, false}, MaterialField{"b_pa", &Material::b, true, false},\n',
            "server/physics/material/sound_law.hpp": "class SoundLaw { kConstants = {&Material::a}; };\n",
            "server/physics/material/bare_law.hpp": "class BareLaw { kConstants = {&Material::b, &Material::c}; };\n",
            "twin.cpp": "SoundLaw\n", "tests/sound_law.cpp": "sound_law\n",
            "server/ARCHITECTURE.md": f"| flow | `{LIST.removeprefix('server/')}` | `sound_law.hpp` |\n"
                                      f"| friction | `{FRICTION_LIST.removeprefix('server/')}` | `sound_law.hpp` |\n"
                                      "### Adding a flow law\n\n| | file |\n|---|---|\n| 1 | `server/physics/material/<law>.hpp` |\n"
                                      f"| 2 | `{LIST}` |\n| 3 | `{SCHEMA}` |\n| 4 | `twin.cpp` |\n| 5 | `tests` |\n| 6 | `<law>.txt` |\n"
                                      f"### Adding a friction law\n\n| 1 | `{FRICTION_LIST}` |\n| 2 | `{SCHEMA}` |\n| 3 | `twin.cpp` |\n"
                                      "| 4 | `tests` |\n| 5 | `<law>.txt` |\n",
            "sound_law.txt": "sound_law\n"}
        for name, text in files.items():
            (root / name).parent.mkdir(parents=True, exist_ok=True)
            (root / name).write_text(text)
        found = list(faults(root))
        expected = [*(f"server/ARCHITECTURE.md: the laws there are lack {bare}.hpp" for bare in ("bare_law", "bare_rubbing")),
                    f"{SCHEMA}: does not mention BareLaw", "twin.cpp: does not mention BareLaw", "tests: does not mention BareLaw",
                    "<law>.txt: BareLaw has no such file", f"{SCHEMA}: BareLaw is not number 2 of the enum FlowLaw",
                    f"{SCHEMA}: b_pa is not used_with flow_law=bare_law", f"{CONSTANTS}: no row for the constant c of BareLaw",
                    f"{SCHEMA}: does not mention BareRubbing", "twin.cpp: does not mention BareRubbing", "tests: does not mention BareRubbing",
                    "<law>.txt: BareRubbing has no such file", f"{SCHEMA}: BareRubbing is not number 2 of the enum FrictionLaw"]
        return [] if sorted(found) == sorted(expected) else ["self-test: expected", *sorted(expected), "found", *sorted(found)]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--root", type=pathlib.Path, default=pathlib.Path(__file__).resolve().parents[2])
    parser.add_argument("--self-test", action="store_true")
    options = parser.parse_args()
    found = self_test() if options.self_test else list(faults(options.root))
    print("\n".join(found))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
