#!/usr/bin/python3
"""Stages the pages of the tree as the source of the documentation site, and generates the pages of reference.

stage.py --source ROOT --bin DIR --out DIR

Every page of the tree keeps its place (client/README.md is the page client/README of the site), and the pages of deploy/docs/pages stand
at the root of the site. Links between pages become links of the site; a linked source file becomes a page that shows it, a linked directory
a page that shows its files. In a page of deploy/docs/pages

    [title](page#anchor) <!-- include -->    stands for the section of another page, without its heading
    [title](file) <!-- show -->              stands for a file, as code

where a reader of the tree has the link.
A link, section or file that does not exist ends the program, as does a status code without cause and cure in the schema."""
import argparse
import os
import pathlib
import posixpath
import re
import shutil
import subprocess
import sys
import textwrap
import tomllib

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "proto"))
import contract  # noqa: E402
import fortran_page  # noqa: E402

PAGES = "deploy/docs/pages"
MEASURED, HOST_ERRORS = "tests/measured.toml", "deploy/docs/pages/howto/host_errors.toml"
OPTIONS, COLUMNS = "server/physics/solver/parts_table.hpp", "proto/wire/columns.inc"
# source: the page that shows it
GENERATED = {MEASURED: "reference/measured", HOST_ERRORS: "howto/host_errors", OPTIONS: "reference/options", COLUMNS: "reference/columns"}
PYTHON_CLIENT = pathlib.Path(__file__).resolve().parents[2] / "client/python"
PICTURES = {".png", ".svg"}
LANGUAGES = {".toml": "toml", ".py": "python", ".c": "c", ".h": "c", ".cpp": "cpp", ".hpp": "cpp", ".f90": "fortran", ".sh": "bash",
             ".sbatch": "bash", ".cff": "yaml", ".service": "ini", ".proto": "protobuf"}
PROGRAMS = ("shearbus-server", "shearbus-ctl", "shearbus-hydro", "shearbus-replay", "shearbus-report", "shearbus-study")
FENCE = re.compile(r"^(```+|~~~+).*?^\1[ \t]*$", re.M | re.S)
LINK = re.compile(r"(!?\[(?:[^\[\]]|\[[^\[\]]*\]|!\[[^\]]*\]\([^)]*\))*\]\()([^)\s]+)(\))")
DIRECTIVE = re.compile(r"^\[[^\]]*\]\((\S+)\) <!-- (include|show) -->$", re.M)


def slug(heading):
    """Returns the anchor that GitHub, and the site, make of a heading."""
    return re.sub(r"[^\w\- ]", "", re.sub(r"[`*]", "", heading).strip().lower()).replace(" ", "-")


def outside_code(text, change):
    """Returns the text with change(part) applied to all parts that are no fenced code."""
    parts, at = [], 0
    for fence in FENCE.finditer(text):
        parts += [change(text[at : fence.start()]), fence[0]]
        at = fence.end()
    return "".join(parts) + change(text[at:])


def section(text, anchor):
    """Returns what stands below the heading, up to the next heading of its level or a higher one."""
    fences = [f.span() for f in FENCE.finditer(text)]
    found = [h for h in re.finditer(r"^(#+) (.+)$", text, re.M) if not any(a <= h.start() < b for a, b in fences)]
    for i, heading in enumerate(found):
        if slug(heading[2]) == anchor:
            end = next((h.start() for h in found[i + 1 :] if len(h[1]) <= len(heading[1])), len(text))
            lower = len(heading[1]) - 1  # the headings of the section move up to the level of the page that includes it
            return outside_code(text[heading.end() : end], lambda part: re.sub(rf"^#{{{lower}}}(?=#)", "", part, flags=re.M)).strip()
    sys.exit(f"no heading has the anchor #{anchor}")


