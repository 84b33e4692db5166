#!/usr/bin/python3
"""Checks the worked exchange of proto/WIRE.md: the requests on the page are the bytes of the messages that they describe, a real server
answers them with the replies on the page, and the comments next to the bytes are correct.

wire_page.py --endpoint ENDPOINT --protos DIR --work DIR --page WIRE.md [--protoc PROTOC] [--write]
--write replaces the blocks of the page by the bytes of this server."""
import argparse
import pathlib
import re
import struct
import sys
import unittest

import outsider
from google.protobuf.descriptor import FieldDescriptor

SESSION = bytes(range(16))
NODE = 7
STEP = {"dt_s": 2e-8, "mode": 1}
COLUMNS = {outsider.JUMP: [100.0], outsider.PRESSURE: [11.2e9]}
BLOCK = re.compile(r"```hex (\w+)\n(.*?)```", re.S)
HEX_LINE = re.compile(r"((?:[0-9a-f]{2} )*[0-9a-f]{2})(?:  |$)")
BYTES_PER_LINE = 16
OF_THE_RUN = {  # fields that differ from run to run, from machine to machine and from release to release
    "ReplyHeader": ("epoch",),
    "Upscale": ("solver_ns", "service_ns"),
}
PAGE = None


def lines_of(data, comment):
    """Returns bytes as lines of the page; the first line has the comment."""
    rows = [data[i : i + BYTES_PER_LINE].hex(" ") for i in range(0, len(data), BYTES_PER_LINE)]
    return [f"{rows[0]:<{3 * BYTES_PER_LINE + 1}}{comment}".rstrip(), *rows[1:]]


def varint(data, at):
    value = shift = 0
    while True:
        byte = data[at]
        value |= (byte & 0x7F) << shift
        at, shift = at + 1, shift + 7
        if byte < 0x80:
            return value, at


def message_lines(data, descriptor, depth=0):
    """Yields the lines of a serialised message: one for each tag and its value, with field number, name and value."""
    at = 0
    while at < len(data):
        start = at
        tag, at = varint(data, at)
        field = descriptor.fields_by_number[tag >> 3]
        name = f"{'  ' * depth}{field.number} {field.name}"
        kind = tag & 7
        if kind == 0:
            value, at = varint(data, at)
            if field.type == FieldDescriptor.TYPE_ENUM:
                value = field.enum_type.values_by_number[value].name
            yield from lines_of(data[start:at], f"{name}: {value}")
        elif kind in (1, 5):
            size = 8 if kind == 1 else 4
            raw, at = data[at : at + size], at + size
            if field.type == FieldDescriptor.TYPE_DOUBLE:
                value = repr(struct.unpack("<d", raw)[0])
            else:
                value = f"0x{int.from_bytes(raw, 'little'):x}"
            yield from lines_of(data[start:at], f"{name}: {value}")
        else:
            length, at = varint(data, at)
            body, after = data[at : at + length], at + length
            if field.type == FieldDescriptor.TYPE_MESSAGE:
                yield from lines_of(data[start:at], f"{name}, {length} bytes:")
                yield from message_lines(body, field.message_type, depth + 1)
            elif field.type == FieldDescriptor.TYPE_STRING:
                yield from lines_of(data[start:after], f'{name}: "{body.decode()}"')
            else:
                yield from lines_of(data[start:after], f"{name}, {length} bytes")
            at = after


def payload_lines(frame, payload):
    """Yields the lines of a payload frame: one for each column and one for the zeros behind it."""
    at = 0
    for column in sorted(payload.columns, key=lambda c: c.offset_bytes):
        size = column.count * struct.calcsize(outsider.CODE[column.element])
        values = struct.unpack_from(f"<{column.count}{outsider.CODE[column.element]}", frame, column.offset_bytes)
        name = outsider.pb.Field.Name(column.field).removeprefix("FIELD_").lower()
        yield from lines_of(frame[column.offset_bytes : column.offset_bytes + size], f"{name}: {', '.join(map(repr, values))}")
        at = column.offset_bytes + size
        if at % 8:
            yield from lines_of(frame[at : at + -at % 8], "zeros up to a multiple of 8")


def block(frames, descriptor, header_class):
    """Returns the text of a block: each frame of a message with its number and size."""
    lines = [f"frame 0, the header, {len(frames[0])} bytes", *message_lines(frames[0], descriptor)]
    if len(frames) > 1:
        lines += [f"frame 1, the payload, {len(frames[1])} bytes",
                  *payload_lines(frames[1], header_class.FromString(frames[0]).payload)]
    return "\n".join(lines) + "\n"


def frames_of(text):
    """Returns the bytes of a block, frame by frame, from the hexadecimal digits only."""
    frames = []
    for line in text.splitlines():
        if line.startswith("frame "):
            frames.append(b"")
        elif match := HEX_LINE.match(line):
            frames[-1] += bytes.fromhex(match[1])
        else:
            raise ValueError(f"neither bytes nor the beginning of a frame: {line!r}")
    return frames


