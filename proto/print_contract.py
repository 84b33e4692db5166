#!/usr/bin/python3
"""Prints what lists the contract, from shearbus/v1/*.proto, wire/columns.inc and wire/units.inc: the messages and enums of C++, the tables of shearbus.h,
Fortran and Python, the regimes and outcomes of the physics, and the codes of WIRE.md; and from shearbus.h the structs and functions of Fortran and
what Python calls. What is printed is committed.

print_contract.py              writes the files
print_contract.py --check      fails where a file is not as printed, and shows the difference
print_contract.py --self-test  shows that a file which is not as printed is noticed

Part of a file stands between two lines, one with "print_contract.py: NAME" and one with "print_contract.py: end"."""
import argparse
import difflib
import itertools
import pathlib
import re
import sys
import textwrap

import contract
from contract import FAR_FIELD_FORM, Contract

ROOT = pathlib.Path(__file__).resolve().parents[1]
WIDTH = 120
PRINTED = "Printed by proto/print_contract.py from shearbus/v1/*.proto"

# ---- C++ ----

# What C++ has beyond the schema: types of enums that are columns or packed, and the values that a struct has at first.
BASES = {"Regime": "std::uint8_t", "Outcome": "std::uint8_t", "Code": "std::uint16_t", "Element": "std::uint32_t"}
ALIASES = {"session_id": "SessionId", "after": "SessionId", "resume_token": "ResumeToken", "transfer_id": "TransferId", "offers": "TransferId"}
INITIAL = {"oldest_major": "kProtocolMajor", "newest_major": "kProtocolMajor", "protocol_major": "kProtocolMajor",
           "protocol_minor": "kProtocolMinor", "durability": '"none"', "tangential_components": "1", "Downscale.mode": "Mode::kAdvance",
           "max_header_bytes": "kMaxHeaderBytes", "max_payload_bytes": "kMaxPayloadBytes", "max_nodes_per_session": "kMaxNodesPerSession",
           "max_sessions": "kMaxSessions", "max_marks": "kMaxMarks", "max_frames": "kMaxFrames", "max_rows_per_message": "kMaxRowsPerMessage",
           "max_sessions_per_user": "kMaxSessions"}
TYPES = {1: "double", 4: "std::uint64_t", 6: "std::uint64_t", 8: "bool", 9: "std::string", 13: "std::uint32_t"}
FIXED64, BYTES, MESSAGE, ENUM, REPEATED = 6, 12, 11, 14, 3
ENVELOPE = ("Payload", "Column", "Status", "RequestHeader", "ReplyHeader")  # written by hand: codec.cpp, batch.hpp, status.hpp


def camel(name):
    return "k" + "".join(word.capitalize() for word in name.split("_"))


def enumerator(enum, value):
    return "kOutcomeOk" if (enum, value.name) == ("Outcome", "OK") else camel(value.name)


def values_of(what, name):
    """Returns the values of an enum; those of Code include the codes of clients."""
    values = what.enums[name].values
    return values + what.enums["ClientCode"].values[1:] if name == "Code" else values


def outcomes_of(what):
    """Returns the bits of the outcome, and the outcomes of clients."""
    return what.enums["Outcome"].values[1:] + what.enums["ClientOutcome"].values[1:]


def filled(prefix, items, suffix, indent=2):
    """Returns items between prefix and suffix, on one line or on several."""
    line = f"{prefix} {', '.join(items)} {suffix}"
    if len(line) <= WIDTH:
        return [line]
    body = textwrap.wrap(", ".join(item.replace(" ", "\0") for item in items), WIDTH - indent - 1)
    return [prefix, *(" " * indent + line.replace("\0", " ") for line in body), suffix]


def enums_hpp(what):
    lines = [f"// {PRINTED}, which explain the values. clang-format does not see this file.", "// clang-format off", "#pragma once", "",
             "#include <cstddef>", "#include <cstdint>", "", '#include "proto/wire/enum_value.hpp"', "", "namespace shearbus::wire {"]
    for name in sorted(what.enums.keys() - {"ClientCode", "ClientOutcome"}):
        values = values_of(what, name)
        kind = ("enum " if name == "Outcome" else "enum class ") + name + (f" : {BASES[name]}" if name in BASES else "")
        lines += ["", *filled(f"{kind} {{", [f"{enumerator(name, v)} = {v.number}" for v in values], "};")]
        lines += filled(f"inline constexpr EnumValue k{name}Values[] = {{", [f'{{{v.number}, "{v.name}"}}' for v in values], "};")
        lines.append(f'constexpr EnumNames names_of({name}) {{ return {{"{name}", k{name}Values}}; }}')
    lines += ["", f"inline constexpr std::size_t kRegimeCount = {len(what.enums['Regime'].values)};",
              f"inline constexpr std::uint32_t kFirstClientCode = {what.enums['ClientCode'].values[1].number};", "", "}  // namespace shearbus::wire"]
    return lines


