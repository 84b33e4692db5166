#!/usr/bin/python3
"""Parameters of a scene from measured curves: least squares through runs of shearbus-hydro, or of shearbus-replay.

    shearbus-study fit SCENE.toml --curve MEASURED.csv --parameter KEY=LOW:HIGH [--parameter ...] --out DIR
    shearbus-study fit SCENE.toml --stress-strain MEASURED.csv --parameter soft.KEY=LOW:HIGH [...] --out DIR
    shearbus-study fit SCENE.toml --parameter KEY=LOW:HIGH [...] --out DIR          sensitivities alone

A parameter is a key of the scene with its table, for instance interface.friction_coefficient=0.1:0.6, and the range
in which it is sought. A curve is a CSV file in SI units with a header: time_s, a quantity of the run's history.h5
(free_surface_velocity, velocity_jump_new, interface_temperature, ...) or slip_distance, and, as far as there are,
sigma (the standard deviation of the measurement) and node_id.

Curves of stress against strain need no run: the scene's soft metal is strained at a constant rate by shearbus-study
curve. Their file has plastic_strain, stress_pa, rate_per_s, temperature_k (at the start) and taylor_quinney (the
fraction of the work that heats the metal; 0: isothermal), any number of curves one after another. Their residuals are
relative to the measured stress.

DIR gets fit.json, fitted.toml, the scene with the fitted values, and fit.png. The intervals hold 95 % of the
probability for a model that is linear over them and errors that are normal and independent; without a sigma their
size is taken from the residuals. Directions in the space of the parameters, each scaled to its range, tell which
combinations the curves determine. Without curves DIR gets sensitivities.h5: the derivatives of shear_stress,
sliding_velocity and interface_temperature of every row and node, and the differences between two step sizes."""
import argparse
import concurrent.futures
import csv
import datetime
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import tomllib

import h5py
import numpy as np
from scipy.optimize import least_squares
from scipy.stats import qmc, t as student

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "client/report"))
sys.path.insert(0, str(ROOT / "proto"))
import contract  # noqa: E402
import output  # noqa: E402
from runs import flat, meta_of, provenance_of  # noqa: E402
from scene_text import with_value  # noqa: E402
from terminal import Parser, complain, positive_count, read_text, read_toml, real_number  # noqa: E402

PROGRAM = "shearbus-study fit"
FILES = {"fit.json": ("a result of " + PROGRAM, lambda head: b'"sigma_known"' in head),
         "fitted.toml": ("a scene of " + PROGRAM, lambda head: head.startswith(f"# {PROGRAM}".encode())), "fit.png": output.PICTURE}
SENSITIVITIES = ("sensitivities of " + PROGRAM, lambda head: head.startswith(b"\x89HDF") and PROGRAM.encode() in head)
SCANNED = 4  # points for each search, which starts from the best of them
STEP = 2e-3  # of a derivative, as a part of the parameter's range
ANSWERS = ("shear_stress", "sliding_velocity", "interface_temperature")
INPUTS = [column.quantity for column in contract.columns(ROOT / "proto/wire/columns.inc") if column.macro in ("INPUT", "STICK")]
OF_NODES = {name + suffix for name in (*INPUTS, "initial_temperature", "initial_velocity_jump") for suffix in ("", "_second")}
UNDETERMINED = 0.5  # a standard deviation, as a part of the range, from which on the curves do not determine a direction


class Fault(Exception):
    """What is wrong with the input, in a sentence for the user."""


class Parameter:
    def __init__(self, text):
        found = re.fullmatch(r"([\w.]+)=([^:]+):([^:]+)", text)
        try:
            self.key, self.low, self.high = found[1], real_number(found[2]), real_number(found[3])
        except (TypeError, argparse.ArgumentTypeError):
            raise argparse.ArgumentTypeError(f"expected KEY=LOW:HIGH, for instance interface.friction_coefficient=0.1:0.6, found {text}") from None
        if not self.low < self.high:
            raise argparse.ArgumentTypeError(f"expected LOW below HIGH, found {text}")

    def value(self, x):
        return self.low + x * (self.high - self.low)


