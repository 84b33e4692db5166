#!/usr/bin/python3
"""Measures a step over a network with delays: a server and a host in two network namespaces of this machine, joined by a veth pair.

network.py --bin BUILD/bin [--nodes N ...] [--delays MS ...] [--rates MBIT ...] [--shards K ...] [--steps S] [--out FILE.json]      (as root)

The rate is limited by a token bucket (tc tbf) at both ends. The delay of each way is netem's where the kernel has it; otherwise a relay in the
host's namespace holds all bytes for so long, and its own cost is in the row without delay. Prints the fastest step next to what the figures
of that row predict: the step without a network limit, plus round trips times delay, plus bytes by rate. A step on several servers takes two round
trips, since it is committed when its trial stands on all of them, and one with commit_previous. Exit code 77: this machine has no namespaces."""
import contextlib
import json
import os
import pathlib
import queue
import socket
import subprocess
import sys
import tempfile
import threading
import time

import numpy

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[2] / room) for room in ("client/report", "tests/support")]
import served  # noqa: E402
from terminal import Parser, real_number, whole_number  # noqa: E402

OPTIONS = None
SKIPPED = 77
SERVER_SIDE, HOST_SIDE = "shearbus-bench-server", "shearbus-bench-host"
ADDRESS = {SERVER_SIDE: "10.213.7.1", HOST_SIDE: "10.213.7.2"}
LINK = {SERVER_SIDE: "sbbench0", HOST_SIDE: "sbbench1"}
PORT = 5600
BURST = 256 * 1024  # bytes of the token bucket
REQUEST, REPLY = 6 * 8, 5 * 8 + 2  # bytes per node: six columns there; five columns and two of a byte each back
SCENE = served.scene("force_driven", layer={"thickness_m": 20e-6, "cells": 20, "grading": 1.2},
                     interface={"friction_coefficient": 0.3, "yield_strength_pa": 200e6})


def run(*words, check=True):
    return subprocess.run(list(map(str, words)), check=check, capture_output=True, text=True)


def relay(port, target, delay):
    """Passes connections to this port on to the target and holds all bytes for `delay` seconds in each direction."""
    def pump(source, sink):
        held = queue.SimpleQueue()

        def deliver():
            while (item := held.get()) is not None:
                due, data = item
                time.sleep(max(due - time.monotonic(), 0.0))
                with contextlib.suppress(OSError):
                    sink.sendall(data)
            with contextlib.suppress(OSError):
                sink.shutdown(socket.SHUT_WR)

        threading.Thread(target=deliver, daemon=True).start()
        with contextlib.suppress(OSError):
            while data := source.recv(1 << 20):
                held.put((time.monotonic() + delay, data))
        held.put(None)

    listener = socket.create_server(("127.0.0.1", port))
    while True:
        near, _ = listener.accept()
        far = socket.create_connection((target, port))
        for end in (near, far):
            end.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        for ends in ((near, far), (far, near)):
            threading.Thread(target=pump, args=ends, daemon=True).start()


def play(endpoint, nodes, steps, overlapped):
    """Prints the seconds of the fastest step, and of its solver."""
    bus = shearbus.open(SCENE, numpy.arange(nodes), endpoint, check_closure="off", reply_deadline=120.0, retry_after=60.0)
    wave = numpy.arange(nodes) % 97
    values = {"jump": 50.0 + wave, "pressure": 1e9 + 1e7 * wave, "stress_soft": 1e8, "stress_hard": -1e8, "mass_soft": 0.027, "mass_hard": 0.079}
    times = []
    for count in range(steps + 2):
        begun = time.monotonic()
        answer = bus.trial(1e-9, commit_previous=count > 0, **values) if overlapped else bus.step(1e-9, **values)
        times.append((time.monotonic() - begun, answer.solver_s))
    bus.close()
    print(json.dumps(min(times[2:])))


@contextlib.contextmanager
def namespaces():
    """Joins two new network namespaces by a veth pair."""
    with contextlib.ExitStack() as undo:
        for name in ADDRESS:
            run("ip", "netns", "add", name)
            undo.callback(run, "ip", "netns", "del", name, check=False)
        run("ip", "link", "add", LINK[SERVER_SIDE], "netns", SERVER_SIDE, "type", "veth", "peer", "name", LINK[HOST_SIDE], "netns", HOST_SIDE)
        for name, address in ADDRESS.items():
            run("ip", "-n", name, "address", "add", f"{address}/24", "dev", LINK[name])
            for link in ("lo", LINK[name]):
                run("ip", "-n", name, "link", "set", link, "up")
        yield


def shape(rate, delay):
    """Limits the rate (Mbit/s; 0: no limit) and, where the kernel has netem, delays (s). Returns whether it delays."""
    for name in ADDRESS:
        tc = ("tc", "-n", name, "qdisc")
        run(*tc, "del", "dev", LINK[name], "root", check=False)
        if rate:
            run(*tc, "add", "dev", LINK[name], "root", "handle", "1:", "tbf", "rate", f"{rate}mbit", "burst", BURST, "latency", "400ms")
        if delay:
            where = ("parent", "1:") if rate else ("root",)
            if run(*tc, "add", "dev", LINK[name], *where, "netem", "delay", f"{1e6 * delay:.0f}us", "limit", 100_000, check=False).returncode:
                return False
    return True


