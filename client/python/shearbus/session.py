"""A session: the shear layers of a set of interface nodes on a server, and the calls that step, move and keep them. The
library libshearbus makes the calls (client/include/shearbus/shearbus.h)."""
import contextlib
import ctypes
import dataclasses
import functools
import inspect
import os
import re
import types
import weakref

import numpy

from . import _library, _values
from ._contract import STRATEGY
from ._fallback import callback
from ._plan import Plan
from ._values import count, frozen, given_nodes, node_ids, number
from .answer import Answer, Profiles, Trial, html_table
from .columns import BY_NAME, BY_NUMBER, FAR_FIELD_FORM, LEDGER, PROFILE, STICK_FORM
from .errors import (Code, ContentError, Error, MessageError, SceneWarning, SessionError, UnknownOutcome, Unreachable, WrongType,
                     WrongValue)
from .history import History
from .scene import scene_of

__all__ = ["Session", "Welcome", "open", "resume"]

ADVANCE, TRIAL = 0, 1  # shearbus_request.mode
ABSENT_NODES = {"keep": 0, "open": 1}
OPTIONS = {"nodes": None, "want": None, "absent_nodes": "keep", "time": 0.0, "step": 0, "attempt": 0, "commit_previous": False,
           "all_or_nothing": False}  # of a step
PLAIN = list(OPTIONS.values())  # those of a step that names none
CHECKS = {"warn": 0, "off": 1, "error": 2}
SCENE_NAME, PAIR_NAMES, PARAMETER_KEYS, MARK_NAMES, SERVER_VERSION, CAPABILITIES, DURABILITY, ACCESS = range(8)  # shearbus_text()
TICKET_BYTES, TRANSFER_BYTES = 80, 16
TICKET = re.compile("[0-9a-f]{32}:[0-9a-f]{32}")
IN_DOUBT = (Code.UNKNOWN_OUTCOME, Code.NO_MEMORY)

_doubted = {}  # an opening whose outcome is unknown: its contents -> handle and host


def _suggesting(function):
    """Refuses keywords that a function does not have by the name that was probably meant."""
    known = tuple(inspect.signature(function).parameters)

    @functools.wraps(function)
    def call(*arguments, **keywords):
        for name in keywords:
            if name not in known:
                raise WrongType(Code.SHAPE, f"{function.__name__}() has no argument {name!r}{_values.similar(name, known)}",
                                f"It has {', '.join(known)}.", name)
        return function(*arguments, **keywords)
    return call


