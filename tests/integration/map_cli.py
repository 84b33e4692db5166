"""Tests of `shearbus-study map` and its pictures, run as a user does; the map is compared with closed formulas."""
import argparse
import csv
import json
import math
import pathlib
import subprocess
import sys
import tempfile
import tomllib

import numpy as np

THICKNESS_M, G0_KEY = 20e-6, "shear_modulus_pa"
STICK = 1  # shearbus.v1.Regime


def run(*command):
    return subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=200)


def check(condition, what):
    if not condition:
        raise AssertionError(what)


class Map:
    """A map of 4 pressures and 13 velocities at three times. Columns are arrays (times, pressures, velocities)."""

    def __init__(self, options, scene, out):
        done = run(options.study, "map", scene, "--out", out, "--pressures", 4, "--velocities", 13, "--times", 50e-9, 100e-9, 400e-9)
        check(done.returncode == 0, done.stderr)
        self.json = json.loads((out / "map.json").read_text())
        with open(out / "nodes.csv", newline="") as file:
            rows = list(csv.DictReader(file))
        number = lambda text: float(text) if text else math.nan
        self.of = {name: np.array([number(row[name]) for row in rows]).reshape(3, 4, 13) for name in rows[0]}
        self.times = [seen["time_s"] for seen in self.json["observations"]]
        self.shear_modulus = tomllib.loads(self.json["effective_scene"])["soft"][G0_KEY]

    def line(self, name):
        """Returns an array (times, pressures); NaN outside of the map."""
        return np.array([[math.nan if value is None else value for value in seen[name]] for seen in self.json["observations"]])


def check_axes(made):
    velocity = made.json["velocity_jump_m_per_s"]
    check((velocity[0], velocity[-1]) == (1.0, 1000.0), velocity)
    check(abs(velocity[4] / velocity[3] - 10**0.25) < 1e-12, "axes are at equal ratios")


def check_elastic_part(made):
    """The part of the imposed displacement V t that is not plastic slip is elastic: sqrt(3) integral(ep) = V t - h s / G0."""
    elastic = THICKNESS_M * made.of["shear_stress_pa"] / (made.shear_modulus * made.of["velocity_jump_m_per_s"] * made.of["time_s"])
    check(np.abs(made.of["slip_share"] - (1.0 - elastic)).max() < 1e-8, "what is not carried is elastic")
    check(((made.of["regime"] == STICK) == (made.of["slip_share"] == 0.0)).all(), "a layer that sticks carries no slip")


def check_sticking_line(made, source):
    """The layer yields when the elastic stress G0 V t / h reaches the flow stress at the pressure and 300 K, divided by
    sqrt(3). The tolerance is 15 % because that is of a layer that has not hardened: in the map it has hardened a little at the
    lowest velocity at which it flows."""
    sys.path.insert(0, str(source / "client/python"))
    import shearbus
    pressures = np.array(made.json["pressure_pa"])
    with shearbus.open(made.json["effective_scene"], [0]) as session:
        flow_stress = [np.nanmax(session.profiles([0], pressure=pressure).layer_flow_stress) for pressure in pressures]
    line, drawn = made.line("sticking_below_m_per_s"), 0
    for time, velocities in zip(made.times, line):
        for found, stress in zip(velocities, flow_stress):
            expected = THICKNESS_M * stress / math.sqrt(3.0) / (made.shear_modulus * time)
            check(math.isnan(found) == (expected <= 1.0), (time, found, expected))
            if not math.isnan(found):
                drawn += 1
                check(abs(found / expected - 1.0) < 0.15, (time, found, expected))
    check(drawn >= 8, drawn)


def check_domain(made):
    """The limiting velocity is proportional to s/t. It falls a little less than 1/t does, because s rises as the layer hardens."""
    line = made.line("domain_limit_m_per_s")
    check(np.isfinite(line[:-1]).all(), line)
    for k in range(1, len(line)):
        falls = line[k - 1] / line[k] / (made.times[k] / made.times[k - 1])
        falls = falls[np.isfinite(falls)]
        check(((falls > 0.5) & (falls < 1.05)).all(), falls)


