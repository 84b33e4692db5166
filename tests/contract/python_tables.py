#!/usr/bin/python3
"""Holds the tables of the Python client to the contract: its columns to proto/wire/columns.inc, its messages and
numbers to the .proto files, and its bytes to those of protobuf over random messages.

python_tables.py --source DIR --work DIR [--protoc PROTOC]   (root of the sources; a directory for the generated
modules)"""
import argparse
import os
import pathlib
import random
import re
import subprocess
import sys
import unittest

OPTIONS = None
SEED = int(os.environ.get("SHEARBUS_SEED", "20260101"))
KIND = {"TYPE_UINT32": "uint", "TYPE_UINT64": "uint", "TYPE_ENUM": "uint", "TYPE_BOOL": "bool", "TYPE_DOUBLE": "double",
        "TYPE_FIXED64": "fixed64", "TYPE_FIXED32": "fixed32", "TYPE_BYTES": "bytes", "TYPE_STRING": "string"}


def arguments(text):
    """Returns the arguments of a macro call, without the quotes of texts."""
    return [part.strip().strip('"') for part in re.findall(r'(?:"(?:[^"\\]|\\.)*"|[^,"])+', text)]


def rows_of(text):
    """Yields each row of columns.inc as {parameter of COLUMN: argument}, by expanding the macros of the file."""
    text = re.sub(r"\\\n\s*", "", re.sub(r"^\s*//.*$", "", text, flags=re.M))
    meaning = re.search(r"COLUMN\(([^)]*)\)", re.sub(r"//\s*", "", OPTIONS.columns_text.replace("\n//", " ")))[1]
    names = arguments(meaning)
    macros = {name: (arguments(parameters), arguments(body))
              for name, parameters, body in re.findall(r"#define (\w+)\(([^)]*)\)\s*COLUMN\(([^)]*)\)", text)}
    for macro, body in re.findall(r"^([A-Z]+)\((.*?)\)$", re.sub(r"\n[ \t]+", " ", text), re.M):
        if macro in macros:
            parameters, expansion = macros[macro]
            given = dict(zip(parameters, arguments(body)))
            yield dict(zip(names, (given.get(word, word) for word in expansion)))


def column_faults(columns, text):
    """Yields the differences between the table of the client and the rows of columns.inc."""
    element = {"Float64": 1, "Uint64": 2, "Uint8": 3}
    expected = {
        int(row["number"]):
        (row["name"], row["quantity"], row["unit"], element[row["element"]], row["direction"] == "Tangential")
        for row in rows_of(text)
    }
    found = {c.number: (c.wire_name, c.quantity, c.unit, c.element, c.tangential) for c in columns}
    for number in sorted(expected.keys() | found.keys()):
        if expected.get(number) != found.get(number):
            yield f"column {number}: columns.inc has {expected.get(number)}, the Python client {found.get(number)}"


def messages_of(header):
    found = {}
    for value in vars(header).values():
        if isinstance(value, header.Message):
            found[value.name] = value
    return found


def message_faults(message, descriptor):
    """Yields the differences between a message of the client and its descriptor."""
    def row(field):
        kind = field.message_type.name if field.message_type else KIND[next(
            k for k in KIND if getattr(type(field), k, None) == field.type)]
        repeated = field.label == field.LABEL_REPEATED
        return field.number, "numbers" if repeated and kind == "uint" else kind, repeated

    expected = {field.name: row(field) for field in descriptor.fields}
    found = {
        field.name: (field.number, field.message.name if field.message else field.kind, field.repeated)
        for field in message.fields
    }
    for name in found:  # a field of the schema that the client does not know is safe to ignore (WIRE.md, "Versions")
        if expected.get(name) != found[name]:
            yield f"{message.name}.{name}: the schema has {expected.get(name)}, the Python client {found[name]}"


