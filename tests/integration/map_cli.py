"""Tests of `shearbus-study map` and its pictures, run as a user does; the map is compared with closed formulas."""
import csv
import json
import math
import pathlib
import sys
import tomllib

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
import shearbus
from served import EXAMPLES, OPTIONS

SCENE = EXAMPLES / "validity_map.toml"
SMALL = ("--pressures", 4, "--velocities", 7, "--times", 2e-8, 1e-7, "--dt", 1e-9)
THICKNESS_M, G0_KEY = 20e-6, "shear_modulus_pa"
STICK = 1  # shearbus.v1.Regime


def rows(out):
    with open(out / "nodes.csv", newline="") as file:
        return list(csv.DictReader(file))


class Map:
    """A map of 4 pressures and 13 velocities at three times. Columns are arrays (times, pressures, velocities)."""

    def __init__(self, out):
        self.json = json.loads((out / "map.json").read_text())
        number = lambda text: float(text) if text else math.nan
        read = rows(out)
        self.of = {name: np.array([number(row[name]) for row in read]).reshape(3, 4, 13) for name in read[0]}
        self.times = [seen["time_s"] for seen in self.json["observations"]]
        self.shear_modulus = tomllib.loads(self.json["effective_scene"])["soft"][G0_KEY]

    def line(self, name):
        """Returns an array (times, pressures); NaN outside of the map."""
        return np.array([[math.nan if value is None else value for value in seen[name]] for seen in self.json["observations"]])


