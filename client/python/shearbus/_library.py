"""libshearbus: where it is, its structs and functions (client/include/shearbus/shearbus.h), and its faults as exceptions."""
import atexit
import ctypes
import functools
import glob
import logging
import os
import pathlib
import re
import sys
import threading
import time
import warnings
import weakref

from ._contract import FUNCTIONS
from .columns import COLUMNS
from .errors import ClosureWarning, Code, LibraryError, error

NAME = "libshearbus.so.1"
VERSION = "0.1.0"
VARIABLE = "SHEARBUS_LIBRARY"
PACKAGE = pathlib.Path(__file__).resolve().parent
REMEDY = (f"Build it (deploy/run), install it (cmake --install build), or name the file in the environment variable {VARIABLE}.")
ENDING_S = 5.0  # longest time that a call may take to end with the interpreter
APPENDED = 2**31 - 1  # a place behind all lines of a list

log = logging.getLogger("shearbus")


class _Unconfigured(logging.Handler):
    """Prints lines of the library as it does itself, where the host has configured no logging."""

    def emit(self, record):
        if not logging.getLogger().handlers and log.handlers == [self]:
            print(f"shearbus: {record.getMessage()}", file=sys.stderr)


log.addHandler(_Unconfigured(logging.WARNING))

Size, Double, Text, Address = ctypes.c_size_t, ctypes.c_double, ctypes.c_char_p, ctypes.c_void_p
Number, Word, Whole = ctypes.c_uint64, ctypes.c_uint32, ctypes.c_int
Log = ctypes.CFUNCTYPE(None, Address, Text)
Interrupted = ctypes.CFUNCTYPE(Whole, Address)
Fallback = ctypes.CFUNCTYPE(Whole, Address, Address)


class _Struct(ctypes.Structure):
    """A struct of the header whose first member is its size."""

    def __init__(self, **members):
        super().__init__(ctypes.sizeof(self), **members)


def _struct(name, rows):
    """Returns a class for a struct: rows of a type and names with spaces between them."""
    fields = [(member, kind) for kind, names in rows for member in names.split()]
    first = fields[0][0] == "size"
    return type(name, (_Struct if first else ctypes.Structure,), {"_fields_": fields, "__doc__": f"struct {name}."})


Status = _struct("shearbus_status", [(Size, "size"), (Whole, "code n_nodes"), (Number * 16, "nodes"), (ctypes.c_char * 64, "field"),
                                     (ctypes.c_char * 512, "remedy"), (ctypes.c_char * 2048, "text")])
Column = _struct("shearbus_column", [(Word, "field component"), (Address, "values"), (ctypes.c_ssize_t, "stride_bytes")])
Options = _struct("shearbus_options", [
    (Size, "size"), (Text, "endpoint scene_file scene_text domain name server_key_file secret_key_file"),
    (Double, "connect_deadline_s reply_deadline_s retry_after_s"), (Log, "log"), (Address, "log_user"), (Text, "state_dir"),
    (Word, "threads"), (Whole, "check_closure"), (Number, "idle_limit_s"), (Interrupted, "interrupted"),
    (Address, "interrupted_user"), (Text, "scene_name"), (Whole, "ignore_environment")])
Nodes = _struct("shearbus_nodes", [
    (Size, "size n"), (Address, "node_ids initial_temperature_k"), (Size, "n_pairs"), (ctypes.POINTER(Text), "pairs"),
    (Address, "pair"), (Size, "n_parameters"), (ctypes.POINTER(Text), "parameters"), (ctypes.POINTER(Address), "values")])
Request = _struct("shearbus_request", [
    (Size, "size"), (Double, "dt_s time_s"), (Number, "step"), (Word, "attempt"),
    (Whole, "mode commit_previous all_or_nothing"), (Size, "n"), (Address, "node_ids"), (ctypes.POINTER(Column), "inputs"),
    (Size, "n_inputs"), (ctypes.POINTER(Column), "outputs"), (Size, "n_outputs"), (Whole, "open_absent")])
Result = _struct("shearbus_result", [
    (Size, "size"), (Number, "nodes flagged_nodes state_version solver_ns service_ns round_trip_ns"),
    (Double, "largest_closure_m_per_s"), (Number, "closure_node"), (Double, "layer_time_s"), (Whole, "replayed")])
Info = _struct("shearbus_info", [
    (Size, "size"), (Whole, "strategy"), (Word, "tangential_components"), (Number, "bytes_per_node last_sequence"),
    (Whole, "outlives_server"), (Number, "state_version max_rows_per_message max_marks")])
Fallbacks = _struct("shearbus_fallbacks", [(Size, "size"), (Number, "steps node_steps"), (Double, "time_s"), (Number, "absences"),
                                           (Whole, "allowed")])
Totals = _struct("shearbus_totals", [(Size, "size"), (Number, "requests node_steps solver_ns asleep_node_steps")])


def places():
    """Yields the files that may be the library, most wanted first: that of the environment alone, if it names one; in the
    package, as a wheel has it; of a build of the source tree around the package; of the installation that has the package;
    of the system's loader."""
    if named := os.environ.get(VARIABLE):
        yield pathlib.Path(named, NAME) if os.path.isdir(named) else named
        return
    yield PACKAGE / NAME
    root = PACKAGE.parents[2]
    if (root / "client/include/shearbus/shearbus.h").exists():
        yield root / "build/lib" / NAME
    prefix = PACKAGE.parents[3]  # of PREFIX/lib/python3/dist-packages/shearbus
    yield from (pathlib.Path(found) for lib in ("lib", "lib64", "lib/*-linux-gnu*")
                for found in sorted(glob.glob(f"{glob.escape(str(prefix))}/{lib}/{NAME}")))
    yield NAME


