#!/usr/bin/python3
"""Adds a column, a regime, a bit of the outcome, status codes and a field to a copy of the contract, at the places that
.github/CONTRIBUTING.md names, prints what lists the contract, and checks that C, C++, Fortran and Python have them.

additions.py --protoc PROTOC --cc CC --cxx CXX"""
import pathlib
import re
import shutil
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import OPTIONS

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


class Additions(served.Served):
    def setUp(self):
        super().setUp()
        for name in COPIED:
            target = self.path / name
            target.parent.mkdir(parents=True, exist_ok=True)
            (shutil.copytree if (served.SOURCE / name).is_dir() else shutil.copy)(served.SOURCE / name, target)

    def run_here(self, *command, **more):
        return self.run_program(*command, cwd=self.path, **more)

    def print_contract(self, *arguments, code=0):
        program = served.SOURCE / "proto/print_contract.py"
        return self.run_here(sys.executable, "-B", program, "--protoc", OPTIONS.protoc, "--root", self.path, *arguments, code=code)

    def test_places_of_the_page_suffice(self):
        self.print_contract("--check")
        page = (self.path / ".github/CONTRIBUTING.md").read_text()
        for kind, places in ADDITIONS.items():
            row = re.search(rf"^\| {re.escape(kind)} \| (.*) \|$", page, re.M)
            self.assertIsNotNone(row, f"the page has no row {kind!r}")
            self.assertIn("proto/print_contract.py", row[1])
            for name, additions in places.items():
                self.assertTrue(name in row[1] or name.startswith("proto/shearbus/v1/") and "proto/shearbus/v1/*.proto" in row[1],
                                f"{kind}: the page does not name {name}")
                file = self.path / name
                for behind, text in zip(additions[::2], additions[1::2]):
                    found = file.read_text()
                    self.assertEqual(found.count(behind), 1, f"{name}: {behind}")
                    file.write_text(found.replace(behind, behind + text))
        self.print_contract("--check", code=1)  # what was added must be printed
        self.print_contract()
        self.print_contract("--check")
        path, strict, fortran = self.path, ("-Wall", "-Wextra", "-Wpedantic", "-Werror"), ("gfortran", "-std=f2008", "-fsyntax-only")
        drawn = re.search(r"^constexpr std::array kColours.*?^static_assert\(.*?;$", (path / "client/ctl/watch_screen.cpp").read_text(), re.M | re.S)
        self.assertIn("kLetters.size() == wire::kRegimeCount", drawn[0])
        self.run_here(OPTIONS.cxx, "-std=c++20", "-fsyntax-only", f"-I{path}", "-x", "c++", "-", input=CPP + drawn[0])
        self.run_here(OPTIONS.cc, "-std=c99", *strict, "-fsyntax-only", f"-I{path}/client/include", "-x", "c", "-", input=C)
        self.run_here(*fortran, "-Wall", "-Wextra", f"-J{path}", path / "client/fortran/shearbus.f90")
        self.run_here(*fortran, f"-I{path}", "-x", "f95", "-", input=FORTRAN)
        self.run_here(sys.executable, "-B", served.SOURCE / "tests/tidy/check_pictures.py", "--root", path)
        self.run_here("env", f"PYTHONPATH={path}/client/python", sys.executable, "-B", "-c", PYTHON)
        self.assertIn(", 410 BUSY, ", (path / "proto/WIRE.md").read_text())

    def test_a_column_without_its_number_is_refused(self):
        file = self.path / "proto/wire/columns.inc"
        file.write_text(file.read_text().replace("#undef COLUMN\n", COLUMN.replace("64", "65").replace("amage", "amages") + "#undef COLUMN\n"))
        self.assertIn("damages_j_per_m3", self.print_contract(code=1).stderr)


if __name__ == "__main__":
    served.main("protoc", "cc", "cxx")
