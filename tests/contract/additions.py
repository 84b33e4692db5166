#!/usr/bin/python3
"""Adds a column, a regime, a bit of the outcome, status codes and a field to a copy of the contract, at the places that
.github/CONTRIBUTING.md names, prints what lists the contract, and checks that C, C++, Fortran and Python have them.

additions.py --source DIR --work DIR [--protoc PROTOC] [--cc CC] [--cxx CXX] [--fc FC]   (root of the sources; a directory for the copy)"""
import argparse
import pathlib
import re
import shutil
import subprocess
import sys
import unittest

OPTIONS = None
# Of the tree: what is printed, and what the compilers need to read it.
COPIED = ("proto", "client/include", "client/fortran", "client/mpi", "client/python/shearbus", "client/report/style.py", "client/ctl/watch_screen.cpp", "server/physics",
          ".github/CONTRIBUTING.md")
COLUMN = """OUTPUT(kDamage, 64, damage_j_per_m3, damage, "J/m3", Float64, Tangential, OnRequest, OnRequest, "damage of the interface")
"""
# Row of the page: {file: (text, addition, ...)}: each addition goes behind the text before it.
ADDITIONS = {
    "a column of the protocol": {
        "proto/wire/columns.inc": ("scenes with inertia\")\n", COLUMN),
        "proto/shearbus/v1/envelope.proto": ("FIELD_MEAN_FAR_STRESS_PA = 63;", "\n  FIELD_DAMAGE_J_PER_M3 = 64;"),
    },
    "a regime, a bit of the outcome": {
        "proto/shearbus/v1/downscale.proto": ("or a melt film carries the stress\n", "  REGIME_WELDED = 5;    // no slip any more\n"),
        "client/report/style.py": ('"MELTING": ("Tresca, melting", "#4a' '0012"),\n', '    "WELDED": ("welded", "#aa3377"),\n'),
        "client/ctl/watch_screen.cpp": ("178, 52", ", 133", '".-CT#', "W"),
    },
    "a status code": {
        "proto/shearbus/v1/envelope.proto": ("  CODE_NO_SPACE = 402;", "\n  // too many requests\n  // Remedy: wait\n  CODE_BUSY = 410;"),
    },
    "a field of a message": {
        "proto/shearbus/v1/control.proto": ("message Drain {", "\n  string reason = 3 [(wire).text = LONG];"),
    },
}
CPP = """#include "proto/wire/messages.hpp"
#include "proto/wire/enum_names.hpp"
using namespace shearbus::wire;
static_assert(static_cast<int>(Field::kDamage) == 64 && static_cast<int>(Regime::kWelded) == 5 && kRegimeCount == 6);
static_assert(static_cast<int>(Code::kBusy) == 410);
std::string reason(Drain drain) { return drain.reason; }
#include "server/physics/solver/tile.hpp"
static_assert(static_cast<int>(shearbus::physics::Regime::kWelded) == 5);
#include <array>
#include <string_view>
using namespace shearbus;
"""
C = """#include <shearbus/shearbus.h>
typedef char column[SHEARBUS_DAMAGE == 64 && SHEARBUS_REGIME_WELDED == 5 && SHEARBUS_BUSY == 410 ? 1 : -1];
"""
FORTRAN = """program host
  use shearbus
  type(shearbus_interface) :: bus
  allocate (bus%damage(3), bus%damage2(3))
  if (shearbus_regime_welded /= 5 .or. shearbus_code_busy /= 410) error stop
end program
"""
PYTHON = """import shearbus
column = shearbus.columns.BY_NAME["damage"]
assert (column.number, column.unit, column.tangential) == (64, "J/m3", True)
assert shearbus.Regime.WELDED == 5 and shearbus.Code.BUSY == 410
"""


def run(*command, text=None):
    found = subprocess.run([str(word) for word in command], input=text, text=True, capture_output=True, cwd=OPTIONS.work)
    return "" if found.returncode == 0 else found.stdout + found.stderr