class Site:
    def __init__(self, root, out):
        self.root, self.out, self.wanted = root, out, set()
        listed = subprocess.run(["git", "-C", root, "ls-files", "-co", "--exclude-standard"], capture_output=True, text=True)
        names = listed.stdout.splitlines() if listed.returncode == 0 else [p.relative_to(root).as_posix() for p in root.rglob("*") if p.is_file()]
        self.files = {n for n in names if (root / n).is_file() and not re.match(r"build|out/|\.git/", n)}
        # Templates of issues are forms, no pages.
        self.pages = {n for n in self.files if n.endswith(".md") and "ISSUE_TEMPLATE" not in n}

    def place(self, name):
        """Returns where a file of the tree stands in the site."""
        return name[len(PAGES) + 1 :] if name.startswith(PAGES + "/") else name.replace(".github/", "github/")

    def target(self, page, link):
        """Returns the link of a page of the tree as (place in the site, anchor)."""
        path, _, anchor = link.partition("#")
        name = posixpath.normpath(posixpath.join(posixpath.dirname(page), path)) if path else page
        if name in self.pages:
            return self.place(name), anchor
        if name in self.files:
            if name in GENERATED:
                return GENERATED[name] + ".md", anchor
            if pathlib.Path(name).suffix not in PICTURES:
                self.wanted.add(name)
                return self.place(name) + ".md", ""
            self.copy(name)
            return self.place(name), ""
        if name + "/README.md" in self.pages:
            return self.place(name + "/README.md"), anchor
        if any(f.startswith(name + "/") for f in self.files):
            self.wanted.add(name)
            return self.place(name) + "/index.md", ""
        sys.exit(f"{page}: the tree has no file for the link {link}")

    def linked(self, page, text, place):
        """Returns the text of a page of the tree, or of a part of it, with its links as they are at a place of the site."""

        def link(match):
            if "://" in match[2] or match[2].startswith("mailto:"):
                return match[0]
            to, anchor = self.target(page, match[2])
            path = "" if to == place else posixpath.relpath(to, posixpath.dirname(place) or ".")
            return match[1] + path + ("#" + anchor if anchor else "" if path else "#") + match[3]

        # A picture may stand inside of the text of a link, so links are replaced until nothing changes the place.
        return outside_code(text, lambda part: LINK.sub(link, part))

    def write(self, place, text):
        path = self.out / place
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(re.sub(r"^```hex\b.*$", "```text", text, flags=re.M))

    def copy(self, name):
        path = self.out / self.place(name)
        path.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(self.root / name, path)

    def stage(self, page):
        place = self.place(page)
        given = []

        def directive(match):
            path, _, anchor = match[1].partition("#")
            name = posixpath.normpath(posixpath.join(posixpath.dirname(page), path))
            if name not in self.files:
                sys.exit(f"{page}: {match[0]}: the tree has no such file")
            other = (self.root / name).read_text()
            given.append(self.linked(name, section(other, anchor), place) if match[2] == "include" else code(name, other))
            return f"\0{len(given) - 1}\0"

        text = self.linked(page, DIRECTIVE.sub(directive, (self.root / page).read_text()), place)
        text = re.sub("\0(\\d+)\0", lambda match: given[int(match[1])], text)
        # Pages of the tree are in a list of contents by the pages of deploy/docs/pages, or in none.
        self.write(place, text if page.startswith(PAGES) else "---\norphan: true\n---\n" + text)

    def show(self, name):
        """Makes the page of a source file, or of a directory."""
        if name in self.files:
            self.write(self.place(name) + ".md", f"---\norphan: true\n---\n# {name}\n\n" + code(name, (self.root / name).read_text()))
            return
        below = sorted(f for f in self.files if f.startswith(name + "/"))
        shown = (f"\n## {f[len(name) + 1 :]}\n\n{code(f, (self.root / f).read_text())}" for f in below if not f.endswith(".md"))
        self.write(self.place(name) + "/index.md", f"---\norphan: true\n---\n# {name}\n" + "".join(shown))


def code(name, text):
    language = LANGUAGES.get(pathlib.Path(name).suffix, "bash" if text.startswith("#!/") else "text")
    return f"`````{language}\n{text}`````\n"


def output_of(*command):
    environment = {**os.environ, "PYTHONPATH": str(PYTHON_CLIENT), "PYTHONDONTWRITEBYTECODE": "1"}  # shearbus-ctl rehearse is a part of it
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=60, env=environment)
    if done.returncode != 0:
        sys.exit(f"{' '.join(map(str, command))} ended with {done.returncode}: {done.stderr}")
    return done.stdout


def wrapped(text, width=108):
    """Returns a help text whose long lines go on below their description."""
    lines = []
    for line in text.splitlines():
        start = re.match(r"\s*(?:\S.*?\s{2,})?", line).end()
        lines += textwrap.wrap(line, width, subsequent_indent=" " * min(start, 32), break_long_words=False, break_on_hyphens=False) or [""]
    return "\n".join(lines)


