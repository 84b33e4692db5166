"""A session: the shear layers of a set of interface nodes on a server, and the calls that step, move and keep them."""
import contextlib
import copy
import difflib
import operator
import os
import time
import types

import numpy

from . import header
from .checksum import xxh3
from .closure import ClosureCheck
from .columns import (BY_NAME, BY_NUMBER, DTYPE, FAR_FIELD_FORM, INITIAL_TEMPERATURE, LEDGER, NODE_ID, PAIR,
                      PARAMETER, PROFILE, STICK_FORM, UINT64)
from .connection import SMALL_BYTES, Connection
from .errors import Code, ContentError, Error, MessageError, SessionError, UnexpectedReply, UnknownOutcome, Unreachable
from .history import History

ADVANCE, TRIAL = 1, 2  # Mode
ALL_OR_NOTHING = 2  # Policy
ABSENT_NODES = {"keep": 0, "open": 1}
STRATEGY = {1: "velocity_driven", 2: "force_driven"}
FLOAT = numpy.dtype(float)
MAX_ROWS = 200_000  # of a message, where the server does not say
PAUSE_S = 0.1  # between two attempts while the server restarts
MOST_RESTARTS = 20  # of the server that one call follows


class Regime:
    """Values of the column `regime`: what held the stress in the step."""

    OPEN, STICK, COULOMB, TRESCA, MELTING = range(5)


class Outcome:
    """Bits of the column `outcome`; 0 is success without qualification."""

    SUBSTEPPED, MULTIPLE_ROOTS, OUTSIDE_DOMAIN, SUDDEN = 1, 2, 4, 8
    OVER_BUDGET, ASLEEP, FIRST_ORDER, FAILED = 16, 32, 64, 128


# -- from values to a payload --


def node_ids(values):
    """Returns node ids as an array of uint64. Raises ContentError or MessageError where they are not distinct whole
    numbers from 0 on."""
    if isinstance(values, numpy.ma.MaskedArray):
        raise MessageError(Code.SHAPE, "nodes is a masked array", "Pass the ids that are meant, as a plain array.",
                           "nodes")
    if not isinstance(values, numpy.ndarray):
        array = _whole_numbers(values)
    else:
        array = values if values.size or values.ndim != 1 else values.astype(numpy.uint64)
    if array.ndim != 1 or array.dtype.kind not in "iu":
        raise MessageError(
            Code.SHAPE,
            f"nodes has the type {array.dtype} and the shape {array.shape}, expected a list of whole numbers "
            "from 0 to 2**64 - 1", "Convert the ids explicitly: numpy.asarray(ids, numpy.uint64).", "nodes")
    if array.dtype.kind == "i" and (array < 0).any():
        raise ContentError(Code.INVALID_VALUE, f"nodes has the id {array[array < 0][0]}, expected 0 or more",
                           "Number the nodes from 0 on.", "nodes")
    array = array.astype(numpy.uint64)
    ordered = numpy.sort(array)
    twice = ordered[1:][ordered[1:] == ordered[:-1]]
    if twice.size:
        raise ContentError(Code.DUPLICATE_NODE, f"nodes has the id {twice[0]} twice", "Name each node once.", "nodes",
                           [int(twice[0])])
    return array


def _whole_numbers(values):
    """Returns a sequence of Python's whole numbers as an array; numpy itself would make floats of [1, 2**64 - 1]."""
    try:
        found = [operator.index(value) for value in values if not isinstance(value, (bool, numpy.bool_))]
        if len(found) == len(values):
            return numpy.array(found, numpy.int64 if min(found, default=0) < 0 else numpy.uint64)
    except (TypeError, OverflowError):
        pass
    return numpy.array(values, object)


def fill(rows, name, value):
    """Writes the values of a column into `rows`, of shape (components, N). A number stands for all rows; anything else
    has the shape (N,), or (N, 2) with two components. Raises MessageError or ContentError, which name the column,
    before anything is sent."""
    if isinstance(value, numpy.ma.MaskedArray):
        raise MessageError(Code.SHAPE, f"{name} is a masked array",
                           f"Pass {name}.filled(value), or only the nodes in contact (nodes=).", name)
    try:
        array = numpy.asarray(value)
    except ValueError as fault:
        raise MessageError(Code.SHAPE, f"{name} is no array of numbers: {fault}", field=name) from None
    if array.dtype.kind not in "iuf" or (array.dtype.kind == "f" and array.dtype.itemsize != 8):
        raise MessageError(Code.SHAPE, f"{name} has the type {array.dtype}, expected float64",
                           f"Compute it in double precision, or convert it explicitly: numpy.asarray({name}, float).",
                           name)
    components, count = rows.shape
    expected = (count,) if components == 1 else (count, components)
    if array.ndim == 0 and (components == 1 or array == 0):
        rows[...] = array
    elif array.shape == expected:
        rows[...] = array if components == 1 else array.T
    else:
        raise MessageError(
            Code.SHAPE, f"{name} has the shape {array.shape}, expected {expected}" +
            (" or a number" if components == 1 else ": one row per node, one column per tangential direction"),
            "Pass one value per node of the step, in the order of its rows.", name)


def check_finite(rows, name, nodes):
    """Raises ContentError, which names the first node at fault, if a value of `rows`, of shape (components, N), is not
    finite."""
    finite = numpy.isfinite(rows)
    if not finite.all():
        row, component = numpy.argwhere(~finite.T)[0]
        raise ContentError(Code.INVALID_VALUE, f"{name} of node {nodes[row]} is {rows[component, row]}",
                           "Every value must be finite.", name, map(int, nodes[~finite.all(axis=0)][:16]))


_layouts = {}  # (number, component) of the columns and rows -> the encoded columns of a payload


