#!/usr/bin/python3
"""Tests of the Python client against real servers.

python_client.py --endpoint ENDPOINT --server SHEARBUS_SERVER --source DIR [--ctl SHEARBUS_CTL]
    [--replay SHEARBUS_REPLAY] [--server-key FILE --key FILE] [TEST...]
--endpoint is a running server; the tests start more with --server."""
import argparse
import importlib
import importlib.util
import inspect
import os
import pathlib
import pickle
import signal
import subprocess
import sys
import threading
import time
import tomllib
import types
import warnings

import h5py
import numpy

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import EXAMPLES, OPTIONS
import shearbus
from shearbus._library import FUNCTIONS

VELOCITY_DRIVEN = served.scene("velocity_driven", layer={"thickness_m": 20e-6, "cells": 40, "grading": 1.1})
TWO_COMPONENTS = "tangential_components = 2\n" + VELOCITY_DRIVEN
NODES = [3, 7, 2**64 - 1]


def drive(*jumps):
    return {"jump": numpy.array(jumps, float), "pressure": 11.2e9}


def example():
    """Returns a new copy of the module of the example, which is a host of its own."""
    spec = importlib.util.spec_from_file_location("host", EXAMPLES / "host.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class Live(served.Served):
    def open(self, scene=VELOCITY_DRIVEN, nodes=NODES, **options):
        bus = shearbus.open(scene, nodes, **{"endpoint": OPTIONS.endpoint, **options})
        self.addCleanup(bus.__exit__, RuntimeError)
        return bus

    def serve(self, **options):
        """Starts a server of the test's own, which is durable."""
        return served.Server(self, self.path, **options)

    def assert_refused(self, kind, code, call, field=None, nodes=None, text=""):
        with self.assertRaises(kind) as caught:
            call()
        fault = caught.exception
        self.assertEqual(fault.code.name, code, fault)
        self.assertIn(text, str(fault))
        if field is not None:
            self.assertEqual(fault.field, field, fault)
        if nodes is not None:
            self.assertEqual(fault.nodes, nodes, fault)
        return fault


class Steps(Live):
    def test_a_session_tells_what_its_scene_needs(self):
        bus = self.open()
        self.assertEqual((bus.strategy, bus.components, bus.columns), ("velocity_driven", 1, ("jump", "pressure")))
        self.assertEqual(bus.reply_columns, ("stress", "slip", "temperature", "friction_heat", "regime", "outcome"))
        self.assertIn("interface_work", bus.columns_on_request)
        self.assertIn("density_kg_per_m3", bus.scene)
        self.assertGreater(bus.bytes_per_node, 0)
        self.assertEqual((list(bus.nodes), len(bus.warnings)), (NODES, 1))
        self.assertIn("half_space", bus.warnings[0])

    def test_an_answer_has_read_only_arrays_that_outlive_the_next_step(self):
        bus = self.open()
        first = bus.step(20e-9, **drive(100, -100, 50))
        kept = first.stress.copy()
        for array in (first.stress, first.regime, first.outcome, first.nodes):
            self.assertEqual((array.shape, array.flags.writeable), ((3,), False))
            with self.assertRaises(ValueError):
                array[0] = 0
        self.assertEqual(first.regime.dtype, numpy.uint8)
        self.assertEqual((first.stress[1], first.state_version), (-first.stress[0], 1))
        self.assertEqual(first.flagged_nodes,
                         numpy.count_nonzero(first.outcome & ~numpy.uint8(shearbus.Outcome.ASLEEP)))
        for _ in range(3):
            bus.step(1e-9, **drive(1, 2, 3))
        numpy.testing.assert_array_equal(first.stress, kept)
        self.assertEqual(set(first.regime), {shearbus.Regime.TRESCA})
        with self.assertRaisesRegex(AttributeError, "interface_work.*want="):
            first.interface_work

    def test_profiles_hold_the_state_and_change_nothing(self):
        bus, plain = self.open(), self.open()
        for _ in range(5):
            answer = bus.step(20e-9, **drive(100, -100, 50))
            plain.step(20e-9, **drive(100, -100, 50))
        profiles = bus.profiles([NODES[2], NODES[0]], pressure=11.2e9)
        vertices = profiles.position.size
        self.assertEqual((profiles.position[0], profiles.width.shape), (0.0, (vertices,)))
        self.assertEqual((list(profiles.nodes), profiles.state_version), ([NODES[2], NODES[0]], 5))
        numpy.testing.assert_array_equal(profiles.layer_temperature[:, 0], answer.temperature[[2, 0]])
        numpy.testing.assert_array_equal(profiles.layer_shear_stress[:, 0], answer.stress[[2, 0]])
        inside = ~numpy.isnan(profiles.layer_flow_stress)
        limit = profiles.layer_flow_stress[inside] * (1 + 1e-9)
        self.assertTrue((3**0.5 * abs(profiles.layer_shear_stress[inside]) <= limit).all())
        self.assertTrue((profiles.layer_flow_stress[inside] > bus.profiles(profiles.nodes).layer_flow_stress[inside]).all())
        numpy.testing.assert_array_equal(bus.step(1e-9, **drive(1, 2, 3)).stress, plain.step(1e-9, **drive(1, 2, 3)).stress)
        self.assert_refused(shearbus.ContentError, "UNKNOWN_NODE", lambda: bus.profiles([77]), "node_id", [77])
        self.assert_refused(shearbus.ContentError, "INVALID_VALUE", lambda: bus.profiles(NODES, pressure=float("nan")), "pressure")
        self.assert_refused(shearbus.MessageError, "SHAPE", lambda: bus.profiles([]), "node_id")

    def test_numbers_stand_for_all_rows_and_lists_and_integers_are_taken(self):
        a, b = self.open(), self.open()
        x = a.step(1e-9, jump=100, pressure=11.2e9)
        y = b.step(1e-9, jump=[100, 100, 100], pressure=numpy.full(3, 11_200_000_000))
        numpy.testing.assert_array_equal(x.temperature, y.temperature)

    def test_large_frames_are_viewed_where_they_arrived(self):
        nodes = numpy.arange(20_000)
        bus = self.open(nodes=nodes)
        answer = bus.step(1e-9, jump=numpy.linspace(-100, 100, nodes.size), pressure=11.2e9)
        self.assertFalse(answer.stress.flags.owndata)
        few = self.open().step(1e-9, **drive(-100, 100, answer.stress[0] * 0))
        self.assertEqual((answer.stress[0], answer.stress[-1]), (few.stress[0], few.stress[1]))

    def test_a_step_in_two_halves_has_the_bits_of_a_whole_one(self):
        many = numpy.arange(1, 5001)  # which the library reads where they are
        for nodes in (NODES, many):
            halves, whole = self.open(nodes=nodes, record=True), self.open(nodes=nodes)
            for trial in (False, True, False):
                jump = numpy.linspace(50, 100, len(nodes))
                self.assertIsNone(halves.start(1e-9, trial=trial, jump=jump, pressure=1e9))
                expected = (whole.trial if trial else whole.step)(1e-9, jump=jump, pressure=1e9)
                jump[:] = 0.0  # is the host's again
                for call in (lambda: halves.step(1e-9, jump=jump, pressure=1e9), lambda: halves.start(1e-9, jump=jump, pressure=1e9),
                             halves.commit, lambda: halves.mark("m"), lambda: halves.profiles(nodes[:1])):
                    self.assert_refused(shearbus.ContentError, "INVALID_VALUE", call, text="a started step has not been finished")
                answer = halves.finish()
                self.assertEqual((type(answer), answer.state_version), (type(expected), expected.state_version))
                for name in expected.columns:
                    numpy.testing.assert_array_equal(getattr(answer, name), getattr(expected, name))
                if trial:
                    halves.commit(), whole.commit()
            self.assert_refused(shearbus.ContentError, "INVALID_VALUE", halves.finish, text="a step is finished that was not started")
            self.assertEqual(len(halves.history.dt), 3)
            halves.start(1e-9, jump=1.0, pressure=1e9)
            self.assertEqual(halves.close().node_steps, 4 * len(nodes))
            whole.start(1e-9, jump=1.0, pressure=1e9)
            ticket = whole.ticket
            whole.leave()
            with shearbus.resume(ticket, OPTIONS.endpoint) as successor:
                version = successor.rollback()
                self.assertIn(version, (3, 4))  # the step that was left may run or not, but no more after the resumption
                self.assertEqual(successor.step(1e-9, jump=1.0, pressure=1e9).state_version, version + 1)

    def test_an_interrupt_outside_of_the_library_leaves_a_started_session_whole(self):
        def interrupted(function, after):
            """Returns a function of the library before or after which a signal's handler raises an exception in Python code."""
            def call(*arguments):
                if after:
                    function(*arguments)
                raise KeyboardInterrupt
            return call

        values = drive(50, 60, 70)
        expected = self.open().step(1e-9, **values)
        for name, after in (("start", False), ("start", True), ("finish", False), ("finish", True)):
            for end in ("finish", "close"):
                bus = self.open()
                if name == "finish":
                    bus.start(1e-9, **values)
                library, function = bus._library, f"shearbus_{name}"
                bus._library = types.SimpleNamespace(**{function: interrupted(getattr(library, function), after)})
                with self.assertRaises(KeyboardInterrupt):
                    bus.start(1e-9, **values) if name == "start" else bus.finish()
                bus._library = library
                sent, waits = (name, after) != ("start", False), (name, after) in (("start", True), ("finish", False))
                if end == "finish" and waits:
                    numpy.testing.assert_array_equal(bus.finish().temperature, expected.temperature)
                elif end == "finish":
                    self.assert_refused(shearbus.ContentError, "INVALID_VALUE", bus.finish, text="a step is finished that was not started")
                self.assertEqual(bus.close().node_steps, 3 * sent, (name, after, end))

    def test_two_components_are_an_extra_axis(self):
        bus = self.open(TWO_COMPONENTS)
        jump = numpy.array([[100.0, 0.0], [0.0, 100.0], [60.0, 80.0]])
        answer = bus.step(1e-9, jump=jump, pressure=11.2e9)
        self.assertEqual(answer.stress.shape, (3, 2))
        self.assertEqual(answer.stress[0, 0], answer.stress[1, 1])
        numpy.testing.assert_allclose(answer.stress[2] / answer.stress[0, 0], [0.6, 0.8], rtol=1e-12)
        self.assertEqual(answer.temperature.shape, (3,))
        bus.step(1e-9, jump=0, pressure=11.2e9)
        for wrong in (100.0, numpy.ones(3), numpy.ones((2, 3))):
            self.assert_refused(shearbus.MessageError, "SHAPE", lambda: bus.step(1e-9, jump=wrong, pressure=1e9), "jump", text="(3, 2)")
        bad = jump.copy()
        bad[1, 1] = numpy.nan
        self.assert_refused(shearbus.ContentError, "INVALID_VALUE", lambda: bus.step(1e-9, jump=bad, pressure=1e9),
                            "jump", [7])

    def test_wanted_columns_come_in_addition(self):
        bus = self.open(want="ledger")
        answer = bus.step(1e-9, **drive(100, 100, 100))
        self.assertTrue(set(bus.reply_columns) < set(answer.columns))
        numpy.testing.assert_allclose(answer.interface_work, answer.stress * 100 * 1e-9, rtol=1e-12)
        only = self.open().step(1e-9, want=["plastic_work"], **drive(100, 100, 100))
        self.assertEqual(set(only.columns) - set(bus.reply_columns), {"plastic_work"})
        self.assert_refused(shearbus.MessageError, "SHAPE", lambda: self.open(want=["jump_new"]), "jump_new")

    def test_initial_temperatures_are_per_node_or_one_for_all(self):
        cold, hot = self.open(nodes=[1, 2], initial_temperature=[300.0, 700.0]).step(1e-9, **drive(1, 1)).temperature
        self.assertTrue(300 <= cold < 310 and 700 <= hot < 710)
        self.assertGreater(self.open(initial_temperature=700).step(1e-9, **drive(1, 1, 1)).temperature.min(), 700)

    def test_a_scene_is_a_path_a_text_or_a_dict(self):
        file = EXAMPLES / "constant_friction.toml"
        nested = tomllib.loads(VELOCITY_DRIVEN)
        nested["layer"]["thickness_m"] = numpy.float64(20e-6)
        self.assertEqual(self.open(nested).scene, self.open(VELOCITY_DRIVEN).scene)
        self.assertEqual(self.open(file).scene, self.open(file.read_text()).scene)
        fault = self.assert_refused(shearbus.ContentError, "INVALID_SCENE",
                                    lambda: self.open(VELOCITY_DRIVEN.replace("cells", "cels")), "layer.cels")
        self.assertIn("scene:9:1: ", fault.text)
        edited = shearbus.Scene(file)
        edited["interface.friction_coefficient"] = 0.25
        edited["layer.initial_temperature_k"] = edited["layer.cells"] * 10.0
        scene = shearbus.Scene(self.open(edited).scene)
        self.assertEqual((scene["interface.friction_coefficient"], scene["layer.initial_temperature_k"]), (0.25, 400.0))
        self.assertEqual(self.open(scene).scene, self.open(edited).scene)
        for absent in ("interface.mu", "name.mu"):
            with self.assertRaises(KeyError):
                scene[absent]
            self.assertFalse(absent in scene or scene.get(absent))
        edited.update({"interface.friction_coefficient": numpy.array(0.125)})
        self.assertTrue("interface.friction_coefficient" in edited)
        self.assertEqual(shearbus.Scene(self.open(edited).scene).get("interface.friction_coefficient"), 0.125)
        self.assertEqual(edited.pop("interface.friction_coefficient"), 0.125)
        self.assertNotIn("friction_coefficient", edited["interface"])
        for wrong in ("no_such_file.toml", 3, {"name": None}):
            self.assert_refused(shearbus.ContentError, "INVALID_SCENE", lambda: self.open(wrong))


class Forms(Live):
    """What a force-driven host may leave to the server."""

    FAR = {"jump": numpy.array([100.0, 50, -80]), "pressure": 1e9, "stress_soft": 30e6,
           "stress_hard": numpy.array([0.0, 1e7, -1e7]), "mass_soft": 0.0043, "mass_hard": 0.0123}

    scene = EXAMPLES / "constant_friction.toml"

    def stick(self, dt):
        """Returns FAR in stick form."""
        soft, hard = self.FAR["mass_soft"], self.FAR["mass_hard"]
        z = 1 / (dt * (1 / soft + 1 / hard))
        free = self.FAR["jump"] + dt * (self.FAR["stress_soft"] / soft + self.FAR["stress_hard"] / hard)
        return {"jump": self.FAR["jump"], "pressure": 1e9, "stick_stress": z * free, "impedance": z}

    def test_a_step_has_one_form_and_all_of_it(self):
        bus, stick = self.open(self.scene, check_closure="off"), self.stick(1e-9)
        self.assert_refused(shearbus.MessageError, "SHAPE", lambda: bus.step(1e-9, **{**self.FAR, **stick}), "stress_soft", text="is of the far-field form")
        del stick["impedance"]
        self.assert_refused(shearbus.MessageError, "SHAPE", lambda: bus.step(1e-9, **stick), "impedance", text="missing")

    def test_absent_nodes_cool_where_the_host_says_so(self):
        found = []
        for absent_nodes in ("keep", "open"):
            bus = self.open(self.scene, check_closure="off")
            bus.step(1e-9, **self.FAR)
            bus.step(1e-9, nodes=[7], absent_nodes=absent_nodes, **{**self.FAR, "stress_hard": 0.0, "jump": 70.0})
            found.append(bus.step(1e-12, **self.FAR).temperature)
        hot, cool = found
        self.assertEqual((cool < hot).tolist(), [True, False, True])

    def test_the_server_tells_closure_and_times(self):
        bus = self.open(self.scene, want="closure")
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            first = bus.step(2e-6, time=2e-6, **self.FAR)
            second = bus.step(2e-6, time=7e-6, **self.FAR)
        self.assertTrue(numpy.isnan(first.closure).all())
        numpy.testing.assert_array_equal(second.closure, self.FAR["jump"] - first.jump_new)
        worst = abs(second.closure).argmax()
        self.assertEqual((second.largest_closure, second.closure_node), (abs(second.closure[worst]), NODES[worst]))
        self.assertAlmostEqual(second.layer_time, 4e-6)
        told = [str(w.message).split(":")[0] for w in caught if w.category is shearbus.ClosureWarning and
                pathlib.Path(w.filename).name == "python_client.py"]
        self.assertEqual(sorted(told), sorted(set(told)))
        self.assertLessEqual({"time", "closure"}, set(told))

    def test_a_server_that_lacks_a_capability_is_named(self):
        bus = self.open(self.scene, idle_limit=3600)
        bus.welcome.capabilities = ()
        for call, field in ((lambda: bus.step(1e-9, **self.stick(1e-9)), "stick_stress"),
                            (lambda: bus.step(1e-9, absent_nodes="open", **self.FAR), "absent_nodes")):
            self.assert_refused(shearbus.MessageError, "UNSUPPORTED", call, field)


class Decisions(Live):
    def test_a_trial_commits_on_leaving_and_rolls_back_otherwise(self):
        bus, plain = self.open(), self.open()
        with bus.trial(1e-9, **drive(400, 400, 400)) as trial:
            if trial.temperature.max() > 300:
                trial.reject()
        with self.assertRaises(KeyError), bus.trial(1e-9, **drive(300, 300, 300)):
            raise KeyError("of the host")
        with bus.trial(1e-9, **drive(100, 100, 100)) as trial:
            self.assertEqual(trial.state_version, 0)
        expected = plain.step(1e-9, **drive(100, 100, 100))
        numpy.testing.assert_array_equal(trial.temperature, expected.temperature)
        numpy.testing.assert_array_equal(
            bus.step(1e-9, **drive(1, 2, 3)).stress,
            plain.step(1e-9, **drive(1, 2, 3)).stress)
        bus.trial(1e-9, **drive(100, 100, 100))
        bus.trial(1e-9, commit_previous=True, **drive(100, 100, 100))
        self.assertEqual((bus.commit(), bus.rollback()), (4, 4))

    def test_pairs_and_parameters_of_nodes_are_refused_by_name(self):
        key = "soft.yield_strength_pa"
        bus = self.open(VELOCITY_DRIVEN + '[pair.weak.soft]\nmaterial = "aluminium_dlp"\n', pair=["weak", "", "weak"], parameters={key: [2e7, 4e7, 3e7]})
        self.assertEqual((bus.pairs, bus.parameters), (("weak",), (key,)))
        bus.register([9], pair="weak")
        for kind, code, options, field, nodes in (
                (shearbus.ContentError, "INVALID_VALUE", {"pair": ["tin"]}, "pairs", None),
                (shearbus.ContentError, "INVALID_VALUE", {"parameters": {key: -1.0}}, key, [10]),
                (shearbus.MessageError, "SHAPE", {"parameters": {"soft.density_kg_per_m3": 1.0}}, "parameters", None),
                (shearbus.MessageError, "SHAPE", {"pair": ["weak", ""]}, "pair", None)):
            self.assert_refused(kind, code, lambda: bus.register([10], **options), field, nodes)

    def test_a_successor_resumes_by_the_ticket(self):
        bus, plain = self.open(), self.open()
        expected = [each.step(1e-9, **drive(100, 90, 80)).stress for each in (bus, plain)]
        numpy.testing.assert_array_equal(*expected)
        ticket = bus.ticket
        bus.leave()
        successor = shearbus.resume(ticket + "\n", OPTIONS.endpoint)  # as read from a file
        self.addCleanup(successor.close)
        self.assertEqual((list(successor.nodes), successor.scene, successor.columns),
                         (NODES, plain.scene, plain.columns))
        numpy.testing.assert_array_equal(
            successor.step(1e-9, **drive(1, 2, 3)).stress,
            plain.step(1e-9, **drive(1, 2, 3)).stress)
        self.assert_refused(shearbus.SessionError, "RESUME_REFUSED",
                            lambda: shearbus.resume(ticket[:33] + "0" * 32, OPTIONS.endpoint))
        for wrong in ("", "xyz", None):
            self.assert_refused(shearbus.SessionError, "RESUME_REFUSED",
                                lambda: shearbus.resume(wrong, OPTIONS.endpoint))
        self.assert_refused(shearbus.Unreachable, "UNREACHABLE", lambda: shearbus.resume(ticket))
        # None of these leads to a session with cold layers in the middle of a run.
        successor.close()
        for gone, why in ((ticket, "the session was closed"), ("0" * 32 + ticket[32:], "has no state directory")):
            fault = self.assert_refused(shearbus.SessionError, "UNKNOWN_SESSION", lambda: shearbus.resume(gone, OPTIONS.endpoint), text=why)
            self.assertIn("cold layers", fault.remedy)

    def test_a_host_with_another_mesh_keeps_the_layers_of_the_nodes_that_remain(self):
        bus, whole = self.open(), self.open()
        for each in (bus, whole):
            each.step(1e-9, **drive(100, 90, 80))
        bus.mark("dump")
        bus.step(1e-9, **drive(500, 500, 500))
        ticket = bus.ticket
        bus.leave()
        with self.assertRaisesRegex(shearbus.SessionError, "node 11 is not in the session.*retire and register") as caught:
            shearbus.resume(ticket, OPTIONS.endpoint, nodes=[7, 3, 11])
        self.assertEqual((caught.exception.code, caught.exception.nodes), (shearbus.Code.RESUME_REFUSED, [11]))
        with self.assertWarnsRegex(UserWarning, f"1 nodes that the host does not name, such as node {2**64 - 1}"):
            successor = shearbus.resume(ticket, OPTIONS.endpoint, nodes=[7, 3])
        self.addCleanup(successor.close)
        successor.rollback_to("dump")
        successor.retire([2**64 - 1])
        successor.register([11])
        self.assertEqual(list(successor.nodes), [3, 7, 11])
        answer, expected = successor.step(1e-9, **drive(70, 60, 50)), whole.step(1e-9, **drive(70, 60, 50))
        numpy.testing.assert_array_equal(answer.temperature[:2], expected.temperature[:2])
        fresh = self.open(nodes=[11])
        numpy.testing.assert_array_equal(answer.temperature[2:], fresh.step(1e-9, **drive(50)).temperature)

    def test_a_history_holds_what_was_kept(self):
        bus = self.open(record=True)
        answers = [bus.step(1e-9, step=i, **drive(100 + i, 90, 80)) for i in range(3)]
        with bus.trial(1e-9, **drive(500, 500, 500)) as trial:
            trial.reject()
        bus.mark("dump")
        bus.step(1e-9, **drive(500, 500, 500))
        bus.rollback_to("dump")
        with bus.trial(2e-9, time=5e-9, **drive(70, 80, 90)) as trial:
            pass
        history = bus.history
        self.assertEqual((len(history), history.stress.shape, list(history.nodes)), (4, (4, 3), NODES))
        numpy.testing.assert_array_equal(history.stress, [a.stress for a in (*answers, trial)])
        numpy.testing.assert_array_equal(history.jump[:, 0], [100, 101, 102, 70])
        numpy.testing.assert_allclose(history.time, [1e-9, 2e-9, 3e-9, 5e-9], rtol=1e-12)
        self.assertEqual((list(history.step), list(history.dt)), ([0, 1, 2, 0], [1e-9, 1e-9, 1e-9, 2e-9]))
        file, again, scene = (self.path / name for name in ("history.h5", "again.h5", "scene.toml"))
        history.to_hdf5(file, bus.scene)
        scene.write_text(bus.scene)
        with h5py.File(file) as read:
            numpy.testing.assert_array_equal(read["shear_stress"], history.stress)
            self.assertEqual((read["shear_stress"].attrs["units"], read["meta/scene"][()].decode()), (b"Pa", bus.scene))
            legends = [read[name].attrs["legend"] for name in ("regime", "outcome")]
        # The file is what shearbus-replay reads, and the replay answers with the same bits.
        self.run_program(OPTIONS.replay, file, "--scene", scene, "--out", again)
        with h5py.File(again) as read:
            self.assertEqual([read[name].attrs["legend"] for name in ("regime", "outcome")], legends)
            numpy.testing.assert_array_equal(read["shear_stress"], history.stress)
            numpy.testing.assert_array_equal(read["interface_temperature"], history.temperature)
        bus.step(1e-9, nodes=[7], **drive(60))
        table = history.table()
        self.assertEqual((list(table["node"][-2:]), len(table["stress"]), table["jump"][-1]), ([2**64 - 1, 7], 13, 60))
        with self.assertRaisesRegex(ValueError, "different nodes"):
            history.stress

    def test_two_components_of_a_history_have_names_of_their_own(self):
        bus = self.open(TWO_COMPONENTS, record=True)
        answer = bus.step(1e-9, jump=numpy.ones((3, 2)), pressure=1e9)
        self.assertEqual(bus.history.stress.shape, (1, 3, 2))
        numpy.testing.assert_array_equal(bus.history.table()["stress_second"], answer.stress[:, 1])


class Refusals(Live):
    """What numpy makes easy to get wrong is refused by name, before anything is sent."""

    def setUp(self):
        super().setUp()
        self.bus, self.plain = self.open(), self.open()

    def silently(self, call, kind, code, field, nodes=None, text=""):
        sends, self.bus._step_call = self.bus._step_call, lambda *_: self.fail("something was sent")
        self.bus._call = self.bus._step_call
        try:
            return self.assert_refused(kind, code, call, field, nodes, text)
        finally:
            del self.bus._call
            self.bus._step_call = sends

    def test_values_are_refused_by_the_name_of_their_column(self):
        good = drive(1, 2, 3)
        ones = numpy.ones(3)
        for wrong in (numpy.ones(2), numpy.ones(4), numpy.ones((3, 1)), [], numpy.float32(1e9), numpy.ones(3, numpy.float32),
                      numpy.ones(3, numpy.float16), numpy.ones(3, numpy.longdouble), numpy.ones(3, complex), numpy.ones(3, bool), ["1", "2", "3"],
                      None, [1.0, [2.0], 3.0], numpy.ma.masked_array(ones, [0, 1, 0]), numpy.ma.masked_array(ones)):
            with self.subTest(repr(wrong)):
                self.silently(lambda: self.bus.step(1e-9, **{**good, "pressure": wrong}), shearbus.MessageError, "SHAPE", "pressure")
        for value in (numpy.nan, numpy.inf, -numpy.inf):
            bad = numpy.array([1.0, 2.0, value])
            self.assert_refused(shearbus.ContentError, "INVALID_VALUE", lambda: self.bus.step(1e-9, **{**good, "jump": bad}),
                                "jump", [2**64 - 1], f"jump of node {2**64 - 1} is {value}")
            self.assert_refused(shearbus.ContentError, "INVALID_VALUE",
                                lambda: self.bus.step(1e-9, nodes=[7], jump=value, pressure=1.0), "jump", [7])
        for dt, values, field, text in ((1e-9, {"jump": 1.0}, "pressure", "is missing"), (1e-9, {**good, "pressure": None}, "pressure", "is None"),
                                        (1e-9, {**good, "presure": 1.0}, "presure", 'mean "pressure"'),
                                        (1e-9, {"velocity_jump": 1.0, "pressure": 1.0}, "velocity_jump", 'mean "jump"'),
                                        (1e-9, {**good, "nods": [3]}, "nods", 'mean "nodes"'),
                                        (1e-9, {**good, "stress_soft": 1.0}, "stress_soft", ""), ("1 ns", good, "dt", "")):
            with self.subTest(field):
                self.silently(lambda: self.bus.step(dt, **values), shearbus.MessageError, "SHAPE", field, text=text)
        numpy.testing.assert_array_equal(self.bus.step(1e-9, **good).stress, self.plain.step(1e-9, **good).stress)

    def test_nodes_are_refused_where_they_are_no_distinct_whole_numbers(self):
        for wrong, text in (([1, 1.5], "has 1.5 of type float at [1], expected"), (numpy.array([1, 2], numpy.float32), "type float32"),
                            ([[1, 2]], "[1, 2] of type list"), (5, "nodes is 5 of type int"), (["a"], "'a'"), ([True, False], "True"),
                            ([2**64], f"{2**64}"), ([-2**64], f"{-2**64}"), (None, "None"), (numpy.ma.masked_array([1, 2]), "masked")):
            self.silently(lambda: self.bus.step(1e-9, nodes=wrong, jump=1.0, pressure=1.0) if wrong is not None else
                          self.bus.register(wrong), shearbus.MessageError, "SHAPE", "nodes", text=text)
        self.silently(lambda: self.bus.register([5, -4]), shearbus.ContentError, "INVALID_VALUE", "nodes", text="-4")
        self.silently(lambda: self.bus.retire([7, 3, 7]), shearbus.ContentError, "DUPLICATE_NODE", "nodes", [7])
        self.silently(lambda: self.bus.offer([7, 7]), shearbus.ContentError, "DUPLICATE_NODE", "nodes", [7])
        self.assert_refused(shearbus.ContentError, "INVALID_VALUE", lambda: self.bus.register([5], [numpy.nan]),
                            "initial_temperature", [5])

    def test_the_servers_refusals_have_the_class_of_their_code(self):
        step = lambda **more: self.bus.step(**{"dt": 1e-9, **drive(1, 2, 3), **more})
        fault = self.assert_refused(shearbus.ContentError, "INVALID_VALUE", lambda: step(dt=0.0))
        self.assertTrue(fault.text and fault.remedy)
        self.assert_refused(shearbus.ContentError, "INVALID_VALUE", lambda: step(pressure=1e13), "pressure", NODES)
        self.assert_refused(shearbus.ContentError, "UNKNOWN_NODE", lambda: step(nodes=[3, 8, 7]), "node_id", [8])
        self.assert_refused(shearbus.ContentError, "DUPLICATE_NODE", lambda: self.bus.register([7]), "node_id", [7])
        self.assert_refused(shearbus.SessionError, "NOTHING_TO_COMMIT", self.bus.commit)
        self.assert_refused(shearbus.SessionError, "UNKNOWN_MARK", lambda: self.bus.rollback_to("gone"), text="gone")
        self.assert_refused(shearbus.SessionError, "UNKNOWN_TRANSFER", lambda: self.open(domain="mine", nodes=()).accept(b"x" * 16))
        self.assert_refused(shearbus.MessageError, "SHAPE", lambda: self.open(nodes=()))
        self.assert_refused(shearbus.MessageError, "LIMIT", lambda: self.open("#" * 300_000 + "\n"))
        self.bus.trial(1e-9, **drive(1, 2, 3))
        self.assert_refused(shearbus.SessionError, "TRIAL_STANDS", lambda: self.bus.retire([7]))
        self.bus.rollback()
        numpy.testing.assert_array_equal(step().stress, self.plain.step(1e-9, **drive(1, 2, 3)).stress)
        self.bus.close()
        self.assert_refused(shearbus.SessionError, "UNKNOWN_SESSION", step)
        self.assertEqual(type(shearbus.errors.error(499, "of a later version")), shearbus.ServerError)

    def test_a_draining_server_opens_no_session(self):
        server = self.serve()
        self.run_program(OPTIONS.ctl, "drain", "--server", server.endpoint)
        self.assert_refused(shearbus.ServerError, "DRAINING", lambda: self.open(endpoint=server.endpoint))

    def test_a_server_that_is_not_there_is_told(self):
        for endpoint in ("bogus", "udp://x", "ipc:///nowhere/at/all"):
            self.assert_refused(shearbus.Unreachable, "UNREACHABLE",
                                lambda: self.open(endpoint=endpoint, connect_deadline=0.2))
        self.assert_refused(shearbus.AuthError, "AUTH", lambda: self.open(server_key_file="a", secret_key_file="b"))
        self.assert_refused(shearbus.AuthError, "AUTH", lambda: self.open(endpoint="tcp://127.0.0.1:9", secret_key_file="b"))


class Losses(Live):
    def with_a_lost_answer(self, call):
        """Returns a session that has made a step, and then a call whose answer was lost."""
        server = self.serve()
        bus = self.open(endpoint=server.endpoint, reply_deadline=0.4, retry_after=0.15)
        bus.step(1e-9, **drive(1, 2, 3))
        server.stop()
        self.assert_refused(shearbus.UnknownOutcome, "UNKNOWN_OUTCOME", lambda: call(bus))
        server.go()
        bus.reply_deadline = 5.0
        return bus

    def test_an_unknown_outcome_is_settled_by_the_same_call(self):
        plain, step = self.open(), lambda bus: bus.step(1e-9, **drive(50, 60, 70))
        plain.step(1e-9, **drive(1, 2, 3))
        answer = step(self.with_a_lost_answer(step))
        self.assertEqual(answer.state_version, 2)
        numpy.testing.assert_array_equal(answer.stress, step(plain).stress)

    def test_a_close_of_unknown_outcome_is_made_again(self):
        bus = self.with_a_lost_answer(shearbus.Session.close)
        totals = bus.close()
        self.assertEqual((totals.node_steps, bus.close()), (3, totals))

    def test_the_end_of_a_started_step_without_a_server_costs_one_deadline(self):
        server = self.serve()
        for end in ("close", "with"):
            bus = self.open(endpoint=server.endpoint, reply_deadline=0.4, retry_after=0.15)
            library = bus._library
            server.stop()
            bus.start(1e-9, **drive(50, 60, 70))
            bus._library = types.SimpleNamespace(shearbus_finish=library.shearbus_finish)  # nothing else is asked
            if end == "close":
                self.assert_refused(shearbus.UnknownOutcome, "UNKNOWN_OUTCOME", bus.close)
            else:
                with self.assertRaises(shearbus.UnknownOutcome), bus:
                    pass
            bus._library = library
            server.go()
            if end == "close":
                bus.reply_deadline = 30.0
                self.assertIn(bus.close().node_steps, (0, 3))

    def test_an_interrupt_leaves_a_session_that_can_be_closed(self):
        server = self.serve()
        bus = self.open(endpoint=server.endpoint)
        server.stop()
        threading.Timer(0.2, os.kill, (os.getpid(), signal.SIGINT)).start()
        with self.assertRaises(KeyboardInterrupt):
            bus.step(1e-9, **drive(50, 60, 70))
        threading.Timer(0.4, server.go).start()  # the next call waits, too
        self.assertEqual(bus.close().node_steps, 3)


class Hosts(Live):

    def test_a_wrong_host_is_told_its_mistake_in_words_of_python_before_the_step_is_sent(self):
        """Two masses under far stresses; factors of what a right host sends. The client library knows many more mistakes."""
        for sent, dt, text in (({"stress_soft": -1}, 1, "stress_soft has the wrong sign"), ({"mass_soft": 2}, 1, "mass_soft must be half of that sent"),
                               ({"jump": -1}, 1, "jump has the wrong sign"), ({}, .5, "dt half of that sent"), ({}, 1, "")):
            bus = self.open(EXAMPLES / "constant_friction.toml", check_closure="error")
            v_soft, v_hard, m_soft, m_hard = numpy.array([100.0, 90, 80]), 0.0, 0.0043, 0.0123

            def step():
                values = {"jump": v_soft - v_hard, "stress_soft": 30e6, "stress_hard": 10e6, "mass_soft": m_soft, "mass_hard": m_hard}
                return bus.step(1e-9, pressure=1e9, **{name: sent.get(name, 1) * value for name, value in values.items()})

            stress = step().stress
            v_soft, v_hard = v_soft + dt * 1e-9 / m_soft * (30e6 - stress), v_hard + dt * 1e-9 / m_hard * (stress - 10e6)
            if text:
                self.assert_refused(shearbus.ClosureError, "NOT_CLOSED", step, "jump", text=text)
            else:
                step()

    def test_a_wrong_host_is_warned_once_and_only_where_it_asks_for_it(self):
        host = example()
        right = host.Body.accelerate
        host.STEPS = 5
        for wrong in (lambda body, dt, friction: right(body, dt, -friction),
                      lambda body, dt, friction: right(body, dt, friction if body.side > 0 else 0 * friction),
                      lambda body, dt, friction: right(body, 2 * dt, friction)):
            host.Body.accelerate = wrong
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                jump, exact, closure = host.run(OPTIONS.endpoint)
            caught = [w for w in caught if w.category is not shearbus.SceneWarning]
            self.assertEqual([w.category for w in caught], [shearbus.ClosureWarning])
            self.assertEqual(pathlib.Path(caught[0].filename).name, "host.py")
            self.assertGreater(abs(jump - exact).max(), 1e-3)
            self.assertGreater(closure, 1e-3)
        self.assert_refused(shearbus.MessageError, "SHAPE", lambda: self.open(check_closure="maybe"), "check_closure")

    def test_the_environment_replaces_endpoint_and_scene(self):
        scene = EXAMPLES / "constant_friction.toml"
        for name, value in (("SHEARBUS_ENDPOINT", OPTIONS.endpoint), ("SHEARBUS_SCENE", str(scene))):
            os.environ[name] = value
            self.addCleanup(os.environ.pop, name)
        self.assertEqual(self.open(endpoint="ipc:///nowhere").name, "constant_friction")

    def test_the_examples_run_as_printed(self):
        done, swept = (subprocess.run([sys.executable, "-B", EXAMPLES / name, OPTIONS.endpoint], text=True, stdout=subprocess.PIPE)
                       for name in ("host.py", "sweep.py"))
        self.assertEqual(done.returncode, 0)
        hottest = [[float(word) for word in line.split()[1::2]] for line in swept.stdout.splitlines()[1:]]
        self.assertEqual((swept.returncode, numpy.shape(hottest)), (0, (3, 3)))
        self.assertTrue((numpy.diff(hottest, axis=0) > 0).all() and (numpy.diff(hottest, axis=1) > 0).all(), hottest)
        self.assertIn("node  5  P   500 MPa  [V] 92.183880 m/s  exact 92.183880\n", done.stdout)


class Processes(Live):
    """A server in this process; what threads, forked children, signals and the end of a process do to a session."""

    STEP = {"jump": [1.0, 2.0, 3.0], "pressure": 11.2e9}

    def host(self, text, *arguments):
        """Starts a host whose streams are pipes."""
        return served.program(self, sys.executable, "-B", "-W", "ignore", "-c", text, *arguments, stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                              stderr=subprocess.PIPE)

    def test_without_an_endpoint_the_server_is_in_this_process(self):
        plain = self.open()
        before = threading.active_count(), len(os.listdir("/proc/self/task"))
        with shearbus.open(VELOCITY_DRIVEN, nodes=NODES) as bus:
            self.assertGreater(len(os.listdir("/proc/self/task")), before[1])
            numpy.testing.assert_array_equal(bus.step(1e-9, **self.STEP).stress, plain.step(1e-9, **self.STEP).stress)
        self.assertEqual((threading.active_count(), len(os.listdir("/proc/self/task"))), before)
        with shearbus.open(VELOCITY_DRIVEN, nodes=NODES, state_dir=str(self.path), threads=2) as bus:
            bus.step(1e-9, **self.STEP)
            self.assertTrue(bus.durable)
            bus.leave()
        absent = self.path / "states"
        self.assert_refused(shearbus.Unreachable, "UNREACHABLE", lambda: shearbus.resume(bus.ticket, state_dir=absent), text="is not there")
        self.assertFalse(absent.exists())
        with shearbus.resume(bus.ticket, state_dir=self.path) as bus:
            self.assertEqual(bus.step(1e-9, **self.STEP).state_version, 2)

    def test_a_process_ends_with_its_session_open(self):
        for ending in ("", "bus.leave()", "del bus", "sys.exit()"):
            done = self.run_program(sys.executable, "-B", "-W", "ignore", "-c", "import shearbus, sys; bus = shearbus.open(sys.argv[1], nodes=[1]); "
                                    f"bus.step(1e-9, jump=1.0, pressure=1e9); print('end', flush=True); {ending}", VELOCITY_DRIVEN)
            self.assertEqual((done.stdout, done.stderr), ("end\n", ""))

    def test_a_process_ends_while_a_daemon_thread_waits_in_a_call(self):
        server = self.serve()
        begin = "import shearbus, sys, threading, time; bus = shearbus.open(sys.argv[1], [1], sys.argv[2]); print(1, flush=True); sys.stdin.readline(); "
        calls = {"a step": "bus.step(1e-9, jump=1.0, pressure=1e9)", "an opening": "shearbus.open(sys.argv[1], [2], sys.argv[2])"}
        for name, call in calls.items():
            program = begin + f"threading.Thread(target=lambda: {call}, daemon=True).start(); time.sleep(0.3)"
            host = self.host(program, VELOCITY_DRIVEN, server.endpoint)
            host.stdout.readline()
            server.stop()
            _, said = host.communicate("\n", timeout=60)
            server.go()
            self.assertEqual(host.returncode, 0, (name, said))
            self.assertNotIn("FATAL", said)

    def test_a_session_is_not_pickled_and_an_answer_is(self):
        bus = self.open()
        answer = bus.step(1e-9, **self.STEP)
        with self.assertRaisesRegex(TypeError, "cannot be pickled.*shearbus.resume"):
            pickle.dumps(bus)
        again = pickle.loads(pickle.dumps(answer))
        numpy.testing.assert_array_equal(again.stress, answer.stress)
        self.assertEqual((again.columns, again.state_version), (answer.columns, 1))

    def test_an_interrupt_ends_any_wait(self):
        server = self.serve()
        server.stop()
        waits = {"an opening": lambda: self.open(endpoint=server.endpoint, connect_deadline=60.0),
                 "a connection": lambda: self.open(endpoint="ipc:///nowhere/at/all", connect_deadline=60.0),
                 "an endpoint file": lambda: self.open(endpoint="file:///nowhere/at/all", connect_deadline=60.0)}
        for name, call in waits.items():
            begun = time.monotonic()
            threading.Timer(0.3, os.kill, (os.getpid(), signal.SIGINT)).start()
            with self.assertRaises(KeyboardInterrupt, msg=name):
                call()
            self.assertLess(time.monotonic() - begun, 5, name)
        server.go()

    def test_a_signal_whose_handler_returns_ends_nothing(self):
        server, came = self.serve(), []
        bus = self.open(endpoint=server.endpoint)
        before = signal.signal(signal.SIGUSR1, lambda *_: came.append(1))
        self.addCleanup(signal.signal, signal.SIGUSR1, before)
        server.stop()
        for wait in (0.1, 0.2, 0.3):
            threading.Timer(wait, os.kill, (os.getpid(), signal.SIGUSR1)).start()
        threading.Timer(0.6, server.go).start()
        self.assertEqual(bus.step(1e-9, **self.STEP).state_version, 1)
        self.assertIn(len(came), (1, 2, 3), "signals of one kind that wait for a process become one")

    def test_a_library_that_is_not_there_or_is_another_is_told_in_a_sentence(self):
        program = "import shearbus, shearbus.conformity; shearbus.open('x.toml', nodes=[1])"
        other = self.path / "libshearbus.so.1"
        source = "const char* shearbus_version(void) { return \"0.0.9\"; }\n"

        def told(library):
            return self.run_program(sys.executable, "-B", "-c", program, env={**os.environ, "SHEARBUS_LIBRARY": str(library)}, code=1).stderr.splitlines()[-1]

        for names, text in (((), "is older than this package"), (FUNCTIONS, "is version 0.0.9, and this package is")):
            lines = [source, *(f"void shearbus_{name}(void) {{}}" for name, *_ in names if name != "version")]
            self.run_program("cc", "-shared", "-fPIC", "-x", "c", "-", "-o", other, input="\n".join(lines))
            self.assertIn(text, told(other))
        self.run_program("cc", "-shared", "-fPIC", "-x", "c", "-", "-o", other, input="int other;")
        self.assertIn("it is another library", told(other))
        self.assertRegex(told("/nowhere"), "LibraryError.*cannot be loaded: /nowhere.*SHEARBUS_LIBRARY")


class Manners(Live):
    """Arguments of a wrong type or value, and how things show themselves."""

    def test_arguments_of_wrong_types_and_values_are_refused_by_name(self):
        bus = self.open()
        for kind, call, field in (
                (TypeError, lambda: bus.step(True, **drive(1, 2, 3)), "dt"),
                (TypeError, lambda: bus.step("1e-9", **drive(1, 2, 3)), "dt"),
                (TypeError, lambda: bus.step(1e-9, time=None, **drive(1, 2, 3)), "time"),
                (TypeError, lambda: bus.step(1e-9, step=1.5, **drive(1, 2, 3)), "step"),
                (TypeError, lambda: bus.step(1e-9, attempt=True, **drive(1, 2, 3)), "attempt"),
                (ValueError, lambda: bus.step(1e-9, step=-1, **drive(1, 2, 3)), "step"),
                (ValueError, lambda: bus.step(1e-9, attempt=2**32, **drive(1, 2, 3)), "attempt"),
                (ValueError, lambda: self.open(threads=2**32), "threads"),
                (ValueError, lambda: bus.step(1e-9, absent_nodes="cool", **drive(1, 2, 3)), "absent_nodes"),
                (TypeError, lambda: bus.mark(b"dump"), "name"),
                (ValueError, lambda: bus.mark("a\0b"), "name"),
                (TypeError, lambda: bus.accept("x" * 16), "transfer"),
                (ValueError, lambda: bus.accept(b"x" * 15), "transfer"),
                (TypeError, lambda: self.open(reply_deadline="5"), "reply_deadline"),
                (ValueError, lambda: self.open(reply_deadline=-1), "reply_deadline"),
                (ValueError, lambda: self.open(connect_deadline=float("nan")), "connect_deadline"),
                (TypeError, lambda: self.open(retry_after=True), "retry_after"),
                (TypeError, lambda: self.open(endpoint=7), "endpoint"),
                (TypeError, lambda: self.open(endpoint=b"ipc:///x"), "endpoint"),
                (TypeError, lambda: self.open(domain=b"run"), "domain"),
                (TypeError, lambda: self.open(name=3), "name"),
                (TypeError, lambda: self.open(idle_limit=1.5), "idle_limit"),
                (TypeError, lambda: self.open(pair=[b"weak"] * 3), "pair"),
                (ValueError, lambda: self.open(check_closure="maybe"), "check_closure"),
                (TypeError, lambda: self.open(idle_limt=1), "idle_limt")):
            with self.assertRaises(kind) as caught:
                call()
            self.assertIsInstance(caught.exception, shearbus.MessageError)
            self.assertEqual(caught.exception.field, field)
        with self.assertRaisesRegex(shearbus.WrongType, r"open\(\) has no argument 'endpont'; did you mean \"endpoint\"\?"):
            shearbus.open(VELOCITY_DRIVEN, [1], endpont="ipc:///x")
        for ticket in (bus.ticket.encode(), bus.ticket.upper()):
            self.assert_refused(shearbus.SessionError, "RESUME_REFUSED", lambda: shearbus.resume(ticket, OPTIONS.endpoint), "ticket")

    def test_a_step_tells_its_signature(self):
        named = inspect.signature(shearbus.Session.step).parameters
        self.assertEqual((list(named)[:3], named["absent_nodes"].default), (["self", "dt", "nodes"], "keep"))
        self.assertNotIn("commit_previous", named)
        self.assertIn("commit_previous", inspect.signature(shearbus.Session.trial).parameters)

    def test_modules_tell_their_names_and_nothing_else(self):
        self.assertFalse({"numpy", "os", "pathlib"} & set(dir(shearbus)))
        for module in (shearbus, shearbus.columns, shearbus.errors, *(importlib.import_module(f"shearbus.{name}")
                                                                      for name in ("answer", "history", "scene", "session"))):
            self.assertTrue(module.__all__ and all(hasattr(module, name) for name in module.__all__), module)

    def test_sessions_answers_and_histories_show_themselves(self):
        bus = self.open(record=True, nodes=range(30))
        self.assertRegex(repr(bus.history), "History of no steps")
        answer = bus.step(1e-9, jump=numpy.linspace(1, 100, 30), pressure=11.2e9)
        self.assertRegex(repr(answer), r"Answer of 30 nodes.*\n  stress +\[.*\.\.\..*\] \[Pa\]\n")
        self.assertRegex(repr(bus.history), r"1 steps of 30 nodes(.*\n)+  jump \[m/s\] +1 to 100\n")
        self.assertIn("30 nodes, at ", repr(bus))
        for one, text in ((answer, "<th>stress [Pa]</th>"), (bus.history, "<td>jump [m/s]</td><td>1</td>"), (bus, "<td>velocity_driven</td>")):
            self.assertIn(text, one._repr_html_())
        self.assertIn("temperature", dir(answer))
        self.assertNotIn("interface_work", dir(answer))

    def test_doubts_of_the_scene_are_told_at_the_opening(self):
        sound = (EXAMPLES / "constant_friction.toml").read_text()
        swapped = sound.replace("[soft]", "[other]").replace("[hard]", "[soft]").replace("[other]", "[hard]")
        for scene, told in ((sound, []), (VELOCITY_DRIVEN, []), (swapped, ["the layer that flows should be the weaker body"])):
            with warnings.catch_warnings(record=True) as caught:
                warnings.simplefilter("always")
                bus = self.open(scene)
            self.assertEqual([(w.category, str(w.message), pathlib.Path(w.filename).name) for w in caught],
                             [(shearbus.SceneWarning, text, "python_client.py") for text in bus.warnings if told and not text.startswith("note: ")])
            self.assertEqual(len(caught), len(told))
            for warning, text in zip(caught, told):
                self.assertIn(text, str(warning.message))

    def test_columns_of_any_layout_have_the_bits_of_plain_ones(self):
        """Few rows are copied, many are read where they lie; both in any order and step."""
        for count in (5, 3000):
            for scene in (VELOCITY_DRIVEN, TWO_COMPONENTS):
                width = 2 if scene is TWO_COMPONENTS else 1
                plain, other = self.open(scene, range(count)), self.open(scene, range(count))
                jump = numpy.linspace(-100, 100, count * width).reshape(count, width)
                jump = jump if width == 2 else jump[:, 0]
                pressure = numpy.linspace(1e9, 2e9, count)
                x = plain.step(1e-9, jump=jump, pressure=pressure)
                y = other.step(1e-9, jump=numpy.asfortranarray(jump[::-1])[::-1], pressure=numpy.repeat(pressure, 3)[::3])
                for name in x.columns:
                    numpy.testing.assert_array_equal(getattr(x, name), getattr(y, name))
                    self.assertFalse(getattr(y, name).flags.writeable)
                constant = numpy.broadcast_to(numpy.float64(1e9), (count,))
                x, y = (bus.step(1e-9, jump=jump, pressure=p) for bus, p in ((plain, 1e9), (other, constant)))
                numpy.testing.assert_array_equal(x.temperature, y.temperature)
                pressure[count // 2] = numpy.nan
                self.assert_refused(shearbus.ContentError, "INVALID_VALUE",
                                    lambda: other.step(1e-9, jump=jump, pressure=pressure), "pressure", [count // 2])
                self.assertEqual(other.rollback(), 2)


class Keys(Live):
    """Against a server on tcp with keys."""

    def open(self, **options):
        return super().open(connect_deadline=20.0, **options)  # a wrong key shows after three handshakes

    def test_a_client_with_the_right_keys_is_served(self):
        bus = self.open(server_key_file=OPTIONS.server_key, secret_key_file=OPTIONS.key)
        self.assertEqual((bus.welcome.access, len(bus.step(1e-9, **drive(1, 2, 3)).stress)), ("key", 3))

    def test_a_client_without_or_with_other_keys_is_refused(self):
        self.run_program(OPTIONS.ctl, "keygen", self.path / "other")
        others_public, others_secret = self.path / "other.public", self.path / "other.secret"

        def refused(text, server_key_file=OPTIONS.server_key, **options):
            return self.assert_refused(shearbus.AuthError, "AUTH", lambda: self.open(server_key_file=server_key_file, **options), text=text)

        self.assert_refused(shearbus.AuthError, "AUTH", self.open, text="expects clients with keys")
        fault = refused("does not admit this client's key", secret_key_file=others_secret)
        self.assertIn(others_public.read_text().split()[0], fault.remedy)
        refused("handshake", others_public, secret_key_file=OPTIONS.key)
        others_secret.chmod(0o644)
        refused("0600", secret_key_file=others_secret)
        refused("", secret_key_file="/nowhere")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("server", "ctl", "replay", "server-key", "key"):
        parser.add_argument(f"--{name}")
    for name in ("SHEARBUS_ENDPOINT", "SHEARBUS_SCENE"):
        os.environ.pop(name, None)
    served.main("endpoint", "source", parser=parser)
