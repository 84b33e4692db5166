#!/usr/bin/python3
"""Runs the host of kit_host.py, in both request forms, on each problem of client/examples/problems, and compares it with the tables.

friction_problems.py [ENDPOINT] [--measure | --self-test]     without an endpoint the server runs in this process
--measure prints the errors; --self-test runs hosts that begin a thousandth too fast, which must be noticed"""
import copy
import sys

import kit_host  # finds the package in the source tree
import numpy
import problem_answers

SOURCE = kit_host.SOURCE
PLATE_ZONES, SKIPPED = 200, 20  # SKIPPED: steps after the start and after each front whose T0 is not looked at
BOUNDS = {  # problem -> V (m/s), s (relative to its largest), T0 (K); client/examples/problems/README.md has them
    "constant_friction": (1e-7, 1e-9, 0.3),
    "softening_friction": (0.03, 6e-4, 0.5),
    "finite_plate": (1e-7, 1e-9, 0.2),
    "stick_slip_brake": (1e-7, 1e-9, 0.05),
    "flash_to_melting": (0.02, 3e-3, 2.0),
    "opening_and_closing": (1e-7, 1e-9, 0.6),
    "turned_line": (1e-7, 1e-9, 0.3),
}


def scene_of(problem):
    """Returns the scene of a problem: that of the example host with the problem's friction."""
    law = problem["friction"]
    scene = {"name": problem["name"], "strategy": "force_driven", "soft": {"material": "aluminium_dlp"}, "hard": {"material": "steel_dlp"},
             "layer": {"thickness_m": 100e-6, "cells": 80, "grading": 1.06, "far_boundary": "half_space"},
             "interface": {"friction_coefficient": law.get("coefficient", 0.3), "yield_strength_pa": law.get("yield_strength_pa", 10e9)}}
    if "line" in problem:
        scene["tangential_components"] = 2
    return scene


def run(problem, form, endpoint=None):
    """Returns the times and the jump, stress (both along the line), temperature, and the components of the velocities and of the stress of a run."""
    angle = numpy.radians(problem.get("line", {}).get("angle_degrees", 0.0))
    tangent = numpy.array([numpy.cos(angle), numpy.sin(angle)]) if "line" in problem else numpy.ones(1)
    name = "two_half_spaces" if problem["name"] == "constant_friction" else problem["name"]
    rows = kit_host.run(endpoint, name, None if form == "far_field" else "stick_form", nodes=1, plate_zones=PLATE_ZONES,
                        end=problem_answers.TIMES[problem["name"]][-1], jump=problem["start"]["velocity_jump_m_per_s"], scene=scene_of(problem),
                        check_closure="error")
    time, soft, hard, stress, temperature = map(numpy.array, zip(*rows))
    return smooth(numpy.vstack([time, (soft - hard) @ tangent, stress @ tangent, temperature, soft.T, hard.T, stress.T]))


def smooth(rows):
    """Returns rows without what alternates from step to step: after a sudden change of stress a velocity at half steps swings about its mean."""
    inner = (rows[:, :-2] + 2 * rows[:, 1:-1] + rows[:, 2:]) / 4
    return numpy.hstack([rows[:, :1], inner, rows[:, -1:]])


def errors(problem, table, found):
    """Returns the largest errors of V, s and T0 of a run against the rows of a table."""
    times = table["time_s"]
    expected = [table["jump_m_per_s"], table["shear_stress_pa"]]
    values = [found[1], found[2]]
    if "line" in problem:  # the components, which are in the table
        names = [f"velocity_{side}_{axis}_m_per_s" for side in ("soft", "hard") for axis in "xy"]
        expected = [numpy.hstack([table[name] for name in names]), numpy.hstack([table["friction_on_hard_x_pa"], table["friction_on_hard_y_pa"]])]
        at = lambda rows: numpy.hstack([numpy.interp(times, found[0], row) for row in rows])
        values = [at(found[4:8]), at(found[8:10])]
    else:
        values = [numpy.interp(times, found[0], row) for row in values]
    late = times > SKIPPED * (found[0][1] - found[0][0])
    temperature = numpy.interp(times, found[0], found[3])
    return (abs(values[0] - expected[0]).max(), abs(values[1] - expected[1]).max() / abs(expected[1]).max(),
            abs(temperature - table["temperature_k"])[late].max())


def self_test(endpoint):
    """Returns the problems in which a host that begins a thousandth too fast was not noticed."""
    missed = []
    for problem, path in problem_answers.problems(SOURCE / "client/examples/problems"):
        wrong = copy.deepcopy(problem)
        wrong["start"]["velocity_jump_m_per_s"] *= 1.001
        found = errors(problem, numpy.genfromtxt(path, delimiter=",", names=True), run(wrong, "stick", endpoint))
        if found[0] <= BOUNDS[problem["name"]][0]:
            missed.append(f"{problem['name']}: a start that is a thousandth too fast was not noticed, {found}")
    return missed


def main(words):
    measure, endpoint = "--measure" in words, next((word for word in words if not word.startswith("--")), None)
    if "--self-test" in words:
        missed = self_test(endpoint)
        print("\n".join(missed) or "wrong hosts are noticed")
        return bool(missed)
    wrong, played = [], set()
    for problem, path in problem_answers.problems(SOURCE / "client/examples/problems"):
        table = numpy.genfromtxt(path, delimiter=",", names=True)
        for form in ("far_field", "stick"):
            found = errors(problem, table, run(problem, form, endpoint))
            played.add(problem["name"])
            if measure:
                print(problem["name"], form, *(f"{value:.2e}" for value in found))
            if any(not value <= bound for value, bound in zip(found, BOUNDS[problem["name"]])):
                wrong.append(f"{problem['name']}, {form}: errors of V, s, T0 {found}, expected at most {BOUNDS[problem['name']]}")
    if played != set(BOUNDS):
        wrong.append(f"expected the problems {sorted(BOUNDS)}, found {sorted(played)}")
    print("\n".join(wrong) or f"{len(played)} problems in both forms are as in their tables")
    return bool(wrong)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
