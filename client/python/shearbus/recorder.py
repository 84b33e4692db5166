"""Writes the exchanges of a session to an event log (proto/wire/event_log.md)."""
import fcntl
import logging
import os
import pathlib
import struct
import time

from .checksum import xxh3

MAGIC, VERSION, CLIENT = b"SHBEVLG\n", 1, 2
HEAD, RECORD, SUM = struct.Struct("<8sII16sQIIQ"), struct.Struct("<QQ4I"), struct.Struct("<Q")
RECORDED = frozenset(("open_session", "downscale", "commit", "rollback", "close_session", "resume_session", "mark",
                      "register_nodes", "retire_nodes", "offer_nodes", "accept_nodes"))

log = logging.getLogger("shearbus")


def _summed(part):
    return part + SUM.pack(xxh3(part) or 1)


def _sum_of(parts):
    seed = 0
    for part in parts:
        seed = xxh3(part, seed)
    return SUM.pack(seed or 1)


class Recorder:
    """Records the session of one connection. place: a directory (it exists or ends with "/"), which gets a file
    session-ID.log, or the name of a new file. A fault ends the recording with one line of the log; it is no error of
    the session."""

    def __init__(self, place):
        self._place, self._file, self._ended = place, None, False
        self._bytes = self._index = self._ns = 0

    def add(self, verb, request, answer=None, reply=()):
        """Appends an exchange. verb: name of the request's body; request, reply: their frames; answer: the decoded
        reply header, None if no reply came."""
        if self._ended or verb not in RECORDED:
            return
        try:
            if self._file is None and not self._begin(verb, answer):
                return
            frames = [*request, *[b""] * (2 - len(request)), *reply, *[b""] * (2 - len(reply))]
            self._ns = max(self._ns + 1, time.time_ns())
            parts = [_summed(RECORD.pack(self._index, self._ns, *map(len, frames))), *frames]
            self._write([*parts, _sum_of(parts)])
            self._index += 1
            if verb == "close_session" and answer is not None and answer.session_closed is not None:
                os.fdatasync(self._file)
                self.close()
        except (OSError, ValueError, struct.error, MemoryError) as fault:
            log.warning("the session is not recorded any further: %s", fault)
            self.close()

    def close(self):
        """Ends the recording."""
        self._ended = True
        if self._file is not None:
            os.close(self._file)
            self._file = None

    def __del__(self):
        self.close()

    def _begin(self, verb, answer):
        """Makes the log of an accepted opening, or continues that of a resumed session. Returns whether there is one."""
        opened = getattr(answer, "session_opened", None)
        if opened is None and getattr(answer, "session_resumed", None) is None:
            return False
        in_directory = self._place.endswith("/") or os.path.isdir(self._place)
        path = pathlib.Path(self._place)
        if in_directory:
            path.mkdir(mode=0o700, exist_ok=True)
            path /= f"session-{answer.session_id[:8].hex()}.log"
        if in_directory and path.exists():
            self._continue(path, answer.session_id)
        elif opened is None:
            raise ValueError("it was opened before the recording began")
        else:
            self._file = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC | os.O_NOFOLLOW, 0o600)
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            scene = opened.effective_scene.encode()
            self._write([_summed(HEAD.pack(MAGIC, VERSION, HEAD.size + SUM.size, answer.session_id, time.time_ns(),
                                           CLIENT, len(scene), xxh3(scene))), scene])
        return True

    def _continue(self, path, session_id):
        self._file = os.open(path, os.O_WRONLY | os.O_CLOEXEC | os.O_NOFOLLOW)
        fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)  # no other recorder writes to it
        data = path.read_bytes()
        if data[:8] != MAGIC or data[16:32] != session_id or HEAD.unpack_from(data)[1] != VERSION:
            raise ValueError(f"{path} is not the log of this session")
        end = HEAD.size + SUM.size + HEAD.unpack_from(data)[6]
        while len(data) - end >= RECORD.size + SUM.size and any(data[end:end + RECORD.size]):
            index, self._ns, *lengths = RECORD.unpack_from(data, end)
            after = end + RECORD.size + SUM.size + sum(lengths) + SUM.size
            if data[end:end + RECORD.size + SUM.size] != _summed(data[end:end + RECORD.size]) or index != self._index:
                raise ValueError(f"{path} is damaged at byte {end}")
            if after > len(data) or not any(data[after - SUM.size:after]):
                break
            end, self._index = after, index + 1
        self._bytes = end
        os.ftruncate(self._file, end)
        os.lseek(self._file, end, os.SEEK_SET)

    def _write(self, parts):
        """Appends `parts`; what was written of an incomplete record is removed again."""
        data = b"".join(parts)
        try:
            written = 0
            while written < len(data):
                written += os.write(self._file, memoryview(data)[written:])
        except OSError:
            os.ftruncate(self._file, self._bytes)
            raise
        self._bytes += len(data)
