"""A build that is installed as a user installs it, and a server of the installation."""
import contextlib
import signal
import subprocess
import sys
import time


def run(*command, fails=False, **options):
    """Runs a command to its end. The test ends where it fails, unless it may."""
    done = subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=200, **options)
    if done.returncode != 0 and not fails:
        sys.exit(f"{' '.join(map(str, command))} ended with {done.returncode}:\n{done.stdout[-3000:]}{done.stderr[-5000:]}")
    return done


def install(build, prefix, *components):
    for component in components:
        run("cmake", "--install", build, "--prefix", prefix, "--component", component)


@contextlib.contextmanager
def serving(prefix, socket):
    """Yields the endpoint of a server, which must end well."""
    with subprocess.Popen([prefix / "bin/shearbus-server", "--bind", f"ipc://{socket}", "--log-level", "error"]) as server:
        try:
            while not socket.exists() and server.poll() is None:
                time.sleep(0.02)
            yield f"ipc://{socket}"
            server.send_signal(signal.SIGTERM)
            if server.wait(20) != 0:
                sys.exit(f"the server ended with {server.returncode}")
        finally:
            server.kill()