@_suggesting
def open(scene, nodes=(), endpoint=None, *, initial_temperature=None, pair=None, parameters=None, domain="", want=(),
         record=False, check_closure="warn", idle_limit=0, name="shearbus-python", server_key_file=None, secret_key_file=None,
         connect_deadline=None, reply_deadline=None, retry_after=None, state_dir=None, threads=None):
    """Opens a session: one shear layer for each node. Returns a Session, which is a context manager.

    scene: path of a TOML file, TOML text (anything with a line break), or a dict. nodes: distinct whole numbers from 0
    on; none only in a domain. endpoint: tcp://host:port, ipc://path, or file://path of a server's endpoint file; several
    with commas between them, or file://path of a directory of endpoint files, divide the nodes over several servers
    (proto/WIRE.md, "Several servers"); None is a server in this process, which ends with the session.
    initial_temperature (K): a number or an array (N,), or None for the scene's. pair: name of a table [pair.NAME] of the
    scene for all nodes, or a list of one name per node, "" for the tables outside; None takes these for all nodes.
    parameters: a dict of number-valued keys of the scene, as "interface.friction_coefficient", with a number or an array
    (N,) each, by which the nodes differ, so that an ensemble is one session. domain: sessions of a domain share their
    node ids, and nodes move between them. want: names of columns that every reply shall have in addition ("ledger" stands
    for the energy ledger). record: True keeps a History. check_closure: what a force-driven host meets whose jump is not the
    jump that its last step answered: "warn" (a ClosureWarning, in the first 100 steps with the likely mistake), "error" (of any step, a
    ClosureError before it is sent) or "off", for hosts whose jump has other changes, too, as where an interface turns.
    idle_limit (s): the server closes the session after so long without a request; 0 is never. name: of this host, for the
    server's log. server_key_file and secret_key_file: files of the server's public and the client's secret key, for tcp.
    connect_deadline (s): of connecting and the first exchange, 5. reply_deadline (s): of every call, retries included,
    60. retry_after (s): time after which a request is sent again, 5. state_dir: directory of states that outlive the
    server in this process. threads: number of threads in it that solve layers, 1.

    The environment variables SHEARBUS_ENDPOINT, SHEARBUS_SCENE and SHEARBUS_SECRET_KEY_FILE (paths) replace endpoint,
    scene and key; SHEARBUS_RECORD, a directory (DIR/) or a new file, gets an event log of the session
    (proto/files/event_log.md). Doubts of the server are a SceneWarning each. Raises an Error."""
    ids = node_ids(nodes)
    given = given_nodes(ids, initial_temperature, pair, parameters)
    options = _options(endpoint, check_closure, name, server_key_file, secret_key_file, connect_deadline, reply_deadline, retry_after,
                       state_dir, threads, domain=_values.text("domain", domain), idle_limit_s=count("idle_limit", idle_limit),
                       **scene_of(scene))
    wanted = _words(want)
    contents = (*(getattr(options, name) for name, kind in options._fields_ if kind in (_library.Text, ctypes.c_uint64)),
                *(array.tobytes() for array in given.kept), str(pair), tuple(parameters or ()))
    handle, host = _doubted.pop(contents, None) or (_library.Address(), _library.Host())
    host.give_to(options)
    status = _library.Status()
    with host.turn:
        code = _library.library().shearbus_open_nodes(ctypes.byref(handle), ctypes.byref(options), ctypes.byref(given),
                                                      ctypes.byref(status))
    if code in IN_DOUBT and handle:  # the same arguments again are the same session, opened once
        _doubted[contents] = handle, host
    host.after_call(opening=True)
    if code:
        raise _library.fault_of(status)
    session = Session(handle, host, options, wanted, record)
    session._note(History._registered, ids, initial_temperature, pair, parameters)
    return session


@_suggesting
def resume(ticket, endpoint=None, *, nodes=None, pair=None, parameters=None, want=(), record=False, check_closure="warn",
           name="shearbus-python", server_key_file=None, secret_key_file=None, connect_deadline=None, reply_deadline=None,
           retry_after=None, state_dir=None, threads=None):
    """Continues the session of a client that has ended. ticket: Session.ticket of that client; the other arguments are
    those of open(). The session keeps the scene with which it was opened; a closed one cannot be resumed. nodes, pair,
    parameters: what the host takes its nodes for, as in open(); where they are given and not those of the session, the call
    is refused (RESUME_REFUSED) and the session stays as it is. Returns a Session. Raises an Error."""
    if not isinstance(ticket, str) or not TICKET.fullmatch(ticket.rstrip()):
        raise SessionError(Code.RESUME_REFUSED,
                           "the ticket is not two times 32 hexadecimal digits with a colon between" +
                           ("" if isinstance(ticket, str) else f"; it is of type {type(ticket).__name__}"),
                           "Pass Session.ticket as it was.", "ticket")
    if endpoint is None and not os.environ.get("SHEARBUS_ENDPOINT") and state_dir is None:
        raise Unreachable(Code.UNREACHABLE, "a session is resumed where it was opened, and no endpoint was given",
                          "Give endpoint=, or the state_dir= of a server in this process.")
    if nodes is None and (pair is not None or parameters):
        raise MessageError(Code.SHAPE, "pair or parameters without nodes", "Give nodes=, too.", "nodes")
    given = given_nodes(node_ids(() if nodes is None else nodes), None, pair, parameters)
    options = _options(endpoint, check_closure, name, server_key_file, secret_key_file, connect_deadline, reply_deadline, retry_after,
                       state_dir, threads)
    handle, host, status = _library.Address(), _library.Host(), _library.Status()
    host.give_to(options)
    with host.turn:
        code = _library.library().shearbus_resume_nodes(ctypes.byref(handle), ctypes.byref(options), ticket.encode(),
                                                        ctypes.byref(given), ctypes.byref(status))
    host.after_call(opening=True)
    if code:
        raise _library.fault_of(status)
    session = Session(handle, host, options, _words(want), record)
    session._take_resumed()
    return session


