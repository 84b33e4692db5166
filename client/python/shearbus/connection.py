"""One DEALER socket with deadlines and retries (proto/WIRE.md, "Deadlines and repeats"): sends the frames of a request
and returns the reply to it."""
import contextlib
import logging
import os
import pathlib
import socket as socket_library
import stat
import struct
import time
import tomllib
from typing import Any, NamedTuple

import zmq

from . import header
from .checksum import xxh3
from .errors import AuthError, Code, Error, UnexpectedReply, UnknownOutcome, Unreachable, error

HANDSHAKES = (zmq.EVENT_HANDSHAKE_SUCCEEDED | zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL | zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
              | zmq.EVENT_HANDSHAKE_FAILED_AUTH)
SILENT_FAILURES = 3  # handshakes failed in a row after which a wrong key is reported
SMALL_BYTES = 1 << 16  # frames up to this size are copied, which is quicker than views of them
RECEIVE_MS = 100  # a receive waits so long before handshakes and deadlines are looked at
REPORT_AFTER_S = 2.0  # time after which a waiting call says whom it waits for
RECOVERY_PAUSE_S = 0.2  # time between two requests to a server that recovers
MAX_PAYLOAD_BYTES = 32 * 1024 * 1024
Z85 = frozenset(b"0123456789abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ.-:+=^!/*?&<>()[]{}@%$#")

FRAMES_BEFORE_LOOK = 90  # most frames read from a socket since it was found empty
NOW, MORE = int(zmq.DONTWAIT), int(zmq.DONTWAIT | zmq.SNDMORE)

log = logging.getLogger("shearbus")


class Reply(NamedTuple):
    header: Any  # decoded ReplyHeader
    payload: Any  # bytes or memoryview of the payload frame, or None
    round_trip_s: float


def key_in(file, secret):
    """Returns the only key in a file: a line of 40 characters of Z85, then words; lines that begin with "# " are
    comments."""
    path = pathlib.Path(file)
    try:
        if secret and path.stat().st_mode & 0o077:
            raise AuthError(Code.AUTH, f"{file}: others can read the secret key; expected mode 0600",
                            f"chmod 600 {file}")
        lines = [line.split()[0].encode() for line in path.read_text().splitlines()
                 if line.strip() and line.strip() != "#" and not line.startswith("# ")]
    except (OSError, UnicodeError) as fault:
        raise AuthError(Code.AUTH, f"{file}: the key cannot be read: {fault}",
                        "shearbus-ctl keygen makes a pair of files.")
    if len(lines) != 1 or not _is_key(lines[0]):
        raise AuthError(Code.AUTH, f"{file}: expected one key of 40 characters of Z85",
                        "shearbus-ctl keygen makes a pair of files.")
    return lines[0]


FILE_SCHEME = "file://"  # an endpoint that names an endpoint file, which a server writes when it listens
MAX_ENDPOINT_FILE_BYTES = 4096
FILE_PAUSE_S = 0.05  # time between two looks at an endpoint file
FILE_LOOK_S = 0.5  # likewise while the server that it names does not answer


class EndpointFile(NamedTuple):
    """What an endpoint file tells (deploy/README.md, "Endpoint files"). server_key: empty where the server has none."""
    version: str
    host: str
    server_key: str
    endpoint: str
    epoch: str


