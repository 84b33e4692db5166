#!/usr/bin/python3
"""Counts with callgrind what each option of server/physics/solver/parts_table.hpp makes of the instructions of a node-step, and compares with
the column "cost" of the page of options; fails where a cost is missing or off by more than a tenth. The case is that of the paper, its first
microsecond on 60 graded cells, with the option and without it, a companion that the option needs being in both."""
import argparse
import re
import subprocess
import sys

from instructions import LANES, instructions

STEPS = 1000
STRATEGIES = {"velocity_driven": "velocity-driven", "force_driven": "force-driven"}
ACCURACY = 0.1
EXCLUDED = 3  # exit code of the program: the strategy excludes the option


def node_step(valgrind, program, case):
    """Returns the instructions of a node-step, or None where there is no such case."""
    if subprocess.run([program, case, "0"], check=False).returncode == EXCLUDED:
        return None
    counts = [instructions(valgrind, program, case, steps) for steps in (0, STEPS)]
    return (counts[1] - counts[0]) / (STEPS * LANES)


def measured(valgrind, program, key):
    """Returns the ratio of the instructions with the option to those without it, by strategy."""
    ratios = {}
    for strategy, name in STRATEGIES.items():
        there = node_step(valgrind, program, f"{strategy}: {key}")
        if there is not None:
            ratios[name] = there / node_step(valgrind, program, f"{strategy} without: {key}")
    return ratios


def text(ratios):
    return ", ".join(f"{name} x {ratio:.2f}" if ratio < 10 else f"{name} x {ratio:.0f}" for name, ratio in ratios.items())


def costs(page):
    """Returns the costs that the page tells, by the setting of the option."""
    rows = page[page.index("## Options"):page.index("## Friction laws")].splitlines()
    cells = [[cell.strip() for cell in row.strip("|").split(" | ")] for row in rows if row.startswith("| `")]
    return {row[0].strip("` "): {name: float(ratio) for name, ratio in re.findall(r"([a-z-]+) x ([0-9.]+)", row[3])} for row in cells}


def main():
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--valgrind", default="valgrind")
    arguments.add_argument("--program", required=True, help="shearbus-bench-steps")
    arguments.add_argument("--ctl", help="shearbus-ctl, whose page of options is compared; without it the costs are printed")
    given = arguments.parse_args()
    keys = subprocess.run([given.program, "options"], capture_output=True, text=True, check=True).stdout.splitlines()
    told = costs(subprocess.run([given.ctl, "options"], capture_output=True, text=True, check=True).stdout) if given.ctl else {}
    wrong = 0
    for key in keys:
        found = measured(given.valgrind, given.program, key)
        print(f"{key}: {text(found)}", flush=True)
        if not given.ctl:
            continue
        setting = next((s for s in told if s.strip("[]") == key or s == key or (" = " not in key and s.startswith(key + " = "))), None)
        page = told.get(setting, {})
        good = page.keys() == found.keys() and all(abs(page[n] / found[n] - 1) <= ACCURACY for n in found)
        if not good:
            print(f"  the page tells {text(page) if page else 'nothing'}")
        wrong += not good
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
