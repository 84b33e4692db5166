# Configuration of Sphinx for the pages that stage.py has staged. deploy/docs/build gives the places by environment variables.
import os
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
    (r"py:.*", r"(numpy|zmq|enum|pathlib)\..*|Warning|optional|Bit|IntFlag|IntEnum"),
]

breathe_projects = {"shearbus": os.environ["SHEARBUS_DOXYGEN"]}
breathe_show_include = False
breathe_default_project = "shearbus"
breathe_domain_by_extension = {"h": "c", "hpp": "cpp"}
c_id_attributes = ["SHEARBUS_API"]
cpp_id_attributes = ["SHEARBUS_API"]

autodoc_member_order = "bysource"

html_theme = "furo"
html_title = f"shearbus {release}"
html_static_path = [os.path.join(os.path.dirname(__file__), "static")]
html_css_files = ["site.css"]
html_show_sphinx = False
html_show_copyright = False  # the owners have chosen no licence yet
smartquotes = False  # quotes in tables are those of TOML
html_copy_source = False


def plain(app, what, name, obj, options, lines):
    """Makes a docstring, which is plain text, reStructuredText: marks are text, indented lines are code."""
    text, indented = [], False
    for line in lines:
        if line.startswith("    "):
            if not indented:
                text += ["", "::", ""]
            indented = True
            text.append(line)
        else:
            if indented and line:
                text.append("")
                indented = False
            words = re.split(r"(`[^`]+`)", line)
            text.append("".join(f"`{w}`" if w.startswith("`") else re.sub(r"([\\*`|_])", r"\\\1", w).replace("://", r"\://") for w in words))
    lines[:] = text


def setup(app):
    app.connect("autodoc-process-docstring", plain)
