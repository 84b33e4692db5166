#!/usr/bin/python3
"""shearbus_stub.h: a host compiles with it alone, in every language, needs nothing of the library, and says what is missing. The header has every
function of shearbus.h. stub.py --stub SHEARBUS_STUB_H --source ROOT"""
import argparse
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

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


def run(*command, expect=0):
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True)
    if done.returncode != expect:
        sys.exit(f"{' '.join(map(str, command))}: exit code {done.returncode}, expected {expect}\n{done.stdout}{done.stderr}")
    return done.stdout + done.stderr


def says_so(program):
    undefined = re.findall(r"U (shearbus_\w+)", run("nm", "-u", program))
    if undefined:
        sys.exit(f"{program.name} needs {undefined} of the library")
    done = subprocess.run([program, "constant_friction.toml"], capture_output=True, text=True)
    text = done.stdout + done.stderr
    if done.returncode == 0 or "NO_LIBRARY" not in text or SAYS not in text:
        sys.exit(f"{program.name} does not say that it has no library: exit code {done.returncode}\n{text}")


def functions(header):
    return set(re.findall(r"SHEARBUS_API [^;{]*?\b(shearbus_\w+)\(", header))


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--stub", type=pathlib.Path, required=True)
    parser.add_argument("--source", type=pathlib.Path, required=True)
    options = parser.parse_args()
    client = options.source / "client"
    declared, defined = functions((client / "include/shearbus/shearbus.h").read_text()), functions(options.stub.read_text())
    if declared != defined or len(declared) < 30:
        sys.exit(f"shearbus.h and the stub differ in {sorted(declared ^ defined)}, of {len(declared)} functions")
    with tempfile.TemporaryDirectory(prefix="shearbus-") as scratch:
        work = pathlib.Path(scratch)
        shutil.copy(options.stub, work)
        here = f"-I{work}"
        (work / "calls.c").write_text(CALLS)
        for compiler in (["gcc", "-std=c99"], ["g++", "-x", "c++", "-std=c++17"]):
            run(*compiler, *WARNINGS, "-Wconversion", here, work / "calls.c", "-o", work / "calls")
            run(work / "calls")
        (work / "host.c").write_text((client / "examples/host.c").read_text().replace("<shearbus/shearbus.h>", '"shearbus_stub.h"'))
        run("gcc", "-std=c99", *WARNINGS, here, work / "host.c", "-o", work / "host_c", "-lm")
        # A host in C++ has copies of the headers over the C interface, too.
        (work / "shearbus").mkdir()
        for header in ("client.hpp", "contact_law.hpp"):
            shutil.copy(client / "include/shearbus" / header, work / "shearbus")
        (work / "host.cpp").write_text('#include "shearbus_stub.h"\n#include "shearbus/contact_law.hpp"\n' + (client / "examples/host.cpp").read_text())
        run("g++", "-std=c++17", *WARNINGS, here, work / "host.cpp", "-o", work / "host_cxx")
        (work / "stub.c").write_text('#define SHEARBUS_STUB_EXTERNAL\n#include "shearbus_stub.h"\n')
        run("gcc", "-std=c99", *WARNINGS, here, "-c", work / "stub.c", "-o", work / "stub.o")
        run("gfortran", "-std=f2008", f"-J{work}", client / "fortran/shearbus.f90", client / "examples/host.f90", work / "stub.o", "-o", work / "host_f")
        for program in ("host_c", "host_cxx", "host_f"):
            says_so(work / program)
    print(f"{len(declared)} functions; hosts in C, C++ and Fortran say that they have no library")


if __name__ == "__main__":
    main()
