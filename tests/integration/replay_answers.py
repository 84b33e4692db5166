"""Checks the numbers of replays: the paper's velocity-driven case (tests/measured.toml, "Exact solutions"), loops, restarts."""
import re
import subprocess

import h5py
import numpy as np
from replay_support import EXAMPLES, ReplayTest, force_history, served, velocity_history
from served import OPTIONS


class PaperCase(ReplayTest):
    """The case of DLP 5.1: h = 20 um, P = 11.2 GPa, jump 100 m/s, dt = 1 ns."""

    def relative(self, found, expected, tolerance):
        self.assertLess(abs(found / expected - 1), tolerance, f"{found!r} against {expected!r}")

    def test_layer_shear_on_500_cells_to_six_digits(self):
        self.example("constant")
        result = self.result(scene=EXAMPLES / "paper_velocity_driven.toml")
        for step, temperature, stress in [(10, 398.146970801, 229.2063259e6), (100, 685.320394816, 280.5250815e6),
                                          (300, 1014.495922106, 293.2798836e6), (1000, 1218.945925353, 142.6492093e6)]:
            self.relative(result["interface_temperature"][step - 1, 0], temperature, 1e-6)
            self.relative(result["shear_stress"][step - 1, 0], stress, 1e-6)
        self.relative(result["shear_stress"][599, 0], 208.7e6, 5e-3)
        self.assertTrue(np.all(result["interface_temperature"] < 1220.0))

    def test_regimes_end_in_melting_and_the_summary_says_so(self):
        self.example("constant")
        result = self.result()
        melting = result["regime"][:, 0] == 4
        self.assertTrue(melting[-1] and not melting[0])
        self.assertIn("melting %.1f %%" % (100 * melting.mean()), result["text"])
        self.assertIn("%.3f K, node 0" % result["interface_temperature"].max(), result["text"])
        self.assertRegex(result["text"], r"layer, residuals +heat \S+ of the heat; energy -\d\.\de-04 of the work\n +more than rounding: elastic work that heats")
        slip = np.sum(np.abs(result["sliding_velocity"]) * result["dt"][:, None])
        self.assertIn("%.6g m mean" % slip, result["text"])


