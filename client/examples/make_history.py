#!/usr/bin/python3
"""Writes a macroscopic history for shearbus-replay with h5py: a place to start your own from.

  make_history.py constant OUT.h5       one node at 100 m/s and 11.2 GPa for 1 us (DLP 5.1)
  make_history.py ramp OUT.h5           8 nodes; the pressure rises, the contact opens, and closes again
  make_history.py force_driven OUT.h5   4 pairs of plates at 25 to 100 m/s, stopped by friction alone (closed loop)
  make_history.py imposed OUT.h5        4 force-driven nodes whose sliding at 25 to 100 m/s the host keeps up
  make_history.py pressed OUT.h5        the same, pressed twice as much after half of the time
  make_history.py stepped OUT.h5        one node that slides ten times as fast in the middle third of the time
  make_history.py rates OUT.h5          13 nodes at 1 to 1000 m/s, in steps that grow
  make_history.py pressures OUT.h5      11 nodes at 0.5 to 20 GPa
  make_history.py turning OUT.h5        a node whose sliding turns round in the interface, pressed on and off

What the datasets mean is in client/replay/README.md. Everything is SI."""
import argparse
import os
import re

import h5py
import numpy as np

MASS_OF_1_MM_ALUMINIUM = 2703 * 1e-3  # kg/m2
MASS_OF_1_MM_STEEL = 7900 * 1e-3


def start(file, times, node_ids):
    """The three datasets every history has, but for the pressure."""
    time = file.create_dataset("time", data=times)  # the END of each step
    time.attrs["units"] = "s"
    time.attrs["t0"] = 0.0  # the start of the first
    file.create_dataset("node_id", data=np.asarray(node_ids, dtype=np.uint64))


def put(file, name, units, values):
    file.create_dataset(name, data=np.asarray(values, dtype=np.float64)).attrs["units"] = units


def constant(file, args):
    times = args.dt * np.arange(1, args.steps + 1)
    start(file, times, [0])
    put(file, "pressure", "Pa", np.full((args.steps, 1), args.pressure))
    put(file, "velocity_jump", "m s-1", np.full((args.steps, 1), args.velocity))


def rates(file, args):
    jumps = np.geomspace(1e-2, 10.0, 13) * args.velocity
    start(file, args.dt * np.geomspace(1.0, 1e5, args.steps), np.arange(13))
    put(file, "pressure", "Pa", np.full((args.steps, 13), args.pressure))
    put(file, "velocity_jump", "m s-1", np.tile(jumps, (args.steps, 1)))


def pressures(file, args):
    start(file, args.dt * np.arange(1, args.steps + 1), np.arange(11))
    put(file, "pressure", "Pa", np.tile(np.linspace(0.5e9, 20e9, 11), (args.steps, 1)))
    put(file, "velocity_jump", "m s-1", np.full((args.steps, 11), args.velocity))


def turning(file, args):
    times = args.dt * np.arange(1, args.steps + 1)
    start(file, times, [0])
    share = (times - 0.5 * args.dt) / times[-1]  # of the run, in the middle of each step
    pressed = np.clip(np.interp(share, [0, 0.35, 0.4, 0.6, 0.65, 1], [1, 1, -0.1, -0.1, 1, 1]), -0.1, 1.0)
    put(file, "pressure", "Pa", args.pressure * pressed[:, None])
    for name, turned in (("velocity_jump", np.cos), ("velocity_jump_second", np.sin)):
        put(file, name, "m s-1", args.velocity * turned(2 * np.pi * share)[:, None])


def ramp(file, args):
    nodes = 8
    times = args.dt * np.arange(1, args.steps + 1)
    start(file, times, 100 + np.arange(nodes))
    end = times[-1]
    # P > 0 is compression; where P <= 0 the contact is open.
    shape = np.interp(times, [0, 0.2 * end, 0.4 * end, 0.5 * end, 0.6 * end, 0.8 * end, end], [0, 1, 1, -0.1, -0.1, 1, 1])
    put(file, "pressure", "Pa", np.outer(shape, np.linspace(2e9, 11.2e9, nodes)))
    put(file, "velocity_jump", "m s-1", np.outer(np.ones(args.steps), np.linspace(-args.velocity, args.velocity, nodes)))
    put(file, "initial_temperature", "K", np.linspace(300, 370, nodes))


def plates(file, args, nodes):
    """Two plates of 1 mm at each node, pressed together, and free but for the friction between them. Returns their jumps."""
    start(file, args.dt * np.arange(1, args.steps + 1), np.arange(nodes))
    put(file, "pressure", "Pa", np.full((args.steps, nodes), args.pressure))
    # The stresses on the far faces of the two masses: none, the plates are free but for the friction between them.
    put(file, "stress_soft", "Pa", np.zeros((args.steps, nodes)))
    put(file, "stress_hard", "Pa", np.zeros((args.steps, nodes)))
    put(file, "mass_soft", "kg m-2", np.full(nodes, MASS_OF_1_MM_ALUMINIUM))
    put(file, "mass_hard", "kg m-2", np.full(nodes, MASS_OF_1_MM_STEEL))
    return args.velocity * np.arange(1, nodes + 1) / nodes


def force_driven(file, args):
    # No /velocity_jump: each answer's new jump is the next step's.
    put(file, "initial_velocity_jump", "m s-1", plates(file, args, nodes=4))


def imposed(file, args):
    put(file, "velocity_jump", "m s-1", np.tile(plates(file, args, nodes=4), (args.steps, 1)))


def pressed(file, args):
    imposed(file, args)
    file["pressure"][args.steps // 2:] = 2 * args.pressure


def stepped(file, args):
    constant(file, args)
    file["velocity_jump"][args.steps // 3:2 * args.steps // 3] = 10 * args.velocity


def number(least, most, whole=False):
    """Returns the reader of a number of the command line between two bounds."""
    digits = "[0-9]{1,9}" if whole else r"[+-]?([0-9]{1,40}\.?[0-9]{0,40}|\.[0-9]{1,40})([eE][+-]?[0-9]{1,3})?"

    def read(text):
        value = float(text) if re.fullmatch(digits, text) else float("nan")
        if not least <= value <= most:
            raise argparse.ArgumentTypeError(f"expected a {'whole ' * whole}number from {least:g} to {most:g}, found {text[:60]!r}")
        return int(value) if whole else value
    return read


def main():
    kinds = {made.__name__: made for made in (constant, ramp, force_driven, imposed, pressed, stepped, rates, pressures, turning)}
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kind", choices=kinds)
    parser.add_argument("out", metavar="OUT.h5")
    parser.add_argument("--steps", type=number(1, 1e7, whole=True), default=1000)
    parser.add_argument("--dt", type=number(1e-15, 1.0), default=1e-9, help="length of a step, s (default 1e-9)")
    parser.add_argument("--velocity", type=number(-1e5, 1e5), default=100.0, help="velocity jump, m/s (default 100)")
    parser.add_argument("--pressure", type=number(-1e12, 1e12), default=11.2e9, help="Pa (default 11.2e9); ramp and pressures have their own")
    args = parser.parse_args()
    try:
        with h5py.File(args.out, "w") as file:
            kinds[args.kind](file, args)
    except OSError as fault:
        why = os.strerror(fault.errno) if fault.errno else fault
        parser.exit(1, f"make_history.py: {args.out} cannot be written: {why}; name a file where there is room and you may write\n")


if __name__ == "__main__":
    main()
