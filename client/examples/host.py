#!/usr/bin/python3
"""A host of shearbus in Python: two elastic half-spaces slide on each other at ten interface nodes, with another
pressure at each.

Behind each node a column of zones carries shear waves: velocities live at zone faces and at half steps, stresses in
zones and at full steps; dt is the time that a shear wave takes across a zone, for which this scheme is exact. So is the
answer: [V] = V0 - mu P (1/Z_soft + 1/Z_hard), 92.184 m/s at 500 MPa, from the first step on."""
import argparse
import pathlib
import sys

import numpy

try:
    import shearbus
except ImportError as fault:
    sys.exit(f"host.py: the Python client cannot be loaded: {fault}; install it, or name its directory in PYTHONPATH (client/python)")

NODES, STEPS, DT = 10, 100, 1e-9
INITIAL_JUMP, FRICTION = 100.0, 0.1  # m/s, the scene's friction coefficient
PRESSURE = 100e6 * numpy.arange(1, NODES + 1)  # Pa
SCENE = pathlib.Path(__file__).with_name("constant_friction.toml")


class Body:
    """A column of zones behind each node: zone 0 is at the interface, the far end is free. A shear wave crosses a zone
    in `dt`. With as many zones as steps no wave comes back. side: +1 for z > 0 (soft), -1 for z < 0 (hard)."""

    def __init__(self, density, shear_modulus, velocity, side, zones, dt):
        self.density, self.modulus, self.side = density, shear_modulus, side
        self.width = numpy.sqrt(shear_modulus / density) * dt  # m
        self.velocity = numpy.full((NODES, zones + 1), velocity)  # m/s, at the faces
        self.stress = numpy.zeros((NODES, zones))  # Pa, in the zones
        self.half_mass = density * self.width / 2  # kg/m2, moves with the interface

    def accelerate(self, dt, friction):
        self.velocity[:, 0] += self.side * dt / self.half_mass * (self.stress[:, 0] - friction)
        self.velocity[:, 1:-1] += self.side * dt / (self.density * self.width) * numpy.diff(self.stress)
        self.velocity[:, -1] -= self.side * dt / self.half_mass * self.stress[:, -1]

    def deform(self, dt):
        self.stress += self.side * dt * self.modulus / self.width * numpy.diff(self.velocity)


def run(endpoint=None):
    """Returns the jump of each node at the end, the exact one, and the largest difference between the host's jump and
    the server's, all in m/s."""
    soft, hard = Body(2703.0, 27.6e9, INITIAL_JUMP, +1, STEPS, DT), Body(7900.0, 77e9, 0.0, -1, STEPS, DT)
    closure = 0.0
    with shearbus.open(SCENE, nodes=range(NODES), endpoint=endpoint) as bus:
        for step in range(STEPS):
            dt = DT if step > 0 else DT / 2  # velocities live half a step before stresses
            answer = bus.step(dt, jump=soft.velocity[:, 0] - hard.velocity[:, 0], pressure=PRESSURE,
                              stress_soft=soft.stress[:, 0], stress_hard=hard.stress[:, 0],
                              mass_soft=soft.half_mass, mass_hard=hard.half_mass, step=step)
            for body in (soft, hard):
                body.accelerate(dt, answer.stress)
                body.deform(DT)
            jump = soft.velocity[:, 0] - hard.velocity[:, 0]
            closure = max(closure, abs(jump - answer.jump_new).max())
    exact = INITIAL_JUMP - FRICTION * PRESSURE * sum(1 / numpy.sqrt(b.density * b.modulus) for b in (soft, hard))
    return jump, exact, closure


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("endpoint", nargs="?", help="of a server; without one it starts a server of its own")
    try:
        jump, exact, closure = run(parser.parse_args().endpoint)
    except shearbus.Error as fault:
        sys.exit(f"host.py: {fault}")
    for node in range(NODES):
        print(f"node {node + 1:2}  P {PRESSURE[node] / 1e6:5.0f} MPa  [V] {jump[node]:.6f} m/s  "
              f"exact {exact[node]:.6f}")
    print(f"host and server differ by at most {closure:.1e} m/s")
    sys.exit(not (abs(jump - exact).max() < 1e-6 and closure < 1e-6))
