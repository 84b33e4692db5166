#!/usr/bin/python3
"""A client written from proto/WIRE.md and the .proto files alone, with its tests of a server. It shares no code with the C++ client, so it
fails if the page is wrong or incomplete.

outsider.py --endpoint ENDPOINT --protos DIR --work DIR   (DIR of .proto files; a directory for the generated modules)
    [--server-key FILE --key FILE]                          (for tcp: the server's public key and the client's secret key)"""
import argparse
import ctypes
import math
import os
import pathlib
import struct
import subprocess
import sys
import tomllib
import unittest

import zmq

MAGIC = 0x31425353
DEADLINE_MS = 5_000
OPTIONS = None
pb = None  # envelope_pb2
downscale_pb = None


def generate(protoc, protos, work):
    """Generates the Python modules of the messages with protoc, so that the .proto files are the only source."""
    global pb, downscale_pb
    work.mkdir(parents=True, exist_ok=True)
    files = sorted(str(p) for p in (protos / "shearbus/v1").glob("*.proto"))
    subprocess.run([protoc, f"-I{protos}", f"--python_out={work}", *files], check=True)
    sys.path.insert(0, str(work))
    from shearbus.v1 import downscale_pb2, envelope_pb2

    pb, downscale_pb = envelope_pb2, downscale_pb2


def xxh3(data):
    library = ctypes.CDLL("libxxhash.so.0")
    library.XXH3_64bits.restype = ctypes.c_uint64
    library.XXH3_64bits.argtypes = [ctypes.c_char_p, ctypes.c_size_t]
    return library.XXH3_64bits(bytes(data), len(data))


# WIRE.md, "The payload": field number -> (element, struct code)
FLOAT64, UINT64, UINT8 = 1, 2, 3
CODE = {FLOAT64: "d", UINT64: "Q", UINT8: "B"}
NODE_ID, INITIAL_TEMPERATURE, JUMP, PRESSURE = 1, 2, 10, 11
STRESS_SOFT, STRESS_HARD, MASS_SOFT, MASS_HARD = 12, 13, 14, 15
STICK_STRESS, IMPEDANCE = 18, 19
STRESS, SLIDING, TEMPERATURE, JUMP_NEW, REGIME, OUTCOME, HEAT = 30, 31, 32, 33, 34, 35, 36
CLOSURE = 61


def element_of(field):
    return UINT64 if field == NODE_ID else UINT8 if field in (REGIME, OUTCOME) else FLOAT64


def pack(columns):
    """Packs {field: values} into (Payload, frame)."""
    frame, payload = b"", pb.Payload()
    for field, values in columns.items():
        element = element_of(field)
        payload.columns.add(field=field, element=element, offset_bytes=len(frame), count=len(values))
        frame += struct.pack(f"<{len(values)}{CODE[element]}", *values)
        frame += bytes(-len(frame) % 8)
    payload.size_bytes, payload.xxh3 = len(frame), xxh3(frame)
    return payload, frame


def unpack(payload, frame):
    assert payload.size_bytes == len(frame) and payload.xxh3 == xxh3(frame)
    columns = {}
    for column in payload.columns:
        assert column.element == element_of(column.field) and column.offset_bytes % 8 == 0 and column.component == 0
        columns[column.field] = struct.unpack_from(f"<{column.count}{CODE[column.element]}", frame, column.offset_bytes)
    return columns


class Reply:
    def __init__(self, frames):
        self.frames = frames
        self.header = pb.ReplyHeader.FromString(frames[0])
        assert self.header.magic == MAGIC and self.header.protocol_major == 1
        assert (len(frames) == 2) == self.header.HasField("payload")
        self.code = self.header.status.code
        assert (self.code == pb.CODE_OK) == (self.header.WhichOneof("body") is not None)
        self.columns = unpack(self.header.payload, frames[1]) if len(frames) == 2 else {}


def key_in(file):
    """Returns the key in a file as WIRE.md, "Transport and frames" defines it: 40 characters of Z85, then words; lines that begin with "# "
    are comments."""
    lines = [line for line in pathlib.Path(file).read_text().splitlines() if line and not line.startswith("# ")]
    return lines[0].split()[0].encode()