def endpoint_in(file):
    """Returns the EndpointFile of a path. Raises ValueError for a file that is absent, incomplete or no endpoint file."""
    try:
        with open(os.open(file, os.O_RDONLY | os.O_NONBLOCK), "rb") as opened:
            if not stat.S_ISREG(os.fstat(opened.fileno()).st_mode):
                raise ValueError(f"{file}: is not a regular file")
            text = opened.read(MAX_ENDPOINT_FILE_BYTES + 1)
        if len(text) > MAX_ENDPOINT_FILE_BYTES:
            raise ValueError(f"{file}: has more than {MAX_ENDPOINT_FILE_BYTES} bytes; it is no endpoint file")
        if text and not text.endswith(b"\n"):
            raise ValueError(f"{file}: the last line is incomplete; the file was written only in part")
        table = tomllib.loads(text.decode())
    except OSError as fault:
        raise ValueError(f"{file}: cannot be read: {fault.strerror}") from None
    except (UnicodeError, tomllib.TOMLDecodeError) as fault:
        raise ValueError(f"{file}: is no endpoint file: {fault}") from None
    for key in EndpointFile._fields:
        if not isinstance(table.get(key), str):
            raise ValueError(f"{file}: has no {key}; expected an endpoint file of shearbus-server, complete")
    found = EndpointFile(*(table[key] for key in EndpointFile._fields))
    if not found.endpoint.startswith(("tcp://", "ipc://")):
        raise ValueError(f"{file}: endpoint = {found.endpoint!r}, expected tcp://HOST:PORT or ipc://PATH")
    if found.server_key and not _is_key(found.server_key.encode()):
        raise ValueError(f"{file}: server_key is not a key of 40 characters of Z85")
    return found


def _is_key(key):
    return len(key) == 40 and Z85.issuperset(key)


