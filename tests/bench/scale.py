#!/usr/bin/python3
"""Measures how a server grows with the number of nodes, and what several servers bring.

scale.py --bin BUILD/bin [--nodes N ...] [--shards K ...] [--steps S] [--cells C ...] [--out FILE.json]

For each number of nodes one durable server with one solver thread: its memory against the formula of server/ARCHITECTURE.md, the time per
node-step against 10,000 nodes on the same server in alternation, the growth of the journal, and the time until the server is ready again after
kill -9, from the journal alone and from a checkpoint. For each number of shards the time of the same step, the numbers of shards in turn.
Times are of the fastest step of several, since other load of the machine only adds to them, and ratios are of the same run. Prints tables in
Markdown; --out gets the figures. The largest case needs 450 B per node of memory, and 800 B more while it writes a checkpoint."""
import contextlib
import json
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import time

import numpy

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[2] / room) for room in ("client/report", "tests/support")]
import served  # noqa: E402
from terminal import Parser, whole_number  # noqa: E402

OPTIONS = None
REFERENCE = 10_000  # nodes
LARGEST_SESSION, LARGEST_MESSAGE = 2_000_000, 200_000  # nodes, the limits of the contract
REPLY, FRAME = 42, 56  # bytes of a row of a reply, of which the kept one and an earlier one are there, and of the request at hand
NO_CHECKPOINTS = ("--checkpoint-every", "1e6", "--checkpoint-after", "1048576", "--checkpoint-work", "1e18")


class Server:
    """A durable server with one solver thread, which writes a checkpoint only where it is asked to."""

    def __init__(self, directory, name="server"):
        self.directory, self.states = pathlib.Path(directory, name), pathlib.Path(directory, f"{name}-states")
        self.directory.mkdir(mode=0o700)
        self.start()

    def start(self):
        """Starts the server and returns the seconds until it is ready."""
        self.log = self.directory / "log"
        (self.directory / "bus").unlink(missing_ok=True)
        begun = time.monotonic()
        with self.log.open("wb") as log:
            command = [OPTIONS.bin / "shearbus-server", "--bind", self.endpoint, "--threads", "1", "--state-dir", self.states, *NO_CHECKPOINTS]
            self.process = subprocess.Popen(list(map(str, command)), stderr=log)
        while b"ready" not in self.log.read_bytes() and b"listening" not in self.log.read_bytes():
            time.sleep(0.01)
        self.ctl("wait", "--timeout", "600")
        return time.monotonic() - begun

    @property
    def endpoint(self):
        return f"ipc://{self.directory}/bus"

    def ctl(self, verb, *rest):
        subprocess.run([OPTIONS.bin / "shearbus-ctl", verb, "--server", self.endpoint, *rest], check=True, stdout=subprocess.DEVNULL)

    def kill(self):
        self.process.kill()
        self.process.wait()

    def forget_peak(self):
        pathlib.Path(f"/proc/{self.process.pid}/clear_refs").write_text("5")

    def memory(self):
        """Returns the resident bytes of the process, and the most that there were since forget_peak()."""
        text = pathlib.Path(f"/proc/{self.process.pid}/status").read_text()
        return [1024 * int(re.search(rf"{key}:\s+(\d+)", text)[1]) for key in ("VmRSS", "VmHWM")]

    def bytes_of(self, pattern):
        return sum(file.stat().st_size for file in self.states.glob(pattern))


def columns(nodes, step):
    wave = numpy.arange(nodes) % 97
    return {"jump": 50.0 + wave + step, "pressure": 1e9 + 1e7 * wave, "stress_soft": 1e8, "stress_hard": -1e8, "mass_soft": 0.027, "mass_hard": 0.079}


class Host:
    """Sessions that hold the nodes together, at most LARGEST_SESSION each."""

    def __init__(self, endpoint, nodes, cells):
        sizes = [min(LARGEST_SESSION, nodes - first) for first in range(0, nodes, LARGEST_SESSION)]
        how = {"check_closure": "off", "reply_deadline": 600.0, "retry_after": 600.0}
        scene = served.scene("force_driven", layer={"thickness_m": 20e-6, "cells": cells, "grading": 1 + 4 / cells},
                             interface={"friction_coefficient": 0.3, "yield_strength_pa": 200e6})
        self.sessions = [shearbus.open(scene, numpy.arange(size), endpoint, **how) for size in sizes]
        self.nodes, self.count = nodes, 0

    def step(self):
        """Returns the seconds of a step: the whole, in the service, and in the solver."""
        self.count += 1
        begun = time.monotonic()
        answers = [bus.step(1e-9, **columns(len(bus.nodes), self.count)) for bus in self.sessions]
        return time.monotonic() - begun, sum(a.service_s for a in answers), sum(a.solver_s for a in answers)

    def leave(self):
        for bus in self.sessions:
            bus.leave()


