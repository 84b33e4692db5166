"""Tests of shearbus-study mesh: the table and the picture of a coupled answer on meshes that halve, and its faults in one line."""
import argparse
import json
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

OPTIONS = None


def mesh(*arguments):
    return subprocess.run([OPTIONS.study, "mesh", *map(str, arguments)], capture_output=True, text=True, timeout=280)


class Mesh(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.out = pathlib.Path(scratch.name)
        text = pathlib.Path(OPTIONS.problems, "cone_al_steel.toml").read_text()
        self.scene = self.out / "short.toml"
        self.scene.write_text(re.sub(r"(?m)^end_time_s = \S+", "end_time_s = 4e-6", text))

    def test_errors_are_those_of_the_runs(self):
        done = mesh(self.scene, "--meshes", "2e-3,1e-3", "--out", self.out / "study")
        self.assertEqual(done.returncode, 0, done.stderr)
        found = json.loads((self.out / "study/mesh.json").read_text())
        self.assertTrue((self.out / "study/mesh.png").exists())
        self.assertEqual([row["answer"] for row in found["rows"]], ["displacement_1mm", "displacement_0.5mm", "slip", "impulse", "free_surface"])
        for zone, made in zip(found["zones_m"], found["runs"]):
            directory = self.out / f"study/{zone * 1e3:g}mm"
            self.assertIn(f"first_zone_m = {zone:g}", (directory / "scene.toml").read_text())
            summary = json.loads((directory / "run/summary.json").read_text())
            self.assertEqual(made["answers"]["slip"], summary["mean_slip_m"])
            self.assertGreater(made["cpu_s"], 0.0)
        for row in found["rows"]:
            coarse, fine = row["values"]
            self.assertAlmostEqual(row["extrapolated"], 2 * fine - coarse, delta=1e-9 * abs(fine))
            self.assertNotEqual(row["error_dt"], 0.0, "half the Courant number changes every answer")
            self.assertIsNotNone(row["error_layer"])
        self.assertRegex(done.stdout, r"\| friction impulse, Pa s \| [\d.]+ \| [\d.]+ \| [\d.]+ \(1\.0\)")

    def test_faults_are_one_line(self):
        for arguments, said in (((self.scene, "--meshes", "1e-3"), r"--meshes 0.001: expected at least two widths"),
                                ((self.scene, "--meshes", "1e-3,0.3e-3"), "expected at least two widths of zones that halve"),
                                ((pathlib.Path(OPTIONS.problems, "two_half_spaces.toml"),), "expected a cone"),
                                ((self.out / "none.toml",), "No such file")):
            done = mesh(*arguments)
            self.assertEqual(done.returncode, 1)
            self.assertRegex(done.stderr, r"^shearbus-study: mesh: [^\n]*\n$")
            self.assertIn(said, done.stderr)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--study", required=True)
    parser.add_argument("--problems", required=True)
    OPTIONS, rest = parser.parse_known_args()
    unittest.main(argv=[sys.argv[0], *rest])
