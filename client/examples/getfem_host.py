#!/usr/bin/python3
"""Two blocks slide on each other, on meshes that do not match: GetFEM assembles, this file integrates, shearbus answers the friction."""
import argparse
import pathlib
import getfem
import numpy as np
import shearbus
from scipy import sparse

PERIOD, DT = 120e-6, 1.2e-9  # m along the interface, where all repeats; s
SCENES = pathlib.Path(__file__).resolve().parent
X, Z = 0, 1  # along the interface and across it


class Block:
    """A block in plane strain; its row 0 of nodes is the interface. side: +1 for z > 0 (soft), -1 for z < 0 (hard)."""

    def __init__(self, side, columns, rows, depth, density, shear_modulus, pressure, velocity=0.0, poisson=0.33):
        mesh = getfem.Mesh("cartesian", np.linspace(0, PERIOD, columns + 1), np.sort(side * np.linspace(0, depth, rows + 1)))
        fem, numbers, quadrature = getfem.MeshFem(mesh, 2), getfem.MeshFem(mesh, 1), getfem.MeshIm(mesh, getfem.Integ("IM_GAUSS_PARALLELEPIPED(2, 2)"))
        fem.set_classical_fem(1), numbers.set_classical_fem(1)
        one = np.ones(numbers.nbdof())
        stiffness = getfem.asm_linear_elasticity(quadrature, fem, numbers, 2 * shear_modulus * poisson / (1 - 2 * poisson) * one, shear_modulus * one)
        mass = density * getfem.asm_mass_matrix(quadrature, fem).mult(np.ones(fem.nbdof()))  # lumped: sums of rows
        x, z = fem.basic_dof_nodes()
        place = np.rint(abs(z) / depth * rows) * columns + np.rint(x / PERIOD * columns) % columns  # ties x = PERIOD to x = 0
        tie = sparse.csr_matrix((np.ones(len(x)), (np.arange(len(x)), (2 * place + np.arange(len(x)) % 2).astype(int))))
        pointers, indices = stiffness.csc_ind()
        stiffness = (tie.T @ sparse.csc_matrix((stiffness.csc_val(), indices, pointers)) @ tie).tocsr()
        self.at_interface, self.behind = stiffness[:2 * columns], stiffness[2 * columns:]
        shape = rows + 1, columns, 2
        self.mass = (tie.T @ mass).reshape(shape)[..., X]
        self.x = np.arange(columns) * PERIOD / columns
        self.u, self.v = np.zeros(shape), np.zeros(shape)
        self.v[..., X] = velocity
        self.push = -side * pressure * PERIOD / columns  # of the initial stress on the interface nodes, in balance until friction acts

    def forces(self, rows):
        """Returns the forces of the nodes of one of the two parts."""
        return -(rows @ self.u.ravel()).reshape(-1, *self.u.shape[1:])


def weights(soft, hard):
    """Returns the weight of each hard node in each soft one, and the areas: integrals of products of shape functions, exact on each piece of overlap."""
    xs, xh = soft.x + soft.u[0, :, X], hard.x + hard.u[0, :, X]
    ends = np.sort(np.concatenate([xs, xh]) % PERIOD)
    half = np.diff(np.append(ends, ends[0] + PERIOD)) / 2
    points = np.concatenate([ends + half * (1 - 3**-0.5), ends + half * (1 + 3**-0.5)])
    shared = hats(xs, points).multiply(np.tile(half, 2)) @ hats(xh, points).T
    area, area_hard = np.asarray(shared.sum(1)).ravel(), np.asarray(shared.sum(0)).ravel()
    return sparse.diags(1 / area) @ shared, area, area_hard


def hats(x, points):
    """Returns the values of the shape functions of nodes at x in points, of which each lies between two nodes."""
    order = np.argsort(x % PERIOD)
    right = np.searchsorted(x[order] % PERIOD, points) % len(x)
    left, right = order[right - 1], order[right]
    share = (points - x[left]) % PERIOD / ((x[right] - x[left]) % PERIOD)
    columns = np.arange(len(points))
    return sparse.csr_matrix((np.append(1 - share, share), (np.append(left, right), np.append(columns, columns))), (len(x), len(points)))


