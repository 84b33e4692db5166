"""Runs `shearbus-study stability` as a user does, on one row and on scenes of the user's own. Table, JSON, picture and exit code agree;
scenes without a layer are refused; values that no solver can handle are reported."""
import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import EXAMPLES, OPTIONS, PROBLEMS

# Metals, thickness, initial state and host all differ from the paper's.
SCENE = served.scene("force_driven", name="mine", soft="copper_ofhc", hard="steel_304",
                     layer={"thickness_m": 5e-6, "cells": 30, "grading": 1.1, "far_boundary": "half_space", "initial_temperature_k": 77.0},
                     interface={"friction_coefficient": 0.2, "yield_strength_pa": 300e6},
                     hydro={"end_time_s": 1e-6, "shear_column": {"length_m": 1e-3, "zones": 100, "velocity_jump_m_per_s": [50.0],
                                                                 "pressure_pa": [20e9, 3e9]}})
OF_LAYERS = ("hardening", "saturation", "host_shear")  # rows that need a layer that deforms; the layer of SCENE does not


class Stability(served.Served):
    def setUp(self):
        super().setUp()
        self.scene = self.path / "mine.toml"
        self.scene.write_text(SCENE)

    def run_study(self, *arguments, code=0):
        return self.run_program(OPTIONS.study, "stability", *arguments, "--out", self.path, code=code)

    def study(self, *arguments):
        """Returns what stability.json has, and what is printed."""
        said = self.run_study(*arguments).stdout
        self.assertNotIn("BROKEN", said)
        return json.loads((self.path / "stability.json").read_text()), said

    def assert_drawn(self):
        self.assertGreater((self.path / "stability.png").stat().st_size, 10000)

    def test_one_row(self):
        found, text = self.study("--row", "near_melting")
        self.assert_drawn()
        self.assertTrue(found["commit"] and found["processor"])
        self.assertEqual(([row["name"] for row in found["rows"]], found["scene"]), (["near_melting"], None))
        self.assertTrue(len(found["cells"]) == len(found["physics"]) > 15)
        for cell in found["cells"]:
            self.assertEqual((cell["verdict"], cell["reason"]), ("held", ""), cell)
            self.assertTrue(cell["node_steps"] > 1000 and cell["heat_residual"] < 1e-12 and 0 <= cell["bound_share"] <= 1.13, cell)
            self.assertGreater(cell["layer_sums"] + cell["limit_values"] + cell["wave_evaluations"], 0, cell)
        self.assertIn("near_melting", text)
        said = self.run_study("--row", "nothing", code=1).stderr
        self.assertTrue("nothing" in said and "near_melting" in said, said)

    def test_a_scene_of_the_users_own(self):
        found, text = self.study(self.scene, "--random", 4000, "--steps", 200)
        self.assert_drawn()
        told = found["scene"]
        self.assertEqual((told["name"], told["file"]), ("mine", str(self.scene)))
        self.assertIn("copper_ofhc on steel_304", told["physics"])
        # The host's values come from the scene: its largest pressure, its zones, and the time of a shear wave across a zone. None is the
        # paper's.
        self.assertTrue(told["pressure_pa"] == 20e9 and told["soft_zone_width_m"] == 1e-5 and 2e-9 < told["dt_s"] < 6e-9, told)
        self.assertTrue(f"mine: {told['physics']}" in text and f"host: {told['host']}" in text, text)
        self.assertEqual((found["physics"], found["controls"]), (["mine"], []))
        verdicts = {cell["row"]: cell["verdict"] for cell in found["cells"]}
        self.assertTrue(len(verdicts) > 20 and all((v == "not asked") == (row in OF_LAYERS) for row, v in verdicts.items()), verdicts)
        self.assertTrue(all(v != "broken" for v in verdicts.values()) and verdicts["three_roots"] == "held", verdicts)
        (drawn,) = found["random"]
        self.assertEqual((drawn["name"], drawn["node_steps"], drawn["faults"]), ("mine", 4000, []))
        # Values that the scene does not give, or that the command line replaces.
        found, _ = self.study(self.scene, "--row", "pressure", "--pressure", 1e9, "--zone-width", 4e-6, "--dt", 1e-10, "--no-plot")
        told = found["scene"]
        self.assertEqual((told["pressure_pa"], told["hard_zone_width_m"], told["dt_s"]), (1e9, 4e-6, 1e-10))
        self.assertIn("--pressure", told["host"])

    def test_shipped_scenes(self):
        found, _ = self.study(PROBLEMS / "cone_al_steel_coarse.toml", "--no-plot", "--random", 4000)
        self.assertAlmostEqual(found["scene"]["pressure_pa"], 7.69e9, delta=0.1e9)
        self.assertIn("modes", found["scene"]["physics"])
        self.assertEqual({cell["verdict"] for cell in found["cells"]}, {"held", "not asked"}, found["cells"])
        for name in ("interface_slip", "paper_velocity_driven_graded"):
            self.study(EXAMPLES / f"{name}.toml", "--no-plot", "--random", 400, "--steps", 20)

    def test_bad_scenes(self):
        problems = PROBLEMS / "verification"
        for text, *expected in (((problems / "taylor_bar.toml").read_text(), "no bodies slide", "shear_column"),
                                ((problems / "oblique_free_slip.toml").read_text(), "free_slip", '"subgrid"'),
                                (SCENE.replace('"copper_ofhc"', '"cheese"'), "cheese"),
                                (SCENE.replace("= 77.0", "= 2000.0"), ":12:1", "layer.initial_temperature_k", "starts solid"),
                                (SCENE.replace("[20000000000.0, 3000000000.0]", "[-1e9]"), "pressure above 0", "--pressure")):
            self.scene.write_text(text)
            self.refused(OPTIONS.study, "stability", self.scene, "--no-plot", said=(self.scene.name, *expected))
        self.refused(OPTIONS.study, "stability", "--pressure", "1e9", said="name the scene")
        # A metal that conducts no heat is unphysical; the server accepts it, and the campaign reports it.
        self.scene.write_text(SCENE.replace('"copper_ofhc"', '"copper_ofhc"\nthermal_conductivity_w_per_m_k = 1e-300'))
        self.assertIn("BROKEN fourier_number, mine", self.run_study(self.scene, "--row", "fourier_number", "--no-plot", code=1).stdout)
        (cell,) = json.loads((self.path / "stability.json").read_text())["cells"]
        self.assertTrue(cell["verdict"] == "broken" and cell["reason"], cell)


if __name__ == "__main__":
    served.main()
