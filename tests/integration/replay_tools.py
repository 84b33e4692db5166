"""What an experimenter does with shearbus-replay: CSV tables, points and steps, what-if, comparison, export, pictures."""
import json
import os
import re
import resource
import struct
import sys

import h5py
import numpy as np
import replay_support as support
import served
from replay_support import EXAMPLES, velocity_history

sys.dont_write_bytecode = True
import shearbus

GRADED = EXAMPLES / "paper_velocity_driven_graded.toml"
# Eight irregular points of an experiment, in us, GPa and m/s with decimal commas.
POINTS = [(0, 11.2, 100), (0.1, 11.2, 100), (0.25, 11.0, 98), (0.3, 10.5, 95), (0.5, 9.8, 90), (0.62, 9.1, 80), (0.8, 8.0, 60),
          (1.0, 7.5, 50)]


class Tool(support.ReplayTest):
    def tool(self, *arguments, code=0):
        return super().tool("replay", *arguments, code=code)

    def csv(self, text, name="shot.csv"):
        file = self.path / name
        file.write_text(text, encoding="utf-8")
        return file

    def points(self):
        rows = "".join(f"{t};{p};{v}\n".replace(".", ",") for t, p, v in POINTS)
        return self.csv("\ufeff# shot 12\r\ntime [µs];pressure_GPa;velocity_jump [m/s]\r\n" + rows)

    def read(self, path=None):
        with h5py.File(path or self.out) as file:
            return {name: file[name][()] for name in file if name != "meta"}


class Units(Tool):
    def played(self, *arguments, **changes):
        """Replays a history with changes. Returns what was printed, and the warnings."""
        self.write(**velocity_history(**{"steps": 40, **changes}))
        run = self.replay(*arguments)
        self.assertEqual(run.returncode, 0, run.stderr)
        return run.stdout, [line for line in run.stderr.splitlines() if "warning" in line]

    def test_inputs_in_other_units_draw_the_warnings_of_sessions(self):
        out, warnings = self.played()
        self.assertEqual(warnings, [])
        self.assertIn("inputs                      P 1.12e+10 Pa; [V] 100 m/s; dt 1e-09 s", out)
        for pascals in (11.2, 11.2e3, 112e3):
            with self.subTest(pascals):
                out, warnings = self.played(pressure=np.full((40, 3), pascals) * np.array([1.0, 0.5, 0.0]))
                (warning,) = warnings
                self.assertIn("shearbus-replay: warning: pressure_pa: the highest pressure of the first", warning)
                self.assertIn("11.2 GPa", warning)
                self.assertIn(f"P 0 to {pascals:.6g} Pa", out)
        out, (warning,) = self.played(pressure=np.full((40, 3), -11.2e9))
        self.assertIn("no node was ever in contact in 40 steps; lowest pressure -1.12e+10 Pa", warning)
        _, warnings = self.played(time=1e-3 * np.arange(1, 41))
        self.assertIn("shearbus-replay: warning: dt_s: the first step is 0.001 s long", warnings[0])

    def test_the_json_summary_has_the_ranges(self):
        out, _ = self.played("--json", velocity_jump=np.linspace(-3.0, 100.0, 120).reshape(40, 3))
        self.assertEqual(json.loads(out)["inputs"]["velocity_jump_m_per_s"], {"lowest": -3.0, "highest": 100.0})
        self.assertEqual(json.loads(out)["inputs"]["pressure_pa"], {"lowest": 11.2e9, "highest": 11.2e9})


