"""Tests of `shearbus-study map` and its pictures, run as a user does."""
import argparse
import csv
import json
import pathlib
import subprocess
import sys
import tempfile


def run(*command):
    return subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=200)


def check(condition, what):
    if not condition:
        raise AssertionError(what)


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
        refused = run(options.study, "map", options.source / "client/examples/force_driven.toml", "--out", out, *small)
        check(refused.returncode == 1 and "layer_shear" in refused.stderr, refused.stderr)

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
