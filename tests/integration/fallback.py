"""The host's own law in Python, while the server is gone: flagged, counted, and only where the user allows it."""
import os
import pathlib
import signal
import sys
import time

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
import shearbus  # noqa: E402
from served import EXAMPLES, OPTIONS  # noqa: E402

SCENE = EXAMPLES / "constant_friction.toml"
INPUTS = {"jump": 100.0, "pressure": np.array([1e8, 2e8, 3e8]), "stress_soft": 0.0, "stress_hard": 0.0, "mass_soft": 4e-3, "mass_hard": 12e-3}


def law(inputs, outputs):
    outputs["stress"][:] = 0.2 * inputs["pressure"]
    outputs["temperature"][:] = 300.0


class Fallback(served.Served):
    def setUp(self):
        super().setUp()
        self.addCleanup(os.environ.pop, "SHEARBUS_FALLBACK", None)
        self.serve()

    def serve(self):
        self.server = served.serve(self, self.log(), OPTIONS.server, "--bind", self.bus, "--state-dir", self.path / "state")

    def kill(self):
        self.server.send_signal(signal.SIGKILL)
        self.server.wait()

    def open(self, **more):
        return shearbus.open(SCENE, nodes=[1, 2, 3], endpoint=f"ipc://{self.path}/bus", check_closure="off", retry_after=0.2, **more)

    def test_the_law_answers_and_is_counted(self):
        os.environ["SHEARBUS_FALLBACK"] = "0.2"
        with self.open() as bus:
            bus.set_fallback(law)
            first = bus.step(1e-9, **INPUTS)
            self.assertTrue(bus.fallbacks.allowed and bus.fallbacks.steps == 0)
            self.kill()
            with self.assertLogs("shearbus", "WARNING") as said:
                for _ in range(3):
                    alone = bus.step(1e-9, **INPUTS)
                    np.testing.assert_array_equal(alone.stress, 0.2 * INPUTS["pressure"])
                    self.assertTrue((alone.outcome == shearbus.Outcome.FALLBACK).all() and alone.flagged_nodes == 3)
                self.serve()
                while alone.outcome[0] == shearbus.Outcome.FALLBACK:
                    alone = bus.step(1e-9, **INPUTS)
                    time.sleep(0.01)
            np.testing.assert_allclose(alone.stress, first.stress)
            counts = bus.fallbacks
            self.assertTrue(counts.steps >= 3 and counts.node_steps == 3 * counts.steps and counts.absences == 1)
            self.assertRegex("\n".join(said.output), r"(?s)answers instead of the server.*answers again; the host's own law has answered")

    def test_what_the_law_leaves_is_nan_and_the_count_outlives_the_law(self):
        os.environ["SHEARBUS_FALLBACK"] = "0.2"
        for end in ("close", "leave", "collected"):
            with self.subTest(end=end), self.assertLogs("shearbus", "WARNING") as said:
                bus = self.open(want="ledger")
                bus.step(1e-9, **INPUTS)
                self.server.send_signal(signal.SIGSTOP)  # the outcome of the first step stays unknown
                for factor in (0.2, 0.3):
                    def stress_alone(inputs, outputs, factor=factor):
                        outputs["stress"][:] = factor * inputs["pressure"]

                    bus.set_fallback(stress_alone)
                    for rows in ([1, 2, 3], [1, 3]):
                        alone = bus.step(1e-9, nodes=rows, **{**INPUTS, "pressure": INPUTS["pressure"][np.array(rows) - 1]})
                        np.testing.assert_array_equal(alone.stress, factor * INPUTS["pressure"][np.array(rows) - 1])
                        self.assertTrue(np.isnan(alone.temperature).all() and np.isnan(alone.heat_to_soft).all())
                        self.assertFalse(alone.regime.any())
                bus.set_fallback(None)
                counts = bus.fallbacks
                self.assertEqual((counts.steps, counts.node_steps, counts.absences, counts.allowed), (4, 10, 1, False))
                self.kill()
                self.serve()
                if end == "collected":
                    del bus
                else:
                    getattr(bus, end)()
            summaries = [line for line in said.output if "of this session the host's own law answered 4 steps" in line]
            self.assertEqual(len(summaries), 1, said.output)

    def test_a_law_that_raises_ends_the_step(self):
        os.environ["SHEARBUS_FALLBACK"] = "0.2"
        bus = self.open()
        bus.set_fallback(lambda inputs, outputs: outputs["no such column"])
        self.kill()
        with self.assertRaisesRegex(KeyError, "no such column"):
            bus.step(1e-9, **INPUTS)
        self.serve()
        bus.step(1e-9, **INPUTS)
        bus.close()

    def test_without_permission_the_step_fails(self):
        bus = self.open(reply_deadline=0.3)
        bus.set_fallback(law)
        self.assertFalse(bus.fallbacks.allowed)
        self.kill()
        with self.assertRaises((shearbus.UnknownOutcome, shearbus.Unreachable)):
            bus.step(1e-9, **INPUTS)
        self.assertEqual(bus.fallbacks.steps, 0)
        bus.leave()

    def test_a_trial_waits_for_the_server(self):
        os.environ["SHEARBUS_FALLBACK"] = "0.2"
        bus = self.open(reply_deadline=0.3)
        bus.set_fallback(law)
        self.kill()
        with self.assertRaises((shearbus.UnknownOutcome, shearbus.Unreachable)):
            bus.trial(1e-9, **INPUTS)
        bus.leave()


if __name__ == "__main__":
    served.main()
