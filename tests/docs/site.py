#!/usr/bin/python3
"""Builds the documentation site with the programs of a build directory; a warning, a dead link and a page that is missing are faults. Ends
with 77, skipped, where a package of deploy/packages/docs.txt is missing.

site.py --build BUILD --out DIR
site.py --self-test      each rule of stage.py and links.py fails on a tree made for it"""
import argparse
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
DOCS = ROOT / "deploy/docs"
# What the site must have: page -> a text of it, from each of the sources that it is generated from.
EXPECTED = {
    "index.html": "First run",
    "README.html": "shearbus.open(",
    "github/CONTRIBUTING.html": "compile_commands.json",
    "tutorials/couple.html": "shearbus_open",
    "howto/errors.html": "NODE_OWNED (304)",
    "howto/host_errors.html": "usual mistake, cure",
    "howto/batch.html": "several_nodes.sbatch",
    "howto/capsule.html": "--capsule",
    "reference/scene.html": "friction_coefficient",
    "reference/hydro.html": "end_time_s",
    "reference/materials.html": "aluminium_dlp",
    "reference/columns.html": "velocity_jump_m_per_s",
    "reference/options.html": "does not go with",
    "reference/measured.html": "398.146970801",
    "reference/programs.html": "shearbus-ctl keygen",
    "reference/c.html": "shearbus_rollback_to",
    "reference/cxx.html": "register_nodes",
    "reference/fortran.html": "keys of the scene that have a value for each node",
    "reference/python.html": "Parameters<span class=\"colon\">",
    "server/physics/MODEL.html": "What the layer computes",
}


# What a page of reference has not: the source.
UNEXPECTED = {"reference/fortran.html": "iso_c_binding", "reference/python.html": "def step"}


def missing():
    """Returns the first thing that the site needs and this machine lacks."""
    for module in ("sphinx", "myst_parser", "breathe", "furo", "zmq", "numpy"):
        if subprocess.run([sys.executable, "-c", f"import {module}"], capture_output=True).returncode != 0:
            return f"the Python module {module}"
    return None if shutil.which("doxygen") else "doxygen"


def run(*command):
    return subprocess.run([str(word) for word in command], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=280)


def build(programs, out):
    done = run(DOCS / "build", "--programs", programs, "--out", out)
    faults = [done.stdout] if done.returncode != 0 else []
    for page, text in EXPECTED.items() if not faults else ():
        path = out / "html" / page
        if not path.is_file():
            faults.append(f"the site has no page {page}")
        elif text not in path.read_text():
            faults.append(f"{page} has no {text!r}")
    faults += [f"{page} shows the source" for page, text in UNEXPECTED.items() if not faults and text in (out / "html" / page).read_text()]
    print(done.stdout[-300:])
    return faults


def md(name):
    """Returns the name of a page of a tree that a test makes; tidy.tree takes the whole name for a reference to a page of this tree."""
    return name + ".md"


PAGE = md("a/page")


def self_test(scratch):
    """Returns the rules that did not fail."""
    sys.path.insert(0, str(DOCS))
    import stage

    faults = []

    def refused(name, function, *arguments):
        try:
            function(*arguments)
        except SystemExit:
            return
        faults.append(f"self-test: {name} was accepted")

    tree = scratch / "tree"
    (tree / "a").mkdir(parents=True)
    (tree / PAGE).write_text("# Page\n\n## One\n\nfirst\n\n```sh\n# no heading\n```\n\n### Below\n\n## Two\n\nsecond\n")
    (tree / "a/code.c").write_text("int one;\n")
    site = stage.Site(tree, scratch / "site")
    for link, expected in ((md("page") + "#one",) * 2, ("code.c", md("code.c")), ("https://example.org", "https://example.org"), ("../a", md("index"))):
        found = site.linked(PAGE, f"[x]({link})", md("a/other"))
        if found != f"[x]({expected})":
            faults.append(f"self-test: link {link} became {found}")
    if site.linked(PAGE, "[x](#one)", md("b/other")) != f"[x](../{PAGE}#one)":
        faults.append("self-test: an anchor of a page that is included does not lead back to it")
    part = stage.section((tree / PAGE).read_text(), "one")
    if not part.startswith("first") or "second" in part or "# no heading" not in part or "## Below" not in part:
        faults.append(f"self-test: section: {part}")
    refused("a link to a file that does not exist", site.linked, PAGE, f"[x]({md('gone')})", PAGE)
    refused("a section that does not exist", stage.section, "# Page\n", "gone")
    refused("a row of other length than its head", stage.tables_page, "Title", "file", "text = ''\n[[part]]\nhead = ['a', 'b']\nrows = [['1']]\n")
    # A code without a cure in the schema.
    (tree / "proto/shearbus/v1").mkdir(parents=True)
    schema = tree / "proto/shearbus/v1/envelope.proto"
    shutil.copy(ROOT / "proto/shearbus/v1/envelope.proto", schema)
    stage.codes(tree)
    text = schema.read_text()
    schema.write_text(re.sub(r"  // Remedy: (?:.*\n  //)*.*\n(?=  CODE_NODE_OWNED = 304;)", "", text))
    if schema.read_text() == text:
        faults.append("self-test: the schema has no remedy of NODE_OWNED")
    refused("a code without a cure", stage.codes, tree)
    # An argument of a Fortran call that the comment at the beginning does not explain.
    source = (ROOT / "client/fortran/shearbus.f90").read_text()
    shutil.copy(ROOT / "client/fortran/shearbus_contract.inc", tree)
    fortran = tree / ("shearbus" + ".f90")
    fortran.write_text(source)
    if "call bus%step(dt, " not in stage.fortran_page.page(fortran):
        faults.append("self-test: the page of Fortran has no step")
    fortran.write_text(source.replace("!   reply_deadline   ", "!   other_deadline   "))
    refused("an argument of Fortran without a meaning", stage.fortran_page.page, fortran)
    # Dead links in HTML.
    html = scratch / "html"
    html.mkdir()
    for body, dead in (('<a id="x" href="#x">', False), ('<a href="#y">', True), ('<a href="gone.html">', True), ('<img src="gone.png">', True), ('<a href="file://path">', True)):
        (html / "index.html").write_text(body)
        if (run(sys.executable, "-B", DOCS / "links.py", html).returncode != 0) != dead:
            faults.append(f"self-test: links.py and {body}")
    return faults


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--build", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path)
    parser.add_argument("--self-test", action="store_true")
    options = parser.parse_args()
    if options.self_test:
        with tempfile.TemporaryDirectory() as scratch:
            faults = self_test(pathlib.Path(scratch))
        print("\n".join(faults) or "the rules of the site can fail")
        sys.exit(bool(faults))
    if lack := missing():
        print(f"skipped: {lack} is missing; install the packages of deploy/packages/docs.txt")
        sys.exit(77)
    faults = build(options.build.resolve(), options.out)
    print("\n".join(faults))
    sys.exit(bool(faults))


if __name__ == "__main__":
    main()
