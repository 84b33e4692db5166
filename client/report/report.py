"""Puts one or more runs into one HTML file that needs nothing else: no network, no script. A RUN is a directory that
shearbus-hydro wrote, in one or two dimensions, or a file of results of shearbus-replay; runs of one scene with
several laws are compared.
"""
import importlib
import json
import pathlib
import platform
import shlex
import subprocess
import sys

from terminal import Parser, complain, nothing_to_clean_up, printable


EPILOG = """Examples:
  shearbus-report out/cone_al_steel-subgrid out/cone_al_steel-coulomb_tresca -o cone.html
  shearbus-report result.h5

Exit codes: 0 the report is written, 1 a run cannot be read or the file not written, 2 a faulty command line"""


def version_of(version, programs):
    """Returns the entries of --version. programs: directory of shearbus-ctl, which is of the same build and knows its
    commit."""
    found = {"program": "shearbus-report", "version": version, "commit": "unknown"}
    try:
        told = subprocess.run([pathlib.Path(programs) / "shearbus-ctl", "--version", "--json"], capture_output=True, text=True, timeout=20, check=True)
        found["commit"] = json.loads(told.stdout)["commit"]
    except (OSError, subprocess.SubprocessError, ValueError, KeyError):
        pass
    found["python"] = platform.python_version()
    for library in ("jinja2", "matplotlib", "numpy", "h5py", "PIL"):
        try:
            found[library] = importlib.import_module(library).__version__
        except ImportError:
            found[library] = "missing"
    return found


def arguments(version, programs):
    parser = Parser(prog="shearbus-report", usage="shearbus-report RUN [RUN ...] [-o REPORT.html] [--figures DIR]\n       shearbus-report --version [--json]", description=__doc__, epilog=EPILOG)
    parser.add_argument("runs", nargs="*", type=pathlib.Path, metavar="RUN", help="directory of shearbus-hydro, or result of shearbus-replay (HDF5)")
    parser.add_argument("-o", "--out", type=pathlib.Path, metavar="REPORT.html", help="the report, replaced once it is whole (default: report.html in the first RUN, or beside it)")
    parser.add_argument("--figures", type=pathlib.Path, metavar="DIR", help="figures.json and pictures of the paper's figures, for a section of their own")
    parser.add_argument("--version", action="store_true", help="print version, commit and libraries")
    parser.add_argument("--json", action="store_true", help="with --version: as one line of JSON")
    options = parser.parse_args()
    if options.version:
        entries = version_of(version, programs)
        text = [f"{entries.pop('program')} {entries.pop('version')}"] if not options.json else []
        print(json.dumps(entries) if options.json else "\n".join(text + [f"  {key:<10} {value}" for key, value in entries.items()]))
        sys.exit(0)
    if options.json:
        parser.error("--json needs --version")
    if not options.runs:
        parser.error("the following arguments are required: RUN")
    return options


def main(version, programs):
    """Runs the program. programs: directory of shearbus-ctl, which knows the sources of the materials. Returns the
    exit code."""
    options = arguments(version, programs)
    if options.out is None:
        first = options.runs[0]
        options.out = (first if first.is_dir() else first.parent) / "report.html"
    try:
        with nothing_to_clean_up():
            import jinja2
            import output
            import runs
            import sections
    except ImportError as fault:
        print(f"shearbus-report: {fault}; install python3-jinja2, python3-matplotlib and python3-h5py", file=sys.stderr)
        return 1
    try:
        output.refuse_inputs(options.out, options.runs)  # before the work of a report
        output.check(options.out, output.PAGE)
        template = jinja2.Environment(loader=jinja2.FileSystemLoader(pathlib.Path(__file__).resolve().parent), autoescape=True, trim_blocks=True,
                                      lstrip_blocks=True, undefined=jinja2.StrictUndefined).get_template("report.html")
        page = template.render(sections.report(options.runs, options.figures, pathlib.Path(programs) / "shearbus-ctl", shlex.join(["shearbus-report", *sys.argv[1:]]), options.out))
        output.write(options.out, output.PAGE, page.encode("utf-8"), options.runs)
    except (runs.Fault, OSError) as fault:
        complain("shearbus-report", " ".join(str(fault).split()))
        return 1
    print(f"  report                  {printable(options.out)}")
    return 0
