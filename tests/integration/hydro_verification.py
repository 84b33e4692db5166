"""Runs every scene of problems/verification as a user does, and the same problems in other symmetries, on other meshes and to other times. They
end with their exact values, within the bounds below, and errors fall with the width of the zones. tests/convergence/hydro2d_exact.cpp holds the
exact values to published ones."""
import json
import pathlib
import re
import sys

import h5py

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import OPTIONS, PROBLEMS

# scene -> {quantity: bound of its error}. An error is relative where the exact value is not 0. A bound is one number, or the least and the
# greatest error.
BOUNDS = {
    "piston": {"stress behind both waves": 1e-3, "elastic limit": 1e-2, "mean error of the stress": 0.02},
    "flyer_on_aluminium": {"velocity of the struck face": 1e-3, "stress behind the shock": 1e-3},
    "flyer_on_steel": {"velocity of the struck face": 1e-3, "stress behind the shock": 1e-3},
    "imploding_cylinder": {"inner radius at rest": 5e-3, "spread of the inner radius": 1e-12},
    "imploding_sphere": {"inner radius at rest": 3e-3, "spread of the inner radius": 1e-3},
    "noh": {"mean density behind the shock": 0.17, "radius of the shock": 0.075},
    "sedov": {"radius of the shock": 0.015, "spread of the front": 0.025, "largest density": (-1 / 6, 0.05)},
    "saltzman": {"mean density behind the shock": 0.01, "mean error of the density": 0.08},
    "sliding_half_spaces": {"velocity jump": 1.6e-3, "velocity of the soft plate's face": 2e-3},
    "rotated_sliding": {"velocity jump": 2e-3, "velocity of the soft plate's face": 2e-3},
    "finite_plate": {"velocity of the soft plate's face": 3e-3},
    "oblique_free_slip": {"velocity jump": 1e-6},
    "patch_test": {"largest velocity": 1e-8, "pressure on the line": 1e-9},
    "taylor_bar": {"length": 0.0116, "radius of the foot": 0.027},
}
SYMMETRIES = ("plane", "axisymmetric")
# Changes of a scene, and the bounds that hold then.
CHANGED = [
    ("sedov", {"symmetry": "plane"}, BOUNDS["sedov"]),
    *((f"flyer_on_{target}", {"symmetry": "axisymmetric"}, {"velocity of the struck face": 2e-3, "stress behind the shock": 2e-3})
      for target in ("aluminium", "steel")),
    *(("imploding_cylinder", {"symmetry": symmetry, "stop_radius_m": stop, "zones": zones}, {"inner radius at rest": bound})
      for symmetry in SYMMETRIES for stop in (50e-3, 45e-3) for zones, bound in ((10, 0.01), (20, 5e-3))),
    ("imploding_sphere", {"zones": 8}, {"inner radius at rest": 0.02, "spread of the inner radius": 1.8e-3}),
    ("sliding_half_spaces", {"end_time_s": 50e-9}, {"velocity jump": 1.6e-3}),
    ("sliding_half_spaces", {"end_time_s": 50e-9, "zone_width_m": 40e-6}, {"velocity jump": 7.6e-3}),
    ("sliding_half_spaces", {"zone_width_m": 40e-6}, {"velocity jump": 1.6e-3}),
    ("sliding_half_spaces", {"first_zone_m": 5e-6}, BOUNDS["sliding_half_spaces"]),  # zones that are graded to the line
    ("finite_plate", {"end_time_s": 0.1565e-6}, {"velocity of the soft plate's face": 2.6e-3}),  # before the wave returns from the back
]
# Scene, changes, zones that halve, an error, the largest ratio of it to the one before, and the bounds with the thinnest zones.
REFINED = [
    *(("piston", {"symmetry": symmetry}, (100, 200, 400), "mean error of the stress", 0.6,
       {"mean error of the stress": 0.01, "stress behind both waves": 2e-4, "elastic limit": 2e-3}) for symmetry in SYMMETRIES),
    ("noh", {"symmetry": "plane"}, (20, 40), "mean error of the density", 0.65,
     {"mean error of the density": 0.12, "radius of the shock": 0.075, "mean density behind the shock": 0.09}),
    ("noh", {}, (20, 40), "mean error of the density", 0.65,
     {"mean error of the density": 0.18, "radius of the shock": 0.075, "mean density behind the shock": 0.17}),
    ("saltzman", {}, (10, 20), "mean error of the density", 0.65,
     {"mean error of the density": 0.04, "mean density behind the shock": 0.01, "largest cross velocity": 0.08}),
]
# Exact values as others give them: scene, time of its end, quantity.
PUBLISHED = {("sliding_half_spaces", None, "velocity jump"): 92.184, ("finite_plate", None, "velocity of the soft plate's face"): 82.633,
             ("finite_plate", 0.1565e-6, "velocity of the soft plate's face"): 94.211}


