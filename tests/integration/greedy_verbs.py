"""A user of ten nodes beside one who asks for much of every verb: the server gives no request more than a short turn
before it looks at the others."""
import argparse
import contextlib
import json
import pathlib
import signal
import subprocess
import sys
import time
import unittest

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
import shearbus  # noqa: E402

parser = argparse.ArgumentParser()
parser.add_argument("--neighbour", nargs=2, metavar=("ENDPOINT", "PID"), help="act as the user of ten nodes until an interrupt")
OPTIONS, REST = served.options(parser=parser)

PLAIN = served.scene("velocity_driven")
CELLS = "[layer]\ncells = 60\n"
NODES = 200_000
SETS = 4_000
# Processor time of one turn  [s], which a busy machine prolongs less than waits: up to 0.01 is usual. Before other requests
# had turns, they took 0.35 to 5.8 s; before tiles of few active lanes counted as whole ones, a step of 4,000 sets 0.05 to 0.09.
LONGEST_TURN_S = 0.05
# Processor time of the server's thread while the neighbour waited for one answer  [s]: what the wait takes on a machine
# that does nothing else, whatever else this one does. A turn of another, and the neighbour's own step.
LONGEST_WAIT_S = 0.08
# The longest wait of the neighbour, as a part of the time that the request took: without turns it is all of it.
PART_OF_REQUEST = 0.5
JITTER_S = 0.3  # of a busy machine


def neighbour(endpoint, pid):
    """Steps ten nodes until an interrupt, and prints when each answer that was long in coming was asked for, how long it
    took, and the processor time that the server's main thread had meanwhile  [s]."""
    def used():
        return 1e-9 * int(schedule.read_bytes().split()[0])

    schedule = pathlib.Path("/proc", pid, "schedstat")
    session = shearbus.open(PLAIN, range(10), endpoint, check_closure="off", reply_deadline=120.0)
    print("ready", flush=True)
    with contextlib.suppress(KeyboardInterrupt):
        while True:
            begun, used_before = time.monotonic(), used()
            session.step(1e-9, jump=np.full(10, 100.0), pressure=np.full(10, 5e9))
            waited = time.monotonic() - begun
            if waited > 0.005:
                print(begun, waited, used() - used_before, flush=True)
            time.sleep(0.002)


