#!/usr/bin/python3
"""Runs client/examples/getfem_host.py, the host of deploy/docs/pages/tutorials/getfem.md, in both request forms, and compares it with exact
answers and with what the page prints; then the conformity kit on it. Exit code 77 where GetFEM is not installed.

getfem_page.py --build BUILD [--self-test]      with hosts made wrong on purpose
getfem_page.py --build BUILD --measure COLUMNS ROWS      what a step of the host waits for the server, in both forms, with so many elements
                                                         along the interface and across the soft block (SHEARBUS_ENDPOINT: of which server)"""
import argparse
import importlib.util
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time

SOURCE = pathlib.Path(__file__).resolve().parents[2]
PAGE = SOURCE / "deploy/docs/pages/tutorials/getfem.md"
HOST = SOURCE / "client/examples/getfem_host.py"
sys.path[:0] = [str(SOURCE / "client/python"), str(SOURCE / "tests/contract")]
if importlib.util.find_spec("getfem") is None or importlib.util.find_spec("scipy") is None:
    print("skipped: expected the modules getfem and scipy, found none (packages python3-getfem++, python3-scipy)")
    sys.exit(77)

import numpy  # noqa: E402
import problem_answers  # noqa: E402
import shearbus  # noqa: E402
import tomllib  # noqa: E402
from shearbus._terminal import whole_number  # noqa: E402

FORMS = ("far_field", "stick")
WRONG = {  # mistake -> what the host has, and what the wrong host has instead
    "weights in the wrong order": ("sparse.diags(1 / area) @ shared,", "(sparse.diags(1 / area) @ shared)[:, ::-1],"),
    "mass of whole zones": ("1 / (w @ (area_hard / m_hard))", "2 / (w @ (area_hard / m_hard))"),
    "stick stress without forces": ('"stick_stress": impedance * free[:, X]', '"stick_stress": impedance * jump[:, X]'),
    "another density": ("depth, 2703.0", "depth, 2900.0"),
    "friction on one side": ("f_hard -= w.T @ traction", "f_hard[:, Z] -= (w.T @ traction)[:, Z]"),
}
PROBLEMS = {"two_half_spaces": "constant_friction", "finite_plate": "finite_plate", "brake": "stick_slip_brake", "hot_spot": "softening_friction"}


class Run:
    """What a run of the host has at the end of each step: means over the interface, and spreads over its nodes."""

    def __init__(self, host, name, form):
        soft, hard, steps = host.problem(name, form)
        blocks = soft, hard
        energy = sum((block.mass * (block.v**2).sum(2)).sum() / 2 for block in blocks)
        rows, self.heat = [], 0.0
        for time, area, jump, answer in steps:
            mean = lambda values: values @ area / area.sum()
            self.heat += answer.friction_heat @ area
            rows.append((time, mean(jump), mean(answer.stress), mean(answer.temperature), numpy.ptp(jump), numpy.argmax(answer.temperature),
                         answer.stress[6], answer.temperature.max()))
        self.time, self.jump, self.stress, self.temperature, self.spread, self.hottest, self.spot, self.highest = numpy.array(rows).T
        for block in blocks:  # kinetic, elastic, and that of the initial stress
            energy -= (block.mass * (block.v**2).sum(2)).sum() / 2
            force = numpy.concatenate([block.forces(part) for part in (block.at_interface, block.behind)])
            energy -= -((block.u - host.DT * block.v) * force).sum() / 2 + block.push * block.u[0, :, 1].sum()
        self.lost = energy
        # No uniform problem sees to which hard node a weight belongs: the weighted place of the hard nodes is that of the soft one.
        x = [block.x + block.u[0, :, 0] for block in blocks]
        apart = (x[1] - x[0][:, None] + host.PERIOD / 2) % host.PERIOD - host.PERIOD / 2
        self.misplaced = abs((host.weights(soft, hard)[0].toarray() * apart).sum(1)).max()
        self.end = f"{time * 1e9:.1f} ns: [V] {abs(self.jump[-1]):.2f} m/s, s {self.stress[-1] / 1e6:.2f} MPa, T0 up to {self.highest[-1]:.1f} K"

    def mean(self, values, start, end):
        return values[(self.time > start) & (self.time < end)].mean()


