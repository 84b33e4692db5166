#!/usr/bin/python3
"""Rehearses hosts with the installed shearbus-ctl, by the commands of the page client/README.md: hosts in C++ and Fortran that are
listings of that page, the Python host of the kit, a host of Godunov's kind, and a host with a wrong sign, which must fail.

rehearse.py --build BUILD --page README.md --examples DIR"""
import argparse
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import time

import coupling_page

KIT_HOST = f"/usr/bin/python3 -B {pathlib.Path(__file__).with_name('kit_host.py')}"
GODUNOV_HOST = f"/usr/bin/python3 -B {pathlib.Path(__file__).with_name('godunov_host.py')}"
DELAY = "--delay 0.3 "  # s; the Python host of the kit repeats a request after 0.1 s


def rehearse(page, words, host=None):
    """Runs the installed shearbus-ctl; `host` is started once it waits. Returns (exit code, what it said)."""
    kit = subprocess.Popen([page.prefix / "bin/shearbus-ctl", *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True,
                           env={name: value for name, value in os.environ.items() if name != "PYTHONPATH"})
    if host:
        said = kit.stdout.readline()
        if "waiting at" not in said:
            return kit.wait(10), said + kit.stdout.read()
        host()
    said = kit.communicate(timeout=300)[0]
    return kit.returncode, said


def faults(page, examples, endpoint):
    lines = re.findall(r"^shearbus-ctl (rehearse .*?)(?:  +#.*)?$", "".join(re.findall(r"^```sh\n(.*?)^```", page.text, re.M | re.S)), re.M)
    lines = [line.replace("ipc:///tmp/bus", endpoint) for line in lines]
    if len(lines) != 3:
        yield f"expected three commands on the page, found {lines}"
        return
    by_hand, plate, started = lines
    one_pressure = lambda source: source.replace("{1e8, 3e8, 5e8}", "{1e9, 1e9, 1e9}").replace("[1e8_real64, 3e8_real64, 5e8_real64]", "1e9_real64")
    hosts = {name: (language, one_pressure(source)) for name, language, source, _ in page.sources() if name in ("cpp", "fortran newmark")}
    runs = {name: (by_hand, lambda host=host: page.play(*host, examples, endpoint)) for name, host in hosts.items()}
    runs["plate"] = plate, lambda: coupling_page.run(*KIT_HOST.split(), endpoint, "finite_plate")
    runs["all problems"] = f"rehearse {DELAY}--scenario all -- {KIT_HOST} @endpoint @problem stick_form", None
    runs["started"] = started.replace("your_host --server @endpoint --problem @problem", f"{KIT_HOST} @endpoint @problem").replace(
        "rehearse ", "rehearse " + DELAY), None
    # Velocities at whole steps, in cells: both forms, and steps shorter than the time that a wave takes across a cell.
    further = "".join(f"--scenario {name} " for name in ("softening_friction", "stick_slip_brake", "flash_to_melting", "opening_and_closing"))
    for form, scenarios in (("far_field", ""), ("stick", ""), ("stick", further), ("far_field 0.4", "--scenario two_half_spaces ")):
        runs[f"godunov {form} {scenarios}"] = f"rehearse {DELAY}{scenarios}-- {GODUNOV_HOST} @endpoint @problem {form}", None
    for name, (words, host) in runs.items():
        code, said = rehearse(page, words.split(), host)
        good = re.search(r"^your client: (\d+) of (\d+)$", said, re.M)
        if code != 0 or not good or good[1] != good[2]:
            yield f"{name}: exit code {code}, {said}"
    code, said = rehearse(page, f"rehearse --scenario two_half_spaces -- {KIT_HOST} @endpoint @problem sign_of_a_stress".split())
    if code != 1 or "the jump of a request is the jump that was answered" not in said:
        yield f"a wrong sign was not noticed: exit code {code}, {said}"
    code, said = rehearse(page, ["rehearse"])
    if code != 2 or "expected either an ENDPOINT or" not in said:
        yield f"no argument: exit code {code}, {said}"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("build", "page", "examples"):
        parser.add_argument(f"--{name}", type=pathlib.Path, required=True)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="shearbus-") as scratch:
        work = pathlib.Path(scratch)
        page = coupling_page.installed_page(options.build, options.page, work)
        found = list(faults(page, options.examples.resolve(), f"ipc://{work}/mock"))
    print("\n".join(found) if found else "right hosts pass, a wrong one does not")
    return bool(found)


if __name__ == "__main__":
    sys.exit(main())
