"""The errors of the package: one exception class for each class of status codes (proto/WIRE.md, "Status")."""
from ._contract import Code
from ._terminal import printable, printable_lines

__all__ = ["AuthError", "ClosureError", "ClosureWarning", "Code", "ContentError", "Error", "LibraryError", "MessageError",
           "SceneWarning", "ServerError", "SessionError", "UnexpectedReply", "UnknownOutcome", "Unreachable", "WrongType",
           "WrongValue"]


class Error(Exception):
    """A refused or failed call. Nothing was changed, except where the class says otherwise.

    code: a Code, or a plain number that this version does not know; text: what was expected and what was found;
    remedy: what to do; field: the field, column or keyword at fault; nodes: at most 16 node ids at fault."""

    def __init__(self, code, text, remedy="", field="", nodes=()):
        self.code = Code(code) if code in Code._value2member_map_ else code
        text = (printable_lines if code == Code.INVALID_SCENE else printable)(text)  # the faults of a scene are several
        remedy, field = printable(remedy), printable(field)
        self.text, self.remedy, self.field = text, remedy, field
        self.nodes = list(nodes)
        name = self.code.name if isinstance(self.code, Code) else str(code)
        super().__init__(f"{name}: {text}" + (f" ({remedy})" if remedy else ""))


class MessageError(Error):
    """1xx: the request is not as the protocol asks: missing, surplus or wrongly shaped columns."""


class WrongType(MessageError, TypeError):
    """An argument has a type that it cannot have."""


class WrongValue(MessageError, ValueError):
    """An argument has a value that it cannot have."""


class SessionError(Error):
    """2xx: the two sides differ about what has happened in the session; or another thread is in a call on it (IN_USE), or it
    is of the process of which this one is a fork (OTHER_PROCESS)."""


class ContentError(Error):
    """3xx: a scene, a value or a node is refused; `field` and `nodes` name it."""


class ServerError(Error):
    """4xx: the server cannot serve the request now; the same call later is safe."""


class Unreachable(Error):
    """No server answers at the endpoint; nothing was sent."""


class UnknownOutcome(Error):
    """The request was sent and no reply came before the deadline: it may or may not have run. The same call with the
    same values is the same request: if it has run, the server answers it again without running it twice."""


class UnexpectedReply(Error):
    """The reply does not answer the request: server and client do not agree on the protocol."""


class AuthError(Error):
    """The server does not admit this client, or it is not the server that the client expects."""


class ClosureError(Error):
    """The host's jump is not the jump that its last step answered; the step was not sent."""


class LibraryError(Error, ImportError):
    """The library libshearbus is not there, cannot be loaded, or is of another version than this package."""


class ClosureWarning(UserWarning):
    """The host's jump is not the jump that its last step answered, or a step has doubtful times or units."""


class SceneWarning(UserWarning):
    """The server has opened the session and doubts something of its scene."""


_CLASSES = {1: MessageError, 2: SessionError, 3: ContentError, 4: ServerError}
_CLIENT_SIDE = {
    Code.UNREACHABLE: Unreachable, Code.UNKNOWN_OUTCOME: UnknownOutcome, Code.UNEXPECTED_REPLY: UnexpectedReply,
    Code.AUTH: AuthError, Code.NOT_CLOSED: ClosureError, Code.IN_USE: SessionError, Code.OTHER_PROCESS: SessionError
}


def error(code, text, remedy="", field="", nodes=()):
    """Returns the exception of a status code. A code that this version does not know is treated as its class."""
    kind = _CLIENT_SIDE.get(code) or _CLASSES.get(int(code) // 100, Error)
    return kind(code, text, remedy, field, nodes)