class Results(ReplayTest):
    def test_layout_units_legend_and_meta(self):
        self.write(**velocity_history(steps=4, nodes=2, t0=-1e-9))
        self.result()
        with h5py.File(self.out) as file:
            self.assertEqual(set(file), {"time", "dt", "node_id", "pressure", "velocity_jump", "shear_stress", "sliding_velocity",
                                         "interface_temperature", "regime", "outcome", "friction_heat", "meta"})
            with h5py.File(self.history) as history:  # the result has what was sent, so that it can be drawn alone
                for name in ("pressure", "velocity_jump"):
                    np.testing.assert_array_equal(file[name][:], history[name][:])
            units = {"time": "s", "pressure": "Pa", "velocity_jump": "m s-1", "shear_stress": "Pa", "sliding_velocity": "m s-1", "interface_temperature": "K"}
            for name, unit in units.items():
                self.assertEqual(file[name].attrs["units"].decode(), unit)
            self.assertEqual(file["time"].attrs["t0"], -1e-9)
            self.assertEqual(file["shear_stress"].shape, (4, 2))
            self.assertEqual(h5py.check_enum_dtype(file["regime"].dtype),
                             {"OPEN": 0, "STICK": 1, "COULOMB": 2, "TRESCA": 3, "MELTING": 4})
            self.assertEqual(list(file["node_id"]), [10, 11])
            meta = file["meta"]
            self.assertEqual(meta.attrs["input_file"], "history.h5")
            self.assertRegex(meta.attrs["input_hash"], "^xxh3-64:[0-9a-f]{16}$")
            self.assertTrue(meta.attrs["server_version"])
            scene = meta["scene"].asstr()[()]
            self.assertIn("paper_velocity_driven_graded", scene)
            self.assertIn("melting_temperature_k", scene)  # the result holds the effective scene, with its constants filled in

    def test_the_summary_tells_where_the_energy_went(self):
        self.example("constant", "--steps", "300")
        result = self.result()
        line = next(line for line in result["text"].splitlines() if "layer, energy" in line)
        work, soft, hard, plastic, elastic = (float(n) for n in re.findall(r"[0-9.]+(?:e[-+][0-9]+)?", line)[:5])
        with h5py.File(self.history) as file:
            jump = file["velocity_jump"][()]
        expected = (result["shear_stress"] * jump * result["dt"][:, None]).sum() / jump.shape[1]
        self.assertAlmostEqual(work / expected, 1.0, places=5)
        self.assertAlmostEqual((soft + hard) / work, 1.0, places=5)  # all work of the jump becomes heat (DLP 18)
        self.assertAlmostEqual(soft / result["friction_heat"].sum() * jump.shape[1], 1.0, places=5)
        self.assertTrue(0.9 * work < plastic < work and 0.0 < elastic < 0.01 * work)

    def test_profiles_of_chosen_nodes_and_times(self):
        self.write(**velocity_history(steps=40, nodes=3))
        plain = self.result()
        asked = self.result("--profile-nodes", "12,10", "--profile-times", "30e-9,0,10.5e-9")
        for name in ("shear_stress", "interface_temperature"):
            np.testing.assert_array_equal(asked[name], plain[name])
        with h5py.File(self.out) as file:
            group = file["profiles"]
            np.testing.assert_allclose(group["time"], np.array([1, 11, 30]) * 1e-9, rtol=1e-12)
            self.assertEqual(list(group["node_id"]), [12, 10])
            self.assertEqual(group["layer_temperature"].shape, (3, 2, group["position"].size))
            self.assertEqual({name: data.attrs["units"].decode() for name, data in group.items()}, {
                "time": "s", "node_id": "1", "pressure": "Pa", "position": "m", "width": "m", "layer_temperature": "K",
                "layer_plastic_strain": "1", "layer_flow_stress": "Pa", "layer_shear_stress": "Pa"})
            rows = [0, 10, 29]
            np.testing.assert_array_equal(group["layer_temperature"][:, :, 0], asked["interface_temperature"][rows][:, [2, 0]])
            np.testing.assert_array_equal(group["layer_shear_stress"][:, :, 0], asked["shear_stress"][rows][:, [2, 0]])
        for arguments, text in ((("--profile-nodes", "99", "--profile-times", "1e-9"), "node 99 is not of this session"),
                                (("--profile-nodes", "10", "--profile-times", "1"), "--profile-times has 1 s; expected times up to 4e-08 s"),
                                (("--profile-nodes", "10"), "--profile-times")):
            done = self.replay(*arguments)
            self.assertNotEqual(done.returncode, 0)
            self.assertIn(text, done.stderr)

    def test_open_contact_carries_no_stress_and_closes_again(self):
        self.example("ramp")
        with h5py.File(self.history) as file:
            pressure = file["pressure"][()]
            initial = file["initial_temperature"][()]
        result = self.result()
        is_open = pressure <= 0
        self.assertTrue(is_open.any() and (pressure[-1] > 0).all())
        slip = (np.abs(result["sliding_velocity"]) * result["dt"][:, None] * ~is_open).sum(axis=0).mean()
        self.assertAlmostEqual(float(re.search(r"slip distance +([0-9.e-]+) m mean", result["text"])[1]) / slip, 1.0, places=4)
        self.assertTrue(np.all(result["shear_stress"][is_open] == 0))
        self.assertTrue(np.all(result["regime"][is_open] == 0) and np.all(result["regime"][~is_open] != 0))
        self.assertTrue(np.all(result["friction_heat"][is_open] == 0))
        self.assertTrue(np.all(result["shear_stress"][-1] * np.sign([-1] * 4 + [1] * 4) > 0))  # the stress acts against the jump
        self.assertTrue(np.all(result["interface_temperature"] >= initial.min() - 1e-9))

    def test_check_reads_everything_and_writes_nothing(self):
        self.write(**velocity_history())
        run = self.replay("--check", out=False)
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertIn("5 steps of 3 nodes", run.stdout)
        self.assertEqual([p.name for p in self.path.iterdir()], ["history.h5"])

    def test_explain_tells_what_a_scene_pays_for_and_replays_nothing(self):
        self.write(**velocity_history())
        command = [OPTIONS.replay, "--scene", str(EXAMPLES / "paper_velocity_driven.toml"), "--explain"]
        run = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertRegex(run.stdout, r"off layer.inertia +would take \+\d+ B per node")
        self.assertRegex(run.stdout, r"memory +\d+ B per node; with everything on \d+ B")
        self.assertEqual(self.replay("--explain", out=False).returncode, 2, "with a history it is refused")

    def test_rates_of_the_host_drive_the_layers_that_read_them(self):
        forced, plastic = EXAMPLES / "force_driven.toml", self.path / "plastic_layer.toml"
        plastic.write_text(forced.read_text() + "\nplastic_layer = true\n")
        for column, rate, scene, history, other in (
                ("soft_shear_rate", 1e7, EXAMPLES / "interface_slip.toml", velocity_history, EXAMPLES / "paper_velocity_driven_graded.toml"),
                ("soft_plastic_strain_rate", 1e5, plastic, force_history, forced)):
            answers = []
            for parts in ({}, {column: np.zeros((5, 3))}, {column: np.full((5, 3), rate)}):
                self.write(**history(**parts))
                answers.append(self.result(scene=scene))
            without, zero, driven = answers
            np.testing.assert_array_equal(without["shear_stress"], zero["shear_stress"])
            self.assertFalse(np.array_equal(driven["sliding_velocity"], zero["sliding_velocity"]), column)
            self.assertIn(f"/{column} is not used", self.result(scene=other)["text"])


