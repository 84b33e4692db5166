"""Makes the page of reference of the Fortran interface from its source, client/fortran/shearbus.f90: constants, columns and calls, each with
its arguments. The source says what an argument means once, in the comment at its beginning; one without a meaning ends the program."""
import re
import sys

UP = "../" * 4  # the top of the tree, from a page of deploy/docs/pages/reference
DECLARATION = re.compile(r"^(.*?)\s*::\s*(.*)$")


def statements(text):
    """Yields (comment lines before, statement, comment behind) of a Fortran source, continued lines joined."""
    before, statement = [], ""
    for line in text.splitlines():
        code, _, comment = line.partition("!") if "'" not in line or line.lstrip().startswith("!") else (line, "", "")
        if not code.strip():
            before = [*before, comment.strip()] if comment else [] if not statement else before
            continue
        statement += " " + code.strip().strip("&").strip()
        if code.rstrip().endswith("&"):
            continue
        yield before, statement.strip(), comment.strip()
        before, statement = [], ""


def names_of(text):
    """Returns [(name, shape)] of the names of a declaration: "a(:), b = 1"."""
    return [(name, shape or "") for name, shape in re.findall(r"(\w+)(\([^)]*\))?(?:\s*=[^,]*)?", re.sub(r"=\s*[^,]*", "", text))]


def meanings(text):
    """Returns {argument: meaning} from the comment at the beginning of the source."""
    block = text.split("! Arguments of the calls:\n!\n", 1)[1].split("\n!\n", 1)[0]
    found = re.findall(r"^!   (\w+) +(.*(?:\n!    +.*)*)", block, re.M)
    return {name: re.sub(r"\n! +", " ", meaning) for name, meaning in found}


def procedures(text):
    """Returns {name: (kind, arguments, {argument: (type, intent, optional)}, comment, result)} of every procedure of the source."""
    found, open_one = {}, None
    for before, statement, _ in statements(text):
        head = re.match(r"(?:module )?(subroutine|function) (\w+)\(([^)]*)\)(?: bind\(.*?\))?(?: result\((\w+)\))?", statement)
        if head:
            open_one = head[2]
            # A procedure inside of another one keeps that of its name outside of it.
            found.setdefault(open_one, (head[1], [a.strip() for a in head[3].split(",") if a.strip()], {}, before, head[4]))
        elif open_one and (row := DECLARATION.match(statement)):
            parts = re.split(r",\s*(?![^(]*\))", row[1])
            intent = next((re.search(r"\((\w+)\)", part)[1] for part in parts if part.startswith("intent")), "")
            for name, shape in names_of(row[2]):
                found[open_one][2].setdefault(name, (parts[0] + shape, intent, "optional" in parts))
        elif statement.startswith("end "):
            open_one = None
    return found


def table(head, rows):
    return "".join("| " + " | ".join(row) + " |\n" for row in (head, ["---"] * len(head), *rows))


def call(name, shown, procedure, meaning, note=()):
    """Returns the section of a call."""
    kind, arguments, types, _, result = procedure
    given = [a for a in arguments if a != "self"]
    if missing := [a for a in given if a not in meaning]:
        sys.exit(f"client/fortran/shearbus.f90: {name} has the argument {', '.join(missing)}, which the comment at the beginning does not explain")
    words = [f"[{a}]" if types[a][2] else a for a in given]
    lines, line = [], ("call " if kind == "subroutine" else "text = ") + shown + "("
    indent = " " * min(len(line), 24)
    for i, word in enumerate(words):
        word += ", " if i + 1 < len(words) else ""
        if len(line) + len(word) > 96:
            lines, line = [*lines, line.rstrip()], indent
        line += word
    page = f"\n### {name}\n\n{' '.join(note)}\n\n```fortran\n" + "\n".join([*lines, line + ")"]) + "\n```\n"
    if kind == "function":
        page += f"\nReturns `{types[result][0]}`.\n"
    if given:
        rows = [(f"`{a}`", f"`{types[a][0]}`", types[a][1] + (", optional" if types[a][2] else ""), meaning[a].replace("|", "\\|")) for a in given]
        page += "\n" + table(["argument", "type", "intent", "meaning"], rows)
    return page


