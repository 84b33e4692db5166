"""Runs the accuracy studies as a user does, on few settings. The errors that `precision` reports are the known errors of the methods, no
setting beats the settings that it calls efficient, and it accepts a scene of the user's own; `tolerance` delivers the accuracy that is
requested; the cone's error from the layer is smaller than the error from its zones."""
import json
import math
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import OPTIONS, SOURCE

SCENE = served.scene("velocity_driven", name="mine")


def errors(problem, integrator, cells):
    runs = [r for r in problem["runs"] if r["integrator"] == integrator and r["cells"] == cells and r["modes_accuracy"] in (0, 1e-6)]
    return [r["temperature_error"] for r in sorted(runs, key=lambda r: r["steps"])]


class Studies(served.Served):
    def study(self, name, *arguments, out=None):
        """Returns what the study's file has, and what is printed."""
        out = out or self.path
        done = self.run_program(OPTIONS.study, name, *arguments, "--quick", "--repeats", 1, "--out", out)
        return json.loads((out / f"{name}.json").read_text()), done.stdout

    def test_errors_are_those_of_the_methods(self):
        found, text = self.study("precision", "--no-plot")
        problems = {p["name"]: p for p in found["problems"]}
        self.assertEqual(set(problems), {"constant_flux", "fixed_slip", "two_half_spaces", "paper_velocity_driven", "stick_slip"})
        self.assertTrue(found["commit"] and found["processor"])
        for problem in problems.values():
            runs = problem["runs"]
            self.assertEqual({r["failure"] for r in runs}, {""}, problem["name"])
            # An error that the reference does not resolve counts as ten times that of the reference.
            self.assertGreaterEqual(problem["uncertainty"], problem["space_error"] + problem["time_error"], problem["name"])
            least = 10 * problem["uncertainty"]
            self.assertTrue(all(r["resolved"] == (r["temperature_error"] >= least) for r in runs), problem["name"])
            front = sorted((r["ns_per_node"], max(r["temperature_error"], least)) for r in runs if r["efficient"])
            self.assertEqual(front, sorted(front, key=lambda r: -r[1]))
            self.assertTrue(all(r["message_ns_per_node_step"] > 0 for r in runs if r["efficient"]))
            self.assertIn(f"\n{problem['title']}\n", text)
        # 20 and 100 steps of constant flux: backward Euler is low by 1/(8 n) of the rise after n steps; modes are exact.
        coarse, fine = errors(problems["constant_flux"], "backward_euler", 60)
        self.assertTrue(math.isclose(coarse / fine, 5, rel_tol=0.35), (coarse, fine))
        self.assertLess(max(errors(problems["constant_flux"], "sdirk2", 60)), 0.3 * coarse)
        self.assertLess(max(errors(problems["constant_flux"], "backward_euler", 0)), 1e-6)
        self.assertGreater(problems["paper_velocity_driven"]["runs"][0]["state_bytes"], problems["fixed_slip"]["runs"][-1]["state_bytes"])
        # The grids of the reference are not those of the settings, and differ from each other.
        for name in ("paper_velocity_driven", "stick_slip"):
            self.assertTrue(0 < problems[name]["space_error"] < 1e-4, problems[name]["space_error"])
        # Every option that the page tells has its rows; only a tolerance has a study of its own.
        rows = {r["option"] for r in found["options"]}
        page = self.run_program(OPTIONS.ctl, "options").stdout
        table = page[page.index("## Options"):page.index("## Friction laws")]
        keys = {line.split("`")[1] for line in table.splitlines() if line.startswith("| `")}
        for key in keys - {'strategy = "velocity_driven"', 'strategy = "force_driven"', "tolerance"}:
            self.assertTrue(key.strip("[]") in rows or key.split(" = ")[0] in rows, (key, rows))
        resolved = [r for r in found["options"] if r["option"] in ("", "hard_layer", "soft.melting_curve", "layer.far_boundary")]
        self.assertEqual(len(resolved), 8)
        self.assertTrue(all(0 < run["temperature_error"] < 2e-2 for r in resolved for run in r["runs"]), resolved)

    def test_a_scene_of_the_users_own_and_a_directory_of_any_name(self):
        scene, place = self.path / "mine.toml", self.path / 'a "$(touch touched)" b'  # no shell reads it
        scene.write_text(SCENE)
        mine, text = self.study("precision", scene, "--end", "3e-7", out=place)
        self.assertGreater((place / "precision.png").stat().st_size, 0)
        self.assertEqual([p["name"] for p in mine["problems"]], ["mine"])
        self.assertIn("cheapest for a tolerance", text)
        scene.write_text(SCENE.replace("aluminium_dlp", "cheese"))
        self.refused(OPTIONS.study, "precision", scene, "--no-plot", said="cheese")

    def test_requested_tolerances_are_kept_and_the_stricter_one_delivers_more(self):
        kept, text = self.study("tolerance", "--no-plot")
        for problem in kept["problems"]:
            loose, strict = problem["runs"]
            self.assertEqual([(run["requested"], run["failure"]) for run in (loose, strict)], [(1e-2, ""), (1e-4, "")], problem)
            self.assertTrue(loose["temperature_error"] < 1e-2 and strict["temperature_error"] < 1e-4, problem)
            self.assertLess(strict["temperature_error"], loose["temperature_error"], problem)
            self.assertIn(f"\n{problem['name']}\n", text)
        loose, strict = kept["histories"]
        self.assertEqual((loose["requested"], strict["requested"]), (1e-1, 1e-2))
        self.assertLess(loose["sums_per_step"], strict["sums_per_step"])
        for run in (loose, strict):
            self.assertTrue(0 < run["median_of_request"] < run["largest_of_request"] < 1 and run["histories"] == 8, run)
            self.assertEqual(run["largest_of_request"], max(error["largest_of_request"] for error in run["errors"].values()), run)
        self.assertIn("\n8 random histories", text)

    def test_the_error_of_a_layer_of_80_cells_is_below_that_of_the_zones(self):
        self.run_program(sys.executable, SOURCE / "tests/validation/cone_sweep.py", "--hydro", OPTIONS.hydro, "--zones", "2e-3,1e-3",
                         "--layers", "80 cells", "--end", "6e-6", "--out", self.path)
        rows = json.loads((self.path / "cone_sweep.json").read_text())["rows"]
        self.assertEqual(len(rows), 5)
        apart = {r["layer"]: r["error"] for r in rows if r["zone_width_m"] == 2e-3}
        layer, zones = apart["profile, 80 cells x1.06"], apart["zones half as wide (hydro error)"]
        self.assertTrue(0 < layer["mean_slip_m"] < 0.5 * zones["mean_slip_m"] and 0 < layer["temperature_rms"] < 2e-2, apart)


if __name__ == "__main__":
    served.main()
