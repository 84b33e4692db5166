"""Eight users at one server for minutes: five couple hosts, three are greedy or rude. Meanwhile the server and the users are killed with
SIGKILL, and the disk of the states fills up. Every answer of the five must have the bits that a server to which nothing happens gives.
In the last third nothing is killed: then the memory and the descriptors of the server must not grow.

Needs --server, --ctl and --source. --seconds: how long; --seed: of the histories and of the faults. As root the states are on a disk of
their own, made with unshare and tmpfs; otherwise no disk fills up, and the last line says so. Exit code 0: everything held."""
import argparse
import contextlib
import json
import os
import pathlib
import random
import shutil
import signal
import socket
import statistics
import subprocess
import sys
import tempfile
import time

import numpy as np
import zmq

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "client/report"))
from terminal import Parser, real_number, whole_number  # noqa: E402

parser = Parser(description=__doc__)
for option in ("server", "ctl", "source"):
    parser.add_argument(f"--{option}", type=pathlib.Path, required=True)
parser.add_argument("--seconds", type=real_number, default=1200.0)
parser.add_argument("--seed", type=whole_number, default=1)
parser.add_argument("--user", type=whole_number, help=argparse.SUPPRESS)  # a process of a user, started by the soak itself
parser.add_argument("--work", type=pathlib.Path, help=argparse.SUPPRESS)
OPTIONS = parser.parse_args()
sys.path.insert(0, str(OPTIONS.source / "client" / "python"))
import shearbus  # noqa: E402
from shearbus.errors import Code  # noqa: E402

HOSTS, USERS = 5, 8
DISK_MB = 96
PATIENCE_S = 120.0  # a server on a busy machine that is killed now and then
STEPS = 60
REMEMBERED = 4096  # kClosedSessionsKept (server/service/service.hpp)
DT = 1e-9
GROWTH, GROWTH_MB, GROWTH_FILES = 1.05, 4.0, 8  # allowed between the last two quarters of the quiet third

BODIES = '[soft]\nmaterial = "aluminium_dlp"\n[hard]\nmaterial = "steel_dlp"\n'
LAW = "[interface]\nfriction_coefficient = 0.2\nyield_strength_pa = 2e8\n"
SCENES = (
    'name = "velocity"\nstrategy = "velocity_driven"\n' + BODIES,
    'name = "force"\nstrategy = "force_driven"\n' + BODIES + LAW,
    'name = "divided"\nstrategy = "velocity_driven"\ntolerance = 1e-2\n' + BODIES,
    'name = "layer"\nstrategy = "force_driven"\n' + BODIES + LAW + "plastic_layer = true\n",
    'name = "weakening"\nstrategy = "force_driven"\n' + BODIES + LAW + 'friction_law = "velocity_weakening"\n'
    "friction_coefficient_fast = 0.05\nvelocity_decay_s_per_m = 0.1\n",
)
POISON = ('name = "poison"\nstrategy = "velocity_driven"\ntolerance = 1e-6\nwork_budget = 1e7\n[soft]\nmaterial = "copper_ofhc_jc"\n'
          '[hard]\nmaterial = "steel_dlp"\n[layer]\nfar_boundary = "half_space"\n')


def connection(work, user):
    return {"endpoint": f"file://{work / 'endpoint'}", "key": str(work / f"user{user}.secret"), "name": f"user{user}",
            "reply_deadline": PATIENCE_S, "connect_deadline": PATIENCE_S, "retry_after": 0.5, "check_closure": "off"}


def columns(scene, rng, nodes):
    """The inputs of one step: impacts, sliding to and fro, and contact that opens."""
    values = {"jump": rng.uniform(-300.0, 300.0, nodes), "pressure": rng.uniform(-5e8, 1e10, nodes)}
    if "force_driven" in scene:
        values |= {"stress_soft": rng.uniform(-3e8, 3e8, nodes), "stress_hard": rng.uniform(-3e8, 3e8, nodes),
                   "mass_soft": np.full(nodes, 0.02), "mass_hard": np.full(nodes, 0.05)}
    return values


def bits(answer):
    return {name: np.asarray(getattr(answer, name)).tobytes() for name in answer.columns}


def run_history(session, scene, seed, told):
    """Makes the steps of a seed, as trials that are kept or dropped, with marks and new nodes. Yields the bits of each answer."""
    rng = np.random.default_rng(seed)
    for step in range(STEPS):
        values = columns(scene, rng, len(session.nodes))
        kind = rng.integers(10)
        if kind == 0:
            insist(lambda: session.mark("dump"), told)
        if kind < 4:
            yield bits(insist(lambda: session.trial(DT, **values), told))
            insist(session.commit if kind else session.rollback, told)
        elif kind == 4 and step > 2:
            new = int(session.nodes.max()) + 1
            insist(lambda: session.register([new]), told)
        else:
            yield bits(insist(lambda: session.step(DT, **values), told))


