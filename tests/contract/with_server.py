#!/usr/bin/python3
"""Runs a program against a server of its own: with_server.py --server SHEARBUS_SERVER -- COMMAND ARGS... where {endpoint} stands
for the server's endpoint. Fails if the program does, or if the server does not stop cleanly on SIGTERM."""
import argparse
import pathlib
import signal
import subprocess
import sys
import tempfile
import time

START_S = 20.0
RUN_S = 240.0
STOP_S = 10.0


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--server", required=True, help="path of shearbus-server")
    parser.add_argument("command", nargs=argparse.REMAINDER)
    options = parser.parse_args()
    command = options.command[1:] if options.command[:1] == ["--"] else options.command
    with tempfile.TemporaryDirectory(prefix="shearbus-") as directory:
        path = pathlib.Path(directory, "bus")
        server = subprocess.Popen([options.server, "--bind", f"ipc://{path}"])
        try:
            deadline = time.monotonic() + START_S
            while not path.exists():
                if server.poll() is not None or time.monotonic() > deadline:
                    sys.exit(f"the server did not start listening within {START_S} s (exit code {server.poll()})")
                time.sleep(0.02)
            code = subprocess.run([word.replace("{endpoint}", f"ipc://{path}") for word in command], timeout=RUN_S).returncode
            if server.poll() is not None:
                sys.exit(f"the server ended during the test with exit code {server.returncode}")
            server.send_signal(signal.SIGTERM)
            if server.wait(STOP_S) != 0:
                sys.exit(f"the server ended with exit code {server.returncode} on SIGTERM, expected 0")
            sys.exit(code)
        finally:
            if server.poll() is None:
                server.kill()
                server.wait()


if __name__ == "__main__":
    main()