def payload_of(columns, frame):
    """Returns the encoded Payload of columns (number, component) whose values are the rows of `frame`, 8 bytes each,
    and the bytes of the payload frame."""
    count = frame.shape[1]
    layout = _layouts.get((columns, count))
    if layout is None:
        _layouts.clear() if len(_layouts) > 256 else None
        layout = _layouts[columns, count] = header.PAYLOAD.encode({
            "columns": [{
                "field": number, "component": component, "element": BY_NUMBER[number].element, "offset_bytes":
                8 * count * i, "count": count
            } for i, (number, component) in enumerate(columns)]
        })
    data = frame.tobytes() if frame.nbytes <= SMALL_BYTES else memoryview(frame).cast("B")
    return header.PAYLOAD.encode({"size_bytes": frame.nbytes, "xxh3": xxh3(data)}) + layout, data


def named_nodes(nodes, temperature=None, places=None, parameters=()):
    """Returns (columns, frame) of nodes to be opened, registered, retired or offered; (None, None) without nodes.
    places: of the nodes' pairs in the request's list; parameters: (key, values) in the order of the session's keys."""
    if not len(nodes):
        return None, None
    columns = [(NODE_ID.number, 0)]
    if temperature is not None:
        columns.append((INITIAL_TEMPERATURE.number, 0))
    if places is not None:
        columns.append((PAIR.number, 0))
    columns += [(PARAMETER.number, component) for component in range(len(parameters))]
    frame = numpy.empty((len(columns), len(nodes)))
    frame[0].view(numpy.uint64)[:] = nodes
    row = 1
    if temperature is not None:
        fill(frame[row:row + 1], INITIAL_TEMPERATURE.name, temperature)
        check_finite(frame[row:row + 1], INITIAL_TEMPERATURE.name, nodes)
        row += 1
    if places is not None:
        frame[row].view(numpy.uint64)[:] = places
        row += 1
    for row, (key, values) in enumerate(parameters, row):
        fill(frame[row:row + 1], key, values)
        check_finite(frame[row:row + 1], key, nodes)
    return tuple(columns), frame


def pairs_of(pair, count):
    """Returns (names, places) of the pairs of `count` nodes: a name for all, or a list of one name per node; ([], None)
    for None."""
    if pair is None or not count:
        return [], None
    each = [pair] * count if isinstance(pair, str) else [str(name) for name in pair]
    if len(each) != count:
        raise MessageError(Code.SHAPE, f"pair has {len(each)} names, expected {count}", "Give one name per node.", "pair")
    names = list(dict.fromkeys(each))
    place = {name: i for i, name in enumerate(names)}
    return names, [place[name] for name in each]


def in_order(parameters, keys):
    """Returns (key, values) of a dict of parameters in the order of the session's keys: all of them, or none."""
    given = dict(parameters or {})
    if given and set(given) != set(keys):
        raise MessageError(Code.SHAPE, f"parameters are {', '.join(given)}; those of the session: {', '.join(keys) or 'none'}",
                           "Give values for each of them, or for none; the opening chooses the keys.", "parameters")
    return [(key, given[key]) for key in keys if key in given]


# -- answers --


class Answer:
    """The answer to a step. Each column of the reply is an attribute: stress, slip, temperature, jump_new,
    friction_heat, regime, outcome, ..., a read-only array of shape (N,), or (N, 2) with two tangential components, in
    SI units and in the order of the request's rows. The arrays are views of the received frame, which lives as long as
    they do.

    nodes: ids of the rows; state_version: number of commits so far; flagged_nodes: rows with an outcome other than
    success and asleep; solver_s, service_s, round_trip_s: times; replayed: whether the server sent a kept reply;
    largest_closure (m/s), closure_node, layer_time (s): the largest difference of a node's jump from the jump that it
    was answered before, the node, and the time of its layer; 0 with closure="off"."""

    def __init__(self, reply, nodes):
        upscale, view = reply.header.upscale, reply.payload
        self.nodes = nodes
        self.state_version, self.flagged_nodes = upscale.state_version, upscale.flagged_nodes
        self.solver_s, self.service_s = upscale.solver_ns * 1e-9, upscale.service_ns * 1e-9
        self.largest_closure, self.closure_node = upscale.largest_closure_m_per_s, upscale.closure_node
        self.layer_time = upscale.layer_time_s
        self.round_trip_s, self.replayed = reply.round_trip_s, reply.header.replayed
        self._columns = reply.header.payload.columns.parts
        if type(view) is not bytes and numpy.frombuffer(view, numpy.uint8, 1).ctypes.data % 8:
            view = bytes(view)  # libzmq delivers small frames at any address
        self._view = view

    @property
    def columns(self):
        """Names of the columns of the reply."""
        return tuple(self._columns)

    def __getattr__(self, name):
        columns = self.__dict__.get("_columns", {})
        if name not in columns:
            hint = "; ask for it with want=" if name in BY_NAME else ""
            raise AttributeError(f"the reply has no column {name}: it has {', '.join(columns)}{hint}")
        parts = columns[name]
        dtype, count, begin = DTYPE[parts[0].element], parts[0].count, parts[0].offset_bytes
        if len(parts) == 1:
            array = numpy.ndarray((count,), dtype, self._view, begin)
        else:
            array = numpy.ndarray((count, 2), dtype, self._view, begin, (dtype.itemsize, parts[1].offset_bytes - begin))
        array.setflags(write=False)
        self.__dict__[name] = array
        return array

    def __dir__(self):
        return [*super().__dir__(), *self._columns]

    def __repr__(self):
        return f"<{type(self).__name__} of {len(self.nodes)} nodes: {', '.join(self._columns)}>"


