"""Nodes of a history that have a pair of materials and parameters of their own: from tables and recordings to the bits of runs alone."""
import os

import h5py
import numpy as np
import replay_support as support
import served
from replay_support import force_history

import shearbus

MU = "interface.friction_coefficient"
ANSWERS = ("shear_stress", "sliding_velocity", "interface_temperature", "velocity_jump_new")


def scene_text(soft="aluminium_dlp", mu=0.3, tables=""):
    layer = {"thickness_m": 50e-6, "cells": 30, "grading": 1.14}
    return served.scene("force_driven", soft=soft, layer=layer, interface={"friction_coefficient": mu, "yield_strength_pa": 60e6}) + tables


class Pairs(support.ReplayTest):
    def setUp(self):
        super().setUp()
        os.environ.pop("SHEARBUS_RECORD", None)
        self.scene = self.file("scene.toml", scene_text(tables="[pair.brass.soft]\nmaterial = \"copper_ofhc\"\n"))

    def file(self, name, text):
        path = self.path / name
        path.write_text(text, encoding="utf-8")
        return path

    def history_of(self, **more):
        """Four nodes at the same load: what differs between their answers is pair and parameter."""
        self.write(**force_history(steps=40, nodes=4, pressure=np.full((40, 4), 0.1e9), initial_velocity_jump=np.full(4, 40.0), **more))

    def alone(self, place, **scene):
        """The answers of one node of a scene that is its own."""
        result = self.result(scene=self.file("alone.toml", scene_text(**scene)))
        return {name: result[name][:, place] for name in ANSWERS}

    def test_each_node_answers_as_in_a_replay_of_its_own_scene(self):
        pair, mu = ["", "brass", "brass", ""], np.array([0.3, 0.3, 0.1, 0.2])
        self.history_of()
        expected = [self.alone(i, soft="copper_ofhc" if pair[i] else "aluminium_dlp", mu=float(mu[i])) for i in range(4)]
        self.assertEqual(len({tuple(node["interface_temperature"]) for node in expected}), 4, "the four are told apart by their answers")
        self.history_of(pair=pair, **{f"parameter/{MU}": mu})
        found = self.result(scene=self.scene)
        for name in ANSWERS:
            for i in range(4):
                np.testing.assert_array_equal(found[name][:, i], expected[i][name], f"{name} of node {10 + i}")
        with h5py.File(self.out) as file:  # the result can be replayed as it is
            self.assertEqual([name.decode() for name in file["pair"][:]], pair)
            np.testing.assert_array_equal(file[f"parameter/{MU}"][:], mu)

        # Divided steps, and a table of text, are of the same nodes.
        divided = self.result("--dt", "5e-10", scene=self.scene)
        self.assertEqual(len(divided["time"]), 80)
        np.testing.assert_allclose(divided["shear_stress"][-1], found["shear_stress"][-1], rtol=0.05)
        rows = "".join(f"{i + 1},{10 + n},1e8,0,0,2.7,7.9,40,{pair[n]},{mu[n]}\n" for i in range(40) for n in range(4))
        table = self.file("t.csv", f"time [ns],node,pressure [Pa],stress_soft [Pa],stress_hard [Pa],mass_soft [kg/m2],mass_hard [kg/m2],"
                                   f"initial_velocity_jump [m/s],pair,parameter/{MU}\n{rows}")
        from_text = self.result("--steps", history=table, scene=self.scene)
        for name in ANSWERS:
            np.testing.assert_allclose(from_text[name], found[name], rtol=1e-9)

    def test_faults_name_dataset_node_key_and_value(self):
        good = np.full(4, 0.3)
        cases = (
            (dict(pair=["", "brass", "tin", ""]), r'the scene has no pair "tin"; it has brass.*\[nodes 12\]'),
            (dict(pair=np.zeros(4)), "/pair holds float values; expected texts"),
            (dict(pair=["", "brass"]), r"/pair has shape \[2\]; expected \[N\] = \[4\]"),
            ({f"parameter/{MU}": [0.3, -1.0, 0.3, 0.3]}, rf"parameters of node 11: {MU} = -1 is out of range"),
            ({f"parameter/{MU}": [0.3, np.nan, 0.3, 0.3]}, rf"/parameter/{MU}\[1\] \(node 11\) is nan; expected a finite number"),
            ({f"parameter/{MU}": np.full((40, 4), 0.3)}, rf"/parameter/{MU} has shape \[40, 4\]; expected \[N\]"),
            ({"parameter/layer.cells": good}, "layer.cells cannot be a parameter of nodes"),
            ({"parameter/interface.friction": good}, "interface.friction cannot be a parameter of nodes"),
            (dict(parameter=good), "/parameter is not a group"),
        )
        for datasets, reason in cases:
            self.history_of(**datasets)
            run = self.replay(scene=self.scene)
            self.assertEqual(run.returncode, 1, run.stdout)
            self.assertRegex(run.stderr, reason)
            self.assertFalse(self.out.exists())
        self.history_of(pair=["brass"] * 4)
        self.assertIn("column pair in a session of one pair", self.replay(scene=self.file("one.toml", scene_text())).stderr)
        head = "time [ns],node,pressure [Pa],pair\n"
        for text, reason in ((head + "1,7,1,a\n2,7,1,b\n", 'line 3: pair of node 7 changes from "a" to "b"'),
                             (head.replace("pair", f"parameter/{MU} [Pa]") + "1,7,1,1\n", "has the unit")):
            self.assertIn(reason, self.replay("--steps", history=self.file("t.csv", text), scene=self.scene).stderr)

    def run_host(self, record=None):
        """A host with two pairs and a parameter, which registers a node later. Returns the answers of its last steps, and its history."""
        if record:
            os.environ["SHEARBUS_RECORD"] = str(record)
        far = dict(stress_soft=0.0, stress_hard=0.0, mass_soft=2.7, mass_hard=7.9, jump=40.0)
        with shearbus.open(self.scene, [3, 4], pair=["", "brass"], parameters={MU: [0.3, 0.1]}, record=True, check_closure="off") as session:
            session.register([5], pair="brass", parameters={MU: [0.2]})
            answers = [session.step(1e-9, pressure=0.1e9, **far) for _ in range(20)]
            return np.array([answer.stress for answer in answers]), session.history, session.scene

    def test_a_recorded_session_repeats_and_becomes_a_history(self):
        stress, history, scene = self.run_host(self.path / "run.log")
        self.assertEqual(len(set(stress[-1])), 3, "pair and parameter matter")
        self.tool("replay", self.path / "run.log")  # exit code 0: the bits of the record
        exported, written = self.path / "exported.h5", self.path / "written.h5"
        self.tool("replay", "export", self.path / "run.log", "--out", exported)
        history.to_hdf5(written, scene)
        for source in (exported, written):
            with h5py.File(source) as file:
                self.assertEqual([name.decode() for name in file["pair"][:]], ["", "brass", "brass"])
                np.testing.assert_array_equal(file[f"parameter/{MU}"][:], [0.3, 0.1, 0.2])
            np.testing.assert_array_equal(self.result(history=source, scene=self.scene)["shear_stress"], stress)
        self.tool("replay", "export", self.path / "run.log", "--out", self.path / "e.csv")
        found = self.result("--steps", history=self.path / "e.csv", scene=self.scene)["shear_stress"]
        np.testing.assert_allclose(found, stress, rtol=1e-9)
        self.tool("replay", "export", self.path / "run.log", "--out", self.path / "one.h5", "--node", "5")
        np.testing.assert_array_equal(self.result(history=self.path / "one.h5", scene=self.scene)["shear_stress"][:, 0], stress[:, 2])

    def test_nodes_without_a_temperature_of_their_own_begin_at_that_of_the_scene(self):
        scene = self.file("warm.toml", scene_text(tables='[pair.brass.layer]\nthickness_m = 50e-6\ncells = 30\ngrading = 1.14\ninitial_temperature_k = 350\n'))
        os.environ["SHEARBUS_RECORD"] = str(self.path / "warm.log")
        far = dict(pressure=0.1e9, stress_soft=0.0, stress_hard=0.0, mass_soft=2.7, mass_hard=7.9, jump=40.0)
        with shearbus.open(scene, [1, 2], pair=["", "brass"], record=True, check_closure="off") as session:
            session.register([9], pair="", initial_temperature=900.0)
            answers = np.array([session.step(1e-9, **far).temperature for _ in range(20)])
            session.history.to_hdf5(self.path / "h.h5", session.scene)
        self.tool("replay", "export", self.path / "warm.log", "--out", self.path / "e.h5")
        for name in ("h.h5", "e.h5"):
            with h5py.File(self.path / name) as file:
                np.testing.assert_array_equal(file["initial_temperature"][:], [300.0, 350.0, 900.0])
            np.testing.assert_array_equal(self.result(history=self.path / name, scene=scene)["interface_temperature"], answers)

    def test_layers_that_began_before_the_history_are_told(self):
        far = dict(pressure=0.1e9, stress_soft=0.0, stress_hard=0.0, mass_soft=2.7, mass_hard=7.9, jump=40.0)
        scene, server = self.file("one.toml", scene_text()), served.Server(self, self.path, durable=False)
        giver = shearbus.open(scene, [1, 2], server.endpoint, domain="d", check_closure="off")
        giver.step(1e-9, **far)
        os.environ["SHEARBUS_RECORD"] = str(self.path / "taker.log")
        taker = shearbus.open(scene, [3], server.endpoint, domain="d", record=True, check_closure="off")
        taker.accept(giver.offer([2]))
        taker.step(1e-9, **far)
        taker.mark("there")
        taker.step(1e-9, **far)
        with self.assertWarnsRegex(UserWarning, "the layer of node 2 began before the first step; a replay lets it begin at the start"):
            taker.history.to_hdf5(self.path / "h.h5")
        taker.close()
        giver.close()
        told = "warning: {}: the layer of node 2 began in another session; a replay of the table lets the layers begin at the start"
        self.assertIn(told.format(self.path / "e.h5"), self.tool("replay", "export", self.path / "taker.log", "--out", self.path / "e.h5"))
        for name, past in (("h.h5", "before the first step"), ("e.h5", "in another session")):
            told = f"warning: {self.path / name}: the layer of node 2 began {past}; here it begins at the start, and the answers differ"
            self.assertIn(told, self.replay(history=self.path / name, scene=scene).stderr)

    def test_what_if_keeps_pairs_and_parameters(self):
        stress, _, _ = self.run_host(self.path / "run.log")
        self.tool("replay", self.path / "run.log", "--set", "interface.yield_strength_pa=5e6", "--out", self.out)
        with h5py.File(self.out) as file:
            weak = file["shear_stress"][:]
            self.assertEqual([name.decode() for name in file["pair"][:]], ["", "brass", "brass"])
        self.assertTrue((np.abs(weak[-1]) < np.abs(stress[-1])).all())

    def test_changes_that_reach_no_node_are_refused_and_those_that_miss_some_are_told(self):
        self.run_host(self.path / "run.log")
        own = f"{MU}=0.5 would change nothing: the nodes have values of their own of that key"
        self.assertIn(own, self.tool("replay", self.path / "run.log", "--set", f"{MU}=0.5", "--out", self.out, code=1))
        self.history_of(pair=["", "brass", "brass", ""], **{f"parameter/{MU}": np.full(4, 0.3)})
        for change in (("--set", f"{MU}=0.5"), ("--sweep", f"{MU}=0.5,0.6")):
            self.assertIn(own, self.replay(*change, scene=self.scene).stderr)
        missed = "note: --set soft.yield_strength_pa=1e8 does not reach the nodes of [pair.brass], which has a table [soft] of its own"
        self.assertIn(missed, self.replay("--set", "soft.yield_strength_pa=1e8", scene=self.scene).stderr)
        self.assertNotIn("does not reach", self.replay("--set", "interface.yield_strength_pa=1e8", scene=self.scene).stderr)

    def test_nodes_whose_pair_a_log_does_not_tell_are_refused(self):
        far = dict(pressure=0.1e9, stress_soft=0.0, stress_hard=0.0, mass_soft=2.7, mass_hard=7.9, jump=40.0)
        server = served.Server(self, self.path, durable=False)
        giver = shearbus.open(self.scene, [1, 2], server.endpoint, domain="d", pair="brass")
        os.environ["SHEARBUS_RECORD"] = str(self.path / "taker.log")
        taker = shearbus.open(self.scene, [3], server.endpoint, domain="d", pair="", record=True)
        taker.accept(giver.offer([2]))
        taker.step(1e-9, **far)
        with self.assertRaisesRegex(ValueError, "node 2 came from another session"):
            taker.history.to_hdf5(self.path / "h.h5")
        taker.close()
        giver.close()
        text = self.tool("replay", "export", self.path / "taker.log", "--out", self.path / "h.h5", code=1)
        self.assertIn("node 2 came from another session", text)
        self.tool("replay", "export", self.path / "taker.log", "--out", self.path / "h.h5", "--node", "3")


if __name__ == "__main__":
    served.main()