def inside(name, *words, **options):
    return subprocess.Popen(["ip", "netns", "exec", name, *map(str, words)], **options)


def measure(shards, nodes, rate, delay, overlapped, endpoints):
    """Returns a row: the fastest step over the network."""
    by_kernel = shape(rate, delay)
    with contextlib.ExitStack() as undo:
        where = ADDRESS[SERVER_SIDE]
        if not by_kernel or not delay:
            where = "127.0.0.1"
            for number in range(shards):
                held = inside(HOST_SIDE, sys.executable, __file__, "--relay", PORT + number, delay)
                undo.callback(lambda held=held: (held.kill(), held.wait()))
            time.sleep(0.5)
        endpoint = ",".join(f"tcp://{where}:{port}" for port in endpoints[:shards])
        host = inside(HOST_SIDE, sys.executable, __file__, "--host", endpoint, nodes, OPTIONS.steps, int(overlapped), stdout=subprocess.PIPE, text=True)
        out, _ = host.communicate(timeout=600)
        step, solver = json.loads(out)
    return {"shards": shards, "nodes": nodes, "mbit_per_s": rate, "delay_ms": 1e3 * delay, "commit_previous": overlapped, "step_s": step,
            "solver_s": solver, "delayed_by": "netem" if by_kernel and delay else "relay"}


def predict(rows):
    """Adds to each row what the row without limit and delay predicts for it."""
    for row in rows:
        free = next(r for r in rows if (r["shards"], r["nodes"], r["commit_previous"]) == (row["shards"], row["nodes"], row["commit_previous"])
                    and not r["mbit_per_s"] and not r["delay_ms"])
        trips = 2 if row["shards"] > 1 and not row["commit_previous"] else 1
        # What goes beyond the bucket's burst waits for the rate; request and reply are on different ends of the link.
        wire = sum(max(row["nodes"] * size - BURST, 0) for size in (REQUEST, REPLY)) * 8 / (row["mbit_per_s"] * 1e6) if row["mbit_per_s"] else 0.0
        row["predicted_s"] = free["step_s"] + trips * 2e-3 * row["delay_ms"] + wire


def main():
    global OPTIONS, shearbus
    sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "client/python"))
    if sys.argv[1:2] == ["--relay"]:
        return relay(int(sys.argv[2]), ADDRESS[SERVER_SIDE], float(sys.argv[3]))
    import shearbus
    if sys.argv[1:2] == ["--host"]:
        return play(sys.argv[2], int(sys.argv[3]), int(sys.argv[4]), bool(int(sys.argv[5])))
    parser = Parser(description=__doc__)
    parser.add_argument("--bin", type=pathlib.Path, required=True)
    parser.add_argument("--nodes", type=whole_number, nargs="*", default=[100, 10_000, 100_000])
    parser.add_argument("--delays", type=real_number, nargs="*", default=[0, 0.1, 1, 5], help="of one way, ms")
    parser.add_argument("--rates", type=whole_number, nargs="*", default=[0, 1000, 100], help="Mbit/s; 0: no limit")
    parser.add_argument("--shards", type=whole_number, nargs="*", default=[1, 2])
    parser.add_argument("--steps", type=whole_number, default=15)
    parser.add_argument("--out", type=pathlib.Path)
    OPTIONS = parser.parse_args()
    if os.geteuid() != 0 or run("ip", "netns", "list", check=False).returncode:
        print("skipped: network namespaces need root and iproute2")
        return SKIPPED
    load = os.getloadavg()[0]
    with namespaces(), tempfile.TemporaryDirectory(prefix="shearbus-network-") as directory, contextlib.ExitStack() as undo:
        endpoints = [PORT + number for number in range(max(OPTIONS.shards))]
        for port in endpoints:
            server = inside(SERVER_SIDE, OPTIONS.bin / "shearbus-server", "--bind", f"tcp://{ADDRESS[SERVER_SIDE]}:{port}", "--insecure-plaintext",
                            "--threads", 1, "--log-file", f"{directory}/{port}.log")
            undo.callback(lambda server=server: (server.terminate(), server.wait()))
        rows = []
        for shards in OPTIONS.shards:
            for overlapped in (False, True)[:shards]:
                for nodes in OPTIONS.nodes:
                    cases = [(0, delay) for delay in OPTIONS.delays] + [(rate, 0) for rate in OPTIONS.rates if rate]
                    rows += [measure(shards, nodes, rate, delay / 1e3, overlapped, endpoints) for rate, delay in cases]
    predict(rows)
    print(f"load {load:.1f} before and {os.getloadavg()[0]:.1f} after; delays by {'netem' if any(r['delayed_by'] == 'netem' for r in rows) else 'a relay'}\n")
    print("| servers | nodes | Mbit/s | one way [ms] | commit_previous | step [ms] | predicted [ms] |\n|---|---|---|---|---|---|---|")
    for r in rows:
        print(f"| {r['shards']} | {r['nodes']:,} | {r['mbit_per_s'] or 'no limit'} | {r['delay_ms']:g} | {'yes' if r['commit_previous'] else 'no'} | "
              f"{1e3 * r['step_s']:.2f} | {1e3 * r['predicted_s']:.2f} |")
    if OPTIONS.out:
        OPTIONS.out.write_text(json.dumps(rows, indent=1) + "\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
