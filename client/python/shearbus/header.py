"""The headers of the protocol: protobuf's wire format, written by hand for the messages that a client needs. The fields
stand in this file once; tests/contract/python_tables.py holds them to the .proto files and the bytes to protobuf's
own."""
import functools
import struct
from types import SimpleNamespace

from .columns import BY_NUMBER, DTYPE

MAGIC = 0x31425353
PROTOCOL_MAJOR, PROTOCOL_MINOR = 1, 0

VARINT, FIXED64, LENGTH, FIXED32 = 0, 1, 2, 5  # wire types
# kind of a field -> its wire type; `numbers` is a packed list of varints
WIRE_TYPE = {"uint": VARINT, "bool": VARINT, "double": FIXED64, "fixed64": FIXED64, "fixed32": FIXED32, "bytes": LENGTH,
             "string": LENGTH, "numbers": LENGTH}


def varint(value):
    """Returns the bytes of a varint."""
    out = bytearray()
    while value > 0x7F:
        out.append(value & 0x7F | 0x80)
        value >>= 7
    out.append(value)
    return bytes(out)


def read_varint(data, at):
    """Returns a varint of `data` and the offset behind it. Raises IndexError at the end of the data."""
    byte = data[at]
    if byte < 0x80:
        return byte, at + 1
    value, shift = byte & 0x7F, 7
    while True:
        at += 1
        byte = data[at]
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at + 1
        shift += 7
        if shift > 63:
            raise ValueError("a varint of more than ten bytes")


_WRITE = {
    "uint": varint, "bool": varint, "double": struct.Struct("<d").pack, "fixed64": struct.Struct("<Q").pack,
    "fixed32": struct.Struct("<I").pack, "bytes": bytes, "string": str.encode,
    "numbers": lambda values: b"".join(map(varint, values))
}
_READ = {
    "string": bytes.decode, "bool": bool, "double": lambda bits: struct.unpack("<d", bits.to_bytes(8, "little"))[0]
}


class Field:
    def __init__(self, name, number, kind, repeated=False):
        self.name, self.number, self.kind = name, number, kind
        self.repeated = repeated or kind == "numbers"
        self.message = kind if isinstance(kind, Message) else None
        self.wire_type = LENGTH if self.message else WIRE_TYPE[kind]
        self.tag = varint(number << 3 | (LENGTH if repeated else self.wire_type))
        self.default = () if self.repeated else None if self.message else {"bytes": b"", "string": "", "double": 0.0,
                                                                          "bool": False}.get(kind, 0)
        self.write = kind.encode if self.message else _WRITE[kind]  # value -> bytes behind the tag, without a length
        self.read = kind.decode if self.message else _READ.get(kind)  # bytes or number of the wire -> value


class Message:
    """A message: encode() makes bytes of a dict, decode() an object with an attribute for each field."""

    def __init__(self, name, *fields, kept=False):
        """`fields` are rows (name, number, kind[, repeated]); the kind is a key of WIRE_TYPE or a Message. `kept`:
        decoded messages are shared between equal bytes, for small messages that come again and again."""
        self.name = name
        self.fields = sorted((Field(*field) for field in fields), key=lambda field: field.number)
        self.by_number = {field.number: field for field in self.fields}
        self.by_name = {field.name: field for field in self.fields}
        self.defaults = {field.name: field.default for field in self.fields}
        if kept:
            self.decode = functools.lru_cache(4096)(self.decode)

    def encode(self, values):
        """Returns the bytes of {field name: value}, fields in the order of the dict; default values take no bytes. The
        value of a message may be its bytes."""
        out = []
        for name, value in values.items():
            field = self.by_name[name]
            if value is None or (not value and not field.message):
                continue
            if field.repeated and field.kind == "fixed64":
                value = b"".join(map(field.write, value))
                out += (field.tag, varint(len(value)), value)
                continue
            for item in value if field.repeated and field.kind != "numbers" else (value,):
                body = item if type(item) is bytes else field.write(item)
                out += (field.tag, varint(len(body)), body) if field.wire_type == LENGTH else (field.tag, body)
        return b"".join(out)

    def decode(self, data):
        """Returns the message in `data`. Ignores fields that a later minor version has added. Raises ValueError or
        IndexError where the bytes are not such a message."""
        found = dict(self.defaults)
        at, end = 0, len(data)
        while at < end:
            tag = data[at]
            at += 1
            if tag > 0x7F:
                tag, at = read_varint(data, at - 1)
            wire_type = tag & 7
            if wire_type == LENGTH:
                size, at = read_varint(data, at)
                at, begin = at + size, at
                value = data[begin:at]
            elif wire_type == VARINT:
                value, at = read_varint(data, at)
            else:
                size = 8 if wire_type == FIXED64 else 4 if wire_type == FIXED32 else None
                if size is None:
                    raise ValueError(f"{self.name}: unknown wire type {wire_type}")
                at, begin = at + size, at
                value = int.from_bytes(data[begin:at], "little")
            if at > end:
                raise ValueError(f"{self.name} is cut off")
            field = self.by_number.get(tag >> 3)
            if field is None:
                continue
            if field.repeated and field.kind in ("numbers", "fixed64"):  # packed, or one by one
                many = (value,) if wire_type != LENGTH else self._unpacked(field.kind, value)
                found[field.name] = (*found[field.name], *many)
                continue
            if wire_type != field.wire_type:
                raise ValueError(f"{self.name}.{field.name} has the wire type {wire_type}")
            if field.read is not None:
                value = field.read(value)
            found[field.name] = (*found[field.name], value) if field.repeated else value
        return SimpleNamespace(**found)

    @staticmethod
    def _unpacked(kind, data):
        if kind == "fixed64":
            if len(data) % 8:
                raise ValueError("a list of numbers is cut off")
            return struct.unpack(f"<{len(data) // 8}Q", data)
        values, at = [], 0
        while at < len(data):
            value, at = read_varint(data, at)
            values.append(value)
        return values


