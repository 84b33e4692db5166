"""The socket of the mock server: the endpoints that it takes, and that it takes none from a server. The rules are those of
shearbus-server (server/transport/socket_path.cpp), except that any directory will do."""
import contextlib
import errno
import fcntl
import os
import socket
import stat

import zmq

LONGEST_PATH = 107  # bytes
EXPECTED = "expected ipc://PATH, or tcp://ADDRESS:PORT with a port up to 65535 (*: any that is free)"


class Refused(Exception):
    """Why no host can be waited for at an endpoint, and what to do."""


def check_endpoint(endpoint):
    """Raises Refused for what is no endpoint of a server."""
    scheme, _, address = endpoint.partition("://")
    host, _, port = address.rpartition(":")
    if scheme == "tcp" and host and (port == "*" or port.isascii() and port.isdigit() and int(port[:9]) <= 65535):
        return
    if scheme != "ipc" or not address or address[0] in "*@~":
        raise Refused(f'{EXPECTED}; found "{endpoint}"')
    if len(os.fsencode(address)) > LONGEST_PATH:
        raise Refused(f"expected a path of at most {LONGEST_PATH} bytes, found {len(os.fsencode(address))} in {endpoint}; choose a shorter one")


def _is_served(path):
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM | socket.SOCK_NONBLOCK) as probe:
        return probe.connect_ex(path) in (0, errno.EAGAIN)


def _take(path):
    """Returns the descriptor of the locked file PATH.lock."""
    directory = os.path.dirname(path) or "."
    if not os.path.isdir(directory):
        raise Refused(f"ipc://{path}: there is no directory {directory}; create it, or choose another path")
    lock = path + ".lock"
    try:
        held = os.open(lock, os.O_CREAT | os.O_RDWR | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
    except OSError as fault:
        raise Refused(f"{lock}: cannot be opened: {fault.strerror}; choose a path in a directory of your own") from None
    try:
        fcntl.flock(held, fcntl.LOCK_EX | fcntl.LOCK_NB)
        if os.path.lexists(path) and not stat.S_ISSOCK(os.lstat(path).st_mode):
            raise Refused(f"ipc://{path} is a file or directory, not a socket: listening there would delete it; choose another path")
        if _is_served(path):
            raise BlockingIOError
    except BlockingIOError:
        os.close(held)
        raise Refused(f"a server listens on ipc://{path}; stop it first, or choose another path") from None
    except BaseException:
        os.close(held)
        raise
    return held


@contextlib.contextmanager
def listening(router, endpoint):
    """Binds a socket to an endpoint and yields the endpoint as bound. Raises Refused. At the end the file of the socket is removed;
    the lock file stays, as a server leaves it."""
    check_endpoint(endpoint)
    path = endpoint[len("ipc://"):] if endpoint.startswith("ipc://") else None
    held = None if path is None else _take(path)
    try:
        try:
            router.bind(endpoint)
        except zmq.ZMQError as fault:
            raise Refused(f"cannot listen on {endpoint}: {fault.strerror}; choose another endpoint") from None
        made = path and os.lstat(path).st_ino
        try:
            yield router.getsockopt(zmq.LAST_ENDPOINT).rstrip(b"\0").decode()
        finally:
            with contextlib.suppress(OSError):
                if path and os.lstat(path).st_ino == made:
                    os.unlink(path)
    finally:
        if held is not None:
            os.close(held)