class Recorded(ReplayTest):
    """A recorded run of the hydrocode, sent again, gives the hydrocode's own answers."""

    def test_replay_of_a_coupled_run_gives_its_bits(self):
        problems = EXAMPLES.parents[1] / "hydro_stub" / "problems"
        for problem in ("two_half_spaces", "release_and_reclose", "shear_column_yields"):
            with self.subTest(problem):
                scene = problems / f"{problem}.toml"
                run = subprocess.run([OPTIONS.hydro, str(scene), "--out", str(self.path / problem), "--no-plot"],
                                     check=True, capture_output=True, text=True, timeout=240)
                self.assertNotIn("closure", run.stderr)
                recording = self.path / problem / "history.h5"
                with h5py.File(recording) as file:
                    coupled = {name: file[name][()] for name in file if name != "meta"}
                    (self.path / "effective.toml").write_text(file["meta/scene"].asstr()[()])
                again = [scene, self.path / "effective.toml"]
                if (rate := coupled.get("soft_plastic_strain_rate")) is not None:
                    again.remove(scene)  # the thickness of its layer is that of the zones
                    self.assertEqual({-1.0, 0.0, 1.0}, set(np.sign(rate * coupled["velocity_jump"]).flat), "the soft zone shears with the jump and against it")
                for text in again:
                    replayed = self.result(history=recording, scene=text)
                    for name in ("shear_stress", "sliding_velocity", "interface_temperature", "velocity_jump_new", "regime"):
                        np.testing.assert_array_equal(coupled[name], replayed[name], name)