def _options(endpoint, check_closure, name, server_key_file, secret_key_file, connect_deadline, reply_deadline, retry_after, state_dir,
             threads, **more):
    """Returns a shearbus_options of the keywords of open()."""
    files = {"server_key_file": server_key_file, "secret_key_file": secret_key_file, "state_dir": state_dir}
    times = {"connect_deadline": connect_deadline, "reply_deadline": reply_deadline, "retry_after": retry_after}
    return _library.Options(
        endpoint=_values.text("endpoint", endpoint), name=_values.text("name", name),
        check_closure=_values.word("check_closure", check_closure, CHECKS), threads=0 if threads is None else count("threads", threads, 32),
        **{key: _values.text(key, value, path=True) for key, value in files.items()},
        **{f"{key}_s": _values.deadline(key, value) for key, value in times.items() if value is not None}, **more)


def _words(want):
    return (want,) if isinstance(want, str) else tuple(want)


@dataclasses.dataclass
class Welcome:
    """What the server has told of itself. access: how it has admitted this client; durability: of its sessions;
    capabilities: what it can do; limits: max_rows_per_message, max_marks."""

    server_version: str
    capabilities: tuple
    durability: str
    access: str
    limits: types.SimpleNamespace


class Session:
    """The shear layers of a set of nodes on a server. Made by shearbus.open() or shearbus.resume(); belongs to one
    thread at a time, and to the process that made it.

    nodes: ids in the order of the rows; name: of the scene; scene: the effective scene as TOML text, with every default
    and constant; warnings: of the opening, to be shown to a person; strategy: "velocity_driven" or "force_driven";
    components: tangential components; pairs, parameters: names of the scene's pairs, and keys that differ by node;
    columns: names of the columns that a step needs; optional_columns, reply_columns, columns_on_request: names;
    bytes_per_node: memory on the server; durable: whether the session outlives the server; welcome: what the server has
    told of itself; offers: numbers of this session's offers that waited when it was resumed; resumed_pair,
    resumed_parameters: names of the pairs of a resumed session's nodes (None with one pair) and {key: array} of their
    parameters, in the order that `nodes` had then; history: a History, with record=True.

    Every call raises an Error, which says what was expected and found and what to do. After UnknownOutcome the same
    call with the same values is the same request. The sessions of a durable server outlive it: calls wait for its
    restart until their deadline."""

    def __init__(self, handle, host, options, want, record):
        self._handle, self._host, self._totals = handle.value, host, None
        self._library = _library.library()
        self._step_call = self._library.shearbus_step
        self._status = _library.Status()
        self._by_status = ctypes.byref(self._status)
        self._turn = host.turn
        self._end = weakref.finalize(self, _leave, handle, host)
        self._endpoint = os.environ.get("SHEARBUS_ENDPOINT") or (options.endpoint or b"").decode()
        self._reply_deadline = options.reply_deadline_s or 60.0
        self._plans, self._vertices, self._transfer_in_doubt = {}, 0, None
        self._started = None  # mode, plan, rows and room of the answer of a step between start() and finish()
        self.resumed_pair, self.resumed_parameters = None, {}
        self.history = History() if record else None
        self._read_facts()
        self._want = self._names(want)

    def _read_facts(self):
        info = _library.Info()
        self._call("inspect", ctypes.byref(info))
        self.strategy, self.components = STRATEGY.get(info.strategy, info.strategy), info.tangential_components
        self.bytes_per_node, self.durable = info.bytes_per_node, bool(info.outlives_server)
        self.name = self._text(SCENE_NAME)
        self.pairs, self.parameters = self._lines(PAIR_NAMES), self._lines(PARAMETER_KEYS)
        self.welcome = Welcome(self._text(SERVER_VERSION), self._lines(CAPABILITIES), self._text(DURABILITY), self._text(ACCESS),
                               types.SimpleNamespace(max_rows_per_message=info.max_rows_per_message, max_marks=info.max_marks))
        self.scene = self._library.shearbus_effective_scene(self._handle).decode()
        self.warnings = self._library.shearbus_warnings(self._handle).decode().splitlines()
        self.columns, self.optional_columns, self.reply_columns, self.columns_on_request = map(self._columns, range(4))
        room = (ctypes.c_uint8 * TRANSFER_BYTES * self._library.shearbus_offers(self._handle, 0, None))()
        self._library.shearbus_offers(self._handle, len(room), room)
        self.offers = [bytes(transfer) for transfer in room]
        room = ctypes.create_string_buffer(TICKET_BYTES)
        self._call("ticket", room)
        self._ticket = room.value.decode()
        self._take_nodes()
        if self.history is not None:
            self.history._several, self.history._scene = bool(self.pairs or self.parameters), self.scene
        for warning in self.warnings:
            if not warning.startswith("note: "):  # which only informs
                _library.warn(warning, SceneWarning)

    def _text(self, which):
        return self._library.shearbus_text(self._handle, which).decode()

    def _lines(self, which):
        return tuple(self._text(which).splitlines())

    def _columns(self, use):
        room = (ctypes.c_uint32 * len(BY_NUMBER))()
        found = self._library.shearbus_columns(self._handle, use, len(room), room)
        return tuple(BY_NUMBER[column].name for column in room[:found] if column in BY_NUMBER)

    def _take_nodes(self):
        """Takes over the ids that the library has."""
        found = self._library.shearbus_node_count(self._handle)
        data = ctypes.string_at(self._library.shearbus_node_ids(self._handle), 8 * found) if found else b""
        self.nodes = numpy.frombuffer(data, numpy.uint64)

    def _take_resumed(self):
        """Takes over what the server told of a resumed session's nodes."""
        told = _library.Nodes()
        self._call("resumed_nodes", ctypes.byref(told))
        if not told.n_pairs:
            return
        places = ctypes.cast(told.pair, ctypes.POINTER(ctypes.c_uint64))[:told.n]
        self.resumed_pair = [told.pairs[place].decode() for place in places]
        self.resumed_parameters = {
            told.parameters[i].decode(): numpy.frombuffer(ctypes.string_at(told.values[i], 8 * told.n))
            for i in range(told.n_parameters)}
        self._note(History._known, self.nodes, None, self.resumed_pair, self.resumed_parameters)

    def _note(self, what, *arguments):
        """Calls a method of History on the history, if there is one."""
        if self.history is not None:
            what(self.history, *arguments)

    # -- calls of the library --

    def _begin(self, started=False):
        """Takes the turn of a call, which must end with self._turn.release(): the library refuses a second thread, but not
        before that has changed what the two share here. started: the call may come after start()."""
        if not self._turn.acquire(False):
            raise SessionError(Code.IN_USE, "another thread is inside a call on this session",
                               "Make one call at a time on a session: guard it with a lock, or open a session per thread.")
        if self._handle is None:
            self._turn.release()
            raise SessionError(Code.UNKNOWN_SESSION, "this session is closed", "Open another one.")
        if self._started and not started:
            self._turn.release()
            raise ContentError(Code.INVALID_VALUE, "a started step has not been finished", "Finish it before any other call.")

    def _call(self, name, *arguments):
        """Makes a call of the library on this session. Raises its fault."""
        self._begin()
        try:
            code = getattr(self._library, f"shearbus_{name}")(self._handle, *arguments, self._by_status)
            self._settle(code)
        finally:
            self._turn.release()

    def _settle(self, code):
        """Ends a call with a code: raises its fault, or what a signal's handler has raised."""
        if code == Code.SEQUENCE_REUSED:  # the library has asked where the session stands, and with which nodes
            self._take_nodes()
        self._host.after_call()
        if code:
            raise _library.fault_of(self._status)

    def _version(self):
        info = _library.Info()
        self._call("inspect", ctypes.byref(info))
        return info.state_version

    @property
    def reply_deadline(self):
        """Deadline of every call, retries included, in seconds; can be set."""
        return self._reply_deadline

    @reply_deadline.setter
    def reply_deadline(self, seconds):
        seconds = _values.deadline("reply_deadline", seconds)
        self._call("set_reply_deadline", seconds)
        self._reply_deadline = seconds

    # -- steps --

    def _names(self, want):
        """Returns the columns of a reply: the default ones and those of `want`."""
        names = [name for word in _words(want) for name in ([BY_NUMBER[number].name for number in LEDGER] if word == "ledger"
                                                            else [word])]
        offered = (*self.reply_columns, *self.columns_on_request)
        for name in names:
            if name not in offered:
                raise MessageError(
                    Code.SHAPE,
                    f"want names {name!r}, which a reply of this scene cannot have{_values.similar(str(name), offered)}",
                    f"It can have {', '.join(offered)}; \"ledger\" stands for the energy ledger.", str(name))
        return tuple(dict.fromkeys((*self.reply_columns, *names)))

    def _require(self, capability, field):
        """Raises MessageError where the server lacks a capability that it may ignore without a word."""
        if capability not in self.welcome.capabilities:
            raise MessageError(Code.UNSUPPORTED,
                               f"the server (version {self.welcome.server_version}) has no {capability}",
                               "Use a newer server.", field)

    def _plan(self, key, names, want):
        """Returns the Plan of steps with these keywords. Raises MessageError where one is missing or unknown."""
        needed = self.columns
        if self.strategy == "force_driven" and any(name in STICK_FORM for name in names):
            self._require("stick_form", "stick_stress")
            needed = (*(name for name in needed if name not in FAR_FIELD_FORM), *STICK_FORM)
        known = (*needed, *self.optional_columns)
        for name in names:
            if name not in known and name in self.columns:
                raise MessageError(
                    Code.SHAPE, f"{name} is of the far-field form of a step, and {', '.join(n for n in names if n in STICK_FORM)} of its stick form",
                    f"Pass the columns of one form: {', '.join(self.columns)}; or {', '.join(needed)}.", name)
            if name not in known:
                raise MessageError(
                    Code.SHAPE,
                    f"a step of this scene ({self.strategy}) has no column {name!r}{_values.similar(name, (*known, *OPTIONS))}",
                    f"It needs {', '.join(needed)}" +
                    (f" and may have {', '.join(self.optional_columns)}." if self.optional_columns else "."), name)
        for name in needed:
            if name not in names:
                raise MessageError(
                    Code.SHAPE,
                    f"{name} is missing: a step of this scene ({self.strategy}) needs {', '.join(needed)}",
                    f"Pass {name}=, one value per node or one for all.", name)
        places, at = [], 0
        for name in names:
            places.append((name, at, self.components if BY_NAME[name].tangential else 1))
            at += places[-1][2]
        wanted = self._want if want is None else self._names(want)
        plan = self._plans[key] = Plan(places, self.components, wanted, self.history is not None)
        return plan

    def _step(self, mode, dt, values, start=None):
        """Makes a step, or sends it by the function `start`, which takes the place of the library's step."""
        if self._handle is None or self._started or not self._turn.acquire(False):
            self._begin()  # refuses the call
        try:
            options, nodes = PLAIN, None
            plan = self._plans.get((mode, *values))
            if plan is None:  # a first step, or one with options
                values = values.copy()
                options = [values.pop(name, default) for name, default in OPTIONS.items()]
                nodes, want = options[:2]
                key = (mode, *values) if want is None else (mode, _words(want), *values)
                plan = self._plans.get(key) or self._plan(key, tuple(values), want)
            rows = self.nodes if nodes is None else node_ids(nodes)
            if plan.count != rows.size:
                plan.fit(rows.size)
            kept = plan.take(values)
            plan.request.dt_s = dt if type(dt) is float else number("dt", dt)
            if options is not plan.said:
                plan.said = None
                self._say(plan.request, mode, rows, *options)
                plan.said = options
            block = plan.room()
            if start:  # before the call: a signal's handler may raise an exception as soon as the library has returned
                self._started = mode, plan, rows, block
            code = (start or self._step_call)(self._handle, plan.by_request, plan.by_result, self._by_status)
            del kept
            if start:
                if code:
                    self._started = None
                return self._settle(code)
            if code or self._host.lines or self._host.raised:
                self._settle(code)
            answer = _answer(mode, plan, rows, block)
        finally:
            self._turn.release()
        return answer if mode == ADVANCE and self.history is None else self._noted(answer, mode, plan)

    def _noted(self, answer, mode, plan):
        """Ends what an answer is the last part of: a trial knows its session, a history has its steps."""
        if mode == TRIAL:
            answer._session = self
        if self.history is not None:
            request = plan.request
            if request.commit_previous:
                self.history._commit()
            self.history._add(request.dt_s, request.time_s, request.step, plan.columns, plan.frame.copy(), answer, mode == ADVANCE)
        return answer

    def _say(self, request, mode, rows, nodes, _, absent_nodes, time, step, attempt, commit_previous, all_or_nothing):
        """Tells the library the options of a step."""
        request.mode, request.commit_previous, request.all_or_nothing = mode, bool(commit_previous), bool(all_or_nothing)
        request.time_s, request.step, request.attempt = number("time", time), count("step", step), count("attempt", attempt, 32)
        request.open_absent = _values.word("absent_nodes", absent_nodes, ABSENT_NODES)
        if request.open_absent:
            self._require("absent_nodes", "absent_nodes")
        if mode == ADVANCE and commit_previous:
            raise MessageError(Code.SHAPE, "commit_previous is of a trial", "Call trial(), or leave it out.", "commit_previous")
        request.node_ids = None if nodes is None else _library.address(rows)

    def step(self, dt, **values):
        """Makes one step of length `dt` (s) and keeps its result. Returns an Answer.

        values: the columns of the scene's strategy by name (`columns`, `optional_columns`), in SI units: one number for
        all rows, or an array of float64 of shape (N,), or (N, 2) with two tangential components. nodes: ids of the
        rows, for a step of some nodes; without it the rows are all nodes in the order of `nodes` of the session.
        absent_nodes: "keep" keeps the states of nodes that are not named, "open" steps them with P = 0, so that they
        cool. time (s): end of the step, for records. step and attempt: the host's own numbers, for records.
        all_or_nothing: where a node has no answer the step is refused (STEP_FAILED) and nothing changes; otherwise the node
        keeps its state and its row has Outcome.FAILED. want: names of more columns for this reply; "ledger" stands for the
        energy ledger."""
        return self._step(ADVANCE, dt, values)

    def trial(self, dt, **values):
        """Makes one step from the committed states and waits for a decision. Returns a Trial: use it in a `with` block,
        or call commit() or rollback() of the session; another trial replaces it. commit_previous: first commits the
        trial that stands. The other arguments are those of step()."""
        return self._step(TRIAL, dt, values)

    def start(self, dt, *, trial=False, **values):
        """Sends a step, or with `trial` a trial, and returns at once: the host does other work while the server steps the layers, and
        finish() gets the answer. The arguments are those of step(); their arrays are the host's again. Between the two no other
        call on the session but close() and leave(). A step that was started and then left may run or not."""
        send = self._library.shearbus_start
        self._step(TRIAL if trial else ADVANCE, dt, values, lambda handle, request, _, status: send(handle, request, status))

    def finish(self):
        """Waits for the answer to the step that start() has sent. Returns an Answer or a Trial. After an error the whole call with
        the same values, step() or trial(), sends the same request."""
        self._begin(started=True)
        try:
            mode, plan, rows, block = self._started or (ADVANCE, None, None, None)
            code = self._library.shearbus_finish(self._handle, plan and plan.by_result, self._by_status)
            self._started = None  # after the call: an exception of a signal's handler before it leaves the step started
            self._settle(code)
            answer = _answer(mode, plan, rows, block)
        finally:
            self._turn.release()
        return self._noted(answer, mode, plan)

    # To match each column with the names of options costs a call as much as the rest of it: they are told here.
    step.__signature__, trial.__signature__ = (
        inspect.Signature([inspect.Parameter("self", inspect.Parameter.POSITIONAL_OR_KEYWORD),
                           inspect.Parameter("dt", inspect.Parameter.POSITIONAL_OR_KEYWORD),
                           *(inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default)
                             for name, default in OPTIONS.items() if trial or name != "commit_previous"),
                           inspect.Parameter("values", inspect.Parameter.VAR_KEYWORD)]) for trial in (False, True))

    def set_fallback(self, law):
        """Gives the host's own law, for steps (not trials) while the server is gone, if the user allows it by the environment
        variable SHEARBUS_FALLBACK, the time in s that a step gives the server. law(inputs, outputs) fills the arrays of the
        outputs, {name: array}; "2" behind a name stands for the second component; what it does not fill is NaN (a regime: 0). Rows of such a step have the outcome Outcome.FALLBACK
        and are flagged, and `fallbacks` counts them. None takes the law away."""
        function = None if law is None else callback(law, self._host.raised)
        self._call("set_fallback", ctypes.cast(function, ctypes.c_void_p) if law else None, None)
        self._law = function  # lives as long as the library may call it

    @property
    def fallbacks(self):
        """What the host's own law answered: steps, node_steps, time (s), absences of the server, allowed by the user."""
        counts = _library.Fallbacks()
        self._call("count_fallbacks", ctypes.byref(counts))
        return types.SimpleNamespace(steps=counts.steps, node_steps=counts.node_steps, time=counts.time_s, absences=counts.absences,
                                     allowed=bool(counts.allowed))

    def commit(self):
        """Keeps the result of the trial. Returns the state version."""
        self._call("commit")
        self._note(History._commit)
        return self._version()

    def rollback(self):
        """Drops the trial; without one it does nothing. Returns the state version."""
        self._call("rollback")
        self._note(History._drop)
        return self._version()

    # -- marks --

    def mark(self, name):
        """Keeps nodes and committed states on the server under a name, such as that of a restart dump. Returns the
        names of the kept marks, oldest first: the server keeps the newest welcome.limits.max_marks."""
        self._call("mark", _values.text("name", name))
        names = list(self._lines(MARK_NAMES))
        self._note(History._mark, name, names)
        return names

    def rollback_to(self, name):
        """Restores the nodes and states of a mark, and drops a trial. Returns the state version."""
        self._call("rollback_to", _values.text("name", name))
        self._take_nodes()
        self._note(History._rollback_to, name)
        return self._version()

    # -- profiles --

    def profiles(self, nodes, pressure=None):
        """Reads the layers of some nodes, vertex by vertex, from their committed states; changes nothing. pressure
        (Pa): a number or an array (N,), at which the flow stress is evaluated; None: 0.

        Returns Profiles of N nodes and V vertices in ascending z, in SI units. A scene that keeps no profile is a
        MessageError (UNSUPPORTED), which gives the reason."""
        named = node_ids(nodes)
        at = None
        if pressure is not None:
            at = numpy.empty((1, named.size))
            _values.fill(at, "pressure", pressure)
        widths = {number: self.components if BY_NUMBER[number].tangential else 1 for number in PROFILE}
        while True:
            room, vertices = self._vertices, _library.Size(self._vertices)
            arrays = {number: numpy.empty((width, named.size, room)) for number, width in widths.items()}
            outputs = [_library.Column(number, i, _library.address(array[i])) for number, array in arrays.items()
                       for i in range(len(array))]
            try:
                self._call("profiles", named.size, _library.address(named), None if at is None else _library.address(at),
                           (_library.Column * len(outputs))(*outputs), len(outputs), ctypes.byref(vertices))
            except MessageError as fault:
                if fault.code != Code.SHAPE or vertices.value <= room:
                    raise
                self._vertices = vertices.value
                continue
            if vertices.value == room:
                return Profiles(named, self._version(), arrays)
            self._vertices = vertices.value

    # -- the set of nodes --

    def register(self, nodes, initial_temperature=None, pair=None, parameters=None):
        """Adds nodes behind the present ones. initial_temperature (K): a number or an array (N,); None: the scene's. pair
        and parameters: as in open(); parameters of all keys of the opening, or None: the values of the pairs."""
        new = node_ids(nodes)
        self._call("register_nodes", ctypes.byref(given_nodes(new, initial_temperature, pair, parameters)))
        self._take_nodes()
        self._note(History._registered, new, initial_temperature, pair, parameters)

    def retire(self, nodes):
        """Removes nodes and frees their states."""
        gone = node_ids(nodes)
        self._call("retire", gone.size, _library.address(gone))
        self._take_nodes()

    def offer(self, nodes):
        """Offers nodes with their states to another session of the domain. Returns the 16 bytes under which that
        session accepts them. From then on the nodes wait on the server and are not this session's."""
        given, transfer = node_ids(nodes), (ctypes.c_uint8 * TRANSFER_BYTES)()
        self._call("offer", given.size, _library.address(given), transfer)
        self._take_nodes()
        return bytes(transfer)

    def accept(self, transfer):
        """Accepts the nodes of an offer behind the present ones. Returns their ids."""
        if not isinstance(transfer, (bytes, bytearray)):
            raise WrongType(Code.SHAPE, f"transfer is {transfer!r}, expected the {TRANSFER_BYTES} bytes of Session.offer()",
                            field="transfer")
        if len(transfer) != TRANSFER_BYTES:
            raise WrongValue(Code.SHAPE, f"transfer has {len(transfer)} bytes, expected the {TRANSFER_BYTES} of Session.offer()",
                             field="transfer")
        before = self.nodes.size
        self._call("accept", bytes(transfer))
        self._take_nodes()
        return self.nodes[before:]

    # -- the end --

    @property
    def ticket(self):
        """Text by which shearbus.resume() continues this session after this process has ended. A secret: its holder
        owns the session."""
        return self._ticket

    def close(self):
        """Closes the session, frees its states and ends a server in this process. Returns the session's totals: requests,
        node_steps, solver_ns, asleep_node_steps; of a closed session those of its end. After an error the session is still
        this client's: call close() again, or leave()."""
        if self._handle is None:
            return self._totals
        if self._started:
            try:
                self.finish()
            except (Unreachable, UnknownOutcome):
                raise  # the server does not answer: to ask it once more would only cost the host another deadline
            except Error:
                pass  # a refused step does not keep the session open
        totals = _library.Totals()
        try:
            self._call("end", ctypes.byref(totals))
        except SessionError as fault:
            # An interrupted request had run after all: the session now stands behind it.
            if fault.code != Code.SEQUENCE_REUSED:
                raise
            self._call("end", ctypes.byref(totals))
        self._totals = types.SimpleNamespace(**{name: getattr(totals, name) for name, _ in totals._fields_[1:]})
        self.leave()
        return self._totals

    def leave(self):
        """Leaves the session open on the server, to be resumed by its ticket, and disconnects."""
        if self._handle is None:
            return
        self._begin(started=True)
        try:
            self._handle = None
            self._end()
        finally:
            self._turn.release()

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        if self._handle is None:
            return
        if kind is not None and issubclass(kind, (Unreachable, UnknownOutcome)):
            self.leave()  # the server does not answer: to ask it once more would only cost the host another deadline
            return
        try:
            with contextlib.suppress(Error) if kind is not None else contextlib.nullcontext():
                self.close()
        finally:
            self.leave()

    def __reduce__(self):
        raise TypeError("a shearbus.Session is a connection of this process and cannot be pickled or copied: pass its ticket, and "
                        "after leave() the other process continues it by shearbus.resume(ticket, endpoint)")

    def _state(self):
        return "closed" if self._handle is None else f"{self.nodes.size} nodes"

    def __repr__(self):
        return f"<shearbus.Session {self.name!r}, {self.strategy}, {self._state()}, at {self._endpoint or 'a server in this process'}>"

    def _repr_html_(self):
        rows = [("strategy", self.strategy), ("nodes", self._state()), ("server", self._endpoint or "in this process"),
                ("server version", self.welcome.server_version), ("durability", self.welcome.durability),
                ("tangential components", self.components), ("bytes per node", self.bytes_per_node),
                ("columns of a step", ", ".join(self.columns)), ("may have", ", ".join(self.optional_columns)),
                ("columns of an answer", ", ".join(self.reply_columns)), ("on request", ", ".join(self.columns_on_request)),
                *(("warning", warning) for warning in self.warnings)]
        return html_table(f"shearbus.Session {self.name}", [("", self.name), *rows])


def _answer(mode, plan, rows, block):
    """Returns the answer that the library has written to the plan, or to the room of its own."""
    return (Answer if mode == ADVANCE else Trial)(rows, plan.layout, plan.block.tobytes() if block is None else frozen(block),
                                                  bytes(plan.result))


def _leave(handle, host):
    """Frees a handle, and passes on what the library says of the session's end. host: lives as long as the handle."""
    _library.library().shearbus_leave(ctypes.byref(handle))
    host.after_call(opening=True)