def is_value(rule, field, name):
    return getattr(rule, field) == rule.DESCRIPTOR.fields_by_name[field].enum_type.values_by_name[name].number


def member(what, message, field):
    """Returns the declaration of a field as a member, and its row."""
    rule = contract.rule_of(field)
    of_columns = rule is not None and rule.columns != 0
    kind = ("Field" if of_columns else ALIASES[field.name] if field.type == BYTES else TYPES.get(field.type) or field.type_name.split(".")[-1])
    row = f"m.{field.name}"
    if rule is not None and rule.at_most:
        row = f"at_most{'_fixed' * (field.type == FIXED64)}({rule.at_most}, {row})"
    elif field.type == FIXED64:
        row = f"fixed({row})"
    if of_columns and is_value(rule, "columns", "KNOWN"):
        row = f"known_only({row})"
    if rule is not None and rule.required:
        row = f"required({row})"
    if rule is not None and rule.text:
        row = ("scene" if is_value(rule, "text", "SCENE") else "long") + f"_text({row})"
    if field.label == REPEATED:
        return f"  std::vector<{kind}> {field.name};", row
    initial = INITIAL.get(f"{message.name}.{field.name}") or INITIAL.get(field.name)
    if initial is None:
        initial = {1: "0.0", 8: "false", 9: "", MESSAGE: "", BYTES: "{}"}.get(field.type, "0")
    if field.type == ENUM and initial == "0":
        initial = f"{kind}::{enumerator(kind, what.enums[kind].values[0])}"
    assign = "{}" if initial == "{}" else f" = {initial}" if initial else ""
    return f"  {kind} {field.name}{assign};", row


def struct(what, message, body):
    """Returns a message as a struct. body: field of a header that has it."""
    lines = [f"struct {message.name} {{"]
    if body is not None:
        rule = contract.rule_of(body)
        lines.append(f'  static constexpr BodyRow kBody = {{{body.number}, "{body.name}"{", true" if rule is not None and rule.payload else ""}}};')
    made = {field.number: member(what, message, field) for field in message.field}
    lines += [declared for declared, _ in made.values()]
    if not made:
        return [*lines, "  static void fields(auto&&, auto&) {}", "};"]
    names = {field.number: field.name for field in message.field}
    rows = [f'v({number}, "{names[number]}", {made[number][1]});' for number in sorted(made)]
    if len(rows) == 1:
        lines += ["", f"  static void fields(auto&& v, auto& m) {{ {rows[0]} }}"]
    else:
        lines += ["", "  static void fields(auto&& v, auto& m) {", *("    " + row for row in rows), "  }"]
    return [*lines, "};"]


def messages_hpp(what):
    headers = {name: {field.type_name.split(".")[-1]: field for field in what.messages[name + "Header"].field if field.HasField("oneof_index")}
               for name in ("Request", "Reply")}
    bodies = {**headers["Request"], **headers["Reply"]}
    lines = [f"// {PRINTED}, which explain the fields: requests and replies as", "// values. codec.hpp turns them into frames and back; "
             "batch.hpp holds their columns. clang-format does not see this file.", "// clang-format off", "#pragma once", "", "#include <cstdint>",
             "#include <string>", "#include <variant>", "#include <vector>", "", '#include "proto/wire/batch.hpp"', '#include "proto/wire/columns.hpp"',
             '#include "proto/wire/enums.hpp"', '#include "proto/wire/field_rows.hpp"', '#include "proto/wire/limits.hpp"', '#include "proto/wire/status.hpp"',
             "", "namespace shearbus::wire {", "", "using SessionId = Id;", "using ResumeToken = Id;", "using TransferId = Id;",
             "static_assert(sizeof(Id) == kSessionIdBytes);"]
    done = set(ENVELOPE)

    def add(name):
        if name in done:
            return
        done.add(name)
        for field in what.messages[name].field:
            if field.type == MESSAGE:
                add(field.type_name.split(".")[-1])
        lines.extend(["", *struct(what, what.messages[name], bodies.get(name))])

    for name in what.messages:
        add(name)
    for name, own in headers.items():
        lines += ["", f"struct {name} {{", "  std::uint32_t protocol_major = kProtocolMajor;", "  std::uint32_t protocol_minor = kProtocolMinor;",
                  "  std::uint64_t request_id = 0;", "  SessionId session_id{};", "  std::uint64_t sequence = 0;", "  std::uint64_t epoch = 0;",
                  *(["  Status status;", "  bool replayed = false;"] if name == "Reply" else []),
                  *filled("  std::variant<", ["std::monostate", *own], "> body;", 4), "  Batch batch;", "};"]
    return [*lines, "", "}  // namespace shearbus::wire"]


