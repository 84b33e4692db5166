"""The contract as values: the columns of wire/columns.inc, and the messages and enums of shearbus/v1/*.proto with their comments and
rules (shearbus/v1/wire.proto)."""
import pathlib
import re
import subprocess
import sys
import tempfile
from typing import NamedTuple

PROTO = pathlib.Path(__file__).resolve().parent
SCHEMA = ("downscale", "control", "envelope")  # the files of messages on the wire
# Names of columns in Python and Fortran that are shorter than their quantity.
SHORT_NAME = {"velocity_jump": "jump", "shear_stress": "stress", "sliding_velocity": "slip", "interface_temperature": "temperature",
              "velocity_jump_new": "jump_new"}
FAR_FIELD_FORM = ("stress_soft", "stress_hard", "mass_soft", "mass_hard")  # the stick form has the STICK columns in their place


class Column(NamedTuple):
    """A row of columns.inc. The members are the arguments of COLUMN, and the name of the row's macro."""

    enumerator: str
    number: int
    name: str
    quantity: str
    unit: str
    element: str
    kind: str
    direction: str
    velocity_driven: str
    force_driven: str
    lowest: str
    highest: str
    meaning: str
    macro: str

    @property
    def tangential(self):
        return self.direction == "Tangential"

    @property
    def short_name(self):
        return SHORT_NAME.get(self.quantity, self.quantity)


class Value(NamedTuple):
    """A value of an enum. name: without the prefix of the enum; title: heading of the values from this one on, with its text."""

    name: str
    number: int
    text: str
    remedy: str
    title: tuple


class Declared(NamedTuple):
    """A parameter or a member of a struct of C: `const kind**... name[count]`."""

    name: str
    kind: str
    stars: int
    const: bool
    count: int  # 0: no array


class Function(NamedTuple):
    name: str
    result: str
    parameters: list


class Enum(NamedTuple):
    name: str
    values: list


class Contract:
    def __init__(self, proto=PROTO, protoc="protoc"):
        """Raises ValueError where the schema and columns.inc have different columns."""
        self.columns = list(columns(proto / "wire/columns.inc"))
        self.units = re.findall(r'^(UNIT|WORD)\("(.*?)", (.*)\)$', (proto / "wire/units.inc").read_text(encoding="utf-8"), re.M)
        self.enums, self.messages = {}, {}
        files = schema(proto, protoc)
        for file in files:
            self._read(file)
        client = proto.parent / "client"
        self.structs, self.functions = read_header((client / "include/shearbus/shearbus.h").read_text(encoding="utf-8"))
        self.fortran = {name: (client / name).read_text(encoding="utf-8") for name in ("fortran/shearbus.f90", "mpi/shearbus_ranks.f90")}
        self.of_mpi = [function for name in ("include/shearbus/shearbus_mpi.h", "mpi/shearbus_mpi.c")
                       for function in read_header((client / name).read_text(encoding="utf-8"))[1]]
        numbers = {value.name.lower(): value.number for value in self.enums.pop("Field").values if value.number}
        rows = {column.name: column.number for column in self.columns}
        if numbers != rows:
            raise ValueError(f"Field of envelope.proto and columns.inc differ in {dict(numbers.items() ^ rows.items())}")

    def _read(self, file):
        comments = {tuple(place.path): place for place in file.source_code_info.location}
        for i, enum in enumerate(file.enum_type):
            prefix = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", enum.name).upper() + "_"
            self.enums[enum.name] = Enum(enum.name, [value_of(value, prefix, comments.get((5, i, 2, j))) for j, value in enumerate(enum.value)])
        for message in file.message_type:
            self.messages[message.name] = message


def columns(file):
    """Yields the rows of columns.inc, by expanding its macros."""
    text = file.read_text(encoding="utf-8")
    names = arguments(re.search(r"COLUMN\(([^)]*)\)", re.sub(r"^//\s*", "", text, flags=re.M))[1])
    bare = re.sub(r"\\\n\s*", "", re.sub(r"^\s*//.*$", "", text, flags=re.M))
    macros = {name: (arguments(parameters), arguments(body))
              for name, parameters, body in re.findall(r"#define (\w+)\(([^)]*)\)\s*COLUMN\(([^)]*)\)", bare)}
    for macro, body in re.findall(r"^([A-Z]+)\((.*?)\)$", re.sub(r"\n[ \t]+", " ", bare), re.M):
        if macro not in macros:
            sys.exit(f"{file}: {macro}({body[:40]}... is no row")
        parameters, expansion = macros[macro]
        given = dict(zip(parameters, arguments(body)))
        row = dict(zip(names, (given.get(word, word) for word in expansion)))
        yield Column(**{**row, "number": int(row["number"])}, macro=macro)


