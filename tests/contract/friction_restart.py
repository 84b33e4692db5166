#!/usr/bin/python3
"""The templates of vendors' friction routines across a restart of their host: the host that dies after a restart file and goes on in another
process has the bits of the whole run; without the ticket, with one of another time, or without a server of its own it stops or says so.
friction_restart.py --program CALLER --scene SCENE.toml --kind exact|heat --endpoint ENDPOINT"""
import argparse
import os
import pathlib
import subprocess
import sys
import tempfile


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--program", type=pathlib.Path, required=True)
    parser.add_argument("--scene", type=pathlib.Path, required=True)
    parser.add_argument("--kind", required=True)
    parser.add_argument("--endpoint", required=True)
    given = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="shearbus-") as scratch:
        place = pathlib.Path(scratch)

        def host(*part, expect=0, says="", endpoint=given.endpoint, **environment):
            done = subprocess.run([given.program.resolve(), given.scene, given.kind, *part], capture_output=True, text=True, cwd=place, timeout=60,
                                  env={**os.environ, "SHEARBUS_SCENE": str(given.scene), "SHEARBUS_ENDPOINT": endpoint, **environment})
            if done.returncode != expect or says not in done.stderr:
                sys.exit(f"{' '.join(part) or 'whole'}: exit code {done.returncode}, expected {expect} and \"{says}\"\n{done.stdout}{done.stderr}")
            return [line for line in done.stdout.splitlines() if line.startswith("node")]

        def tickets():
            return sorted(place.glob("*.shearbus"))

        whole = host()
        for file in tickets():
            file.unlink()
        host("first")
        if len(tickets()) != 2 or any(file.stat().st_mode & 0o077 for file in tickets()) or list(place.glob("*.new")):
            sys.exit(f"expected two tickets for their owner alone: {sorted(place.iterdir())}")
        kept = {file: file.read_text() for file in tickets()}
        again = host("second", says="the layers go on from t4.55")
        if again != whole or len(whole) != 2:
            sys.exit(f"the run that goes on differs:\n{whole}\n{again}")
        again = host("second")  # a second time from the same restart file
        if again != whole:
            sys.exit(f"the second run that goes on differs:\n{whole}\n{again}")
        for file, text in kept.items():
            file.write_text(text.replace("4.55", "4.95"))
        host("second", expect=1, says="no mark of the layers has the time of the restart")
        for file in kept:
            file.write_text("no ticket\n")
        host("second", expect=1, says="the ticket cannot be read")
        for file in kept:
            file.unlink()
        host("second", expect=1, says="the host was restarted, and the ticket of its layers")
        cold = host("second", says="warning: the host was restarted with cold layers", SHEARBUS_COLD_LAYERS="1")
        if (cold == whole) != (given.kind == "exact"):
            sys.exit(f"cold layers: {cold}, and the whole run: {whole}")
        host("first", says="name a server by SHEARBUS_ENDPOINT", endpoint="")
        if tickets():
            sys.exit("a host whose layers end with it has written a ticket")
        host("second", expect=1, says="the host was restarted, and the ticket of its layers", endpoint="")
    print("; ".join(whole))


if __name__ == "__main__":
    main()