def rows_of(path):
    """Returns the cells of a CSV file without its comments."""
    try:
        return list(csv.reader(line for line in read_text(path).splitlines() if line.strip() and not line.startswith("#")))
    except (OSError, ValueError, csv.Error) as cause:
        raise Fault(f"{path}: expected a curve as a CSV file: {getattr(cause, 'strerror', None) or cause}") from None


def id_of(path, text):
    """Returns the id of a node as it stands: a float holds those up to 2^53 alone. Other programs write 7 as 7.0."""
    found = re.fullmatch(r"\s*([0-9]+)(?:\.0*)?\s*", text)
    if found is None or not int(found[1]) < 2**64:
        raise Fault(f"{path}: node {text[:60]!r} is no whole number from 0 to 2^64 - 1")
    return int(found[1])


class Curve:
    """A measured quantity of one or several nodes against time."""

    def __init__(self, path):
        rows = rows_of(path)
        header = [name.strip() for name in rows[0]] if rows else []
        quantities = [name for name in header if name not in ("time_s", "sigma", "node_id")]
        if "time_s" not in header or len(quantities) != 1:
            raise Fault(f"{path}: expected a header of time_s, one quantity, and perhaps sigma and node_id; found {', '.join(header) or 'nothing'}")
        try:
            numbers = np.array(rows[1:], float)
            columns = dict(zip(header, numbers.T, strict=True))
        except ValueError:
            raise Fault(f"{path}: expected {len(header)} numbers in every row") from None
        self.path, self.quantity = path, quantities[0]
        self.time, self.values = columns["time_s"], columns[self.quantity]
        self.sigma = columns.get("sigma")
        self.node_id = None
        if "node_id" in header:
            place = header.index("node_id")
            self.node_id = np.array([id_of(path, row[place]) for row in rows[1:]], np.uint64)
        if not np.isfinite(numbers).all() or len(numbers) == 0 or (self.sigma is not None and (self.sigma <= 0).any()):
            raise Fault(f"{path}: expected finite numbers, with sigma above 0")

    def of(self, run):
        """Returns the quantity of a run at the times of the measurement."""
        node_id = np.full(len(self.time), self._only(run)) if self.node_id is None else self.node_id
        result = np.empty(len(self.time))
        for node in np.unique(node_id):
            place = np.flatnonzero(run.node_id == node)
            if place.size == 0:
                raise Fault(f"{self.path}: the run has no node {node}")
            time, values = run.series(self.quantity, place[0], self.path)
            here = node_id == node
            if self.time[here].min() < time[0] or self.time[here].max() > time[-1]:
                raise Fault(f"{self.path}: times from {self.time[here].min():g} to {self.time[here].max():g} s; the run has {self.quantity} from "
                            f"{time[0]:g} to {time[-1]:g} s")
            result[here] = np.interp(self.time[here], time, values)
        return result

    def _only(self, run):
        if len(run.node_id) != 1:
            raise Fault(f"{self.path}: the run has {len(run.node_id)} nodes; expected a column node_id")
        return run.node_id[0]

    @property
    def weight(self):
        """Returns by what the residuals are divided."""
        return np.ones(len(self.time)) if self.sigma is None else self.sigma