@functools.cache
def library():
    """Returns the library, loaded once. Raises LibraryError where there is none, or one of another version."""
    for place in places():
        if isinstance(place, pathlib.Path) and not place.exists() and not os.environ.get(VARIABLE):
            continue
        try:
            loaded = ctypes.CDLL(os.fspath(place))
        except OSError as fault:
            raise LibraryError(Code.LIBRARY_FAULT, f"the library of the Python client cannot be loaded: {fault}", REMEDY) from None
        kinds = {"": None, "Size": Size, "Double": Double, "Text": Text, "Address": Address, "Whole": Whole, "Word": Word}
        for name, result, arguments in FUNCTIONS:
            function = getattr(loaded, f"shearbus_{name}", None)
            if function is None:
                why = f"is older than this package, {VERSION}" if hasattr(loaded, "shearbus_version") else "is another library"
                raise LibraryError(Code.LIBRARY_FAULT, f"{place} has no shearbus_{name}: it {why}", REMEDY)
            function.restype, function.argtypes = kinds[result], [kinds[kind] for kind in arguments.split()]
        if (version := loaded.shearbus_version().decode()) != VERSION:
            raise LibraryError(Code.LIBRARY_FAULT, f"{place} is version {version}, and this package is {VERSION}",
                               "Install both from one build.")
        return loaded
    raise AssertionError("the last place is the loader's")


def address(array):
    """Returns the address of an array's values."""
    return array.__array_interface__["data"][0]


def texts(values):
    """Returns an array of C texts."""
    return (Text * len(values))(*(value.encode() for value in values))


_hosts, _ending = weakref.WeakSet(), []
os.register_at_fork(after_in_child=_hosts.clear)


@atexit.register
def _end_calls():
    """Ends the calls that wait in daemon threads: without an interpreter they could not call back."""
    _ending.append(True)
    until = time.monotonic() + ENDING_S
    for host in list(_hosts):
        in_call = host.turn.locked()
        if host.turn.acquire(timeout=max(0.0, until - time.monotonic())) and not in_call:
            host.turn.release()  # other turns stay taken, for a daemon thread that makes its call again


class Host:
    """What the library calls back while a call waits: it takes the lines that the library says, and ends the call where a
    signal's handler, such as that of Ctrl-C, raises an exception. Neither callback begins in Python code, in whose first
    instruction a handler would run and its exception be lost: the one is the list's own insert(), the other resumes a
    generator inside of its `try`."""

    def __init__(self):
        self.lines, self.raised, self.turn = [], [], threading.Lock()  # turn: held during a call
        _hosts.add(self)
        waiting = self._wait(self.lines, self.raised)
        next(waiting)
        self.log, self.interrupted = Log(self.lines.insert), Interrupted(functools.partial(next, waiting))

    @staticmethod
    def _wait(lines, raised):
        while True:
            try:
                while True:
                    yield bool(raised or _ending)
                    for line in [line for line in lines if not line.startswith(b"warning: ")]:
                        lines.remove(line)
                        say(line)
            except GeneratorExit:
                return
            except BaseException as fault:  # raised when the call has ended, without this frame: who clears it ends the generator
                raised.append(fault.with_traceback(fault.__traceback__.tb_next))

    def give_to(self, options):
        options.log, options.log_user, options.interrupted = self.log, APPENDED, self.interrupted

    def after_call(self, opening=False):
        """Raises what a signal's handler has raised, and passes on the lines of a call."""
        lines = self.lines[:]
        self.lines.clear()
        if self.raised:
            fault = self.raised[0]
            self.raised.clear()
            raise fault
        for line in lines:
            text = line.decode(errors="replace")
            if text.startswith("warning: ") and not opening:
                warn(in_python(text.removeprefix("warning: ")), ClosureWarning)
            elif not text.startswith("warning: "):  # those of an opening come as SceneWarning
                say(line)


def say(line):
    level = logging.INFO if line.startswith((b"session of ", b"note: ")) else logging.WARNING
    log.log(level, "%s", line.decode(errors="replace"))


def warn(text, kind):
    """Warns at the line outside of this package that made the call."""
    frame, level = sys._getframe(1), 2
    while frame.f_back is not None and pathlib.Path(frame.f_code.co_filename).parent == pathlib.Path(__file__).parent:
        frame, level = frame.f_back, level + 1
    warnings.warn(text, kind, stacklevel=level)


# Names of the library and of the protocol -> those of a Python host. A name behind a dot is a key of the scene.
_OWN = {**{column.wire_name: column.name for column in COLUMNS}, **{column.quantity: column.name for column in COLUMNS},
        "dt_s": "dt", "time_s": "time", "scene_text": "scene"}
_NAMES = re.compile(rf"(?<![\w.])({'|'.join(sorted(map(re.escape, _OWN), key=len, reverse=True))})(?!\w|\.\w)")


def in_python(text):
    """Names things as a Python host does."""
    return _NAMES.sub(lambda found: _OWN[found[0]], text)


def fault_of(status):
    """Returns the exception of a status."""
    text, whole = status.text, library().shearbus_fault_text()
    if text.endswith(b"...") and whole.startswith(text[:-3]):  # of a long one the status has the beginning
        text = whole
    words = [in_python(word.decode(errors="replace")) for word in (text, status.remedy, status.field)]
    return error(status.code, *words, status.nodes[:status.n_nodes])