class Connection:
    """A connection to a server, with a socket that is replaced after every reply that did not come in time.

    endpoint: tcp://host:port, ipc://path, or file://path of a server's endpoint file. server_key, key: files of the
    server's public and the client's own secret key, for tcp; an endpoint file has the server's key. Times in seconds; reply_deadline is that of a call, retries included."""

    def __init__(self, endpoint, server_key=None, key=None, name="shearbus-python", connect_deadline=5.0,
                 reply_deadline=60.0, retry_after=5.0):
        if not isinstance(endpoint, str) or not endpoint.startswith(("tcp://", "ipc://", FILE_SCHEME)):
            raise Unreachable(Code.UNREACHABLE, f"{endpoint!r} is not an endpoint",
                              "Use tcp://host:port, ipc://path, or file://path of an endpoint file.")
        by_file = endpoint.startswith(FILE_SCHEME)
        if (server_key is None) != (key is None) and not (by_file and server_key is None):
            raise AuthError(Code.AUTH,
                            "server_key and key go together: the server's public key and one's own secret key",
                            "Give both, or neither; shearbus-ctl keygen makes a pair.")
        if key is not None and not by_file and not endpoint.startswith("tcp://"):
            raise AuthError(Code.AUTH, f"{endpoint} takes no keys: it is on this machine, where the user is known",
                            "Leave out server_key and key.")
        self.endpoint, self.name = endpoint, name
        self.connect_deadline, self.reply_deadline, self.retry_after = connect_deadline, reply_deadline, retry_after
        self.server_key = self.secret_key = self.public_key = None
        self._where, self._file_fault = endpoint, None  # the server for messages; why its endpoint file cannot be used
        self._connected_to = None  # endpoint to which the socket connects
        self._file_epoch = None  # epoch in the endpoint file when the socket was made
        if key is not None:
            self.server_key = None if server_key is None else key_in(server_key, False)
            self.secret_key = key_in(key, True)
            self.public_key = zmq.curve_public(self.secret_key)
        self._socket = self._monitor = None
        self._posted = None  # id of a request that was sent by post()
        self.recorder = None  # a Recorder that gets the frames of every exchange
        self._refusal, self._silent_failures = None, 0
        self._last_id = int.from_bytes(os.urandom(8), "little")

    def next_request_id(self):
        self._last_id = (self._last_id + 1) % 2**64 or 1
        return self._last_id

    def close(self):
        if self._socket is not None:
            self._socket.disable_monitor()
            self._socket.close()
            self._monitor.close()
            self._socket = self._posted = None

    def post(self, frames, request_id):
        """Sends `frames` if there is a connection. The call() with the same frames then waits for the reply, or sends
        them."""
        try:
            if self._socket is not None and self._send(frames):
                self._posted = request_id
        except BaseException:  # an interrupt between two frames
            self.close()
            raise

    def call(self, frames, request_id, deadline=None, verb=""):
        """Sends `frames` and returns the Reply to them; sends the same bytes again on a fresh socket after every
        `retry_after` without a reply. verb: name of the request's body.

        Raises the error of a refusal, Unreachable if the request was never sent, AuthError where the server refuses the
        connection, UnknownOutcome if the request was sent and no reply came before the deadline."""
        try:
            reply, raw = self._call(frames, request_id, deadline)
        except Error as fault:
            if self.recorder and fault.code == Code.UNKNOWN_OUTCOME:
                self.recorder.add(verb, frames)
            raise
        except BaseException:  # an interrupt: a late reply must not be taken for the reply to the next request
            self.close()
            raise
        if self.recorder:
            self.recorder.add(verb, frames, reply.header, raw)
        status = reply.header.status
        if status is None or status.code != Code.OK:
            raise _refusal_of(status)
        return reply

    def _call(self, frames, request_id, deadline):
        started = time.monotonic()
        self._report_at = started + REPORT_AFTER_S
        last_moment = started + (self.reply_deadline if deadline is None else deadline)
        sent = posted = self._posted == request_id
        self._posted = None
        while True:
            while self._socket is None and not self._connect():
                if self._refusal:
                    self._refused(sent)
                now = time.monotonic()
                if now >= last_moment:
                    self._give_up(sent, started)
                if now >= self._report_at:
                    log.warning("waiting for a server at %s: %s", self.endpoint, self._file_fault)
                    self._report_at = float("inf")
                time.sleep(FILE_PAUSE_S)
            if not posted and not self._send_until(frames, last_moment):
                if self._refusal:
                    self._refused(sent)
                if time.monotonic() >= last_moment:
                    self._give_up(sent, started)
                self.close()  # to connect to the server where it is now
                continue
            sent, posted = True, False
            received = self._receive(request_id, min(last_moment, time.monotonic() + self.retry_after), started)
            if received is not None:
                status = received[0].header.status
                if status is not None and status.code == Code.RECOVERING:
                    # The server is at work and answers when it has recovered: the deadline begins anew.
                    if time.monotonic() >= self._report_at:
                        log.warning("waiting for the server at %s: %s", self._where, status.text)
                        self._report_at = time.monotonic() + REPORT_AFTER_S
                    time.sleep(RECOVERY_PAUSE_S)
                    last_moment = time.monotonic() + (self.reply_deadline if deadline is None else deadline)
                    continue
                return received
            self.close()
            if self._refusal:
                self._refused(sent)
            if time.monotonic() >= last_moment:
                self._give_up(sent, started)

    def _find_server(self):
        """Returns the address of the server and its public key. An endpoint file is read before each new socket,
        because a restarted server may listen elsewhere; None, None where it cannot be used."""
        if not self.endpoint.startswith(FILE_SCHEME):
            return self.endpoint, self.server_key
        try:
            file = endpoint_in(self.endpoint.removeprefix(FILE_SCHEME))
        except ValueError as fault:
            self._file_fault = str(fault)
            return None, None
        self._file_fault, self._file_epoch = None, file.epoch
        self._where = f"{file.endpoint} (named by {self.endpoint}, written on {file.host})"
        if file.endpoint.startswith("ipc://"):
            if self.server_key:
                self._refusal = ("a server on this machine proves no key, and this client expects one",
                                 "Leave out server_key.")
            return file.endpoint, None
        server_key = self.server_key or file.server_key.encode()
        if server_key and not self.secret_key:
            self._refusal = ("the server expects clients with keys, and this one has none",
                             "Give key; shearbus-ctl keygen makes a pair of files.")
        elif self.secret_key and not server_key:
            self._refusal = ("the server has no keys, and this client has one to prove itself",
                             "Leave out key, or have the server started with --curve-secret.")
        return file.endpoint, server_key

    def _connect(self):
        """Makes a socket that connects to the server. Returns False if the endpoint file names no server to use."""
        self._refusal, self._frames_read = None, 0
        endpoint, server_key = self._find_server()
        if endpoint is None or self._refusal:
            return False
        self._proves_keys, self._connected_to = bool(server_key), endpoint
        path = endpoint.removeprefix("ipc://")
        if path != endpoint and os.path.exists(path) and not os.access(path, os.W_OK, effective_ids=True):
            raise AuthError(Code.AUTH, f"{self._where}: uid {os.geteuid()} may not connect there",
                            f"Run as the server's user, or have it started with --allow-uid {os.geteuid()}.")
        socket = zmq.Context.instance().socket(zmq.DEALER)
        try:
            for option, value in ((zmq.IMMEDIATE, 1), (zmq.LINGER, 0), (zmq.MAXMSGSIZE, MAX_PAYLOAD_BYTES),
                                  (zmq.RECONNECT_IVL, 100), (zmq.RECONNECT_IVL_MAX, 5000), (zmq.HANDSHAKE_IVL, 5000),
                                  (zmq.HEARTBEAT_IVL, 2000), (zmq.HEARTBEAT_TIMEOUT, 6000), (zmq.TCP_KEEPALIVE, 1),
                                  (zmq.IPV6, int(endpoint.startswith("tcp://["))), (zmq.RCVTIMEO, RECEIVE_MS)):
                socket.setsockopt(option, value)
            if server_key:
                socket.curve_serverkey, socket.curve_publickey = server_key, self.public_key
                socket.curve_secretkey = self.secret_key
            monitor = socket.get_monitor_socket(HANDSHAKES)
            socket.connect(endpoint)
        except zmq.ZMQError as fault:
            socket.close()
            raise Unreachable(Code.UNREACHABLE, f"{self._where}: {fault}", "Use tcp://host:port or ipc://path.")
        self._socket, self._monitor = socket, monitor
        self._incoming, self._outgoing = zmq.Poller(), zmq.Poller()
        self._incoming.register(socket, zmq.POLLIN)
        self._outgoing.register(socket, zmq.POLLOUT)
        for poller in (self._incoming, self._outgoing):
            poller.register(monitor, zmq.POLLIN)
        return True

    def _send_until(self, frames, last_moment):
        """Sends as soon as there is a connection. Returns False if `last_moment` passed first, if the server refused
        the connection, or if it was started again and its endpoint file names another address."""
        while not self._send(frames):
            look = last_moment if self._file_epoch is None else min(last_moment, time.monotonic() + FILE_LOOK_S)
            if not self._wait(self._outgoing, look) and (self._refusal or look == last_moment
                                                         or self._server_has_moved()):
                return False
        return True

    def _server_has_moved(self):
        with contextlib.suppress(ValueError):  # a server that has ended; the next one writes the file again
            return endpoint_in(self.endpoint.removeprefix(FILE_SCHEME)).epoch != self._file_epoch
        return False

    def _send(self, frames):
        """Sends without waiting. Returns False if there is no connection (yet)."""
        try:
            for frame in frames[:-1]:
                self._socket.send(frame, MORE, copy=False)
            self._socket.send(frames[-1], NOW, copy=False)
            return True
        except zmq.Again:
            return False

    def _wait(self, poller, until):
        """Waits for the socket. Returns False if `until` passed first, or if the server refused the connection."""
        while True:
            now = time.monotonic()
            if now >= self._report_at:
                log.warning("waiting for the server at %s", self._where)
                self._report_at = float("inf")
            left = max(min(until, self._report_at) - now, 0.0)
            found = poller.poll(int(left * 1000) + 1)
            if any(socket is self._socket for socket, _ in found):
                return True
            if found:
                self._read_handshakes()
            if self._refusal or time.monotonic() >= until:
                return False

    def _first_frame(self, until):
        """Waits for a message and returns its first frame. Returns None if `until` passed first, or if the server
        refused the connection."""
        if time.monotonic() + RECEIVE_MS / 1000 < min(until, self._report_at):
            with contextlib.suppress(zmq.Again):
                return self._socket.recv()  # without a poll, which costs as much as the rest of a small request
        return self._socket.recv(NOW) if self._wait(self._incoming, until) else None

    def _receive(self, request_id, until, started):
        """Waits for the reply to `request_id` and skips replies to earlier requests. Returns the Reply and its frames,
        or None if `until` passed first or the request must be sent again on a fresh socket.

        libzmq 4.3.4 aborts the process (fq.cpp:112) if it notices between two frames of a message that the connection
        is lost. While messages arrive it looks for that at every hundredth recv() of a socket, counted from the last
        recv() that found nothing. So each message is preceded by a recv() that finds nothing."""
        while self._frames_read <= FRAMES_BEFORE_LOOK:
            try:
                first = self._socket.recv(NOW)
            except zmq.Again:
                self._frames_read = 0
                first = self._first_frame(until)
                if first is None:
                    return None
            frames = []
            while self._socket.rcvmore and len(frames) < 2:
                frames.append(self._socket.recv(NOW, copy=False))
            self._frames_read += 1 + len(frames)
            received = time.monotonic()
            try:
                answer = header.REPLY_HEADER.decode(first)
                if answer.magic != header.MAGIC:
                    raise ValueError("it does not begin with the magic number of shearbus")
                payload = _checked_payload(answer.payload, frames)
            except (ValueError, IndexError) as fault:
                raise UnexpectedReply(Code.UNEXPECTED_REPLY, f"{self._where} sent what is no reply: {fault}",
                                      "Is it a shearbus server of this version?")
            refused = answer.status is not None and answer.status.code != Code.OK
            # A reply has the id 0 if the server could not read the id of the request.
            if answer.request_id == request_id or (answer.request_id == 0 and refused):
                return Reply(answer, payload, received - started), [first, *(frame.buffer for frame in frames)]
        return None

    def _read_handshakes(self):
        while True:
            try:
                event, _ = self._monitor.recv_multipart(zmq.DONTWAIT)
            except zmq.Again:
                return
            self._handshake(*struct.unpack("=HI", event[:6]))

    def _handshake(self, event, detail):
        """Keeps the reason of a failed handshake if a retry is useless."""
        keys = self._proves_keys
        uid = os.geteuid()
        failed = event == zmq.EVENT_HANDSHAKE_FAILED_PROTOCOL
        mismatch = failed and detail == zmq.PROTOCOL_ERROR_ZMTP_MECHANISM_MISMATCH
        undecipherable = failed and detail == zmq.PROTOCOL_ERROR_ZMTP_CRYPTOGRAPHIC
        if event == zmq.EVENT_HANDSHAKE_SUCCEEDED:
            self._silent_failures = 0
        elif event == zmq.EVENT_HANDSHAKE_FAILED_AUTH and keys:
            self._refusal = ("the server does not admit this client's key",
                             "Ask its operator to add this line to the file --authorized-keys: "
                             f"{self.public_key.decode()} {self.name}")
        elif event == zmq.EVENT_HANDSHAKE_FAILED_AUTH:
            self._refusal = (f"the server does not admit this client, of uid {uid}",
                             f"Run as the server's user, or have it started with --allow-uid {uid}.")
        elif mismatch and keys:
            self._refusal = ("the server has no keys, and this client expects it to prove that it is the right one",
                             "Leave out server_key and key, or have the server started with --curve-secret.")
        elif mismatch:
            self._refusal = ("the server expects clients with keys, and this one has none",
                             "Give server_key and key; shearbus-ctl keygen makes a pair of files.")
        elif keys:
            # A server that cannot decrypt the handshake, because it was encrypted for another key, sends no reason.
            self._silent_failures += event == zmq.EVENT_HANDSHAKE_FAILED_NO_DETAIL
            if undecipherable or self._silent_failures >= SILENT_FAILURES:
                self._refusal = (
                    "the connection is broken off in the handshake: the server has no keys, or not the secret one to "
                    "server_key", "Take the server's public key from the line it logs at its start.")

    def _refused(self, sent):
        text, remedy = self._refusal
        self.close()
        if not sent:
            raise AuthError(Code.AUTH, f"{self._where}: {text}", remedy)
        raise UnknownOutcome(
            Code.UNKNOWN_OUTCOME, f"{self._where}: {text}; the request had been sent before, and may or may not "
            "have run", remedy)

    def _give_up(self, sent, started):
        waited = time.monotonic() - started
        if not sent and self._file_fault:
            raise Unreachable(Code.UNREACHABLE,
                              f"no endpoint file of a server within {waited:.1f} s: {self._file_fault}",
                              "Is a server running? It writes the file when it listens: shearbus-server "
                              "--endpoint-file FILE, for clients with file://FILE.")
        if not sent and (fault := _fault_of_host_name(self._connected_to or "")):
            raise Unreachable(Code.UNREACHABLE, f"no server was found at {self._where} within {waited:.1f} s: {fault}",
                              "Write the address of the server's machine, or a name that \"getent ahostsv4 NAME\" "
                              "knows here.")
        if not sent:
            raise Unreachable(Code.UNREACHABLE, f"no server answered at {self._where} within {waited:.1f} s",
                              "A server that is killed leaves its file behind: start it again, or remove the file."
                              if self.endpoint.startswith(FILE_SCHEME) else
                              f"Is one running? Start it with: shearbus-server --bind {self._where}")
        raise UnknownOutcome(
            Code.UNKNOWN_OUTCOME, f"{self._where} did not answer within {waited:.1f} s; the request may or may not "
            "have run", "Make the same call again: if it has run, it is not run a second time.")