def print_contract(*arguments):
    return run(sys.executable, "-B", OPTIONS.source / "proto/print_contract.py", "--protoc", OPTIONS.protoc, "--root", OPTIONS.work, *arguments)


class Additions(unittest.TestCase):
    def test_places_of_the_page_suffice(self):
        self.assertEqual(print_contract("--check"), "")
        page = (OPTIONS.work / ".github/CONTRIBUTING.md").read_text()
        for kind, places in ADDITIONS.items():
            row = re.search(rf"^\| {re.escape(kind)} \| (.*) \|$", page, re.M)
            self.assertIsNotNone(row, f"the page has no row {kind!r}")
            self.assertIn("proto/print_contract.py", row[1])
            for name, additions in places.items():
                self.assertTrue(name in row[1] or name.startswith("proto/shearbus/v1/") and "proto/shearbus/v1/*.proto" in row[1],
                                f"{kind}: the page does not name {name}")
                file = OPTIONS.work / name
                for behind, text in zip(additions[::2], additions[1::2]):
                    found = file.read_text()
                    self.assertEqual(found.count(behind), 1, f"{name}: {behind}")
                    file.write_text(found.replace(behind, behind + text))
        self.assertNotEqual(print_contract("--check"), "", "what was added must be printed")
        self.assertEqual(print_contract(), "")
        self.assertEqual(print_contract("--check"), "")
        work = OPTIONS.work
        drawn = re.search(r"^constexpr std::array kColours.*?^static_assert\(.*?;$", (work / "client/ctl/watch_screen.cpp").read_text(), re.M | re.S)
        self.assertIn("kLetters.size() == wire::kRegimeCount", drawn[0])
        watch = CPP + drawn[0]
        for language, fault in {
                "C++": run(OPTIONS.cxx, "-std=c++20", "-fsyntax-only", f"-I{work}", "-x", "c++", "-", text=watch),
                "C": run(OPTIONS.cc, "-std=c99", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-fsyntax-only", f"-I{work}/client/include", "-x", "c", "-", text=C),
                "Fortran, the module": run(OPTIONS.fc, "-std=f2008", "-Wall", "-Wextra", "-fsyntax-only", f"-J{work}", work / "client/fortran/shearbus.f90"),
                "Fortran": run(OPTIONS.fc, "-std=f2008", "-fsyntax-only", f"-I{work}", "-x", "f95", "-", text=FORTRAN),
                "pictures": run(sys.executable, "-B", OPTIONS.source / "tests/tidy/check_pictures.py", "--root", work),
                "Python": run("env", f"PYTHONPATH={work}/client/python", sys.executable, "-B", "-c", PYTHON),
        }.items():
            self.assertEqual(fault, "", language)
        self.assertIn(", 410 BUSY, ", (work / "proto/WIRE.md").read_text())

    def test_a_column_without_its_number_is_refused(self):
        file = OPTIONS.work / "proto/wire/columns.inc"
        text = file.read_text()
        file.write_text(text.replace("#undef COLUMN\n", COLUMN.replace("64", "65").replace("amage", "amages") + "#undef COLUMN\n"))
        self.assertIn("damages_j_per_m3", print_contract())
        file.write_text(text)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--source", required=True, type=pathlib.Path)
    parser.add_argument("--work", required=True, type=pathlib.Path)
    for name, default in (("protoc", "protoc"), ("cc", "cc"), ("cxx", "c++"), ("fc", "gfortran")):
        parser.add_argument(f"--{name}", default=default)
    OPTIONS, rest = parser.parse_known_args()
    shutil.rmtree(OPTIONS.work, ignore_errors=True)
    for name in COPIED:
        target = OPTIONS.work / name
        target.parent.mkdir(parents=True, exist_ok=True)
        copy = shutil.copytree if (OPTIONS.source / name).is_dir() else shutil.copy
        copy(OPTIONS.source / name, target)
    unittest.main(argv=[sys.argv[0], *rest], verbosity=2)
