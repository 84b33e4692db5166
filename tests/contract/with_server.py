#!/usr/bin/python3
"""Runs a program against its own server: with_server.py --server SHEARBUS_SERVER [--ctl SHEARBUS_CTL] -- COMMAND ARGS... where {endpoint}
stands for the server's endpoint. With --ctl the server listens on tcp with keys that shearbus-ctl makes; {server_key} and {key} then stand
for the files that a client needs. With --durable the server keeps its states and is started again when the program has killed it; {pid_file}
stands for a file with its process id. Fails if the program fails, or if the server does not stop cleanly on SIGTERM."""
import argparse
import pathlib
import signal
import socket
import subprocess
import sys
import tempfile
import time

START_S = 20.0
RUN_S = 240.0
STOP_S = 10.0


def free_port():
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--server", required=True, help="path of shearbus-server")
    parser.add_argument("--ctl", help="path of shearbus-ctl")
    parser.add_argument("--durable", action="store_true", help="a durable server, which the program may kill")
    parser.add_argument("command", nargs=argparse.REMAINDER)
    options = parser.parse_args()
    command = options.command[1:] if options.command[:1] == ["--"] else options.command
    with tempfile.TemporaryDirectory(prefix="shearbus-") as directory:
        path = pathlib.Path(directory, "bus")
        words = {"{endpoint}": f"ipc://{path}"}
        arguments = ["--bind", f"ipc://{path}"]
        if options.ctl:
            for name in ("server", "client"):
                subprocess.run([options.ctl, "keygen", f"{directory}/{name}"], check=True)
            words["{endpoint}"] = f"tcp://127.0.0.1:{free_port()}"
            words["{server_key}"], words["{key}"] = f"{directory}/server.public", f"{directory}/client.secret"
            arguments += ["--bind", words["{endpoint}"], "--curve-secret", f"{directory}/server.secret",
                          "--authorized-keys", f"{directory}/client.public"]
        pid_file = pathlib.Path(directory, "pid")
        if options.durable:
            words["{pid_file}"] = str(pid_file)
            arguments += ["--state-dir", f"{directory}/state"]

        def start():
            path.unlink(missing_ok=True)
            process = subprocess.Popen([options.server, *arguments])
            deadline = time.monotonic() + START_S
            while not path.exists():
                if process.poll() is not None or time.monotonic() > deadline:
                    process.kill()
                    sys.exit(f"the server did not start listening within {START_S} s (exit code {process.poll()})")
                time.sleep(0.02)
            pid_file.write_text(f"{process.pid}\n")
            return process

        server = start()
        program = None
        try:
            for mark, value in words.items():
                command = [word.replace(mark, value) for word in command]
            program = subprocess.Popen(command)
            deadline = time.monotonic() + RUN_S
            while program.poll() is None:
                if time.monotonic() > deadline:
                    sys.exit(f"the program did not end within {RUN_S} s")
                if options.durable and server.poll() == -signal.SIGKILL:
                    server = start()
                time.sleep(0.02)
            code = program.returncode
            if server.poll() is not None:
                sys.exit(f"the server ended during the test with exit code {server.returncode}")
            server.send_signal(signal.SIGTERM)
            if server.wait(STOP_S) != 0:
                sys.exit(f"the server ended with exit code {server.returncode} on SIGTERM, expected 0")
            sys.exit(code)
        finally:
            if program is not None and program.poll() is None:
                program.kill()
                program.wait()
            if server.poll() is None:
                server.kill()
                server.wait()


if __name__ == "__main__":
    main()