class Trial(Answer):
    """The answer to a trial, and the `with` block that decides it: leaving the block commits the trial; an exception,
    or reject() before the end of the block, rolls it back."""

    def __init__(self, reply, nodes, session):
        super().__init__(reply, nodes)
        self._session, self._rejected = session, False

    def reject(self):
        """Rolls the trial back when the block ends."""
        self._rejected = True

    def __enter__(self):
        return self

    def __exit__(self, kind, fault, _):
        if kind is None and not self._rejected:
            self._session.commit()
            return
        with contextlib.suppress(Error) if kind is not None else contextlib.nullcontext():
            self._session.rollback()


class Profiles:
    """The layers of N nodes at V vertices. nodes: ids; state_version: number of commits that led to these states;
    position, width (m), shape (V,): z of each vertex, above 0 in the soft body, and the length that it stands for;
    layer_temperature (K), layer_plastic_strain, layer_flow_stress, layer_shear_stress (Pa): shape (N, V), the stress
    (N, V, 2) with two tangential components. NaN: the vertex lies outside of the layer. A layer that cannot flow has
    neither strain nor flow stress: they are None."""

    def __init__(self, reply, nodes):
        self.nodes, self.state_version = nodes, reply.header.profiles.state_version
        shape, parts = (len(nodes), reply.header.profiles.vertices), reply.header.payload.columns.parts
        for column in (BY_NUMBER[number] for number in PROFILE):
            of_component = [
                numpy.frombuffer(reply.payload, DTYPE[part.element], part.count,
                                 part.offset_bytes).reshape(shape).astype(float)
                for part in parts.get(column.name, ())
            ]
            array = of_component[0] if len(of_component) == 1 else numpy.stack(of_component, -1) if of_component else None
            if column.name in ("position", "width"):
                array = array[0]
            setattr(self, column.name, array if array is None else _frozen(array))

    @classmethod
    def joined(cls, nodes, parts):
        """The Profiles of `nodes`, from parts (rows among the nodes, Profiles of these rows)."""
        whole = copy.copy(parts[0][1])
        whole.nodes = nodes
        for column in (BY_NUMBER[number] for number in PROFILE):
            first = getattr(whole, column.name)
            if first is None or column.name in ("position", "width"):
                continue
            array = numpy.empty((len(nodes), *first.shape[1:]))
            for rows, part in parts:
                array[rows] = getattr(part, column.name)
            setattr(whole, column.name, _frozen(array))
        return whole

    def __repr__(self):
        return f"<Profiles of {len(self.nodes)} nodes at {len(self.position)} vertices>"


# -- the session --