class Verification(served.Served):
    def test_every_scene_is_listed(self):
        self.assertEqual({p.stem for p in (PROBLEMS / "verification").glob("*.toml")}, set(BOUNDS))

    def test_errors_fall_where_zones_halve(self):
        for name, changes, zones, quantity, ratio, bounds in REFINED:
            errors = [self.errors(name, {**changes, "zones": count}) for count in zones]
            for wide, thin in zip(errors, errors[1:]):
                self.assertLess(thin[quantity] / wide[quantity], ratio, (name, changes))
            self.hold(errors[-1], bounds, (name, changes))

    def test_a_bar_that_has_struck_the_wall_is_at_rest(self):
        self.errors("taylor_bar", {"zones": 5})
        with h5py.File(max((self.path / "run/fields").glob("0*.h5"))) as fields:
            self.assertLess((fields["velocity"][:]**2).sum(axis=1).mean(), 0.02 * 227**2)

    def errors(self, name, changes):
        """Returns the errors of a scene's quantities."""
        text = (PROBLEMS / f"verification/{name}.toml").read_text()
        for key, value in changes.items():  # the table of the problem is the last one
            line = f"{key} = {json.dumps(value)}"
            text, found = re.subn(rf"(?m)^{key} = \S+", line, text)
            text += "" if found else line + "\n"
        scene = self.path / "scene.toml"
        scene.write_text(text)
        done = self.run_program(OPTIONS.hydro, scene, "--out", self.path / "run", "--no-plot")
        summary = json.loads((self.path / "run/summary.json").read_text())
        self.assertLess(abs(summary["energy_residual"]), 1e-13)
        self.assertLess(abs(summary["momentum_residual"]), 1e-12)
        errors = {}
        for one in summary["comparisons"]:
            what, exact, value = one["what"], one["exact"], one["found"]
            self.assertIn(what, done.stdout)
            published = PUBLISHED.get((name, changes.get("end_time_s"), what), exact)
            self.assertLess(abs(exact - published), 2e-5 * (abs(published) or 1.0))
            errors[what] = (value - exact) / (abs(exact) or 1.0)
            print(f"{name:19} {changes} {what}: {value:.6g}, should be {exact:.6g}, error {errors[what]:.2e}")
        return errors

    def hold(self, errors, bounds, of):
        for what, bound in bounds.items():
            least, greatest = bound if isinstance(bound, tuple) else (-bound, bound)
            self.assertTrue(least < errors[what] < greatest, (of, what, errors[what], bound))


for number, (scene, changes, bounds) in enumerate([*((name, {}, bounds) for name, bounds in BOUNDS.items()), *CHANGED]):
    setattr(Verification, f"test_{number:02}_{scene}", lambda self, scene=scene, changes=changes, bounds=bounds:
            self.hold(self.errors(scene, changes), bounds, (scene, changes)))

if __name__ == "__main__":
    served.main()
