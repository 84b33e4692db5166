"""Tests of shearbus-study mesh: the table and the picture of a coupled answer on meshes that halve, and its faults in one line."""
import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import OPTIONS, PROBLEMS


class Mesh(served.Served):
    def setUp(self):
        super().setUp()
        self.scene = served.edited(PROBLEMS / "cone_al_steel.toml", self.path / "short.toml", end_time_s=4e-6)

    def test_errors_are_those_of_the_runs(self):
        done = self.run_program(OPTIONS.study, "mesh", self.scene, "--meshes", "2e-3,1e-3", "--out", self.path / "study")
        found = json.loads((self.path / "study/mesh.json").read_text())
        self.assertTrue((self.path / "study/mesh.png").exists())
        self.assertEqual([row["answer"] for row in found["rows"]], ["displacement_1mm", "displacement_0.5mm", "slip", "impulse", "free_surface"])
        for zone, made in zip(found["zones_m"], found["runs"]):
            directory = self.path / f"study/{zone * 1e3:g}mm"
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
        for arguments, said in ((("--meshes", "1e-3"), "--meshes 0.001: expected at least two widths"), (("--meshes", "1e-3,0.3e-3"), "expected at least two widths of zones that halve"),
                                (("--law", "foo"), "argument --law: invalid choice: 'foo' (choose from 'subgrid', ")):
            self.refused(OPTIONS.study, "mesh", self.scene, *arguments, said=said, code=2)
        other = self.path / "mesh.json"
        other.write_text("mine")
        self.refused(OPTIONS.study, "mesh", self.scene, "--meshes", "2e-3,1e-3", "--out", self.path, said="mesh.json: is there and is not a result of shearbus-study mesh")
        self.assertEqual(other.read_text(), "mine")
        self.scene.write_text(self.scene.read_text().replace("[hydro]", "[hydro]\nzones = 1\nlaw = 2"))
        for arguments, said in (((self.scene, "--meshes", "2e-3,1e-3"), "hydro.law"), ((PROBLEMS / "two_half_spaces.toml",), "expected a cone"),
                                ((self.path / "none.toml",), "No such file")):
            self.assertRegex(self.refused(OPTIONS.study, "mesh", *arguments, said=said), r"^shearbus-study: mesh: [^\n]*\n$")


if __name__ == "__main__":
    served.main()
