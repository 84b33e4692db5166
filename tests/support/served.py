"""What tests of programs share: their options, a scratch directory, scenes, and programs and servers that end with the test."""
import argparse
import json
import os
import pathlib
import re
import resource
import signal
import subprocess
import sys
import tempfile
import time
import unittest

PATIENCE_S = 120.0  # far more than a start takes on a machine that others use
SOURCE = pathlib.Path(__file__).resolve().parents[2]
EXAMPLES, PROBLEMS = SOURCE / "client/examples", SOURCE / "hydro_stub/problems"
PYTHON = str(SOURCE / "client/python")
sys.path.insert(0, PYTHON)
os.environ["PYTHONPATH"] = os.pathsep.join(filter(None, (PYTHON, os.environ.get("PYTHONPATH"))))  # of the hosts that tests start
sys.dont_write_bytecode = True


class Options(argparse.Namespace):
    """Options of the command line, and programs of the build that --build names: contract_c is its shearbus-contract-c."""

    def __getattr__(self, name):
        for folder in ("bin", "tests") if vars(self).get("build") else ():
            program = pathlib.Path(self.build, folder, f"shearbus-{name.replace('_', '-')}")
            if program.is_file():
                return program
        raise AttributeError(f"--{name} is not given, nor a build with a program of this name")


OPTIONS = Options()


def options(*names, parser=None):
    """Reads the options --NAME, or --build, each of which must be given. Returns OPTIONS and the rest of the command line."""
    parser = parser or argparse.ArgumentParser()
    for name in names or ["build"]:
        parser.add_argument(f"--{name}", required=True)
    return parser.parse_known_args(namespace=OPTIONS)


def main(*names, parser=None):
    """Runs the tests of the calling program, which has these options."""
    unittest.main(argv=[sys.argv[0], *options(*names, parser=parser)[1]])


def toml(tables, path=""):
    """Returns nested dicts as TOML: values first, then tables."""
    values = "".join(f"{key} = {json.dumps(value)}\n" for key, value in tables.items() if not isinstance(value, dict))
    return values + "".join(f"[{path}{key}]\n{toml(value, f'{path}{key}.')}" for key, value in tables.items() if isinstance(value, dict))


def scene(strategy, name="test", soft="aluminium_dlp", hard="steel_dlp", **tables):
    """Returns the TOML of a scene with these metals and further tables, or values, as nested dicts."""
    return toml({"name": name, "strategy": strategy, "soft": {"material": soft}, "hard": {"material": hard}, **tables})


def edited(file, path, **values):
    """Writes the scene of a file with other values of some keys, each of which stands in one place. Returns the path."""
    text = pathlib.Path(file).read_text(encoding="utf8")
    for key, value in values.items():
        text, found = re.subn(rf"(?m)^{key} = \S+", lambda _: f"{key} = {value}", text)
        assert found == 1, f"{file}: {key} stands in {found} places"
    path.write_text(text, encoding="utf8")
    return path


def assert_same_run(test, ours, theirs):
    """Compares every dataset of two runs of the hydrocode, and every number of their summaries but times and where the run was made. Returns the
    number of datasets."""
    import h5py
    import numpy

    names = sorted(p.relative_to(theirs) for p in theirs.rglob("*.h5"))
    test.assertEqual(sorted(p.relative_to(ours) for p in ours.rglob("*.h5")), names)
    count = 0
    for name in names:
        with h5py.File(ours / name) as a, h5py.File(theirs / name) as b:
            found = []
            b.visititems(lambda path, thing: found.append(path) if isinstance(thing, h5py.Dataset) else None)
            for path in found:
                if not path.startswith("meta"):
                    numpy.testing.assert_array_equal(a[path][...], b[path][...], err_msg=f"{name} {path}")
                    count += 1
    a, b = (json.loads((run / "summary.json").read_text()) for run in (ours, theirs))
    for key in b.keys() - {"run_time_s", "cpu_time_s", "service_share", "waiting_share", "cpu_share", "provenance"}:
        test.assertEqual(a[key], b[key], key)
    return count


def file_limit(size):
    """Returns what a process calls before it starts so that its files have at most `size` bytes, as on a disk that is full."""
    return lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (size, resource.RLIM_INFINITY))


def end(process):
    process.kill()
    process.wait()
    for stream in (process.stdin, process.stdout, process.stderr):
        if stream:
            stream.close()


def program(test, *command, **more):
    """Starts a program that ends with the test."""
    process = subprocess.Popen([str(word) for word in command], **{"text": True, **more})
    test.addCleanup(end, process)
    return process


def start(test, log, *command, **more):
    """Starts a server that ends with the test. Its process gets the member `text`, a function that returns its log."""
    with open(log, "w", encoding="utf8") as out:
        server = program(test, *command, stdout=out, stderr=out, **more)
    server.text = lambda: log.read_text(encoding="utf8")
    return server


def until(test, holds, process=None, patience=PATIENCE_S):
    """Waits until holds(), while the process runs, if one is given."""
    latest = time.monotonic() + patience
    text = getattr(process, "text", lambda: "what was waited for has not come")
    while not holds():
        test.assertIsNone(process and process.poll(), text())
        test.assertLess(time.monotonic(), latest, text())
        time.sleep(0.005)


def serve(test, log, *command, ready="listening on", **more):
    """Starts a server as start() does, and waits until its log has the words."""
    server = start(test, log, *command, **more)
    until(test, lambda: ready in server.text(), server)
    return server


class Server:
    """A server on a socket of its own, which can be killed and started again, and ends with the test."""

    def __init__(self, test, path, *options, name="bus", durable=True):
        self.test, self.socket = test, path / name
        self.endpoint = f"ipc://{self.socket}"
        self.command = [OPTIONS.server, "--bind", self.endpoint, "--threads", "1", "--log-level", "error", *options]
        if durable:
            self.command += ["--state-dir", path / f"{name}-states"]
        self.start()

    def start(self):
        self.socket.unlink(missing_ok=True)
        self.process = program(self.test, *self.command)
        until(self.test, self.socket.exists, self.process)

    def end(self, how=signal.SIGKILL):
        self.process.send_signal(how)
        return self.process.wait(timeout=PATIENCE_S)

    def stop(self):
        """Lets nothing run until go()."""
        self.process.send_signal(signal.SIGSTOP)

    def go(self):
        self.process.send_signal(signal.SIGCONT)


class Served(unittest.TestCase):
    """A test with a directory of its own, `path`, and the endpoint `bus` in it."""

    def setUp(self):
        scratch = tempfile.TemporaryDirectory(prefix="shearbus-")
        self.addCleanup(scratch.cleanup)
        self.path = pathlib.Path(scratch.name)
        self.bus = f"ipc://{self.path}/bus"
        self.starts = 0

    def log(self):
        """Returns the name of a new log."""
        self.starts += 1
        return self.path / f"log{self.starts}"

    def run_program(self, *command, code=0, **more):
        """Runs a program to its end, which must have this exit code. Returns it, with its `stdout` and `stderr`."""
        more = {"capture_output": True, "text": True, "timeout": 300, **more}
        done = subprocess.run([str(word) for word in command], check=False, **more)
        self.assertEqual(done.returncode, code, f"{command}: {done.stdout}{done.stderr}")
        return done

    def refused(self, *command, said, code=1, **more):
        """Runs a program that must end with this code, and say this in its errors. Returns them."""
        errors = self.run_program(*command, code=code, **more).stderr
        for text in [said] if isinstance(said, str) else said:
            self.assertIn(text, errors)
        return errors