def _fault_of_host_name(endpoint):
    """Looks up the name in tcp://NAME:PORT, which may take seconds. Returns why no connection can be made to it: it is
    not known, or has IPv6 addresses alone, which libzmq reaches only by their numbers. None for any other endpoint."""
    host, _, port = endpoint.removeprefix("tcp://").rpartition(":")
    if not endpoint.startswith("tcp://") or not host or host.startswith("["):
        return None
    try:
        addresses = socket_library.getaddrinfo(host, None, type=socket_library.SOCK_STREAM)
    except (OSError, UnicodeError) as fault:
        return f"the host name \"{host}\" does not resolve: {getattr(fault, 'strerror', None) or fault}"
    if any(family == socket_library.AF_INET for family, *_ in addresses):
        return None
    return (f"the host \"{host}\" has IPv6 addresses alone, which are reached by their numbers: "
            f"tcp://[{addresses[0][4][0]}]:{port}")


def _checked_payload(declared, frames):
    """Returns a view of the payload frame after comparing it with its declaration in the header."""
    if len(frames) != (declared is not None):
        raise ValueError(f"{len(frames)} payload frames, the header declares {int(declared is not None)}")
    if declared is None:
        return None
    view = frames[0].buffer if len(frames[0]) > SMALL_BYTES else frames[0].bytes
    if len(view) != declared.size_bytes or xxh3(view) != declared.xxh3:
        raise ValueError("the payload has another size or checksum than its header says")
    if declared.columns.end > len(view):
        raise ValueError("a column does not lie in the payload")
    return view


def _refusal_of(status):
    if status is None:
        return UnexpectedReply(Code.UNEXPECTED_REPLY, "a reply without a status",
                               "Is it a shearbus server of this version?")
    return error(status.code, status.text, status.remedy, status.field, status.node_ids, status.last_sequence)