def of_one_server(nodes, cells):
    with tempfile.TemporaryDirectory(prefix="shearbus-scale-", dir=OPTIONS.scratch) as directory, contextlib.ExitStack() as stack:
        server = Server(directory)
        stack.callback(lambda: server.kill())
        empty, _ = server.memory()
        host = Host(server.endpoint, nodes, cells)
        stack.callback(host.leave)
        for _ in range(2):
            host.step()
        resident, _ = server.memory()
        per_node = host.sessions[0].bytes_per_node
        reference = Host(server.endpoint, REFERENCE, cells)
        stack.callback(reference.leave)
        for _ in range(5):
            reference.step()
        times, others = [], []
        journal, steps = server.bytes_of("journal-*"), host.count
        for _ in range(OPTIONS.steps):
            times.append(host.step())
        grown, steps = server.bytes_of("journal-*") - journal, host.count - steps
        for _ in range(OPTIONS.steps):
            times.append(host.step())
            others += [reference.step() for _ in range(5)]
        fastest, small = (min(rows) for rows in (times, others))
        server.kill()
        made = host.count * nodes + reference.count * REFERENCE
        from_journal = server.start()
        server.forget_peak()
        before, _ = server.memory()
        begun = time.monotonic()
        server.ctl("checkpoint", "--timeout", "600")
        written, peak = time.monotonic() - begun, server.memory()[1]
        server.kill()
        from_checkpoint = server.start()
        size = server.bytes_of("checkpoint-*.h5")
        formula = empty + nodes * (per_node - REPLY) + min(nodes, LARGEST_MESSAGE) * (2 * REPLY + FRAME)
        return {
            "nodes": nodes, "cells": cells, "bytes_per_node": per_node, "resident_bytes": resident, "empty_bytes": empty,
            "formula_bytes": formula, "resident_of_formula": resident / formula,
            "step_s": fastest[0], "service_s": fastest[1], "solver_s": fastest[2], "ns_per_node_step": 1e9 * fastest[0] / nodes,
            "time_of_reference": (fastest[0] / nodes) / (small[0] / REFERENCE),
            "service_of_reference": (fastest[1] / nodes) / (small[1] / REFERENCE), "journal_bytes_per_node_step": grown / (steps * nodes),
            "recovery_from_journal_s": from_journal, "replayed_node_steps": made, "recovery_ns_per_node_step": 1e9 * from_journal / made,
            "checkpoint_bytes": size, "checkpoint_bytes_per_node": size / (nodes + REFERENCE), "checkpoint_s": written,
            "recovery_from_checkpoint_s": from_checkpoint, "checkpoint_memory_per_node": (peak - before) / (nodes + REFERENCE)
        }


def of_shards(counts, nodes, cells):
    """Returns the seconds of the fastest of the same steps on each number of shards."""
    with tempfile.TemporaryDirectory(prefix="shearbus-scale-", dir=OPTIONS.scratch) as directory, contextlib.ExitStack() as stack:
        hosts = {}
        for count in counts:
            servers = [Server(directory, f"{count}-{number}") for number in range(count)]
            stack.callback(lambda servers=servers: [server.kill() for server in servers])
            hosts[count] = Host(",".join(server.endpoint for server in servers), nodes, cells)
            stack.callback(hosts[count].leave)
            hosts[count].step()
        times = {count: [] for count in counts}
        for _ in range(3 * OPTIONS.steps):
            for count in counts:
                times[count].append(hosts[count].step()[0])
        return [{"shards": count, "nodes": nodes, "cells": cells, "step_s": min(seen), "of_one_shard": min(seen) / min(times[counts[0]])}
                for count, seen in times.items()]


def table(rows, *names):
    def cell(value):
        return f"{value:,}" if isinstance(value, int) else f"{value:.3g}"

    print("|" + "|".join(f" {name} " for name, _ in names) + "|")
    print("|" + "|".join("---" for _ in names) + "|")
    for row in rows:
        print("|" + "|".join(f" {cell(row[key])} " for _, key in names) + "|")
    print(flush=True)


def main():
    global OPTIONS, shearbus
    parser = Parser(description=__doc__)
    parser.add_argument("--bin", type=pathlib.Path, required=True)
    parser.add_argument("--nodes", type=whole_number, nargs="*", default=[10_000, 100_000, 200_000, 1_000_000, 4_000_000])
    parser.add_argument("--cells", type=whole_number, default=20)
    parser.add_argument("--shard-cells", type=whole_number, nargs="*", default=[20, 200])
    parser.add_argument("--shards", type=whole_number, nargs="*", default=sorted({1, 2, len(os.sched_getaffinity(0))}))
    parser.add_argument("--shard-nodes", type=whole_number, default=200_000)
    parser.add_argument("--steps", type=whole_number, default=5)
    parser.add_argument("--scratch", help="directory for the states; by default that for temporary files")
    parser.add_argument("--out", type=pathlib.Path)
    OPTIONS = parser.parse_args()
    sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "client/python"))
    import shearbus
    load = os.getloadavg()[0]
    found = {"cores": len(os.sched_getaffinity(0)), "load_before": load,
             "servers": [of_one_server(nodes, OPTIONS.cells) for nodes in OPTIONS.nodes],
             "shards": [row for cells in OPTIONS.shard_cells if OPTIONS.shards
                        for row in of_shards(OPTIONS.shards, OPTIONS.shard_nodes, cells)]}
    found["load_after"] = os.getloadavg()[0]
    print(f"{found['cores']} cores, load {found['load_before']:.1f} before and {found['load_after']:.1f} after\n")
    table(found["servers"], ("nodes", "nodes"), ("bytes per node", "bytes_per_node"), ("resident, of the formula", "resident_of_formula"),
          ("step [s]", "step_s"), ("solver [s]", "solver_s"), ("per node-step, of 10,000 nodes", "time_of_reference"), ("the same in the server", "service_of_reference"),
          ("journal [B per node-step]", "journal_bytes_per_node_step"), ("recovery from the journal [ns per node-step]", "recovery_ns_per_node_step"),
          ("checkpoint [B per node]", "checkpoint_bytes_per_node"), ("written in [s]", "checkpoint_s"), ("recovery from it [s]", "recovery_from_checkpoint_s"),
          ("memory while it is written [B per node]", "checkpoint_memory_per_node"))
    table(found["shards"], ("servers", "shards"), ("nodes", "nodes"), ("cells", "cells"), ("step [s]", "step_s"), ("of one server", "of_one_shard"))
    if OPTIONS.out:
        OPTIONS.out.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