def insist(call, told):
    """Makes a call until it is answered. A full disk and a deadline are reasons to make the same call again."""
    began = time.monotonic()
    while True:
        try:
            answer = call()
            told["longest_s"] = max(told["longest_s"], time.monotonic() - began)
            told["calls"] += 1
            return answer
        except shearbus.Error as fault:
            told["refusals"][fault.code.name] = told["refusals"].get(fault.code.name, 0) + 1
            if fault.code not in (Code.NO_SPACE, Code.UNKNOWN_OUTCOME, Code.UNREACHABLE, Code.SHUTTING_DOWN):
                raise
            if time.monotonic() - began > 2 * PATIENCE_S:
                raise
            time.sleep(0.1)


def host(work, user, seed, told):
    """Couples one session after the other; each is repeated with the calm server and compared."""
    ticket = work / f"user{user}.ticket"
    link = connection(work, user)
    if ticket.exists():  # this user was killed: its session stands where it was, and goes on
        try:
            session = insist(lambda: shearbus.resume(ticket.read_text(), **link), told)
            insist(session.rollback, told)
            insist(session.close, told)
        except shearbus.Error as fault:
            if fault.code != Code.UNKNOWN_SESSION:  # it was killed while it closed its session
                raise
        ticket.unlink()
        told["resumed"] += 1
    scene = SCENES[user]
    for number in range(1_000_000):
        nodes = np.arange(int(np.random.default_rng([seed, number]).integers(8, 300)))
        session = insist(lambda: shearbus.open(scene, nodes=nodes, **link), told)
        partial = ticket.with_suffix(".partial")
        partial.write_text(session.ticket)
        partial.rename(ticket)
        answers = list(run_history(session, scene, [seed, number], told))
        insist(session.close, told)
        ticket.unlink()
        with shearbus.open(scene, nodes=nodes, endpoint=f"ipc://{work / 'calm'}", check_closure="off") as calm:
            for at, (mine, expected) in enumerate(zip(answers, run_history(calm, scene, [seed, number], dict(TOLD)), strict=True)):
                for name, value in expected.items():
                    if mine[name] != value:
                        raise AssertionError(f"user {user}, seed {seed}, session {number}, answer {at}: {name} has other bits")
        told["sessions"] += 1
        told["answers"] += len(answers)
        write_told(work, user, seed, told)


def greedy(work, user, seed, told):
    """Takes all the sessions it can get, and leaves them to the server to be closed when idle. Before that it closes as many sessions as the
    server remembers of a user, so that its memory is full of them from then on."""
    closed = work / f"user{user}.closed"
    for number in range(int(closed.read_text()) if closed.exists() else 0, REMEMBERED):
        session = insist(lambda: shearbus.open(SCENES[0], nodes=range(8), idle_limit=10, **connection(work, user)), told)
        with contextlib.suppress(shearbus.SessionError):  # closed when idle, while the server was away
            insist(session.close, told)
        session.leave()
        closed.write_text(str(number + 1))
    while True:
        taken = []
        try:
            for _ in range(150):
                taken.append(shearbus.open(SCENES[0], nodes=range(8), idle_limit=10, **connection(work, user)))
        except shearbus.Error as fault:
            told["refusals"][fault.code.name] = told["refusals"].get(fault.code.name, 0) + 1
        told["sessions"] += len(taken)
        for session in taken:
            session.leave()
        write_told(work, user, seed, told)
        time.sleep(5.0)


def hard_work(work, user, seed, told):
    """Asks for steps that need more work than the server gives to a node."""
    while True:
        session = insist(lambda: shearbus.open(POISON, nodes=range(4), idle_limit=30, **connection(work, user)), told)
        answer = insist(lambda: session.step(1e-6, jump=np.linspace(100.0, 300.0, 4), pressure=np.full(4, 5e9)), told)
        told["answers"] += 1
        told["failed"] = told.get("failed", 0) + int(np.count_nonzero(answer.outcome & shearbus.Outcome.OVER_BUDGET))
        insist(session.close, told)
        write_told(work, user, seed, told)


def rude(work, user, seed, told):
    """Sends garbage, requests without reading the replies, and halves of conversations."""
    dice = random.Random(seed)
    context = zmq.Context()
    bind = (work / "bind").read_text()
    place, port = bind.removeprefix("tcp://").split(":")
    while True:
        try:
            if dice.random() < 0.5:
                with socket.create_connection((place, int(port)), timeout=1.0) as raw:
                    raw.sendall(dice.randbytes(dice.choice([1, 64, 4096])))
                    time.sleep(dice.uniform(0.0, 0.2))
            else:
                peer = context.socket(zmq.DEALER)
                peer.linger = 0
                peer.curve_publickey, peer.curve_secretkey = zmq.curve_keypair()
                peer.curve_serverkey = zmq.curve_keypair()[0]
                peer.connect(bind)
                for _ in range(dice.randrange(50)):
                    peer.send_multipart([dice.randbytes(dice.randrange(200)), b""], zmq.DONTWAIT)
                time.sleep(dice.uniform(0.0, 0.2))
                peer.close()
        except OSError:  # no server is listening at the moment
            time.sleep(0.2)
        told["answers"] += 1
        if told["answers"] % 20 == 0:
            write_told(work, user, seed, told)