class Tables(unittest.TestCase):
    def test_columns_are_those_of_the_contract(self):
        self.assertGreater(len(list(rows_of(OPTIONS.columns_text))), 25)
        self.assertEqual(list(column_faults(shearbus.COLUMNS, OPTIONS.columns_text)), [])
        for column in shearbus.COLUMNS:
            self.assertEqual(pb.Field.Name(column.number), f"FIELD_{column.wire_name.upper()}")
        self.assertEqual(len(shearbus.columns.BY_NAME), len(shearbus.COLUMNS))

    def test_a_column_without_a_row_or_with_another_is_noticed(self):
        for i, column in enumerate(shearbus.COLUMNS):
            others = shearbus.COLUMNS[:i] + shearbus.COLUMNS[i + 1:]
            self.assertEqual(len(list(column_faults(others, OPTIONS.columns_text))), 1)
            wrong = (*others, column._replace(tangential=not column.tangential))
            self.assertEqual(len(list(column_faults(wrong, OPTIONS.columns_text))), 1)
        more = OPTIONS.columns_text + 'OUTPUT(kNew, 99, new_pa, new, "Pa", Float64, Scalar, Reply, Reply, "added")\n'
        self.assertEqual(len(list(column_faults(shearbus.COLUMNS, more))), 1)

    def test_messages_are_those_of_the_contract(self):
        messages = messages_of(header)
        self.assertGreater(len(messages), 25)
        for name, message in messages.items():
            descriptor = symbols.message_types_by_name.get(name) or control.message_types_by_name.get(name) \
                or downscale.message_types_by_name[name]
            self.assertEqual(list(message_faults(message, descriptor)), [])
            for field in message.fields:
                row = field.name, field.number + 100, field.message or field.kind, field.repeated
                wrong = header.Message(name, row)
                self.assertEqual(len(list(message_faults(wrong, descriptor))), 1)

    def test_numbers_are_those_of_the_contract(self):
        server_side = {code.name: code.value for code in shearbus.Code if code < 500}
        self.assertEqual(server_side,
                         {name.removeprefix("CODE_"): number for name, number in pb.Code.items() if number})
        for values, enum in ((shearbus.Regime, "Regime"), (shearbus.Outcome, "Outcome")):
            expected = {
                v.name.removeprefix(enum.upper() + "_"): v.number for v in downscale.enum_types_by_name[enum].values
            }
            expected.pop("OK", None)
            self.assertEqual({name: value for name, value in vars(values).items() if name.isupper()}, expected)
        self.assertEqual({f"STRATEGY_{name.upper()}": number for number, name in session.STRATEGY.items()},
                         {v.name: v.number for v in downscale.enum_types_by_name["Strategy"].values if v.number})
        self.assertEqual({column.number for column in shearbus.COLUMNS} & set(shearbus.columns.LEDGER),
                         set(range(40, 49)))

    def random_values(self, message, draw):
        values = {}
        for field in message.fields:
            if draw.random() < 0.3:
                continue
            many = draw.randrange(5) if field.repeated else 1
            items = [
                self.random_values(field.message, draw) if field.message else {
                    "uint": lambda: draw.choice([0, 1, 127, 128, 300, 2**31 - 1]), "numbers":
                    lambda: draw.choice([0, 1, 127, 128, 2**32 - 1]), "bool": lambda: draw.random() < 0.5, "double":
                    lambda: draw.choice([0.0, 1e-9, -3.5, 1e300]), "fixed64": lambda: draw.getrandbits(64), "fixed32":
                    lambda: draw.getrandbits(32), "bytes": lambda: draw.randbytes(draw.randrange(200)), "string":
                    lambda: draw.choice(["", "paper.toml", "µs \"x\"\n"])
                }[field.kind]() for _ in range(many)
            ]
            values[field.name] = items if field.repeated else items[0]
        return values

    def of_protobuf(self, values, target):
        for name, value in values.items():
            if isinstance(value, dict):
                getattr(target, name).SetInParent()
                self.of_protobuf(value, getattr(target, name))
            elif isinstance(value, list) and value and isinstance(value[0], dict):
                for item in value:
                    self.of_protobuf(item, getattr(target, name).add())
            elif isinstance(value, list):
                getattr(target, name).extend(value)
            else:
                setattr(target, name, value)
        return target

    def assert_same(self, found, target):
        for field, value in target.ListFields():
            mine = getattr(found, field.name)
            if field.message_type and field.label == field.LABEL_REPEATED:
                self.assertEqual(len(mine), len(value))
                for a, b in zip(mine, value):
                    self.assert_same(a, b)
            elif field.message_type:
                self.assert_same(mine, value)
            else:
                self.assertEqual(list(mine) if field.label == field.LABEL_REPEATED else mine,
                                 list(value) if field.label == field.LABEL_REPEATED else value, field.name)

    def test_bytes_are_those_of_protobuf(self):
        draw = random.Random(SEED)
        for kind, target in ((header.REQUEST_HEADER, pb.RequestHeader), (header.REPLY_HEADER, pb.ReplyHeader)):
            for round_ in range(300):
                values = self.random_values(kind, draw)
                bodies = [
                    field.name for field in target.DESCRIPTOR.oneofs_by_name["body"].fields if field.name in values
                ]
                for name in set(bodies) - set(draw.sample(bodies, min(1, len(bodies)))):
                    del values[name]
                expected = self.of_protobuf(values, target())
                self.assertEqual(kind.encode(values), expected.SerializeToString(deterministic=True),
                                 f"seed {SEED}, round {round_}")
                self.assert_same(kind.decode(kind.encode(values)), expected)

    def test_damaged_bytes_are_refused_or_read(self):
        draw = random.Random(SEED)
        for _ in range(2000):
            data = bytearray(header.REPLY_HEADER.encode(self.random_values(header.REPLY_HEADER, draw)))
            for _ in range(draw.randrange(1, 4)):
                if data:
                    data[draw.randrange(len(data))] = draw.randrange(256)
            try:
                header.REPLY_HEADER.decode(bytes(data[: draw.randrange(len(data) + 1)]))
            except (ValueError, IndexError):
                pass  # the errors that a caller turns into UnexpectedReply


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--source", required=True, type=pathlib.Path)
    parser.add_argument("--work", required=True, type=pathlib.Path)
    parser.add_argument("--protoc", default="protoc")
    OPTIONS, rest = parser.parse_known_args()
    OPTIONS.columns_text = (OPTIONS.source / "proto/wire/columns.inc").read_text()
    sys.path.insert(0, str(OPTIONS.source / "client/python"))
    import shearbus
    from shearbus import header, session

    OPTIONS.work.mkdir(parents=True, exist_ok=True)
    protos = OPTIONS.source / "proto"
    # The generated modules are in a package "shearbus", too, so the client's package gets their directory as a second
    # place.
    subprocess.run([OPTIONS.protoc, f"-I{protos}", f"--python_out={OPTIONS.work}",
                    *sorted(str(p) for p in (protos / "shearbus/v1").glob("*.proto"))], check=True)
    shearbus.__path__.append(str(OPTIONS.work / "shearbus"))
    from shearbus.v1 import control_pb2, downscale_pb2, envelope_pb2 as pb

    symbols, control, downscale = pb.DESCRIPTOR, control_pb2.DESCRIPTOR, downscale_pb2.DESCRIPTOR
    unittest.main(argv=[sys.argv[0], *rest], verbosity=2)
