# Configuration of Sphinx for the pages that stage.py has staged. deploy/docs/build gives the places by environment variables.
import inspect
import os
import pathlib
import re
import sys

sys.path.insert(0, os.path.join(os.environ["SHEARBUS_SOURCE"], "client/python"))
sys.dont_write_bytecode = True

project = "shearbus"
author = "the shearbus authors"
with open(os.path.join(os.environ["SHEARBUS_SOURCE"], "CMakeLists.txt"), encoding="utf-8") as _file:
    version = release = re.search(r"project\(shearbus[^)]*VERSION ([\d.]+)", _file.read())[1]

extensions = ["myst_parser", "breathe", "sphinx.ext.autodoc"]
source_suffix = {".md": "markdown"}
myst_heading_anchors = 6
highlight_language = "text"
nitpicky = True
# Namespaces, types of the standard libraries and of MPI have no page here, template parameters are no types, and Sphinx does not follow a C++
# declaration to a C one.
nitpick_ignore_regex = [
    (r"(c|cpp):.*", r"std|std::.*|u?int\d+_t|size_t|ptrdiff_t|MPI_Comm"),
    (r"cpp:.*", r"Values?|Function|Opening|Arguments|shearbus(::v1)?|(shearbus|SHEARBUS)_\w+"),
    (r"py:.*", r"(numpy|zmq|enum|pathlib|types)\..*|Warning|optional|Bit|IntFlag|IntEnum"),
]

breathe_projects = {"shearbus": os.environ["SHEARBUS_DOXYGEN"]}
breathe_show_include = False
breathe_default_project = "shearbus"
breathe_domain_by_extension = {"h": "c", "hpp": "cpp"}
c_id_attributes = ["SHEARBUS_API"]
cpp_id_attributes = ["SHEARBUS_API"]

autodoc_member_order = "bysource"

html_theme = "furo"
# Debian's sheet has the colours of a dark screen for the switch alone, not for a system that is dark.
_dark = {"problematic": "#f28b82", "foreground-primary": "#d6d8da", "foreground-secondary": "#a4a8ad", "foreground-muted": "#8d9298", "foreground-border": "#666a6e",
         "background-primary": "#121416", "background-secondary": "#1a1d20", "background-hover": "#22262a", "background-hover--transparent": "#22262a00",
         "background-border": "#33383c", "background-item": "#444a4f", "brand-primary": "#5aa9f5", "brand-content": "#6bb2f6", "highlighted-background": "#0c3a66",
         "highlight-on-target": "#3a3a00", "guilabel-background": "#08356380", "guilabel-border": "#13395f80", "api-keyword": "var(--color-foreground-secondary)",
         "admonition-background": "#18181a"}
html_theme_options = {"dark_css_variables": {f"color-{name}": colour for name, colour in _dark.items()}}
html_title = f"shearbus {release}"
html_static_path = [os.path.join(os.path.dirname(__file__), "static")]
html_css_files = ["site.css"]
html_show_sphinx = False
html_show_copyright = False  # the owners have chosen no licence yet
smartquotes = False  # quotes in tables are those of TOML
html_copy_source = False
html_show_search_summary = False  # a page that is opened as a file may not read others


def marked(line):
    """Returns a line of plain text as reStructuredText: marks are text."""
    words = re.split(r"(`[^`]+`)", line)
    return "".join(f"`{w}`" if w.startswith("`") else re.sub(r"([\\*`|_])", r"\\\1", w).replace("://", r"\://") for w in words)


def known_names(what, obj):
    """Returns the names that a docstring may explain: the parameters of a function, the attributes of a class."""
    if what in ("class", "exception"):
        try:
            return set(re.findall(r"\b[a-z]\w*", inspect.getsource(obj).replace(obj.__doc__ or "", "")))
        except (OSError, TypeError):
            return set()
    try:
        return set(inspect.signature(obj).parameters) if callable(obj) else set()
    except (TypeError, ValueError):
        return set()


def with_fields(what, obj, paragraph):
    """Returns a paragraph whose sentences explain parameters ("name: meaning. other (unit): meaning.") as text and a list of fields."""
    names = known_names(what, obj)
    start = r"(?:(?<=[.;] )|^)((?:\w+, )*(?:\w+ and )?\w+)((?:, shape)? \([^)]*\))?: "
    found = [m for m in re.finditer(start, paragraph) if set(re.findall(r"\w+", m[1])) - {"and"} <= names]
    if not found:
        return [marked(paragraph), ""]
    field = "ivar" if what in ("class", "exception") else "param"
    lead = paragraph[: found[0].start()].strip()
    lines, returns = [marked(lead), ""] if lead else [], []
    for this, following in zip(found, [*found[1:], None]):
        meaning = paragraph[this.end() : following.start() if following else len(paragraph)].strip()
        if match := re.search(r"(?:^|(?<=[.;] ))Returns .*$", meaning):  # of the call, not of its last parameter
            meaning, returns = meaning[: match.start()].strip(), [f":returns: {marked(match[0][8:])}"]
        unit = f"{this[2].strip(', ')} " if this[2] else ""
        lines += [f":{field} {name}: \\{marked(unit + meaning.rstrip(';'))}" for name in re.findall(r"\w+", this[1]) if name != "and"]
    return [*lines, *returns, ""]


def plain(app, what, name, obj, options, lines):
    """Makes a docstring, which is plain text, reStructuredText: indented lines are code, explained parameters a list."""
    text, paragraph, indented = [], [], False
    for line in [*lines, ""]:
        is_code = line.startswith("    ") and not paragraph
        if paragraph and not line.strip():
            text += with_fields(what, obj, " ".join(paragraph))
            paragraph = []
        elif is_code or (indented and not line.strip()):
            text += ([] if indented else ["::", ""]) + [line]
        elif line.strip():
            text += [""] if indented else []
            paragraph.append(line.strip())
        indented = is_code or (indented and not line.strip())
    lines[:] = text


def complete_theme(app, fault):
    """Makes the scripts and styles of Debian's furo whole, which are those of its sources: a script imports another, which a browser takes
    from modules alone, and the sheet imports one from the root of a web server."""
    if fault is not None or app.builder.name != "html":
        return
    static = pathlib.Path(app.outdir, "_static")
    script, sheet = static / "scripts/furo.js", static / "styles/furo.css"
    text, imports = re.subn(r'^import Gumshoe from "./(gumshoe-patched\.js)";$', "", script.read_text(), flags=re.M)
    if imports:  # gumshoe defines window.Gumshoe
        script.write_text((static / "scripts/gumshoe-patched.js").read_text() + text)
    sheet.write_text(re.sub(r"@import url\(/javascript/(.*?)\);", lambda match: pathlib.Path("/usr/share/javascript", match[1]).read_text(), sheet.read_text()))


def setup(app):
    app.connect("autodoc-process-docstring", plain)
    app.connect("build-finished", complete_theme)
