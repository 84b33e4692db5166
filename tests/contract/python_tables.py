#!/usr/bin/python3
"""Holds the tables of the Python client to the contract: its columns to proto/wire/columns.inc, its numbers to the .proto
files, its structs and functions to the C header.

python_tables.py --source DIR --work DIR --include DIR [--protoc PROTOC]   (root of the sources; a directory for the generated
modules; the directory of the generated header shearbus/columns.h)"""
import argparse
import ctypes
import pathlib
import re
import subprocess
import sys
import unittest

OPTIONS = None


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

    def test_structs_are_those_of_the_header(self):
        structs = [value for value in vars(_library).values() if isinstance(value, type) and issubclass(value, ctypes.Structure)
                   and hasattr(value, "_fields_")]
        self.assertGreaterEqual(len(structs), 8)
        lines, expected = [], {}
        for struct in structs:
            for name in {"shearbus_column": ("shearbus_input", "shearbus_output")}.get(struct.__name__, (struct.__name__,)):
                lines.append(f'printf("{name} %zu\\n", sizeof({name}));')
                expected[name] = ctypes.sizeof(struct)
                for field, _ in struct._fields_:
                    lines.append(f'printf("{name}.{field} %zu %zu\\n", offsetof({name}, {field}), sizeof((({name}*)0)->{field}));')
                    at = getattr(struct, field)
                    expected[f"{name}.{field}"] = at.offset, at.size
        program = OPTIONS.work / "structs"
        source = f"#include <stdio.h>\n#include <shearbus/shearbus.h>\nint main(void) {{ {' '.join(lines)} }}\n"
        subprocess.run(["cc", f"-I{OPTIONS.source}/client/include", f"-I{OPTIONS.include}", "-x", "c", "-", "-o", program],
                       input=source, text=True, check=True)
        found = {}
        for line in subprocess.run([program], check=True, capture_output=True, text=True).stdout.splitlines():
            name, *numbers = line.split()
            found[name] = int(numbers[0]) if len(numbers) == 1 else tuple(map(int, numbers))
        self.assertEqual(found, expected)
        # The last member of a struct ends it, so no later one is missing here.
        for struct in structs:
            last = getattr(struct, struct._fields_[-1][0])
            self.assertLess(ctypes.sizeof(struct) - last.offset - last.size, ctypes.alignment(struct), struct)
        self.assertEqual(answer.RESULT.size, _library.Result.replayed.offset + _library.Result.replayed.size)

    def test_functions_are_those_of_the_header(self):
        text = (OPTIONS.source / "client/include/shearbus/shearbus.h").read_text()
        declared = {name: (0 if given == "void" else given.count(",") + 1)
                    for name, given in re.findall(r"SHEARBUS_API [\w\s*]*?shearbus_(\w+)\((.*?)\);", text, re.S)}
        for name, (_, arguments) in _library.FUNCTIONS.items():
            self.assertEqual(len(arguments), declared.get(name), name)
        for first, last, names in ((r"SHEARBUS_SCENE_NAME", "SHEARBUS_ACCESS", range(8)),):
            listed = re.search(rf"enum {{\s*{first} = 0.*?{last} = \d+", text, re.S)[0]
            self.assertEqual([int(number) for number in re.findall(r" = (\d+)", listed)], list(names))

    def test_numbers_are_those_of_the_contract(self):
        server_side = {code.name: code.value for code in shearbus.Code if code < 500}
        header = (OPTIONS.source / "client/include/shearbus/shearbus.h").read_text()
        client_side = {name: int(number) for name, number in re.findall(r"^  SHEARBUS_(\w+) = (5\d\d),?", header, re.M)}
        self.assertEqual({code.name: code.value for code in shearbus.Code if code >= 500}, client_side)
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


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--source", required=True, type=pathlib.Path)
    parser.add_argument("--work", required=True, type=pathlib.Path)
    parser.add_argument("--include", required=True, type=pathlib.Path)
    parser.add_argument("--protoc", default="protoc")
    OPTIONS, rest = parser.parse_known_args()
    OPTIONS.columns_text = (OPTIONS.source / "proto/wire/columns.inc").read_text()
    sys.path.insert(0, str(OPTIONS.source / "client/python"))
    import shearbus
    from shearbus import _library, answer, session

    OPTIONS.work.mkdir(parents=True, exist_ok=True)
    protos = OPTIONS.source / "proto"
    # The generated modules are in a package "shearbus", too, so the client's package gets their directory as a second
    # place.
    subprocess.run([OPTIONS.protoc, f"-I{protos}", f"--python_out={OPTIONS.work}",
                    *sorted(str(p) for p in (protos / "shearbus/v1").glob("*.proto"))], check=True)
    shearbus.__path__.append(str(OPTIONS.work / "shearbus"))
    from shearbus.v1 import downscale_pb2, envelope_pb2 as pb

    downscale = downscale_pb2.DESCRIPTOR
    unittest.main(argv=[sys.argv[0], *rest], verbosity=2)
