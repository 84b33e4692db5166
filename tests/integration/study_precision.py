#!/usr/bin/python3
"""Runs the accuracy studies as a user does, on few settings. The errors that `precision` reports are the known errors of the methods, no
setting beats the settings that it calls efficient, and it accepts a scene of the user's own; `tolerance` delivers the accuracy that is
requested; the cone's error from the layer is smaller than the error from its zones."""
import argparse
import json
import math
import pathlib
import subprocess
import sys
import tempfile

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served

SCENE = served.scene("velocity_driven", name="mine")


def study(program, out, *arguments, name="precision", plot="--no-plot"):
    ran = subprocess.run([program, name, *arguments, "--quick", "--repeats", "1", "--out", out, *[plot] * bool(plot)], capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    return json.loads((pathlib.Path(out) / f"{name}.json").read_text()), ran.stdout


def errors(problem, integrator, cells):
    runs = [r for r in problem["runs"] if r["integrator"] == integrator and r["cells"] == cells and r["modes_accuracy"] in (0, 1e-6)]
    return [r["temperature_error"] for r in sorted(runs, key=lambda r: r["steps"])]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--study", required=True)
    parser.add_argument("--hydro", required=True)
    parser.add_argument("--ctl", required=True)
    parser.add_argument("--cone-sweep", required=True)
    options = parser.parse_args()
    program = options.study
    with tempfile.TemporaryDirectory() as out:
        found, text = study(program, out)
        problems = {p["name"]: p for p in found["problems"]}
        assert set(problems) == {"constant_flux", "fixed_slip", "two_half_spaces", "paper_velocity_driven", "stick_slip"}, problems.keys()
        assert found["commit"] and found["processor"], found
        for problem in problems.values():
            runs = problem["runs"]
            assert all(r["failure"] == "" for r in runs), problem["name"]
            # An error that the reference does not resolve counts as ten times that of the reference.
            assert problem["uncertainty"] >= problem["space_error"] + problem["time_error"], problem["name"]
            least = 10 * problem["uncertainty"]
            assert all(r["resolved"] == (r["temperature_error"] >= least) for r in runs), problem["name"]
            front = sorted((r["ns_per_node"], max(r["temperature_error"], least)) for r in runs if r["efficient"])
            assert front == sorted(front, key=lambda r: -r[1]), front
            assert all(r["message_ns_per_node_step"] > 0 for r in runs if r["efficient"])
            assert f"\n{problem['title']}\n" in text
        # 20 and 100 steps of constant flux: backward Euler is low by 1/(8 n) of the rise after n steps; modes are exact.
        coarse, fine = errors(problems["constant_flux"], "backward_euler", 60)
        assert math.isclose(coarse / fine, 5, rel_tol=0.35), (coarse, fine)
        assert max(errors(problems["constant_flux"], "sdirk2", 60)) < 0.3 * coarse
        assert max(errors(problems["constant_flux"], "backward_euler", 0)) < 1e-6
        assert problems["paper_velocity_driven"]["runs"][0]["state_bytes"] > problems["fixed_slip"]["runs"][-1]["state_bytes"]
        # The grids of the reference are not those of the settings, and differ from each other.
        assert 0 < problems["paper_velocity_driven"]["space_error"] < 1e-4, problems["paper_velocity_driven"]["space_error"]
        assert 0 < problems["stick_slip"]["space_error"] < 1e-4, problems["stick_slip"]["space_error"]
        # Every option that the page tells has its rows; only a tolerance has a study of its own.
        rows = {r["option"] for r in found["options"]}
        page = subprocess.run([options.ctl, "options"], capture_output=True, text=True, check=True).stdout
        table = page[page.index("## Options"):page.index("## Friction laws")]
        keys = {line.split("`")[1] for line in table.splitlines() if line.startswith("| `")}
        for key in keys - {'strategy = "velocity_driven"', 'strategy = "force_driven"', "tolerance"}:
            assert key.strip("[]") in rows or key.split(" = ")[0] in rows, (key, rows)
        resolved = [r for r in found["options"] if r["option"] in ("", "hard_layer", "soft.melting_curve", "layer.far_boundary")]
        assert len(resolved) == 8 and all(0 < run["temperature_error"] < 2e-2 for r in resolved for run in r["runs"]), resolved
        # The study accepts a scene of the user's own, too, and draws into a directory of any name: no shell reads it.
        scene = pathlib.Path(out) / "mine.toml"
        scene.write_text(SCENE)
        place = pathlib.Path(out) / 'a "$(touch touched)" b'
        mine, text = study(program, place, str(scene), "--end", "3e-7", plot="")
        assert (place / "precision.png").stat().st_size > 0
        assert [p["name"] for p in mine["problems"]] == ["mine"] and "cheapest for a tolerance" in text
        scene.write_text(SCENE.replace("aluminium_dlp", "cheese"))
        ran = subprocess.run([program, "precision", str(scene), "--no-plot"], capture_output=True, text=True)
        assert ran.returncode == 1 and "cheese" in ran.stderr, ran
        # The requested tolerances are kept, and the stricter tolerance delivers a smaller error.
        kept, text = study(program, out, name="tolerance")
        for problem in kept["problems"]:
            loose, strict = problem["runs"]
            assert (loose["requested"], strict["requested"]) == (1e-2, 1e-4) and loose["failure"] == strict["failure"] == "", problem
            assert loose["temperature_error"] < 1e-2 and strict["temperature_error"] < 1e-4, problem
            assert strict["temperature_error"] < loose["temperature_error"], problem
            assert f"\n{problem['name']}\n" in text
        loose, strict = kept["histories"]
        assert (loose["requested"], strict["requested"]) == (1e-1, 1e-2) and loose["sums_per_step"] < strict["sums_per_step"], kept
        for run in (loose, strict):
            assert 0 < run["median_of_request"] < run["largest_of_request"] < 1 and run["histories"] == 8, run
            assert run["largest_of_request"] == max(error["largest_of_request"] for error in run["errors"].values()), run
        assert "\n8 random histories" in text
        # With zones of 2 mm and 1 mm, the error of 80 cells is smaller than the error of the zones.
        ran = subprocess.run([sys.executable, options.cone_sweep, "--hydro", options.hydro, "--zones", "2e-3,1e-3", "--layers", "80 cells",
                              "--end", "6e-6", "--out", out], capture_output=True, text=True)
        assert ran.returncode == 0, ran.stderr
        cone = json.loads((pathlib.Path(out) / "cone_sweep.json").read_text())
        apart = {r["layer"]: r["error"] for r in cone["rows"] if r["zone_width_m"] == 2e-3}
        layer, zones = apart["profile, 80 cells x1.06"], apart["zones half as wide (hydro error)"]
        assert len(cone["rows"]) == 5 and 0 < layer["mean_slip_m"] < 0.5 * zones["mean_slip_m"] and 0 < layer["temperature_rms"] < 2e-2, cone
    print("the studies answer as they should")


if __name__ == "__main__":
    main()