class Tables(Tool):
    def test_points_and_steps_are_an_explicit_choice(self):
        points = self.points()
        text = self.tool(points, "--scene", GRADED, "--out", self.out, code=1)
        self.assertIn("does not tell whether its rows are points or steps", text)
        self.assertIn("--points", text)
        self.assertFalse(self.out.exists())
        text = self.tool(points, "--scene", GRADED, "--out", self.out, "--points", "--dt", "1e-9")
        self.assertNotIn("too long", text)
        fine = self.read()
        self.assertEqual(len(fine["time"]), 1000)
        self.tool(points, "--scene", GRADED, "--out", self.out, "--points")
        coarse = self.read()
        np.testing.assert_allclose(coarse["time"], [1e-6 * row[0] for row in POINTS[1:]])
        self.assertLess(abs(coarse["interface_temperature"].max() / fine["interface_temperature"].max() - 1), 0.005)

    def test_points_become_the_means_of_their_steps(self):
        self.tool(self.points(), "--scene", GRADED, "--out", self.out, "--points", "--dt", "4e-8")
        found = self.read()
        time, pressure, jump = np.array(POINTS).T * [[1e-6], [1e9], [1]]
        edges = np.minimum(np.arange(26) * 4e-8, 1e-6)
        fine = np.linspace(0, 1e-6, 100_001)
        rows = velocity_history(steps=25, nodes=1, time=edges[1:], node_id=np.array([0], np.uint64))
        for name, values in (("pressure", pressure), ("velocity_jump", jump)):
            at = np.interp(fine, time, values)
            means = [np.trapz(at[i * 4000:i * 4000 + 4001], fine[i * 4000:i * 4000 + 4001]) / 4e-8 for i in range(25)]
            rows[name] = np.array(means)[:, None]
        self.write(**rows)
        expected = self.result()
        np.testing.assert_allclose(found["interface_temperature"], expected["interface_temperature"], rtol=1e-7)

    def test_steps_of_a_csv_are_those_of_the_hdf5_table(self):
        history = velocity_history(steps=6, nodes=2, pressure=np.linspace(10e9, 11e9, 12).reshape(6, 2))
        self.write(**history)
        expected = self.result()
        rows = [f"{i + 1},{node},{history['pressure'][i, j]!r},100\n" for i in range(6) for j, node in enumerate((10, 11))]
        table = self.csv("time [ns],node,pressure (Pa),velocity_jump [m/s]\n" + "".join(rows))
        self.tool(table, "--scene", GRADED, "--out", self.out, "--steps")
        found = self.read()
        for name in ("node_id", "shear_stress", "interface_temperature", "regime"):
            np.testing.assert_allclose(found[name], expected[name], rtol=1e-12, err_msg=name)
        bare = self.csv("".join(row.replace(",", "\t") for row in rows), "bare.tsv")
        columns = "time:ns,node,pressure:Pa,velocity_jump:m/s"
        self.tool(bare, "--scene", GRADED, "--out", self.out, "--steps", "--columns", columns)
        self.assertIn("equal", self.tool("compare", self.out, self.out))
        np.testing.assert_array_equal(found["shear_stress"], self.read()["shear_stress"])

    def test_points_that_are_taken_as_steps_are_not_passed_over_in_silence(self):
        time, pressure, jump = (np.array(column) for column in zip(*POINTS))
        history = velocity_history(steps=8, nodes=1, time=1e-6 * time, pressure=1e9 * pressure[:, None],
                                   velocity_jump=1.0 * jump[:, None])
        self.write(**{name: values if name == "node_id" else values[1:] for name, values in history.items()})
        run = self.replay()
        self.assertRegex(run.stderr, "the steps are too long for this history: .* node 10 reaches .* say --points")
        naive = self.read()["interface_temperature"].max()
        self.write(**history, t0=-1e-9)
        run = self.replay("--points", "--dt", "1e-9")
        self.assertNotIn("too long", run.stderr)
        points = self.read()
        self.assertEqual(len(points["time"]), 1000)
        self.assertGreater(points["interface_temperature"].max() - naive, 30.0, "the warning is about something")
        self.write(**history, t0=-1e-9)
        self.assertNotIn("too long", self.replay("--steps").stderr)

    def test_a_step_is_divided_by_dt(self):
        self.write(**velocity_history(steps=8, nodes=2, time=1.2e-8 * np.arange(1, 9)))
        run = self.replay("--dt", "1e-9")
        self.assertEqual(run.returncode, 0, run.stderr)
        divided = self.read()
        self.assertEqual(len(divided["time"]), 96)
        self.write(**velocity_history(steps=96, nodes=2))
        fine = self.result()
        np.testing.assert_allclose(divided["interface_temperature"], fine["interface_temperature"], rtol=1e-12)
        self.assertEqual(self.replay("--dt", "0").returncode, 2)
        self.assertEqual(self.replay("--dt", "nan").returncode, 2)

    def test_faults_of_a_table_are_named_with_their_line(self):
        good = "time [us],pressure [GPa],velocity_jump [m/s]\n0,11,100\n0.1,11,100\n"
        for text, words in (
            (good.replace("pressure [GPa]", "pressure"), ("pressure has no unit", "--columns pressure:Pa", "GPa")),
            (good.replace("GPa", "psi"), ('"psi"', "GPa")),
            (good.replace("0.1,11,100", "0.1,11"), ("line 3: 2 values, expected 3",)),
            (good.replace("0.1,11,", "0.1,nan,"), ('line 3: pressure is "nan"', "finite number")),
            (good.replace("0.1,11,", "0.1,1.1e,"), ('line 3: pressure is "1.1e"',)),
            (good.replace("0.1,", "0,"), ("line 3: time 0 s is not after",)),
            (good.replace("velocity_jump [m/s]", "speed [m/s]"), ("/velocity_jump [T,N]",)),
            (good.replace("pressure [GPa]", "time [s]"), ("time stands in two columns",)),
            ("", ("holds no table",)),
            ("1,2,3\n", ("the first line has no names", "--columns")),
            ("time [us];pressure [GPa];velocity_jump [m/s]\n0;1.000,5;1\n", ('"1.000,5"',)),
            ("time [us],node,pressure [GPa],velocity_jump [m/s]\n0,1,1,1\n0,2,1,1\n1,1,1,1\n", ("line 4",)),
        ):
            run = self.tool(self.csv(text), "--scene", GRADED, "--out", self.out, "--points", code=1)
            for word in words:
                self.assertIn(word, run, text)
            self.assertFalse(self.out.exists())
        run = self.tool(self.csv(good), "--scene", GRADED, "--out", self.out, "--steps", code=1)
        self.assertIn("Are the rows --points?", run)
        self.assertIn("--columns is for CSV", self.replay("--columns", "time:s", history=EXAMPLES / "sweep.py").stderr)

    def test_a_force_driven_history_keeps_its_steps(self):
        self.write(**support.force_history(initial_velocity_jump=None, velocity_jump=np.full((5, 3), 50.0)))
        run = self.replay("--dt", "1e-10", scene=EXAMPLES / "force_driven.toml")
        self.assertEqual(run.returncode, 1)
        self.assertIn("belongs to the steps that the host took", run.stderr)
        self.write(**support.force_history())
        self.assertEqual(self.replay("--dt", "5e-10", scene=EXAMPLES / "force_driven.toml").returncode, 0)
        self.assertEqual(len(self.read()["time"]), 10)


