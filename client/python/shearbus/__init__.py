"""The Python client of the shearbus subgrid service: pure Python over pyzmq and numpy.

    import shearbus

    with shearbus.open("friction.toml", nodes=range(10)) as bus:        # starts a server of its own
        answer = bus.step(1e-9, jump=jump, pressure=11.2e9, stress_soft=soft, stress_hard=hard,
                          mass_soft=m_soft, mass_hard=m_hard)
        answer.stress, answer.slip, answer.temperature, answer.jump_new   # read-only arrays (N,), SI units

All quantities are SI: m, s, kg, K, Pa. Names of columns and their meaning: proto/WIRE.md, "The payload"; a step's
keywords and an answer's attributes are the names of shearbus.columns.COLUMNS."""
import contextlib
import os
import pathlib

import numpy

from . import columns, errors
from .columns import COLUMNS
from .closure import ClosureWarning
from .connection import Connection
from .errors import (AuthError, ClosureError, Code, ContentError, Error, MessageError, ServerError, SessionError,
                     UnexpectedReply, UnknownOutcome, Unreachable)
from .history import History
from .recorder import Recorder
from .scene import Scene, toml_of
from .server import Server
from .session import (Answer, Outcome, Profiles, Regime, Session, Trial, fill, in_order, named_nodes, node_ids,
                      pairs_of)
from .shards import ShardedSession, endpoints_in

__version__ = "0.1.0"
__all__ = [
    "Answer", "AuthError", "COLUMNS", "ClosureError", "ClosureWarning", "Code", "ContentError", "Error", "History",
    "MessageError", "Outcome", "Profiles", "Regime", "Scene", "Server", "ServerError", "Session", "SessionError", "Trial",
    "UnexpectedReply", "UnknownOutcome", "Unreachable", "open", "resume"
]

_doubted = {}  # an opening whose outcome is unknown: its contents -> request id, session id, token


def open(scene, nodes=(), endpoint=None, *, initial_temperature=None, pair=None, parameters=None, domain="", want=(),
         record=False, closure="warn", idle_limit=0, **connection):
    """Opens a session: one shear layer for each node. Returns a Session, which is a context manager.

    scene: path of a TOML file, TOML text (anything with a line break), or a dict. nodes: distinct whole numbers from 0
    on; none only in a domain. endpoint: tcp://host:port, ipc://path, or file://path of a server's endpoint file; several
    with commas between them, or file://path of a directory of endpoint files, divide the nodes over several servers
    (proto/WIRE.md, "Several servers"); None starts a server, which ends with the session. initial_temperature (K): a
    number or an array (N,); None: the scene's. pair: name of a table [pair.NAME] of the scene for all nodes, or a list of
    one name per node, "" for the tables outside; None: these for all nodes. parameters: a dict of number-valued keys of
    the scene, as "interface.friction_coefficient", with a number or an array (N,) each, by which the nodes differ: an
    ensemble is one session. domain: sessions of a domain share their node ids, and nodes move
    between them. want: names of columns that every reply shall have in addition
    ("ledger": the energy ledger). record: keeps a history. closure: what a
    force-driven host meets whose jump is not the jump that its last step answered, "warn", "error" or "off"
    (shearbus.closure.ClosureCheck). idle_limit (s): the server closes the session after so long without a request; 0:
    never. connection: server_key and key, files of the server's public
    and the client's secret key, for tcp; name, for the server's log; connect_deadline (5), reply_deadline (60, of every
    call, retries included) and retry_after (5), after which a request is sent again, in seconds.

    The environment variables SHEARBUS_ENDPOINT, SHEARBUS_SCENE and SHEARBUS_SECRET_KEY_FILE (paths) replace endpoint,
    scene and key;
    SHEARBUS_RECORD, a directory or a new file, gets an event log of the session (proto/wire/event_log.md). Raises an
    Error."""
    text, file = _scene(os.environ.get("SHEARBUS_SCENE") or scene)
    ids = node_ids(nodes)
    names, places = pairs_of(pair, len(ids))
    keys = list(parameters or {})
    payload = named_nodes(ids, initial_temperature, places, in_order(parameters, keys))
    with _session(endpoint, want, record, closure, connection) as session:
        contents = (session._endpoint, text, file, domain, tuple(names), tuple(keys),
                    payload[1].tobytes() if len(ids) else b"")
        opening = _doubted.pop(contents, None) or (session._connection.next_request_id(), os.urandom(16),
                                                   os.urandom(16))
        request_id, session._id, session._token = opening
        if idle_limit:
            session._require("idle_limit", "idle_limit")
        for capability, given in (("pairs", names), ("parameters", keys)):
            if given:
                session._require(capability, capability)
        body = {"scene": text, "scene_file": file, "session_id": session._id, "resume_token": session._token,
                "domain": domain, "idle_limit_s": int(idle_limit),
                "check_closure": closure != "off" and "closure" in session.welcome.capabilities,
                "pairs": names, "parameters": keys}
        try:
            session._open(request_id, body, ids, *payload)
            session._remember(ids, initial_temperature, pair, parameters)
        except Error as fault:
            # The same arguments again are the same session, opened once.
            in_doubt = fault.code == Code.UNKNOWN_OUTCOME or int(fault.code) // 100 == 4
            if in_doubt and not session._opening_undone:
                _doubted[contents] = opening
            raise
    return session


