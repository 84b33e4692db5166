#!/usr/bin/python3
"""The MPI helpers on ranks of this machine: mpi.py --mpiexec MPIEXEC --server SHEARBUS_SERVER --program PROGRAM
    --fortran PROGRAM --scene SCENE.toml

The answers of a run have the same md5 on 1, 2, 3 and 4 ranks, with nodes that move between the ranks, after a kill -9 of the server in
mid-run, after a restart on other numbers of ranks, and with one session on root for all ranks."""
import argparse
import hashlib
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import time

RUN_S = 100.0
STEP_BYTES = 24 * 24  # of 24 nodes


class Server:
    """A durable server, which can be killed and started again."""

    def __init__(self, program, directory):
        self.program, self.directory = program, pathlib.Path(directory)
        self.socket = self.directory / "bus"
        self.endpoint = f"ipc://{self.socket}"
        self.start()

    def start(self):
        self.socket.unlink(missing_ok=True)
        self.process = subprocess.Popen([self.program, "--bind", self.endpoint, "--state-dir", str(self.directory / "state"),
                                         "--log-level", "off"])
        while not self.socket.exists():
            if self.process.poll() is not None:
                sys.exit(f"the server ended with {self.process.returncode}")
            time.sleep(0.01)

    def kill(self):
        self.process.kill()
        self.process.wait()


def mpiexec(program, ranks):
    """Returns the command of `ranks` processes on this machine, which needs no network interface but the loopback."""
    words = [program, "-n", str(ranks)]
    if re.search("Open MPI|OpenRTE", subprocess.run([program, "--version"], capture_output=True, text=True).stdout):
        words += ["--oversubscribe"] + ["--allow-run-as-root"] * (os.geteuid() == 0)
        for name, value in (("btl", "self,vader"), ("btl_vader_single_copy_mechanism", "none"), ("oob_tcp_if_include", "lo"),
                            ("plm", "isolated"), ("mpi_yield_when_idle", "1"), ("hwloc_base_binding_policy", "none")):
            words += ["--mca", name, value]
    return words


def run(options, ranks, *words, program=None, server=None, dies=False):
    """Runs the program; where it pauses, kills the server and starts it again while ranks are stepping."""
    process = subprocess.Popen([*mpiexec(options.mpiexec, ranks), program or options.program, options.scene, *map(str, words)], text=True,
                               stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE)
    try:
        if server is not None:
            line = process.stdout.readline()
            if line != "paused\n":
                sys.exit(f"{words} did not pause: {line!r} {process.stderr.read()[-3000:]}")
            time.sleep(0.1)  # the other ranks go on until they need rank 0
            server.kill()
            server.start()
            process.stdin.write("\n")
            process.stdin.flush()
        out, err = process.communicate(timeout=RUN_S)
    finally:
        process.kill()
    if (process.returncode == 0) == dies:
        sys.exit(f"{words} on {ranks} ranks ended with {process.returncode}:\n{out[-3000:]}{err[-3000:]}")
    return out


def answers(directory):
    parts = sorted(pathlib.Path(directory).glob("answers.*"), key=lambda part: int(part.suffix[1:]))
    data = b"".join(part.read_bytes() for part in parts)
    for part in parts:
        part.unlink()
    return f"{hashlib.md5(data).hexdigest()} of {len(data)} bytes"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--mpiexec", required=True)
    parser.add_argument("--server", required=True)
    parser.add_argument("--program", required=True)
    parser.add_argument("--fortran", required=True, help="the program that tests the Fortran module")
    parser.add_argument("--scene", required=True)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="shearbus-") as directory:
        server = Server(options.server, directory)
        try:
            found = {}
            where = (server.endpoint, directory, "run")
            run(options, 3, server.endpoint, directory, "errors")
            run(options, 3, server.endpoint, directory, program=options.fortran)
            for ranks in (1, 2, 3, 4):
                run(options, ranks, *where, 0, 40, "open")
                found[f"{ranks} ranks"] = answers(directory)
            run(options, 3, *where, 0, 40, "open", "pause=24", server=server)
            found["3 ranks, server killed while nodes move"] = answers(directory)
            # Two restarts from one dump, since the first died before the next dump; then others from the next.
            run(options, 3, *where, 0, 24, "open", "dump=20", "die", dies=True)
            run(options, 2, *where, 20, 26, "restart", "die", dies=True)
            run(options, 4, *where, 20, 35, "restart", "die", dies=True)
            run(options, 1, *where, 20, 34, "restart", "dump=30", "die", dies=True)
            run(options, 4, *where, 30, 40, "restart")
            for start in (0, 20):  # the steps before the dump of each part
                part = pathlib.Path(directory, f"answers.{start}")
                part.write_bytes(part.read_bytes()[:(20 if start == 0 else 10) * STEP_BYTES])
            found["3, 2, 4, 1 and 4 ranks, restarted"] = answers(directory)
            for ranks, endpoint in ((1, server.endpoint), (3, server.endpoint), (4, "embedded")):
                run(options, ranks, endpoint, directory, "run", 0, 40, "root")
                found[f"{ranks} ranks, one session, {'embedded' if endpoint == 'embedded' else 'server'}"] = answers(directory)
            for name, answer in found.items():
                print(f"{answer}: {name}")
            if len(set(found.values())) != 1 or f" of {40 * STEP_BYTES} bytes" not in found["1 ranks"]:
                sys.exit("the answers differ")
        finally:
            server.kill()


if __name__ == "__main__":
    main()
