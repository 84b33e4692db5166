"""A server for the tests of a host: it answers the friction and the temperature of a problem, for whatever a host sends, and holds the
client to the protocol (proto/WIRE.md) and to closure: the jump that it answered is the jump that the host sends next.

Of the scene it reads tangential_components alone. Needs numpy, pyzmq and libxxhash (or the package xxhash); of the protocol it knows what a
step needs: hello, open_session, downscale, commit, rollback, mark, resume_session, close_session."""
import cmath
import copy
import ctypes
import os
import struct
import tomllib

import zmq

from ._door import listening
from .problems import Heat, Problem

MAGIC = 0x31425353
OK, BAD_FRAMING, MALFORMED, VERSION, CHECKSUM, SHAPE, UNSUPPORTED = 1, 100, 101, 102, 104, 105, 106
UNKNOWN_SESSION, STALE_SEQUENCE, SEQUENCE_GAP, SEQUENCE_REUSED, EPOCH, NOTHING_TO_COMMIT = 200, 201, 202, 203, 204, 205
RESUME_REFUSED, SUPERSEDED, UNKNOWN_MARK, INVALID_SCENE, INVALID_VALUE, UNKNOWN_NODE, DUPLICATE_NODE, SHUTTING_DOWN = 206, 207, 208, 300, 301, 302, 303, 400
HELLO, OPEN, STEP, COMMIT, ROLLBACK, CLOSE, RESUME, MARK = 16, 17, 18, 19, 20, 21, 23, 24  # bodies, also of replies
MAX_MARKS = 2
FLOAT64, UINT64, UINT8 = 1, 2, 3
CODE = {FLOAT64: "d", UINT64: "Q", UINT8: "B"}
NODE_ID, TEMPERATURE, PAIR, PARAMETER = 1, 2, 3, 4
JUMP, PRESSURE, STRESS_SOFT, STRESS_HARD, MASS_SOFT, MASS_HARD = 10, 11, 12, 13, 14, 15
STICK_STRESS, IMPEDANCE = 18, 19
REQUIRED = (JUMP, PRESSURE, STRESS_SOFT, STRESS_HARD, MASS_SOFT, MASS_HARD)
STICK_FORM = (JUMP, PRESSURE, STICK_STRESS, IMPEDANCE)
REPLY_COLUMNS = (30, 31, 32, 33, 36, 34, 35)
TANGENTIAL = (JUMP, STRESS_SOFT, STRESS_HARD, STICK_STRESS, 30, 31, 33)  # complex numbers here: two components, or a real one
HEAT_TO_SOFT, HEAT_TO_HARD, ENERGY_SOFT, ENERGY_HARD = ON_REQUEST = (41, 42, 70, 71)  # with friction_energy = true in the scene
STICK, SLIDING = 1, 2  # Regime
WIRE_TYPES = {  # field of a request's envelope -> wire type
    1: 5, 2: 0, 3: 0, 4: 1, 5: 2, 6: 0, 7: 1, 8: 2, **{body: 2 for body in range(16, 32)}}

CLOSURE = 1e-6  # m/s: far above rounding, far below any mistake of form
PHYSICS = 0.05  # error of the mean jump over the second half of a run, relative to what the friction has changed
REST = 0.02  # accepted jump of what should stand, relative to the first
ROUNDING = 1e-12  # of the pressure: stresses of bodies that are not sheared yet
FIRST_STEP = 0.05  # accepted error of the ratio of the first two steps, for hosts whose step varies
# Accepted errors of the jump after the first and the second step of a host with velocities at whole steps, relative to
# what the friction has changed. A host with velocities at half steps that begins with a whole step misses one of them.
WHOLE_STEPS = (0.05, 0.25)


