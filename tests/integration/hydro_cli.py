"""Tests of the program shearbus-hydro: the files it writes, its messages for bad input, and its answers with a separate server."""
import datetime
import json
import pathlib
import shlex
import signal
import socket
import subprocess
import sys
import time

import h5py
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import OPTIONS, PROBLEMS

SCENE = """
name = "small"
strategy = "force_driven"
[soft]
material = "aluminium_dlp"
[hard]
material = "steel_dlp"
[layer]
thickness_m = 50e-6
cells = 40
grading = 1.1
far_boundary = "half_space"
[interface]
friction_coefficient = 0.3
yield_strength_pa = 200e6
[hydro]
end_time_s = 200e-9
[hydro.shear_column]
length_m = 1e-3
zones = 200
velocity_jump_m_per_s = [10.0, 50.0, 100.0, -100.0, 400.0]
pressure_pa = [11.2e9]
"""


class HydroTest(served.Served):
    def setUp(self):
        super().setUp()
        self.scene = self.path / "scene.toml"
        self.out = self.path / "results"
        self.scene.write_text(SCENE)

    def hydro(self, *arguments, scene=None):
        command = [OPTIONS.hydro, str(scene or self.scene), "--out", str(self.out), *map(str, arguments)]
        return subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)

    def run_well(self, *arguments, scene=None):
        run = self.hydro("--no-plot", *arguments, scene=scene)
        self.assertEqual(run.returncode, 0, run.stderr)
        with h5py.File(self.out / "history.h5") as file:
            values = {name: file[name][()] for name in file if name != "meta"}
        values["summary"] = json.loads((self.out / "summary.json").read_text())
        values["text"] = run.stdout
        return values

    def assert_refused(self, *texts, arguments=(), code=1, scene=None, left=False):
        said = self.refused(OPTIONS.hydro, scene or self.scene, "--out", self.out, "--no-plot", *arguments, code=code, said=texts)
        self.assertNotIn("terminate called", said)
        self.assertEqual((self.out / "history.h5").exists(), left)
        self.assertEqual(list(self.out.glob("*.partial")), [])

    def edited(self, old, new):
        self.assertIn(old, SCENE)
        self.scene.write_text(SCENE.replace(old, new))
        line = SCENE[:SCENE.index(old)].count("\n") + 1
        return f"scene.toml:{line}:"


