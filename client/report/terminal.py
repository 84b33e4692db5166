"""What Python programs read from a command line and from files of strangers, and what they write to a terminal. Numbers
have the rule of all programs (proto/wire/numbers.hpp); texts of strangers (names in files, names of files) are without
commands to the terminal; a file is regular, and what it nests has an end."""
import argparse
import atexit
import contextlib
import errno
import json
import math
import os
import re
import signal
import stat
import sys
import threading
import tomllib

# Control characters, separators of lines, and characters that change the direction of the text around them.
COMMANDS = re.compile("[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")
NAMES = {"\n": "\\n", "\t": "\\t", "\r": "\\r"}
MOST = 16384  # characters
MOST_DIGITS = 100  # characters of a number
MOST_BYTES = 1 << 30  # of a file of text
REAL = re.compile(r"(?:\+|-)?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?")


def printable(text):
    """Returns the text with commands escaped, as \\n or \\x1b; a byte of no character (as of a file's name) as \\xff."""
    def escaped(match):
        code = ord(match[0])
        if 0xDC80 <= code <= 0xDCFF:  # how Python writes an invalid byte
            code -= 0xDC00
        return NAMES.get(match[0]) or (f"\\x{code:02x}" if code < 0x100 else f"\\u{{{code:04x}}}")
    text = COMMANDS.sub(escaped, str(text))
    return text if len(text) <= MOST else text[:MOST - 3] + "..."


def printable_lines(text):
    """Returns a text of several lines, each of them printable."""
    return "\n".join(map(printable, str(text).split("\n")))


def complain(program, fault):
    """Prints what has ended a program to standard error: one line, or the list of a scene's faults."""
    if isinstance(fault, OSError) and fault.filename is not None and fault.strerror:
        fault = f"{fault.filename}: {fault.strerror}"
    several = getattr(getattr(fault, "code", None), "name", None) == "INVALID_SCENE"
    print((printable_lines if several else printable)(f"{program}: {fault}"), file=sys.stderr)


def end_with(main, *faults):
    """Ends the program with what main() returns; a fault of its input is one line and exit code 1."""
    try:
        sys.exit(main())
    except faults as fault:
        if is_of_output(fault):
            end_unwritten(fault)
        complain(os.path.basename(sys.argv[0]), fault)
        sys.exit(1)


def flush():
    """Ends the program in one line, with exit code 1, if what it printed cannot be written."""
    try:
        sys.stdout.flush()
    except OSError as fault:
        end_unwritten(fault)


def is_of_output(fault):
    """Whether what was printed could not be written: the standard output is full or has no reader."""
    return isinstance(fault, OSError) and fault.filename is None and fault.errno in (errno.EPIPE, errno.ENOSPC, errno.EFBIG)


def end_unwritten(fault):
    complain(os.path.basename(sys.argv[0]), f"standard output could not be written: {fault.strerror}")
    os._exit(1)  # Python would try once more, and say so


def end_by_signals():
    """An interrupt or a reader that has gone ends the program without a word of Python's."""
    for number in (signal.SIGINT, signal.SIGPIPE):
        signal.signal(number, signal.SIG_DFL)


def say_interrupted():
    print(f"{printable(os.path.basename(sys.argv[0]))}: interrupted", file=sys.stderr, flush=True)


def end_at_once(number, frame):
    """Handler of an interrupt that has nothing to clean up: while libraries load, some of them turn every exception into
    a text of their own."""
    say_interrupted()
    signal.signal(number, signal.SIG_DFL)
    os.kill(os.getpid(), number)


def exchange_handlers(old, new):
    """Changes what an interrupt does, unless it is ignored or something else was chosen."""
    if threading.current_thread() is threading.main_thread() and signal.getsignal(signal.SIGINT) is old:
        signal.signal(signal.SIGINT, new)


