#!/usr/bin/python3
"""Tests of the conformity kit, client/python/shearbus/conformity.

conformity.py --self-test [FAULT...]   holds the kit to hosts made wrong on purpose (kit_host.py)
conformity.py --vectors ENDPOINT       plays the frames of vectors.txt to a server and compares the status of each reply
conformity.py --write-vectors          makes vectors.txt of the exchange on the page proto/WIRE.md"""
import argparse
import pathlib
import re
import sys

import numpy
import zmq

import kit_host  # finds the package in the source tree
import friction_problems
import problem_answers
import wire_page
from shearbus.conformity import SCENARIOS, Refused, command_client, judge, mock_server, play

HERE = pathlib.Path(__file__).resolve().parent
PAGE, VECTORS = HERE.parents[1] / "proto/WIRE.md", HERE / "vectors.txt"


def other_answers():
    """Yields where the answers of the mock server, to the host of friction_problems.py in both forms, or the jump that the kit expects are
    not those of the tables of client/examples/problems."""
    for problem, table in problem_answers.problems(HERE.parents[1] / "client/examples/problems"):
        rows = numpy.genfromtxt(table, delimiter=",", names=True)
        name = "two_half_spaces" if problem["name"] == "constant_friction" else problem["name"]
        kit = mock_server.Problem(name)
        jumps = [(row["jump_m_per_s"], kit.exact_jump(row["time_s"], row["shear_stress_pa"])) for row in rows]
        if not any(exact is not None for _, exact in jumps) or any(exact is not None and abs(jump - exact) > 1e-6 for jump, exact in jumps):
            yield f"the exact jump of {name} is not that of {table.name}"
        for form in ("far_field", "stick"):
            def client(endpoint, _):
                try:
                    found = friction_problems.errors(problem, rows, friction_problems.run(problem, form, endpoint))
                except kit_host.shearbus.Error as error:
                    return str(error)
                bounds = friction_problems.BOUNDS[problem["name"]]
                far = any(not error <= 1.1 * bound for error, bound in zip(found, bounds))
                return f"errors of V, s and T0 {found}, expected about {bounds}, those of the server, at most" if far else None
            yield from (f"{name}, {form}, {check}: {fault}" for check, fault in play(name, client, 0.1).items() if fault)


def self_test(chosen):
    """Checks that the kit passes a right client and notices every wrong one by the check that is meant for it."""
    def client(fault):
        def run(endpoint, problem):
            try:
                kit_host.run(endpoint, problem, fault)
            except kit_host.shearbus.Error as error:
                return str(error)
        return run

    delay = 2.5 * kit_host.RETRY_S
    missed = [] if chosen else list(other_answers())
    for right, scenarios in ((None, tuple(SCENARIOS)), ("stick_form", kit_host.STEPS)):
        good, total = judge(client(right), delay, scenarios=scenarios)
        missed += [] if good == total else ["a right client did not pass"]
    for fault in chosen or kit_host.FAULTS:
        check, scenario = kit_host.FAULTS[fault]
        results = play(scenario, client(fault), delay)
        why = results.get(check)
        print(f"{fault}: {check}: {why}")
        if why in (None, mock_server.UNSEEN) and fault != "never_closes":
            missed.append(f"{fault} was not noticed by the check {check}")
        if fault == "pressure_in_gpa" and results["far_stresses"] is not None:
            missed.append(f"another pressure is taken for another stress: {results['far_stresses']}")
        if fault == "sign_of_the_jump" and "see first_jump" not in str(results["jump"]):
            missed.append(f"another start is taken for another mistake: {results['jump']}")
    try:
        judge(command_client(["/no/such/host"], 1.0), delay)
        missed.append("a host that cannot be started was played")
    except Refused as fault:
        print(fault)
    print("\n".join(missed
                    ) if missed else f"a right client passes, and {len(chosen or kit_host.FAULTS)} wrong ones do not")
    return bool(missed)


# -- vectors: frames in hex with their sums and the status of the reply --