class Loops(ReplayTest):
    scene = EXAMPLES / "force_driven.toml"

    def test_plates_slow_down_stop_and_stay(self):
        self.example("force_driven", "--steps", "1500")
        result = self.result(scene=self.scene)
        jump = result["velocity_jump_new"]
        self.assertTrue(np.all(jump >= 0) and np.all(np.diff(jump, axis=0) <= 0))
        self.assertTrue(np.all(jump[-1] == 0))  # stuck, without ringing
        self.assertTrue(np.all(result["regime"][-1] == 1))
        # Momentum balance of each step: the plates lose the momentum that the stress takes.
        slope = result["dt"][:, None] * (1 / 2.703 + 1 / 7.9)
        before = np.vstack([[25.0, 50.0, 75.0, 100.0], jump[:-1]])
        sliding = jump > 0
        np.testing.assert_allclose((before - result["shear_stress"] * slope)[sliding], jump[sliding], rtol=1e-12)

    def test_recorded_loop_gives_the_bits_of_the_closed_one(self):
        parts = force_history(steps=300, nodes=5)
        self.write(**parts)
        closed = self.result(scene=self.scene)
        self.assertIn("closed loop from /initial_velocity_jump", closed["text"])
        recorded = np.vstack([parts["initial_velocity_jump"], closed["velocity_jump_new"][:-1]])
        np.testing.assert_array_equal(closed["velocity_jump"], recorded)  # the result has the jump that was sent
        self.write(**(parts | {"initial_velocity_jump": None, "velocity_jump": recorded}))
        opened = self.result(scene=self.scene)
        self.assertIn("as recorded in /velocity_jump", opened["text"])
        again = self.result("--closed-loop", scene=self.scene)
        self.assertIn("closed loop from the first row of /velocity_jump", again["text"])
        for other in (opened, again):
            for name in ("shear_stress", "sliding_velocity", "interface_temperature", "velocity_jump_new", "regime"):
                np.testing.assert_array_equal(closed[name], other[name], name)

    def test_a_history_in_stick_form_has_the_answers_of_the_far_field_form(self):
        parts = force_history(steps=100, nodes=4)
        self.write(**parts)
        far = self.result(scene=self.scene)
        jump = np.vstack([parts["initial_velocity_jump"], far["velocity_jump_new"][:-1]])
        impedance = 1 / (1e-9 * (1 / parts["mass_soft"] + 1 / parts["mass_hard"])) * np.ones((100, 1))
        stick = {k: v for k, v in parts.items() if k in ("time", "node_id", "pressure")}
        stick |= {"impedance": impedance, "stick_stress": impedance * jump}  # the far stresses are 0
        self.write(**stick, velocity_jump=jump)
        result = self.result(scene=self.scene)
        for name in ("shear_stress", "sliding_velocity", "velocity_jump_new", "interface_temperature"):
            np.testing.assert_allclose(result[name], far[name], rtol=1e-9, atol=1e-6, err_msg=name)
        run = self.replay("--closed-loop", scene=self.scene)
        self.assertEqual(run.returncode, 1)
        self.assertIn("/stick_stress contains the jump that the host had", run.stderr)
        self.write(**stick)
        self.assertIn("/velocity_jump [T,N]", self.replay(scene=self.scene).stderr)
        self.write(**parts, stick_stress=impedance * jump, impedance=impedance)
        self.assertIn("/stick_stress and /impedance are not used", self.result(scene=self.scene)["text"])

    def test_recorded_jump_wins_where_both_are_there(self):
        parts = force_history(steps=10)
        self.write(**parts, velocity_jump=np.full((10, 3), 70.0))
        result = self.result(scene=self.scene)
        self.assertIn("/initial_velocity_jump is not used", result["text"])
        self.assertTrue(np.all(result["velocity_jump_new"][-1] == result["velocity_jump_new"][-1][0]))

    def test_slip_in_two_directions_keeps_its_components(self):
        parts = force_history(steps=100, nodes=4)
        self.write(**parts)
        line = self.result(scene=self.scene)
        turned = self.path / "plane.toml"
        turned.write_text("tangential_components = 2\n" + self.scene.read_text())
        angle = 0.6
        vectors = ("initial_velocity_jump", "stress_soft", "stress_hard")
        plane = {k: np.cos(angle) * v if k in vectors else v for k, v in parts.items()}
        self.write(**plane, **{f"{k}_second": np.sin(angle) * parts[k] for k in vectors})
        self.assertIn("/stress_soft_second is not used: the scene has tangential_components = 1", self.result(scene=self.scene)["text"])
        result = self.result(scene=turned)
        for name in ("shear_stress", "sliding_velocity", "velocity_jump_new"):
            np.testing.assert_allclose(result[name], np.cos(angle) * line[name], rtol=1e-8, atol=1e-6, err_msg=name)
            np.testing.assert_allclose(result[f"{name}_second"], np.sin(angle) * line[name], rtol=1e-8, atol=1e-6, err_msg=name)
        np.testing.assert_allclose(result["interface_temperature"], line["interface_temperature"], rtol=1e-10)


if __name__ == "__main__":
    served.main()