class Connection:
    def __init__(self):
        self.socket = zmq.Context.instance().socket(zmq.DEALER)
        if OPTIONS.key:
            secret = key_in(OPTIONS.key)
            self.socket.curve_secretkey, self.socket.curve_publickey = secret, zmq.curve_public(secret)
            self.socket.curve_serverkey = key_in(OPTIONS.server_key)
        self.socket.setsockopt(zmq.LINGER, 0)
        self.socket.setsockopt(zmq.IMMEDIATE, 1)
        self.socket.setsockopt(zmq.SNDTIMEO, DEADLINE_MS)
        self.socket.connect(OPTIONS.endpoint)
        self.last_id = 0

    def close(self):
        self.socket.close()

    def header(self, **envelope):
        self.last_id += 1
        return pb.RequestHeader(magic=MAGIC, protocol_major=1, protocol_minor=0, request_id=self.last_id, **envelope)

    def exchange(self, frames):
        self.socket.send_multipart(frames)
        if not self.socket.poll(DEADLINE_MS):
            raise TimeoutError("no reply")
        return Reply(self.socket.recv_multipart())

    def call(self, columns=None, **envelope):
        return self.exchange(self.frames(columns, **envelope))

    def frames(self, columns=None, **envelope):
        header = self.header(**envelope)
        if columns is None:
            return [header.SerializeToString()]
        payload, frame = pack(columns)
        header.payload.CopyFrom(payload)
        return [header.SerializeToString(), frame]


class Session:
    """A session that numbers its requests; a refused request does not use up its number."""

    def __init__(self, connection, scene, node_ids, temperatures=None, domain="", **options):
        self.connection, self.id, self.sequence = connection, os.urandom(16), 0
        columns = {NODE_ID: node_ids} if node_ids else None
        if temperatures is not None:
            columns[INITIAL_TEMPERATURE] = temperatures
        self.opening = connection.frames(columns, open_session={"scene": scene, "scene_file": "outsider.toml",
                                                            "session_id": self.id, "domain": domain, **options})
        self.opened = connection.exchange(self.opening)

    def frames(self, columns=None, **body):
        return self.connection.frames(columns, session_id=self.id, sequence=self.sequence + 1, **body)

    def call(self, columns=None, **body):
        return self.send(self.frames(columns, **body))

    def send(self, frames):
        reply = self.connection.exchange(frames)
        if reply.code == pb.CODE_OK and not reply.header.replayed:
            self.sequence += 1
        return reply

    def step(self, columns, mode=1, dt=1e-9, **more):
        return self.call(columns, downscale=dict(dt_s=dt, mode=mode, **more))


def paper_scene(material="aluminium_dlp", strategy="velocity_driven", cells=500, layer=""):
    """The velocity-driven case of DLP section 5: aluminium on steel, 20 um, 500 uniform cells."""
    return f"""name = "outsider"
strategy = "{strategy}"
[soft]
material = "{material}"
[hard]
material = "steel_dlp"
[layer]
thickness_m = 20e-6
cells = {cells}
{layer}
"""


def force_scene():
    return paper_scene(strategy="force_driven", cells=60, layer="grading = 1.08") + """[interface]
friction_coefficient = 0.3
yield_strength_pa = 200e6
"""


def drive(jumps, pressure=11.2e9):
    return {JUMP: jumps, PRESSURE: [pressure] * len(jumps)}


