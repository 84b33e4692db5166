"""Shared parts of the replay tests: the programs, a scratch directory, histories, and a run."""
import argparse
import pathlib
import subprocess
import sys
import tempfile
import time
import unittest

import h5py
import numpy as np

EXAMPLES = pathlib.Path(__file__).resolve().parents[2] / "client" / "examples"
PROGRAMS = {"replay": None, "server": None, "hydro": None, "c_host": None, "fortran_host": None}


class ReplayTest(unittest.TestCase):
    def setUp(self):
        self._scratch = tempfile.TemporaryDirectory(prefix="shearbus-replay-")
        self.addCleanup(self._scratch.cleanup)
        self.path = pathlib.Path(self._scratch.name)
        self.history = self.path / "history.h5"
        self.out = self.path / "result.h5"

    def replay(self, *arguments, history=None, scene=EXAMPLES / "paper_velocity_driven_graded.toml", out=True):
        command = [PROGRAMS["replay"], str(history or self.history), "--scene", str(scene)]
        command += ["--out", str(self.out)] if out else []
        return subprocess.run([*command, *map(str, arguments)], capture_output=True, text=True, timeout=120, check=False)

    def result(self, *arguments, **options):
        """Runs a replay that must succeed. Returns its datasets as arrays, and its printed text as `text`."""
        run = self.replay(*arguments, **options)
        self.assertEqual(run.returncode, 0, run.stderr)
        with h5py.File(self.out) as file:
            values = {name: data[()] for name, data in file.items() if isinstance(data, h5py.Dataset)}
        values["text"] = run.stdout
        return values

    def example(self, kind, *arguments):
        subprocess.run([sys.executable, str(EXAMPLES / "make_history.py"), kind, str(self.history), *arguments], check=True)

    def write(self, **datasets):
        """Writes a history of the given datasets; t0 is the attribute of /time."""
        t0 = datasets.pop("t0", None)
        with h5py.File(self.history, "w") as file:
            for name, values in datasets.items():
                if values is not None:
                    file[name] = values
            if t0 is not None:
                file["time"].attrs["t0"] = t0


class Server:
    """A server of a host of the Python client, without durability."""

    def __init__(self):
        self._place = tempfile.TemporaryDirectory(prefix="shearbus-")
        bus = pathlib.Path(self._place.name, "bus")
        self.endpoint = f"ipc://{bus}"
        self._process = subprocess.Popen([PROGRAMS["server"], "--bind", self.endpoint, "--log-level", "error"])
        end = time.monotonic() + 30
        while not bus.exists() and self._process.poll() is None and time.monotonic() < end:
            time.sleep(0.005)

    def close(self):
        self._process.terminate()
        self._process.wait()
        self._place.cleanup()


def velocity_history(steps=5, nodes=3, **changes):
    parts = {
        "time": 1e-9 * np.arange(1, steps + 1),
        "node_id": np.arange(10, 10 + nodes, dtype=np.uint64),
        "pressure": np.full((steps, nodes), 11.2e9),
        "velocity_jump": np.full((steps, nodes), 100.0),
    }
    return parts | changes


def force_history(steps=5, nodes=3, **changes):
    parts = {
        "time": 1e-9 * np.arange(1, steps + 1),
        "node_id": np.arange(10, 10 + nodes, dtype=np.uint64),
        "pressure": np.full((steps, nodes), 11.2e9),
        "stress_soft": np.zeros((steps, nodes)),
        "stress_hard": np.zeros((steps, nodes)),
        "mass_soft": np.full(nodes, 2.7),
        "mass_hard": np.full(nodes, 7.9),
        "initial_velocity_jump": np.linspace(20.0, 100.0, nodes),
    }
    return parts | changes


def main():
    """replay_*.py --replay PROGRAM [--server PROGRAM] [--hydro PROGRAM] [--c_host PROGRAM] [--fortran_host PROGRAM] [unittest ...]"""
    parser = argparse.ArgumentParser()
    for program in PROGRAMS:
        parser.add_argument(f"--{program}")
    known, rest = parser.parse_known_args()
    PROGRAMS.update(vars(known))
    unittest.main(module="__main__", argv=[sys.argv[0], *rest])
