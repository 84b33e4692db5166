#!/usr/bin/python3
"""Holds every verb of the protocol to the list of edits under "Adding a verb" in .github/CONTRIBUTING.md: each row names a file, or a
directory, that must mention the verb. Production code outside of the list may mention at most the verbs that it uses or records.
Run with --self-test to see each rule fail on a tree made for it."""
import argparse
import pathlib
import re
import sys
import tempfile

PAGE = ".github/CONTRIBUTING.md"
TABLE = "server/service/verbs.cpp"
MOST = 13  # rows of the list
# Files outside of the list that treat some verbs by name: which requests a recording, a replay, a shard or a step needs to know apart.
BY_NAME = ("client/replay/", "client/mpi/", "client/examples/", "client/ctl/", "client/report/", "hydro_stub/", "proto/files/",
           "proto/wire/columns.inc", "deploy/", "client/README.md", "client/replay/README.md")
CODE = (".cpp", ".hpp", ".h", ".inc", ".proto", ".f90", ".c")


def rows(root):
    """(file, whether it is for every verb) of the list of edits."""
    page = (root / PAGE).read_text()
    if "## Adding a verb" not in page:
        return []
    section = page.split("## Adding a verb", 1)[1].split("\n## ", 1)[0]
    return [(path, who != "hosts") for path, who in re.findall(r"^\| \d+ \| `([^`]+)` \| (\w+) \|", section, re.M)]


def verbs(root):
    """(struct, whether hosts ask for it) of the rows of the table."""
    table = (root / TABLE).read_text()
    return [(name, kind == "next") for kind, name in re.findall(r"^\s*(aside|next)<wire::(\w+), &Service::", table, re.M)]


def names_of(struct):
    verb = re.sub(r"(?<!^)(?=[A-Z])", "_", struct).lower()
    return struct, verb, verb.split("_")[0]


def mentions(path, names):
    files = [path] if path.is_file() else [p for p in path.rglob("*") if p.is_file() and p.suffix not in (".pyc", ".so")]
    return any(re.search(rf"(?<![a-z]){re.escape(name)}", p.read_text(errors="replace")) for p in files for name in names)


def faults(root):
    places, known = rows(root), verbs(root)
    if not places or len(places) > MOST:
        yield f"{PAGE}: a list of 1 to {MOST} places of a verb is expected, found {len(places)}"
    if len(known) < 2:
        yield f"{TABLE}: no rows of verbs are found"
    for struct, of_hosts in known:
        for place, of_all in places:
            if not of_all and not of_hosts:
                continue
            if not (root / place).exists():
                yield f"{place}: is on the list of {PAGE}, and is not there"
            elif not mentions(root / place, names_of(struct)):
                yield f"{place}: does not mention {struct}"
    # Whoever writes a struct of a request outside of the list is a place that the list lacks.
    listed = [place for place, _ in places]
    for path in sorted(p for room in ("proto", "server", "client", "hydro_stub") for p in (root / room).rglob("*")):
        name = str(path.relative_to(root))
        if path.suffix not in CODE or any(name == place or name.startswith(place + "/") for place in listed):
            continue
        if name.startswith(BY_NAME):
            continue
        for struct, _ in known:
            if re.search(rf"\bwire::{struct}\b", path.read_text(errors="replace")):
                yield f"{name}: mentions wire::{struct} and is not on the list of {PAGE}"


def self_test():
    page = ("## Adding a verb\n| | file | of | edit |\n| 1 | `proto/wire/messages.hpp` | all | x |\n| 2 | `client/src` | hosts | x |\n"
            "| 3 | `server/service` | all | x |\n")
    good = {PAGE: page, TABLE: "  aside<wire::Hello, &Service::hello>(),\n  next<wire::RetireNodes, &Service::retire_nodes>(x),\n",
            "proto/wire/messages.hpp": "struct Hello {}; struct RetireNodes {};", "client/src/session.cpp": "wire::RetireNodes"}
    wrong = {
        "the list is gone": {PAGE: "nothing"},
        "the list is longer": {PAGE: page + "".join(f"| {i} | `client/src` | all | x |\n" for i in range(4, 15))},
        "a verb is not where all are": {"proto/wire/messages.hpp": "struct RetireNodes {};"},
        "a verb of hosts is not in the client": {"client/src/session.cpp": ""},
        "a file of the list is gone": {PAGE: page + "| 4 | `proto/gone.txt` | all | x |\n"},
        "a file is not on the list": {"client/core/more.cpp": "wire::RetireNodes"},
        "the table has no rows": {TABLE: ""},
    }
    for what, changed in {"": {}, **wrong}.items():
        with tempfile.TemporaryDirectory() as scratch:
            root = pathlib.Path(scratch)
            for name, text in {**good, **changed}.items():
                (root / name).parent.mkdir(parents=True, exist_ok=True)
                (root / name).write_text(text)
            found = list(faults(root))
            if bool(found) != bool(what):
                sys.exit(f"self-test, {what or 'a good tree'}: {found}")


def main():
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--self-test", action="store_true")
    if arguments.parse_args().self_test:
        return self_test()
    found = list(faults(pathlib.Path(__file__).resolve().parents[2]))
    sys.exit("\n".join(found) if found else 0)


if __name__ == "__main__":
    main()
