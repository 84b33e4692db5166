"""The Python client of the shearbus subgrid service: the library libshearbus with numpy's manners.

    import shearbus

    with shearbus.open("friction.toml", nodes=range(10)) as bus:        # a server in this process
        answer = bus.step(1e-9, jump=jump, pressure=11.2e9, stress_soft=soft, stress_hard=hard,
                          mass_soft=m_soft, mass_hard=m_hard)
        answer.stress, answer.slip, answer.temperature, answer.jump_new   # read-only arrays (N,), SI units

All quantities are SI: m, s, kg, K, Pa. Names of columns and their meaning: proto/WIRE.md, "The payload"; a step's
keywords and an answer's attributes are the names of shearbus.columns.COLUMNS."""
from . import columns, errors
from ._library import VERSION as __version__
from .answer import Answer, Outcome, Profiles, Regime, Trial
from .columns import COLUMNS
from .errors import (AuthError, ClosureError, ClosureWarning, Code, ContentError, Error, LibraryError, MessageError,
                     SceneWarning, ServerError, SessionError, UnexpectedReply, UnknownOutcome, Unreachable, WrongType,
                     WrongValue)
from .history import History
from .scene import Scene
from .session import Session, Welcome, open, resume

__all__ = [
    "Answer", "AuthError", "COLUMNS", "ClosureError", "ClosureWarning", "Code", "ContentError", "Error", "History",
    "LibraryError", "MessageError", "Outcome", "Profiles", "Regime", "Scene", "SceneWarning", "ServerError", "Session",
    "SessionError", "Trial", "UnexpectedReply", "UnknownOutcome", "Unreachable", "Welcome", "WrongType", "WrongValue",
    "columns", "errors", "open", "resume"
]


def __dir__():
    return [*__all__, "__doc__", "__version__"]