def constants(text):
    page = ""
    for before, statement, _ in statements(text.split(":: shearbus_columns", 1)[0]):
        if statement.startswith("integer, parameter, public"):
            page += ("\n" + " ".join(before) + "\n\n" if before else "") + table(["constant", "value"], [(f"`{n}`", v) for n, v in re.findall(r"(\w+)\s*=\s*(\d+)", statement)]) + "\n"
    return page


def columns(body):
    """Returns the tables of the columns of an interface, each below its comment."""
    page, rows = "", []
    for before, statement, behind in statements(body):
        row = DECLARATION.match(statement)
        if "private" in row[1]:
            continue
        heads, own = (before, "") if before and before[-1].endswith(".") else ([], " ".join(before))
        if heads:
            page, rows = page + (table(["column", "type", "unit and meaning"], rows) if rows else "") + "\n" + " ".join(heads) + "\n\n", []
        kind = re.split(r",\s*allocatable", row[1])[0]
        rows += [(f"`{n}{shape}`", f"`{kind}`", (own or behind).replace("|", "\\|")) for n, shape in names_of(row[2])]
    return page + table(["column", "type", "unit and meaning"], rows)


def page(source):
    """Returns the page."""
    text = re.sub(r"^ *include '(.*)'\n", lambda found: (source.parent / found[1]).read_text(), source.read_text(), flags=re.M)
    text = re.sub(r"^.*print_contract\.py: .*\n", "", text, flags=re.M)
    meaning, known = meanings(text), procedures(text)
    head = text.split("! Arguments of the calls:", 1)[0]
    intro, _, rest = head.partition("carries its columns:\n!\n")
    example, _, after = rest.partition("\n!\n")
    plain = lambda part: " ".join(re.sub(r"^! ?", "", part, flags=re.M).split())
    made = ("# Fortran interface\n\n" + plain(intro + "carries its columns:") + "\n\n```fortran\n" + re.sub(r"^! ? ? ?", "", example, flags=re.M) + "\n```\n\n" + plain(after) +
            f"\n\nThe guide is [Couple your code]({UP}client/README.md); the source, which is compiled with the host, is "
            f"[shearbus.f90]({UP}client/fortran/shearbus.f90) with its [shearbus_contract.inc]({UP}client/fortran/shearbus_contract.inc).\n")
    steps, layers, own, sizes, interface = (text.split(f" :: {name}\n", 1)[1].split("  end type", 1)[0] for name in (
        "columns_of_a_step", "columns_of_a_profile", "shearbus_columns", "shearbus_profiles", "shearbus_interface"))
    bound = interface.partition("\n  contains\n")[2]
    made += "\n## Calls of an interface\n"
    for before, statement, _ in statements(bound):
        generic, plain_one = re.match(r"generic :: (\w+) => .*?(\w+)$", statement), re.match(r"procedure :: (\w+)$", statement)
        if generic or plain_one:
            name, specific = generic.groups() if generic else (plain_one[1],) * 2
            made += call(name, f"bus%{name}", known[specific], meaning, before)
    made += "\n## Columns\n\n" + columns(own + steps) + "\n## Profiles\n\nThe components of `type(shearbus_profiles)`, arrays (vertices, nodes).\n\n" + columns(sizes + layers) + "\n## Constants\n" + constants(text)
    made += "\n## Other procedures\n" + call("shearbus_version", "shearbus_version", known["shearbus_version"], meaning, known["shearbus_version"][3])
    made += (f"\n## Ranks of MPI\n\nA submodule, [shearbus_ranks.f90]({UP}client/mpi/shearbus_ranks.f90), which a host with MPI compiles, too. Every call is "
             "collective, and has the same `stat` and `msg` on all ranks.\n")
    return made + "".join(call(name, name, known[name], meaning, known[name][3]) for name in known if name.startswith("shearbus_mpi_"))
