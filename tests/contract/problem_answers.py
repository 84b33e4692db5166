#!/usr/bin/python3
"""The answers of the friction problems of client/examples/problems, from the formulas of its README.md.

problem_answers.py DIR [--write]      compares DIR/*.csv with the formulas, or writes them
problem_answers.py DIR --self-test    does so with tables that have one wrong value"""
import pathlib
import shutil
import sys
import tempfile
import tomllib

import numpy

DIGITS = ".9g"
FRONT = 4.5e-9  # s
TIMES = {  # s, of the rows of each table; none is nearer than FRONT to a jump of its velocities
    "constant_friction": numpy.arange(10, 101, 10) * 1e-9,
    "softening_friction": 4e-9 * numpy.arange(1, 11) ** 2,
    "finite_plate": numpy.arange(50, 1001, 50) * 1e-9,
    "stick_slip_brake": numpy.arange(45, 1850, 50) * 1e-9,
    "flash_to_melting": numpy.arange(50, 1001, 50) * 1e-9,
    "opening_and_closing": numpy.arange(10, 301, 20) * 1e-9,
    "turned_line": numpy.arange(10, 101, 10) * 1e-9,
}


class Pair:
    """Impedances, and the sum of the effusivities, of the two bodies of a problem."""

    def __init__(self, problem):
        soft, hard = problem["soft"], problem["hard"]
        self.soft, self.hard = (numpy.sqrt(body["density_kg_per_m3"] * body["shear_modulus_pa"]) for body in (soft, hard))
        self.both = 1 / (1 / self.soft + 1 / self.hard)  # Pa s/m
        self.effusivity = sum(body["conductivity_w_per_m_k"] / numpy.sqrt(body["diffusivity_m2_per_s"]) for body in (soft, hard))
        thickness = soft.get("thickness_m")
        self.round_trip = 2 * thickness * numpy.sqrt(soft["density_kg_per_m3"] / soft["shear_modulus_pa"]) if thickness else numpy.inf
        self.jump, self.start = problem["start"]["velocity_jump_m_per_s"], problem["start"]["temperature_k"]

    def heated(self, times, changes):
        """Returns T0 under a flux that changes by `changes`, [(time, W/m2)]."""
        rise = sum(change * numpy.sqrt(numpy.maximum(times - since, 0)) for since, change in changes)
        return self.start + 2 / (self.effusivity * numpy.sqrt(numpy.pi)) * rise


def braked(problem, times):
    """Constant friction: stress, velocities of both bodies and T0. The state changes at pressures and at returns of the wave."""
    pair, law = Pair(problem), problem["friction"]
    begins, pressures = problem["pressure"]["time_s"], problem["pressure"]["pressure_pa"]
    ends = [n * pair.round_trip for n in range(1, 1000) if n * pair.round_trip < times[-1]]
    # The pressure's changes come back with each return of the wave.
    edges = sorted({*begins, *ends, *(b + e for b in begins for e in ends if b + e < times[-1])})
    assert min(abs(time - edge) for time in times for edge in edges) > FRONT
    states = []  # (from, stress, wave that reaches the interface)

    def at(time):
        return next(state for state in reversed(states) if state[0] <= time)

    for edge in edges:
        inside = edge + 1e-15  # past the edge, whatever the rounding of the sums
        wave = pair.soft * pair.jump
        if inside > pair.round_trip:
            _, s, before = at(inside - pair.round_trip)
            wave = before - 2 * s
        limit = law["coefficient"] * max(0.0, next(p for t, p in zip(reversed(begins), reversed(pressures)) if t <= inside))
        states.append((edge, float(numpy.clip(wave * pair.both / pair.soft, -limit, limit)), wave))
    stress, wave = (numpy.array([at(time)[i] for time in times]) for i in (1, 2))
    flux = [abs(s) * abs((w - s) / pair.soft - s / pair.hard) for _, s, w in states]
    changes = zip((state[0] for state in states), numpy.diff([0.0, *flux]))
    return stress, (wave - stress) / pair.soft, stress / pair.hard, pair.heated(times, changes)