TOLD = {"calls": 0, "sessions": 0, "answers": 0, "resumed": 0, "longest_s": 0.0}
ROLES = [host] * HOSTS + [greedy, hard_work, rude]


def write_told(work, user, seed, told):
    """Keeps what a process of a user has done, for the sum at the end."""
    file = work / f"told-{user}-{seed}"
    file.with_suffix(".partial").write_text(json.dumps(told))
    file.with_suffix(".partial").rename(file)


class Soak:
    """The server, its users, its disk, and what is done to them."""

    def __init__(self, work, full_disks):
        self.work, self.full_disks = work, full_disks
        self.dice = random.Random(OPTIONS.seed)
        self.lives, self.user_seed, self.kills, self.user_kills, self.disks = 0, 1000 * OPTIONS.seed, 0, 0, 0
        self.samples, self.faults = [], []
        self.disk = work / "disk"
        self.ballast = self.disk / "ballast"
        with socket.socket() as probe:
            probe.bind(("127.0.0.1", 0))
            self.bind = f"tcp://127.0.0.1:{probe.getsockname()[1]}"
        (work / "bind").write_text(self.bind)
        names = [*(f"user{user}" for user in range(USERS)), "operator"]
        for name in ("server", *names):
            as_operator = ["--operator"] if name == "operator" else []
            subprocess.run([OPTIONS.ctl, "keygen", *as_operator, work / name], check=True, stdout=subprocess.DEVNULL)
        (work / "authorized").write_text("".join((work / f"{name}.public").read_text() for name in names))
        self.calm = subprocess.Popen([OPTIONS.server, "--bind", f"ipc://{work / 'calm'}", "--threads", "1", "--log-level", "error"])
        self.server = None
        self.users = [None] * USERS

    def start_server(self):
        self.lives += 1
        with open(self.work / f"log{self.lives}", "wb") as log:
            self.server = subprocess.Popen(
                [OPTIONS.server, "--bind", self.bind, "--curve-secret", self.work / "server.secret", "--authorized-keys",
                 self.work / "authorized", "--endpoint-file", self.work / "endpoint", "--state-dir", self.disk / "states",
                 "--checkpoint-every", "7", "--checkpoint-after", "4", "--sessions-per-user", "100"], stdout=log, stderr=log)

    def start_user(self, user):
        self.user_seed += 1
        self.users[user] = subprocess.Popen(
            [sys.executable, "-B", __file__, "--server", OPTIONS.server, "--ctl", OPTIONS.ctl, "--source", OPTIONS.source, "--user",
             str(user), "--work", self.work, "--seed", str(self.user_seed)], stderr=open(self.work / f"user{user}.log", "ab"))

    def status(self):
        asked = subprocess.run([OPTIONS.ctl, "status", "--json", "--server", f"file://{self.work / 'endpoint'}", "--key",
                                self.work / "operator.secret", "--timeout", "20"], capture_output=True, text=True, check=False)
        return json.loads(asked.stdout) if asked.returncode == 0 else None

    def watch(self):
        """Starts again what has ended. A server ends by our kill, or because it found no room on its full disk."""
        code = self.server.poll()
        if code is not None:
            if code != -signal.SIGKILL and not self.ballast.exists():
                log = (self.work / f"log{self.lives}").read_text(errors="replace")
                self.faults.append(f"the server of life {self.lives} ended with {code}: {log[-1500:]}")
            self.start_server()
        for user, process in enumerate(self.users):
            code = process.poll() if process else None
            if code is not None and code != -signal.SIGKILL:
                self.faults.append(f"user {user} ended with {code}: {(self.work / f'user{user}.log').read_text()[-3000:]}")
            if process is None or code is not None:
                self.start_user(user)

    def fill_disk(self, until):
        """Leaves no room on the disk until a time."""
        self.disks += 1
        with contextlib.suppress(OSError), open(self.ballast, "wb", buffering=0) as ballast:
            while True:
                ballast.write(bytes(1 << 16))
        while time.monotonic() < until:
            time.sleep(0.05)
            self.watch()
        self.ballast.unlink(missing_ok=True)

    def run(self, seconds):
        began = time.monotonic()
        self.disk.mkdir()
        if self.full_disks:
            subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={DISK_MB}m,mode=0700", "tmpfs", self.disk], check=True)
        self.start_server()
        quiet_from = began + 2 * seconds / 3
        next_fault = began + 5.0
        while time.monotonic() < began + seconds and not self.faults:
            self.watch()
            now = time.monotonic()
            if now >= quiet_from:
                if status := self.status():
                    self.samples.append((now, status["resident_bytes"], status["open_files"], status["sessions"]))
                time.sleep(1.0)
            elif now >= next_fault:
                self.strike(now)
                next_fault = time.monotonic() + self.dice.uniform(1.0, 8.0)
            else:
                time.sleep(0.1)

    def strike(self, now):
        fault = self.dice.random()
        if fault < 0.5:
            self.kills += 1
            self.server.kill()
            self.server.wait()
        elif fault < 0.75 or not self.full_disks:
            self.user_kills += 1
            self.users[user := self.dice.randrange(USERS)].kill()
            self.users[user].wait()
        else:
            self.fill_disk(now + self.dice.uniform(0.5, 3.0))

    def end(self):
        for process in self.users:
            if process:
                process.kill()
                process.wait()
        if self.server and self.server.poll() is None and not self.faults:
            self.server.terminate()
            code = self.server.wait(timeout=PATIENCE_S)
            if code != 0:
                self.faults.append(f"the server ended with {code} when it was stopped")
        for process in (self.server, self.calm):
            if process and process.poll() is None:
                process.kill()
                process.wait()
        if self.full_disks:
            subprocess.run(["umount", self.disk], check=False)

    def report(self, seconds):
        told = [json.loads(file.read_text()) for file in self.work.glob("told-*") if file.suffix != ".partial"]
        refusals = {}
        for one in told:
            for name, count in one["refusals"].items():
                refusals[name] = refusals.get(name, 0) + count
        hosts = [json.loads(file.read_text()) for user in range(HOSTS) for file in self.work.glob(f"told-{user}-*")
                 if file.suffix != ".partial"]
        print(f"{seconds:.0f} s, seed {OPTIONS.seed}: {self.lives} lives of the server ({self.kills} kills), {self.user_kills} kills of users, "
              f"{self.disks} full disks{'' if self.full_disks else ' (none: not root)'}")
        print(f"hosts: {sum(h['sessions'] for h in hosts)} sessions, {sum(h['answers'] for h in hosts)} answers compared bit for bit, "
              f"{sum(h['resumed'] for h in hosts)} resumed after a kill; longest wait {max((h['longest_s'] for h in hosts), default=0.0):.1f} s")
        print(f"refusals: {', '.join(f'{name} {count}' for name, count in sorted(refusals.items())) or 'none'}")
        if not any(h["answers"] for h in hosts):
            self.faults.append("no host had an answer compared")
        self.judge_growth()
        for fault in self.faults:
            print("FAULT:", fault)
        return 1 if self.faults else 0

    def judge_growth(self):
        """Compares the last two quarters of the quiet third: after a kill the heap takes minutes until it is as fragmented as ever after."""
        kept = self.samples[len(self.samples) // 2 :]
        if len(kept) < 60:
            print(f"memory: not judged, {len(kept)} samples of the quiet third")
            return
        halves = kept[: len(kept) // 2], kept[len(kept) // 2 :]
        memory = [statistics.median(sample[1] for sample in half) / 2**20 for half in halves]
        files = [min(sample[2] for sample in half) for half in halves]
        print(f"memory: {memory[0]:.1f} MB, then {memory[1]:.1f} MB (medians); descriptors {files[0]}, then {files[1]} (lowest), of the last two "
              f"quarters of the quiet third, {len(kept)} samples")
        if memory[1] > GROWTH * memory[0] + GROWTH_MB:
            self.faults.append("the memory grows")
        if files[1] > files[0] + GROWTH_FILES:
            self.faults.append("the descriptors grow")


def main():
    if OPTIONS.user is not None:
        ROLES[OPTIONS.user](OPTIONS.work, OPTIONS.user, OPTIONS.seed, {**TOLD, "refusals": {}})
        return 0
    full_disks = os.geteuid() == 0 and shutil.which("unshare") is not None
    if full_disks and "SHEARBUS_SOAK_MOUNTS" not in os.environ:  # in a mount namespace of its own
        os.environ["SHEARBUS_SOAK_MOUNTS"] = "1"
        os.execvp("unshare", ["unshare", "--mount", sys.executable, "-B", *sys.argv])
    with tempfile.TemporaryDirectory(prefix="shearbus-soak-") as scratch:
        soak = Soak(pathlib.Path(scratch), full_disks)
        try:
            soak.run(OPTIONS.seconds)
        finally:
            soak.end()
        return soak.report(OPTIONS.seconds)


if __name__ == "__main__":
    sys.exit(main())