class WhatIf(Tool):
    def test_set_and_sweep_of_a_table(self):
        self.example("force_driven", "--steps", "30")
        scene = EXAMPLES / "force_driven.toml"
        text = scene.read_text()
        self.assertEqual(text.count("friction_coefficient = "), 1)
        line = next(line for line in text.splitlines() if line.startswith("friction_coefficient = "))
        (self.path / "edited.toml").write_text(text.replace(line, "friction_coefficient = 0.002"))
        expected = self.result(scene=self.path / "edited.toml")
        changed = self.path / "changed.h5"  # the history behind --set is no second value of it
        self.tool("--scene", scene, "--set", "interface.friction_coefficient=0.002", self.history, "--out", changed)
        np.testing.assert_array_equal(expected["shear_stress"], self.read(changed)["shear_stress"])
        self.tool(self.history, "--scene", scene, "--out", self.path / "mu.h5", "--sweep",
                  "interface.friction_coefficient=0.001,0.002,0.1")
        self.assertEqual(sorted(p.name for p in self.path.glob("mu*")), ["mu-0.001.h5", "mu-0.002.h5", "mu-0.1.h5"])
        self.assertIn("equal: 30 steps", self.tool("compare", self.out, self.path / "mu-0.002.h5"))
        self.assertRegex(self.tool("compare", self.out, self.path / "mu-0.1.h5", code=1),
                         r"^step \d+ \(ends at .* s\): \w+ of node \d+ is \S+ in result.h5, \S+ in mu-0.1.h5 \(\d+ of \d+ values")
        for change, word in (("interface.friction=0.1", "did you mean"), ("friction", "sets no key"),
                             ("interface.friction_coefficient=x", "expected a number")):
            run = self.replay("--set", change, scene=scene)
            self.assertEqual(run.returncode, 1)
            self.assertIn(word, run.stderr)
        # All values of a sweep are checked before the first is replayed.
        for key, values, wrong, word in (("interface.friction_coefficient", "0.3,x", "x", "expected a number"),
                                         ("interface.friction", "0.3,0.4", "0.3", "did you mean")):
            said = self.tool(self.history, "--scene", scene, "--out", self.path / "late.h5", "--sweep", f"{key}={values}", code=1)
            self.assertRegex(said, f"--sweep {key}={wrong}: .*{word}")
            self.assertEqual(list(self.path.glob("late*")), [])

    def test_compare_with_a_tolerance_tells_the_largest_difference_of_each_column_and_where(self):
        self.write(**velocity_history(steps=40))
        self.result()
        self.tool(self.history, "--scene", GRADED, "--set", "soft.yield_strength_pa=150e6", "--out", self.path / "other.h5")
        text = self.tool("compare", self.out, self.path / "other.h5", "--rtol", "1e-3", code=1)
        with h5py.File(self.out) as a, h5py.File(self.path / "other.h5") as b:
            for name in ("shear_stress", "interface_temperature"):
                differing = ~np.isclose(a[name], b[name], rtol=0, atol=0) & (np.abs(a[name][:] - b[name][:]) > 1e-3 * np.maximum(np.abs(a[name]), np.abs(b[name])))
                self.assertTrue(differing.any())
                far = np.where(differing, np.abs(a[name][:] - b[name][:]), 0.0)
                step, row = np.unravel_index(far.argmax(), far.shape)
                found = re.search(rf"^{name}: (\d+) of (\d+) values differ; largest difference (\S+) .*at node (\d+), step (\d+) \(ends at (\S+) s\)", text, re.M)
                self.assertIsNotNone(found, text)
                self.assertEqual([int(found[i]) for i in (1, 2, 4, 5)], [differing.sum(), differing.size, a["node_id"][row], step])
                self.assertAlmostEqual(float(found[3]) / far.max(), 1.0, places=5)
                self.assertAlmostEqual(float(found[6]), a["time"][step], places=15)
        self.assertIn("different within 0.001", text)

    def test_compare_has_the_exit_codes_of_diff(self):
        self.write(**velocity_history(steps=4))
        self.result()
        other = self.path / "other.h5"
        other.write_bytes(self.out.read_bytes())
        with h5py.File(other, "r+") as file:
            value = file["shear_stress"][2, 1]
            file["shear_stress"][2, 1] = np.nextafter(value, 0)
            file["interface_temperature"][3, 0] *= 1 + 1e-9
        text = self.tool("compare", self.out, other, code=1)
        self.assertRegex(text, r"step 2 \(ends at 3\S*e-09 s\): shear_stress of node 11 is .* \(1 of \d+ values of the step differ\)")
        self.assertRegex(self.tool("compare", self.out, other, "--rtol", "1e-12", code=1), "interface_temperature: 1 of .* at node 10, step")
        self.assertIn("equal", self.tool("compare", self.out, other, "--rtol", "1e-8"))
        self.assertIn("no such file", self.tool("compare", self.out, self.path / "none.h5", code=2))
        self.tool("compare", self.out, code=2)