def with_links(text):
    """Returns a printed text whose paths from the root of the tree are links."""
    return re.sub(r"\b(?:server|tests)/[\w/]+\.(?:md|py)\b", r"[\g<0>](\g<0>)", text)


def programs_page(directory):
    """Returns the page of the programs: the help of each program and of each subcommand."""
    page = "# Programs\n\nThe help of each program, as the program prints it; `man` shows the same where the packages are installed.\n"
    for program in PROGRAMS:
        helps = [(program, output_of(directory / program, "--help"))]
        subcommands = re.findall(r"^  ([a-z]+) ", helps[0][1].split("Subcommands:\n")[1], re.M) if "Subcommands:\n" in helps[0][1] else []
        helps += [(f"{program} {name}", output_of(directory / program, name, "--help")) for name in subcommands]
        for depth, (name, text) in zip(["##"] + ["###"] * len(subcommands), helps):
            page += f"\n{depth} {name}\n\n```text\n{wrapped(text.replace(str(directory) + '/', '').strip())}\n```\n"
    return page


def materials_page(text):
    """Returns the page of the catalog: `shearbus-ctl materials` prints a name, then its sources, indented."""
    page = "# Materials\n\nThe catalog, as `shearbus-ctl materials` prints it: each material with the sources of its numbers.\n\n| material | sources |\n|---|---|\n"
    for name, sources in re.findall(r"^(\S+)\n((?:  .*\n?)+)", text, re.M):
        page += f"| `{name}` | {' '.join(sources.split()).replace('|', ' ')} |\n"
    return page


def columns_page(root):
    """Returns the page of the columns, from proto/wire/columns.inc."""
    page = ("# Columns\n\nEvery column of a request or a reply, from `proto/wire/columns.inc`. A column that is *tangential* comes twice in a scene with "
            "`tangential_components = 2`. Python's keywords and attributes are the quantities, but for the short names `jump`, `stress`, `slip`, "
            "`temperature` and `jump_new`.\n\n| no. | name | element | unit | kind | tangential | meaning |\n|---|---|---|---|---|---|---|\n")
    kinds = {"STICK": "input, stick form", "Node": "node", "Input": "input", "Output": "answer", "Ledger": "energy ledger, on request",
             "Profile": "profile of the layer", "OnRequest": "answer on request"}
    for c in sorted(contract.columns(root / "proto/wire/columns.inc"), key=lambda column: column.number):
        on_request = c.kind == "Output" and "OnRequest" in (c.velocity_driven, c.force_driven)
        kind = kinds["OnRequest"] if on_request else kinds.get(c.macro) or kinds[c.kind]
        meaning = c.meaning.replace("|", "\\|")
        page += f"| {c.number} | `{c.name}` | {c.element.lower()} | {c.unit} | {kind} | {'yes' if c.tangential else ''} | {meaning} |\n"
    return page


def tables_page(title, source, text):
    """Returns the page that a source of parts makes: TOML with a text in front, and in each part a group, a title, a text, a head and rows
    of as many cells, each of them where there is one."""
    found = tomllib.loads(text)
    page = f"# {title}\n\n{found['text']}\n"
    for part in found["part"]:
        page += "".join(f"\n{mark} {part[key]}\n" for mark, key in (("##", "group"), ("###", "title")) if key in part)
        page += f"\n{part['text'].strip()}\n" if "text" in part else ""
        if head := part.get("head"):
            if odd := [row for row in part["rows"] if len(row) != len(head)]:
                sys.exit(f"{source}: a row of {len(head)} cells is expected, found {odd[0]}")
            page += "\n" + fortran_page.table(head, part["rows"])
    return page


def python_page():
    """Returns the page of the Python package, from what the package itself says is public."""
    found = output_of(sys.executable, "-B", "-c", """
import inspect, shearbus
for name in shearbus.__all__:
    what = getattr(shearbus, name)
    print(name, "errors" if inspect.isclass(what) and issubclass(what, BaseException) else "classes" if inspect.isclass(what) else "functions" if callable(what) else "")
""")
    kinds = {"functions": "Functions", "classes": "Classes", "errors": "Errors and warnings"}
    rows = [line.split() for line in found.splitlines() if len(line.split()) == 2]
    if {kind for _, kind in rows} != set(kinds):
        sys.exit(f"shearbus.__all__ has no functions, classes or errors: {found}")
    page = "# Python interface\n\n```{eval-rst}\n.. automodule:: shearbus\n   :no-members:\n```\n"
    for kind, title in kinds.items():
        page += f"\n## {title}\n"
        directive = {"functions": "autofunction", "classes": "autoclass", "errors": "autoexception"}[kind]
        for name, _ in sorted((row for row in rows if row[1] == kind), key=lambda row: (row[0] not in ("open", "Session", "Error"), row[0])):
            options = "   :members:\n" + ("   :show-inheritance:\n" if kind == "errors" else "")
            page += f"\n### {name}\n\n```{{eval-rst}}\n.. {directive}:: shearbus.{name}\n{options if kind != 'functions' else ''}```\n"
    return page


