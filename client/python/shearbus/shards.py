"""Several servers as one: which servers an endpoint names, which of them has a node, under which names they know a
session, and the session over all of them (proto/WIRE.md, "Several servers")."""
import contextlib
import heapq
import os
import pathlib
import re
import time
from types import SimpleNamespace

import numpy

from .checksum import xxh3
from .columns import DTYPE, NODE_ID, UINT64
from .connection import FILE_SCHEME
from .errors import Code, ContentError, Error, MessageError, SessionError, UnexpectedReply, UnknownOutcome, error
from .session import ADVANCE, TRIAL, Profiles, Session, ids_of, joined, named_nodes

MOST_NODES_NAMED = 16  # in an error
COMMIT, ROLLBACK = ("commit", {}, "committed"), ("rollback", {}, "rolled_back")
TORN_REMEDY = "Roll back to a mark that all shards have, or start again from the host's restart point."
REFUSALS = frozenset((Code.NOTHING_TO_COMMIT, Code.UNKNOWN_MARK, Code.TRIAL_STANDS, Code.UNKNOWN_TRANSFER,
                      Code.NOT_PERMITTED))
RANK = {"process": 1, "power": 2}  # of a durability; the weakest of the servers is that of the session


def endpoints_in(text):
    """Returns the endpoints in a text: one, or several with a comma between them; a directory of endpoint files
    (file://DIR) stands for its files in the order of their names. Raises ContentError for an endpoint that is empty or
    named twice, and for a directory without endpoint files."""
    if not isinstance(text, str):
        return [text]
    found = []
    # A comma that no endpoint follows is part of a path.
    for one in re.split(r",(?=[, ]*(?:(?:tcp|ipc|inproc|file)://|$))", text):
        one = one.strip(" ")
        if not one and text:
            raise ContentError(Code.INVALID_VALUE, f"the list of endpoints {text!r} has an empty endpoint",
                               "Give the endpoint of each server once, with one comma between two of them.", "endpoint")
        path = one.removeprefix(FILE_SCHEME)
        found += _files_in(path) if path != one and os.path.isdir(path) else [one]
    for one in found:
        if found.count(one) > 1:
            raise ContentError(Code.INVALID_VALUE, f"the endpoint {one} is named twice",
                               "Give the endpoint of each server once.", "endpoint")
    return found


def _files_in(directory):
    try:
        files = [file for file in sorted(pathlib.Path(directory).iterdir())
                 if file.is_file() and file.suffix != ".partial"]
        fault = "has no endpoint files; is a server running?"
    except OSError as cause:
        files, fault = [], cause.strerror
    if not files:
        raise ContentError(Code.INVALID_VALUE, f"{directory}: {fault}",
                           "Start all servers of the run with --endpoint-file, and wait for each of them: "
                           "shearbus-ctl wait --server file://FILE.", "endpoint")
    return [f"{FILE_SCHEME}{file}" for file in files]


def _mixed(x):
    """The mixing function of SplitMix64, of an array of uint64."""
    x = (x ^ (x >> numpy.uint64(30))) * numpy.uint64(0xbf58476d1ce4e5b9)
    x = (x ^ (x >> numpy.uint64(27))) * numpy.uint64(0x94d049bb133111eb)
    return x ^ (x >> numpy.uint64(31))


def shard_of(nodes, shards):
    """Returns the shard of each node of an array of uint64, from 0 to shards - 1, by rendezvous hashing: another shard
    behind the last one takes 1 in (shards + 1) of the nodes and moves no other node."""
    seed, increment = _mixed(nodes), 0x9e3779b97f4a7c15
    return numpy.argmax([_mixed(seed + numpy.uint64((k + 1) * increment % 2**64)) for k in range(shards)], axis=0)


def session_of_shard(session_id, shard, shards):
    """Returns the id by which a shard knows a session. So a ticket that is used with another list of servers finds no
    session."""
    mask = int(_mixed(numpy.array([(shards << 32) + shard + 1], numpy.uint64))[0])
    return (int.from_bytes(session_id[:8], "little") ^ mask).to_bytes(8, "little") + session_id[8:]


def domain_of_shard(domain, shard, shards):
    """Returns the domain by which a shard knows a session. A server refuses two shards of one domain."""
    return f"{domain}#{shard}/{shards}"