class MapCli(served.Served):
    def setUp(self):
        super().setUp()
        self.out = self.path / "map"

    def map(self, *words, scene=SCENE, out=None, code=0):
        """Makes a map. Returns what is printed, which is a fault where a code is expected."""
        done = self.run_program(OPTIONS.study, "map", scene, "--out", out or self.out, *words, code=code)
        return done.stderr if code else done.stdout

    def test_the_files_say_what_was_run(self):
        self.assertIn("sticking below", self.map(*SMALL))
        described = json.loads((self.out / "map.json").read_text())
        self.assertEqual([seen["time_s"] for seen in described["observations"]], [2e-8, 1e-7])
        self.assertIn("[soft]", described["effective_scene"])
        found = rows(self.out)
        self.assertEqual(len(found), 2 * 4 * 7)
        for row in found:
            self.assertLess(abs(float(row["friction_coefficient"]) * float(row["pressure_pa"]) - float(row["shear_stress_pa"])), 1.0, row)
            self.assertTrue(0.0 <= float(row["slip_share"]) <= 1.0, row)
        self.run_program("/usr/bin/python3", served.SOURCE / "client/study/map/plot_map.py", self.out)
        for picture in ("limits.png", "fields.png"):
            self.assertEqual((self.out / picture).read_bytes()[:4], b"\x89PNG", picture)
        with_hydro = self.path / "hydro.toml"
        with_hydro.write_text(SCENE.read_text() + "\n[hydro]\nof_the_hydro_stub = 1\n")
        self.map(*SMALL, scene=with_hydro, out=self.path / "hydro")
        self.assertEqual((self.path / "hydro/nodes.csv").read_bytes(), (self.out / "nodes.csv").read_bytes(), "[hydro] is left out")
        self.assertIn("hydro.toml: cannot be made: File exists", self.map(*SMALL, out=with_hydro, code=1))

    def test_faults_are_told(self):
        for bad, told in ((("--times", 3e-7, 1e-7), "must increase"), (("--dt", 3e-8), "whole number of steps"),
                          (("--pressure", 2e9, 1e9), "lower value first")):
            self.assertIn(told, self.map(*bad, code=2))
        for other in ("force_driven.toml", "interface_slip.toml"):
            self.assertIn("layer_shear", self.map(*SMALL, scene=EXAMPLES / other, code=1))
        # A fault is told with its file and, behind [hydro], with its line.
        bad = self.path / "bad.toml"
        for text, told in ((b"a = [", "bad.toml: "), (b"\xff", "bad.toml: 'utf-8' codec"), (None, "bad.toml: No such file"),
                           (b"[hydro]\nx = [[1, 2],\n" + SCENE.read_bytes().replace(b"[soft]", b"[3, 4]]\n[soft]", 1), "bad.toml: "),
                           (b"\n[hydro.of]\nx = 1\n[layer]\nthicknes_m = 1e-5\n", ":5")):
            bad.unlink(missing_ok=True)
            if text is not None:
                bad.write_bytes(text)
            said = self.map(*SMALL, scene=bad, code=1)
            self.assertIn(told, said)
            self.assertNotIn("Traceback", said)
        faults = said.splitlines()  # of the last scene: each has its line
        self.assertTrue(len(faults) > 2 and all("scene:" in fault for fault in faults), faults)

    def test_a_map_is_that_of_closed_formulas(self):
        self.map("--pressures", 4, "--velocities", 13, "--times", 50e-9, 100e-9, 400e-9)
        made = Map(self.out)
        velocity = made.json["velocity_jump_m_per_s"]
        self.assertEqual((velocity[0], velocity[-1]), (1.0, 1000.0))
        self.assertLess(abs(velocity[4] / velocity[3] - 10**0.25), 1e-12, "axes are at equal ratios")
        # The part of the imposed displacement V t that is not plastic slip is elastic: sqrt(3) integral(ep) = V t - h s / G0.
        elastic = THICKNESS_M * made.of["shear_stress_pa"] / (made.shear_modulus * made.of["velocity_jump_m_per_s"] * made.of["time_s"])
        self.assertLess(np.abs(made.of["slip_share"] - (1.0 - elastic)).max(), 1e-8, "what is not carried is elastic")
        np.testing.assert_array_equal(made.of["regime"] == STICK, made.of["slip_share"] == 0.0, "a layer that sticks carries no slip")
        self.check_sticking_line(made)
        # The limiting velocity is proportional to s/t. It falls a little less than 1/t does, because s rises as the layer hardens.
        line = made.line("domain_limit_m_per_s")
        self.assertTrue(np.isfinite(line[:-1]).all(), line)
        for k in range(1, len(line)):
            falls = line[k - 1] / line[k] / (made.times[k] / made.times[k - 1])
            falls = falls[np.isfinite(falls)]
            self.assertTrue(((falls > 0.5) & (falls < 1.05)).all(), falls)
        # Faster melts earlier, and the line falls with time.
        melting = made.of["melting_time_s"][-1]
        slower, faster = melting[:, :-1], melting[:, 1:]
        both = np.isfinite(slower)
        self.assertTrue(both.sum() > 4 and (faster[both] <= slower[both]).all(), melting)
        line = made.line("melting_above_m_per_s")
        self.assertTrue((line[2] < line[1]).all(), line)

    def check_sticking_line(self, made):
        """The layer yields when the elastic stress G0 V t / h reaches the flow stress at the pressure and 300 K, divided by
        sqrt(3). The tolerance is 15 % because that is of a layer that has not hardened: in the map it has hardened a little at the
        lowest velocity at which it flows."""
        with shearbus.open(made.json["effective_scene"], [0]) as session:
            flow_stress = [np.nanmax(session.profiles([0], pressure=pressure).layer_flow_stress) for pressure in made.json["pressure_pa"]]
        line, drawn = made.line("sticking_below_m_per_s"), 0
        for time, velocities in zip(made.times, line):
            for found, stress in zip(velocities, flow_stress):
                expected = THICKNESS_M * stress / math.sqrt(3.0) / (made.shear_modulus * time)
                self.assertEqual(math.isnan(found), expected <= 1.0, (time, found, expected))
                if not math.isnan(found):
                    drawn += 1
                    self.assertLess(abs(found / expected - 1.0), 0.15, (time, found, expected))
        self.assertGreaterEqual(drawn, 8)

    def test_the_catalog_is_printed(self):
        self.assertIn("tantalum\n  strength: Steinberg", self.run_program(OPTIONS.ctl, "materials").stdout)
        one = self.run_program(OPTIONS.ctl, "materials", "copper_ofhc_jc").stdout
        self.assertTrue('flow_law = "johnson_cook"' in one and "hardening_modulus_pa = 292000000" in one, one)
        self.assertNotIn("hardening_coefficient", one, "only its own law's constants")
        self.refused(OPTIONS.ctl, "materials", "coper_ofhc", said='did you mean "copper_ofhc"')


if __name__ == "__main__":
    served.main()
