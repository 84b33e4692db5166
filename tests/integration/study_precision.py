#!/usr/bin/python3
"""shearbus-study precision as a user runs it, on few settings: the errors it reports are those the methods have, what it calls
efficient nothing beats, and a scene of the user's own is studied too."""
import argparse
import json
import math
import pathlib
import subprocess
import tempfile

SCENE = """
name = "mine"
strategy = "velocity_driven"
[soft]
material = "aluminium_dlp"
[hard]
material = "steel_dlp"
"""


def study(program, out, *arguments):
    ran = subprocess.run([program, "precision", *arguments, "--quick", "--repeats", "1", "--no-plot", "--out", out],
                         capture_output=True, text=True)
    assert ran.returncode == 0, ran.stderr
    return json.loads((pathlib.Path(out) / "precision.json").read_text()), ran.stdout


def errors(problem, integrator, cells):
    runs = [r for r in problem["runs"] if r["integrator"] == integrator and r["cells"] == cells and r["modes_accuracy"] in (0, 1e-6)]
    return [r["temperature_error"] for r in sorted(runs, key=lambda r: r["steps"])]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--study", required=True)
    program = parser.parse_args().study
    with tempfile.TemporaryDirectory() as out:
        found, text = study(program, out)
        problems = {p["name"]: p for p in found["problems"]}
        assert set(problems) == {"constant_flux", "fixed_slip", "two_half_spaces", "paper_velocity_driven", "stick_slip"}, problems.keys()
        assert found["commit"] and found["processor"], found
        for problem in problems.values():
            runs = problem["runs"]
            assert all(r["failure"] == "" for r in runs), problem["name"]
            front = sorted((r["ns_per_node"], r["temperature_error"]) for r in runs if r["efficient"])
            assert front == sorted(front, key=lambda r: -r[1]), front
            assert all(r["message_ns_per_node_step"] > 0 for r in runs if r["efficient"])
            assert f"\n{problem['title']}\n" in text
        # 20 and 100 steps of constant flux: backward Euler is low by 1/(8 n) of the rise, modes follow it exactly.
        coarse, fine = errors(problems["constant_flux"], "backward_euler", 60)
        assert math.isclose(coarse / fine, 5, rel_tol=0.35), (coarse, fine)
        assert max(errors(problems["constant_flux"], "sdirk2", 60)) < 0.3 * coarse
        assert max(errors(problems["constant_flux"], "backward_euler", 0)) < 1e-6
        assert problems["paper_velocity_driven"]["runs"][0]["state_bytes"] > problems["fixed_slip"]["runs"][-1]["state_bytes"]
        # A scene of the user's own.
        scene = pathlib.Path(out) / "mine.toml"
        scene.write_text(SCENE)
        mine, text = study(program, out, str(scene), "--end", "3e-7")
        assert [p["name"] for p in mine["problems"]] == ["mine"] and "cheapest for a tolerance" in text
        scene.write_text(SCENE.replace("aluminium_dlp", "cheese"))
        ran = subprocess.run([program, "precision", str(scene), "--no-plot"], capture_output=True, text=True)
        assert ran.returncode == 1 and "cheese" in ran.stderr, ran
    print("shearbus-study precision answers as it should")


if __name__ == "__main__":
    main()