def tile_hpp(what):
    """The physics includes nothing of the contract, so it has the two enums of its answers to itself."""
    regimes, outcomes = what.enums["Regime"].values, what.enums["Outcome"].values
    lines = filled("enum class Regime : std::uint8_t {", [f"{enumerator('Regime', v)} = {v.number}" for v in regimes], "};")
    lines += ["", "// Bits of a lane's outcome; 0 is a plain success."]
    return lines + [f"inline constexpr std::uint8_t {enumerator('Outcome', v)} = {v.number};" for v in outcomes if v.number]


# ---- C ----


def plain(text):
    """Returns a text without the marks of Markdown."""
    return re.sub(r"\[([^]]*)\]\(#[^)]*\)", r'"\1" (WIRE.md)', re.sub(r"\[([^]]*)\]\([^#)][^)]*\)", r"\1", text)).replace("`", "")


def c_value(name, number, text, last=False):
    value = f"  SHEARBUS_{name} = {number}{'' if last else ','}"
    if not text:
        return [value]
    if len(f"{value} /* {text} */") <= WIDTH:
        return [f"{value} /* {text} */"]
    return [*textwrap.wrap(f"/* {text} */", WIDTH, initial_indent="  ", subsequent_indent="   * "), value]


def c_enum(rows):
    lines = ["enum {"]
    for i, row in enumerate(rows):
        lines += c_value(*row, i == len(rows) - 1)
    return [*lines, "};"]


def c_codes(what):
    values = [v for v in values_of(what, "Code") if v.number]
    return c_enum([(v.name, 0 if v.name == "OK" else v.number, "" if v.name == "OK" else plain(v.text)) for v in values])


def c_columns(what):
    """The columns of nodes are arguments of the functions."""
    rows = sorted((c for c in what.columns if c.kind != "Node"), key=lambda column: column.number)
    return c_enum([(c.quantity.upper(), c.number, ("uint8_t: " if c.element == "Uint8" else "") + c.meaning +
                    (f"  [{c.unit}]" if c.unit else "") + ("; tangential" if c.tangential else "")) for c in rows])


def c_answers(what):
    return [*c_enum([(f"REGIME_{v.name}", v.number, plain(v.text)) for v in what.enums["Regime"].values]),
            *c_enum([(f"OUTCOME_{v.name}", v.number, plain(v.text)) for v in outcomes_of(what)])]


# ---- Fortran ----


def fortran_columns(what, kinds):
    """Yields (column, component, name) of the columns of doubles of these kinds."""
    for column in what.columns:
        if column.kind in kinds and column.element == "Float64":
            yield column, 0, column.short_name
            if column.tangential:
                yield column, 1, column.short_name + "2"


STEP, LAYER = ("Input", "Output", "Ledger"), ("Profile",)


def continued(head, text):
    """Returns a statement of Fortran on as many lines as it needs; \\0 are blanks at which no line ends."""
    lines = textwrap.wrap(head.lstrip() + text, 122, subsequent_indent=" " * 4)
    indent = " " * (len(head) - len(head.lstrip()))
    return [indent + line.replace("\0", " ") + (" &" if i + 1 < len(lines) else "") for i, line in enumerate(lines)]


