"""Puts one or more runs into one HTML file that needs nothing else: no network, no script. A RUN is a directory that
shearbus-hydro wrote, in one or two dimensions, or a file of results of shearbus-replay; runs of one scene with
several laws are compared.

exit code: 0 the report is written, 1 a run cannot be read or the file not written, 2 a faulty command line"""
import argparse
import os
import pathlib
import shlex
import sys


def arguments(version):
    parser = argparse.ArgumentParser(prog="shearbus-report", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", type=pathlib.Path, metavar="RUN", help="directory of shearbus-hydro, or result of shearbus-replay (HDF5)")
    parser.add_argument("-o", "--out", type=pathlib.Path, metavar="REPORT.html", help="the report, replaced once it is whole (default: report.html in the first RUN, or beside it)")
    parser.add_argument("--figures", type=pathlib.Path, metavar="DIR", help="figures.json and pictures of the paper's figures, for a section of their own")
    parser.add_argument("--version", action="version", version=f"shearbus-report {version}")
    return parser.parse_args()


def main(version, programs):
    """Runs the program. programs: directory of shearbus-ctl, which knows the sources of the materials. Returns the
    exit code."""
    options = arguments(version)
    if options.out is None:
        first = options.runs[0]
        options.out = (first if first.is_dir() else first.parent) / "report.html"
    partial = options.out.with_name(options.out.name + ".partial")
    try:
        import jinja2
        import runs
        import sections
    except ImportError as fault:
        print(f"shearbus-report: {fault}; install python3-jinja2, python3-matplotlib and python3-h5py", file=sys.stderr)
        return 1
    try:
        if not options.out.parent.is_dir():  # before the work of a report
            raise runs.Fault(f"{options.out}: there is no directory {options.out.parent}")
        template = jinja2.Environment(loader=jinja2.FileSystemLoader(pathlib.Path(__file__).resolve().parent), autoescape=True, trim_blocks=True,
                                      lstrip_blocks=True, undefined=jinja2.StrictUndefined).get_template("report.html")
        page = template.render(sections.report(options.runs, options.figures, pathlib.Path(programs) / "shearbus-ctl", shlex.join(["shearbus-report", *sys.argv[1:]])))
        partial.write_text(page, encoding="utf-8")
        os.replace(partial, options.out)
    except (runs.Fault, OSError) as fault:
        partial.unlink(missing_ok=True)
        print(f"shearbus-report: {' '.join(str(fault).split())}", file=sys.stderr)
        return 1
    print(f"  report                  {options.out}")
    return 0