# -- shearbus/v1/envelope.proto and control.proto: what a client sends and receives --

COLUMN = Message("Column", ("field", 1, "uint"), ("component", 2, "uint"), ("element", 3, "uint"),
                 ("offset_bytes", 4, "uint"), ("count", 5, "uint"),
                 kept=True)


class Layout(tuple):
    """The columns of a payload. `end`: size of the frame that they need; `parts`: {name: columns in the order of their
    components}."""

    @functools.cached_property
    def end(self):
        return max(
            (c.offset_bytes + c.count * (DTYPE[c.element].itemsize if c.element in DTYPE else 2**63) for c in self),
            default=0)

    @functools.cached_property
    def parts(self):
        parts = {}
        for column in sorted(self, key=lambda column: column.component):
            if column.field in BY_NUMBER:
                parts.setdefault(BY_NUMBER[column.field].name, []).append(column)
        return {
            name: parts[name] for name in dict.fromkeys(BY_NUMBER[c.field].name for c in self if c.field in BY_NUMBER)
        }


class PayloadMessage(Message):
    """The message Payload, of which decode() reads the columns once: they are the same in every reply of a session."""

    def decode(self, data):
        if data[:1] != b"\x08":
            return self._whole(data)
        size, at = read_varint(data, 1)
        columns = at + 9
        if data[at : at + 1] != b"\x11" or data[columns : columns + 1] != b"\x1a":
            return self._whole(data)
        return SimpleNamespace(size_bytes=size,
                               xxh3=int.from_bytes(data[at + 1:columns], "little"),
                               columns=_layout(data[columns:]))

    def _whole(self, data):
        found = super().decode(data)
        found.columns = Layout(found.columns)
        return found


PAYLOAD = PayloadMessage("Payload", ("size_bytes", 1, "uint"), ("xxh3", 2, "fixed64"), ("columns", 3, COLUMN, True))


@functools.lru_cache(1024)
def _layout(data):
    return PAYLOAD._whole(data).columns


STATUS = Message("Status", ("code", 1, "uint"), ("text", 2, "string"), ("remedy", 3, "string"), ("field", 4, "string"),
                 ("node_ids", 5, "fixed64", True), ("last_sequence", 6, "uint"))
LIMITS = Message("Limits", ("max_header_bytes", 1, "uint"), ("max_payload_bytes", 2, "uint"),
                 ("max_nodes_per_session", 3, "uint"), ("max_sessions", 4, "uint"), ("max_marks", 5, "uint"),
                 ("max_frames", 20, "uint"), ("max_state_bytes", 21, "uint"), ("max_work_budget", 22, "uint"),
                 ("max_replay_work", 23, "uint"), ("max_rows_per_message", 30, "uint"),
                 ("max_sessions_per_user", 31, "uint"), ("max_state_bytes_per_user", 32, "uint"))

HELLO = Message("Hello", ("oldest_major", 1, "uint"), ("newest_major", 2, "uint"), ("client_name", 3, "string"))
OPEN_SESSION = Message("OpenSession", ("scene", 1, "string"), ("session_id", 2, "bytes"), ("resume_token", 3, "bytes"),
                       ("scene_file", 5, "string"), ("domain", 4, "string"), ("check_closure", 6, "bool"),
                       ("idle_limit_s", 7, "uint"), ("pairs", 8, "string", True), ("parameters", 9, "string", True))
DOWNSCALE = Message("Downscale", ("dt_s", 1, "double"), ("time_s", 2, "double"), ("step", 3, "uint"),
                    ("attempt", 4, "uint"), ("mode", 5, "uint"), ("commit_previous", 6, "bool"),
                    ("wanted", 7, "numbers"), ("policy", 8, "uint"), ("part", 9, "uint"), ("parts", 10, "uint"),
                    ("absent_nodes", 11, "uint"), ("follows", 12, "fixed64"))