# Every check, with what it holds a client to. A check that was never exercised has failed.
CHECKS = {
    "framing": "a request is one header frame, and one payload frame exactly when the header declares a payload",
    "header": "the header is a protobuf message whose fields are of the envelope, each once, with one body",
    "magic": "field 1 is 0x31425353",
    "version": "protocol_major is 1",
    "request_id": "every new request has a request_id of its own, not 0",
    "hello_first": "hello precedes every other request of a connection's client",
    "hello": "hello has a range of versions with 1 in it, and neither session, sequence nor epoch",
    "session_id": "the session id has 16 bytes, drawn at random",
    "resume_token": "the opening has a resume token of 16 random bytes, other than the session id",
    "opening": "the opening has a scene and its nodes, each once",
    "sequence": "the requests of a session are numbered 1, 2, 3, ...",
    "repeats": "a number is sent again only with the same bytes",
    "fresh_socket": "a repeated request comes on a fresh socket",
    "one_in_flight": "a request follows the answer to the one before",
    "epoch": "a request of a session carries the server's epoch",
    "payload_size": "the payload frame has the size of its header",
    "payload_sum": "the payload frame has the XXH3-64 of its header",
    "columns": "columns lie in the frame at multiples of 8, do not overlap, and come once",
    "elements": "each column has its own element type, and one element per row",
    "required": "a step has the columns 10 to 15, or in stick form 10, 11, 18 and 19",
    "finite": "all values are finite",
    "step": "dt is from 1e-18 to 1 s, and the mode is ADVANCE or TRIAL",
    "masses": "masses, or impedances, are positive",
    "closed": "the session is closed at the end",
    "pressure": "the pressure is the problem's: Pa, compression positive",
    "first_jump": "the first jump is V_soft - V_hard, in m/s, with its sign",
    "first_step": "the first step is half as long as the second: velocities live half a step before stresses. Velocities "
                  "may live at whole steps, in stick form or where the jump is exact from the first step on (Godunov)",
    "half_zones": "the masses are those of half zones of about the same transit time, the soft one's in column 14, or without strength "
                  "27.03 and 79 g/m2; an impedance is that of such masses",
    "closure": "the jump of a request is the jump that was answered: the host has applied the stress to both bodies",
    "far_stresses": "the stresses of the first step are 0, and later have the sign of the friction; the first stick "
                    "stress is that of the jump. Without strength this holds in every step",
    "jump": "the mean jump over the second half of the run is the exact one, within 5 % of what the friction has changed; "
            "for the plate away from the fronts",
    "long_enough": "the host has made 20 steps at least, until what the problem is about has happened",
    "rest": "after its stop (looked at from 720 ns on) and until the brake is eased at 1.1 us the plate does not move on the half-space; "
            "without strength nothing slides from 45 ns on",
    "restart": "after an EPOCH the session is claimed with its token, and the same request comes with the new epoch",
    "claim": "a claim has the number of the last claim plus one, a claimant, and the epoch of the question",
    "busy": "after SHUTTING_DOWN of a durable server the same bytes come again",
}
UNSEEN = "never seen"
PROTOCOL = [name for name in CHECKS if name not in ("restart", "claim", "busy", "repeats", "fresh_socket", "rest")]
REPEATED = ["repeats", "fresh_socket"]  # where a message was lost
RESTARTED = ["restart", "claim", "busy"]  # where the server was restarted


class Report:
    """What was seen of each check, and its first failure."""

    def __init__(self):
        self.seen, self.failed = {}, {}

    def check(self, name, holds, what=""):
        assert name in CHECKS
        self.seen[name] = self.seen.get(name, 0) + 1
        if not holds:
            self.failed.setdefault(name, what or "is not so")
        return holds

    def results(self, names):
        """Returns {name: None, or why it failed}."""
        return {name: self.failed.get(name) if name in self.seen else UNSEEN for name in names}


def xxh3(data):
    try:
        import xxhash
        return xxhash.xxh3_64_intdigest(data)
    except ImportError:
        library = ctypes.CDLL("libxxhash.so.0")
        library.XXH3_64bits.restype = ctypes.c_uint64
        library.XXH3_64bits.argtypes = [ctypes.c_char_p, ctypes.c_size_t]
        return library.XXH3_64bits(data, len(data))


# -- protobuf's wire format, as {field number: [values]} --

def varint(value):
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    return bytes([*out, value])


def read_varint(data, at):
    value = 0
    for shift in range(0, 70, 7):
        byte = data[at]
        value |= (byte & 0x7F) << shift
        at += 1
        if byte < 0x80:
            return value, at
    raise ValueError("a varint of more than ten bytes")


def read(data, types=None):
    """Returns {field number: values} of a message: numbers of varints and fixed fields, bytes of the others."""
    fields, at = {}, 0
    while at < len(data):
        tag, at = read_varint(data, at)
        number, kind = tag >> 3, tag & 7
        if types is not None and types.get(number) != kind:
            raise ValueError(f"field {number} of wire type {kind} is not of a request")
        if kind == 0:
            value, at = read_varint(data, at)
        else:
            size, at = read_varint(data, at) if kind == 2 else ({1: 8, 5: 4}[kind], at)
            value, at = data[at : at + size], at + size
            if at > len(data):
                raise ValueError("the message is cut off")
            value = value if kind == 2 else int.from_bytes(value, "little")
        fields.setdefault(number, []).append(value)
    return fields


def write(fields):
    """Returns the bytes of [(field number, value)]: int as varint, ("fixed64", int), ("fixed32", int), str, bytes or a
    nested list."""
    out = b""
    for number, value in fields:
        if isinstance(value, int):
            out += varint(number << 3) + varint(value)
        elif isinstance(value, tuple):
            size = 8 if value[0] == "fixed64" else 4
            out += varint(number << 3 | (1 if size == 8 else 5)) + value[1].to_bytes(size, "little")
        else:
            body = write(value) if isinstance(value, list) else value.encode() if isinstance(value, str) else value
            out += varint(number << 3 | 2) + varint(len(body)) + body
    return out


def double(value):
    return struct.unpack("<d", value.to_bytes(8, "little"))[0]