class StressStrain:
    """Measured curves of stress against plastic strain; `node_id` numbers the curves."""

    HEADER = ["plastic_strain", "stress_pa", "rate_per_s", "temperature_k", "taylor_quinney"]
    quantity, sigma = "stress", None

    def __init__(self, path):
        rows = rows_of(path)
        if not rows or [name.strip() for name in rows[0]] != self.HEADER:
            raise Fault(f"{path}: expected the header {','.join(self.HEADER)}; found {','.join(rows[0]) if rows else 'nothing'}")
        try:
            numbers = np.array(rows[1:], float).reshape(-1, len(self.HEADER))
        except ValueError:
            raise Fault(f"{path}: expected {len(self.HEADER)} numbers in every row") from None
        self.path, self.time, self.values = path, numbers[:, 0], numbers[:, 1]
        self.conditions, self.node_id = np.unique(numbers[:, 2:], axis=0, return_inverse=True)
        if not np.isfinite(numbers).all() or len(numbers) == 0 or (self.values <= 0).any():
            raise Fault(f"{path}: expected finite numbers, with stresses above 0")

    def of(self, run):
        """Returns the stresses of a metal at the measured strains."""
        result = np.empty(len(self.time))
        for i, condition in enumerate(self.conditions):
            here = np.flatnonzero(self.node_id == i)
            here = here[np.argsort(self.time[here])]
            result[here] = run.stress(self.time[here], *condition)
        return result

    @property
    def weight(self):
        return self.values


class Metal:
    """The soft metal of a scene, as a run that StressStrain looks at."""

    units = {"stress": "Pa"}

    def __init__(self, program, scene):
        self.program, self.scene, self.done = program, scene, {}

    @property
    def provenance(self):
        made = json.loads(subprocess.run([self.program, "--version", "--json"], capture_output=True, text=True, check=True).stdout)
        return {**made, "scene": read_toml(self.scene).get("name", ""), "program": "shearbus-study curve", "date": str(datetime.date.today())}

    def stress(self, strain, rate, temperature, taylor_quinney):
        key = (strain.tobytes(), rate, temperature, taylor_quinney)
        if key not in self.done:
            with tempfile.NamedTemporaryFile("w", suffix=".toml") as scene:
                scene.write(self.scene)
                scene.flush()
                made = subprocess.run([self.program, "curve", scene.name, "--rate", repr(float(rate)), "--temperature", repr(float(temperature)), "--taylor-quinney",
                                       repr(float(taylor_quinney)), "--plastic-strain", ",".join(repr(float(x)) for x in strain)], capture_output=True, text=True, check=False)
                if made.returncode != 0:
                    raise Fault(made.stderr.strip().replace(scene.name, "the scene with these parameters"))
            self.done[key] = np.array([float(row.split(",")[1]) for row in made.stdout.splitlines()[1:]])
        return self.done[key]


class Run:
    """The history of a run; `nodes`, `node_id`: columns of the file and the ids of these nodes, where it holds several runs."""

    def __init__(self, path, nodes=slice(None), node_id=None):
        with h5py.File(path) as file:
            self.node_id, self.time = file["node_id"][:] if node_id is None else node_id, file["time"][:]
            self.step = file["dt"][:] if "dt" in file else np.diff(self.time, prepend=file["time"].attrs["t0"])
            self.of = {name: data[:, nodes] for name, data in file.items() if isinstance(data, h5py.Dataset) and data.ndim == 2 and data.dtype.kind == "f"}
            meta = file["meta"].attrs
            self.provenance = provenance_of(meta_of(file)[0], meta.get("scene_name", ""))
            self.units = {name: file[name].attrs["units"].decode() for name in self.of} | {"slip_distance": "m"}
            self.of_step = {name for name in self.of if re.search(r"\b(during|mean of|in) (the|this) step", str(file[name].attrs["long_name"]))}
        self.of["slip_distance"] = np.cumsum(np.abs(self.of["sliding_velocity"]) * self.step[:, None], axis=0)

    def series(self, quantity, place, path):
        """Returns times and values of a node: a mean of a step is the value at its middle."""
        if quantity not in self.of:
            raise Fault(f"{path}: the run has no {quantity}; it has {', '.join(sorted(self.of))}")
        return self.time - (0.5 * self.step if quantity in self.of_step else 0.0), self.of[quantity][:, place]