class Outsider(unittest.TestCase):
    def setUp(self):
        self.bus = Connection()
        self.addCleanup(self.bus.close)

    def assert_refused(self, reply, code, field=None):
        self.assertEqual(pb.Code.Name(reply.code), pb.Code.Name(code), reply.header.status.text)
        self.assertTrue(reply.header.status.text)
        if field is not None:
            self.assertEqual(reply.header.status.field, field)

    def open(self, scene, node_ids, temperatures=None, domain="", **options):
        session = Session(self.bus, scene, node_ids, temperatures, domain, **options)
        self.assertEqual(session.opened.code, pb.CODE_OK, session.opened.header.status.text)
        self.addCleanup(lambda: session.call(close_session={"reason": "test over"}))
        return session

    # -- hello --

    def test_hello_tells_version_limits_and_epoch(self):
        reply = self.bus.call(hello={"oldest_major": 1, "newest_major": 1, "client_name": "outsider"})
        welcome = reply.header.welcome
        self.assertEqual(reply.header.request_id, self.bus.last_id)
        self.assertEqual((welcome.protocol_major, welcome.durability), (1, "none"))
        self.assertRegex(welcome.server_version, r"^\d+\.\d+\.\d+")
        self.assertEqual(welcome.limits.max_header_bytes, 512 * 1024)
        self.assertEqual(welcome.limits.max_payload_bytes, 32 * 1024 * 1024)
        self.assertEqual(welcome.limits.max_nodes_per_session, 2_000_000)
        self.assertLessEqual({"velocity_driven", "force_driven", "trial"}, set(welcome.capabilities))
        self.assertNotEqual(reply.header.epoch, 0)
        self.assertEqual(welcome.access, "key" if OPTIONS.key else "uid")
        self.assertEqual(welcome.limits.max_frames, 2)
        self.assertGreater(welcome.limits.max_state_bytes, 0)

    def test_versions_apart_are_told(self):
        self.assert_refused(self.bus.call(hello={"oldest_major": 2, "newest_major": 3}), pb.CODE_VERSION)
        header = self.bus.header(server_status={})
        header.protocol_major = 9
        reply = self.bus.exchange([header.SerializeToString()])
        self.assert_refused(reply, pb.CODE_VERSION)
        self.assertIn("9.0", reply.header.status.text)
        self.assertIn("1.0", reply.header.status.text)

    # -- numbers --

    def test_ten_steps_of_the_papers_case(self):
        session = self.open(paper_scene(), [7])
        for _ in range(10):
            reply = session.step(drive([100.0]))
            self.assertEqual(reply.code, pb.CODE_OK, reply.header.status.text)
        # At N = 500, dt = 1 ns, backward Euler, this is the answer of the discrete problem to rounding.
        self.assertTrue(math.isclose(reply.columns[TEMPERATURE][0], 398.146970801, rel_tol=1e-8), reply.columns)
        self.assertTrue(math.isclose(reply.columns[STRESS][0], 229.2063259e6, rel_tol=1e-8), reply.columns)
        self.assertEqual(reply.columns[REGIME], (3,))
        self.assertEqual(reply.columns[OUTCOME], (0,))
        self.assertEqual(set(reply.columns), {STRESS, SLIDING, TEMPERATURE, REGIME, OUTCOME, HEAT})
        self.assertEqual((reply.header.upscale.nodes, reply.header.upscale.state_version), (1, 10))

    def test_signs_follow_the_jump(self):
        session = self.open(paper_scene(), [1, 2, 3])
        for _ in range(3):
            reply = session.step({JUMP: [100.0, -100.0, 100.0], PRESSURE: [11.2e9, 11.2e9, -1.0]})
        up, down, apart = reply.columns[STRESS]
        self.assertGreater(up, 0.0)
        self.assertEqual(down, -up)
        self.assertEqual((apart, reply.columns[REGIME][2], reply.columns[HEAT][2]), (0.0, 0, 0.0))

    def test_force_driven_slows_the_slip(self):
        session = self.open(force_scene(), [5])
        jump = 100.0
        for _ in range(10):
            reply = session.step({JUMP: [jump], PRESSURE: [11.2e9], STRESS_SOFT: [0.0], STRESS_HARD: [0.0],
                                  MASS_SOFT: [2703 * 0.5e-5], MASS_HARD: [7900 * 0.5e-5]})
            self.assertEqual(reply.code, pb.CODE_OK, reply.header.status.text)
            self.assertEqual(set(reply.columns), {STRESS, SLIDING, TEMPERATURE, JUMP_NEW, HEAT, REGIME, OUTCOME})
            # The interface pulls each half zone with the stress s, so [V] changes by -dt s (1/m_soft + 1/m_hard).
            stress = reply.columns[STRESS][0]
            expected = jump - 1e-9 * stress * (1 / (2703 * 0.5e-5) + 1 / (7900 * 0.5e-5))
            self.assertTrue(math.isclose(reply.columns[JUMP_NEW][0], expected, rel_tol=1e-12), (reply.columns, expected))
            self.assertLessEqual(stress, 0.3 * 11.2e9)
            jump = reply.columns[JUMP_NEW][0]
        self.assertLess(jump, 100.0)

    def test_stick_form_has_the_answer_of_the_far_field_form(self):
        far, stick = self.open(force_scene(), [5, 6]), self.open(force_scene(), [5, 6])
        soft, hard = 2703 * 0.5e-5, 7900 * 0.5e-5
        impedance = 1 / (1e-9 * (1 / soft + 1 / hard))
        jumps = [100.0, -3.0]
        for _ in range(10):
            free = [jump + 1e-9 * (2e8 / soft - 1e8 / hard) for jump in jumps]
            drive_far = {STRESS_SOFT: [2e8] * 2, STRESS_HARD: [-1e8] * 2, MASS_SOFT: [soft] * 2, MASS_HARD: [hard] * 2}
            drive_stick = {STICK_STRESS: [impedance * jump for jump in free], IMPEDANCE: [impedance] * 2}
            want = far.step(drive(jumps) | drive_far)
            found = stick.step(drive(jumps) | drive_stick)
            self.assertEqual(found.code, pb.CODE_OK, found.header.status.text)
            for field in (STRESS, SLIDING, TEMPERATURE, JUMP_NEW):
                for a, b in zip(found.columns[field], want.columns[field]):
                    self.assertTrue(math.isclose(a, b, rel_tol=1e-9, abs_tol=1e-9), (field, a, b))
            for jump, stress, new in zip(free, found.columns[STRESS], found.columns[JUMP_NEW]):
                self.assertTrue(math.isclose(new, jump - stress / impedance, rel_tol=1e-9, abs_tol=1e-9))
            jumps = list(want.columns[JUMP_NEW])
        self.assert_refused(stick.step(drive(jumps) | drive_stick | {MASS_SOFT: [soft] * 2}), pb.CODE_SHAPE, "mass_soft_kg_per_m2")
        self.assert_refused(stick.step(drive(jumps) | {IMPEDANCE: [impedance] * 2}), pb.CODE_SHAPE, "stick_stress_pa")
        self.assert_refused(stick.step(drive(jumps) | {STICK_STRESS: [0.0] * 2, IMPEDANCE: [0.0, impedance]}),
                            pb.CODE_INVALID_VALUE, "impedance_pa_s_per_m")

    def test_nodes_that_a_step_does_not_name_cool_if_it_opens_them(self):
        def temperature_of_the_other(absent_nodes):
            session = self.open(paper_scene(), [1, 2])
            session.step(drive([100.0, 100.0]), dt=1e-8)
            for _ in range(5):
                reply = session.step({NODE_ID: [1], **drive([100.0])}, dt=1e-8, absent_nodes=absent_nodes)
                self.assertEqual(len(reply.columns[TEMPERATURE]), 1)
            return session.step(drive([0.0, 0.0], 0.0), dt=1e-18).columns[TEMPERATURE][1]
        self.assertLess(temperature_of_the_other(1) + 1.0, temperature_of_the_other(0))

    def test_the_closure_shows_an_answer_that_was_not_applied(self):
        session = self.open(force_scene(), [5, 6], check_closure=True)
        far_field = {STRESS_SOFT: [0.0] * 2, STRESS_HARD: [0.0] * 2, MASS_SOFT: [2703 * 0.5e-5] * 2, MASS_HARD: [7900 * 0.5e-5] * 2}
        wanted = [STRESS, JUMP_NEW, CLOSURE]
        first = session.step(drive([100.0, 80.0]) | far_field, wanted=wanted)
        self.assertTrue(all(math.isnan(value) for value in first.columns[CLOSURE]))
        right, wrong = first.columns[JUMP_NEW][0], 80.0
        second = session.step(drive([right, wrong]) | far_field, wanted=wanted)
        self.assertEqual(second.columns[CLOSURE], (0.0, wrong - first.columns[JUMP_NEW][1]))
        upscale = second.header.upscale
        self.assertEqual((upscale.largest_closure_m_per_s, upscale.closure_node), (second.columns[CLOSURE][1], 6))
        self.assertEqual(upscale.layer_time_s, 2e-9)
        plain = self.open(force_scene(), [5, 6])
        self.assert_refused(plain.step(drive([100.0, 80.0]) | far_field, wanted=wanted), pb.CODE_UNSUPPORTED, "wanted")

    def test_rows_are_the_requests_in_its_order(self):
        all_at_once = self.open(paper_scene(), [10, 20, 30])
        piecewise = self.open(paper_scene(), [30, 10, 20])
        whole = all_at_once.step(drive([50.0, 60.0, 70.0])).columns[STRESS]
        part = piecewise.step({NODE_ID: [20, 10], **drive([60.0, 50.0])}).columns[STRESS]
        rest = piecewise.step({NODE_ID: [30], **drive([70.0])}).columns[STRESS]
        self.assertEqual(part + rest, (whole[1], whole[0], whole[2]))

    def test_initial_temperatures_are_per_node(self):
        session = self.open(paper_scene(), [1, 2], [300.0, 700.0])
        cold, hot = session.step(drive([1.0, 1.0])).columns[TEMPERATURE]
        self.assertTrue(300.0 <= cold < 310.0 and 700.0 <= hot < 710.0)

    def test_only_wanted_columns_come(self):
        session = self.open(paper_scene(), [1])
        all_of = self.open(paper_scene(), [1]).step(drive([1.0])).columns
        reply = session.step(drive([1.0]), wanted=[TEMPERATURE, OUTCOME])
        self.assertEqual(reply.columns, {field: all_of[field] for field in (TEMPERATURE, OUTCOME)})
        self.assert_refused(session.step(drive([1.0]), wanted=[JUMP_NEW]), pb.CODE_SHAPE)

    def test_effective_scene_has_every_constant(self):
        session = self.open(paper_scene(), [1])
        opened = session.opened.header.session_opened
        scene = tomllib.loads(opened.effective_scene)
        self.assertEqual((scene["soft"]["density_kg_per_m3"], scene["hard"]["melting_temperature_k"]), (2703.0, 2380.0))
        self.assertEqual((scene["layer"]["initial_temperature_k"], scene["layer"]["grading"]), (300.0, 1.0))
        self.assertEqual(scene["layer"]["far_boundary"], "insulated")
        again = self.open(opened.effective_scene, [1])
        self.assertEqual(again.opened.header.session_opened.effective_scene, opened.effective_scene)

    def test_an_opening_names_the_columns_of_its_steps(self):
        """Checks that an opening tells a client without a TOML reader all that it needs to know of its scene."""
        def facts(session):
            opened = session.opened.header.session_opened
            return (opened.strategy, opened.tangential_components, list(opened.required_columns), list(opened.optional_columns),
                    list(opened.reply_columns), list(opened.columns_on_request))
        on_request = [37, 38, 39, 49, *range(40, 49)]
        velocity = facts(self.open(paper_scene(), [1]))
        self.assertEqual(velocity, (1, 1, [JUMP, PRESSURE], [], [STRESS, SLIDING, TEMPERATURE, HEAT, REGIME, OUTCOME], on_request))
        force = facts(self.open(force_scene() + "plastic_layer = true\n", [1]))
        self.assertEqual(force, (2, 1, [JUMP, PRESSURE, STRESS_SOFT, STRESS_HARD, MASS_SOFT, MASS_HARD], [17],
                                 [STRESS, SLIDING, TEMPERATURE, JUMP_NEW, HEAT, REGIME, OUTCOME], [37, 49, *range(40, 49)]))

    # -- trial, commit, rollback --

    def test_trial_leaves_the_committed_states(self):
        session, plain = self.open(paper_scene(), [1]), self.open(paper_scene(), [1])
        session.step(drive([400.0]), mode=2)
        self.assertEqual(session.call(rollback={}).code, pb.CODE_OK)
        session.step(drive([300.0]), mode=2)
        trial = session.step(drive([100.0]), mode=2)
        self.assertEqual(session.call(commit={}).header.committed.state_version, 1)
        self.assertEqual(trial.columns, plain.step(drive([100.0])).columns)
        self.assert_refused(session.call(commit={}), pb.CODE_NOTHING_TO_COMMIT)
        session.step(drive([100.0]), mode=2)
        rode_along = session.step(drive([100.0]), mode=2, commit_previous=True)
        plain.step(drive([100.0]))
        self.assertEqual(rode_along.columns, plain.step(drive([100.0])).columns)

    # -- nodes are registered, retired and moved --

    def test_nodes_move_between_sessions_of_a_domain_with_their_states(self):
        domain = os.urandom(8).hex()
        giver, taker = self.open(paper_scene(), [1, 2, 3], domain=domain), self.open(paper_scene(), [], domain=domain)
        plain = self.open(paper_scene(), [1, 2, 3, 7])
        giver.step(drive([100.0, 150.0, 50.0]))
        plain.step(drive([100.0, 150.0, 50.0]) | {NODE_ID: [1, 2, 3]})
        self.assert_refused(Session(self.bus, paper_scene(), [3], domain=domain).opened, pb.CODE_NODE_OWNED, "node_id")
        transfer = {"transfer_id": os.urandom(16)}
        self.assert_refused(taker.call(accept_nodes=transfer), pb.CODE_UNKNOWN_TRANSFER)
        offer = giver.call({NODE_ID: [3, 1]}, offer_nodes=transfer)
        self.assertEqual(offer.header.nodes_changed.nodes, 1)
        accepted = taker.call(accept_nodes=transfer)
        self.assertEqual(accepted.columns[NODE_ID], (3, 1))
        self.assertEqual(taker.call({NODE_ID: [7]}, register_nodes={}).header.nodes_changed.nodes, 3)
        moved = taker.step(drive([60.0, 70.0, 80.0]))
        whole = plain.step(drive([70.0, 1.0, 60.0, 80.0]))
        for field in (TEMPERATURE, STRESS):
            self.assertEqual(moved.columns[field], tuple(whole.columns[field][row] for row in (2, 0, 3)))
        self.assertEqual(taker.call({NODE_ID: [1]}, retire_nodes={}).header.nodes_changed.nodes, 2)
        self.assertEqual(len(taker.step(drive([60.0, 70.0])).columns[TEMPERATURE]), 2)
        taker.step(drive([60.0, 70.0]), mode=2)
        self.assert_refused(taker.call({NODE_ID: [7]}, retire_nodes={}), pb.CODE_TRIAL_STANDS)

    def test_a_mark_brings_its_nodes_back(self):
        session = self.open(paper_scene(), [1, 2, 3])
        session.call(mark={"name": "dump"})
        session.call({NODE_ID: [2]}, retire_nodes={})
        session.call({NODE_ID: [9]}, register_nodes={})
        self.assertEqual(session.call(rollback={"to_mark": "dump"}).columns[NODE_ID], (1, 2, 3))

    # -- sequence numbers --

    def test_repeated_request_is_answered_again_and_run_once(self):
        session, plain = self.open(paper_scene(), [1]), self.open(paper_scene(), [1])
        frames = session.frames(drive([100.0]), downscale={"dt_s": 1e-9, "mode": 1})
        first = session.send(frames)
        again = session.send(frames)
        self.assertEqual((first.header.replayed, again.header.replayed), (False, True))
        self.assertEqual(first.frames[1], again.frames[1])
        first.header.upscale.ClearField("solver_ns")  # a repeated reply reports no time
        first.header.upscale.ClearField("service_ns")
        self.assertEqual(first.header.upscale, again.header.upscale)
        plain.step(drive([100.0]))
        self.assertEqual(session.step(drive([100.0])).columns, plain.step(drive([100.0])).columns)

    def test_opening_twice_opens_once(self):
        session = self.open(paper_scene(), [1])
        again = self.bus.exchange(session.opening)
        self.assertTrue(again.code == pb.CODE_OK and again.header.replayed)

    def test_sequences_out_of_order_are_refused(self):
        session = self.open(paper_scene(), [1])
        session.step(drive([1.0]))
        session.step(drive([1.0]))
        body = {"downscale": {"dt_s": 1e-9, "mode": 1}}
        for sequence, code in ((1, pb.CODE_STALE_SEQUENCE), (2, pb.CODE_SEQUENCE_REUSED), (4, pb.CODE_SEQUENCE_GAP)):
            reply = self.bus.call(drive([2.0]), session_id=session.id, sequence=sequence, **body)
            self.assert_refused(reply, code)
            self.assertEqual((reply.header.status.last_sequence, reply.header.sequence), (2, sequence))
        self.assertEqual(session.step(drive([1.0])).header.upscale.state_version, 3)

    def test_unknown_sessions_and_epochs_are_refused(self):
        reply = self.bus.call(session_id=os.urandom(16), sequence=1, commit={})
        self.assert_refused(reply, pb.CODE_UNKNOWN_SESSION)
        session = self.open(paper_scene(), [1])
        reply = self.bus.call(drive([1.0]), session_id=session.id, sequence=1, epoch=reply.header.epoch ^ 1,
                              downscale={"dt_s": 1e-9, "mode": 1})
        self.assert_refused(reply, pb.CODE_EPOCH)

    # -- refusals change nothing --

    def test_refused_steps_change_nothing(self):
        session, plain = self.open(paper_scene(), [1, 2]), self.open(paper_scene(), [1, 2])
        nan = session.step({JUMP: [1.0, math.nan], PRESSURE: [1e9, 1e9]})
        self.assert_refused(nan, pb.CODE_INVALID_VALUE, "velocity_jump_m_per_s")
        self.assertEqual(list(nan.header.status.node_ids), [2])
        self.assert_refused(session.step({JUMP: [1.0, 1.0], PRESSURE: [1e9, math.inf]}), pb.CODE_INVALID_VALUE, "pressure_pa")
        self.assert_refused(session.step(drive([1.0, 1.0]), dt=0.0), pb.CODE_INVALID_VALUE)
        self.assert_refused(session.step(drive([1.0, 1.0]), dt=math.nan), pb.CODE_INVALID_VALUE)
        self.assert_refused(session.step({JUMP: [1.0, 1.0]}), pb.CODE_SHAPE, "pressure_pa")
        self.assert_refused(session.step(drive([1.0])), pb.CODE_SHAPE)
        self.assert_refused(session.step({JUMP: [1.0] * 2, PRESSURE: [1.0] * 2, STRESS_SOFT: [1.0] * 2}), pb.CODE_SHAPE)
        self.assert_refused(session.step({NODE_ID: [1, 3], **drive([1.0, 1.0])}), pb.CODE_UNKNOWN_NODE)
        self.assert_refused(session.step({NODE_ID: [2, 2], **drive([1.0, 1.0])}), pb.CODE_DUPLICATE_NODE)
        self.assert_refused(session.step(drive([1.0, 1.0]), mode=0), pb.CODE_MALFORMED)
        self.assert_refused(session.step(drive([1.0, 1.0]), mode=7), pb.CODE_MALFORMED)
        self.assert_refused(session.step(drive([1.0, 1.0]), commit_previous=True), pb.CODE_NOTHING_TO_COMMIT)
        self.assertEqual(session.step(drive([80.0, 90.0])).columns, plain.step(drive([80.0, 90.0])).columns)

    def test_damaged_messages_are_refused(self):
        session, plain = self.open(paper_scene(), [1]), self.open(paper_scene(), [1])
        header, payload = session.frames(drive([100.0]), downscale={"dt_s": 1e-9, "mode": 1})
        flipped = bytes([payload[0] ^ 1]) + payload[1:]
        self.assert_refused(self.bus.exchange([header, flipped]), pb.CODE_CHECKSUM)
        self.assert_refused(self.bus.exchange([header, payload[:-1]]), pb.CODE_CHECKSUM)
        self.assert_refused(self.bus.exchange([header]), pb.CODE_BAD_FRAMING)
        for count in (1, 2, 98):
            self.assert_refused(self.bus.exchange([header, payload, *[payload] * count]), pb.CODE_BAD_FRAMING)
        self.assert_refused(self.bus.exchange([header + header, payload]), pb.CODE_MALFORMED)
        self.assert_refused(self.bus.exchange([header + b"\x78\x01", payload]), pb.CODE_MALFORMED)
        self.assert_refused(self.bus.exchange([header[:-1], payload]), pb.CODE_MALFORMED)
        for garbage in (b"GET / HTTP/1.1\r\n\r\n", b"", bytes(1000), b"\xff" * 1000):
            self.assert_refused(self.bus.exchange([garbage]), pb.CODE_MALFORMED)
        self.assert_refused(self.bus.exchange([bytes(512 * 1024 + 1)]), pb.CODE_LIMIT)
        later = self.bus.header(session_id=session.id, sequence=1).SerializeToString() + b"\xfa\x02\x00"  # the unknown body 47
        self.assert_refused(self.bus.exchange([later]), pb.CODE_UNSUPPORTED)
        self.assertEqual(session.step(drive([100.0])).columns, plain.step(drive([100.0])).columns)

    def test_every_fault_of_a_scene_is_reported_with_its_line(self):
        scene = paper_scene(cells=0, layer="cels = 4") + "[hydro]\nend_time_s = 1\n"
        reply = Session(self.bus, scene, [1]).opened
        self.assert_refused(reply, pb.CODE_INVALID_SCENE, "layer.cells")
        lines = reply.header.status.text.splitlines()
        self.assertEqual([line.split(": ")[0] for line in lines],
                         ["outsider.toml:9:1", "outsider.toml:10:1", "outsider.toml:11:1"])
        self.assertIn('did you mean "cells"?', lines[1])
        self.assertIn("hydro is not a key of a scene", lines[2])
        self.assert_refused(Session(self.bus, "name = = 3", [1]).opened, pb.CODE_INVALID_SCENE)
        self.assert_refused(Session(self.bus, "#" * (256 * 1024 + 1), [1]).opened, pb.CODE_LIMIT)

    # -- closing --

    def test_closing_frees_the_session(self):
        before = self.bus.call(server_status={}).header.server_status
        session = Session(self.bus, paper_scene(), [1, 2])
        session.step(drive([1.0, 1.0]))
        during = self.bus.call(server_status={}).header.server_status
        self.assertEqual((during.sessions - before.sessions, during.nodes - before.nodes), (1, 2))
        closed = session.call(close_session={"reason": "done"})
        self.assertEqual(closed.header.session_closed.node_steps, 2)
        self.assert_refused(session.step(drive([1.0, 1.0])), pb.CODE_UNKNOWN_SESSION)
        after = self.bus.call(server_status={}).header.server_status
        self.assertEqual((after.sessions, after.nodes), (before.sessions, before.nodes))


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--endpoint", required=True)
    parser.add_argument("--protos", required=True, type=pathlib.Path)
    parser.add_argument("--work", required=True, type=pathlib.Path)
    parser.add_argument("--protoc", default="protoc")
    parser.add_argument("--server-key")
    parser.add_argument("--key")
    OPTIONS, rest = parser.parse_known_args()
    generate(OPTIONS.protoc, OPTIONS.protos, OPTIONS.work)
    unittest.main(argv=[sys.argv[0], *rest], verbosity=2)
