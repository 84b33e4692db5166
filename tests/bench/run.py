#!/usr/bin/python3
"""Runs all benchmarks next to what one would use without shearbus, prints one table and writes the measurements as JSON.

    cmake --build build --target benchmarks
    tests/bench/run.py [--bin build/bin] [--out FILE.json] [--only PART ...] [--quick]

Every part alternates with its yardstick within one run, on two processors to which all programs are bound. Times move
with the load of the machine, which the file records; the ratios of a part move less. The parts:

    rooms       kernels against the scalar twin, codec against packed protobuf messages, service against shard
    bus         round trips by ipc, tcp and inproc against bare ZeroMQ, the embedded C call against copies, and MPI
    durability  event log and journal on and off
    cone        a whole run of the hydrocode, with the layers of the server against its own Coulomb-Tresca law
    threads     the start of the fine cone: two threads against one, beside two runs at once, which share nothing"""
import datetime
import json
import os
import pathlib
import platform
import re
import resource
import shutil
import statistics
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "client/report"))
from terminal import Parser, whole_number  # noqa: E402
PARTS = ("rooms", "bus", "durability", "cone", "threads")
MPIRUN = ["mpirun", "--allow-run-as-root", "--oversubscribe", "--bind-to", "none", "-n", "2"]
NODES = (100, 1_000, 10_000, 100_000)


def output(*command):
    run = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    if run.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))} ended with {run.returncode}:\n{run.stderr or run.stdout}")
    return run.stdout


def row(part, name, value, unit, yardstick="", against=None):
    """Returns a line of the table. against: the yardstick's value, in the same unit."""
    return {"part": part, "name": name, "value": value, "unit": unit, "yardstick": yardstick, "against": against, "ratio": value / against if against else None}


def rooms(given, scratch):
    """Google Benchmark draws the order of all repetitions at random, so each benchmark alternates with its yardstick."""
    file = scratch / "rooms.json"
    output(given.bin / "shearbus-bench-rooms", f"--benchmark_out={file}", "--benchmark_out_format=json", "--benchmark_enable_random_interleaving=true",
           f"--benchmark_repetitions={3 if given.quick else 9}", f"--benchmark_min_time={0.02 if given.quick else 0.2}")
    ns = {}
    for run in json.loads(file.read_text())["benchmarks"]:
        if run["run_type"] == "iteration":
            ns.setdefault(run["run_name"], []).append(1e9 / run["items_per_second"])
    ns = {name: statistics.median(values) for name, values in ns.items()}
    rows = [row("rooms", f"kernel, {strategy.replace('_', '-')}, 60 cells", ns[f"kernel/{strategy}/tile"], "ns a node-step", "scalar twin", ns[f"kernel/{strategy}/twin"])
            for strategy in ("force_driven", "velocity_driven")]
    for nodes in (100, 10_000, 100_000):
        rows.append(row("rooms", f"codec, {nodes:,} rows", ns[f"codec/columns/{nodes}"], "ns a row", "packed protobuf", ns[f"codec/packed/{nodes}"]))
    for nodes in (100, 10_000, 100_000):
        rows.append(row("rooms", f"service without socket, {nodes:,} nodes", ns[f"step/service/{nodes}"], "ns a node-step", "shard", ns[f"step/shard/{nodes}"]))
    return rows


def mpi_trip(given, case, rounds):
    program = given.bin / "shearbus-bench-mpi"
    if shutil.which("mpirun") is None or not program.exists():
        return None
    return json.loads(output(*MPIRUN, program, case["request_bytes"], case["reply_bytes"], rounds))["lowest_tenth_us"]


def bus(given, scratch):
    """The program of the round trips alternates trip by trip; MPI and the C call take turns with it, block by block."""
    blocks = 1 if given.quick else 3
    trips, mpi, calls = {}, {}, {}
    for _ in range(blocks):
        file = scratch / "bus.json"
        output(given.bin / "shearbus-bench-roundtrip", file, 10 if given.quick else 3)
        for case in json.loads(file.read_text())["round_trips"]:
            trips.setdefault((case["transport"], case["nodes"]), []).append(case)
            if case["transport"] == "ipc":
                mpi.setdefault(case["nodes"], []).append(mpi_trip(given, case, case["rounds"]))
        for nodes in NODES:
            calls.setdefault(nodes, []).append(json.loads(output(given.bin / "shearbus-bench-embedded-call", nodes, 30 if given.quick else 300)))
    rows = []
    for (transport, nodes), cases in trips.items():
        least = {key: min(case[key] for case in cases) for key in ("shearbus_lowest_us", "bare_lowest_us")}
        rows.append(row("bus", f"round trip, {transport}, {nodes:,} nodes", least["shearbus_lowest_us"], "us", "bare ZeroMQ", least["bare_lowest_us"]))
        if transport == "ipc" and mpi[nodes][0] is not None:
            rows.append(row("bus", f"round trip, ipc, {nodes:,} nodes", least["shearbus_lowest_us"], "us", "MPI", min(mpi[nodes])))
    for nodes, found in calls.items():
        value, copy = (min(case[key]["lowest_tenth_us"] for case in found) for key in ("call", "copy"))
        rows.append(row("bus", f"embedded C call, {nodes:,} nodes", value, "us", "copies", copy))
        rows.append(row("bus", f"embedded C call, {nodes:,} nodes", value, "us", "bare inproc", min(case["bare_lowest_us"] for case in trips["inproc", nodes])))
    return rows


