#!/usr/bin/python3
"""What if: the interface temperature of a contact under a range of friction coefficients and jumps.

One session per friction coefficient, one node per jump; the bodies are free plates of 1 mm, which friction brakes. Prints the
highest interface temperature (K) in 1 us."""
import argparse
import pathlib
import sys

import numpy

try:
    import shearbus
except ImportError as fault:
    sys.exit(f"sweep.py: the Python client cannot be loaded: {fault}; install it, or name its directory in PYTHONPATH (client/python)")

FRICTION = (0.05, 0.1, 0.2)
JUMPS = numpy.array([10.0, 50.0, 100.0])  # m/s
PRESSURE, MASS_SOFT, MASS_HARD = 1e9, 2.703, 7.9  # Pa, kg/m2 (1 mm of aluminium, of steel)
STEPS, DT = 100, 10e-9  # s
SCENE = pathlib.Path(__file__).with_name("constant_friction.toml")


def highest_temperature(friction, endpoint):
    """Returns the highest interface temperature (K) of each jump."""
    scene = shearbus.Scene(SCENE)
    scene["interface.friction_coefficient"] = friction
    jump, highest = JUMPS, numpy.zeros(len(JUMPS))
    with shearbus.open(scene, nodes=range(len(JUMPS)), endpoint=endpoint) as bus:
        for _ in range(STEPS):
            answer = bus.step(DT, jump=jump, pressure=PRESSURE, stress_soft=0.0, stress_hard=0.0, mass_soft=MASS_SOFT,
                              mass_hard=MASS_HARD)
            jump, highest = answer.jump_new, numpy.maximum(highest, answer.temperature)
    return highest


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("endpoint", nargs="?", help="of a server; without one the servers run in this process")
    place = parser.parse_args().endpoint
    print("mu  " + "".join(f"{jump:8.0f} m/s" for jump in JUMPS))
    try:
        for mu in FRICTION:
            print(f"{mu:4.2f}" + "".join(f"{temperature:10.2f} K" for temperature in highest_temperature(mu, place)))
    except shearbus.Error as fault:
        sys.exit(f"sweep.py: {fault}")
