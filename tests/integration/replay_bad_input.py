"""Bad input to shearbus-replay: exit code 1 (2 for the command line), one line that names the fault, and no file left."""
import signal
import subprocess

import numpy as np
from replay_support import EXAMPLES, ReplayTest, force_history, served, velocity_history
from served import OPTIONS

FORCE = EXAMPLES / "force_driven.toml"


def with_value(array, place, value):
    changed = np.array(array, dtype=np.float64)
    changed[place] = value
    return changed


class BadInput(ReplayTest):
    def assert_refused(self, *texts, code=1, **options):
        before = {p.name for p in self.path.iterdir()}
        run = self.replay(**options)
        self.assertEqual(run.returncode, code, run.stdout + run.stderr)
        for text in texts:
            self.assertIn(text, run.stderr)
        self.assertEqual({p.name for p in self.path.iterdir()}, before, "a file was left behind")
        return run

    def refused_history(self, texts, parts, **options):
        self.write(**parts)
        self.assert_refused(*([texts] if isinstance(texts, str) else texts), **options)

    def test_missing_dataset(self):
        self.refused_history("no dataset /time", velocity_history(time=None))
        self.refused_history("no dataset /node_id", velocity_history(node_id=None))
        self.refused_history("/pressure [T,N]", velocity_history(pressure=None))
        self.refused_history("/velocity_jump [T,N]", velocity_history(velocity_jump=None))

    def test_force_driven_needs_are_all_listed(self):
        self.refused_history(["/stress_hard [T,N]", "/mass_soft [N]", "force_driven"],
                             force_history(stress_hard=None, mass_soft=None), scene=FORCE)
        self.refused_history("/velocity_jump [T,N] (as recorded) or /initial_velocity_jump [N] (closed loop)",
                             force_history(initial_velocity_jump=None), scene=FORCE)

    def test_history_of_the_other_strategy(self):
        self.refused_history("looks like one for strategy force_driven", force_history())
        self.refused_history("looks like one for strategy velocity_driven", velocity_history(), scene=FORCE)

    def test_closed_loop_of_a_velocity_driven_scene(self):
        self.write(**velocity_history())
        run = self.replay("--closed-loop")
        self.assertEqual(run.returncode, 1)
        self.assertIn("force_driven", run.stderr)

    def test_not_finite_is_named_by_step_and_node(self):
        pressure = velocity_history()["pressure"]
        self.refused_history(["/pressure[3, 1]", "node 11", "nan"], velocity_history(pressure=with_value(pressure, (3, 1), np.nan)))
        self.refused_history(["/velocity_jump[0, 2]", "inf"],
                             velocity_history(velocity_jump=with_value(pressure, (0, 2), -np.inf)))
        self.refused_history("/initial_temperature[1]", velocity_history(initial_temperature=np.array([300, np.nan, 300])))
        self.refused_history("/mass_hard[0]", force_history(mass_hard=np.array([np.nan, 1, 1])), scene=FORCE)

    def test_values_physics_refuses_name_step_and_node(self):
        self.refused_history(["mass_soft", "11"], force_history(mass_soft=np.array([1.0, -1.0, 1.0])), scene=FORCE)
        self.refused_history(["temperature", "12"], velocity_history(initial_temperature=np.array([300.0, 300.0, -5.0])))
        self.refused_history("temperature", velocity_history(initial_temperature=np.array([300.0, 5000.0, 300.0])))

    def test_scene_faults_have_a_place(self):
        self.write(**velocity_history())
        scene = self.path / "scene.toml"
        text = (EXAMPLES / "paper_velocity_driven_graded.toml").read_text()
        scene.write_text(text.replace("cells = 30", "cels = 30"))
        line = next(i for i, t in enumerate(scene.read_text().splitlines(), 1) if t.startswith("cels"))
        self.assert_refused(f"scene.toml:{line}:", "cells", scene=scene)
        scene.write_text(text.replace('"aluminium_dlp"', '"unobtainium"'))  # only the server knows the catalog
        line = next(i for i, t in enumerate(scene.read_text().splitlines(), 1) if "unobtainium" in t)
        self.assert_refused(f"scene.toml:{line}:", "unobtainium", scene=scene)
        self.assert_refused("absent.toml", scene=self.path / "absent.toml")

    def test_check_finds_what_only_reading_every_value_finds(self):
        parts = velocity_history(steps=500)
        self.write(**(parts | {"pressure": with_value(parts["pressure"], (499, 2), np.nan)}))
        run = self.replay("--check", out=False)
        self.assertEqual(run.returncode, 1)
        self.assertIn("/pressure[499, 2]", run.stderr)

    def test_result_in_a_directory_that_is_not_there(self):
        self.write(**velocity_history())
        self.out = self.path / "absent" / "result.h5"
        self.assert_refused("no directory")

    def test_an_older_result_survives_a_run_that_fails(self):
        self.write(**velocity_history())
        self.result()
        older = self.out.read_bytes()
        self.write(**velocity_history(pressure=with_value(velocity_history()["pressure"], (4, 0), np.nan)))
        self.assert_refused("/pressure[4, 0]")
        self.assertEqual(self.out.read_bytes(), older)

    def test_server_that_is_not_there(self):
        self.write(**velocity_history())
        run = self.replay("--server", f"ipc://{self.path}/nobody")
        self.assertEqual(run.returncode, 1)
        self.assertIn("nobody", run.stderr)
        self.assertFalse(self.out.exists())

    def test_stopped_run_leaves_nothing(self):
        self.example("constant", "--steps", "2000000")
        run = served.program(self, OPTIONS.replay, self.history, "--scene", EXAMPLES / "paper_velocity_driven.toml", "--out", self.out,
                             stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        served.until(self, lambda: list(self.path.glob("result.h5.*partial")), run)
        run.send_signal(signal.SIGINT)
        _, errors = run.communicate(timeout=60)
        self.assertEqual(run.returncode, 1)
        self.assertIn("interrupted", errors)
        self.assertEqual([p.name for p in self.path.iterdir()], ["history.h5"])


if __name__ == "__main__":
    served.main()