COMMIT = Message("Commit")
ROLLBACK = Message("Rollback", ("to_mark", 1, "string"))
CLOSE_SESSION = Message("CloseSession", ("reason", 1, "string"))
RESUME_SESSION = Message("ResumeSession", ("resume_token", 1, "bytes"), ("claim", 2, "uint"),
                         ("claimant", 3, "fixed64"))
MARK = Message("Mark", ("name", 1, "string"))
REGISTER_NODES = Message("RegisterNodes", ("pairs", 1, "string", True))
RETIRE_NODES = Message("RetireNodes")
OFFER_NODES = Message("OfferNodes", ("transfer_id", 1, "bytes"))
ACCEPT_NODES = Message("AcceptNodes", ("transfer_id", 1, "bytes"))
READ_PROFILES = Message("ReadProfiles")

WELCOME = Message("Welcome", ("protocol_major", 1, "uint"), ("protocol_minor", 2, "uint"),
                  ("server_version", 3, "string"), ("limits", 4, LIMITS), ("capabilities", 5, "string", True),
                  ("durability", 6, "string"), ("access", 20, "string"))
SESSION_OPENED = Message("SessionOpened", ("effective_scene", 1, "string"), ("bytes_per_node", 2, "uint"),
                         ("warnings", 3, "string", True), ("strategy", 4, "uint"), ("tangential_components", 5, "uint"),
                         ("required_columns", 6, "numbers"), ("optional_columns", 7, "numbers"),
                         ("reply_columns", 8, "numbers"), ("columns_on_request", 9, "numbers"),
                         ("scene_name", 10, "string"), ("pairs", 11, "string", True),
                         ("parameters", 12, "string", True))
UPSCALE = Message("Upscale", ("nodes", 1, "uint"), ("state_version", 2, "uint"), ("solver_ns", 3, "uint"),
                  ("service_ns", 4, "uint"), ("flagged_nodes", 5, "uint"), ("largest_closure_m_per_s", 6, "double"),
                  ("closure_node", 7, "uint"), ("layer_time_s", 8, "double"), ("warnings", 9, "string", True))
COMMITTED = Message("Committed", ("state_version", 1, "uint"))
ROLLED_BACK = Message("RolledBack", ("state_version", 1, "uint"))
SESSION_CLOSED = Message("SessionClosed", ("requests", 1, "uint"), ("node_steps", 2, "uint"), ("solver_ns", 3, "uint"),
                         ("asleep_node_steps", 6, "uint"))
SESSION_RESUMED = Message("SessionResumed", ("session", 1, SESSION_OPENED), ("last_sequence", 2, "uint"),
                          ("state_version", 3, "uint"), ("trial_stands", 4, "bool"), ("claim", 5, "uint"),
                          ("offers", 6, "bytes", True), ("claimant", 7, "fixed64"))
MARKED = Message("Marked", ("state_version", 1, "uint"), ("names", 2, "string", True))
NODES_CHANGED = Message("NodesChanged", ("nodes", 1, "uint"))
PROFILES = Message("Profiles", ("nodes", 1, "uint"), ("vertices", 2, "uint"), ("state_version", 3, "uint"))

_ENVELOPE = (("magic", 1, "fixed32"), ("protocol_major", 2, "uint"), ("protocol_minor", 3, "uint"), ("request_id", 4,
                                                                                                     "fixed64"),
             ("session_id", 5, "bytes"), ("sequence", 6, "uint"), ("epoch", 7, "fixed64"), ("payload", 8, PAYLOAD))
REQUEST_HEADER = Message("RequestHeader", *_ENVELOPE, ("hello", 16, HELLO), ("open_session", 17, OPEN_SESSION),
                         ("downscale", 18, DOWNSCALE), ("commit", 19, COMMIT), ("rollback", 20, ROLLBACK),
                         ("close_session", 21, CLOSE_SESSION), ("resume_session", 23, RESUME_SESSION),
                         ("mark", 24, MARK), ("register_nodes", 25, REGISTER_NODES), ("retire_nodes", 26, RETIRE_NODES),
                         ("offer_nodes", 27, OFFER_NODES), ("accept_nodes", 28, ACCEPT_NODES), ("read_profiles", 32, READ_PROFILES))
REPLY_HEADER = Message("ReplyHeader", *_ENVELOPE, ("status", 9, STATUS), ("replayed", 10, "bool"),
                       ("welcome", 16, WELCOME), ("session_opened", 17, SESSION_OPENED), ("upscale", 18, UPSCALE),
                       ("committed", 19, COMMITTED), ("rolled_back", 20, ROLLED_BACK),
                       ("session_closed", 21, SESSION_CLOSED), ("session_resumed", 23, SESSION_RESUMED),
                       ("marked", 24, MARKED), ("nodes_changed", 25, NODES_CHANGED), ("profiles", 32, PROFILES))