class Results(HydroTest):
    def test_run_leaves_histories_summary_and_pictures(self):
        run = self.hydro()
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertEqual(run.stderr, "", "nothing but errors and warnings on stderr, no bar where there is no terminal")
        self.assertEqual({p.name for p in self.out.iterdir()}, {"history.h5", "summary.json", "histories.png"})
        for words in ("peak temperature", "0.99 T_melt", "slip distance", "stick", "friction work", "energy ledger", "run time"):
            self.assertIn(words, run.stdout)
        self.assertEqual((self.out / "histories.png").read_bytes()[:4], b"\x89PNG")
        with h5py.File(self.out / "history.h5") as file:
            self.assertEqual(file["shear_stress"].shape, (file["time"].size, 5))
            self.assertEqual(file["shear_stress"].attrs["units"], b"Pa")
            self.assertIn("melting_temperature_k", file["meta/scene"][()].decode())

    def test_results_say_where_they_come_from(self):
        values = self.run_well("--interface-law", "free_slip")
        origin = values["summary"]["provenance"]
        self.assertEqual(list(origin), ["program", "version", "commit", "scene", "date", "machine", "command"])
        self.assertEqual((origin["program"], origin["scene"], origin["machine"]), ("shearbus-hydro", values["summary"]["scene"], socket.gethostname()))
        version = json.loads(self.run_program(OPTIONS.hydro, "--version", "--json").stdout)
        self.assertEqual((origin["version"], origin["commit"]), (version["version"], version["commit"]))
        written = datetime.datetime.strptime(origin["date"], "%Y-%m-%dT%H:%M:%SZ").replace(tzinfo=datetime.timezone.utc)
        self.assertLess(abs((datetime.datetime.now(datetime.timezone.utc) - written).total_seconds()), 300)
        self.assertEqual(shlex.split(origin["command"]), ["shearbus-hydro", str(self.scene), "--out", str(self.out), "--no-plot", "--interface-law", "free_slip"])
        with h5py.File(self.out / "history.h5") as file:
            meta = {key: file["meta"].attrs[key] for key in ("producer", "commit", "machine", "command")}
        text = lambda value: value.decode() if isinstance(value, bytes) else value
        self.assertEqual({key: text(value) for key, value in meta.items()},
                         {"producer": "shearbus-hydro " + origin["version"], **{key: origin[key] for key in ("commit", "machine", "command")}})
        self.assertIn("free slip 100.0 %", values["text"])  # and not Coulomb
        self.assertNotIn("coulomb", values["summary"]["node_step_share"])

    def test_a_run_removes_what_the_one_before_left(self):
        cone = served.edited(PROBLEMS / "cone_al_steel_coarse.toml", self.path / "cone.toml", zone_width_m=1.25e-3, end_time_s=5e-6)
        files = lambda: {str(p.relative_to(self.out)) for p in self.out.rglob("*") if p.is_file() and p.name != ".lock"}
        self.assertEqual(self.hydro(scene=cone).returncode, 0)
        self.assertTrue({"cone_regime.png", "cone_pressure.png", "fields/00000.h5", "fields.xmf", "interface.h5", "free_surface.h5"} <= files())
        others = {"notes.txt", "fields/notes.txt"}
        for name in others:
            (self.out / name).write_text("mine")
        self.run_well()
        self.assertEqual(files(), others | {"history.h5", "summary.json"})
        # A run that is killed leaves no summary of the one before; one that cannot begin leaves all.
        self.assert_refused("UNREACHABLE", arguments=("--server", f"ipc://{self.path}/nobody"), left=True)
        victim = served.program(self, OPTIONS.hydro, cone, "--out", self.out, "--no-plot")
        served.until(self, (self.out / "fields.xmf").exists, victim)
        victim.kill()
        victim.wait()
        self.assertEqual({name for name in files() if not name.startswith("fields")}, {"notes.txt"})
        with h5py.File(self.out / "interface.h5", "w") as file:
            file["mine"] = 1.0
        before = files()
        self.assertIn("interface.h5: is there and is not a history of shearbus-hydro", self.hydro("--no-plot").stderr)
        self.assertEqual(files(), before)

    def test_many_columns_get_a_map_of_regimes(self):
        self.edited("[10.0, 50.0, 100.0, -100.0, 400.0]", str([10.0 * k for k in range(1, 11)]))
        self.assertEqual(self.hydro().returncode, 0)
        self.assertTrue((self.out / "regimes.png").exists())

    def test_work_is_that_of_the_slip_and_heat_that_of_the_soft_body(self):
        values = self.run_well(scene=PROBLEMS / "paper_section_6.toml")  # the layer flows, and both bodies conduct
        summary, closed = values["summary"], values["regime"] > 0
        power, jump = values["shear_stress"] * values["dt"][:, None], 0.5 * (values["velocity_jump"] + values["velocity_jump_new"])
        self.assertAlmostEqual(summary["friction_work_j_per_m2"] / (power * values["sliding_velocity"])[closed].sum(), 1.0, places=9)
        self.assertAlmostEqual(summary["interface_work_j_per_m2"] / (power * jump).sum(), 1.0, places=9)
        self.assertGreater(summary["interface_work_j_per_m2"], 2 * summary["friction_work_j_per_m2"])
        self.assertAlmostEqual(summary["heat_into_soft_body_j_per_m2"] / (summary["columns"] * summary["layer_energy"]["heat_to_soft_j_per_m2"]), 1.0, places=9)

    def test_summary_agrees_with_the_histories(self):
        values = self.run_well()
        summary = values["summary"]
        self.assertEqual(summary["peak_interface_temperature_k"], values["interface_temperature"].max())
        self.assertEqual(summary["peak_node"], 4)
        slip = (np.abs(values["sliding_velocity"]) * values["dt"][:, None]).sum(axis=0)
        np.testing.assert_allclose(summary["slip_distance_m"], slip, rtol=1e-12)
        shares = np.bincount(values["regime"].ravel(), minlength=5) / values["regime"].size
        np.testing.assert_allclose(list(summary["node_step_share"].values()), shares, atol=1e-15)
        work = (values["shear_stress"] * values["dt"][:, None] * 0.5 * (values["velocity_jump"] + values["velocity_jump_new"])).sum()
        self.assertAlmostEqual(summary["friction_work_j_per_m2"] / work, 1.0, places=9)
        self.assertAlmostEqual(summary["heat_into_soft_body_j_per_m2"] / (work * summary["heat_partition"]), 1.0, places=9)
        layer = {term: 5 * mean for term, mean in summary["layer_energy"].items()}  # reported as means of the columns
        self.assertAlmostEqual(layer["interface_work_j_per_m2"] / work, 1.0, places=9)
        self.assertAlmostEqual(layer["heat_to_soft_j_per_m2"] / summary["heat_into_soft_body_j_per_m2"], 1.0, places=9)
        self.assertLess(abs(layer["heat_residual_j_per_m2"]), 1e-9 * work)
        self.assertLess(abs(layer["energy_residual_j_per_m2"]), 1e-3 * work)  # from the steps in which columns stop
        first = [None if not m.any() else values["time"][m.argmax()]
                 for m in (values["interface_temperature"] >= summary["melting_threshold_k"]).T]
        self.assertEqual(summary["time_to_melting_threshold_s"], first)
        self.assertLess(summary["momentum_residual"], 1e-12)
        self.assertLess(summary["energy_residual"], 1e-12)

    def test_laws_differ_and_are_named(self):
        subgrid = self.run_well()
        macroscopic = self.run_well("--interface-law", "coulomb_tresca")
        self.assertEqual(subgrid["summary"]["interface_law"], "subgrid")
        self.assertEqual(macroscopic["summary"]["interface_law"], "coulomb_tresca")
        self.assertGreater(np.abs(subgrid["shear_stress"] - macroscopic["shear_stress"]).max(), 1e6)

    def test_effective_scene_gives_the_same_run(self):
        first = self.run_well()
        with h5py.File(self.out / "history.h5") as file:
            effective = self.path / "effective.toml"
            effective.write_bytes(file["meta/scene"][()])
        second = self.run_well(scene=effective)
        for name in ("time", "dt", "shear_stress", "velocity_jump_new", "interface_temperature"):
            np.testing.assert_array_equal(first[name], second[name], name)

    def test_shipped_problems_are_in_order(self):
        problems = sorted(PROBLEMS.glob("*.toml"))
        self.assertGreaterEqual(len(problems), 4)
        for problem in problems:
            self.assertIn("source", problem.read_text())
            run = self.hydro("--check", scene=problem)
            self.assertEqual(run.returncode, 0, f"{problem.name}: {run.stderr}")
            self.assertIn("in order", run.stdout)
        self.assertFalse(self.out.exists(), "--check runs nothing")

    def test_explain_tells_what_a_scene_pays_for_and_runs_nothing(self):
        run = self.hydro("--explain", scene=PROBLEMS / "cone_al_steel_coarse.toml")
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertLessEqual(max(map(len, run.stdout.splitlines())), 100)
        told = " ".join(run.stdout.split())
        self.assertRegex(told, r"off tangential_components would take \+\d+ B per node")
        self.assertRegex(told, r"off layer.inertia not in this scene: layer.inertia = true .* a layer that is rigid moves with the soft body")
        self.assertRegex(told, r"a step of 41 nodes [\d.]+ µs if all slip")
        self.assertFalse(self.out.exists(), "--explain runs nothing")

    def test_released_interface_carries_nothing_and_cools(self):
        values = self.run_well(scene=PROBLEMS / "release_and_reclose.toml")
        is_open = values["pressure"][:, 0] <= 0
        self.assertTrue(is_open.any())
        np.testing.assert_array_equal(values["shear_stress"][is_open], 0.0)
        self.assertTrue((np.diff(values["interface_temperature"][is_open], axis=0) < 0).all())
        self.assertTrue((values["regime"][is_open] == 0).all() and (values["regime"][~is_open] != 0).all())
        self.assertTrue((values["shear_stress"][-1] > 10e6).all(), "closed again, it rubs again")

    def test_plates_slide_to_a_stop_and_do_not_ring(self):
        for law in ("subgrid", "coulomb_tresca"):
            values = self.run_well("--interface-law", law, scene=PROBLEMS / "sliding_to_a_stop.toml")
            jump = values["velocity_jump_new"]
            self.assertTrue((jump[-200:] == 0.0).all(), law)
            self.assertTrue((jump[1:] * jump[:-1] >= 0.0).all(), "never from one direction to the other in one step")
            slips = jump != 0.0
            self.assertLess(np.abs(np.diff(slips.astype(int), axis=0)).sum(axis=0).max(), 12, "no chatter between stick and slip")


