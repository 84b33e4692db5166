"""A server of one's own: the program shearbus-server as a child of this process."""
import os
import pathlib
import shutil
import subprocess
import tempfile
import time
import weakref

from .errors import Code, Unreachable

START_S, STOP_S = 20.0, 10.0
# The shell ends the server when standard input closes, so no server outlives this process, however it ends.
_KEEPER = """exec 3<&0
"$@" 3<&- </dev/null & server=$!
(read -r _ <&3; kill -TERM "$server") & watcher=$!
wait "$server"; code=$?
kill "$watcher"; exit "$code" """


class Server:
    """Runs shearbus-server on an ipc endpoint in a private directory until close(), or until this process ends.

    executable: its path; None: the environment's SHEARBUS_SERVER, shearbus-server on PATH, or that of the installation
    prefix of this package. state_dir: directory in which sessions outlive the server; None: they end with it.
    arguments: more options of the program."""

    def __init__(self, executable=None, state_dir=None, arguments=()):
        beside = os.path.join(os.path.dirname(__file__), *[".."] * 4, "bin", "shearbus-server")
        program = (executable or os.environ.get("SHEARBUS_SERVER") or shutil.which("shearbus-server")
                   or shutil.which(beside))
        if not program or not shutil.which(program):
            raise Unreachable(Code.UNREACHABLE, "no endpoint was given, and " +
                              (f"{program} is no program" if program else "no shearbus-server is on PATH"),
                              "Give endpoint=, or name the program in the environment variable SHEARBUS_SERVER.")
        directory = tempfile.TemporaryDirectory(prefix="shearbus-")
        socket = pathlib.Path(directory.name, "bus")
        self.endpoint, self._log = f"ipc://{socket}", pathlib.Path(directory.name, "log")
        command = [program, "--bind", self.endpoint, *arguments]
        if state_dir is not None:
            command += ["--state-dir", os.fspath(state_dir)]
        with self._log.open("wb") as output:
            # A session of its own: an interrupt from the terminal is for the host, which then closes its session.
            keeper = subprocess.Popen(["/bin/sh", "-c", _KEEPER, "shearbus", *command],
                                      stdin=subprocess.PIPE,
                                      stdout=output,
                                      stderr=output,
                                      start_new_session=True)
        self.close = weakref.finalize(self, _stop, keeper, directory)
        deadline = time.monotonic() + START_S
        while not socket.exists():
            if keeper.poll() is not None or time.monotonic() > deadline:
                said = self._log.read_text(errors="replace").strip()[-2000:]
                self.close()
                raise Unreachable(Code.UNREACHABLE, f"{program} did not start: {said}",
                                  "Start it by hand to see what is wrong.")
            time.sleep(0.005)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()


def _stop(keeper, directory):
    keeper.stdin.close()
    try:
        keeper.wait(STOP_S)
    except subprocess.TimeoutExpired:
        os.killpg(keeper.pid, 9)
        keeper.wait()
    directory.cleanup()