def faults_of(name, run):
    """Yields what a run has that is not exact to the accuracy of its mesh."""
    problem = tomllib.loads((SOURCE / f"client/examples/problems/{PROBLEMS[name]}.toml").read_text())
    pair = problem_answers.Pair(problem)

    def near(what, found, expected, most):
        if not abs(found - expected) <= most:
            yield f"{name}: expected {what} {expected:.9g} within {most:g}, found {found:.9g}"

    yield from near("the distance of soft nodes and weighted hard nodes (m)", run.misplaced, 0, 1e-8)
    if name == "hot_spot":
        half = run.time > run.time[-1] / 2
        yield from near("the mean jump (m/s)", run.jump[half].mean(), (pair.jump - run.stress / pair.both)[half].mean(), 0.05)
        soft, hard = (problem[side]["conductivity_w_per_m_k"] / problem[side]["diffusivity_m2_per_s"] ** 0.5 for side in ("soft", "hard"))
        yield from near("the heat of the soft side over the energy lost", run.heat / run.lost, soft / (soft + hard), 1e-3)
        if set(run.hottest) != {6} or not run.spot[0] < 0.8 * run.stress[0] or run.spread.max() < 1:
            yield f"{name}: the spot is not the hottest node and the one with the least friction"
        return
    yield from near("the spread of the jumps (m/s)", run.spread.max(), 0, 1e-8)
    edges = [n * pair.round_trip for n in range(4)] if pair.round_trip < 1 else [0, 4e-7]
    for start, end in zip(edges, edges[1:]):
        start, end = start + 0.5 * (end - start), end - 10e-9
        if run.time[-1] > end or name == "two_half_spaces":
            stress, soft, hard, temperature = problem_answers.braked(problem, numpy.array([(start + end) / 2, 2e-6]))
            yield from near(f"the mean jump (m/s) around {(start + end) / 2:g} s", run.mean(run.jump, start, end), soft[0] - hard[0], 0.05)
            yield from near(f"the mean stress (Pa) around {(start + end) / 2:g} s", run.mean(run.stress, start, end), stress[0], 0.5e6)
            yield from near(f"T0 (K) at {(start + end) / 2:g} s", numpy.interp((start + end) / 2, run.time, run.temperature), temperature[0], 0.5)
    if name == "brake":
        yield from near("the slip (m)", run.jump.sum() * (run.time[1] - run.time[0]), (22.1838804 + 10.6061766) * pair.round_trip, 5e-8)
        yield from near("the time of rest (s)", run.time[numpy.argmax(abs(run.jump) < 1e-6)], 2 * pair.round_trip, 30e-9)
        yield from near("the jump at the end (m/s)", run.jump[-1], 0, 1e-9)


def faults(host, path, build):
    page = PAGE.read_text()
    for name in PROBLEMS:
        runs = [Run(host, name, form) for form in FORMS]
        for run in runs:
            yield from faults_of(name, run)
        for what in ("jump", "stress", "temperature"):
            a, b = (getattr(run, what) for run in runs)
            if abs(a - b).max() > 1e-9 * abs(a).max():
                yield f"{name}: the two forms differ in {what} by {abs(a - b).max():g}"
        if runs[0].end not in page:
            yield f"{name}: the page does not print {runs[0].end!r}"
    for form in FORMS:
        command = [sys.executable, "-B", "-m", "shearbus.conformity", *(word for name in ("two_half_spaces", "finite_plate", "restart") for word in ("--scenario", name)),
                   "--", sys.executable, "-B", str(path), "@problem", form]
        kit = subprocess.run(command, env=environment(build), text=True, capture_output=True)
        if kit.returncode:
            yield f"the conformity kit, {form}: {kit.stdout[-2000:]}{kit.stderr[-1000:]}"