def softening(problem, times, steps=2000):
    """Friction s(T0): T0(t) = T_start + 1/(E sqrt(pi)) integral of s [V] / sqrt(t - x), in steps of equal sqrt(t); q is linear in each."""
    coarse, fine = (volterra(problem, times, n) for n in (steps // 2, steps))
    temperature = fine + (fine - coarse) / 3  # of second order
    pair = Pair(problem)
    stress = numpy.array([softened(problem, t) for t in temperature])
    return stress, pair.jump - stress / pair.soft, stress / pair.hard, temperature


def softened(problem, temperature):
    law, pressure = problem["friction"], problem["pressure"]["pressure_pa"][0]
    melting = law["melting_temperature_k"]
    if temperature >= melting:
        return 0.0
    return (law["yield_strength_pa"] / numpy.sqrt(3) * (1 + law["a_per_pa"] * pressure - law["b_per_k"] * (temperature - 300))
            * numpy.exp(-0.001 * temperature / (melting - temperature)))


def volterra(problem, times, steps):
    pair = Pair(problem)
    nodes = times[-1] * (numpy.arange(steps + 1) / steps) ** 2
    scale = 1 / (pair.effusivity * numpy.sqrt(numpy.pi))
    work = lambda t: (lambda s: s * (pair.jump - s / pair.both))(softened(problem, t))
    flux, temperature = [work(pair.start)], [pair.start]
    for n in range(1, steps + 1):
        u = numpy.sqrt(numpy.maximum(nodes[n] - nodes[:n + 1], 0))  # integrals over a step, in u = sqrt(t - x)
        whole, first = 2 * (u[:-1] - u[1:]), 2 / 3 * (u[:-1] ** 3 - u[1:] ** 3)
        right = (u[:-1] ** 2 * whole - first) / (u[:-1] ** 2 - u[1:] ** 2)  # weight of the later end
        left = whole - right
        known = pair.start + scale * (left @ flux + right[:-1] @ flux[1:])
        low, high = known, known + scale * right[-1] * flux[0] * 2
        for _ in range(60):
            middle = (low + high) / 2
            low, high = (middle, high) if known + scale * right[-1] * work(middle) > middle else (low, middle)
        temperature.append(low)
        flux.append(work(low))
    found = [int(numpy.argmin(abs(nodes - time))) for time in times]
    assert abs(nodes[found] - times).max() < 1e-18, "a time between two steps"
    return numpy.array(temperature)[found]


def flash(problem, times):
    """Constant friction until T0 = T_melt at t_m, then the flux q0 (2/pi) asin(sqrt(t_m/t)) that keeps it there."""
    pair, law = Pair(problem), problem["friction"]
    friction = law["coefficient"] * problem["pressure"]["pressure_pa"][0]
    rise = law["melting_temperature_k"] - pair.start
    start_flux = friction * (pair.jump - friction / pair.both)
    melts = numpy.pi * (pair.effusivity * rise / (2 * start_flux)) ** 2
    flux = start_flux * 2 / numpy.pi * numpy.arcsin(numpy.sqrt(melts / numpy.maximum(times, melts)))
    stress = pair.both / 2 * (pair.jump - numpy.sqrt(pair.jump**2 - 4 * flux / pair.both))
    return stress, pair.jump - stress / pair.soft, stress / pair.hard, pair.start + rise * numpy.minimum(1, numpy.sqrt(times / melts))


SOLVERS = {"constant": braked, "softening": softening, "constant_to_melting": flash}


def answer(problem):
    """Returns the columns of the table of a problem, {name: array}."""
    times = TIMES[problem["name"]]
    stress, soft, hard, temperature = SOLVERS[problem["friction"]["law"]](problem, times)
    columns = {"time_s": times, "jump_m_per_s": numpy.round(soft - hard, 12), "shear_stress_pa": stress, "temperature_k": temperature,
               "velocity_soft_m_per_s": soft, "velocity_hard_m_per_s": hard}
    if "line" in problem:
        angle = numpy.radians(problem["line"]["angle_degrees"])
        for body, velocity, force in (("soft", soft, -stress), ("hard", hard, stress)):
            for axis, part in (("x", numpy.cos(angle)), ("y", numpy.sin(angle))):
                columns[f"velocity_{body}_{axis}_m_per_s"] = velocity * part
                columns[f"friction_on_{body}_{axis}_pa"] = force * part
    return columns


def text(columns):
    rows = zip(*columns.values())
    return "\n".join([",".join(columns), *(",".join(format(value + 0.0, DIGITS) for value in row) for row in rows)]) + "\n"


def problems(directory):
    """Yields each problem of a directory and the path of its table."""
    for path in sorted(directory.glob("*.toml")):
        problem = tomllib.loads(path.read_text())
        assert problem["name"] == path.stem, path
        yield problem, path.with_suffix(".csv")


def faults_of(directory):
    """Returns what the tables of a directory have that is not of the formulas."""
    faults = []
    for problem, table in problems(directory):
        columns = answer(problem)
        lines = table.read_text().splitlines()
        if lines[0] != ",".join(columns):
            faults.append(f"{table.name}: expected the columns {','.join(columns)}, found {lines[0]}")
            continue
        found = numpy.array([[float(word) for word in line.split(",")] for line in lines[1:]]).T
        for name, expected, values in zip(columns, columns.values(), found):
            scale = max(abs(expected).max(), 1e-300)
            if len(values) != len(expected) or abs(values - expected).max() > 1e-8 * scale:
                faults.append(f"{table.name}: the column {name} is not that of the formulas")
    return faults


def self_test(directory):
    """Returns the tables whose wrong value, a millionth too much in the last line, was not noticed."""
    with tempfile.TemporaryDirectory(prefix="shearbus-") as copy:
        copy = pathlib.Path(shutil.copytree(directory, copy, dirs_exist_ok=True))
        for _, table in problems(copy):
            *lines, last = table.read_text().splitlines()
            time, jump, stress, temperature, *rest = last.split(",")
            table.write_text("\n".join([*lines, ",".join([time, jump, stress, format(float(temperature) * (1 + 1e-6), DIGITS), *rest])]) + "\n")
        noticed = "\n".join(faults_of(copy))
        return [f"{table.name}: a wrong value was not noticed" for _, table in problems(copy) if table.name not in noticed]


def main(directory, mode=""):
    directory = pathlib.Path(directory)
    if mode == "--write":
        for problem, table in problems(directory):
            table.write_text(text(answer(problem)))
    faults = self_test(directory) if mode == "--self-test" else faults_of(directory)
    print("\n".join(faults) or ("wrong tables are noticed" if mode == "--self-test" else "the tables are those of the formulas"))
    return bool(faults)


if __name__ == "__main__":
    sys.exit(main(*sys.argv[1:]))
