#!/usr/bin/python3
"""The MPI helpers on ranks of this machine: mpi.py --mpiexec MPIEXEC --server SHEARBUS_SERVER --program PROGRAM
    --fortran PROGRAM --scene SCENE.toml   (--fortran: the program that tests the Fortran module)"""
import hashlib
import os
import pathlib
import re
import subprocess
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import OPTIONS

STEP_BYTES = 24 * 24  # of 24 nodes


def mpiexec(program, ranks):
    """Returns the command of `ranks` processes on this machine, which needs no network interface but the loopback."""
    words = [program, "-n", str(ranks)]
    if re.search("Open MPI|OpenRTE", subprocess.run([program, "--version"], capture_output=True, text=True).stdout):
        words += ["--oversubscribe"] + ["--allow-run-as-root"] * (os.geteuid() == 0)
        for name, value in (("btl", "self,vader"), ("btl_vader_single_copy_mechanism", "none"), ("oob_tcp_if_include", "lo"),
                            ("plm", "isolated"), ("mpi_yield_when_idle", "1"), ("hwloc_base_binding_policy", "none")):
            words += ["--mca", name, value]
    return words


class Ranks(served.Served):
    def run_ranks(self, ranks, *words, program=None, server=None, dies=False):
        """Runs the program; where it pauses, kills the server and starts it again while ranks are stepping."""
        process = served.program(self, *mpiexec(OPTIONS.mpiexec, ranks), program or OPTIONS.program, OPTIONS.scene, *words,
                                 stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        if server is not None:
            self.assertEqual(process.stdout.readline(), "paused\n")
            time.sleep(0.1)  # the other ranks go on until they need rank 0
            server.end()
            server.start()
            process.stdin.write("\n")
            process.stdin.flush()
        out, err = process.communicate(timeout=100)
        self.assertEqual(process.returncode != 0, dies, f"{words} on {ranks} ranks ended with {process.returncode}:\n{out[-3000:]}{err[-3000:]}")

    def answers(self):
        parts = sorted(self.path.glob("answers.*"), key=lambda part: int(part.suffix[1:]))
        data = b"".join(part.read_bytes() for part in parts)
        for part in parts:
            part.unlink()
        return f"{hashlib.md5(data).hexdigest()} of {len(data)} bytes"

    def test_answers_have_the_same_sum_on_any_number_of_ranks_through_moves_kills_and_restarts(self):
        server = served.Server(self, self.path)
        found = {}
        where = (server.endpoint, self.path, "run")
        self.run_ranks(3, server.endpoint, self.path, "errors")
        self.run_ranks(3, server.endpoint, self.path, program=OPTIONS.fortran)
        for ranks in (1, 2, 3, 4):
            self.run_ranks(ranks, *where, 0, 40, "open")
            found[f"{ranks} ranks"] = self.answers()
        self.run_ranks(3, *where, 0, 40, "open", "pause=24", server=server)
        found["3 ranks, server killed while nodes move"] = self.answers()
        # Two restarts from one dump, since the first died before the next dump; then others from the next.
        self.run_ranks(3, *where, 0, 24, "open", "dump=20", "die", dies=True)
        self.run_ranks(2, *where, 20, 26, "restart", "die", dies=True)
        self.run_ranks(4, *where, 20, 35, "restart", "die", dies=True)
        self.run_ranks(1, *where, 20, 34, "restart", "dump=30", "die", dies=True)
        self.run_ranks(4, *where, 30, 40, "restart")
        for start in (0, 20):  # the steps before the dump of each part
            part = self.path / f"answers.{start}"
            part.write_bytes(part.read_bytes()[:(20 if start == 0 else 10) * STEP_BYTES])
        found["3, 2, 4, 1 and 4 ranks, restarted"] = self.answers()
        for ranks, endpoint in ((1, server.endpoint), (3, server.endpoint), (4, "embedded")):
            self.run_ranks(ranks, endpoint, self.path, "run", 0, 40, "root")
            found[f"{ranks} ranks, one session, {'embedded' if endpoint == 'embedded' else 'server'}"] = self.answers()
        self.assertEqual(len(set(found.values())), 1, found)
        self.assertIn(f" of {40 * STEP_BYTES} bytes", found["1 ranks"])


if __name__ == "__main__":
    served.main("mpiexec", "server", "program", "fortran", "scene")
