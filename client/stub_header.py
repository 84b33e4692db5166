#!/usr/bin/python3
"""Writes shearbus/shearbus_stub.h: shearbus.h, in which every function has a body that says that the program was built without the
library. Ends with a sentence where a declaration has no body here.

stub_header.py SHEARBUS_H VERSION FILE"""
import pathlib
import re
import sys

PROTO = pathlib.Path(__file__).resolve().parents[1] / "proto"
sys.path.insert(0, str(PROTO))
import contract  # noqa: E402

ABOUT = """/* shearbus.h for a program that is built without the library: the same types, constants and functions, in this file
 * alone. Printed from shearbus.h by the build; a host may keep a copy of it in its own tree:
 *
 *   #ifdef HAVE_SHEARBUS
 *   #include <shearbus/shearbus.h>
 *   #else
 *   #include "shearbus_stub.h"
 *   #endif
 *
 * An opening is SHEARBUS_NO_LIBRARY, whose text says what is missing, and there never is a session; so is each other call
 * that may fail. Names of codes and columns are those of the library; closing and leaving have nothing to do. client.hpp
 * and contact_law.hpp work over it where it is included before them. A program with the Fortran module compiles one C
 * file, too:
 *
 *   #define SHEARBUS_STUB_EXTERNAL
 *   #include "shearbus_stub.h"
 */
"""
LINKAGE = """#define SHEARBUS_STUB 1
#ifdef SHEARBUS_STUB_EXTERNAL
#define SHEARBUS_API
#else
#define SHEARBUS_API static inline
#endif"""
REPORT = r"""static inline int shearbus_stub_report(shearbus_status* status, int code, const char* text, const char* remedy) {
  if (status == NULL) return code;
  status->code = code;
  status->n_nodes = 0;
  status->field[0] = '\0';
  strncpy(status->text, text, sizeof status->text - 1);
  strncpy(status->remedy, remedy, sizeof status->remedy - 1);
  return code;
}
static inline int shearbus_stub_refuse(shearbus_status* status) {
  return shearbus_stub_report(status, SHEARBUS_NO_LIBRARY, "this program was built without the shearbus library",
                              "Build it with the library (find_package(shearbus) or pkg-config shearbus), or switch "
                              "its subgrid friction off.");
}

"""
FIELD_NUMBER = """  uint32_t field;
  for (field = 1; name != NULL && field < 256; ++field)
    if (shearbus_field_name(field) != NULL && strcmp(shearbus_field_name(field), name) == 0) return field;
  return 0;
"""
# Bodies by the type of the result.
BODIES = {"void": "", "const char*": '  return "";\n', "size_t": "  return 0;\n", "const uint64_t*": "  return NULL;\n",
          "int": "  return shearbus_stub_refuse(status);\n"}


def chosen(by, names, otherwise):
    """Returns the body of a function that gives the name of a number: of (constant, name)."""
    cases = "".join(f'    case {constant}: return "{name}";\n' for constant, name in names)
    return f"  switch ({by}) {{\n{cases}    default: return {otherwise};\n  }}\n"


def with_bodies(header, version):
    """Gives each declaration its body. Parameters that the body does not read are named in casts to void."""
    codes = re.findall(r"(SHEARBUS_([A-Z_]+)) = \d+", re.search(r"SHEARBUS_OK = 0.*?\};", header, re.S)[0])
    columns = [(f"SHEARBUS_{c.quantity.upper()}", c.name) for c in contract.columns(PROTO / "wire/columns.inc") if c.kind != "Node"]
    own = {"shearbus_code_name": chosen("code", codes, '"?"'), "shearbus_field_name": chosen("field", columns, "NULL"),
           "shearbus_field_number": FIELD_NUMBER, "shearbus_version": f'  return "{version} stub";\n',
           "shearbus_close": '  return shearbus_stub_report(status, SHEARBUS_OK, "", "");\n'}

    def defined(found):
        result, name, given = found[1], found[2], found[3]
        body = own.get(name, BODIES.get(result.strip()))
        if body is None:
            sys.exit(f"stub_header.py: {name} returns {result.strip()}, for which the stub has no body")
        names = [re.search(r"(\w+)\)?\s*$", word)[1] for word in re.sub(r"\[[^]]*\]", "", given).split(",")]
        unread = "".join(f"  (void){word};\n" for word in names if word != "void" and not re.search(rf"\b{word}\b", body))
        return f"SHEARBUS_API {result}{name}({given}) {{\n{unread}{body}}}\n"

    return re.sub(r"SHEARBUS_API ([^;{]*?[ *])(shearbus_\w+)\(([^;]*)\);", defined, header)


def main(source, version, target):
    header = pathlib.Path(source).read_text(encoding="utf-8")
    # The bodies report by functions that stand behind the status, whose type they need.
    for begin, end, text in (("/* The C interface", "#ifndef", ABOUT + "#ifndef"), ("#include <stdint.h>", "\n", "#include <stdint.h>\n#include <string.h>\n"),
                             ("#if defined(__GNUC__)", "#endif", LINKAGE), ("/* ---- columns ---- */", "\n", REPORT + "/* ---- columns ---- */\n")):
        header, count = re.subn(f"{re.escape(begin)}.*?{end}", lambda _, text=text: text, header, count=1, flags=re.S)
        if not count:
            sys.exit(f'stub_header.py: {source} has no "{begin}"')
    pathlib.Path(target).write_text(with_bodies(header, version), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
