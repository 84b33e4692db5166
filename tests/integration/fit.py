"""Tests of shearbus-study fit: a synthetic velocimeter with noise, what a curve cannot tell, exact derivatives, and what is refused."""
import json
import os
import pathlib
import re
import sys
import tomllib

import h5py
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import OPTIONS

SIGMA = 0.2  # of the velocimeter (m/s)
DENSITY, MODULUS = 7900.0, 7.7e10  # of steel_dlp
SCENE = served.scene("force_driven", layer={"thickness_m": 50e-6, "cells": 30, "grading": 1.14},
                     interface={"friction_coefficient": 0.3, "yield_strength_pa": 200e6},
                     hydro={"end_time_s": 1.5e-6, "constant_shear_stress_pa": 5e7,
                            "shear_column": {"length_m": 2e-3, "zones": 60, "far_end": "free", "velocity_jump_m_per_s": [30.0, 100.0],
                                             "pressure_pa": [0.15e9, 6e9]}})
CURVES = served.SOURCE / "tests/validation/curves"
MU, YIELD = "interface.friction_coefficient=0.1:0.6", "interface.yield_strength_pa=5e7:4e8"


def metal_scene(metal):
    return served.scene("velocity_driven", soft=metal, layer={"cells": 30}, velocity_driven={"drive": "layer_shear"})


