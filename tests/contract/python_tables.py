#!/usr/bin/python3
"""Holds the tables of the Python client to the contract: its columns and numbers to the .proto files, its structs and functions to
the C header.

python_tables.py --source DIR --work DIR [--protoc PROTOC]   (root of the sources; a directory for the generated modules)"""
import argparse
import ctypes
import pathlib
import re
import subprocess
import sys
import unittest

OPTIONS = None


class Tables(unittest.TestCase):
    def test_columns_are_those_of_the_schema(self):
        self.assertEqual({f"FIELD_{column.wire_name.upper()}": column.number for column in shearbus.COLUMNS},
                         {name: number for name, number in pb.Field.items() if number})
        self.assertEqual(len(shearbus.columns.BY_NAME), len(shearbus.COLUMNS))
        self.assertEqual(shearbus.columns.LEDGER, tuple(range(40, 49)))
        self.assertEqual(shearbus.columns.PROFILE, tuple(range(50, 56)))

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
        subprocess.run(["cc", f"-I{OPTIONS.source}/client/include", "-x", "c", "-", "-o", program],
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
        self.assertEqual({name: len(arguments.split()) for name, _, arguments in _library.FUNCTIONS}, declared)
        for first, last, names in ((r"SHEARBUS_SCENE_NAME", "SHEARBUS_ACCESS", range(8)),):
            listed = re.search(rf"enum {{\s*{first} = 0.*?{last} = \d+", text, re.S)[0]
            self.assertEqual([int(number) for number in re.findall(r" = (\d+)", listed)], list(names))

    def test_numbers_are_those_of_the_contract(self):
        server_side = {code.name: code.value for code in shearbus.Code if code < 500}
        client_side = {code.name: code.value for code in shearbus.Code if code >= 500}
        for codes, enum, prefix in ((server_side, pb.Code, "CODE_"), (client_side, pb.ClientCode, "CLIENT_CODE_")):
            self.assertEqual(codes, {name.removeprefix(prefix): number for name, number in enum.items() if number})
        for values, enum in ((shearbus.Regime, "Regime"), (shearbus.Outcome, "Outcome")):
            expected = {
                v.name.removeprefix(enum.upper() + "_"): v.number for v in downscale.enum_types_by_name[enum].values
            }
            expected.pop("OK", None)
            if enum == "Outcome":
                expected["FALLBACK"] = downscale.enum_types_by_name["ClientOutcome"].values_by_name["CLIENT_OUTCOME_FALLBACK"].number
            self.assertEqual({name: value for name, value in vars(values).items() if name.isupper()}, expected)
        self.assertEqual({f"STRATEGY_{name.upper()}": number for number, name in session.STRATEGY.items()},
                         {v.name: v.number for v in downscale.enum_types_by_name["Strategy"].values if v.number})


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--source", required=True, type=pathlib.Path)
    parser.add_argument("--work", required=True, type=pathlib.Path)
    parser.add_argument("--protoc", default="protoc")
    OPTIONS, rest = parser.parse_known_args()
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