def write_ensemble(source, path, sets):
    """Writes a history in which every node of `source` comes once for each set {key: value} of parameters. Returns the nodes' ids in `source`."""
    with h5py.File(source) as file, h5py.File(path, "w") as made:
        node_id, count = file["node_id"][:], len(sets)
        for name in OF_NODES & set(file):
            data = file[name][:]
            made[name] = np.tile(data, (1, count) if data.ndim == 2 else count)
        for name in {"time", "dt"} & set(file):
            file.copy(name, made)
        made["node_id"] = np.arange(count * len(node_id))
        for key in sets[0]:
            made[f"parameter/{key}"] = np.repeat([float(values[key]) for values in sets], len(node_id))
    return node_id


class Model:
    """Runs of a scene with other values of its parameters; each set of values is run once. With a recorded history the sets are parameters of nodes of one
    replay, as far as the server has them per node; the answers have the bits of runs alone."""

    def __init__(self, options, parameters, work):
        self.parameters, self.work, self.history = parameters, work, options.history
        self.check, self.replays = options.bin / "shearbus-ctl", 0
        self.of_metal = bool(options.stress_strain)
        self.program = options.bin / ("shearbus-study" if self.of_metal else "shearbus-replay" if options.history else "shearbus-hydro")
        self.scene_path, self.done = options.scene, {}
        try:
            self.text = read_text(options.scene)
            read_toml(self.text)
        except (OSError, ValueError) as cause:
            raise Fault(f"{options.scene}: {cause}") from None
        if not self.program.exists():
            raise Fault(f"{self.program} is missing: build the programs, or name their directory with --bin")

    def scene(self, x):
        text = self.text
        for parameter, share in zip(self.parameters, x, strict=True):
            text = with_value(text, parameter.key, parameter.value(float(share)))
        return text

    def _run(self, x):
        if self.of_metal:
            self.replays += 1
            return Metal(self.program, self.scene(x))
        with tempfile.TemporaryDirectory(dir=self.work) as where:
            scene, out = pathlib.Path(where) / "scene.toml", pathlib.Path(where) / "out"
            scene.write_text(self.scene(x), encoding="utf-8")
            self.replays += 1
            words = ([self.history, "--scene", scene, "--out", out / "history.h5"] if self.history else [scene, "--out", out, "--no-plot"])
            out.mkdir()
            made = subprocess.run([self.program, *words, "--no-progress"], capture_output=True, text=True, check=False)
            if made.returncode != 0:
                values = ", ".join(f"{p.key} = {p.value(float(share)):.6g}" for p, share in zip(self.parameters, x))
                raise Fault(f"the run with {values} failed: {made.stderr.strip().replace(str(scene), str(self.scene_path))}")
            return Run(out / "history.h5")

    def _sets(self, points):
        """Returns for each point {key: value} of what its effective scene has in place of that of the first; None where that is more than numbers of
        tables which nodes can have of their own."""
        with h5py.File(self.history) as file:
            if {"pair", "parameter"} & set(file):
                return None  # its nodes differ already
        scenes = []
        for x in points:
            path = pathlib.Path(self.work) / "effective.toml"
            path.write_text(self.scene(x), encoding="utf-8")
            made = subprocess.run([self.check, "check", path], capture_output=True, text=True, check=False)
            if made.returncode != 0:
                return None
            scenes.append(flat(tomllib.loads(made.stdout)))
        first = scenes[0]
        keys = [key for key in first if any(scene.get(key) != first[key] for scene in scenes)]
        if any(set(scene) != set(first) for scene in scenes) or any(key.startswith("pair.") or not isinstance(first[key], (int, float)) for key in keys):
            return None
        return [{key: scene[key] for key in keys} for scene in scenes]

    def _together(self, points):
        """Returns the runs at several points by one replay, or None where the points have no ensemble, or a replay refuses it."""
        try:
            sets = self._sets(points) if self.history and len(points) > 1 else None
        except OSError:
            return None  # not HDF5: the replay says what is wrong
        if not sets or not sets[0] or "pair" in tomllib.loads(self.text):
            return None
        with tempfile.TemporaryDirectory(dir=self.work) as where:
            scene, history, out = (pathlib.Path(where) / name for name in ("scene.toml", "history.h5", "out.h5"))
            scene.write_text(self.scene(points[0]), encoding="utf-8")
            node_id = write_ensemble(self.history, history, sets)
            made = subprocess.run([self.program, history, "--scene", scene, "--out", out, "--no-progress"], capture_output=True, text=True, check=False)
            if made.returncode != 0:
                return None
            self.replays += 1
            return [Run(out, slice(i * len(node_id), (i + 1) * len(node_id)), node_id) for i in range(len(points))]

    def runs(self, points):
        """Returns the runs at several points: by one replay, else as many at once as there are cores."""
        new = {tuple(x): x for x in points if tuple(x) not in self.done}
        if together := self._together(list(new.values())):
            self.done.update(zip(new, together, strict=True))
            return [self.done[tuple(x)] for x in points]
        with concurrent.futures.ThreadPoolExecutor(os.cpu_count()) as pool:
            self.done.update(zip(new, pool.map(self._run, new.values()), strict=True))
        return [self.done[tuple(x)] for x in points]

    @staticmethod
    def ends(x, step=STEP):
        return [(np.clip(x - step * unit, 0.0, 1.0), np.clip(x + step * unit, 0.0, 1.0)) for unit in np.eye(len(x))]

    def derivatives(self, x, observe, step=STEP):
        """Returns the derivatives of observe(run) to the parameters, scaled to their ranges: central, and one-sided at the ends of a range."""
        ends = self.ends(x, step)
        runs = [observe(run) for run in self.runs([end for pair in ends for end in pair])]
        return np.array([(runs[2 * i + 1] - runs[2 * i]) / (ends[i][1][i] - ends[i][0][i]) for i in range(len(x))])


