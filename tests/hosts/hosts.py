#!/usr/bin/python3
"""Hosts whose surroundings this script makes: hosts.py CASE ... with one of the cases
  no_thread       few processes, threads or memory: refusals that name the limit, in hosts and in shearbus-server
  control_group   a control group with few threads (pids.max), as of a container or a job: the same
  locale          Turkish and German hosts: the bits and the texts of a plain one
  fortran_traps   a Fortran host that traps floating-point exceptions: the output of a plain one
Exit code 77: what is needed is not there."""
import argparse
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile
import time

SKIPPED = 77
USER = 54399  # of no other process
TIMEOUT = 60


def skip(why):
    print(f"skipped: {why}")
    sys.exit(SKIPPED)


def run(command, **more):
    return subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=TIMEOUT, **more)


def expect(holds, what, found):
    if not holds:
        sys.exit(f"not so: {what}\n  exit code {found.returncode}\n  {found.stdout}{found.stderr}")


def as_user(threads, command):
    """Runs the command as a user who may have so many processes and threads."""
    limited = ["bash", "-c", f'ulimit -u {threads}; exec "$@"', "bash"]
    return run(["setpriv", "--reuid", USER, "--regid", USER, "--clear-groups", *limited, *command])


def expect_limits_named(given, limited, word, told, place):
    """Starts hosts and servers with from few to enough threads, by limited(threads, command): each refusal has the word and told(threads)."""
    for endpoint in ("embedded", "ipc:///tmp/shearbus-no-server"):
        refused = 0
        for threads in range(1, 9):
            found = limited(threads, [given.host, "open", given.scene, endpoint])
            expect(found.returncode in (0, 3) and not found.stderr, f"{threads} threads, {endpoint}: opened or refused", found)
            if word in found.stdout:
                refused += 1
                expect(found.stdout.startswith("UNREACHABLE") and told(threads) in found.stdout, f"{threads} threads, {endpoint}: the refusal names the limit", found)
            elif endpoint != "embedded":
                break  # enough threads to look for the server, which is not there
        expect(refused > 0 and word not in found.stdout, f"{endpoint}: too few threads are refused, enough are not", found)
    for threads in (1, 2, 3):
        found = limited(threads, [given.server, "--threads", "4", "--log-level", "off", "--bind", f"ipc://{place}/own/bus"])
        expect(found.returncode == 1 and word in found.stderr and found.stderr.count("\n") == 1,
               f"shearbus-server with {threads} threads says it in one sentence", found)


def no_thread(given):
    if given.sanitized:
        skip("sanitizers need more memory and threads")
    if os.geteuid() != 0 or shutil.which("setpriv") is None:
        skip("only root can become another user, by setpriv")
    with tempfile.TemporaryDirectory() as place:
        os.chmod(place, 0o755)
        scene = pathlib.Path(place, "scene.toml")
        scene.write_bytes(given.scene.read_bytes())
        scene.chmod(0o644)
        given.scene = scene
        if as_user(64, [given.host, "open", scene, "embedded"]).returncode != 0:
            skip("another user cannot run the programs of this build")
        expect_limits_named(given, as_user, "(ulimit -u)", lambda _: "", place)
        # From too little memory for the libraries to be loaded to enough.
        codes = [run(["bash", "-c", f'ulimit -v {kilobytes}; exec "$@"', "bash", given.host, "open", scene, "embedded"])
                 for kilobytes in range(20_000, 400_000, 10_000)]
        for found in codes:
            expect(found.returncode in (0, 3) or "error while loading shared libraries" in found.stderr,
                   "with little memory a session is opened or refused", found)
        expect(codes[-1].returncode == 0 and any("(ulimit -v)" in found.stdout for found in codes), "memory is refused", codes[-1])


def control_group(given):
    if given.sanitized:
        skip("sanitizers need more threads")
    root = next((place for place in (pathlib.Path("/sys/fs/cgroup/pids"), pathlib.Path("/sys/fs/cgroup")) if (place / "cgroup.procs").exists()), None)
    group = None if root is None else root / f"shearbus-hosts-{os.getpid()}"
    try:
        group.mkdir()
        (group / "pids.max").write_text("64")
    except (AttributeError, OSError) as fault:
        if group is not None and group.exists():
            group.rmdir()
        skip(f"no control group can be made: {fault}")

    def run_inside(threads, command):
        (group / "pids.max").write_text(str(threads))
        return run(["bash", "-c", f'echo $$ >{group}/cgroup.procs; exec "$@"', "bash", *command])

    try:
        if run_inside(64, [given.host, "open", given.scene, "embedded"]).returncode != 0:
            skip("no process can be moved into a control group")
        with tempfile.TemporaryDirectory() as place:
            expect_limits_named(given, run_inside, "(pids.max)", lambda threads: f"{group.name} may have {threads} threads", place)
    finally:
        for _ in range(100):  # the kernel counts a process out a moment after its end
            try:
                group.rmdir()
                break
            except OSError:
                time.sleep(0.05)


def locale(given):
    if shutil.which("localedef") is None:
        skip("no localedef")
    with tempfile.TemporaryDirectory() as place:
        for language in ("tr_TR", "de_DE"):
            made = run(["localedef", "-i", language, "-f", "UTF-8", f"{place}/{language}.UTF-8"])
            if not pathlib.Path(place, f"{language}.UTF-8", "LC_CTYPE").exists():
                skip(f"localedef cannot make {language}: {made.stderr}")

        def answers(name):
            surroundings = dict(os.environ, LOCPATH=place, LC_ALL=name, LANGUAGE="C")
            by_c = run([given.host, "locale", given.scene, given.endpoint], env=surroundings)
            by_cxx = run([given.cxx_host, given.scene, given.endpoint, name], env=surroundings)
            for found in (by_c, by_cxx):
                expect(found.returncode == 0 and not found.stderr, f"a host in {name} runs", found)
            return by_c.stdout + by_cxx.stdout, by_cxx

        plain, _ = answers("C")
        for language in ("tr_TR", "de_DE"):
            found, process = answers(f"{language}.UTF-8")
            expect(found == plain, f"a host in {language} gets the texts and bits of a plain one:\n{plain}\n", process)


def fortran_traps(given):
    plain, traps = (run([program, given.scene, given.endpoint]) for program in (given.plain, given.traps))
    expect(plain.returncode == 0, "the plain host runs", plain)
    expect(traps.returncode == 0 and traps.stdout == plain.stdout, "the host with traps has the same output", traps)


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("case", choices=("no_thread", "control_group", "locale", "fortran_traps"))
    for name in ("scene", "host", "cxx_host", "server", "plain", "traps"):
        parser.add_argument(f"--{name}", type=pathlib.Path)
    parser.add_argument("--endpoint", default="embedded")
    parser.add_argument("--sanitized", action="store_true")
    given = parser.parse_args()
    globals()[given.case](given)


if __name__ == "__main__":
    main()