def fortran_numbers(what):
    names = [*((f"shearbus_regime_{v.name.lower()}", v.number) for v in what.enums["Regime"].values),
             *((f"shearbus_outcome_{v.name.lower()}", v.number) for v in outcomes_of(what)),
             *((f"shearbus_code_{v.name.lower()}", v.number) for v in values_of(what, "Code") if v.number > 1)]
    return continued("  integer, parameter, public :: ", ", ".join(f"{name}\0=\0{number}" for name, number in names))


def fortran_members(what, kinds, shape):
    lines = []
    for column, components in itertools.groupby(fortran_columns(what, kinds), lambda row: row[0]):
        head = f"    real(real64), allocatable :: {', '.join(name + shape for _, _, name in components)}"
        meaning = f"{column.unit or '1'}: {column.meaning}"
        if len(head) + len(meaning) + 4 > 132:
            lines += textwrap.wrap(meaning, 126, initial_indent="    ! ", subsequent_indent="    ! ") + [head]
        else:
            lines.append(f"{head}  ! {meaning}")
    return lines


def fortran_visits(what):
    form = {**dict.fromkeys(FAR_FIELD_FORM, "far_field"), **{c.quantity: "stick_form" for c in what.columns if c.macro == "STICK"}}
    role = {"Output": "answered", "Ledger": "in_ledger"}
    return [f"    call show(self%{name}, {c.number}, {component}, {role.get(c.kind) or form.get(c.quantity, 'of_all_forms')})"
            for c, component, name in fortran_columns(what, STEP)]


def fortran_profiles(what):
    return [f"      call take(profiles%{name}, {column.number}, {component})" for column, component, name in fortran_columns(what, LAYER)]


def fortran_sizes(what):
    numbers = {c.quantity: c.number for c in what.columns}
    return [f"  integer(c_int32_t), parameter :: regime_column = {numbers['regime']}, outcome_column = {numbers['outcome']}",
            f"  integer, parameter :: columns_of_steps = {len(list(fortran_columns(what, STEP)))}, "
            f"columns_of_profiles = {len(list(fortran_columns(what, LAYER)))}",
            *continued("  character(len=32), parameter :: names_of_columns(columns_of_steps) = [character(len=32) :: ",
                       ", ".join(f"'{name}'" for _, _, name in fortran_columns(what, STEP)) + "]")]


# Types of C by value. A text is an array of characters, and where NULL may be given the address is.
FORTRAN = {"size_t": "integer(c_size_t)", "int": "integer(c_int)", "uint32_t": "integer(c_int32_t)", "uint64_t": "integer(c_int64_t)",
           "uint8_t": "integer(c_int8_t)", "ptrdiff_t": "integer(c_intptr_t)", "double": "real(c_double)", "char": "character(kind=c_char)"}
# Structs without initial values, which would be copied in every step.
OF_STEPS = ("status", "input", "output", "request", "result")


def fortran_member(member, start):
    if member.stars:
        return "type(c_ptr)", member.name + start * " = c_null_ptr"
    if member.kind.startswith("shearbus_"):
        return "type(c_funptr)", member.name + start * " = c_null_funptr"
    return FORTRAN[member.kind], member.name + (f"({member.count})" if member.count else start * " = 0")


def fortran_parameter(parameter, structs):
    kind, intent = parameter.kind.removeprefix("shearbus_"), f"intent({'in' if parameter.const else 'inout'})"
    if not parameter.stars and not parameter.count:
        return ("type(c_funptr)" if kind.endswith("_fn") else FORTRAN[kind]) + ", value", parameter.name
    if parameter.stars == 2:
        return "type(c_ptr), intent(inout)", parameter.name
    if kind in structs:
        return f"type(c_{kind}), {intent}", parameter.name + ("" if structs[kind][0].name == "size" else "(*)")
    if kind in ("void", "double") or kind not in FORTRAN:
        return "type(c_ptr), value", parameter.name
    return f"{FORTRAN[kind]}, {intent}", parameter.name + (f"({parameter.count})" if parameter.count else "" if kind == "size_t" else "(*)")


def fortran_rows(rows, indent):
    """Returns the declarations of (type, name), those of one type together."""
    return [line for kind, group in itertools.groupby(rows, lambda row: row[0])
            for line in continued(f"{' ' * indent}{kind} :: ", ", ".join(name.replace(" ", "\0") for _, name in group))]