def shown(vector):
    """Returns the text of a complex number whose imaginary part is the second component."""
    return f"({vector.real:.9g}, {vector.imag:.9g})" if vector.imag else f"{vector.real:.9g}"


class Refusal(Exception):
    def __init__(self, code, text):
        super().__init__(text)
        self.code, self.text = code, text


def tangential_components(scene):
    try:
        found = tomllib.loads(scene.decode()).get("tangential_components", 1)
    except ValueError as fault:
        raise Refusal(INVALID_SCENE, f"expected a scene in TOML: {fault}") from None
    if found not in (1, 2):
        raise Refusal(INVALID_SCENE, f"tangential_components: expected 1 or 2, found {found!r}")
    return found


class Session:
    def __init__(self, token, nodes, scene, opening):
        self.token, self.nodes, self.scene = token, nodes, scene
        self.keys, self.parameters = [], {}  # keys of the scene by which nodes differ; their columns (the answer is that of the problem)
        self.components = tangential_components(scene)
        self.sequence, self.kept = 0, (opening, None)  # the last request's frames and the reply to it
        self.jumps = {}  # node -> the jump that was answered last
        self.tangents = {}  # node -> direction of its first jump
        self.energy = {}  # node -> friction energy of its steps, J/m2
        self.heat = Heat(nodes)
        self.standing = None
        self.steps, self.dts, self.time, self.version, self.claim = 0, [], 0.0, 0, 0
        self.errors = []  # (time, {node: error of its jump}) of each step, where the exact jump is known
        self.refused = None  # frames that a scripted fault refused
        self.marks = {}  # name -> MARKED of that time

    MARKED = ("jumps", "tangents", "energy", "heat", "steps", "dts", "time", "version", "errors")

    def mark(self, name):
        """Keeps the committed states, as the newest of MAX_MARKS."""
        self.marks.pop(name, None)
        self.marks[name] = copy.deepcopy({key: getattr(self, key) for key in self.MARKED})
        self.marks = dict(list(self.marks.items())[-MAX_MARKS:])

    def rollback_to(self, name):
        if name not in self.marks:
            raise Refusal(UNKNOWN_MARK, f"no mark has the name {name}; the session has {[*self.marks]}")
        vars(self).update(copy.deepcopy(self.marks[name]))


