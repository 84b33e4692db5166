"""Shared parts of the replay tests: a scratch directory, histories, and a run."""
import pathlib
import subprocess
import sys

import h5py
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import EXAMPLES, OPTIONS, PROBLEMS  # of the tests


class ReplayTest(served.Served):
    def setUp(self):
        super().setUp()
        self.history = self.path / "history.h5"
        self.out = self.path / "result.h5"

    def tool(self, program, *arguments, code=0, **more):
        """Runs a program, named as in OPTIONS, that must end with this code. Returns what it printed."""
        done = self.run_program(getattr(OPTIONS, program), *arguments, code=code, **more)
        return done.stdout + done.stderr

    def ran(self, program, *arguments, **options):
        """Runs a program, named as in OPTIONS, to any end. Returns it."""
        options = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE, "timeout": 120, **options}
        return subprocess.run([getattr(OPTIONS, program), *map(str, arguments)], check=False, text=True, errors="replace", **options)

    def replay(self, *arguments, history=None, scene=EXAMPLES / "paper_velocity_driven_graded.toml", out=True):
        return self.ran("replay", history or self.history, "--scene", scene, *(("--out", self.out) if out else ()), *arguments)

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


def velocity_history(steps=5, nodes=3, **changes):
    parts = {
        "time": 1e-9 * np.arange(1, steps + 1),
        "node_id": np.arange(10, 10 + nodes, dtype=np.uint64),
        "pressure": np.full((steps, nodes), 11.2e9),
        "velocity_jump": np.full((steps, nodes), 100.0),
    }
    return parts | changes


def force_history(steps=5, nodes=3, **changes):
    parts = velocity_history(steps, nodes, **{
        "stress_soft": np.zeros((steps, nodes)),
        "stress_hard": np.zeros((steps, nodes)),
        "mass_soft": np.full(nodes, 2.7),
        "mass_hard": np.full(nodes, 7.9),
        "initial_velocity_jump": np.linspace(20.0, 100.0, nodes),
    })
    del parts["velocity_jump"]
    return parts | changes