def fortran_function(function, structs):
    result = "type(c_ptr)" if "*" in function.result else FORTRAN.get(function.result)
    head = f"    {result + ' function' if result else 'subroutine'} c_{function.name}("
    rows = [fortran_parameter(parameter, structs) for parameter in function.parameters]
    kinds = [kind for kind, _ in rows]
    return [*continued(head, f"{', '.join(p.name for p in function.parameters)}) bind(c,\0name='shearbus_{function.name}')"), "      import",
            *fortran_rows(sorted(rows, key=lambda row: kinds.index(row[0])), 6), f"    end {'function' if result else 'subroutine'}"]


def contract_inc(what):
    """What shearbus.f90 and shearbus_ranks.f90 name as c_..., and the columns."""
    used = {name for text in what.fortran.values() for name in re.findall(r"\bc_(\w+)", text)}
    lines = ["! Printed by proto/print_contract.py from shearbus/v1/*.proto, wire/columns.inc and shearbus.h; shearbus.f90 includes it.", "",
             "  ! Values of regime, bits of outcome, and codes of faults, which are those of shearbus.h.", *fortran_numbers(what), *fortran_sizes(what), "",
             "  type :: columns_of_a_step", *fortran_members(what, STEP, "(:)"), "  end type",
             "  type :: columns_of_a_profile", *fortran_members(what, LAYER, "(:, :)"), "  end type", ""]
    for name, members in what.structs.items():
        if name in used:
            rows = [fortran_member(member, name not in OF_STEPS) for member in members]
            lines += [f"  type, bind(c) :: c_{name}", *fortran_rows(rows, 4), "  end type"]
    lines += ["", "  interface"]
    for function in what.functions + what.of_mpi:
        if function.name in used:
            lines += fortran_function(function, what.structs)
    return [*lines, "  end interface"]


# ---- Python ----


PYTHON = {"size_t": "Size", "double": "Double", "int": "Whole", "uint32_t": "Word"}  # names of types of ctypes, as _library.py calls them


def python_parameter(parameter):
    return "Address" if parameter.stars or parameter.count else PYTHON.get(parameter.kind, "Address")


def python_result(result):
    return "Text" if result == "const char*" else "" if result == "void" else "Address" if "*" in result else PYTHON[result]


def contract_py(what):
    lines = ['"""The columns, codes and enums of the protocol. Printed by proto/print_contract.py from proto/shearbus/v1/*.proto and',
             'proto/wire/columns.inc, and the units of files of units.inc there."""', "import enum", "", "", "class Code(enum.IntEnum):",
             f'    """Status codes of the protocol. The codes from {what.enums["ClientCode"].values[1].number} on exist on the client\'s side only."""', ""]
    lines += [f"    {v.name} = {v.number}" for v in values_of(what, "Code") if v.number]
    for name, text in (("Regime", "Values of the column `regime`: what held the stress in the step."),
                       ("Outcome", "Bits of the column `outcome`; 0 is success without qualification.")):
        lines += ["", "", f"class {name}:", f'    """{text}"""', ""]
        lines += [f"    {v.name} = {v.number}" + (f"  # {plain(v.text)}" if v.text else "") for v in
                  (outcomes_of(what) if name == "Outcome" else what.enums[name].values)]
    lines += ["", "", "# name without shearbus_, types of result and arguments, of the functions of shearbus.h", "FUNCTIONS = ("]
    lines += [f'    ("{f.name}", "{python_result(f.result)}", "{" ".join(map(python_parameter, f.parameters))}"),' for f in what.functions]
    strategies = ", ".join(f'{v.number}: "{v.name.lower()}"' for v in what.enums["Strategy"].values if v.number)
    lines += [")", "", f"STRATEGY = {{{strategies}}}", f"FAR_FIELD_FORM = {FAR_FIELD_FORM}".replace("'", '"'),
              "# number, name on the wire, quantity, unit, element, kind, tangential, short name", "COLUMNS = ("]
    for c in what.columns:
        kind = "Stick" if c.macro == "STICK" else c.kind
        lines.append(f'    ({c.number}, "{c.name}", "{c.quantity}", "{c.unit}", "{c.element}", "{kind}", {c.tangential}, '
                     f'"{contract.SHORT_NAME.get(c.quantity, "")}"),')
    lines += [")", "# units of files: name, SI unit of the quantity, factor to it", "UNITS = ("]
    lines += [f'    ("{name}", {rest}),' for kind, name, rest in what.units if kind == "UNIT"]
    return [*lines, ")", "UNIT_WORDS = {", *(f'    "{word}": {unit},' for kind, word, unit in what.units if kind == "WORD"), "}"]


