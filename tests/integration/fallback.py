"""The host's own law in Python, while the server is gone: flagged, counted, and only where the user allows it. Needs --server and --source."""
import argparse
import os
import pathlib
import signal
import subprocess
import sys
import tempfile
import time
import unittest

import numpy as np

parser = argparse.ArgumentParser()
for option in ("server", "source"):
    parser.add_argument(f"--{option}", required=True)
OPTIONS, REST = parser.parse_known_args()
sys.path.insert(0, str(pathlib.Path(OPTIONS.source) / "client" / "python"))
import shearbus  # noqa: E402

SCENE = pathlib.Path(OPTIONS.source) / "client/examples/constant_friction.toml"
INPUTS = {"jump": 100.0, "pressure": np.array([1e8, 2e8, 3e8]), "stress_soft": 0.0, "stress_hard": 0.0, "mass_soft": 4e-3, "mass_hard": 12e-3}


def law(inputs, outputs):
    outputs["stress"][:] = 0.2 * inputs["pressure"]
    outputs["temperature"][:] = 300.0


class Fallback(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory(prefix="shearbus-fallback-")
        self.addCleanup(scratch.cleanup)
        self.path = pathlib.Path(scratch.name)
        self.addCleanup(os.environ.pop, "SHEARBUS_FALLBACK", None)
        self.serve()

    def serve(self):
        (self.path / "bus").unlink(missing_ok=True)
        self.server = server = subprocess.Popen([OPTIONS.server, "--bind", f"ipc://{self.path}/bus", "--state-dir", self.path / "state", "--log-level", "error"])
        self.addCleanup(server.wait)
        self.addCleanup(lambda: server.poll() is None and server.kill())
        while not (self.path / "bus").exists():
            self.assertIsNone(server.poll())
            time.sleep(0.02)

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
    unittest.main(argv=[sys.argv[0], *REST])
