#!/usr/bin/python3
"""The velocity-driven model over pressure and velocity: where its layer sticks, slips and melts. Every pair of a constant
pressure and a constant velocity jump is a node, and all nodes are one session of a server inside this process.

    shearbus-study map SCENE.toml --out DIR [--pressure LOW HIGH] [--velocity LOW HIGH] [--times T ...]

DIR gets nodes.csv, a row per node and time of observation, and map.json, which has axes, lines, scene and versions.
What the lines mean and how to draw them: client/study/map/README.md."""
import argparse
import contextlib
import datetime
import fcntl
import json
import math
import os
import pathlib
import re
import shlex
import socket
import subprocess
import sys
import warnings
from typing import NamedTuple

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[3]
sys.path[:0] = [str(ROOT / "client/report"), str(ROOT / "client/python")]
import output  # noqa: E402
import shearbus  # noqa: E402
from terminal import Parser, complain, end_by_signals, positive_number, printable, read_text, read_toml, whole_number  # noqa: E402

PROGRAM = "shearbus-study"
MOST_STEPS = 1e9
WHOLE = 1e-6  # a time of observation may differ by this share from a whole number of steps
# Smallest share of the imposed slip that the layer must carry for the velocity-driven model to be valid. A server marks a step
# in which the layer carries less as outside the domain of validity.
DOMAIN_SHARE = 0.9
HEAD = ("time_s,pressure_pa,velocity_jump_m_per_s,shear_stress_pa,friction_coefficient,slip_carried_m,slip_share,interface_temperature_k,"
        "regime,melting_time_s")
NODES = ("a table of nodes of shearbus-study map", lambda head: head.startswith(b"time_s,pressure_pa,"))
SUMMARY = ("a summary (JSON) of shearbus", lambda head: head.startswith(b"{") and (b'"provenance"' in head or b'"producer"' in head))


class Observation(NamedTuple):
    """The nodes at a time; arrays (pressures, velocities)."""

    time: float  # s
    stress: np.ndarray  # Pa
    slip: np.ndarray  # m, of each node since the start, the integral of its sliding velocity
    share: np.ndarray  # of the imposed slip V t that the layer has carried plastically; the rest is elastic, h s / G0
    temperature: np.ndarray  # K
    regime: np.ndarray


def log_spaced(low, high, count):
    """Returns `count` values from `low` to `high`; neighbouring values have the same ratio."""
    return [low, *(low * (high / low) ** (i / (count - 1)) for i in range(1, count - 1)), high]


def without_hydro(path):
    """Returns the scene without the tables that shearbus-hydro alone reads; its lines keep their numbers."""
    text = read_text(path)
    tables = read_toml(text)
    if "hydro" not in tables:
        return path
    del tables["hydro"]
    lines, cut = [], False
    for line in text.split("\n"):
        if header := re.match(r"\s*\[\[?\s*([A-Za-z_]+)[^=]*\]\s*(#.*)?$", line):
            cut = header[1] == "hydro"
        lines.append("" if cut else line)
    kept = "\n".join(lines)
    with contextlib.suppress(ValueError):
        if read_toml(kept) == tables:
            return kept
    return tables  # a table of hydro that is written otherwise


def open_session(scene, nodes, programs):
    """Opens a session in this process. Raises shearbus.Error unless its layer carries the imposed jump."""
    os.environ.setdefault("SHEARBUS_LIBRARY", str(programs.parent / "lib"))
    for name in {*os.environ} & {"SHEARBUS_ENDPOINT", "SHEARBUS_SCENE", "SHEARBUS_SECRET_KEY_FILE", "SHEARBUS_RECORD"}:
        del os.environ[name]  # the command line decides
    try:
        scene = without_hydro(scene)
    except (OSError, ValueError) as fault:
        raise ValueError(f"{scene}: {getattr(fault, 'strerror', None) or fault}") from None
    session = shearbus.open(scene, np.arange(nodes), name=PROGRAM)
    # A layer whose slip is imposed takes no shear rate.
    if session.strategy != "velocity_driven" or "soft_shear_rate" in session.optional_columns:
        raise shearbus.ContentError(shearbus.Code.INVALID_SCENE, 'a map needs strategy = "velocity_driven" with drive = "layer_shear": it compares the '
                                    "slip that the layer carries with the slip that is imposed on it", field="strategy")
    return session


