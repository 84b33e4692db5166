"""Runs every scene of problems/verification as a user does. It must end with its exact values, within the bounds of the table below, which
hold for the meshes that the scenes name."""
import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import OPTIONS, PROBLEMS

# scene -> (quantity, bound of its error; relative where the exact value is not 0)
BOUNDS = {
    "piston": [("stress behind both waves", 1e-3), ("elastic limit", 1e-2), ("mean error of the stress", 0.02)],
    "flyer_on_aluminium": [("velocity of the struck face", 1e-3), ("stress behind the shock", 1e-3)],
    "flyer_on_steel": [("velocity of the struck face", 1e-3), ("stress behind the shock", 1e-3)],
    "imploding_cylinder": [("inner radius at rest", 5e-3), ("spread of the inner radius", 1e-12)],
    "imploding_sphere": [("inner radius at rest", 3e-3), ("spread of the inner radius", 1e-3)],
    "noh": [("mean density behind the shock", 0.17), ("radius of the shock", 0.075)],
    "sedov": [("radius of the shock", 0.015), ("spread of the front", 0.025)],
    "saltzman": [("mean density behind the shock", 0.01), ("mean error of the density", 0.08)],
    "sliding_half_spaces": [("velocity jump", 2e-3), ("velocity of the soft plate's face", 2e-3)],
    "rotated_sliding": [("velocity jump", 2e-3), ("velocity of the soft plate's face", 2e-3)],
    "finite_plate": [("velocity of the soft plate's face", 3e-3)],
    "oblique_free_slip": [("velocity jump", 1e-6)],
    "patch_test": [("largest velocity", 1e-8), ("pressure on the line", 1e-9)],
    "taylor_bar": [("length", 0.05), ("radius of the foot", 0.12)],
}
COARSER = {"taylor_bar": {"zones": 4}}  # a coarser mesh, so that the test takes seconds; the convergence tests refine


class Verification(served.Served):
    def test_every_scene_is_listed(self):
        self.assertEqual({p.stem for p in (PROBLEMS / "verification").glob("*.toml")}, set(BOUNDS))

    def test_zones_graded_to_the_line_slide_as_equal_ones(self):
        self.check("sliding_half_spaces", ("[hydro.sliding_plates]", "[hydro.sliding_plates]\nfirst_zone_m = 5e-6"))

    def check(self, name, change=("", "")):
        scene = served.edited(PROBLEMS / f"verification/{name}.toml", self.path / "scene.toml", **COARSER.get(name, {}))
        self.assertIn(change[0], scene.read_text())
        scene.write_text(scene.read_text().replace(*change))
        done = self.run_program(OPTIONS.hydro, scene, "--out", self.path / "run", "--no-plot")
        summary = json.loads((self.path / "run/summary.json").read_text())
        found = {c["what"]: c for c in summary["comparisons"]}
        for what, bound in BOUNDS[name]:
            exact, value = found[what]["exact"], found[what]["found"]
            error = abs(value - exact) / (abs(exact) or 1.0)
            print(f"{name:22} {what:36} {value:.6g}, should be {exact:.6g}, error {error:.2e} (bound {bound:g})")
            self.assertLess(error, bound, what)
            self.assertIn(what, done.stdout)
        self.assertLess(abs(summary["energy_residual"]), 1e-12)
        self.assertLess(abs(summary["momentum_residual"]), 1e-12)


for scene in BOUNDS:
    setattr(Verification, f"test_{scene}", lambda self, scene=scene: self.check(scene))

if __name__ == "__main__":
    served.main("hydro")