def fit(model, curves, starts):
    """Returns the best point, its derivatives in standard deviations, the residuals and their scale."""
    sigma = np.concatenate([curve.weight for curve in curves])
    measured = np.concatenate([curve.values for curve in curves])
    if len(measured) <= len(model.parameters):
        raise Fault(f"{len(measured)} measured values for {len(model.parameters)} parameters: expected more values than parameters")

    def observe(run):
        return np.concatenate([curve.of(run) for curve in curves]) / sigma

    def residuals(x):
        return observe(model.runs([x])[0]) - measured / sigma

    count = len(model.parameters)
    points = [np.full(count, 0.5), *qmc.LatinHypercube(count, seed=1).random(SCANNED * starts - 1)]
    model.runs(points)
    best = None
    for start in sorted(points, key=lambda x: np.sum(residuals(x)**2))[:starts]:
        found = least_squares(residuals, start, jac=lambda x: model.derivatives(x, observe).T, bounds=(0.0, 1.0), xtol=1e-6, ftol=1e-8, x_scale="jac")
        best = found if best is None or found.cost < best.cost else best
    known = all(curve.sigma is not None for curve in curves)
    freedom = len(measured) - count
    scale = 1.0 if known else np.sqrt(2.0 * best.cost / freedom)
    return best.x, model.derivatives(best.x, observe).T / scale, best.fun, {
        "values": len(measured), "freedom": freedom, "sigma_known": known, "chi_squared": 2.0 * best.cost if known else None,
        "sigma_of_residuals": None if known else float(scale)}


def judged(parameters, x, jacobian, freedom):
    """Returns intervals, correlations and directions: what the curves say about the parameters."""
    _, singular, directions = np.linalg.svd(jacobian, full_matrices=False)
    deviation = 1.0 / np.maximum(singular, 1e-12)
    covariance = (directions.T * deviation**2) @ directions
    spread = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(spread, spread)
    reach = student.ppf(0.975, freedom) * spread
    found = []
    for i, parameter in enumerate(parameters):
        others = [j for j in range(len(parameters)) if j != i]
        nearest = max(others, key=lambda j: abs(correlation[i, j]), default=None)
        width = parameter.high - parameter.low
        found.append({
            "key": parameter.key, "value": parameter.value(float(x[i])), "low": parameter.value(float(x[i])) - reach[i] * width,
            "high": parameter.value(float(x[i])) + reach[i] * width, "range": [parameter.low, parameter.high],
            "at_end_of_range": bool(x[i] < 1e-3 or x[i] > 1 - 1e-3), "determined": bool(spread[i] < UNDETERMINED),
            "most_correlated": None if nearest is None else parameters[nearest].key,
            "correlation": None if nearest is None else float(correlation[i, nearest])})
    return found, [{"standard_deviation": float(s), "determined": bool(s < UNDETERMINED),
                    "parts": {p.key: float(part) for p, part in zip(parameters, row)}} for s, row in zip(deviation, directions)]