def sweep(session, pressures, velocities, times, dt):
    """Steps all nodes up to the last of the times. Returns (observations, times of melting); NaN: the node did not melt."""
    pressure, velocity = (axis.ravel() for axis in np.meshgrid(pressures, velocities, indexing="ij"))
    slip, melted = np.zeros(pressure.size), np.full(pressure.size, np.nan)
    observations, step = [], 0
    for time in times:
        while step < round(time / dt):
            now = (step + 1) * dt
            answer = session.step(dt, time=now, step=step, jump=velocity, pressure=pressure)
            slip += answer.slip * dt
            melted[np.isnan(melted) & (answer.regime == shearbus.Regime.MELTING)] = now
            step += 1
        columns = answer.stress, slip.copy(), slip / (velocity * time), answer.temperature, answer.regime
        observations.append(Observation(time, *(values.reshape(len(pressures), -1) for values in columns)))
    return observations, melted.reshape(len(pressures), -1)


def velocity_of_share(velocities, shares, share):
    """Returns for each pressure the velocity jump above which the layer carries more than `share` of the imposed slip; None
    outside of the map. For DOMAIN_SHARE this is the lowest velocity at which the model is valid; for 0 it is the velocity below
    which the layer sticks although slip is imposed.

    The share is 1 - V_y / V, with the imposed velocity V and the part V_y = h s / (G0 t) that the layer carries elastically.
    V_y changes little between neighbouring nodes of the map, so V_y is interpolated instead of the share."""
    line = []
    for row in shares.tolist():
        at = next((v for v, carried in enumerate(row) if carried > share), 0)
        if at == 0:
            line.append(None)
            continue
        before, carried = row[at - 1:at + 1]
        if before > 0.0:
            part = math.log((1.0 - before) / (1.0 - share)) / math.log((1.0 - before) / (1.0 - carried)) if carried < 1.0 else 0.0
            line.append(velocities[at - 1] * (velocities[at] / velocities[at - 1]) ** part)
        else:
            line.append(velocities[at] * (1.0 - carried) / (1.0 - share))
    return line


def velocity_of_melting(velocities, melting_times, time):
    """Returns for each pressure the lowest velocity jump that has melted the interface by the time; None outside of the map.

    The velocity is interpolated between the node that has melted and the slower one before it, with the melting time as a
    power of the velocity. If the slower node never melts, the exponent is that between this node and the faster one."""
    line = []
    for row in melting_times.tolist():
        at = next((v for v, melted in enumerate(row) if melted <= time), 0)
        if at == 0:
            line.append(None)
            continue
        before, melted = row[at - 1:at + 1]
        faster = row[at + 1] if at + 1 < len(row) else melted
        # Logarithm of the ratio of melting times of two neighbouring nodes.
        decay = math.log(before / melted) if before > melted else math.log(melted / faster)
        part = min(1.0, math.log(time / melted) / decay) if decay > 0.0 else 0.0
        line.append(velocities[at] * (velocities[at - 1] / velocities[at]) ** part)
    return line


def lines_of(seen, velocities, melting_times):
    return {"sticking_below_m_per_s": velocity_of_share(velocities, seen.share, 0.0),
            "domain_limit_m_per_s": velocity_of_share(velocities, seen.share, DOMAIN_SHARE),
            "melting_above_m_per_s": velocity_of_melting(velocities, melting_times, seen.time)}


def nodes_csv(pressures, velocities, observations, melting_times):
    def cell(value):
        return "" if value != value else repr(value).removesuffix(".0")

    rows = [HEAD]
    for seen in observations:
        for p, v in np.ndindex(melting_times.shape):
            values = (seen.time, pressures[p], velocities[v], seen.stress[p, v], seen.stress[p, v] / pressures[p], seen.slip[p, v],
                      seen.share[p, v], seen.temperature[p, v], seen.regime[p, v], melting_times[p, v])
            rows.append(",".join(cell(float(value)) for value in values))
    return "\n".join(rows) + "\n"


def provenance(options, scene_name):
    version = json.loads(subprocess.run([options.bin / PROGRAM, "--version", "--json"], capture_output=True, text=True, check=True).stdout)
    return {"program": PROGRAM, "version": version["version"], "commit": version["commit"], "scene": scene_name,
            "date": datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ"), "machine": socket.gethostname(),
            "command": shlex.join([PROGRAM, "map", *options.words])}


def write(directory, files):
    """Writes files, each of a kind and a text. One run at a time writes to a directory (proto/files/whole_file.hpp)."""
    lock = directory / ".lock"
    with open(os.open(lock, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW, 0o666), "rb") as held:
        try:
            fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise output.Refused(f"{directory}: another run writes here. Wait for it, or give each run a directory of its own.") from None
        try:
            for name, (kind, text) in files.items():
                output.write(directory / name, kind, text.encode())
        finally:
            lock.unlink()