def run(soft, hard, steps, form, scene, **opening):
    """Yields time, areas, jumps and answer of each step."""
    with shearbus.open(scene, range(soft.x.size), **{"check_closure": "error", **opening}) as bus:
        for step in range(steps):
            dt = DT if step else DT / 2  # velocities live half a step before displacements
            w, area, area_hard = weights(soft, hard)
            f_soft, f_hard = (block.forces(block.at_interface)[0] + [0, block.push] for block in (soft, hard))
            m_soft, m_hard = soft.mass[0], hard.mass[0]
            jump = soft.v[0] - w @ hard.v[0]
            a_soft, a_hard = f_soft / m_soft[:, None], w @ (f_hard / m_hard[:, None])
            free = jump + dt * (a_soft - a_hard)  # the jump after this step without contact
            mass_hard = 1 / (w @ (area_hard / m_hard))
            impedance = 1 / (dt * (area / m_soft + 1 / mass_hard))
            gap = soft.u[0, :, Z] - w @ hard.u[0, :, Z]
            pressure = np.maximum(0, -impedance * (free[:, Z] + gap / dt))  # what keeps the gap closed
            if form == "stick":
                inputs = {"impedance": impedance, "stick_stress": impedance * free[:, X]}
            else:
                inputs = {"stress_soft": f_soft[:, X] / area, "stress_hard": -mass_hard * a_hard[:, X], "mass_soft": m_soft / area, "mass_hard": mass_hard}
            bus.start(dt, time=(step + 0.5) * DT, jump=jump[:, X], pressure=pressure, **inputs)
            for block in (soft, hard):  # while the server steps the layers
                block.v[1:] += dt * block.forces(block.behind) / block.mass[1:, :, None]
            answer = bus.finish()
            traction = np.stack([-answer.stress, pressure], 1) * area[:, None]  # on the soft nodes
            f_soft += traction
            f_hard -= w.T @ traction
            for block, force in ((soft, f_soft), (hard, f_hard)):
                block.v[0] += dt * force / block.mass[0, :, None]
                block.u += DT * block.v
            yield (step + 0.5) * DT, area, (soft.v[0] - w @ hard.v[0])[:, X], answer


def problem(name, form):
    """Returns the blocks of a problem and its run."""
    pressure, velocity, depth, steps = 1e9, 100.0, 1e-3, 250
    scene, opening = SCENES / "constant_friction.toml", {"parameters": {"interface.friction_coefficient": 0.05}}
    if name == "hot_spot":
        pressure, scene = 11.2e9, SCENES / "softening_friction.toml"
        opening = {"initial_temperature": np.where(np.arange(12) == 6, 1000.0, 300.0), "check_closure": "off"}  # soft nodes share hard ones
    if name in ("finite_plate", "brake"):
        velocity, depth, steps = (100.0, 0.5e-3, 520) if name == "finite_plate" else (30.0, 0.5e-3, 850)
    soft = Block(+1, 12, round(depth / 10e-6), depth, 2703.0, 27.6e9, pressure, velocity)
    hard = Block(-1, 9, 170, 1.7e-3, 7900.0, 77e9, pressure)
    return soft, hard, run(soft, hard, steps, form, scene, **opening)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("name", help="two_half_spaces, finite_plate, brake or hot_spot; any other is the first")
    parser.add_argument("form", choices=("far_field", "stick"))
    for time, area, jump, answer in problem(**vars(parser.parse_args()))[2]:
        mean_jump, mean_stress = (values @ area / area.sum() for values in (jump, answer.stress))
    print(f"{time * 1e9:.1f} ns: [V] {mean_jump:.2f} m/s, s {mean_stress / 1e6:.2f} MPa, T0 up to {answer.temperature.max():.1f} K")