def check_melting(made):
    """Faster melts earlier, and the line falls with time."""
    melting = made.of["melting_time_s"][-1]
    slower, faster = melting[:, :-1], melting[:, 1:]
    both = np.isfinite(slower)
    check(both.sum() > 4 and (faster[both] <= slower[both]).all(), melting)
    line = made.line("melting_above_m_per_s")
    check((line[2] < line[1]).all(), line)


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--study", required=True)
    parser.add_argument("--ctl", required=True)
    parser.add_argument("--source", type=pathlib.Path, required=True)
    options = parser.parse_args()
    scene = options.source / "client/examples/validity_map.toml"
    with tempfile.TemporaryDirectory() as scratch:
        out = pathlib.Path(scratch) / "map"
        small = ["--pressures", 4, "--velocities", 7, "--times", 2e-8, 1e-7, "--dt", 1e-9]
        done = run(options.study, "map", scene, "--out", out, *small)
        check(done.returncode == 0, done.stderr)
        check("sticking below" in done.stdout, done.stdout)
        described = json.loads((out / "map.json").read_text())
        check([seen["time_s"] for seen in described["observations"]] == [2e-8, 1e-7], described["observations"])
        check("[soft]" in described["effective_scene"], "map.json says what was run")
        with open(out / "nodes.csv", newline="") as file:
            rows = list(csv.DictReader(file))
        check(len(rows) == 2 * 4 * 7, len(rows))
        for row in rows:
            check(abs(float(row["friction_coefficient"]) * float(row["pressure_pa"]) - float(row["shear_stress_pa"])) < 1.0, row)
            check(0.0 <= float(row["slip_share"]) <= 1.0, row)

        drawn = run("/usr/bin/python3", options.source / "client/study/map/plot_map.py", out)
        check(drawn.returncode == 0, drawn.stderr)
        for picture in ("limits.png", "fields.png"):
            check((out / picture).read_bytes()[:4] == b"\x89PNG", picture)

        for bad, told in ((["--times", 3e-7, 1e-7], "must increase"), (["--dt", 3e-8], "whole number of steps"),
                          (["--pressure", 2e9, 1e9], "lower value first")):
            refused = run(options.study, "map", scene, "--out", out, *bad)
            check(refused.returncode == 2 and told in refused.stderr, refused.stderr)
        for other in ("force_driven.toml", "interface_slip.toml"):
            refused = run(options.study, "map", options.source / "client/examples" / other, "--out", out, *small)
            check(refused.returncode == 1 and "layer_shear" in refused.stderr, refused.stderr)

        with_hydro = pathlib.Path(scratch) / "hydro.toml"
        with_hydro.write_text(scene.read_text() + "\n[hydro]\nof_the_hydro_stub = 1\n")
        done = run(options.study, "map", with_hydro, "--out", pathlib.Path(scratch) / "hydro", *small)
        check(done.returncode == 0, done.stderr)
        check((pathlib.Path(scratch) / "hydro/nodes.csv").read_bytes() == (out / "nodes.csv").read_bytes(), "[hydro] is left out")

        # A fault is told with its file and, behind [hydro], with its line.
        bad = pathlib.Path(scratch) / "bad.toml"
        for text, told in ((b"a = [", "bad.toml: "), (b"\xff", "bad.toml: 'utf-8' codec"), (None, "bad.toml: No such file"),
                           (b"[hydro]\nx = [[1, 2],\n" + scene.read_bytes().replace(b"[soft]", b"[3, 4]]\n[soft]", 1), "bad.toml: "),
                           (b"\n[hydro.of]\nx = 1\n[layer]\nthicknes_m = 1e-5\n", ":5")):
            bad.unlink(missing_ok=True)
            if text is not None:
                bad.write_bytes(text)
            refused = run(options.study, "map", bad, "--out", out, *small)
            check(refused.returncode == 1 and told in refused.stderr and "Traceback" not in refused.stderr, refused.stderr)
        faults = refused.stderr.splitlines()  # of the last scene: each has its line
        check(len(faults) > 2 and all("scene:" in fault for fault in faults), faults)
        refused = run(options.study, "map", scene, "--out", with_hydro, *small)
        check(refused.returncode == 1 and "hydro.toml: cannot be made: File exists" in refused.stderr, refused.stderr)

        made = Map(options, scene, pathlib.Path(scratch) / "larger")
        check_axes(made)
        check_elastic_part(made)
        check_sticking_line(made, options.source)
        check_domain(made)
        check_melting(made)

    catalog = run(options.ctl, "materials")
    check(catalog.returncode == 0 and "tantalum\n  strength: Steinberg" in catalog.stdout, catalog.stdout)
    one = run(options.ctl, "materials", "copper_ofhc_jc")
    check('flow_law = "johnson_cook"' in one.stdout and "hardening_modulus_pa = 292000000" in one.stdout, one.stdout)
    check("hardening_coefficient" not in one.stdout, "only its own law's constants")
    unknown = run(options.ctl, "materials", "coper_ofhc")
    check(unknown.returncode == 1 and 'did you mean "copper_ofhc"' in unknown.stderr, unknown.stderr)
    return 0


if __name__ == "__main__":
    sys.exit(main())
