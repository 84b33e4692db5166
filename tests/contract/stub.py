#!/usr/bin/python3
"""shearbus_stub.h: a host compiles with it alone, in every language, needs nothing of the library, and says what is missing. The header has every
function of shearbus.h. stub.py --stub SHEARBUS_STUB_H --source ROOT"""
import pathlib
import re
import shutil
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import EXAMPLES, OPTIONS

CLIENT = EXAMPLES.parent
WARNINGS = ["-Wall", "-Wextra", "-Wpedantic", "-Werror"]
SAYS = "this program was built without the shearbus library"

# Every call that a host may make although it has no session; a name in a column is that of the library.
CALLS = """
#include <stdio.h>
#include <string.h>
#include "shearbus_stub.h"
int main(void) {
  shearbus_session* bus = NULL;
  shearbus_status status = SHEARBUS_STATUS_INIT;
  shearbus_options options = SHEARBUS_OPTIONS_INIT;
  const uint64_t id = 1;
  int faults = 0;
#define HOLDS(what) if (!(what)) { printf("not so: %s\\n", #what); ++faults; }
  HOLDS(shearbus_open(&bus, &options, 1, &id, NULL, &status) == SHEARBUS_NO_LIBRARY && status.code == SHEARBUS_NO_LIBRARY && bus == NULL);
  HOLDS(strstr(status.text, "built without the shearbus library") != NULL && strstr(status.remedy, "find_package") != NULL);
  HOLDS(shearbus_resume(&bus, &options, "", NULL) == SHEARBUS_NO_LIBRARY);
  HOLDS(shearbus_step(bus, NULL, NULL, &status) == SHEARBUS_NO_LIBRARY);
  HOLDS(shearbus_close(&bus, &status) == SHEARBUS_OK && status.text[0] == '\\0');
  shearbus_leave(&bus);
  HOLDS(strcmp(shearbus_code_name(514), "NO_LIBRARY") == 0 && strcmp(shearbus_code_name(301), "INVALID_VALUE") == 0);
  HOLDS(strcmp(shearbus_code_name(7), "?") == 0);
  HOLDS(strcmp(shearbus_field_name(SHEARBUS_PRESSURE), "pressure_pa") == 0 && shearbus_field_name(9999) == NULL);
  HOLDS(shearbus_field_number("pressure_pa") == SHEARBUS_PRESSURE && shearbus_field_number("pressure") == 0 && shearbus_field_number(NULL) == 0);
  HOLDS(shearbus_node_count(bus) == 0 && shearbus_node_ids(bus) == NULL && shearbus_warnings(bus)[0] == '\\0');
  HOLDS(strstr(shearbus_version(), "stub") != NULL && SHEARBUS_STUB);
  return faults;
}
"""


class Stub(served.Served):
    def compiled(self, *command):
        """Compiles a host below `path`, where the stub is. Returns the program."""
        self.run_program(*command, f"-I{self.path}", "-o", self.path / "host", "-lm")
        return self.path / "host"

    def assert_says_so(self, program):
        self.assertEqual(re.findall(r"U (shearbus_\w+)", self.run_program("nm", "-u", program).stdout), [], "it needs nothing of the library")
        done = self.run_program(program, "constant_friction.toml", code=1)
        for text in ("NO_LIBRARY", SAYS):
            self.assertIn(text, done.stdout + done.stderr)

    def test_hosts_in_every_language_say_that_they_have_no_library(self):
        stub = shutil.copy(OPTIONS.stub, self.path)
        functions = [set(re.findall(r"SHEARBUS_API [^;{]*?\b(shearbus_\w+)\(", pathlib.Path(file).read_text()))
                     for file in (CLIENT / "include/shearbus/shearbus.h", stub)]
        self.assertEqual(*functions)
        self.assertGreaterEqual(len(functions[0]), 30)
        calls, c_host, cxx_host, own = (self.path / name for name in ("calls.c", "host.c", "host.cpp", "stub.c"))
        calls.write_text(CALLS)
        for compiler in (["gcc", "-std=c99"], ["g++", "-x", "c++", "-std=c++17"]):
            self.run_program(self.compiled(*compiler, *WARNINGS, "-Wconversion", calls))
        c_host.write_text((EXAMPLES / "host.c").read_text().replace("<shearbus/shearbus.h>", '"shearbus_stub.h"'))
        self.assert_says_so(self.compiled("gcc", "-std=c99", *WARNINGS, c_host))
        # A host in C++ has copies of the headers over the C interface, too.
        (self.path / "shearbus").mkdir()
        for header in ("client.hpp", "contact_law.hpp"):
            shutil.copy(CLIENT / "include/shearbus" / header, self.path / "shearbus")
        cxx_host.write_text('#include "shearbus_stub.h"\n#include "shearbus/contact_law.hpp"\n' + (EXAMPLES / "host.cpp").read_text())
        self.assert_says_so(self.compiled("g++", "-std=c++17", *WARNINGS, cxx_host))
        own.write_text('#define SHEARBUS_STUB_EXTERNAL\n#include "shearbus_stub.h"\n')
        self.run_program("gcc", "-std=c99", *WARNINGS, f"-I{self.path}", "-c", own, "-o", self.path / "stub.o")
        self.assert_says_so(self.compiled("gfortran", "-std=f2008", f"-J{self.path}", CLIENT / "fortran/shearbus.f90", EXAMPLES / "host.f90",
                                          self.path / "stub.o"))


if __name__ == "__main__":
    served.main("stub", "source")
