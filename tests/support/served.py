"""What tests of programs share: their options, a scratch directory, and servers that end with the test."""
import argparse
import pathlib
import subprocess
import sys
import tempfile
import time
import unittest

PATIENCE_S = 30.0  # far more than a start takes on a machine that others use
SOURCE = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(SOURCE / "client/python"))


def options(*names, parser=None):
    """Returns the options --NAME, each of which must be given, and the rest of the command line."""
    parser = parser or argparse.ArgumentParser()
    for name in names:
        parser.add_argument(f"--{name}", required=True)
    return parser.parse_known_args()


def start(test, log, *command, **more):
    """Starts a server that ends with the test. Its process gets the member `text`, a function that returns its log."""
    with open(log, "w", encoding="utf8") as out:
        server = subprocess.Popen([str(word) for word in command], stdout=out, stderr=out, **more)
    server.text = lambda: log.read_text(encoding="utf8")

    def end():
        if server.poll() is None:
            server.kill()
        server.wait()
    test.addCleanup(end)
    return server


def until(test, holds, server, patience=PATIENCE_S):
    """Waits until holds(), while the server runs."""
    end = time.monotonic() + patience
    while not holds():
        test.assertIsNone(server.poll(), server.text())
        test.assertLess(time.monotonic(), end, server.text())
        time.sleep(0.01)


def serve(test, log, *command, ready="listening on", **more):
    """Starts a server as start() does, and waits until its log has the words."""
    server = start(test, log, *command, **more)
    until(test, lambda: ready in server.text(), server)
    return server


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