class ServerElsewhere(HydroTest):

    def test_nobody_at_the_endpoint(self):
        self.assert_refused("UNREACHABLE", arguments=("--server", f"ipc://{self.path}/nobody"))

    def test_one_key_of_two_is_a_faulty_command_line(self):
        self.assert_refused("--server-key and --key go together", arguments=("--key", "mine"), code=2)

    def test_endpoint_that_is_none(self):
        self.assert_refused("shearbus-hydro:", arguments=("--server", "carrier-pigeon://roof"))


class Interrupted(HydroTest):
    def test_stopped_run_leaves_no_history(self):
        self.edited("end_time_s = 200e-9", "end_time_s = 1e-3")
        run = served.program(self, OPTIONS.hydro, self.scene, "--out", self.out, "--no-plot", stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        served.until(self, lambda: list(self.out.glob("history.h5.*.partial")), run)
        time.sleep(0.2)
        run.send_signal(signal.SIGTERM)
        _, errors = run.communicate(timeout=30)
        self.assertEqual(run.returncode, 1)
        self.assertIn("interrupted at step", errors)
        self.assertEqual(list(self.out.iterdir()), [])


class BadInput(HydroTest):
    def test_missing_file(self):
        self.assert_refused("absent.toml", scene=self.path / "absent.toml")

    def test_not_toml(self):
        self.scene.write_text("name = = 3\n")
        self.assert_refused("scene.toml:1:")

    def test_a_fault_is_named_and_shown_where_it_stands(self):
        jumps, half_space = "[10.0, 50.0,", 'far_boundary = "half_space"'
        cases = [("zones = 200", "zoness = 200", ("zoness", '"zones"'), True), ("length_m = 1e-3\n", "", ("length_m",), False),
                 ("zones = 200", 'zones = "many"', ("zones",), True),
                 (half_space, f"{half_space}\ninitial_temperature_k = -5.0", ("initial_temperature_k", "scene.toml:"), False),
                 ('material = "aluminium_dlp"', 'material = "aluminum_dlp"', ("aluminum_dlp", "aluminium_dlp"), True),
                 ("pressure_pa = [11.2e9]", "pressure_pa = [11.2e9, 1e9]", ("pressure_pa has 2 values, expected 1",), True),
                 ("pressure_pa = [11.2e9]", "pressure_pa = [11.2e9, 1e9]\npressure_time_s = [0.0]", ("pressure_pa has 2 values", "pressure_time_s"), False),
                 ("pressure_pa = [11.2e9]", "pressure_pa = [11.2e9, 1e9]\npressure_time_s = [1e-7, 1e-7]", ("increasing times",), False),
                 ("end_time_s = 200e-9", "end_time_s = 200e-9\ndt_s = 1e-8", ("dt_s", "cfl 1", "scene.toml:"), False),
                 ("pressure_pa = [11.2e9]", "pressure_pa = [11.2e9]\n[hydro.profiles]\nnode = [0]\ntime_s = [1e-6]", ("time 1e-06 s, expected times up to hydro.end_time_s = 2e-07 s",), False)]
        for value in ("nan", "inf", "-inf"):
            cases += [(jumps, f"[{value}, 50.0,", ("scene.toml:", "velocity_jump_m_per_s"), False),
                      ("yield_strength_pa = 200e6", f"yield_strength_pa = {value}", ("yield_strength_pa",), True)]
        for old, new, texts, at_its_place in cases:
            with self.subTest(new):
                place = self.edited(old, new)
                self.assert_refused(*texts, *[place] * at_its_place)

    def test_a_cone_takes_no_key_that_it_does_not_use(self):
        cone = (PROBLEMS / "cone_al_steel_coarse.toml").read_text()
        for table, line, text in (("[hydro]", "cfl = 0.5", "hydro.cfl is of shear_column alone"),
                                  ("[hydro]", "dt_s = 1e-9", "hydro.dt_s is of shear_column alone"),
                                  ("[layer]", "inertia = true", "layer.inertia is of shear_column alone")):
            self.assertEqual(cone.count(f"{table}\n"), 1)
            self.scene.write_text(cone.replace(f"{table}\n", f"{table}\n{line}\n"))
            run = self.hydro("--check")
            self.assertEqual(run.returncode, 1, run.stdout)
            self.assertIn(text, run.stderr)

    def test_a_load_beyond_the_model_is_told_to_the_user_of_the_hydrocode(self):
        for scene, key, value, quantity in (("cone_al_steel_coarse", "flyer_speed_m_per_s", 4000, r"\w+_pa"),
                                            ("two_half_spaces", "velocity_jump_m_per_s", "[1e5]", "velocity_jump_m_per_s")):
            served.edited(PROBLEMS / f"{scene}.toml", self.scene, **{key: value})
            run = self.hydro("--no-plot")
            self.assertEqual(run.returncode, 1)
            self.assertRegex(run.stderr, rf"INVALID_VALUE: in step \d+, to [\d.e-]+ s: {quantity} of node 0 is .*The load on the interface is beyond the range of the model")
            self.assertNotIn("send the step again", run.stderr)

    def test_a_zone_below_absolute_zero_is_told_once(self):
        for speed, told in ((800, 0), (2500, 1)):
            served.edited(PROBLEMS / "cone_al_steel_coarse.toml", self.scene, flyer_speed_m_per_s=speed)
            self.assertEqual(self.hydro("--no-plot").stderr.count("which is below absolute zero"), told)

    def test_scene_without_a_problem(self):
        self.scene.write_text(SCENE[:SCENE.index("[hydro]")])
        self.assert_refused("[hydro]")

    def test_strategy_that_takes_no_far_field(self):
        place = self.edited('strategy = "force_driven"', 'strategy = "velocity_driven"')
        self.scene.write_text(self.scene.read_text().replace("[interface]\nfriction_coefficient = 0.3\nyield_strength_pa = 200e6\n", ""))
        self.assert_refused(place, "force_driven")

    def test_check_refuses_what_a_run_refuses(self):
        place = self.edited('material = "steel_dlp"', 'material = "stel_dlp"')
        run = self.hydro("--check")
        self.assertEqual(run.returncode, 1)
        self.assertIn(place, run.stderr)

    def test_results_that_cannot_be_written(self):
        self.out.write_text("a file stands where the directory should be")
        run = self.hydro("--no-plot")
        self.assertEqual(run.returncode, 1)
        self.assertIn("results", run.stderr)


if __name__ == "__main__":
    served.main()