def codes(root):
    """Returns the rows (number, name, cause, cure) of the codes of proto/shearbus/v1/envelope.proto, from the comments above them."""
    schema = (root / "proto/shearbus/v1/envelope.proto").read_text()
    rows = []
    for comment, name, number in re.findall(r"((?:^ *//.*\n)*)^  (?:CLIENT_)?CODE_(\w+) = (\d+);", schema, re.M):
        cause, cure = contract.cause_and_remedy(re.sub(r"^ *//", "", comment, flags=re.M))
        rows += [(int(number), name, cause, cure)] if int(number) else []
    faults = [f"{name} has no cause or no cure" for n, name, cause, cure in rows if n != 1 and not (cause and cure)]
    if faults or not rows:
        sys.exit("proto/shearbus/v1/envelope.proto: " + "; ".join(faults or ["no codes"]))
    return rows


def errors_page(site):
    """Returns the page of the errors, made of the codes of the schema."""
    place, root = "howto/errors" + ".md", site.root
    page = ("# Errors: cause and cure\n\nEvery refusal has a code, a text with what was expected and found, a remedy, and the field and nodes at fault. A refused call has "
            "changed nothing. The names are those of every language: `SHEARBUS_SHAPE` in C, `Code.SHAPE` in Python "
            "([the protocol](../proto/WIRE.md#status)).\n")
    for n, name, cause, cure in codes(root):
        if n != 1:
            cause, cure = (site.linked("proto/WIRE.md", text, place) for text in (cause, cure))
            sentence = lambda text: text[0].upper() + text[1:] + ("" if text.endswith(".") else ".")
            page += f"\n## {name} ({n})\n\n**Cause.** {sentence(cause)}\n\n**Cure.** {sentence(cure)}\n"
    return page


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--source", type=pathlib.Path, required=True)
    parser.add_argument("--bin", type=pathlib.Path, required=True, help="directory of the programs")
    parser.add_argument("--out", type=pathlib.Path, required=True, help="directory for the staged pages, made anew")
    options = parser.parse_args()
    root, programs = options.source.resolve(), options.bin.resolve()
    shutil.rmtree(options.out, ignore_errors=True)
    site = Site(root, options.out)
    for page in sorted(site.pages):
        site.stage(page)
    scene, hydro = output_of(programs / "shearbus-ctl", "reference"), output_of(programs / "shearbus-hydro", "--reference")
    of_hydro = [part for part in hydro.split("\n## ")[1:] if part.strip() not in scene]
    for name, text in (("reference/scene", scene),
                       ("reference/hydro", "# Keys of [hydro]\n\nThe table of a scene that `shearbus-hydro` reads and the server never sees.\n" +
                        "".join("\n## " + part for part in of_hydro)),
                       ("reference/materials", materials_page(output_of(programs / "shearbus-ctl", "materials"))),
                       ("reference/programs", programs_page(programs)),
                       (GENERATED[COLUMNS], columns_page(root)),
                       (GENERATED[OPTIONS], site.linked("README.md", with_links(output_of(programs / "shearbus-ctl", "options")), GENERATED[OPTIONS] + ".md")),
                       *((GENERATED[source], site.linked(source, tables_page(title, source, (root / source).read_text()), GENERATED[source] + ".md"))
                         for source, title in ((MEASURED, "What was measured"), (HOST_ERRORS, "Errors of a host: as printed, usual mistake, cure"))),
                       ("reference/fortran", site.linked(PAGES + "/reference/fortran" + ".md", fortran_page.page(root / "client/fortran/shearbus.f90"), "reference/fortran" + ".md")),
                       ("reference/python", python_page()),
                       ("howto/errors", errors_page(site))):
        site.write(name + ".md", text)
    for name in site.wanted:
        site.show(name)


if __name__ == "__main__":
    main()