def declared(text, constants):
    """Returns a parameter or a member of a struct of C."""
    const, kind, stars, inner, name, size = re.fullmatch(r"(const )?(\w+)((?: ?(?:const ?)?\*)*) ?(\(\*)?(\w+)\)? ?(?:\[(\w+)\])?", " ".join(text.split())).groups()
    return Declared(name, kind, stars.count("*") + bool(inner), bool(const), int(constants.get(size, size)) if size else 0)


def read_header(text):
    """Returns (structs, functions) that a header of C declares: {name: members} and [Function], names without shearbus_."""
    text = re.sub(r"/\*.*?\*/", "", text, flags=re.S)
    constants = dict(re.findall(r"^#define (\w+) (\d+)$", text, re.M))
    structs = {name: [declared(member, constants) for member in body.split(";")[:-1]]
               for name, body in re.findall(r"^typedef struct shearbus_(\w+) \{(.*?)\} shearbus_\1;", text, re.M | re.S)}
    found = re.findall(r"^(?:SHEARBUS_API )?((?:const )?(?:int|void|size_t|char|uint\d+_t)\*?) shearbus_(\w+)\(([^;{]*)\);", text, re.M)
    return structs, [Function(name, result, [declared(word, constants) for word in given.split(",") if word != "void"]) for result, name, given in found]


def arguments(text):
    """Returns the arguments of a macro call, without the quotes of texts."""
    parts = [part.strip() for part in re.findall(r'(?:"(?:[^"\\]|\\.)*"|[^,"])+', text)]
    return ["".join(re.findall(r'"((?:[^"\\]|\\.)*)"', part)) if part.startswith('"') else part for part in parts]


def schema(proto, protoc):
    """Returns the descriptors of the files of the schema, with comments; the options of wire.proto are known."""
    from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

    with tempfile.TemporaryDirectory() as scratch:
        target = pathlib.Path(scratch, "schema")
        subprocess.run([protoc, f"-I{proto}", f"--descriptor_set_out={target}", "--include_source_info", "--include_imports",
                        *(str(proto / f"shearbus/v1/{name}.proto") for name in SCHEMA)], check=True)
        data = target.read_bytes()
    files = descriptor_pb2.FileDescriptorSet.FromString(data)
    pool = descriptor_pool.DescriptorPool()
    for file in files.file:
        pool.Add(file)
    known = message_factory.MessageFactory(pool).GetMessages([file.name for file in files.file])  # registers the extension
    parsed = known["google.protobuf.FileDescriptorSet"].FromString(data) if "google.protobuf.FileDescriptorSet" in known else files
    by_name = {file.name: file for file in parsed.file}
    return [by_name[f"shearbus/v1/{name}.proto"] for name in SCHEMA]


def rule_of(field):
    """Returns the rule of wire.proto at a field."""
    for descriptor, value in field.options.ListFields():
        if descriptor.is_extension and descriptor.name == "wire":
            return value
    return None


def value_of(value, prefix, place):
    if not value.name.startswith(prefix):
        raise ValueError(f"{value.name} does not begin with {prefix}")
    comment = (place.leading_comments or place.trailing_comments) if place else ""
    title = tuple(sentences(place.leading_detached_comments[-1])) if place and place.leading_detached_comments else ()
    text, remedy = cause_and_remedy(comment)
    return Value(value.name.removeprefix(prefix), value.number, text, remedy, title)


def sentences(comment):
    """Returns the heading of a group of values: its first line, the cause and the remedy."""
    first, _, rest = comment.strip().partition("\n")
    return (first.strip(), *cause_and_remedy(rest))


def cause_and_remedy(comment):
    cause, _, remedy = " ".join(line.strip() for line in comment.splitlines()).strip().partition(" Remedy: ")
    return cause, remedy