def width_of(keys):
    return 2 + max(34, *map(len, keys))


def table(found, directions):
    wide = width_of(row["key"] for row in found)
    lines = [f"{'parameter':<{wide}}{'value':>13}{'95 % from':>13}{'to':>13}  correlation"]
    for row in found:
        remark = " at the end of its range" if row["at_end_of_range"] else "" if row["determined"] else " NOT DETERMINED"
        with_other = f"{row['correlation']:+.2f} with {row['most_correlated']}" if row["most_correlated"] else ""
        lines.append(f"{row['key']:<{wide}}{row['value']:>13.6g}{row['low']:>13.6g}{row['high']:>13.6g}  {with_other}{remark}")
    for direction in directions:
        if not direction["determined"]:
            parts = " ".join(f"{part:+.2f} {key}" for key, part in direction["parts"].items() if abs(part) > 0.1)
            lines.append(f"The curves do not tell values apart along {parts} (each scaled to its range), near those found; --starts N looks farther.")
    return "\n".join(lines)


def label_of(curve, node):
    if isinstance(curve, StressStrain):
        return "fitted, {:g} 1/s from {:g} K".format(*curve.conditions[node])
    return "fitted" if curve.node_id is None else f"fitted, node {node}"


def draw(path, curves, run):
    import style
    made, axes = style.figure(2, len(curves), (4.7 * len(curves) + 0.6, 5.0), squeeze=False, sharex="col", height_ratios=(3, 1))
    for (upper, lower), curve in zip(axes.T, curves):
        strained = isinstance(curve, StressStrain)
        lower.axhline(0.0, color=style.GRID)
        model, nodes = curve.of(run), np.zeros(len(curve.time)) if curve.node_id is None else curve.node_id
        for k, node in enumerate(np.unique(nodes)):
            here = np.flatnonzero(nodes == node)
            here = here[np.argsort(curve.time[here])]
            time, colour = curve.time[here] * (1.0 if strained else 1e6), f"C{k % 5}"
            upper.plot(time, curve.values[here], ".", ms=3, color=colour if strained else style.FAINT, label="measured" if k == 0 else None)
            upper.plot(time, model[here], lw=1.6, color=colour, label=label_of(curve, node))
            lower.plot(time, curve.values[here] - model[here], ".", ms=3, color=colour)
        upper.set_ylabel(f"{curve.quantity.replace('_', ' ')} ({run.units[curve.quantity]})")
        low, high = upper.get_ylim()
        upper.set_ylim(min(0.0, low), high + 0.05 * (high - min(0.0, low)))
        upper.legend()
        lower.set_ylabel(f"measured\n− fitted ({run.units[curve.quantity]})", fontsize=8)
        lower.set_xlabel("plastic strain" if strained else "time (µs)")
    style.save(made, path, [run.provenance])


