#!/usr/bin/python3
"""Holds all pictures to one look: client/report/style.py has the colour of each regime, under the names of the enum
Regime, and no other file gives a regime a colour: it has neither the colours of style.py nor a colour next to the
name of a regime. A file that writes pictures writes their footer by style.py. With --self-test each rule must fail on
a tree made for it."""
import argparse
import pathlib
import re
import sys
import tempfile

STYLE = "client/report/style.py"
ROOMS = ("client", "hydro_stub", "tests", "deploy")
NAMED = re.compile(r"""["'](?:open|stick|coulomb|tresca|(?:tresca, )?melting)["']\s*[,:=]+\s*[("'\[]*["'](?:#[0-9a-f]{3,8}|tab:\w+|C\d|red|green|blue|orange|grey|gray|black|white)["']""", re.I)


def regimes(root):
    """Returns the names of the enum Regime."""
    block = re.search(r"enum Regime \{(.*?)\n\}", (root / "proto/shearbus/v1/downscale.proto").read_text(), re.S)[1]
    return re.findall(r"^  REGIME_(\w+) = \d+;", block, re.M)


def faults(root):
    style = (root / STYLE).read_text()
    block = re.search(r"^REGIMES = \{(.*?)^\}", style, re.M | re.S)[1]
    if re.findall(r'^    "(\w+)":', block, re.M) != regimes(root):
        yield f"{STYLE}: REGIMES are not those of the enum Regime, in its order"
    colours = {colour.lower() for colour in re.findall(r'"(#[0-9a-fA-F]{6})"', block)}
    for path in sorted(p for room in ROOMS for p in (root / room).rglob("*") if p.suffix in (".py", ".html")):
        name = path.relative_to(root).as_posix()
        if name in (STYLE, f"tests/tidy/{pathlib.Path(__file__).name}"):
            continue
        text = path.read_text()
        if re.search(r"\.(?:savefig|SaveScreenshot)\(", text) and "provenance_text(" not in text:
            yield f"{name}: writes a picture without the footer of {STYLE}: use save() or provenance_text()"
        for number, line in enumerate(text.splitlines(), 1):
            if any(colour in line.lower() for colour in colours):
                yield f"{name}:{number}: has a colour of a regime; take it from {STYLE}"
            elif NAMED.search(line):
                yield f"{name}:{number}: gives a regime a colour; take it from {STYLE}"


def self_test():
    with tempfile.TemporaryDirectory() as scratch:
        root = pathlib.Path(scratch)
        for directory in ("proto/shearbus/v1", "client/report", "hydro_stub", "tests", "deploy"):
            (root / directory).mkdir(parents=True)
        (root / "proto/shearbus/v1/downscale.proto").write_text("enum Regime {\n  REGIME_OPEN = 0;  // no contact\n  REGIME_STICK = 1;\n}\n")
        (root / STYLE).write_text('REGIMES = {\n    "OPEN": ("open", "#f2f2f2"),\n}\n')
        (root / "hydro_stub/a.py").write_text('x = "#F2F2F2"\ny = {"stick": "tab:blue"}\nz = [("Coulomb", "#123456")]\nlaws = {"stick": ("stick", 3)}\n')
        (root / "deploy/b.py").write_text("plt.savefig('x.png')\n")
        found = "\n".join(faults(root))
        expected = ("b.py: writes a picture without", "REGIMES are not those", "a.py:1: has a colour", "a.py:2: gives a regime", "a.py:3: gives a regime")
        return [f"self-test: rule did not fire: {rule}" for rule in expected if rule not in found] + ["self-test: too many faults"] * (len(found.splitlines()) != len(expected))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--root", type=pathlib.Path, default=pathlib.Path(__file__).resolve().parents[2])
    parser.add_argument("--self-test", action="store_true")
    options = parser.parse_args()
    found = self_test() if options.self_test else list(faults(options.root))
    print("\n".join(found) or "one look")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