# ---- WIRE.md ----


def wire_codes(what):
    """Returns the codes by class; cause and remedy of each stand in the schema."""
    lines, rows = ["| class | codes | cause | what to do |", "|---|---|---|---|"], [("", [], "the request was run", "")]
    for value in values_of(what, "Code"):
        if value.title:
            rows.append((value.title[0], [], *value.title[1:]))
        if value.number:
            rows[-1][1].append(f"{value.number} {value.name}")
    return lines + [f"| {title} | {', '.join(codes)} | {cause} | {remedy} |" for title, codes, cause, remedy in rows]


# ---- files ----

WHOLE = {"proto/wire/enums.hpp": enums_hpp, "proto/wire/messages.hpp": messages_hpp, "client/python/shearbus/_contract.py": contract_py,
         "client/fortran/shearbus_contract.inc": contract_inc}
PARTS = {
    "server/physics/solver/tile.hpp": {"regimes and outcomes": tile_hpp},
    "client/include/shearbus/shearbus.h": {"codes": c_codes, "columns": c_columns, "regimes and outcomes": c_answers},
    "client/fortran/shearbus.f90": {"visits": fortran_visits, "profiles": fortran_profiles},
    "proto/WIRE.md": {"codes": wire_codes},
}


def with_part(text, name, lines):
    """Returns the text of a file with the lines of a part. Raises ValueError where the file has no such part."""
    pattern = re.compile(rf"(^[^\n]*print_contract\.py: {re.escape(name)}(?= [*-]|$)[^\n]*\n).*?(^[^\n]*print_contract\.py: end)", re.M | re.S)
    if len(pattern.findall(text)) != 1:
        raise ValueError(f"expected one part {name!r}")
    return pattern.sub(lambda found: found[1] + "".join(line + "\n" for line in lines) + found[2], text)


def printed(what, root):
    """Yields (file, its text, its text as printed)."""
    for name, lines in WHOLE.items():
        file = root / name
        yield file, file.read_text(encoding="utf-8") if file.exists() else "", "\n".join(lines(what)) + "\n"
    for name, parts in PARTS.items():
        text = (root / name).read_text(encoding="utf-8")
        new = text
        for part, lines in parts.items():
            new = with_part(new, part, lines(what))
        yield root / name, text, new


def differences(what, root):
    for file, text, new in printed(what, root):
        yield from difflib.unified_diff(text.splitlines(), new.splitlines(), str(file), "printed", lineterm="", n=0)


def self_test(what):
    """Each file with a digit changed inside of what is printed must be noticed, and so must a column without its row."""
    faults = []
    for file, text, new in printed(what, ROOT):
        if text != new:
            faults.append(f"{file} is not as printed")
    at = next(i for i, column in enumerate(what.columns) if column.kind == "Output")
    gone = what.columns.pop(at)
    fewer = {file for file, text, new in printed(what, ROOT) if text != new}
    what.columns.insert(at, gone)
    what.enums["Regime"].values.append(contract.Value("NEW", 9, "", "", ()))
    more = {file for file, text, new in printed(what, ROOT) if text != new}
    header, fortran = ROOT / "client/include/shearbus/shearbus.h", ROOT / "client/fortran/shearbus_contract.inc"
    if not {ROOT / "client/python/shearbus/_contract.py", header, fortran} <= fewer:
        faults.append(f"a column less changes {fewer}")
    if not {ROOT / "server/physics/solver/tile.hpp", header, fortran} <= more:
        faults.append(f"a regime more changes {more}")
    return faults


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--self-test", action="store_true")
    parser.add_argument("--protoc", default="protoc")
    parser.add_argument("--root", type=pathlib.Path, default=ROOT, help="another tree of sources")
    options = parser.parse_args()
    what = Contract(options.root / "proto", options.protoc)
    if options.check or options.self_test:
        found = self_test(what) if options.self_test else list(differences(what, options.root))
        print("\n".join(found) + "\nprint it again: proto/print_contract.py" if found else "all is as printed")
        return 1 if found else 0
    for file, text, new in list(printed(what, options.root)):
        if text != new:
            file.write_text(new, encoding="utf-8")
            print(f"{file.relative_to(options.root)} was printed")
    return 0


if __name__ == "__main__":
    sys.exit(main())
