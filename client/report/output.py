"""Files that the programs of this directory write: under a name of their own until they are whole, in place of older
files of their kind only, and never in place of an input. The twin of proto/files/whole_file.hpp."""
import contextlib
import os
import pathlib
import stat
import tempfile

PICTURE = ("a picture (PNG)", lambda head: head.startswith(b"\x89PNG\r\n\x1a\n"))
PAGE = ("a report of shearbus", lambda head: b"report of shearbus</title>" in head)


class Refused(OSError):
    """An output that is not written. Its text says what is there and what to do."""


def refuse_inputs(out, inputs):
    """Raises Refused if the output is one of the inputs, by device and inode."""
    for file in inputs:
        with contextlib.suppress(FileNotFoundError, NotADirectoryError):
            if os.path.samefile(file, out):
                raise Refused(f"{out}: is an input, {file}; name another file")


def target(out):
    """Returns the file that is written: what a symbolic link points to, unless it is another user's in a directory that
    others can write to, which is refused."""
    at = pathlib.Path(out)
    for _ in range(40):
        if not at.is_symlink():
            return at
        around = os.stat(at.parent)
        shared = around.st_uid not in (os.geteuid(), 0) or around.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
        if os.lstat(at).st_uid != os.geteuid() and shared:
            raise Refused(f"{out}: is a symbolic link of user {os.lstat(at).st_uid} in a directory that others can write to; remove it")
        at = at.parent / os.readlink(at)
    raise Refused(f"{out}: too many symbolic links")


def check(out, kind):
    """Raises Refused unless the output is absent, empty, or an older file of its kind. Returns the file to write."""
    file = target(out)
    if not file.parent.is_dir():
        raise Refused(f"{out}: there is no directory {file.parent}")
    if not os.path.lexists(file):
        return file
    if not stat.S_ISREG(os.lstat(file).st_mode):
        raise Refused(f"{out}: is no regular file; name another file")
    with open(file, "rb") as opened:
        head = opened.read(65536)
    if head and not kind[1](head):
        raise Refused(f"{out}: is there and is not {kind[0]}; no other file is replaced. Remove or rename it, or write elsewhere")
    return file


def prepare(directory, kinds):
    """Makes the directory, and raises Refused if a file of one of these kinds could not be written there."""
    try:
        directory.mkdir(parents=True, exist_ok=True)
    except OSError as fault:
        raise Refused(f"{directory}: cannot be made: {fault.strerror}; write elsewhere") from None
    for name, kind in kinds.items():
        check(directory / name, kind)


def write(out, kind, contents, inputs=()):
    """Writes bytes to a file as a whole; raises OSError, and then leaves no partial file."""
    refuse_inputs(out, inputs)
    file = check(out, kind)
    number, partial = tempfile.mkstemp(prefix=f"{file.name}.", suffix=".partial", dir=file.parent)
    try:
        with os.fdopen(number, "wb") as opened:
            opened.write(contents)
            mask = os.umask(0)
            os.umask(mask)
            os.fchmod(opened.fileno(), 0o666 & ~mask)
            opened.flush()
            os.fsync(opened.fileno())
        os.replace(partial, file)
    except BaseException as fault:
        with contextlib.suppress(OSError):
            os.unlink(partial)
        if isinstance(fault, OSError):
            raise Refused(f"{out}: cannot be written: {fault.strerror}; no file is left") from None
        raise
