"""Counts instructions with callgrind, of a node-step, of a step's way over the bus or of a zone-step of the hydro stub; fails above the bounds
below.

A count does not depend on the load of the machine. The start of the program cancels in the difference of two runs.
"""

import argparse
import json
import pathlib
import re
import subprocess
import sys
import tempfile

LANES = 8
STEPS = {"force_driven": (100, 600), "velocity_driven": (0, 1000)}  # of the two runs
# Most instructions of a node-step of shearbus-bench-steps, by strategy and case. Counted with gcc 12: force-driven 613,
# 341, 1616, 763, 706, 819, 649, 671, 726, 728, 1811, 5,512, 5,541, 19,023; velocity-driven 3,777, 3,739, 24,288, 29,620 and
# 79,408. With a tolerance a layer that flows under force takes at most 6 times what it takes without.
BOUNDS = {
    "force_driven": {
        "profile": 640, "modes": 357, "sdirk2": 1690, "sdirk2_modes": 790, "junctions": 750, "junctions_softening": 900,
        "weakening": 675, "weakening_yields": 700, "softening": 790, "softening_yields": 790, "softening_sdirk2": 1960,
        "plastic_layer": 5600, "plastic_layer_pulled": 5630, "plastic_layer_pulled_1e-3": 19_300,
    },
    "velocity_driven": {
        "layer_shear": 3860, "interface_slip": 3830, "inertia": 25_400, "johnson_cook": 31_200, "preston_tonks_wallace": 83_000,
    },
}
# The flow of a layer is the same sum under either strategy: most instructions under force relative to layer_shear. Counted: 1.45 and 1.46.
MOST_OF_LAYER_SHEAR = {"plastic_layer": 1.47, "plastic_layer_pulled": 1.48}
# Most instructions of a step of shearbus-bench-exchange beyond those of the shard, by number of nodes.
EXCHANGE_STEPS = (4, 12)  # of the two runs
EXCHANGE_BOUNDS = {
    "service": {100: 39_000, 10_000: 960_000},
    "embedded": {100: 32_500, 10_000: 350_000},
}
# Most instructions of a zone-step of shearbus-hydro, contact included, on one thread: the start of cone_al_steel_fine. Counted with gcc 12: 1,008.
HYDRO_BOUND, HYDRO_END = 1100, "0.01e-6"
NO_ANSWER = 77  # the machine has no AVX2: the counts are not meant for it


def instructions(valgrind, program, *arguments):
    command = [valgrind, "--tool=callgrind", "--callgrind-out-file=/dev/null", program, *map(str, arguments)]
    run = subprocess.run(command, capture_output=True, text=True)
    if run.returncode == NO_ANSWER:
        sys.exit(NO_ANSWER)
    found = re.search(r"Collected : (\d+)", run.stderr)
    if run.returncode != 0 or not found:
        sys.exit(f"callgrind ended with {run.returncode}:\n{run.stderr}")
    return int(found.group(1))


def per_step(valgrind, program, steps, *arguments):
    """Returns the instructions of a step: the difference of two runs of `steps` steps, without their common start."""
    counts = [instructions(valgrind, program, *arguments, number) for number in steps]
    return (counts[1] - counts[0]) / (steps[1] - steps[0])


def of_zone_step(valgrind, program, scene):
    if "avx2" not in pathlib.Path("/proc/cpuinfo").read_text():
        sys.exit(NO_ANSWER)
    with tempfile.TemporaryDirectory() as directory:
        text, found = re.subn(r"(?m)^end_time_s = \S+", f"end_time_s = {HYDRO_END}", pathlib.Path(scene).read_text())
        if found != 1:
            sys.exit(f"{scene}: expected one line end_time_s = ..., found {found}")
        short, out = pathlib.Path(directory, "scene.toml"), pathlib.Path(directory, "run")
        short.write_text(text)
        count = instructions(valgrind, "--toggle-collect=*lagrange::Cycle::advance(double)*", program, short, "--out", out, "--no-plot", "--no-progress")
        summary = json.loads((out / "summary.json").read_text())
    return count / (summary["zones"] * summary["steps"])


def main():
    arguments = argparse.ArgumentParser(description=__doc__)
    arguments.add_argument("--valgrind", required=True)
    arguments.add_argument("--program", required=True)
    arguments.add_argument("--strategy", choices=BOUNDS, help="without it the exchange of a step is counted")
    arguments.add_argument("--hydro-scene", help="scene of shearbus-hydro, the program: a zone-step is counted")
    given = arguments.parse_args()
    above = 0
    if given.hydro_scene:
        count = of_zone_step(given.valgrind, given.program, given.hydro_scene)
        print(f"{count:.0f} instructions a zone-step, at most {HYDRO_BOUND} expected")
        above += count > HYDRO_BOUND
    elif given.strategy:
        counts = {}
        for case, bound in BOUNDS[given.strategy].items():
            counts[case] = count = per_step(given.valgrind, given.program, STEPS[given.strategy], case) / LANES
            print(f"{case}: {count:.0f} instructions a node-step, at most {bound} expected")
            above += count > bound
        if given.strategy == "force_driven":
            layer_shear = per_step(given.valgrind, given.program, STEPS["velocity_driven"], "layer_shear") / LANES
            for case, most in MOST_OF_LAYER_SHEAR.items():
                print(f"{case}: {counts[case] / layer_shear:.3f} times layer_shear, at most {most} expected")
                above += counts[case] > most * layer_shear
    else:
        for nodes in EXCHANGE_BOUNDS["service"]:
            shard = per_step(given.valgrind, given.program, EXCHANGE_STEPS, "shard", nodes)
            for kind, bounds in EXCHANGE_BOUNDS.items():
                count = per_step(given.valgrind, given.program, EXCHANGE_STEPS, kind, nodes) - shard
                print(f"{kind}, {nodes} nodes: {count:.0f} instructions of a step over the bus, at most {bounds[nodes]} expected")
                above += count > bounds[nodes]
    sys.exit(1 if above else 0)


if __name__ == "__main__":
    main()