class Greedy(served.Served):
    def setUp(self):
        super().setUp()
        self.bus += "/s"
        self.failures, self.table = [], []

    def serve(self, *arguments):
        server = served.serve(self, self.log(), OPTIONS.server, "--bind", self.bus, "--threads", "1", *arguments)
        other = subprocess.Popen([sys.executable, "-B", __file__, "--build", OPTIONS.build, "--neighbour", self.bus, str(server.pid)],
                                 stdout=subprocess.PIPE, text=True)
        self.assertEqual(other.stdout.readline(), "ready\n")
        self.addCleanup(other.stdout.close)
        self.addCleanup(other.wait)
        self.addCleanup(other.kill)
        self.other, self.server = other, server

    def ctl(self, *arguments):
        done = subprocess.run([OPTIONS.ctl, *arguments, "--server", self.bus], capture_output=True, text=True, timeout=300,
                              check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout

    def longest_turn(self):
        """Processor time of the longest turn since the start of the server  [s]."""
        return json.loads(self.ctl("status", "--json"))["longest_turn_s"]

    @contextlib.contextmanager
    def asked(self, what):
        """Notes what the request in the block did to the neighbour."""
        begun = time.monotonic()
        yield
        ended = time.monotonic()
        self.table.append((what, begun, ended, self.longest_turn()))

    def judge(self):
        """Compares the waits of the neighbour with the requests during which they began."""
        self.other.send_signal(signal.SIGINT)
        whole = self.other.communicate(timeout=60)[0].rpartition("\n")[0]  # the signal may cut the last line
        waits = [tuple(map(float, line.split())) for line in whole.splitlines()]
        faults, longest = [], 0.0
        for what, begun, ended, turn in self.table:
            during = [(waited, used) for at, waited, used in waits if at < ended and at + waited > begun]
            wait, used = (max(column, default=0.0) for column in ([w for w, _ in during], [u for _, u in during]))
            print(f"{what:<44} {1e3 * (ended - begun):8.0f} ms, neighbour waited {1e3 * wait:6.0f} ms, at most {1e3 * used:5.1f} ms of "
                  f"processor, longest turn so far {1e3 * turn:6.1f} ms", flush=True)
            if used > LONGEST_WAIT_S:
                faults.append(f"{what}: the neighbour waited for {used:.3f} s of processor")
            if turn > max(longest, LONGEST_TURN_S):
                faults.append(f"{what}: a turn of {turn:.3f} s")
            if wait > PART_OF_REQUEST * (ended - begun) + JITTER_S:
                faults.append(f"{what}: the neighbour waited {wait:.3f} s of {ended - begun:.3f} s")
            longest = max(longest, turn)
        self.assertFalse(faults, "\n".join(faults))

    def open(self, scene, nodes, **options):
        return shearbus.open(scene, nodes, self.bus, check_closure="off", reply_deadline=600.0, **options)

    def test_no_verb_keeps_the_others_waiting(self):
        self.serve("--record", self.path / "logs", "--state-dir", self.path / "state", "--checkpoint-after", "1000000", "--checkpoint-every", "100000")
        ids = np.arange(NODES, dtype=np.uint64)
        half, rest = ids[::2], ids[1::2]
        with self.asked("opening 200,000 nodes"):
            session = self.open(PLAIN + CELLS, ids, domain="run")
        with self.asked("a step of 200,000 nodes"):
            session.step(1e-10, jump=np.full(NODES, 100.0), pressure=np.full(NODES, 5e9))
        with self.asked("a mark"):
            session.mark("first")
        with self.asked("a rollback to it"):
            session.rollback_to("first")
        with self.asked("profiles of 3,000 nodes"):
            session.profiles(ids[:3000])
        with self.asked("resuming"):
            ticket = session.ticket
            session.leave()
            session = shearbus.resume(ticket, self.bus, reply_deadline=600.0)
        with self.asked("retiring every second node"):
            session.retire(half)
        with self.asked("registering them again"):
            session.register(half)
        with self.asked("a rollback to other nodes"):
            session.rollback_to("first")
        with self.asked("opening an empty session in the domain"):
            other = self.open(PLAIN + CELLS, np.arange(NODES, NODES + 10, dtype=np.uint64), domain="run")
        with self.asked("an offer"):
            transfer = session.offer(rest)
        with self.asked("its acceptance"):
            other.accept(transfer)
        with self.asked("a mark in place of one"):
            session.mark("first")
        with self.asked("closing"):
            session.close()
            other.close()
        self.judge()

    def test_no_checkpoint_keeps_the_others_waiting(self):
        """A checkpoint of 200,000 nodes once held everybody for the time of a copy, 0.2 s, or of its writing, where an
        operator asked for it."""
        self.serve("--state-dir", self.path / "state", "--checkpoint-after", "1000000", "--checkpoint-every", "1")
        ids = np.arange(NODES, dtype=np.uint64)
        session = self.open(PLAIN + CELLS, ids)
        session.mark("first")

        def checkpoints():
            return json.loads(self.ctl("status", "--json"))["checkpoints"]

        def step():
            session.step(1e-10, jump=np.full(NODES, 100.0), pressure=np.full(NODES, 5e9))

        with self.asked("steps and checkpoints of their own accord"):
            last = checkpoints() + 3
            while checkpoints() < last:
                step()
        with self.asked("a checkpoint on demand"):
            self.ctl("checkpoint", "--timeout", "240")
        with self.asked("closing while a checkpoint is written"):
            step()
            time.sleep(1.0)
            session.close()
        self.judge()

    def test_no_scene_and_no_parameters_keep_the_others_waiting(self):
        self.serve()
        pairs = "".join(f'[pair.p{i}.soft]\nmaterial = "aluminium_dlp"\nyield_strength_pa = {20 + i}e6\n' for i in range(250))
        many = "".join(f'[pair.p{i}.soft]\nyield_strength_pa = 2e7\n' for i in range(5000))
        unknown = "".join(f"friction_koefficient_{i} = 1\n" for i in range(8_000))
        with self.asked("a scene of 250 pairs"):
            self.open(PLAIN + pairs, range(10)).close()
        for what, scene in (("5,000 pairs", PLAIN + many), ("8,000 unknown keys", unknown + PLAIN),
                            ("a line of 200,000 bytes", PLAIN + "x = [" + 100_000 * "1," + "1]\n")):
            with self.asked(what), self.assertRaises(shearbus.Error) as fault:
                self.open(scene, range(10))
            self.assertEqual(fault.exception.code, shearbus.Code.INVALID_SCENE)
        with self.asked("4,000 sets of parameters"):
            session = self.open(PLAIN, range(SETS), parameters={"soft.yield_strength_pa": np.linspace(2e7, 3e7, SETS)})
        with self.asked("a step of them"):
            session.step(1e-10, jump=np.full(SETS, 100.0), pressure=np.full(SETS, 5e9))
        with self.asked("registering 4,000 sets"):
            session.register(range(SETS, 2 * SETS), parameters={"soft.yield_strength_pa": np.linspace(3e7, 4e7, SETS)})
        with self.asked("closing them"):
            session.close()
        self.judge()


if __name__ == "__main__":
    if OPTIONS.neighbour:
        neighbour(*OPTIONS.neighbour)
    else:
        unittest.main(argv=[sys.argv[0], *REST])