class Operation:
    """A call that some shards have run and others have not answered. question: what identifies the same call; steps: a
    generator that yields {shard: request}, gets {shard: reply or refusal}, and returns the reply to the call."""

    def __init__(self, question, steps):
        self.question, self.steps = question, steps
        self.requests, self.outcomes = {}, {}  # those of the present step
        self.may_have_run = False


class ShardedSession(Session):
    """A Session whose nodes several servers hold, its shards. A call becomes a request to every shard that it concerns,
    sent to all at once. While the outcome on a shard is unknown, the call is under way: the same call goes on with it,
    and any other call completes it first.

    In addition to Session: nodes of a resumed session are in ascending order if those of every shard are; after a
    refused step no trial stands."""

    def __init__(self, endpoint, connections, want, record, closure):
        self._shards = [Session(connection, None, (), False, "off") for connection in connections]
        super().__init__(connections[0], None, want, record, closure)
        self._endpoint, self._deadline = endpoint, connections[0].reply_deadline
        self._order = numpy.empty(0, numpy.uint64)  # ids of the nodes in the order of the rows
        self._rows = []  # of each shard: the rows of its nodes
        self._marks = {}  # order of the rows at each mark
        self._trial_stands = False
        self._trial_committed = False  # by a step that was then refused: its repetition must not commit again
        self._torn = ""  # why the shards are not at the same step

    def _greet(self):
        """Returns the Welcome of all shards together: the least that one of them has."""
        first, welcomes = self._shards[0], [shard.welcome for shard in self._shards]
        for k, shard in enumerate(self._shards):
            if shard._epoch in [other._epoch for other in self._shards[:k]]:
                raise ContentError(Code.INVALID_VALUE,
                                   f"{shard._endpoint} is a server that another endpoint of the list names, too",
                                   "Give the endpoint of each server once.", "endpoint")
            if shard.welcome.server_version != first.welcome.server_version:
                raise MessageError(
                    Code.VERSION, f"{shard._endpoint} is a server of version {shard.welcome.server_version}, and "
                    f"{first._endpoint} one of {first.welcome.server_version}",
                    "Start all servers of a run from the same version: others may answer with other bits.", "endpoint")
        limits = {name: min(getattr(one.limits, name) for one in welcomes) for name in vars(first.welcome.limits)}
        return SimpleNamespace(**{
            **vars(first.welcome), "limits": SimpleNamespace(**limits),
            "durability": min((one.durability for one in welcomes), key=lambda word: RANK.get(word, 0)),
            "capabilities": tuple(word for word in first.welcome.capabilities
                                  if all(word in one.capabilities for one in welcomes))
        })

    # -- a call --

    def _exchange(self, verb, body, answer, columns=None, frame=None):
        self._check_open()
        self._until = time.monotonic() + self._deadline
        question = verb, repr(sorted(body.items())), columns, b"" if frame is None else xxh3(frame.tobytes())
        if self._doubt and self._doubt.question != question:
            self._complete_before()
        if self._doubt is None:
            if self._torn and not body.get("to_mark"):
                raise SessionError(Code.EPOCH, self._torn, TORN_REMEDY)
            if verb == "commit" and self._trial_committed:
                self._trial_committed = False
                return _reply(committed=SimpleNamespace(state_version=self._version))
            self._begin(question, getattr(self, f"_{verb}")(body, columns, frame))
        return self._complete()

    def _complete_before(self):
        """Completes an earlier call. Returns if that is refused, so that the session is as before it."""
        try:
            self._complete()
        except Error:
            if self._doubt:
                raise
            return
        self._have(self._order)
        raise SessionError(Code.SEQUENCE_REUSED, "a call whose outcome was unknown has run on all shards",
                           "After an unknown outcome make the same call again.")

    def _begin(self, question, steps):
        self._ask_shards(Operation(question, steps), next(steps))

    def _ask_shards(self, operation, requests):
        operation.requests, operation.outcomes = requests, {}
        self._doubt = operation
        for k, (verb, body, _, *payload) in requests.items():
            self._shards[k]._post(self._shards[k]._next_envelope(), verb, body, *payload)

    def _complete(self):
        """Goes on with the call under way until its end. Returns the reply to it, or raises its refusal."""
        while True:
            outcomes = self._settle(self._doubt)
            try:
                self._ask_shards(self._doubt, self._doubt.steps.send(outcomes))
            except StopIteration as end:
                self._doubt = None
                return end.value
            except Error:
                self._doubt = None
                raise

    def _settle(self, operation):
        """Waits for the answers of all shards. Raises the first fault that leaves the outcome on a shard open."""
        unsettled = None
        for k, request in operation.requests.items():
            if k in operation.outcomes:
                continue
            try:
                operation.outcomes[k] = self._in_time(k)._exchange(*request)
                operation.may_have_run = True
            except Error as fault:
                if fault.code in REFUSALS or int(fault.code) // 100 in (1, 3):  # it was not run and cannot run later
                    operation.outcomes[k] = fault
                else:
                    operation.may_have_run |= fault.code not in (Code.UNREACHABLE, Code.AUTH)
                    unsettled = unsettled or fault
        if unsettled is None:
            return operation.outcomes
        if unsettled.code not in (Code.UNREACHABLE, Code.AUTH):
            raise unsettled
        if not operation.may_have_run:
            self._doubt = None
            raise unsettled
        raise UnknownOutcome(Code.UNKNOWN_OUTCOME, f"{unsettled.text}; other shards may have run the request",
                             "Make the same call again: where it has run, it is not run a second time.")

    def _in_time(self, k):
        """Returns a shard, whose next call has the time that is left to the call of the session."""
        shard = self._shards[k]
        shard._connection.reply_deadline = max(self._until - time.monotonic(), 0.001)
        return shard

    # -- the verbs: generators of an Operation --

    def _all(self, *request):
        return dict.fromkeys(range(len(self._shards)), request)

    def _downscale(self, body, columns, frame):
        named = columns[0][0] == NODE_ID.number
        rows = self._rows_of(frame[0].view(numpy.uint64)) if named else self._rows
        asked = {**body, "mode": TRIAL, "commit_previous": body["commit_previous"] and not self._trial_committed}
        last = body.get("part") == body.get("parts")
        # A shard without rows takes part, too, so that all shards count the same steps.
        answers = yield {k: ("downscale", asked, "upscale", columns, frame.take(own, 1)) for k, own in enumerate(rows)}
        refusal = _refusal(answers)
        if refusal:
            if not _only_refused(answers):
                if asked["commit_previous"]:
                    before = {k: COMMIT for k, outcome in answers.items() if _is_refusal(outcome)}
                    self._tear("the trial before cannot be committed", (yield before))
                    self._trial_committed = True
                self._trial_stands = False
                outcomes = yield self._all(*ROLLBACK)
                if not self._tear("a refused request cannot be undone", outcomes):
                    self._same_version("rolled_back", outcomes)
            raise refusal
        commits = body["mode"] == ADVANCE and last
        committed = None
        if commits:
            committed = yield self._all(*COMMIT)
            if self._tear("the commit of a step is refused", committed):
                raise SessionError(Code.EPOCH, self._torn, TORN_REMEDY)
        for k, own in enumerate(rows):
            if answers[k].header.upscale.nodes != len(own):
                raise UnexpectedReply(Code.UNEXPECTED_REPLY, f"shard {k} answers {answers[k].header.upscale.nodes} of "
                                      f"{len(own)} rows", "Are all servers of the same version?")
        reply = joined(list(answers.values()), rows, max)
        reply.header.upscale.state_version = self._same_version(*(("committed", committed) if commits else
                                                                  ("upscale", answers)))
        self._trial_stands, self._trial_committed = not commits and last, False
        return reply

    def _commit(self, body, *_):
        outcomes = yield self._all(*COMMIT)
        self._raise_refusal(outcomes, "the commit is refused")
        self._trial_stands = False
        return _reply(committed=SimpleNamespace(state_version=self._same_version("committed", outcomes)))

    def _rollback(self, body, *_):
        mark = body.get("to_mark")
        if mark and self._trial_stands:
            # First the trials, so that after a crash of this client none of them is taken for a step to be committed.
            yield self._all(*ROLLBACK)
            self._trial_stands = False
        outcomes = yield self._all("rollback", body, "rolled_back")
        self._raise_refusal(outcomes, "the rollback to a mark is refused")
        if mark:
            for k, reply in outcomes.items():
                self._shards[k]._have(ids_of(reply))
        version = self._same_version("rolled_back", outcomes)
        self._torn, self._trial_stands, self._trial_committed = "", False, False
        if mark and not self._place(self._marks.get(mark)):
            self._place(_merged(shard.nodes for shard in self._shards))
        return _reply(self._order, rolled_back=SimpleNamespace(state_version=version))

    def _mark(self, body, *_):
        outcomes = yield self._all("mark", body, "marked")
        self._raise_refusal(outcomes)
        kept = [reply.header.marked.names for reply in outcomes.values()]
        names = [name for name in kept[0] if all(name in others for others in kept)]
        self._marks[body["name"]] = self._order
        self._marks = {name: order for name, order in self._marks.items() if name in names}
        return _reply(marked=SimpleNamespace(names=names, state_version=self._same_version("marked", outcomes)))

    def _register_nodes(self, body, columns=None, frame=None):
        return self._change("register_nodes", body, columns, frame,
                            lambda nodes: ("retire_nodes", {}, "nodes_changed", *named_nodes(nodes)))

    def _retire_nodes(self, body, columns=None, frame=None):
        return self._change("retire_nodes", body, columns, frame, None)

    def _offer_nodes(self, body, columns=None, frame=None):
        return self._change("offer_nodes", body, columns, frame,
                            lambda nodes: ("accept_nodes", body, "nodes_changed"))

    def _change(self, verb, body, columns, frame, undo):
        """Registers, retires or offers nodes. undo(nodes): the request that takes it back on a shard."""
        ids = numpy.empty(0, numpy.uint64) if frame is None else frame[0].view(numpy.uint64)
        leaving = verb != "register_nodes"
        if leaving and self._trial_stands:
            raise SessionError(Code.TRIAL_STANDS, "a trial stands, and the set of nodes cannot change",
                               "Commit it or roll it back first.")
        strange = numpy.setdiff1d(ids, self._order)
        if leaving and strange.size:
            raise ContentError(Code.UNKNOWN_NODE, f"node {strange[0]} is not of this session",
                               "Name nodes of the session: its attribute nodes lists them.", "node_id",
                               map(int, strange[:MOST_NODES_NAMED]))
        rows_of = {k: rows for k, rows in enumerate(self._rows_of(ids)) if rows.size}
        asked = {k: (verb, body, "nodes_changed", columns, frame.take(rows, 1)) for k, rows in rows_of.items()}
        outcomes = yield asked or {0: (verb, body, "nodes_changed")}  # the first shard refuses a request without nodes
        ran = {k: ids[rows_of[k]] for k, outcome in outcomes.items() if not _is_refusal(outcome)}
        self._adopt_change(ran, leaving)
        refusal = _refusal(outcomes)
        if refusal:
            if undo:
                yield from self._undo({k: undo(nodes) for k, nodes in ran.items()}, ran, not leaving)
            raise refusal
        self._place(self._order[~numpy.isin(self._order, ids)] if leaving else numpy.concatenate([self._order, ids]))
        return _reply(nodes_changed=SimpleNamespace(nodes=len(self._order)))

    def _accept_nodes(self, body, *_):
        outcomes = yield self._all("accept_nodes", body, "nodes_changed")
        taken = {k: ids_of(reply) for k, reply in outcomes.items() if not _is_refusal(reply)}
        self._adopt_change(taken, False)
        # A shard that has none of the offered nodes knows no such offer.
        refusal = _refusal({k: outcome for k, outcome in outcomes.items()
                            if not (_is_refusal(outcome) and outcome.code == Code.UNKNOWN_TRANSFER)})
        if refusal is None and not taken:
            refusal = _refusal(outcomes)
        if refusal:
            back = {k: ("offer_nodes", body, "nodes_changed", *named_nodes(nodes)) for k, nodes in taken.items()}
            yield from self._undo(back, taken, True)
            raise refusal
        accepted = _merged(taken.values())
        self._place(numpy.concatenate([self._order, accepted]))
        return _reply(accepted, nodes_changed=SimpleNamespace(nodes=len(self._order)))

    def _undo(self, requests, nodes, leaving):
        """Takes a change of {shard: nodes} back."""
        outcomes = yield requests
        if not self._tear("a refused request cannot be undone", outcomes):
            self._adopt_change(nodes, leaving)
            self._place(self._order)  # their order on a shard may be another one now

    def _read_profiles(self, named, columns, frame):
        """Each shard answers with its nodes. The request changes nothing, so it is no call under way."""
        self._until = time.monotonic() + self._deadline
        rows = self._rows_of(named)
        asked = [k for k, own in enumerate(rows) if len(own)] or [0]  # no nodes: a shard refuses
        parts = [(rows[k], self._in_time(k)._read_profiles(named[rows[k]], columns, frame.take(rows[k], 1)))
                 for k in asked]
        return Profiles.joined(named, parts)

    # -- the shards together --

    def _adopt_change(self, nodes, leaving):
        for k, own in nodes.items():
            shard = self._shards[k]
            shard._remove(own) if leaving else shard._have(numpy.concatenate([shard.nodes, own]))

    def _rows_of(self, nodes):
        """Returns the rows of each shard, for rows that belong to these nodes."""
        shards = shard_of(nodes, len(self._shards))
        return [numpy.flatnonzero(shards == k) for k in range(len(self._shards))]

    def _place(self, order):
        """Makes `order` the order of the rows. Returns False, and changes nothing, if the shards have other nodes."""
        if order is None or sum(len(shard.nodes) for shard in self._shards) != len(order):
            return False
        by_id = numpy.argsort(order)
        rows = [by_id[numpy.searchsorted(order, shard.nodes, sorter=by_id).clip(max=len(order) - 1)]
                if len(shard.nodes) else by_id[:0] for shard in self._shards]
        if any((order[own] != shard.nodes).any() for own, shard in zip(rows, self._shards)):
            return False
        self._order, self._rows = order, rows
        return True

    def _raise_refusal(self, outcomes, torn=""):
        """Raises a refusal. torn: what it means if other shards have run the request."""
        refusal = _refusal(outcomes)
        if refusal and torn and not _only_refused(outcomes):
            self._tear(torn, outcomes)
        if refusal:
            raise refusal

    def _tear(self, what, outcomes):
        """Notes a refusal after which the shards are not at the same step. Returns whether there is one."""
        for k, outcome in outcomes.items():
            if _is_refusal(outcome):
                self._torn = f"the shards are not at the same step: {what} on shard {k}: {outcome}"
                return True
        return False

    def _same_version(self, kind, replies):
        versions = [getattr(reply.header, kind).state_version for reply in replies.values()]
        if len(set(versions)) > 1:
            self._torn = _versions_differ(versions)
            raise SessionError(Code.EPOCH, self._torn, TORN_REMEDY)
        self._version = versions[0]
        return self._version

    # -- begin and end --

    def _name_shard(self, k):
        shard, count = self._shards[k], len(self._shards)
        shard._id, shard._token = session_of_shard(self._id, k, count), self._token
        return shard

    def _open(self, request_id, body, nodes, columns, frame):
        self._until = time.monotonic() + self._deadline
        if not body["domain"] and not len(nodes):
            raise MessageError(Code.SHAPE, "a session without a domain needs at least one node; none was given",
                               "Give nodes, or a domain.", "node_id")
        count, openings, opened, refusal, unsettled = len(self._shards), [], {}, None, None
        for k, rows in enumerate(self._rows_of(nodes)):
            shard = self._name_shard(k)
            domain = domain_of_shard(body["domain"] or f"session {self._id.hex()}", k, count)
            payload = (columns, frame.take(rows, 1)) if rows.size else (None, None)
            openings.append(({**body, "session_id": shard._id, "domain": domain}, nodes[rows], *payload))
            shard._post({"request_id": request_id}, "open_session", openings[k][0], *payload)
        for k, opening in enumerate(openings):
            try:
                opened[k] = self._in_time(k)._open(request_id, *opening)
            except Error as fault:
                # The same opening again is the same session, so other refusals are no end.
                if int(fault.code) // 100 in (1, 2, 3) or fault.code == Code.DRAINING:
                    refusal = refusal or fault
                else:
                    unsettled = unsettled or fault
        if refusal:
            self._opening_undone = True
            for k in opened:
                with contextlib.suppress(Error):  # the server has the session until an operator closes it
                    self._in_time(k)._close()
            raise refusal
        if unsettled and unsettled.code == Code.UNREACHABLE and opened:
            raise error(Code.UNKNOWN_OUTCOME, unsettled.text, unsettled.remedy)
        if unsettled:
            raise unsettled
        self._place(nodes)
        self._have(nodes)
        self._take_opened(opened[0])

    def _resume(self, expected=None):
        self._until = time.monotonic() + self._deadline
        positions = []
        for k in range(len(self._shards)):
            shard = self._name_shard(k)
            try:
                positions.append(self._in_time(k)._resume())
            except SessionError as fault:
                if fault.code != Code.UNKNOWN_SESSION:
                    raise
                raise SessionError(
                    Code.UNKNOWN_SESSION, f"{shard._endpoint} does not have shard {k} of {len(self._shards)} of this "
                    f"session: {fault.text}", "Resume a session with the endpoints that it was opened with, all of "
                    "them, in the same order.") from None
        self._begin("resume", self._reconcile(positions))
        self._complete()
        self.offers = list(dict.fromkeys(offer for shard in self._shards for offer in shard.offers))
        self._place(_merged(shard.nodes for shard in self._shards))
        self._have(self._order)
        self._take_opened(positions[0].session)
        self._resumed(*self._joined_nodes(), expected)

    def _joined_nodes(self):
        """Returns pairs and parameters of the nodes of all shards, in the order of `nodes`."""
        if any(shard.resumed_pair is None for shard in self._shards if len(shard.nodes)):
            return None, {}
        own = {}
        for shard in self._shards:
            for row, node in enumerate(shard.nodes.tolist()):
                own[node] = shard.resumed_pair[row], [values[row] for values in shard.resumed_parameters.values()]
        rows = [own[node] for node in self.nodes.tolist()]
        return [name for name, _ in rows], {key: numpy.array([values[i] for _, values in rows])
                                            for i, key in enumerate(self.parameters)}

    def _reconcile(self, positions):
        """Brings resumed shards to the same step: of a commit that only some have run, the others run it now; a trial
        that does not stand on all of them is rolled back."""
        self._version = max(position.state_version for position in positions)
        behind = [k for k, one in enumerate(positions) if one.trial_stands and one.state_version + 1 == self._version]
        stands = [k for k, one in enumerate(positions) if one.trial_stands and k not in behind]
        self._trial_stands = len(stands) == len(positions)
        versions = [self._version if k in behind else one.state_version for k, one in enumerate(positions)]
        if len(set(versions)) > 1:
            self._torn, self._trial_stands, behind, stands = _versions_differ(versions), bool(stands), [], []
        self._tear("the commit of a successor is refused", (yield dict.fromkeys(behind, COMMIT)))
        if len(stands) < len(positions):
            self._tear("the rollback of a successor is refused", (yield dict.fromkeys(stands, ROLLBACK)))

    def _take_opened(self, first):
        """Takes over what the first shard tells of the scene, and the warnings of all shards."""
        self._opened(first, 0)
        self.warnings = list(dict.fromkeys(warning for shard in self._shards for warning in shard.warnings))

    def _close(self):
        self._until = time.monotonic() + self._deadline
        totals, fault = [], None
        for k in range(len(self._shards)):
            try:
                totals.append(self._in_time(k)._close())
            except Error as refusal:
                fault = fault or refusal
        if fault:
            raise fault
        return SimpleNamespace(**{name: sum(getattr(one, name) for one in totals) for name in vars(totals[0])})

    def leave(self):
        super().leave()
        for shard in self._shards:
            shard.leave()