@contextlib.contextmanager
def nothing_to_clean_up():
    exchange_handlers(signal.default_int_handler, end_at_once)
    try:
        yield
    finally:
        exchange_handlers(end_at_once, signal.default_int_handler)


def tell_fault(kind, fault, trace):
    """In place of sys.excepthook: an interrupt gets one line, after which Python exits by the signal, and so does a
    standard output that is full or has no reader."""
    if issubclass(kind, KeyboardInterrupt):
        say_interrupted()
    elif is_of_output(fault):
        end_unwritten(fault)
    else:
        sys.__excepthook__(kind, fault, trace)


def tell_ignored(unraisable):
    """In place of sys.unraisablehook: Python loses an interrupt that comes where it ignores every exception, for instance
    between fork and exec. It is sent once more, from outside."""
    if unraisable.exc_type is KeyboardInterrupt:
        threading.Timer(0.01, os.kill, (os.getpid(), signal.SIGINT)).start()
    else:
        sys.__unraisablehook__(unraisable)


def open_regular(path, most=MOST_BYTES):
    """Opens a regular file of at most so many bytes. Raises OSError or ValueError; a pipe is not waited for."""
    number = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_NOCTTY)
    found = os.fstat(number)
    if stat.S_ISREG(found.st_mode) and found.st_size <= most:
        return open(number, "rb")
    os.close(number)
    raise ValueError(f"has {found.st_size} bytes, at most {most} are read" if stat.S_ISREG(found.st_mode) else "is no regular file")


def read_text(path):
    """Returns the text of a regular file, in UTF-8. Raises OSError or ValueError."""
    with open_regular(path) as file:
        return file.read().decode("utf-8-sig")


def _of_text(parse, text):
    try:
        return parse(text)
    except RecursionError:
        raise ValueError("is nested too deep") from None


def read_json(path):
    """Returns what a file of JSON holds. Raises OSError or ValueError."""
    return _of_text(json.loads, read_text(path))


def read_toml(text):
    """Returns what a text of TOML holds. Raises ValueError."""
    return _of_text(tomllib.loads, text)


def refuse(expected, text):
    found = printable(text[:60])
    raise argparse.ArgumentTypeError(f'expected {expected}, found "{found}"')


def whole_number(text, least=0):
    """An id or a count of a command line: digits alone, up to 2^64 - 1."""
    if not (text.isascii() and text.isdigit() and len(text) <= MOST_DIGITS and least <= int(text) < 2**64):
        refuse(f"a whole number from {least} to 2^64 - 1, of digits alone", text)
    return int(text)


def positive_count(text):
    return whole_number(text, 1)


def real_number(text):
    """A finite number of a command line."""
    value = float(text) if len(text) <= MOST_DIGITS and REAL.fullmatch(text) else math.nan
    if not math.isfinite(value):
        refuse("a finite number such as 0.25 or 4e-6", text)
    return value


def positive_number(text):
    value = real_number(text)
    if not value > 0:
        refuse("a finite number above 0", text)
    return value


def positive_numbers(text):
    """Several numbers with commas between them."""
    return [positive_number(word) for word in text.split(",")]


class Help(argparse.RawDescriptionHelpFormatter):
    def add_usage(self, usage, actions, groups, prefix=None):
        super().add_usage(usage, actions, groups, "Usage: ")


class Parser(argparse.ArgumentParser):
    """The command line of a program whose description is printed as it stands; a fault of it is one line of text."""

    def __init__(self, **options):
        sys.excepthook, sys.unraisablehook = tell_fault, tell_ignored
        atexit.register(flush)
        super().__init__(**{"formatter_class": Help, "allow_abbrev": False, **options})

    def parse_args(self, *arguments, **options):
        exchange_handlers(end_at_once, signal.default_int_handler)
        return super().parse_args(*arguments, **options)

    def error(self, message):
        complain(self.prog, message)
        self.exit(2, f"Run {self.prog} --help for its options.\n")