def durability(given, scratch):
    file = scratch / "durability.json"
    output(given.bin / "shearbus-bench-durability", file, 30 if given.quick else 300)
    return [row("durability", f"{case['scene']}, {case['nodes']:,} nodes, {what}", case[f"{level}_us"], "us", "without", case["volatile_us"])
            for case in json.loads(file.read_text()) for level, what in (("record", "event log"), ("process", "journal"), ("power", "journal on the disk"))]


def cone(given, scratch):
    """The server is in the process of the run, so that one processor time holds hydrocode, bus and layers."""
    times = {}
    scene = scratch / "cone.toml"
    text = (ROOT / "hydro_stub/problems/cone_al_steel.toml").read_text()
    width = "zone_width_m = 0.25e-3"
    if width not in text:
        sys.exit(f"cone_al_steel.toml has no line {width}")
    scene.write_text(text.replace(width, f"zone_width_m = {1e-3 if given.quick else 0.5e-3}"))
    for _ in range(1 if given.quick else 3):
        for law in ("subgrid", "coulomb_tresca"):
            out = scratch / law
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            output(given.bin / "shearbus-hydro", scene, "--interface-law", law, "--out", out, "--no-plot", "--no-progress")
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            times.setdefault(law, []).append(after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime)
            shutil.rmtree(out)
    return [row("cone", "whole cone, layers of the server", min(times["subgrid"]), "s of processor", "Coulomb-Tresca", min(times["coulomb_tresca"]))]


def threads(given, scratch):
    """What two processors give: two runs of one thread each, side by side, do twice the work of one."""
    scene = scratch / "fine.toml"
    text, found = re.subn(r"(?m)^end_time_s = \S+", f"end_time_s = {0.02e-6 if given.quick else 1e-6}", (ROOT / "hydro_stub/problems/cone_al_steel_fine.toml").read_text())
    if found != 1:
        sys.exit("cone_al_steel_fine.toml has no line end_time_s")
    scene.write_text(text)

    def seconds(runs, number):
        out = [scratch / f"run{run}" for run in range(runs)]
        running = [subprocess.Popen([given.bin / "shearbus-hydro", scene, "--out", directory, "--no-plot", "--no-progress"], stdout=subprocess.DEVNULL,
                                    env={**os.environ, "OMP_NUM_THREADS": str(number)}) for directory in out]
        if any([run.wait() for run in running]):
            sys.exit("a run of cone_al_steel_fine failed")
        return max(json.loads((directory / "summary.json").read_text())["run_time_s"] for directory in out)

    times = {}
    for _ in range(1 if given.quick else 5):
        for case in ((1, 1), (2, 1), (1, 2)):
            times.setdefault(case, []).append(seconds(*case))
    alone, side_by_side, shared = (min(times[case]) for case in ((1, 1), (2, 1), (1, 2)))
    return [row("threads", "fine cone, two threads", alone / shared, "times one", "two runs side by side", 2.0 * alone / side_by_side)]


def machine():
    model = next((line.split(":", 1)[1].strip() for line in open("/proc/cpuinfo") if line.startswith("model name")), platform.machine())
    git = subprocess.run(["git", "-C", ROOT, "describe", "--always", "--dirty"], capture_output=True, text=True)
    return {"machine": model, "system": platform.platform(), "processors": sorted(os.sched_getaffinity(0)), "commit": git.stdout.strip(),
            "date": datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%d"), "load_before": os.getloadavg()[0]}


def table(rows):
    def digits(value):
        return f"{value:.3g}" if value < 1000 else f"{value:,.0f}"

    lines = ["| benchmark | | unit | yardstick | | ratio |", "|---|---|---|---|---|---|"]
    for one in rows:
        lines.append(f"| {one['name']} | {digits(one['value'])} | {one['unit']} | {one['yardstick']} | {digits(one['against'])} | {one['ratio']:.3g} |")
    return "\n".join(lines)


def main():
    parser = Parser(description=__doc__)
    parser.add_argument("--bin", type=pathlib.Path, default=ROOT / "build/bin", help="directory of the programs")
    parser.add_argument("--out", type=pathlib.Path, help="file of the measurements")
    parser.add_argument("--only", nargs="+", choices=PARTS, default=PARTS, metavar="PART", help="some of the parts: %(choices)s")
    parser.add_argument("--quick", action="store_true", help="a tenth of the rounds: shows that everything runs, measures little")
    parser.add_argument("--cpus", type=whole_number, nargs="+", help="processors to bind to; by default the last two")
    given = parser.parse_args()
    os.sched_setaffinity(0, given.cpus or sorted(os.sched_getaffinity(0))[-2:])
    found = machine()
    with tempfile.TemporaryDirectory(prefix="shearbus-bench-") as scratch:
        found["rows"] = [line for part in PARTS if part in given.only for line in globals()[part](given, pathlib.Path(scratch))]
    found["load_after"] = os.getloadavg()[0]
    print(f"{found['machine']}, processors {found['processors']}, commit {found['commit']}, load {found['load_before']:.1f} before and {found['load_after']:.1f} after\n")
    print(table(found["rows"]))
    if given.out:
        given.out.write_text(json.dumps(found, indent=1) + "\n")


if __name__ == "__main__":
    main()