class Logs(Tool):
    """What becomes of an event log that a host left."""

    def setUp(self):
        super().setUp()
        self.log = self.path / "host.log"
        os.environ["SHEARBUS_RECORD"] = str(self.log)
        self.addCleanup(os.environ.pop, "SHEARBUS_RECORD")
        self.server = served.Server(self, self.path, durable=False)

    def host(self, scene=EXAMPLES / "force_driven.toml", steps=20, nodes=(4, 9, 2), drop_trial=True):
        """A closed loop with a rejected trial in each third step, a mark, and a rollback to it."""
        count = len(nodes)
        mass = {"mass_soft": 2.7, "mass_hard": 7.9}
        jump, rows, marked = np.linspace(40.0, 90.0, count), [], None
        with shearbus.open(scene, nodes, self.server.endpoint, initial_temperature=np.linspace(300.0, 330.0, count)) as bus:
            for step in range(steps):
                values = dict(jump=jump, pressure=2e9, stress_soft=1e6, stress_hard=-2e6, **mass)
                if step % 3 == 1 and drop_trial:
                    with bus.trial(2e-9, **values) as trial:
                        trial.reject()
                answer = bus.step(1e-9, time=1e-9 * (len(rows) + 1), **values)
                rows.append((jump, answer.stress, answer.temperature))
                jump = answer.jump_new.copy()
                if step == 9:
                    bus.mark("dump")
                    marked = len(rows), jump
                if step == 14:
                    bus.rollback_to("dump")
                    rows, jump = rows[:marked[0]], marked[1]
        return rows

    def test_export_gives_the_table_that_replays_to_the_same_bits(self):
        rows = self.host()
        self.assertIn("15 steps", self.tool("export", self.log, "--out", self.history))
        with h5py.File(self.history) as file:
            np.testing.assert_array_equal(file["node_id"], [4, 9, 2])
            np.testing.assert_array_equal(file["velocity_jump"], [row[0] for row in rows])
            np.testing.assert_array_equal(file["shear_stress"], [row[1] for row in rows])
            np.testing.assert_array_equal(file["mass_soft"], [2.7] * 3)
            self.assertEqual(file["meta"].attrs["times"], "the host's")
        result = self.result(scene=EXAMPLES / "force_driven.toml")
        np.testing.assert_array_equal(result["interface_temperature"], [row[2] for row in rows])
        self.assertIn("equal: 15 steps", self.tool("compare", self.history, self.out))
        table = self.path / "table.csv"
        self.tool("export", self.log, "--out", table)
        self.tool(table, "--scene", EXAMPLES / "force_driven.toml", "--out", self.path / "of_csv.h5", "--steps")
        np.testing.assert_array_equal(self.read(self.path / "of_csv.h5")["interface_temperature"], [row[2] for row in rows])
        self.tool("export", self.log, "--out", self.path / "one.h5", "--node", 9)
        np.testing.assert_array_equal(self.read(self.path / "one.h5")["shear_stress"][:, 0], [row[1][1] for row in rows])
        self.assertIn("no committed step of node 5",
                      self.tool("export", self.log, "--out", self.path / "x.h5", "--node", 5, code=1))

    def test_a_table_of_nodes_that_change_is_refused_and_one_node_is_exported(self):
        with shearbus.open(GRADED, [1, 2], self.server.endpoint) as bus:
            bus.step(1e-9, jump=50.0, pressure=11.2e9)
            first = bus.step(1e-9, nodes=[2], jump=50.0, pressure=11.2e9)
            bus.register([3])
            bus.step(1e-9, jump=50.0, pressure=11.2e9)
        text = self.tool("export", self.log, "--out", self.history, code=1)
        self.assertIn("the nodes of the steps change", text)
        self.assertIn("--node ID", text)
        self.tool("export", self.log, "--out", self.history, "--node", 2)
        one = self.read(self.history)
        self.assertEqual(one["shear_stress"].shape, (3, 1))
        self.assertEqual(one["shear_stress"][1, 0], first.stress[0])
        self.tool("export", self.log, "--out", self.history, "--node", 3)
        self.assertEqual(self.read(self.history)["time"].shape, (1,))

    def test_a_log_has_the_ranges_and_the_warnings_of_a_history(self):
        with shearbus.open(GRADED, [1, 2], self.server.endpoint) as bus:
            for _ in range(20):
                bus.step(1e-9, jump=[50.0, 60.0], pressure=[11.2e3, 5e3])
        text = self.tool(self.log)
        self.assertIn("inputs                      P 5000 to 11200 Pa; [V] 50 to 60 m/s; dt 1e-09 s", text)
        self.assertEqual(text.count("warning: "), 1)
        self.assertIn("as MPa it would be 11.2 GPa", text)
        self.log.unlink()
        self.host()
        self.assertNotIn("warning: ", self.tool(self.log))

    def test_another_scene_gives_another_log_that_stands_for_itself(self):
        self.host()
        other = self.path / "other.log"
        self.tool(self.log, "--set", "interface.friction_coefficient=0.02", "--out", other)
        self.assertIn("equal to the recorded ones", self.tool(other))
        text = self.tool("compare", self.log, other, code=1)
        self.assertRegex(text, r"step 0 \(request 1, ends at 1e-09 s\): answer, \w+ of node 4 is ")
        self.assertIn("exists", self.tool(self.log, "--out", other, code=1))
        self.tool(self.log, "--sweep", "interface.friction_coefficient=0.02,0.3", "--out", self.out)
        self.assertIn("--sweep interface.friction_coefficient=x: ",
                      self.tool(self.log, "--sweep", "interface.friction_coefficient=0.4,x", "--out", self.out, code=1))
        self.assertFalse((self.path / "result-0.4.h5").exists())
        self.tool("export", other, "--out", self.history)
        self.assertIn("equal: 15 steps", self.tool("compare", self.history, self.path / "result-0.02.h5"))
        self.assertEqual(sorted(p.name for p in self.path.glob("*partial*")), [])

    def test_a_branch_begins_with_the_states_of_its_mark(self):
        rows = self.host(drop_trial=False)
        self.tool(self.log, "--from-mark", "dump", "--out", self.out)
        branch = self.read()
        np.testing.assert_array_equal(branch["interface_temperature"], [row[2] for row in rows[10:]])
        changed = self.path / "changed.h5"
        self.tool(self.log, "--from-mark", "dump", "--set", "interface.friction_coefficient=0.01", "--out", changed)
        first, other = branch["interface_temperature"][0], self.read(changed)["interface_temperature"][0]
        before = np.array(rows[9][2])
        self.assertTrue(np.all(other < first) and np.all(np.abs(other - before) < 20.0), "from the mark's states, with less heat")
        whole = self.path / "whole.h5"
        self.tool(self.log, "--set", "interface.friction_coefficient=0.01", "--out", whole)
        self.assertTrue(np.all(self.read(whole)["interface_temperature"][10] < other), "the whole run had less heat before")
        for arguments, words in ((("--from-mark", "none"), 'no mark "none"; it has dump'),
                                 (("--from-mark", "dump", "--set", "layer.cells=10"), "only keys of [interface]"),
                                 (("--from-mark", "dump", "--set", "interface.plastic_layer=true"), "other states"),
                                 (("--from-mark", "dump", "--set", "interface.friction_coefficient=0.01", "--server",
                                   self.server.endpoint), "Leave --server out")):
            self.assertIn(words, self.tool(self.log, *arguments, "--out", self.path / "x.h5", code=1))

    def test_the_summary_as_json_has_the_numbers_of_the_result_and_its_origin(self):
        self.write(**velocity_history(steps=50))
        summary = json.loads(self.result("--json")["text"])
        self.assertEqual(summary["provenance"]["program"], "shearbus-replay")
        self.assertEqual(summary["provenance"]["scene"], summary["scene"])
        self.assertIn("--json", summary["provenance"]["command"])
        with h5py.File(self.out) as file:
            temperature, regime = file["interface_temperature"][()], file["regime"][()]
            slip = (np.abs(file["sliding_velocity"][()]) * file["dt"][()][:, None]).sum(axis=0)
            self.assertEqual(file["meta"].attrs["commit"], summary["provenance"]["commit"])
            self.assertEqual(file["meta"].attrs["command"], summary["provenance"]["command"])
        self.assertEqual(summary["peak_interface_temperature_k"], temperature.max())
        self.assertEqual((summary["steps"], summary["nodes"], summary["node_steps"]), (50, 3, 150))
        np.testing.assert_allclose(summary["slip_distance_longest_m"], slip.max(), rtol=1e-12)
        np.testing.assert_array_equal(list(summary["node_step_share"].values()), np.bincount(regime.ravel(), minlength=5) / 150)
        self.assertEqual(summary["failed_node_steps"], 0)

    def test_pictures_of_a_log_and_of_a_history_with_its_result(self):
        self.host()
        picture = self.path / "picture.png"
        self.tool("plot", self.log, "--out", picture, "--node", 9)
        self.check_picture(picture)
        picture.unlink()
        self.tool("export", self.log, "--out", self.history)
        self.replay(scene=EXAMPLES / "force_driven.toml")
        self.tool("plot", self.out, self.history, "--out", picture)
        self.check_picture(picture)
        self.assertIn("has no node 5", self.tool("plot", self.out, "--out", picture, "--node", 5, code=1))
        self.assertIn("expected a picture's name that ends in .png", self.tool("plot", self.out, "--out", self.path / "p.docx", code=2))
        self.assertFalse((self.path / "p.docx").exists())
        (self.path / "empty").mkdir()
        said = self.tool(self.path / "empty", code=1)
        self.assertIn(f"{self.path}/empty: expected event logs in the directory, found none", said)

    def check_picture(self, picture):
        data = picture.read_bytes()
        self.assertEqual(data[:8], b"\x89PNG\r\n\x1a\n")
        width, height = struct.unpack(">II", data[16:24])
        self.assertTrue(width > 600 and height > 600)

    def test_a_replay_is_not_slower_than_the_recorded_run(self):
        with shearbus.open(GRADED, range(800), self.server.endpoint) as bus:
            service = sum(bus.step(1e-9, jump=np.full(800, 80.0), pressure=11.2e9).service_s for _ in range(1000))
        spent = []
        for _ in range(3):
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            text = self.tool(self.log)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            spent.append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
        print(f"1000 steps of 800 nodes: the server took {service:.3f} s to answer, the program that replays them {min(spent):.3f} s "
              f"of processor; it says{text.split('run time')[1].splitlines()[0]}")
        self.assertLess(min(spent), 1.5 * service)  # with its start; the processor's time, since other programs run


if __name__ == "__main__":
    served.main()
