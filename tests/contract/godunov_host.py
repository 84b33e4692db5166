#!/usr/bin/python3
"""A host whose velocities live in cells and at whole steps: Godunov's scheme for shear waves. The face of each body at the interface has
the velocity that the wave from its first cell and the answered stress give it, by the row of the table in client/README.md.

godunov_host.py ENDPOINT PROBLEM [far_field | stick] [CFL]

CFL: the step over the time that a wave takes across a cell; 1 is exact. Ends with the jumps of the faces, in m/s."""
import pathlib
import sys

SOURCE = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(SOURCE / "client/python"))
import numpy  # noqa: E402
import shearbus  # noqa: E402
from shearbus.conformity.problems import Problem  # noqa: E402

NODES, DT = 3, 1e-9
DEPTH, PLATE_CELLS = 0.5e-3, 100  # of the plate, m
STEPS = {"two_half_spaces": 100, "finite_plate": 350, "softening_friction": 100, "stick_slip_brake": 800, "flash_to_melting": 450,
         "opening_and_closing": 300}


class Body:
    """Cells behind each node, from the interface outward; `stress` is sigma_xz times side, which is +1 for z > 0."""

    def __init__(self, density, modulus, velocity, side, cells, width):
        self.density, self.modulus, self.side, self.width = density, modulus, side, width
        self.z = numpy.sqrt(density * modulus)  # impedance, Pa s/m
        self.velocity = numpy.full((NODES, cells), velocity)
        self.stress = numpy.zeros((NODES, cells))
        self.face = self.velocity[:, 0].copy()  # velocity at the interface in the last step

    def incoming(self):
        """Returns the invariant R of the wave that reaches the interface, sigma_xz + side * Z * v."""
        return self.side * (self.stress[:, 0] + self.z * self.velocity[:, 0])

    def advance(self, dt, friction):
        """Makes a step under the stress of the interface. The far end is free."""
        self.face = (self.side * self.incoming() - self.side * friction) / self.z
        v, s = self.velocity, self.stress
        inner_v = (v[:, :-1] + v[:, 1:]) / 2 + numpy.diff(s) / (2 * self.z)
        inner_s = (s[:, :-1] + s[:, 1:]) / 2 + self.z * numpy.diff(v) / 2
        far_v, far_s = v[:, -1:] - s[:, -1:] / self.z, numpy.zeros((NODES, 1))
        faces_v = numpy.hstack([self.face[:, None], inner_v, far_v])
        faces_s = numpy.hstack([self.side * friction[:, None], inner_s, far_s])
        self.velocity = v + dt / (self.density * self.width) * numpy.diff(faces_s)
        self.stress = s + dt * self.modulus / self.width * numpy.diff(faces_v)


def run(endpoint, problem, form="far_field", cfl=1.0):
    cells, steps, dt = STEPS[problem], STEPS[problem], DT
    of = Problem(problem)
    if of.finite:
        dt = cfl * DEPTH / PLATE_CELLS * numpy.sqrt(2703.0 / 27.6e9)
    width = lambda density, modulus: numpy.sqrt(modulus / density) * dt / cfl
    soft = Body(2703.0, 27.6e9, of.jump, 1, PLATE_CELLS if of.finite else cells, width(2703.0, 27.6e9))
    hard = Body(7900.0, 77e9, 0.0, -1, cells, width(7900.0, 77e9))
    with shearbus.open(SOURCE / "client/examples/constant_friction.toml", range(NODES), endpoint, connect_deadline=5.0, reply_deadline=2.0,
                       retry_after=0.1) as bus:
        for step in range(steps):
            inputs = {"stress_soft": soft.incoming() - soft.z * soft.face, "stress_hard": hard.incoming() + hard.z * hard.face,
                      "mass_soft": numpy.full(NODES, soft.z * dt), "mass_hard": numpy.full(NODES, hard.z * dt)}
            if form == "stick":
                impedance = 1 / (1 / soft.z + 1 / hard.z)
                inputs = {"impedance": numpy.full(NODES, impedance),
                          "stick_stress": impedance * (soft.incoming() / soft.z + hard.incoming() / hard.z)}
            pressure = numpy.full(NODES, of.pressure((step + 0.5) * dt))
            answer = bus.step(dt, jump=soft.face - hard.face, pressure=pressure, step=step, time=(step + 1) * dt, **inputs)
            for body in (soft, hard):
                body.advance(dt, answer.stress)
        jump = soft.face - hard.face
        assert abs(jump - answer.jump_new).max() < 1e-9, "the host does not close"
    print(*(f"{value:.9f}" for value in jump))


if __name__ == "__main__":
    run(*sys.argv[1:4], *map(float, sys.argv[4:]))
