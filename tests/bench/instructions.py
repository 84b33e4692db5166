"""Counts the instructions of a node-step with callgrind and fails above the bounds below.

A count does not depend on the load of the machine. The start of the program cancels in the difference of two runs.
"""

import argparse
import re
import subprocess
import sys

LANES = 8
STEPS = {"force_driven": (100, 600), "velocity_driven": (0, 1000)}  # of the two runs
# Most instructions of a node-step of shearbus-bench-steps, by strategy and case. Counted with gcc 12: 556 and
# 306; 4,329 and 3,862.
BOUNDS = {"force_driven": {"profile": 600, "modes": 340}, "velocity_driven": {"layer_shear": 4400, "interface_slip": 3950}}
NO_ANSWER = 77  # the machine has no AVX2: the counts are not meant for it


def instructions(valgrind, program, case, steps):
    run = subprocess.run([valgrind, "--tool=callgrind", "--callgrind-out-file=/dev/null", program, case, str(steps)],
                         capture_output=True, text=True)
    if run.returncode == NO_ANSWER:
        sys.exit(NO_ANSWER)
    found = re.search(r"Collected : (\d+)", run.stderr)
    if run.returncode != 0 or not found:
        sys.exit(f"callgrind ended with {run.returncode}:\n{run.stderr}")
    return int(found.group(1))


def main():
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--valgrind", required=True)
    arguments.add_argument("--program", required=True)
    arguments.add_argument("--strategy", required=True, choices=BOUNDS)
    given = arguments.parse_args()
    above = 0
    for case, bound in BOUNDS[given.strategy].items():
        short, long = STEPS[given.strategy]
        counts = [instructions(given.valgrind, given.program, case, steps) for steps in (short, long)]
        count = (counts[1] - counts[0]) / ((long - short) * LANES)
        print(f"{case}: {count:.0f} instructions a node-step, at most {bound} expected")
        above += count > bound
    sys.exit(1 if above else 0)


if __name__ == "__main__":
    main()
