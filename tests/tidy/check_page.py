#!/usr/bin/python3
"""Checks that a committed page equals the output of the program that prints it: check_page.py PAGE COMMAND... With --self-test it checks
that a page which differs is detected."""
import difflib
import pathlib
import subprocess
import sys
import tempfile


def difference(page, command):
    printed = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    committed = page.read_text()
    return list(difflib.unified_diff(committed.splitlines(), printed.splitlines(), str(page), "printed", lineterm="", n=0))


def self_test():
    with tempfile.TemporaryDirectory() as scratch:
        page = pathlib.Path(scratch, "page.txt")
        page.write_text("one\ntwo\n")
        same = difference(page, ["printf", "one\\ntwo\\n"])
        other = difference(page, ["printf", "one\\nthree\\n"])
        return [] if not same and other else ["self-test: a page that differs was not seen"]


def main():
    found = self_test() if sys.argv[1:] == ["--self-test"] else difference(pathlib.Path(sys.argv[1]), sys.argv[2:])
    print("\n".join(found) if found else "the page is what the program prints")
    if found and sys.argv[1:] != ["--self-test"]:
        print(f"print it again: {pathlib.Path(sys.argv[2]).name} {' '.join(sys.argv[3:])} > {sys.argv[1]}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