def vectors(page):
    """Yields (name, frames, status) of a conversation: the exchange of the page, repeated, damaged and ended."""
    blocks = {name: wire_page.frames_of(text) for name, text in wire_page.BLOCK.findall(page)}
    hello, (header, payload) = blocks["hello"][0], blocks["downscale"]
    session = bytes(range(16))
    scene = (
        'name = "vectors"\nstrategy = "force_driven"\n'
        '[soft]\nmaterial = "aluminium_dlp"\n[hard]\nmaterial = "steel_dlp"\n'
        '[layer]\nthickness_m = 20e-6\ncells = 60\ngrading = 1.08\nfar_boundary = "half_space"\n'
        "[interface]\nfriction_coefficient = 0.05\nyield_strength_pa = 200e6\n")
    numbers = iter(range(2, 100))

    def request(body, fields, columns=None, **envelope):
        head = [(1, ("fixed32", mock_server.MAGIC)), (2, 1), (4, ("fixed64", envelope.pop("id", None)
                                                                  or next(numbers)))]
        if envelope.get("sequence") is not None:
            head += [(5, session), (6, envelope["sequence"])]
        if columns is None:
            return [mock_server.write([*head, (body, fields)])]
        frame = b"".join(mock_server.struct.pack("<Q" if field == 1 else "<d", value) for field, value in columns)
        rows = [(3, [(1, field), (3, 2 if field == 1 else 1)] + [(4, 8 * i)] * (i > 0) + [(5, 1)])
                for i, (field, _) in enumerate(columns)]
        declared = [(1, len(frame)), (2, ("fixed64", envelope.get("sum", mock_server.xxh3(frame)))), *rows]
        return [mock_server.write([*head, (8, declared), (body, fields)]), frame]

    step = [(1, ("fixed64", int.from_bytes(mock_server.struct.pack("<d", 1e-9), "little"))), (5, 1)]
    values = [(10, 100.0), (11, 1e9), (12, 0.0), (13, 0.0), (14, 0.0043), (15, 0.0123)]
    first = request(mock_server.STEP, step, values, sequence=1)
    other = request(mock_server.STEP, step, [(10, 99.0), *values[1:]], sequence=1)
    yield "hello of the page", [hello], 1
    yield "a step of a session that was not opened, from the page", [header, payload], 200
    yield "an opening", request(mock_server.OPEN, [(1, scene), (2, session), (3, session[::-1])], [(1, 7)]), 1
    yield "a step", first, 1
    yield "the same bytes again", first, 1
    yield "the same number with other bytes", other, 203
    yield "an earlier number", request(mock_server.STEP, step, values, sequence=0), 201
    yield "a number too far", request(mock_server.STEP, step, values, sequence=3), 202
    yield "another sum", request(mock_server.STEP, step, values, sequence=2, sum=1), 104
    yield "a payload that is too short", [request(mock_server.STEP, step, values, sequence=2)[0], bytes(40)], 104
    yield "a payload that is missing", request(mock_server.STEP, step, values, sequence=2)[:1], 100
    yield "a frame too many", [*first, b""], 100
    yield "a payload nobody declared", [hello, payload], 100
    yield "two headers in one", [first[0] + first[0], first[1]], 101
    yield "a header that is cut off", [first[0][:-1], first[1]], 101
    yield "no header", [b""], 101
    yield "another protocol", [b"GET / HTTP/1.1\r\n\r\n"], 101
    yield "another magic", [b"\x0d\x00\x00\x00\x00" + hello[5:]], 101
    yield "another major version", [hello[:6] + b"\x09" + hello[7:]], 102
    yield "a column that is missing", request(mock_server.STEP, step, values[:-1], sequence=2), 105
    yield "a column that is twice", request(mock_server.STEP, step, [*values, values[0]], sequence=2), 105
    yield "a value that is no number", request(mock_server.STEP, step, [(10, float("nan")), *values[1:]],
                                               sequence=2), 301
    yield "a mass of 0", request(mock_server.STEP, step, [*values[:4], (14, 0.0), values[5]], sequence=2), 301
    yield "a commit without a trial", request(mock_server.COMMIT, b"", sequence=2), 205
    yield "a rollback without a trial", request(mock_server.ROLLBACK, b"", sequence=2), 1
    yield "the end", request(mock_server.CLOSE, b"", sequence=3), 1


def vectors_text():
    lines = [
        "# Requests in one conversation, in this order, with the status of each reply; conformity.py --write-vectors",
        "# makes this file. name: status, then a line for each frame: its size, its XXH3-64 and its bytes in hex."
    ]
    for name, frames, status in vectors(PAGE.read_text()):
        lines.append(f"{name}: {status}")
        lines += [f"  {len(frame)} {mock_server.xxh3(frame):016x} {frame.hex()}".rstrip() for frame in frames]
    return "\n".join(lines) + "\n"


def vector_faults(text, ask):
    """Yields the differences between the expected status and that of `ask`, a function of frames that returns
    frames."""
    frames, name, status = [], None, None

    def fault():
        found = mock_server.read(mock_server.read(ask(frames)[0])[9][0])[1][0]
        return [] if found == status else [f"{name}: expected status {status}, found {found}"]

    for line in text.splitlines():
        if line.startswith("  "):
            size, total, *data = line.split()
            frame = bytes.fromhex(data[0] if data else "")
            if len(frame) != int(size) or mock_server.xxh3(frame) != int(total, 16):
                yield f"{name}: the bytes have not the size and sum of their line"
            frames.append(frame)
        elif not line.startswith("#"):
            if frames:
                yield from fault()
            frames, (name, status) = [], line.rsplit(": ", 1)
            status = int(status)
    yield from fault()


def play_vectors(endpoint):
    text = VECTORS.read_text()
    socket = zmq.Context.instance().socket(zmq.DEALER)
    socket.setsockopt(zmq.LINGER, 0)
    socket.setsockopt(zmq.RCVTIMEO, 5000)
    socket.connect(endpoint)

    def ask(frames):
        socket.send_multipart(frames)
        return socket.recv_multipart()

    mock = mock_server.MockServer()
    faults = [f"server: {fault}" for fault in vector_faults(text, ask)]
    faults += [f"mock server: {fault}" for fault in vector_faults(text, mock.answer)]
    if text != vectors_text():
        faults.append("vectors.txt is not what --write-vectors makes of the page")
    status = re.search(r": (\d+)$", text, re.M)
    if not list(vector_faults(text[: status.start(1)] + "999" + text[status.end(1):], mock_server.MockServer().answer)):
        faults.append("a wrong status was not noticed")
    socket.close()
    print("\n".join(faults) if faults else f"{text.count(chr(10) + '  ')} frames are answered as vectors.txt says")
    return bool(faults)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--self-test", nargs="*", metavar="FAULT", choices=[*kit_host.FAULTS, []])
    parser.add_argument("--vectors", metavar="ENDPOINT")
    parser.add_argument("--write-vectors", action="store_true")
    options = parser.parse_args()
    if options.write_vectors:
        VECTORS.write_text(vectors_text())
        return 0
    return play_vectors(options.vectors) if options.vectors else self_test(options.self_test)


if __name__ == "__main__":
    sys.exit(main())