class MockServer:
    """Serves requests one by one. answer() is a function of bytes; serve() runs it on a ROUTER socket.

    restart_after: after so many steps the server behaves as a durable one that was restarted (EPOCH once, then
    SHUTTING_DOWN once); varying: friction falls slowly from step to step, so the answer to another step is not the
    answer to this one."""

    def __init__(self, problem="two_half_spaces", restart_after=None, varying=False):
        self.problem, self.report = Problem(problem), Report()
        self.epoch = int.from_bytes(os.urandom(8), "little") | 1
        self.restart_after, self.stopping_at, self.varying = restart_after, None, varying
        self.sessions, self.greeted, self.ids, self.peers, self.closed = {}, False, set(), {}, 0

    # -- a request, from frames to frames --

    def answer(self, frames, peer=b""):
        check = self.report.check
        header, request_id, session_id, sequence = {}, 0, b"", 0
        try:
            if not check("framing", 1 <= len(frames) <= 2, f"{len(frames)} frames"):
                raise Refusal(BAD_FRAMING, f"expected one or two frames, found {len(frames)}")
            header = self.envelope(frames)
            request_id, session_id, sequence = header.get(4, [0])[0], header.get(5, [b""])[0], header.get(6, [0])[0]
            body = next(number for number in header if number >= 16)
            fields = read(header[body][0])
            columns = self.payload(header, frames)
            if body not in (HELLO, OPEN, STEP, COMMIT, ROLLBACK, CLOSE, RESUME, MARK):
                raise Refusal(UNSUPPORTED, f"this mock server has no request {body}; it has what a step needs. Rehearse without it")
            reply_body, payload = self.request(body, fields, columns, header, frames, peer)
        except Refusal as refusal:
            status = [(1, refusal.code), (2, refusal.text)]
            session = self.sessions.get(session_id)
            if session and 201 <= refusal.code <= 203:
                status.append((6, session.sequence))
            return self.reply(request_id, session_id, sequence, [(9, status)])
        if reply_body is None:
            return payload  # the kept reply
        reply = self.reply(request_id, session_id, sequence, [(9, [(1, OK)]), (body, reply_body)], payload)
        if body in (STEP, COMMIT, ROLLBACK, CLOSE, MARK):
            self.sessions[session_id].kept = (frames, reply)
            if body == CLOSE:
                self.closed += 1
        elif body == OPEN:
            self.sessions[fields[2][0]].kept = (frames, reply)
        return reply

    def envelope(self, frames):
        check = self.report.check
        try:
            header = read(frames[0], WIRE_TYPES)
            once = all(len(values) == 1 for values in header.values()) and sum(number >= 16 for number in header) == 1
            if not check("header", once, "a field comes twice, or there is not one body"):
                raise ValueError("a field comes twice, or there is not one body")
        except (ValueError, IndexError, KeyError) as fault:
            check("header", False, str(fault))
            raise Refusal(MALFORMED, f"the header is no message of this protocol: {fault}") from None
        if not check("magic", header.get(1, [0])[0] == MAGIC, f"{header.get(1)}"):
            raise Refusal(MALFORMED, "expected the magic number 0x31425353")
        if not check("version", header.get(2, [0])[0] == 1, f"major {header.get(2)}"):
            raise Refusal(VERSION, f"expected version 1.0, found {header.get(2, [0])[0]}.{header.get(3, [0])[0]}")
        if not check("framing", (8 in header) == (len(frames) == 2), "the payload frame is not as the header declares"):
            raise Refusal(BAD_FRAMING, "the payload frame is not as the header declares")
        return header

    def payload(self, header, frames):
        """Returns {(field, component): values}."""
        if 8 not in header:
            return {}
        check, frame, columns = self.report.check, frames[1], {}
        try:
            declared = read(header[8][0])
            if not check("payload_size",
                         declared.get(1, [0])[0] == len(frame), f"{declared.get(1)} declared, {len(frame)} sent"):
                raise Refusal(CHECKSUM, "the payload has another size than its header says")
            if not check("payload_sum", declared.get(2, [0])[0] == xxh3(frame), "another sum"):
                raise Refusal(CHECKSUM, "the payload has another sum than its header says")
            used = []
            for column in map(read, declared.get(3, [])):
                field, component, element, offset, count = (column.get(i, [0])[0] for i in range(1, 6))
                expected = UINT64 if field == NODE_ID else FLOAT64
                if not check("elements", element == expected,
                             f"column {field} has the element {element}, expected {expected}"):
                    raise Refusal(SHAPE, f"column {field}: expected element {expected}, found {element}")
                end = offset + 8 * count
                apart = all(end <= a or offset >= b or a == b or offset == end for a, b in used)
                if not check("columns", offset % 8 == 0 and end <= len(frame) and apart and
                             (field, component) not in columns,
                             f"column {field} from {offset} to {end} of {len(frame)} bytes"):
                    raise Refusal(SHAPE, f"column {field} lies badly in the payload, or comes twice")
                used.append((offset, end))
                columns[field, component] = struct.unpack_from(f"<{count}{CODE[element]}", frame, offset)
        except (ValueError, IndexError, KeyError, struct.error) as fault:
            check("columns", False, str(fault))
            raise Refusal(MALFORMED, f"the payload is badly declared: {fault}") from None
        if not check("elements",
                     len({len(values) for values in columns.values()}) == 1, "columns of different lengths"):
            raise Refusal(SHAPE, "the columns have different lengths")
        return columns

    def reply(self, request_id, session_id, sequence, fields, payload=None):
        head = [(1, ("fixed32", MAGIC)), (2, 1), (4, ("fixed64", request_id))]
        head += [(5, session_id)] * bool(session_id) + [(6, sequence)] * bool(sequence) + [(7, ("fixed64", self.epoch))]
        if payload is None:
            return [write(head + fields)]
        frame, columns = b"", []
        for column, values in payload.items():
            field, component = column if isinstance(column, tuple) else (column, 0)
            element = UINT64 if field in (NODE_ID, PAIR) else UINT8 if field in (34, 35) else FLOAT64
            columns.append((3, [(1, field), (2, component), (3, element), (4, len(frame)), (5, len(values))]))
            frame += struct.pack(f"<{len(values)}{CODE[element]}", *values)
            frame += bytes(-len(frame) % 8)
        return [write(head + [(8, [(1, len(frame)), (2, ("fixed64", xxh3(frame))), *columns])] + fields), frame]

    # -- what requests do --

    def request(self, body, fields, columns, header, frames, peer):
        """Returns (body, payload) of the reply; (None, frames) for the kept reply to a repeated request."""
        check = self.report.check
        if body == HELLO:
            self.greeted = True
            plain = not header.get(5, [b""])[0] and not header.get(6, [0])[0] and not header.get(7, [0])[0]
            check("hello", plain and fields.get(1, [0])[0] <= 1 <= fields.get(2, [0])[0],
                  "its range has no 1, or its envelope is not empty")
            self.new_id(header)
            durability = "process" if self.restart_after is not None else "none"
            limits = [(1, 524288), (2, 33554432), (3, 200000), (4, 1024), (5, MAX_MARKS), (20, 2), (21, 1 << 30)]
            return [(1, 1), (3, "mock"), (4, limits), (5, "force_driven"), (5, "trial"), (5, "resume"),
                    (5, "stick_form"), (5, "parameters"), (6, durability), (20, "uid")], None
        check("hello_first", self.greeted, "no hello")
        if body == OPEN:
            return self.open(fields, columns, header, frames, peer)
        session = self.sessions.get(header.get(5, [b""])[0])
        if session is None:
            raise Refusal(UNKNOWN_SESSION, "no session of this id was opened")
        if body == RESUME:
            return self.resume(session, fields, header)
        sequence = header.get(6, [0])[0]
        if sequence == session.sequence:
            same = session.kept[0] == frames
            check("repeats", same, f"number {sequence} came again with other bytes")
            if not same:
                raise Refusal(SEQUENCE_REUSED, f"number {sequence} was used by a request with other bytes")
            check("fresh_socket",
                  self.peers.get(bytes(frames[0])) != peer, "the repeated request came on the same socket")
            return None, self.replayed(session.kept[1])
        if not check("sequence", sequence == session.sequence + 1, f"number {sequence} after {session.sequence}"):
            raise Refusal(STALE_SEQUENCE if sequence < session.sequence else SEQUENCE_GAP,
                          f"expected number {session.sequence + 1}, found {sequence}")
        self.faults_of_the_script(session, header, frames)
        check("epoch", header.get(7, [0])[0] == self.epoch, "another epoch, or none")
        if header.get(7, [0])[0] not in (0, self.epoch):
            raise Refusal(EPOCH, "this is another incarnation of the server")
        self.new_id(header)
        if body == STEP:
            answer = self.step(session, fields, columns)
        elif body == COMMIT:
            if session.standing is None:
                raise Refusal(NOTHING_TO_COMMIT, "no trial stands")
            self.accept(session)
            answer = [(1, session.version)], None
        elif body == ROLLBACK:
            session.standing, name = None, fields.get(1, [b""])[0].decode()
            if name:
                session.rollback_to(name)
            answer = [(1, session.version)] * bool(session.version), {NODE_ID: session.nodes} if name else None
        elif body == MARK:
            session.mark(fields.get(1, [b""])[0].decode())
            answer = [*[(1, session.version)] * bool(session.version), *((2, name) for name in session.marks)], None
        else:
            self.end(session)
            answer = [(1, session.sequence + 2), (2, session.steps * len(session.nodes))], None
        session.sequence = sequence
        self.peers[bytes(frames[0])] = peer
        return answer

    def new_id(self, header):
        number = header.get(4, [0])[0]
        self.report.check("request_id", number != 0 and number not in self.ids, f"{number:#x} is 0 or was used before")
        self.ids.add(number)

    def replayed(self, reply):
        return [reply[0] + write([(10, 1)]), *reply[1:]]

    def open(self, fields, columns, header, frames, peer):
        check = self.report.check
        session_id, token = fields.get(2, [b""])[0], fields.get(3, [b""])[0]
        if session_id in self.sessions:
            session = self.sessions[session_id]
            same = session.kept[0] == frames
            check("repeats", same, "the opening came again with other bytes")
            if not same:
                raise Refusal(SEQUENCE_REUSED, "the opening came again with other bytes")
            return None, self.replayed(session.kept[1])
        if not check("session_id", len(session_id) == 16 and len(set(session_id)) > 4, f"{session_id.hex()}"):
            raise Refusal(INVALID_VALUE, "session_id: expected 16 random bytes")
        check("resume_token", len(token) == 16 and len(set(token)) > 4 and token != session_id, f"{token.hex()}")
        nodes = columns.get((NODE_ID, 0), ())
        check("opening",
              bool(fields.get(1)) and len(nodes) > 0 and len(set(nodes)) == len(nodes), f"{len(nodes)} nodes")
        if not nodes or len(set(nodes)) != len(nodes):
            raise Refusal(DUPLICATE_NODE if nodes else SHAPE, "expected distinct nodes in column node_id")
        self.new_id(header)
        session = self.sessions[session_id] = Session(token, list(nodes), fields.get(1, [b""])[0], frames)
        session.keys = fields.get(9, [])
        session.parameters = {column: values for column, values in columns.items() if column[0] == PARAMETER}
        self.peers[bytes(frames[0])] = peer
        return self.opened(session), None

    def opened(self, session):
        """Returns the body session_opened. A mock server has no scene of its own: the text comes back as it was."""
        packed = lambda numbers: b"".join(map(varint, numbers))
        return [(1, session.scene), (4, 2), (5, session.components), (6, packed(REQUIRED)), (8, packed(REPLY_COLUMNS)), (9, packed(ON_REQUEST)),
                (10, "mock"),
                *((12, key) for key in session.keys)]

    def resume(self, session, fields, header):
        if fields.get(1, [b""])[0] != session.token:
            raise Refusal(RESUME_REFUSED, "not the token of the opening")
        claim = fields.get(2, [0])[0]
        if claim:
            right = claim == session.claim + 1 and fields.get(3, [0])[0] and header.get(7, [0])[0] == self.epoch
            if not self.report.check("claim", right, f"claim {claim} after {session.claim}"):
                raise Refusal(SUPERSEDED, "not the next claim, without a claimant, or with another epoch")
            session.claim = claim
        body = [(1, self.opened(session)), (2, session.sequence), (3, session.version), (5, session.claim)]
        pairs = {PAIR: [0] * len(session.nodes)} if session.keys else {}
        return [field for field in body if field[1] != 0], {NODE_ID: session.nodes, **pairs, **session.parameters}

    def faults_of_the_script(self, session, header, frames):
        """Behaves as a durable server that was restarted and is then told to stop, where the script says so."""
        if self.restart_after is None:
            return
        if session.refused is None and session.steps == self.restart_after:
            session.refused = frames
            self.epoch ^= 0x5A5A
            raise Refusal(EPOCH, "the server was restarted")
        if session.refused and self.stopping_at is None:
            claimed = session.claim > 0 and header.get(7, [0])[0] == self.epoch
            before, now = read(session.refused[0]), read(frames[0])
            same = {k: v for k, v in before.items() if k != 7} == {k: v for k, v in now.items() if k != 7
                                                                   } and frames[1:] == session.refused[1:]
            self.report.check("restart", claimed and same,
                              "not claimed, not the epoch of the claim, or another request")
            self.stopping_at = frames
            raise Refusal(SHUTTING_DOWN, "the server is stopping")
        if self.stopping_at is not None and self.stopping_at != "over":
            self.report.check("busy", self.stopping_at == frames, "another request")
            self.stopping_at = "over"

    # -- a step --

    def step(self, session, fields, columns):
        check = self.report.check
        dt, mode = double(fields.get(1, [0])[0]), fields.get(5, [0])[0]
        if fields.get(6, [0])[0]:
            if session.standing is None:
                raise Refusal(NOTHING_TO_COMMIT, "no trial stands")
            self.accept(session)
        if not check("step", 1e-18 <= dt <= 1 and mode in (1, 2), f"dt {dt}, mode {mode}"):
            raise Refusal(INVALID_VALUE, "expected dt from 1e-18 to 1 s, and mode 1 or 2")
        form = STICK_FORM if (STICK_STRESS, 0) in columns or (IMPEDANCE, 0) in columns else REQUIRED
        parts = lambda field: [(field, i) for i in range(session.components if field in TANGENTIAL else 1)]
        needed = [key for field in form for key in parts(field)]
        missing, surplus = [key for key in needed if key not in columns], [key for key in columns if key not in (*needed, (NODE_ID, 0))]
        if not check("required", not missing and not surplus, f"missing {missing}, surplus {surplus}"):
            raise Refusal(SHAPE, f"columns are missing {missing} or surplus {surplus}")
        nodes = columns.get((NODE_ID, 0), session.nodes)
        values = [map(complex, *(columns[key] for key in parts(field))) if field in TANGENTIAL else columns[field, 0] for field in form]
        rows = [dict(zip(form, row)) for row in zip(*values)]
        if not check("elements", len(rows) == len(nodes), f"{len(rows)} rows for {len(nodes)} nodes"):
            raise Refusal(SHAPE, f"expected {len(nodes)} rows, found {len(rows)}")
        if not set(nodes) <= set(session.nodes):
            raise Refusal(UNKNOWN_NODE, "a node is not of this session")
        if not check("finite", all(cmath.isfinite(value) for row in rows for value in row.values()), "not finite"):
            raise Refusal(INVALID_VALUE, "a value is not finite")
        positive = set(form) & {MASS_SOFT, MASS_HARD, IMPEDANCE}
        if not check("masses", all(row[field] > 0 for row in rows for field in positive), "not positive"):
            raise Refusal(INVALID_VALUE, "a mass or impedance is not positive")
        self.judge(session, dt, nodes, rows)
        answers = self.solve(session, dt, nodes, rows)
        if mode == 1:
            self.accept(session)
        wanted = []
        for packed in fields.get(7, []):
            at = 0
            while at < len(packed):
                number, at = read_varint(packed, at)
                wanted.append(number)
        part = lambda key, value: value.imag if key[1] else value.real if key[0] in TANGENTIAL else value
        payload = {key: [part(key, value) for value in answers[key[0]]]
                   for field in answers if field in (wanted or REPLY_COLUMNS) for key in parts(field)}
        body = [(1, len(nodes)), (2, session.version)]
        return [f for f in body if f[1]], payload

    def solve(self, session, dt, nodes, rows):
        """Returns {column: values} of a step of the committed states, which stands until it is accepted."""
        problem, answers = self.problem, {field: [] for field in (*REPLY_COLUMNS, *ON_REQUEST)}
        problem.factor = 1 / (1 + 1e-3 * session.steps * self.varying)
        jumps, stresses, energies, powers = {}, {}, {}, {}
        cold, warming = session.heat.begin(dt)
        for node, row in zip(nodes, rows):
            a, free = self.balance(row, dt)
            stick = free / a
            along = stick / abs(stick) if stick else 1.0
            before = (row[JUMP] / along).real
            # What the bodies lose; DLP (61).
            power = lambda s: max(0.0, s * (before + a * (abs(stick) - s)) / 2)
            size, temperature = problem.stress(abs(stick), power, lambda q: cold[node] + warming * q, row[PRESSURE])
            sliding = size < abs(stick)
            stress, new = (size * along, free - a * size * along) if sliding else (stick, 0j)
            heat = power(size) * dt
            jumps[node], stresses[node], powers[node] = new, stress, power(size)
            energies[node] = session.energy.get(node, 0.0) + heat
            part, rest = problem.to_soft, 1 - problem.to_soft
            for field, value in ((30, stress), (31, new), (32, temperature), (33, new), (36, part * heat),
                                 (34, SLIDING if sliding else STICK), (35, 0), (HEAT_TO_SOFT, part * heat), (HEAT_TO_HARD, rest * heat),
                                 (ENERGY_SOFT, part * energies[node]), (ENERGY_HARD, rest * energies[node])):
                answers[field].append(value)
        session.standing = dt, jumps, stresses, energies, powers
        return answers

    def balance(self, row, dt):
        """Returns what a stress of 1 Pa takes from the new jump (m/s), and the new jump without friction (m/s)."""
        if IMPEDANCE in row:
            return 1 / row[IMPEDANCE], row[STICK_STRESS] / row[IMPEDANCE]
        return (dt * (1 / row[MASS_SOFT] + 1 / row[MASS_HARD]),
                row[JUMP] + dt * (row[STRESS_SOFT] / row[MASS_SOFT] + row[STRESS_HARD] / row[MASS_HARD]))

    def accept(self, session):
        dt, jumps, stresses, energies, powers = session.standing
        session.standing = None
        session.jumps.update(jumps)
        session.energy.update(energies)
        session.heat.accept(dt, powers)
        session.steps, session.version, session.time = session.steps + 1, session.version + 1, session.time + dt
        session.dts.append(dt)
        along = lambda values, node: (values[node] / session.tangents[node]).real
        exact = {node: self.problem.exact_jump(session.time, along(stresses, node)) for node in jumps}
        errors = {node: along(jumps, node) - jump for node, jump in exact.items() if jump is not None}
        if errors:
            session.errors.append((session.time, errors))

    def judge(self, session, dt, nodes, rows):
        """Holds a request to the problem: it begins a step from the committed states."""
        check, problem = self.report.check, self.problem
        expected = [problem.pressure(session.time + part * dt) for part in (0.5, 0.0, 1.0)]  # within a step it may change
        for node, row in zip(nodes, rows):
            check("pressure", any(abs(row[PRESSURE] - p) < 1e-6 * abs(p) for p in expected),
                  f"{row[PRESSURE]:g} Pa at {session.time:g} s, expected {expected[0]:g}")
            self.judge_masses(session, dt, row)
            if problem.rest and problem.rest[0] < session.time < problem.rest[1]:
                check("rest", abs(row[JUMP]) < REST * problem.jump, f"node {node} moves with {shown(row[JUMP])} m/s at {session.time:g} s")
            # With two components the axes are the host's.
            first = session.tangents.setdefault(node, row[JUMP] / abs(row[JUMP]) if session.components == 2 and row[JUMP] else 1.0)
            if session.steps == 0:
                check("first_jump", abs(row[JUMP] - problem.jump * first) < CLOSURE, f"{shown(row[JUMP])} m/s, expected {problem.jump:g}")
            answered = session.jumps.get(node)
            if answered is not None:
                check("closure", abs(row[JUMP] - answered) < CLOSURE,
                      f"node {node}, step {session.steps}: the host has a jump of {shown(row[JUMP])} m/s, {shown(answered)} was answered")
            self.judge_far_stresses(session, row, first)
            if session.steps == 2:
                self.check_first_step(session, node, IMPEDANCE in row)

    def judge_masses(self, session, dt, row):
        """Looks at how long a wave takes across the zones of the masses, or without strength at the masses."""
        problem = self.problem
        if problem.masses:
            shares = ([row[IMPEDANCE] * dt * sum(1 / mass for mass in problem.masses)] if IMPEDANCE in row else
                      [row[field] / mass for field, mass in zip((MASS_SOFT, MASS_HARD), problem.masses)])
            self.report.check("half_zones", all(abs(share - 1) < 1e-3 for share in shares),
                              f"{' and '.join(f'{share:g}' for share in shares)} times the masses of the problem")
            return
        if IMPEDANCE in row:
            transit = [2 * row[IMPEDANCE] * dt * sum(1 / impedance for impedance in problem.impedance)]
        else:
            transit = [2 * row[mass] / z for mass, z in zip((MASS_SOFT, MASS_HARD), problem.impedance)]
        self.report.check(
            "half_zones",
            0.4 < transit[0] / transit[-1] < 2.5 and all(0.9 * dt < t < 20 * max(dt, *session.dts, 0.0) for t in transit),
            f"zones with transit times of {' and '.join(f'{t:g}' for t in transit)} s for dt {dt:g} s: the masses are not those of half "
            "zones, or their sides are swapped")

    def judge_far_stresses(self, session, row, tangent):
        check, problem = self.report.check, self.problem
        if session.steps == 0 or problem.masses:
            if IMPEDANCE in row:
                check("far_stresses", abs(row[STICK_STRESS] / row[IMPEDANCE] - row[JUMP]) < CLOSURE,
                      f"the stick stress is {shown(row[STICK_STRESS])} Pa, expected {shown(row[IMPEDANCE] * row[JUMP])}")
            else:
                most = ROUNDING * problem.pressure(0.0)
                check("far_stresses", max(abs(row[STRESS_SOFT]), abs(row[STRESS_HARD])) <= most,
                      f"{shown(row[STRESS_SOFT])} and {shown(row[STRESS_HARD])} Pa, expected 0 (at most {most:g}, as rounding)")
        elif not problem.finite and len(problem.pressures) == 1 and IMPEDANCE not in row:
            # Behind the front the stress is the friction under the pressure that was sent; a coarse host rings around it.
            friction = problem.limit(row[PRESSURE], problem.start)
            if friction == 0.0:
                return  # the check of the pressure has failed
            shares = [(row[field] / tangent).real / friction for field in (STRESS_SOFT, STRESS_HARD)]
            check("far_stresses", all(-0.7 < share < 1.7 for share in shares),
                  f"{shown(row[STRESS_SOFT])} and {shown(row[STRESS_HARD])} Pa, expected about {friction:g}: "
                  f"{'the sign of a stress is wrong' if min(shares) <= -0.7 else 'a stress is too large: is it that of the interface zone, in Pa?'}")

    def check_first_step(self, session, node, sticks):
        """Checks the length of the first step, by that of the second and the jumps after both."""
        first, second = session.dts[:2]
        half, whole = (abs(first / second - part) < FIRST_STEP for part in (0.5, 1.0))
        errors = [step[node] / self.problem.changed(first) for _, step in session.errors[:2] if node in step]
        exact = len(errors) == 2 and all(abs(error) < most for error, most in zip(errors, WHOLE_STEPS))
        found = f"{first:g} s, then {second:g} s"
        if whole:
            found += "; the jumps after them are off by " + " and ".join(f"{error:+.0%}" for error in errors)
        self.report.check("first_step", half or whole and (sticks or exact), found)

    def end(self, session):
        """Judges a run when its session is closed."""
        check, problem = self.report.check, self.problem
        check("closed", True)
        check("one_in_flight", True)
        long = session.time > problem.long_enough
        check("long_enough", session.steps >= 20 and long,
              f"{session.steps} steps, {session.time:.3g} s, expected at least 20 and more than {problem.long_enough:.3g} s")
        late = [errors for time, errors in session.errors if time > session.time / 2]
        for node in late[-1] if late else ():
            errors = [step[node] for step in late if node in step]
            mean = sum(errors) / len(errors)
            check("jump",
                  abs(mean) < PHYSICS * problem.changed(session.time),
                  f"node {node}: on average {mean:+.3g} m/s off; the friction has changed the jump by "
                  f"{problem.changed(session.time):.3g} m/s. " +
                  ("The host does not begin as the problem does: see first_jump" if "first_jump" in self.report.failed else
                   "The host rings for want of a first step of half the length: see first_step" if "first_step" in self.report.failed else
                   "Where the host closes, its area is wrong, or its material"))

    # -- the socket --

    def serve(self, endpoint, stop=lambda: False, until_closed=True, ready=lambda bound: None):
        """Answers requests until a session was closed, or `stop` says so. Calls `ready` with the endpoint once it listens. Raises
        Refused for an endpoint that cannot be had."""
        socket = zmq.Context.instance().socket(zmq.ROUTER)
        socket.setsockopt(zmq.LINGER, 200)
        monitor = socket.get_monitor_socket(zmq.EVENT_DISCONNECTED)
        try:
            with listening(socket, endpoint) as bound:
                ready(bound)
                while not stop() and not (until_closed and self.closed):
                    if socket.poll(20):
                        self.answer_waiting(socket)
                if until_closed and self.closed:
                    monitor.poll(5000)  # ms; the reply may still be on its way
        finally:
            socket.disable_monitor()
            monitor.close()
            socket.close()

    def answer_waiting(self, socket):
        peer, *frames = socket.recv_multipart()
        waiting = []
        while socket.poll(0):  # a second message that came before the answer to the first
            waiting.append(socket.recv_multipart())
        for other, *more in [(peer, *frames), *waiting]:
            if other == peer and more != frames:
                self.report.check("one_in_flight", False, "a request came before the answer to the one before")
            socket.send_multipart([other, *self.answer(more, other)])