class Fit(served.Served):
    def setUp(self):
        super().setUp()
        self.scene = self.path / "scene.toml"
        self.scene.write_text(SCENE)

    def run_hydro(self, *words):
        self.run_program(OPTIONS.hydro, self.scene, "--out", self.path / "run", "--no-plot", "--no-progress", *words)
        return h5py.File(self.path / "run/history.h5")

    def measure(self, nodes, seed):
        """Writes what a velocimeter at the hard body's back sees of some nodes. Returns the file."""
        noise, path = np.random.default_rng(seed), self.path / "measured.csv"
        with self.run_hydro() as file, open(path, "w") as out:
            out.write("# m/s, by nobody\ntime_s, free_surface_velocity, sigma, node_id\n")
            for node in nodes:
                for time in np.linspace(0.7e-6, 1.45e-6, 80):
                    value = np.interp(time, file["time"][:], file["free_surface_velocity"][:, node]) + noise.normal(0.0, SIGMA)
                    out.write(f"{time:.9e},{value:.9e},{SIGMA},{node}\n")
        return path

    def fit(self, *words, scene=None, **more):
        return self.run_program(OPTIONS.study, "fit", scene or self.scene, "--out", self.path / "out", *words, **more)

    def refuse(self, *words, said):
        errors = self.refused(OPTIONS.study, "fit", self.scene, "--out", self.path / "out", "--starts", "1", *words, said=said)
        self.assertEqual(len(errors.strip().splitlines()), 1, errors)

    def fitted(self, *words, **more):
        done = self.fit("--starts", "1", *words, **more)
        return json.loads((self.path / "out/fit.json").read_text()), done.stdout

    def test_known_parameters_come_back_within_their_intervals(self):
        report, printed = self.fitted("--curve", self.measure((0, 1), 3), "--parameter", MU, "--parameter", YIELD)
        for row, known, most in zip(report["parameters"], (0.3, 2e8), (0.03, 0.02)):
            self.assertLess(row["low"], known, printed)
            self.assertGreater(row["high"], known, printed)
            self.assertLess(row["high"] - row["low"], most * known, "an interval that tells something")
            self.assertTrue(row["determined"] and not row["at_end_of_range"])
        self.assertLess(abs(report["chi_squared"] / report["freedom"] - 1.0), 4.0 * np.sqrt(2.0 / report["freedom"]))
        self.assertEqual((self.path / "out/fit.png").read_bytes()[:4], b"\x89PNG")
        # The interval is the error of the estimate: the Coulomb stress of node 0 is mu P, and its free surface moves at 2 mu P / Z.
        exact = SIGMA / np.sqrt(80) / (2 * 0.15e9 / np.sqrt(DENSITY * MODULUS))
        self.assertAlmostEqual((report["parameters"][0]["high"] - report["parameters"][0]["low"]) / (2 * 1.975 * exact), 1.0, delta=0.05)
        with open(self.path / "out/fitted.toml") as file:
            self.assertIn(f"friction_coefficient = {report['parameters'][0]['value']!r}", file.read())

    def test_curves_are_read_as_they_stand(self):
        curve, pipe = self.path / "curve.csv", self.path / "pipe.csv"
        os.mkfifo(pipe)
        for node, said in (("18446744073709551615", "no node 18446744073709551615"), ("9007199254740993", "no node 9007199254740993"),
                           ("18446744073709551616", "no whole number"), ("1.5", "no whole number"), ("-1", "no whole number"), ("1e3", "no whole number")):
            curve.write_text("time_s,free_surface_velocity,node_id\n" + f"8e-7,1.0,{node}\n" * 9)
            self.refuse("--curve", curve, "--parameter", MU, said=said)
        for option in ("--curve", "--stress-strain"):
            self.refuse(option, pipe, "--parameter", MU, said="pipe.csv: expected a curve as a CSV file: is no regular file")
        for parameter in ("interface.friction_coefficient=nan:1", "interface.friction_coefficient=0.1:inf", "interface.friction_coefficient=1_0:20"):
            self.refused(OPTIONS.study, "fit", self.scene, "--curve", curve, "--parameter", parameter, said="expected KEY=LOW:HIGH", code=2)

    def test_what_a_curve_does_not_determine_is_told(self):
        curve = self.measure((1,), 4)  # slides at its yield limit: mu has no part in it
        report, printed = self.fitted("--curve", curve, "--parameter", "interface.friction_coefficient=0.25:0.6", "--parameter", YIELD)
        mu, strength = report["parameters"]
        self.assertEqual((mu["determined"], strength["determined"]), (False, True), printed)
        self.assertTrue(strength["low"] < 2e8 < strength["high"], printed)
        self.assertIn("NOT DETERMINED", printed)
        self.assertIn("do not tell values apart along", printed)

    def test_a_search_begins_where_the_curve_tells_something(self):
        self.fit("--curve", self.measure((0,), 5), "--parameter", "interface.friction_coefficient=0.05:8")  # above 0.8 the yield limit holds it
        report = json.loads((self.path / "out/fit.json").read_text())
        (row,) = report["parameters"]
        self.assertTrue(row["determined"] and row["low"] < 0.3 < row["high"], row)

    def test_no_other_file_is_replaced(self):
        (self.path / "out").mkdir(exist_ok=True)
        for name, words in (("fitted.toml", ("--curve", self.measure((0,), 5))), ("sensitivities.h5", ())):
            other = self.path / "out" / name
            other.write_text("mine")
            self.refused(OPTIONS.study, "fit", self.scene, "--out", other.parent, "--parameter", MU, *words, said=f"{name}: is there and is not")
            self.assertEqual(other.read_text(), "mine")

    def test_the_free_surface_is_the_wave_of_the_stress(self):
        with self.run_hydro("--interface-law", "constant") as file:
            dt, stress, surface = file["dt"][1], file["shear_stress"][:], file["free_surface_velocity"][:]
        impedance, soft_speed = np.sqrt(DENSITY * MODULUS), np.sqrt(2.76e10 / 2703.0)
        zones = round(2e-3 / (2e-3 / 60 / soft_speed * np.sqrt(MODULUS / DENSITY)))
        self.assertAlmostEqual(dt * soft_speed, 2e-3 / 60, delta=1e-12)
        self.assertTrue((surface[:zones] == 0.0).all() and stress.max() > 0.0)
        last = min(3 * zones, len(surface))  # before the wave comes back from the interface
        self.assertGreater(last, 2 * zones)
        np.testing.assert_allclose(surface[zones + 1:last], 2.0 * stress[:last - zones - 1] / impedance, rtol=1e-9)

    def test_derivatives_are_those_of_the_coulomb_limit(self):
        self.fit("--starts", "1", "--parameter", MU)
        with h5py.File(self.path / "out/sensitivities.h5") as file:
            slope = file["interface.friction_coefficient/shear_stress"][:]
        np.testing.assert_allclose(slope[5:40, 0], 0.15e9, rtol=1e-9, err_msg="s = mu P where the node slides")
        np.testing.assert_array_equal(slope[5:40, 1], 0.0, "the limit of this node is that of its yield")

    def recorded(self):
        """Records a run, and returns the history and a scene for its replay."""
        self.run_hydro().close()
        scene = self.path / "replay.toml"
        scene.write_text(SCENE[:SCENE.index("[hydro]")])
        return self.path / "run/history.h5", scene

    def sensitivities(self, history, scene, *parameters):
        words = [word for parameter in parameters for word in ("--parameter", parameter)]
        done = self.fit("--history", history, *words, scene=scene)
        with h5py.File(self.path / "out/sensitivities.h5") as file:
            return done.stdout, {f"{key}/{name}": data[:] for key, group in file.items() if isinstance(group, h5py.Group) for name, data in group.items()}

    def test_one_replay_gives_the_derivatives_of_separate_ones(self):
        history, scene = self.recorded()
        conductivity = "soft.thermal_conductivity_w_per_m_k=90:140"  # the diffusivity follows from it
        scene.write_text(scene.read_text().replace("[hard]", "thermal_conductivity_w_per_m_k = 117\n[hard]"))
        printed, found = self.sensitivities(history, scene, MU, YIELD, conductivity)
        self.assertIn("13 sets of parameters by 1 run of shearbus-replay", printed)
        ranges = {text.split("=")[0]: [float(end) for end in text.split("=")[1].split(":")] for text in (MU, YIELD, conductivity)}
        for key, (low, high) in ranges.items():
            answers = []
            for x in (0.5 - 2e-3, 0.5 + 2e-3):
                out, values = self.path / "alone.h5", {other: begin + (x if other == key else 0.5) * (end - begin) for other, (begin, end) in ranges.items()}
                changes = [word for name, value in values.items() for word in ("--set", f"{name}={value!r}")]
                self.run_program(OPTIONS.replay, history, "--scene", scene, *changes, "--out", out, "--no-progress")
                with h5py.File(out) as file:
                    answers.append({name: file[name][:] for name in ("shear_stress", "sliding_velocity", "interface_temperature")})
            for name, high_answer in answers[1].items():
                expected = (high_answer - answers[0][name]) / ((0.5 + 2e-3) - (0.5 - 2e-3)) / (high - low)
                np.testing.assert_array_equal(found[f"{key}/{name}"], expected, f"{key}, {name}")
            self.assertGreater(np.abs(found[f"{key}/interface_temperature"]).max(), 0.0)

    def test_what_nodes_cannot_have_of_their_own_is_run_apart(self):
        history, scene = self.recorded()
        printed, found = self.sensitivities(history, scene, "layer.grading=1.1:1.18")
        self.assertIn("5 sets of parameters by 5 runs of shearbus-replay", printed)
        self.assertGreater(np.abs(found["layer.grading/interface_temperature"]).max(), 0.5)

    def test_the_catalog_has_the_fit_to_the_curves_of_aluminium_5083(self):
        keys = {"yield_strength_pa": (1e8, 4e8), "hardening_modulus_pa": (1e8, 9e8), "hardening_exponent": (0.1, 0.9), "rate_coefficient": (0.001, 0.06),
                "thermal_softening_exponent": (0.5, 3.0)}
        words = [word for key, (low, high) in keys.items() for word in ("--parameter", f"soft.{key}={low}:{high}")]
        report, printed = self.fitted("--stress-strain", CURVES / "al5083.csv", *words, scene=CURVES / "al5083.toml", timeout=600)
        self.assertEqual((self.path / "out/fit.png").read_bytes()[:4], b"\x89PNG")
        catalog = self.constants_of("aluminium_5083")
        for row in report["parameters"]:
            self.assertFalse(row["at_end_of_range"], printed)
            self.assertAlmostEqual(catalog[row["key"].removeprefix("soft.")] / row["value"], 1.0, delta=1e-3, msg=row["key"])
        self.assertAlmostEqual(float(re.search(r"residuals: (\S+) of the stress rms", printed)[1]), 0.0362, delta=1e-4)

    # Root mean square of (catalog - measured) / measured. The entries say what they are; these numbers hold what the pages tell of them.
    def test_catalog_entries_are_as_far_from_measured_curves_as_told(self):
        for metal, file, told in (("aluminium_5083", "al5083.csv", 0.0362), ("titanium_6al_4v", "ti64.csv", 0.0588), ("aluminium_dlp", "al5083.csv", 0.3545),
                                  ("aluminium_6061_t6", "al5083.csv", 0.1070)):
            found = self.residual(metal, CURVES / file)
            self.assertAlmostEqual(found, told, delta=5e-4, msg=metal)

    def residual(self, metal, path):
        scene = self.path / f"{metal}.toml"
        scene.write_text(metal_scene(metal))
        with open(path) as file:
            rows = np.array([[float(x) for x in line.split(",")] for line in file if line[0] in "0123456789"])
        errors = []
        for condition in np.unique(rows[:, 2:], axis=0):
            rate, temperature, heated = condition
            here = rows[(rows[:, 2:] == condition).all(1)]
            here = here[np.argsort(here[:, 0])]
            printed = self.run_program(OPTIONS.study, "curve", scene, "--rate", repr(float(rate)), "--temperature", repr(float(temperature)),
                                       "--taylor-quinney", repr(float(heated)), "--plastic-strain", ",".join(map(str, here[:, 0]))).stdout
            stress = np.array([float(line.split(",")[1]) for line in printed.splitlines()[1:]])
            errors.extend(stress / here[:, 1] - 1.0)
        return float(np.sqrt(np.mean(np.square(errors))))

    def constants_of(self, metal):
        scene = self.path / "metal.toml"
        scene.write_text(metal_scene(metal))
        return tomllib.loads(self.run_program(OPTIONS.ctl, "check", scene).stdout)["soft"]

    def test_wrong_input_is_refused_in_a_sentence(self):
        def table(name, text):
            (self.path / name).write_text(text)
            return self.path / name

        curve = table("c.csv", "time_s,free_surface_velocity,node_id\n1e-6,10,0\n1.1e-6,10,0\n")
        late = table("late.csv", "time_s,free_surface_velocity,node_id\n1e-6,10,0\n1.1e-5,10,0\n")
        other = table("other.csv", "time_s,colour,node_id\n1e-6,10,0\n1.1e-6,10,0\n")
        single = table("single.csv", "time_s,slip_distance\n1e-6,10\n1.1e-6,10\n")
        for words, reason in (((MU, "--curve", self.path), f"{self.path}: expected a curve as a CSV file: is no regular file"),
                              ((MU, "--curve", self.path / "none.csv"), "none.csv: expected a curve as a CSV file: No such file or directory"), ((MU, "--curve", self.scene), "expected a header of time_s"), ((MU, "--curve", late), "the run has free_surface_velocity from"),
                              ((MU, "--curve", other), "the run has no colour; it has"), ((MU, "--curve", single), "expected a column node_id"),
                              (("interface.friction=0.1:0.6", "--curve", curve), f"{self.scene}:"),
                              ((MU, "--parameter", YIELD, "--curve", curve), "expected more values than parameters")):
            self.refuse("--parameter", *words, said=reason)
        for words, reason in (((MU.replace("0.1:0.6", "0.6:0.1"),), "expected LOW below HIGH, found interface"), (("mu",), "expected KEY=LOW:HIGH"),
                              ((MU, "--stress-strain", curve, "--curve", curve), "goes without --curve")):
            self.refused(OPTIONS.study, "fit", self.scene, "--parameter", *words, said=reason, code=2)
        self.refused(OPTIONS.study, "curve", self.scene, "--rate", "1e5", "--temperature", "300", "--plastic-strain", "0.1,1e7", said="expected 0 to 100", code=2)


if __name__ == "__main__":
    served.main()