def without_the_run(message):
    """Returns a copy of a reply's header without the fields that differ between runs."""
    copy = type(message)()
    copy.CopyFrom(message)
    found = [copy]
    while found:
        part = found.pop()
        for name in OF_THE_RUN.get(part.DESCRIPTOR.name, ()):
            part.ClearField(name)
        found += [value for field, value in part.ListFields()
                  if field.type == FieldDescriptor.TYPE_MESSAGE and field.label != FieldDescriptor.LABEL_REPEATED]
    return copy


class Exchange:
    """The conversation of the page, held with a server: block name -> frames."""

    def __init__(self):
        self.bus = outsider.Connection()
        self.frames = {"hello": self.bus.frames(hello={"oldest_major": 1, "newest_major": 1, "client_name": "page"})}
        welcome = self.bus.exchange(self.frames["hello"])
        self.capabilities = list(welcome.header.welcome.capabilities)
        opened = self.bus.call({outsider.NODE_ID: [NODE]},
                               open_session={"scene": outsider.paper_scene(), "session_id": SESSION})
        assert opened.code == outsider.pb.CODE_OK, opened.header.status.text
        self.frames["downscale"] = self.bus.frames(COLUMNS, session_id=SESSION, sequence=1, downscale=STEP)
        self.frames["upscale"] = self.bus.exchange(self.frames["downscale"]).frames

    def close(self):
        self.bus.call(session_id=SESSION, sequence=2, close_session={"reason": "page read"})
        self.bus.close()


def header_class(name):
    return outsider.pb.RequestHeader if name in ("hello", "downscale") else outsider.pb.ReplyHeader


def text_of(name, frames):
    return block(frames, header_class(name).DESCRIPTOR, header_class(name))


def faults(page, exchange):
    """Yields the faults of the page."""
    blocks = dict(BLOCK.findall(page))
    if set(blocks) != set(exchange):
        yield f"expected the blocks {sorted(exchange)}, found {sorted(blocks)}"
        return
    for name, frames in exchange.items():
        try:
            written = frames_of(blocks[name])
            annotated = text_of(name, written)
            header = header_class(name).FromString(written[0])
        except Exception as fault:  # the bytes are not a message
            yield f"{name}: {fault}"
            continue
        if annotated != blocks[name]:
            yield f"{name}: a comment says something else than its bytes"
        if name in ("hello", "downscale"):
            if written != frames:
                yield f"{name}: the bytes are not those of the request"
        elif without_the_run(header) != without_the_run(header_class(name).FromString(frames[0])) or written[1:] != frames[1:]:
            yield f"{name}: the server answers otherwise"


class Page(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        exchange = Exchange()
        cls.exchange, cls.capabilities = exchange.frames, exchange.capabilities
        exchange.close()

    def test_the_page_shows_what_goes_over_the_wire(self):
        self.assertEqual(list(faults(PAGE, self.exchange)), [])

    def test_the_page_names_the_capabilities_of_the_welcome(self):
        row = re.search(r"Capabilities are (.*?)[;.]", PAGE, re.S)
        self.assertEqual(re.findall(r"`(\w+)`", row[1]), self.capabilities)

    def test_every_wrong_byte_and_comment_is_noticed(self):
        for name, text in BLOCK.findall(PAGE):
            run = without_the_run(header_class(name).FromString(frames_of(text)[0]))
            for line in text.splitlines():
                field = re.search(r"\d+ (\w+)[:,]|^.*?  ([a-z_0-9]+): ", line)
                if field and any(field[1] in names for names in OF_THE_RUN.values()):
                    continue  # the value is the server's own
                digit = "0" if line[0] != "0" else "1"
                for wrong in (line + ".", digit + line[1:]):
                    damaged = PAGE.replace(line + "\n", wrong + "\n", 1)
                    self.assertTrue(list(faults(damaged, self.exchange)), f"{name}: {line!r} as {wrong!r}; {run}")


def main():
    global PAGE
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--endpoint", required=True)
    parser.add_argument("--protos", required=True, type=pathlib.Path)
    parser.add_argument("--work", required=True, type=pathlib.Path)
    parser.add_argument("--page", required=True, type=pathlib.Path)
    parser.add_argument("--protoc", default="protoc")
    parser.add_argument("--write", action="store_true")
    options, rest = parser.parse_known_args()
    options.key = options.server_key = None
    outsider.OPTIONS = options
    outsider.generate(options.protoc, options.protos, options.work)
    PAGE = options.page.read_text()
    if options.write:
        exchange = Exchange()
        options.page.write_text(BLOCK.sub(lambda m: f"```hex {m[1]}\n{text_of(m[1], exchange.frames[m[1]])}```", PAGE))
        exchange.close()
        return
    unittest.main(argv=[sys.argv[0], *rest], verbosity=2)


if __name__ == "__main__":
    main()