def write_sensitivities(path, model):
    """Derivatives of every answer at the middle of the ranges, by central differences, and how far those of half the step are from them."""
    x = np.full(len(model.parameters), 0.5)
    wide = width_of(parameter.key for parameter in model.parameters)
    print(f"{'parameter':<{wide}}{'quantity':<24}{'largest derivative':>20}{'of its range':>16}{'two steps differ by':>22}")
    with h5py.File(path, "w") as file:
        file.attrs["producer"] = PROGRAM
        base = model.runs([x, *(end for step in (2 * STEP, STEP) for pair in model.ends(x, step) for end in pair)])[0]
        file["time"], file["node_id"] = base.time, base.node_id
        for quantity in ANSWERS:
            coarse, fine = (model.derivatives(x, lambda run: run.of[quantity], step) for step in (2 * STEP, STEP))
            for parameter, d, half in zip(model.parameters, coarse, fine):
                width, most = parameter.high - parameter.low, np.abs(half).max()
                data = file.create_dataset(f"{parameter.key}/{quantity}", data=half / width)
                data.attrs["long_name"] = f"derivative of {quantity} to {parameter.key} at {parameter.value(0.5):g}"
                file[f"{parameter.key}/{quantity}_difference"] = np.abs(half - d) / width
                print(f"{parameter.key:<{wide}}{quantity:<24}{most / width:>20.6g}{most:>16.6g}{np.median(np.abs(half - d)) / max(most, 1e-300):>21.1e}")


def main():
    parser = Parser(prog="shearbus-study fit", description=__doc__)
    parser.add_argument("scene", type=pathlib.Path)
    parser.add_argument("--curve", type=pathlib.Path, action="append", default=[], metavar="CSV", help="a measured curve; repeatable")
    parser.add_argument("--stress-strain", type=pathlib.Path, action="append", default=[], metavar="CSV", help="measured curves of stress against strain; repeatable")
    parser.add_argument("--parameter", type=Parameter, action="append", required=True, metavar="KEY=LOW:HIGH", help="a key of the scene and its range; repeatable")
    parser.add_argument("--history", type=pathlib.Path, help="a recorded history, which shearbus-replay sends; without one shearbus-hydro runs SCENE")
    parser.add_argument("--starts", type=positive_count, default=3, help="searches from so many points, of which the best counts (default 3)")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("out/fit"))
    parser.add_argument("--bin", type=pathlib.Path, default=ROOT / "build/bin", help="directory of the programs")
    options = parser.parse_args()
    if options.stress_strain and (options.curve or options.history):
        parser.error("--stress-strain goes without --curve and --history: it needs no run")
    try:
        parameters = options.parameter
        curves = [Curve(path) for path in options.curve] + [StressStrain(path) for path in options.stress_strain]
        output.prepare(options.out, FILES if curves else {"sensitivities.h5": SENSITIVITIES})
        with tempfile.TemporaryDirectory(prefix="shearbus-fit-") as work:
            model = Model(options, parameters, work)
            if not curves:
                made = pathlib.Path(work) / "sensitivities.h5"
                write_sensitivities(made, model)
                output.write(options.out / made.name, SENSITIVITIES, made.read_bytes())
                print(f"{len(model.done)} sets of parameters by {model.replays} run{'s' * (model.replays != 1)} of {model.program.name}")
                return
            x, jacobian, residuals, quality = fit(model, curves, options.starts)
            found, directions = judged(parameters, x, jacobian, quality["freedom"])
            fitted = f"# {PROGRAM} found the values of {', '.join(p.key for p in parameters)}\n{model.scene(x)}"
            report = {"scene": str(options.scene), "curves": [str(path) for path in options.curve + options.stress_strain], "runs": len(model.done), "replays": model.replays, **quality,
                      "parameters": found, "directions": directions}
            for name, text in (("fitted.toml", fitted), ("fit.json", json.dumps(report, indent=1) + "\n")):
                output.write(options.out / name, FILES[name], text.encode("utf-8"))
            draw(options.out / "fit.png", curves, model.runs([x])[0])
        print(table(found, directions))
        print(f"residuals: {np.sqrt(np.mean(residuals**2)):.3g} {'of the stress' if options.stress_strain else 'sigma' if quality['sigma_known'] else '(SI)'} rms of {quality['values']} values; "
              f"{len(model.done)} runs\nwritten: {options.out}/fit.json, fitted.toml, fit.png")
    except (Fault, OSError) as fault:
        complain("shearbus-study fit", fault)
        sys.exit(1)
    except KeyboardInterrupt:
        sys.exit("shearbus-study fit: interrupted")


if __name__ == "__main__":
    main()
