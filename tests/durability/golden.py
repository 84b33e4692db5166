"""Files of earlier versions in tests/golden/versions: this version must read them and go on as the version that wrote them would have.

  golden.py --server S --ctl C --replay R --source ROOT                  reads every version's files
  golden.py --server S --ctl C --replay R --source ROOT --write VERSION  writes this version's, once

Of each version: the states of a server that was stopped cleanly, and of one that was killed, whose journal has requests to replay; event
logs; a table of committed steps; and facts.json, with the tickets of the sessions and the answers to the next step of each."""
import argparse
import json
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time

import numpy as np

parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
for option in ("server", "ctl", "replay", "source"):
    parser.add_argument(f"--{option}", type=lambda path: pathlib.Path(path).resolve(), required=True)
parser.add_argument("--write", metavar="VERSION")
OPTIONS = parser.parse_args()
sys.path.insert(0, str(OPTIONS.source / "client" / "python"))
import shearbus  # noqa: E402

VERSIONS = OPTIONS.source / "tests" / "golden" / "versions"
NUMERICS = int(re.search(r"kNumericsVersion = (\d+)", (OPTIONS.source / "server/physics/numerics.hpp").read_text()).group(1))
# Answers of other numerics. A scene with a tolerance has them as right as it asks for, in temperature; its steps may be divided otherwise.
OTHER_NUMERICS_RTOL = {"divided": 2e-2, "velocity": 1e-6, "plastic": 1e-6}
PATIENCE_S = 60.0
NODES, STEPS, DT = 4, 6, 1e-9

CELLS = "[layer]\ncells = 12\ngrading = 1.5\n"
BODIES = '[soft]\nmaterial = "aluminium_dlp"\n[hard]\nmaterial = "steel_dlp"\n'
LAW = "[interface]\nfriction_coefficient = 0.2\nyield_strength_pa = 2e8\n"
SCENES = {
    "velocity": 'name = "velocity"\nstrategy = "velocity_driven"\n' + BODIES + CELLS,
    "plastic": 'name = "plastic"\nstrategy = "force_driven"\n' + BODIES + CELLS + LAW + "plastic_layer = true\n",
    "divided": 'name = "divided"\nstrategy = "velocity_driven"\ntolerance = 1e-2\n' + BODIES,
}


def columns(name, step):
    rng = np.random.default_rng([len(name), step])
    values = {"jump": rng.uniform(50.0, 300.0, NODES), "pressure": rng.uniform(1e9, 1e10, NODES)}
    if name == "plastic":
        values |= {"stress_soft": rng.uniform(0.0, 3e8, NODES), "stress_hard": rng.uniform(0.0, 3e8, NODES), "mass_soft": np.full(NODES, 0.02),
                   "mass_hard": np.full(NODES, 0.05)}
    return values


class Server:
    """A server on a state directory."""

    def __init__(self, work, states, *arguments):
        self.bus, self.log = f"ipc://{work / 'bus'}", work / "log"
        with open(self.log, "wb") as log:
            self.process = subprocess.Popen([OPTIONS.server, "--bind", self.bus, "--threads", "1", "--state-dir", states, *arguments],
                                            stdout=log, stderr=log)
        end = time.monotonic() + PATIENCE_S
        while "listening on" not in self.text() and self.process.poll() is None and time.monotonic() < end:
            time.sleep(0.02)

    def text(self):
        return self.log.read_text(errors="replace")

    def end(self, number):
        self.process.send_signal(number)
        return self.process.wait(timeout=PATIENCE_S)


def write(version):
    directory = VERSIONS / version
    directory.mkdir(parents=True)
    facts = {"version": version, "numerics": NUMERICS, "sessions": {}, "next": {}}
    with tempfile.TemporaryDirectory(prefix="shearbus-golden-") as scratch:
        work = pathlib.Path(scratch)
        server = Server(work, work / "states", "--record", work / "logs")
        sessions = {}
        for name, scene in SCENES.items():
            session = sessions[name] = shearbus.open(scene, nodes=range(NODES), endpoint=server.bus, check_closure="off", domain=name)
            for step in range(STEPS):
                if step == 2:
                    session.mark("dump")
                if step == 4:
                    subprocess.run([OPTIONS.ctl, "checkpoint", "--server", server.bus], check=True, stdout=subprocess.DEVNULL)
                with session.trial(DT, **columns(name, step)):
                    pass
            session.trial(DT, **columns(name, STEPS))  # a trial stands
            facts["sessions"][name] = session.ticket
            session.leave()
        server.end(signal.SIGKILL)
        shutil.copytree(work / "states", directory / "killed")
        server = Server(work, work / "states")
        server.end(signal.SIGTERM)
        shutil.copytree(work / "states", directory / "stopped")
        shutil.copytree(work / "logs", directory / "logs")
        facts["next"] = {name: {column: value.hex() for column, value in answer.items()}
                         for name, answer in next_answers(work, directory / "stopped", facts).items()}
    log = min((directory / "logs").glob("*.log"))
    subprocess.run([OPTIONS.replay, "export", log, "--out", directory / "table.h5"], check=True, stdout=subprocess.DEVNULL)
    (directory / "facts.json").write_text(json.dumps(facts, indent=1) + "\n")
    print(f"{directory}: {sum(file.stat().st_size for file in directory.rglob('*') if file.is_file()) / 1024:.0f} kB")