def _reply(nodes=None, **bodies):
    """Returns a reply as a server makes it, with these nodes as its payload."""
    columns = () if nodes is None else (SimpleNamespace(field=NODE_ID.number, count=len(nodes), offset_bytes=0), )
    return SimpleNamespace(header=SimpleNamespace(payload=SimpleNamespace(columns=columns), **bodies),
                           payload=None if nodes is None else nodes.astype(DTYPE[UINT64]).tobytes())


def _is_refusal(outcome):
    return isinstance(outcome, Error)


def _only_refused(outcomes):
    return all(map(_is_refusal, outcomes.values()))


def _refusal(outcomes):
    """Returns the first refusal, with the nodes at fault of all refusals that have its code; None without one."""
    refusals = list(filter(_is_refusal, outcomes.values()))
    if refusals:
        refusals[0].nodes = [node for one in refusals if one.code == refusals[0].code
                             for node in one.nodes][:MOST_NODES_NAMED]
        return refusals[0]
    return None


def _merged(lists):
    """Joins arrays of ids: takes the least of their first ids, again and again."""
    return numpy.fromiter(heapq.merge(*(ids.tolist() for ids in lists)), numpy.uint64)


def _versions_differ(versions):
    return "the shards are not at the same step: their state versions are " + ", ".join(map(str, versions))