def summary(pressures, velocities, dt, lines):
    def ends(line):
        return " ".join("       -" if value is None else f"{value:8.3g}" for value in (line[0], line[-1]))

    rows = [f"{len(pressures)} pressures x {len(velocities)} velocities, dt {dt:g} s",
            f"velocity (m/s) at {1e-9 * pressures[0]:g} and {1e-9 * pressures[-1]:g} GPa: sticking below, {100.0 * DOMAIN_SHARE:.0f} % of the slip carried, "
            "melting above"]
    return "\n".join(rows + [f"  {time:>8.3g} s  " + "  ".join(map(ends, of.values())) for time, of in lines.items()])


def fault_of(options):
    """Returns what is wrong with the ranges or the times of observation, or None."""
    for low, high in (options.pressure, options.velocity):
        if not low < high:
            return "--pressure and --velocity want the lower value first"
    before = 0.0
    for time in options.times:
        steps = time / options.dt
        if not time > before:
            return f"--times must increase, found {time:g} after {before:g} s"
        if not steps <= MOST_STEPS:
            return f"--times: {time:g} s is {steps:g} steps of {options.dt:g} s, expected at most {MOST_STEPS:g}"
        if abs(steps - round(steps)) > WHOLE * steps or steps < 0.5:
            return f"--times: {time:g} s is not a whole number of steps of {options.dt:g} s"
        before = time
    return None


def count(text):
    if not 2 <= whole_number(text) <= 1000:
        raise argparse.ArgumentTypeError(f"expected 2 to 1000, found {text}")
    return int(text)


def command_line():
    parser = Parser(prog=f"{PROGRAM} map", description=__doc__)
    parser.add_argument("scene", type=pathlib.Path, help="velocity-driven scene: materials and layer")
    parser.add_argument("--out", type=pathlib.Path, required=True, metavar="DIR", help="directory for nodes.csv and map.json")
    parser.add_argument("--pressure", type=positive_number, nargs=2, metavar=("LOW", "HIGH"), default=[1e9, 100e9], help="lowest and highest pressure, in Pa (1e9 100e9)")
    parser.add_argument("--velocity", type=positive_number, nargs=2, metavar=("LOW", "HIGH"), default=[1.0, 1000.0],
                        help="lowest and highest velocity jump, in m/s (1 1000)")
    parser.add_argument("--pressures", type=count, default=33, help="how many, at equal ratios (33)")
    parser.add_argument("--velocities", type=count, default=49, help="how many, at equal ratios (49)")
    parser.add_argument("--times", type=positive_number, nargs="+", default=[0.1e-6, 0.3e-6, 1e-6, 3e-6], help="observation times, in s, increasing (1e-7 3e-7 1e-6 3e-6)")
    parser.add_argument("--dt", type=positive_number, default=1e-9, help="step, in s (1e-9)")
    parser.add_argument("--bin", type=pathlib.Path, default=ROOT / "build/bin", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if fault := fault_of(options):
        parser.error(fault)
    options.words = sys.argv[3 if sys.argv[1] == "--bin" else 1:]  # as the user gave them
    return options


def run(options):
    pressures, velocities = log_spaced(*options.pressure, options.pressures), log_spaced(*options.velocity, options.velocities)
    with open_session(options.scene, options.pressures * options.velocities, options.bin) as session:
        output.prepare(options.out, {"nodes.csv": NODES, "map.json": SUMMARY})
        for note in session.warnings:
            if note.startswith("note: "):  # others have been shown
                complain(PROGRAM, note)
        observations, melting_times = sweep(session, pressures, velocities, options.times, options.dt)
    lines = {seen.time: lines_of(seen, velocities, melting_times) for seen in observations}
    made = provenance(options, session.name)
    described = {"producer": f"{PROGRAM} {made['version']}", "server_version": session.welcome.server_version, "scene_name": session.name,
                 "effective_scene": session.scene, "dt_s": options.dt, "domain_share": DOMAIN_SHARE, "pressure_pa": pressures,
                 "velocity_jump_m_per_s": velocities, "provenance": made, "observations": [{"time_s": time, **of} for time, of in lines.items()]}
    write(options.out, {"nodes.csv": (NODES, nodes_csv(pressures, velocities, observations, melting_times)),
                        "map.json": (SUMMARY, json.dumps(described, indent=1, ensure_ascii=False) + "\n")})
    print(summary(pressures, velocities, options.dt, lines))
    print(f"{printable(options.out)}: nodes.csv, map.json")


def main():
    end_by_signals()
    options = command_line()
    warnings.showwarning = lambda message, *_: complain(PROGRAM, f"warning: {message}")
    try:
        run(options)
    except (shearbus.Error, OSError, ValueError) as fault:
        complain(PROGRAM, fault)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
