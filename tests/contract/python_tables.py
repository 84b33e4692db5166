#!/usr/bin/python3
"""Holds the structs of the Python client to the C header; its columns, numbers and functions are printed from the contract.

python_tables.py --source DIR   (root of the sources)"""
import ctypes
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import OPTIONS
from shearbus import _library, answer


class Tables(served.Served):
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
        program = self.path / "structs"
        source = f"#include <stdio.h>\n#include <shearbus/shearbus.h>\nint main(void) {{ {' '.join(lines)} }}\n"
        self.run_program("cc", f"-I{OPTIONS.source}/client/include", "-x", "c", "-", "-o", program, input=source)
        found = {}
        for line in self.run_program(program).stdout.splitlines():
            name, *numbers = line.split()
            found[name] = int(numbers[0]) if len(numbers) == 1 else tuple(map(int, numbers))
        self.assertEqual(found, expected)
        # The last member of a struct ends it, so no later one is missing here.
        for struct in structs:
            last = getattr(struct, struct._fields_[-1][0])
            self.assertLess(ctypes.sizeof(struct) - last.offset - last.size, ctypes.alignment(struct), struct)
        self.assertEqual(answer.RESULT.size, _library.Result.replayed.offset + _library.Result.replayed.size)


if __name__ == "__main__":
    served.main("source")