def resume(ticket, endpoint=None, *, nodes=None, pair=None, parameters=None, want=(), record=False, closure="warn", **connection):
    """Continues the session of a client that has ended. ticket: Session.ticket of that client; the other arguments are
    those of open(). nodes, pair, parameters: what the host takes its nodes for, as in open(); where they are given and not
    those of the session, the call is refused (RESUME_REFUSED) and the session stays as it is. Returns a Session. Raises an
    Error."""
    try:
        session_id, token = (bytes.fromhex(part) for part in ticket.split(":"))
    except (AttributeError, ValueError):
        session_id = token = b""
    if len(session_id) != 16 or len(token) != 16:
        raise SessionError(Code.RESUME_REFUSED,
                           "the ticket is not two times 32 hexadecimal digits with a colon between",
                           "Pass Session.ticket as it was.", "ticket")
    if endpoint is None and not os.environ.get("SHEARBUS_ENDPOINT"):
        raise Unreachable(Code.UNREACHABLE, "a session is resumed where it was opened, and no endpoint was given",
                          "Give endpoint=.")
    with _session(endpoint, want, record, closure, connection) as session:
        session._id, session._token = session_id, token
        session._resume(_expected(nodes, pair, parameters))
    return session


def _expected(nodes, pair, parameters):
    """Returns (ids, names of pairs or None, {key: array}) of the nodes that a host resumes with; None without nodes."""
    if nodes is None:
        if pair is not None or parameters:
            raise MessageError(Code.SHAPE, "pair or parameters without nodes", "Give nodes=, too.", "nodes")
        return None
    ids = node_ids(nodes)
    names, places = pairs_of(pair, len(ids))
    values = numpy.empty((len(parameters or {}), len(ids)))
    for row, (key, given) in enumerate((parameters or {}).items()):
        fill(values[row:row + 1], key, given)
    return ids, None if places is None else [names[place] for place in places], dict(zip(parameters or {}, values))


@contextlib.contextmanager
def _session(endpoint, want, record, closure, options):
    """Connects to a server, or to several; disconnects, and ends a server of one's own, if the block fails."""
    endpoint = os.environ.get("SHEARBUS_ENDPOINT") or endpoint
    with contextlib.ExitStack() as undo:
        server = None
        if endpoint is None:
            server = undo.enter_context(Server())
        elif key := os.environ.get("SHEARBUS_SECRET_KEY_FILE"):
            options = {**options, "key": key}
        place = os.environ.get("SHEARBUS_RECORD")
        connections = []
        for one in [server.endpoint] if server else endpoints_in(endpoint):
            connections.append(Connection(one, **options))
            undo.callback(connections[-1].close)
        for number, connection in enumerate(connections):
            if place:
                in_directory = len(connections) == 1 or place.endswith("/") or os.path.isdir(place)
                connection.recorder = Recorder(place if in_directory else f"{place}.{number}")
        if len(connections) == 1:
            yield Session(connections[0], server, want, record, closure)
        else:
            yield ShardedSession(endpoint, connections, want, record, closure)
        undo.pop_all()


def _scene(scene):
    """Returns the text of a scene and the name by which the server cites it."""
    if isinstance(scene, dict):
        return toml_of(scene), "scene"
    if isinstance(scene, str) and "\n" in scene:
        return scene, "scene"
    try:
        return pathlib.Path(scene).read_text(), os.fspath(scene)
    except (OSError, UnicodeError) as fault:
        raise ContentError(Code.INVALID_SCENE, f"the scene {scene} cannot be read: {fault}",
                           "Pass the path of a TOML file, TOML text or a dict.", "scene") from None
    except TypeError:
        raise ContentError(Code.INVALID_SCENE,
                           f"the scene is {type(scene).__name__}, expected a path, TOML text or a dict",
                           field="scene") from None