def next_answers(work, golden, facts):
    """Recovers a copy of the states, takes up each session and makes its next step. Returns the bytes of each column of each answer."""
    states = work / "copy"
    shutil.rmtree(states, ignore_errors=True)
    shutil.copytree(golden, states)
    states.chmod(0o700)
    server = Server(work, states)
    answers = {}
    try:
        for name, ticket in facts["sessions"].items():
            session = shearbus.resume(ticket, endpoint=server.bus, check_closure="off")
            session.commit()
            answer = session.step(DT, **columns(name, STEPS + 1))
            answers[name] = {column: np.asarray(getattr(answer, column)).tobytes() for column in answer.columns}
            session.rollback_to("dump")
            session.leave()
    except shearbus.Error as fault:
        raise AssertionError(f"{golden}: {fault}\n{server.text()}") from fault
    finally:
        server.end(signal.SIGTERM)
    return answers


def compare(golden, facts, answers):
    faults = []
    for name, expected in facts["next"].items():
        for column, text in expected.items():
            before, now = bytes.fromhex(text), answers[name].get(column)
            same = now == before
            if not same and now is not None and facts["numerics"] != NUMERICS and len(now) == len(before) == 8 * NODES:
                same = np.allclose(np.frombuffer(now), np.frombuffer(before), rtol=OTHER_NUMERICS_RTOL[name], atol=0.0)
            if not same:
                faults.append(f"{golden}: {column} of the next step of session {name} differs")
    return faults


def logs(directory, facts):
    """Yields the arguments that replay the event logs: all of them, or with other numerics each with its bound."""
    if facts["numerics"] == NUMERICS:
        yield [directory / "logs"]
        return
    for name, ticket in facts["sessions"].items():
        yield [directory / "logs" / f"session-{ticket[:16]}.log", "--rtol", str(OTHER_NUMERICS_RTOL[name])]


def read(directory):
    """Returns the faults of one version's files."""
    facts = json.loads((directory / "facts.json").read_text())
    faults = []
    with tempfile.TemporaryDirectory(prefix="shearbus-golden-") as scratch:
        work = pathlib.Path(scratch)
        faults += compare(directory / "stopped", facts, next_answers(work, directory / "stopped", facts))
        if facts["numerics"] == NUMERICS:
            faults += compare(directory / "killed", facts, next_answers(work, directory / "killed", facts))
        else:  # only the numerics that answered the requests of the journal may replay them
            states = work / "copy"
            shutil.rmtree(states)
            shutil.copytree(directory / "killed", states)
            states.chmod(0o700)
            server = Server(work, states)
            if server.process.poll() is None or f"numerics {facts['numerics']}" not in server.text():
                server.process.kill()
                faults.append(f"{directory / 'killed'}: is not refused by name: {server.text()[-500:]}")
        for arguments in (*logs(directory, facts), ["compare", directory / "table.h5", directory / "table.h5"]):
            done = subprocess.run([OPTIONS.replay, *arguments], cwd=work, capture_output=True, text=True, timeout=PATIENCE_S, check=False)
            if done.returncode != 0:
                faults.append(f"shearbus-replay {' '.join(map(str, arguments))}: {done.stdout[-500:]}{done.stderr[-500:]}")
    return faults


def main():
    if OPTIONS.write:
        write(OPTIONS.write)
        return 0
    versions = sorted(VERSIONS.iterdir()) if VERSIONS.exists() else []
    faults = [fault for directory in versions for fault in read(directory)]
    if not versions:
        faults.append(f"{VERSIONS} has no files of any version")
    print(*faults, f"{len(versions)} versions, {len(faults)} faults", sep="\n")
    return 1 if faults else 0


if __name__ == "__main__":
    sys.exit(main())