class Session:
    """The shear layers of a set of nodes on a server. Made by shearbus.open() or shearbus.resume(); belongs to one
    thread at a time.

    nodes: ids in the order of the rows; scene: the effective scene as TOML text, with every default and constant;
    warnings: of the opening, to be shown to a person; strategy: "velocity_driven" or "force_driven"; components:
    tangential components; columns: names of the columns that a step needs; optional_columns, reply_columns,
    columns_on_request: names; bytes_per_node: memory on the server; offers: numbers of this session's offers that
    waited when it was resumed; resumed_pair, resumed_parameters: names of the pairs of a resumed session's nodes (None
    with one pair) and {key: array} of their parameters, in the order that `nodes` had then; history: a History, with record=True.

    Every call raises an Error, which says what was expected and found and what to do. After UnknownOutcome the same
    call with the same values is the same request. The sessions of a durable server outlive it: calls wait for its
    restart until their deadline."""

    def __init__(self, connection, server, want, record, closure):
        """Connects and says hello; shearbus.open() and shearbus.resume() do the rest."""
        self._connection, self._server, self._want = connection, server, want
        self._endpoint = connection.endpoint
        self.history = History() if record else None
        self._closure = ClosureCheck(closure)
        self._id = self._token = b""
        self._epoch = self._sequence = 0
        self._doubt = None  # request id and epoch of the last request, whose outcome is unknown
        self._transfer = b""  # number of an offer that has not been answered
        self._closed = True
        self._claimant = connection.next_request_id()
        self._claim_in_doubt = None  # (number, epoch of the server) of a claim that was sent and not granted
        self._opening_undone = False  # a refused opening cannot be repeated with its ids
        self.offers = []
        self.resumed_pair, self.resumed_parameters = None, {}
        self._plans = {}  # keywords of a request -> its columns
        self.welcome = self._greet()
        self.durable = self.welcome.durability != "none"
        self._max_rows = self.welcome.limits.max_rows_per_message or MAX_ROWS
        self._parts = None  # a step in parts without an end: its hashes, and the replies so far
        self._previous_committed = False  # part 1 of a step that failed has committed the trial before

    def _greet(self):
        """Says hello. Returns the Welcome."""
        connection = self._connection
        hello = {
            "oldest_major": header.PROTOCOL_MAJOR, "newest_major": header.PROTOCOL_MAJOR, "client_name": connection.name
        }
        try:
            greeted = self._ask("hello", hello, "welcome", deadline=connection.connect_deadline).header
            self._epoch = greeted.epoch
            return greeted.welcome
        except Error as fault:
            if fault.code != Code.UNKNOWN_OUTCOME:
                raise
            # hello changes nothing on the server, so its unknown outcome means that no server answered.
            raise Unreachable(
                Code.UNREACHABLE, f"{connection.endpoint} accepts connections but did not answer the greeting within "
                f"{connection.connect_deadline:g} s",
                "Is it a shearbus server, and is it busy with a long step?") from None

    # -- requests --

    def _frames(self, envelope, columns, frame):
        envelope = {
            "magic": header.MAGIC, "protocol_major": header.PROTOCOL_MAJOR, "protocol_minor": header.PROTOCOL_MINOR,
            **envelope
        }
        if columns is None:
            return [header.REQUEST_HEADER.encode(envelope)]
        payload, data = payload_of(columns, frame)
        return [header.REQUEST_HEADER.encode({**envelope, "payload": payload}), data]

    def _send(self, envelope, verb, body, answer, columns=None, frame=None, deadline=None):
        reply = self._connection.call(self._frames({**envelope, verb: body}, columns, frame), envelope["request_id"],
                                      deadline, verb)
        if getattr(reply.header, answer) is None:
            raise UnexpectedReply(Code.UNEXPECTED_REPLY, f"the reply to {verb} is not {answer}",
                                  "Client and server do not agree on the protocol; tell the maintainers.")
        return reply

    def _ask(self, verb, body, answer, deadline=None, **envelope):
        """Sends a request that has no sequence number."""
        return self._send({"request_id": self._connection.next_request_id(), **envelope},
                          verb,
                          body,
                          answer,
                          deadline=deadline)

    def _check_open(self):
        if self._closed:
            raise SessionError(Code.UNKNOWN_SESSION, "this session is closed", "Open another one.")

    def _next_envelope(self):
        """Returns the envelope of the session's next request. From here on its outcome is unknown until a reply
        comes, so the same call again has the same bytes and the server recognises it."""
        self._check_open()
        request_id, epoch = self._doubt = self._doubt or (self._connection.next_request_id(), self._epoch)
        return {"request_id": request_id, "session_id": self._id, "sequence": self._sequence + 1, "epoch": epoch}

    def _post(self, envelope, verb, body, columns=None, frame=None):
        """Sends a request without waiting, if there is a connection; the _send() of the same request then receives
        the reply."""
        self._connection.post(self._frames({**envelope, verb: body}, columns, frame), envelope["request_id"])

    def _exchange(self, verb, body, answer, columns=None, frame=None):
        """Sends the session's next request. Its number counts when the reply arrives."""
        envelope = self._next_envelope()
        request_id = envelope["request_id"]
        started, restarts = time.monotonic(), 0
        try:
            while True:
                left = max(self._connection.reply_deadline - (time.monotonic() - started), 0.001)
                try:
                    reply = self._send(envelope, verb, body, answer, columns, frame, left)
                    break
                except Error as fault:
                    if self._tells_restart(fault) and envelope["epoch"] and restarts < MOST_RESTARTS:
                        envelope["epoch"] = self._follow_restart(fault)
                        self._doubt = request_id, self._epoch
                        # The restarted server is at work: the deadline begins anew.
                        started, restarts = time.monotonic(), restarts + 1
                    elif fault.code == Code.SHUTTING_DOWN and self.durable and left > PAUSE_S:
                        time.sleep(PAUSE_S)
                    else:
                        raise
        except Error as fault:
            # After a refusal of class 4xx the server may still run a copy of the request that is on its way.
            if fault.code in (Code.UNKNOWN_OUTCOME, Code.UNEXPECTED_REPLY) or int(fault.code) // 100 == 4:
                self._doubt = request_id, envelope["epoch"]
            elif fault.code not in (Code.UNREACHABLE, Code.AUTH):
                self._doubt = None
            if fault.code == Code.SEQUENCE_REUSED:
                self._adopt(
                    self._ask("resume_session", {"resume_token": self._token}, "session_resumed", session_id=self._id))
            raise
        self._doubt = None
        self._sequence = envelope["sequence"]
        return reply

    def _tells_restart(self, fault):
        # SUPERSEDED after a claim of unknown outcome: by a late copy of this client's own claim, perhaps.
        return fault.code == Code.EPOCH or fault.code == Code.SUPERSEDED and self._claim_in_doubt

    def _claim(self, after_own=False):
        """Claims the session for this client, after a restart of the server or as a successor; after_own: only if the
        last claim that was granted is this client's. Returns the reply to the claim."""
        for restarts in range(MOST_RESTARTS + 1):
            asked = self._ask("resume_session", {"resume_token": self._token}, "session_resumed",
                              session_id=self._id).header
            if after_own and asked.session_resumed.claimant != self._claimant:
                self._claim_in_doubt = None
                raise SessionError(Code.SUPERSEDED, "the last claim of the session is another client's")
            self._claim_in_doubt = asked.session_resumed.claim + 1, asked.epoch
            try:
                return self._repeat_claim()
            except Error as fault:
                # EPOCH means that the server was restarted between the two requests.
                if fault.code != Code.EPOCH or restarts == MOST_RESTARTS:
                    raise

    def _repeat_claim(self):
        """Makes the claim in doubt (number, epoch of the server) again. Returns the reply to it."""
        number, epoch = self._claim_in_doubt
        claim = {"resume_token": self._token, "claim": number, "claimant": self._claimant}
        try:
            granted = self._ask("resume_session", claim, "session_resumed", session_id=self._id, epoch=epoch)
        except Error as fault:
            if fault.code == Code.SUPERSEDED:
                self._claim_in_doubt = None  # no server will grant it
            raise
        self._claim_in_doubt = None
        return granted

    def _follow_restart(self, fault):
        """Claims the session on the restarted server. Returns the epoch with which the refused request may be sent
        again."""
        superseded = fault.code == Code.SUPERSEDED
        try:
            try:
                claimed = (self._repeat_claim() if superseded else self._claim()).header
            except SessionError as refusal:
                if not superseded or refusal.code != Code.EPOCH:
                    raise
                # Another restart: the server no longer grants the claim, but knows whether it was the last one.
                claimed = self._claim(after_own=True).header
        except Error as refusal:
            # The first error explains the restart, or that another client has the session.
            first = refusal.code == Code.UNKNOWN_SESSION or superseded and refusal.code == Code.SUPERSEDED
            raise fault if first else refusal
        stands_at = claimed.session_resumed.last_sequence
        if stands_at != self._sequence:
            raise SessionError(
                Code.EPOCH, "the server was restarted and came back with older states: the session stands at request "
                f"{stands_at}, this client at {self._sequence}",
                "Open a new session and start again from the host's last restart point.",
                last_sequence=stands_at)
        self._epoch = claimed.epoch
        return claimed.epoch

    def _open(self, request_id, body, nodes, columns, frame):
        """Opens the session on the server with its nodes. Returns the SessionOpened."""
        opened = self._send({"request_id": request_id}, "open_session", body, "session_opened", columns, frame).header
        self._have(nodes)
        self._opened(opened.session_opened, opened.epoch)
        return opened.session_opened

    def _resume(self, expected=None):
        """Continues the session as a successor. Returns its position, a SessionResumed. expected: as in check_nodes()."""
        if expected:  # before the claim, which takes the session from its client
            check_nodes(*nodes_in(self._ask("resume_session", {"resume_token": self._token}, "session_resumed",
                                            session_id=self._id)), *expected)
        claimed = self._claim()
        self._adopt(claimed)
        self._opened(claimed.header.session_resumed.session, claimed.header.epoch)
        self._resumed(*nodes_in(claimed)[1:], expected)
        return claimed.header.session_resumed

    def _resumed(self, pair, parameters, expected):
        """Takes over the pairs and parameters of a resumed session's nodes."""
        if expected:
            check_nodes(self.nodes, pair, parameters, *expected)
        self.resumed_pair, self.resumed_parameters = pair, parameters
        if pair is not None:
            self._remember(self.nodes, None, pair, parameters)

    def _adopt(self, reply):
        """Adopts sequence number, nodes and offers from a session_resumed."""
        resumed = reply.header.session_resumed
        self._sequence, self.offers = resumed.last_sequence, list(resumed.offers)
        self._have(ids_of(reply))

    def _opened(self, opened, epoch):
        self._epoch, self._closed = epoch, False
        names = lambda numbers: tuple(BY_NUMBER[number].name for number in numbers if number in BY_NUMBER)
        self.scene, self.warnings, self.bytes_per_node = opened.effective_scene, list(
            opened.warnings), opened.bytes_per_node
        self.name, self.strategy = opened.scene_name, STRATEGY.get(opened.strategy, opened.strategy)
        self.components = opened.tangential_components
        self.pairs, self.parameters = tuple(opened.pairs), tuple(opened.parameters)
        if self.history is not None:
            self.history._several = bool(self.pairs or self.parameters)
        self.columns, self.optional_columns = names(opened.required_columns), names(opened.optional_columns)
        self.reply_columns, self.columns_on_request = names(opened.reply_columns), names(opened.columns_on_request)
        self._wanted = self._numbers(self._want)
        if self.strategy != "force_driven":
            self._closure.mode = "off"

    # -- steps --

    def _numbers(self, want):
        """Returns the numbers of the columns of a reply: the default ones and those of `want`."""
        if not want:
            return ()
        ledger = [BY_NUMBER[number].name for number in LEDGER]
        names = [
            name for word in ([want] if isinstance(want, str) else want)
            for name in (ledger if word == "ledger" else [word])
        ]
        offered = (*self.reply_columns, *self.columns_on_request)
        for name in names:
            if name not in offered:
                raise MessageError(
                    Code.SHAPE,
                    f"want names {name!r}, which a reply of this scene cannot have{_similar(name, offered)}",
                    f"It can have {', '.join(offered)}; \"ledger\" stands for the energy ledger.", name)
        return tuple(dict.fromkeys(BY_NAME[name].number for name in (*self.reply_columns, *names)))

    def _request(self, values, nodes):
        """Returns (columns, frame, nodes) of a step from its keywords."""
        named = nodes is not None
        rows = self.nodes if nodes is None else node_ids(nodes)
        plan = self._plans.get((named, *values)) or self._plan(named, tuple(values))
        columns, places = plan
        count = len(rows)
        frame = numpy.empty((len(columns), count))
        if named:
            frame[0].view(numpy.uint64)[:] = rows
        for name, at, width in places:
            value = values[name]
            if width == 1 and type(value) is numpy.ndarray and value.dtype is FLOAT and value.shape == (count,):
                frame[at] = value  # the usual case
            else:
                fill(frame[at : at + width], name, value)
        if not numpy.isfinite(frame[named:]).all():
            for name, at, width in places:
                check_finite(frame[at : at + width], name, rows)
        return columns, frame, rows

    def _require(self, capability, field):
        """Raises MessageError where the server lacks a capability that it may ignore without a word."""
        if capability not in self.welcome.capabilities:
            raise MessageError(Code.UNSUPPORTED,
                               f"the server (version {self.welcome.server_version}) has no {capability}",
                               "Use a newer server.", field)

    def _plan(self, named, names):
        """Returns (columns, places) of requests with these keywords: where each keyword's values begin in the frame,
        and in how many columns. Raises MessageError where a keyword is missing or unknown."""
        needed = self.columns
        if self.strategy == "force_driven" and any(name in STICK_FORM for name in names):
            self._require("stick_form", "stick_stress")
            needed = (*(name for name in needed if name not in FAR_FIELD_FORM), *STICK_FORM)
        known = (*needed, *self.optional_columns)
        for name in names:
            if name not in known:
                raise MessageError(
                    Code.SHAPE, f"a step of this scene ({self.strategy}) has no column {name!r}{_similar(name, known)}",
                    f"It needs {', '.join(needed)}" +
                    (f" and may have {', '.join(self.optional_columns)}." if self.optional_columns else "."), name)
        for name in needed:
            if name not in names:
                raise MessageError(
                    Code.SHAPE,
                    f"{name} is missing: a step of this scene ({self.strategy}) needs {', '.join(needed)}",
                    f"Pass {name}=, one value per node or one for all.", name)
        columns, places = [(NODE_ID.number, 0)] * named, []
        for name in names:
            width = self.components if BY_NAME[name].tangential else 1
            places.append((name, len(columns), width))
            columns += [(BY_NAME[name].number, component) for component in range(width)]
        plan = self._plans[(named, *names)] = tuple(columns), places
        return plan

    def _step(self, mode, dt, nodes, absent_nodes, time, step, attempt, commit_previous, all_or_nothing, want,
              values):
        columns, frame, rows = self._request(values, nodes)
        body = {"dt_s": _number("dt", dt), "time_s": _number("time", time), "step": _count("step", step),
                "attempt": _count("attempt", attempt), "mode": mode, "commit_previous": commit_previous,
                "wanted": self._wanted if want is None else self._numbers(want),
                "policy": ALL_OR_NOTHING if all_or_nothing else 0}
        if absent_nodes != "keep":
            if absent_nodes not in ABSENT_NODES:
                raise MessageError(Code.SHAPE, f"absent_nodes is {absent_nodes!r}",
                                   'Use "keep" or "open".', "absent_nodes")
            self._require("absent_nodes", "absent_nodes")
            body["absent_nodes"] = ABSENT_NODES[absent_nodes]
        watched = self._closure.mode != "off"
        if watched:
            self._closure.compare(columns, frame, rows, nodes is not None, body["dt_s"], commit_previous)
        body["commit_previous"] = commit_previous and not self._previous_committed
        if frame.shape[1] > self._max_rows:
            reply = self._in_parts(body, columns, frame, rows)
        else:
            reply = self._exchange("downscale", body, "upscale", columns, frame)
        self._previous_committed = False
        answer = Answer(reply, rows) if mode == ADVANCE else Trial(reply, rows, self)
        for warning in reply.header.upscale.warnings:
            self._closure.tell(warning)
        if watched:
            if commit_previous:
                self._closure.committed()
            self._closure.answered(columns, frame, rows, nodes is not None, body["dt_s"], answer, mode == ADVANCE)
        if self.history is not None:
            if commit_previous:
                self.history._commit()
            self.history._add(body, columns, frame, answer, committed=mode == ADVANCE)
        return answer

    def _in_parts(self, body, columns, frame, rows):
        """Makes a step of more rows than a message holds, in parts that the server commits as one. If a part has no
        answer in time, a repetition of the call goes on with that part. If a part is refused, the parts before it are
        dropped. Returns the replies as one."""
        count, limit = frame.shape[1], self._max_rows
        parts = -(-count // limit)
        step = xxh3(repr((sorted(body.items()), columns)).encode()), xxh3(memoryview(frame).cast("B"))
        if self._parts is None or self._parts[0] != step:
            self._parts = step, []
        replies = self._parts[1]
        values = frame[1:] if columns[0][0] == NODE_ID.number else frame
        columns = (NODE_ID.number, 0), *columns[len(frame) - len(values):]
        try:
            while len(replies) < parts:
                part = slice(len(replies) * limit, min(count, (len(replies) + 1) * limit))
                piece = numpy.empty((len(columns), part.stop - part.start))
                piece[0].view(numpy.uint64)[:] = rows[part]
                piece[1:] = values[:, part]
                numbered = {**body, "part": len(replies) + 1, "parts": parts,
                            "commit_previous": body["commit_previous"] and not replies}
                replies.append(self._exchange("downscale", numbered, "upscale", columns, piece))
        except Error as fault:
            if self._doubt is None and fault.code not in (Code.UNREACHABLE, Code.AUTH):
                self._parts = None
                if replies:
                    self._previous_committed = body["commit_previous"]
                    with contextlib.suppress(Error):  # the next step drops the parts, too
                        self._exchange("rollback", {}, "rolled_back")
            raise
        self._parts = None
        return joined(replies, [slice(first, first + limit) for first in range(0, count, limit)], sum)

    def step(self, dt, *, nodes=None, absent_nodes="keep", time=0.0, step=0, attempt=0, all_or_nothing=False,
             want=None, **values):
        """Makes one step of length `dt` (s) and keeps its result. Returns an Answer.

        values: the columns of the scene's strategy by name (`columns`, `optional_columns`), in SI units: one number for
        all rows, or an array of float64 of shape (N,), or (N, 2) with two tangential components. nodes: ids of the
        rows, for a step of some nodes; without it the rows are all nodes in the order of `nodes` of the session.
        absent_nodes: "keep" keeps the states of nodes that are not named, "open" steps them with P = 0, so that they
        cool. time (end of the step, s), step, attempt: the host's own, for records. all_or_nothing: where a node has no
        answer the step is refused (STEP_FAILED) and nothing changes; otherwise the node keeps its state and its row has
        Outcome.FAILED. want: names of more columns for this reply; "ledger" stands for the energy ledger."""
        return self._step(ADVANCE, dt, nodes, absent_nodes, time, step, attempt, False, all_or_nothing, want, values)

    def trial(self, dt, *, nodes=None, absent_nodes="keep", time=0.0, step=0, attempt=0, commit_previous=False,
              all_or_nothing=False, want=None, **values):
        """Makes one step from the committed states and waits for a decision. Returns a Trial: use it in a `with` block,
        or call commit() or rollback() of the session; another trial replaces it. commit_previous: first commits the
        trial that stands. The other arguments are those of step()."""
        return self._step(TRIAL, dt, nodes, absent_nodes, time, step, attempt, commit_previous, all_or_nothing, want,
                          values)

    def commit(self):
        """Keeps the result of the trial. Returns the state version."""
        version = self._exchange("commit", {}, "committed").header.committed.state_version
        self._closure.committed()
        if self.history is not None:
            self.history._commit()
        return version

    def rollback(self):
        """Drops the trial; without one it does nothing. Returns the state version."""
        version = self._exchange("rollback", {}, "rolled_back").header.rolled_back.state_version
        self._closure.rolled_back()
        if self.history is not None:
            self.history._drop()
        return version

    # -- marks --

    def mark(self, name):
        """Keeps nodes and committed states on the server under a name, such as that of a restart dump. Returns the
        names of the kept marks, oldest first: the server keeps the newest welcome.limits.max_marks."""
        names = list(self._exchange("mark", {"name": name}, "marked").header.marked.names)
        if self.history is not None:
            self.history._mark(name, names)
        return names

    def rollback_to(self, name):
        """Restores the nodes and states of a mark, and drops a trial. Returns the state version."""
        reply = self._exchange("rollback", {"to_mark": name}, "rolled_back")
        self._have(ids_of(reply))
        if self.history is not None:
            self.history._rollback_to(name)
        return reply.header.rolled_back.state_version

    # -- profiles --

    def profiles(self, nodes, pressure=None):
        """Reads the layers of some nodes, vertex by vertex, from their committed states; changes nothing. pressure
        (Pa): a number or an array (N,), at which the flow stress is evaluated; None: 0.

        Returns Profiles of N nodes and V vertices in ascending z, in SI units. A scene that keeps no profile is a
        MessageError (UNSUPPORTED), which gives the reason."""
        named = node_ids(nodes)
        columns = ((NODE_ID.number, 0),) if pressure is None else ((NODE_ID.number, 0), (BY_NAME["pressure"].number, 0))
        frame = numpy.empty((len(columns), len(named)))
        frame[0].view(numpy.uint64)[:] = named
        if pressure is not None:
            fill(frame[1:], "pressure", pressure)
            check_finite(frame[1:], "pressure", named)
        self._check_open()
        return self._read_profiles(named, columns, frame)

    def _read_profiles(self, named, columns, frame):
        for restarts in range(MOST_RESTARTS + 1):
            envelope = {"request_id": self._connection.next_request_id(), "session_id": self._id, "epoch": self._epoch}
            try:
                return Profiles(self._send(envelope, "read_profiles", {}, "profiles", columns, frame), named)
            except Error as fault:
                if not self._tells_restart(fault) or restarts == MOST_RESTARTS:
                    raise
                self._follow_restart(fault)

    # -- the set of nodes --

    def register(self, nodes, initial_temperature=None, pair=None, parameters=None):
        """Adds nodes behind the present ones. initial_temperature (K): a number or an array (N,); None: the scene's. pair
        and parameters: as in open(); parameters of all keys of the opening, or None: the values of the pairs."""
        new = node_ids(nodes)
        names, places = pairs_of(pair, len(new))
        self._exchange("register_nodes", {"pairs": names}, "nodes_changed",
                       *named_nodes(new, initial_temperature, places, in_order(parameters, self.parameters)))
        self._have(numpy.concatenate([self.nodes, new]))
        self._remember(new, initial_temperature, pair, parameters)

    def _remember(self, nodes, initial_temperature, pair, parameters):
        """The history's file has what nodes were registered with."""
        if self.history is not None:
            self.history._registered(nodes, initial_temperature, pair, parameters)

    def retire(self, nodes):
        """Removes nodes and frees their states."""
        gone = node_ids(nodes)
        self._exchange("retire_nodes", {}, "nodes_changed", *named_nodes(gone))
        self._remove(gone)

    def offer(self, nodes):
        """Offers nodes with their states to another session of the domain. Returns the 16 bytes under which that
        session accepts them. From then on the nodes wait on the server and are not this session's."""
        given = node_ids(nodes)
        transfer = self._transfer = self._transfer or os.urandom(
            16)  # an offer whose outcome is unknown keeps its number
        self._exchange("offer_nodes", {"transfer_id": transfer}, "nodes_changed", *named_nodes(given))
        self._transfer = b""
        self._remove(given)
        return transfer

    def accept(self, transfer):
        """Accepts the nodes of an offer behind the present ones. Returns their ids."""
        taken = ids_of(self._exchange("accept_nodes", {"transfer_id": transfer}, "nodes_changed"))
        self._have(numpy.concatenate([self.nodes, taken]))
        return taken

    def _remove(self, gone):
        self._have(self.nodes[~numpy.isin(self.nodes, gone)])

    def _have(self, nodes):
        """The session has other nodes, or other states, from now on."""
        self.nodes = _frozen(nodes)
        self._closure.forget()

    # -- the end --

    @property
    def ticket(self):
        """Text by which shearbus.resume() continues this session after this process has ended. A secret: its holder
        owns the session."""
        return f"{self._id.hex()}:{self._token.hex()}"

    def close(self):
        """Closes the session, frees its states and ends a server of its own. Returns the session's totals: requests,
        node_steps, solver_ns, asleep_node_steps. After an error the session is still this client's: call close() again, or
        leave()."""
        totals = self._close()
        self.leave()
        return totals

    def _close(self):
        try:
            return self._exchange("close_session", {}, "session_closed").header.session_closed
        except SessionError as fault:
            # An interrupted request had run after all: the session now stands behind it.
            if fault.code != Code.SEQUENCE_REUSED:
                raise
            return self._exchange("close_session", {}, "session_closed").header.session_closed

    def leave(self):
        """Leaves the session open on the server, to be resumed by its ticket, and disconnects."""
        self._closed = True
        self._connection.close()
        if self._connection.recorder:
            self._connection.recorder.close()
        if self._server is not None:
            self._server.close()

    def __enter__(self):
        return self

    def __exit__(self, kind, *_):
        if self._closed:
            return
        if kind is not None and issubclass(kind, (Unreachable, UnknownOutcome)):
            self.leave()  # the server does not answer: to ask it once more would only cost the host another deadline
            return
        try:
            with contextlib.suppress(Error) if kind is not None else contextlib.nullcontext():
                self.close()
        finally:
            self.leave()

    def __repr__(self):
        state = "closed" if self._closed else f"{len(self.nodes)} nodes"
        return f"<shearbus.Session {self.name!r}, {self.strategy}, {state}, at {self._endpoint}>"


def _frozen(array):
    array.setflags(write=False)
    return array


def joined(replies, rows, total):
    """Returns replies to pieces of a step as one reply. rows: the places of each reply's rows in the whole; total: sum
    or max, of the times of the pieces."""
    layouts = [reply.header.payload.columns.parts for reply in replies]
    upscales = [reply.header.upscale for reply in replies]
    count, size, columns = sum(upscale.nodes for upscale in upscales), 0, {}
    for name, places in layouts[0].items():
        columns[name] = []
        for place in places:
            columns[name].append(types.SimpleNamespace(element=place.element, count=count, offset_bytes=size))
            size += -(-count * DTYPE[place.element].itemsize // 8) * 8
    payload = numpy.empty(size // 8).view(numpy.uint8)
    for reply, layout, own in zip(replies, layouts, rows):
        for name, places in layout.items():
            for place, whole in zip(places, columns[name]):
                dtype = DTYPE[place.element]
                values = numpy.frombuffer(reply.payload, dtype, place.count, place.offset_bytes) if place.count else []
                numpy.ndarray((count, ), dtype, payload, whole.offset_bytes)[own] = values
    worst = max((one for one in upscales if one.nodes), key=lambda one: one.largest_closure_m_per_s,
                default=upscales[0])
    upscale = types.SimpleNamespace(
        nodes=count, state_version=upscales[-1].state_version, solver_ns=total(one.solver_ns for one in upscales),
        service_ns=total(one.service_ns for one in upscales), flagged_nodes=sum(one.flagged_nodes for one in upscales),
        largest_closure_m_per_s=worst.largest_closure_m_per_s, closure_node=worst.closure_node,
        layer_time_s=worst.layer_time_s,
        warnings=list(dict.fromkeys(warning for one in upscales for warning in one.warnings)))
    header = types.SimpleNamespace(
        upscale=upscale, replayed=any(reply.header.replayed for reply in replies),
        payload=types.SimpleNamespace(columns=types.SimpleNamespace(parts=columns)))
    return types.SimpleNamespace(header=header, payload=memoryview(payload) if size else b"",
                                 round_trip_s=total(reply.round_trip_s for reply in replies))


def nodes_in(reply):
    """Returns (ids, names of the pairs or None, {key: array} of the parameters) of a reply session_resumed."""
    opened, pair, parameters = reply.header.session_resumed.session, None, {}
    for column in reply.header.payload.columns if reply.payload is not None else ():
        values = numpy.frombuffer(reply.payload, DTYPE[column.element], column.count, column.offset_bytes)
        if column.field == PAIR.number:
            names = ["", *opened.pairs]
            pair = [names[place] for place in values.tolist()]
        elif column.field == PARAMETER.number:
            parameters[opened.parameters[column.component]] = _frozen(values.astype(float))
    return ids_of(reply), pair, parameters


def check_nodes(ids, pair, parameters, nodes, expected_pair, expected_parameters):
    """Raises SessionError where a resumed session does not have `nodes` with these names of pairs (None: not compared)
    and {key: values} of parameters."""
    faults = {}
    row_of = {node: row for row, node in enumerate(ids.tolist())}
    for i, node in enumerate(nodes.tolist()):
        row = row_of.get(node)
        if row is None:
            faults[node] = f"node {node} is not in the session, which has {len(row_of)} nodes"
            continue
        has = pair[row] if pair is not None else ""
        if expected_pair is not None and has != expected_pair[i]:
            faults[node] = f'node {node} has the pair "{has}" in the session, the host "{expected_pair[i]}"'
        for key, values in expected_parameters.items():
            if key not in parameters:
                raise SessionError(Code.RESUME_REFUSED, f"{key} is no parameter of the nodes of this session",
                                   "The opening of a session chooses the keys.", key)
            if parameters[key][row] != values[i]:
                faults.setdefault(node, f"{key} of node {node} is {parameters[key][row]} in the session, "
                                  f"{values[i]} of the host")
    if faults:
        raise SessionError(
            Code.RESUME_REFUSED,
            f"{next(iter(faults.values()))} ({len(faults)} of {len(nodes)} nodes are not as expected)",
            "Resume with the nodes as they were registered, or open a new session. The session was left as it is.",
            nodes=list(faults)[:16])


def ids_of(reply):
    """Returns the column node_id of a reply, as an array of its own."""
    if reply.payload is None:
        return _frozen(numpy.empty(0, numpy.uint64))
    for column in reply.header.payload.columns:
        if column.field == NODE_ID.number:
            return _frozen(
                numpy.frombuffer(reply.payload, DTYPE[UINT64], column.count, column.offset_bytes).astype(numpy.uint64))
    raise UnexpectedReply(Code.UNEXPECTED_REPLY, "the reply has no column node_id",
                          "Is it a shearbus server of this version?")


def _number(name, value):
    try:
        return float(value)
    except (TypeError, ValueError):
        raise MessageError(Code.SHAPE, f"{name} is {value!r}, expected a number of seconds", field=name) from None


def _count(name, value):
    try:
        if operator.index(value) >= 0:
            return operator.index(value)
    except TypeError:
        pass
    raise MessageError(Code.SHAPE, f"{name} is {value!r}, expected a whole number from 0 on", field=name)


def _similar(name, known):
    found = difflib.get_close_matches(name, known, 1)
    return f'; did you mean "{found[0]}"?' if found else ""