def loaded(path):
    spec = importlib.util.spec_from_file_location("getfem_host", path)
    host = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(host)
    return host


def faults_of_host(source, build):
    with tempfile.TemporaryDirectory(prefix="shearbus-") as directory:
        path = pathlib.Path(directory, "getfem_host.py")
        path.write_text(source)
        for scene in ("constant_friction.toml", "softening_friction.toml"):
            shutil.copy(HOST.with_name(scene), directory)
        yield from faults(loaded(path), path, build)


def measure(columns, rows, steps=60, first=10):
    """Prints how long a step of the host is, and how long it is in the calls: its processor time (medians), and time on the clock in the
    quickest quarter of the steps, which a busy machine disturbs least. The closure check is off, as it is by itself after 100 steps."""
    host, calls = loaded(HOST), []
    host.PERIOD = 10e-6 * columns

    def timed(call):
        def run(*arguments, **values):
            begun = time.perf_counter(), time.thread_time()
            answer = call(*arguments, **values)
            calls.append((time.perf_counter() - begun[0], time.thread_time() - begun[1]))
            return answer
        return run
    for name in ("start", "finish"):
        setattr(shearbus.Session, name, timed(getattr(shearbus.Session, name)))
    deep = 17 * rows // 10
    soft = host.Block(+1, columns, rows, rows * 10e-6, 2703.0, 27.6e9, 1e9, 100.0)
    hard = host.Block(-1, 3 * columns // 4, deep, deep * 10e-6, 7900.0, 77e9, 1e9)
    for form in FORMS:
        calls.clear()
        ends = []
        for _ in host.run(soft, hard, steps, form, HOST.with_name("constant_friction.toml"), check_closure="off",
                          parameters={"interface.friction_coefficient": 0.05}):
            ends.append((time.perf_counter(), time.thread_time()))
        inside = numpy.array(calls).reshape(steps, 2, 2).sum(1)[first:]
        whole = numpy.diff(ends, axis=0)[first - 1:]
        (wall, _), (waits, _) = (numpy.quantile(times, 0.25, axis=0) for times in (whole, inside))
        (_, own), (_, spent) = (numpy.median(times, axis=0) for times in (whole, inside))
        print(f"{columns} x {rows} and {3 * columns // 4} x {deep} elements, {form}: processor time of the host {own * 1e3:.1f} ms a step, in the "
              f"calls {spent * 1e3:.2f} ms ({spent / own:.1%}); a quarter of the steps takes at most {wall * 1e3:.1f} ms, is in the calls at most "
              f"{waits * 1e3:.2f} ms ({waits / wall:.1%})", flush=True)


def noticed(right, wrong, build):
    """Returns whether a host with one mistake has a fault, or is stopped by the closure check."""
    source = HOST.read_text()
    assert source.count(right) == 1, right
    try:
        fault = next(faults_of_host(source.replace(right, wrong), build), None)
    except shearbus.ClosureError as error:
        fault = str(error)
    print(f"{right} -> {wrong}: {fault}"[:300])
    return fault is not None


def environment(build):
    return {**os.environ, "PYTHONPATH": str(SOURCE / "client/python"), "SHEARBUS_LIBRARY": str(build / "lib")}


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--build", type=pathlib.Path, required=True)
    parser.add_argument("--self-test", action="store_true")
    parser.add_argument("--measure", type=whole_number, nargs=2, metavar=("COLUMNS", "ROWS"))
    options = parser.parse_args()
    os.environ.update(environment(options.build))
    os.chdir("/")  # the host finds its scenes from any directory
    if options.measure:
        measure(*options.measure)
        found = []
    elif options.self_test:
        found = [f"not noticed: {mistake}" for mistake, (right, wrong) in WRONG.items() if not noticed(right, wrong, options.build)]
        print("\n".join(found) or f"{len(WRONG)} wrong hosts are noticed")
    else:
        found = list(faults_of_host(HOST.read_text(), options.build))
        print("\n".join(found) or f"{len(PROBLEMS)} problems in both forms have their exact answers, and the kit passes")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
