"""The closure check: a force-driven host that applies the answered stress has, but for rounding, the jump that its last
step answered. A host that has another jump is told which single mistake would explain it."""
import warnings
from typing import Any, NamedTuple

import numpy

from .columns import BY_NAME
from .errors import ClosureError, Code, MessageError

RELATIVE, ABSOLUTE = 1e-6, 1e-6  # accepted difference: of the jump, and in addition m/s
STEPS_WATCHED = 100  # with "warn"
JUMP = BY_NAME["jump"].number
FAILED = 128  # bit of the column outcome


class ClosureWarning(UserWarning):
    """The host's jump is not the jump that its last step answered."""


class Step(NamedTuple):
    dt_before: float  # length of the step before, s; 0: not known
    dt: float
    columns: tuple  # (number, component) of the request
    frame: Any  # the request's values, one row per column
    nodes: Any
    named: bool  # the request names its nodes
    answer: Any

    def value(self, name, component=0):
        """Returns a column of the request; zeros where it has none."""
        key = (BY_NAME[name].number, component)
        return self.frame[self.columns.index(key)] if key in self.columns else numpy.zeros(self.frame.shape[1])


# A host with one mistake: factors of the old jump's balance, DLP (61),
#   [V]now = [V] + dt (soft s_soft/m_soft + hard s_hard/m_hard) - dt s (to_soft/m_soft + to_hard/m_hard)
# as (soft, hard, to_soft, to_hard); a factor of one side is that of the reciprocal of its mass, too.
FAR_FIELD = {
    "stress_soft has the wrong sign": (-1, 1, 1, 1),
    "stress_hard has the wrong sign": (1, -1, 1, 1),
    "stress_soft and stress_hard both have the wrong sign": (-1, -1, 1, 1),
    "jump has the wrong sign: it is V_soft - V_hard": (-1, -1, -1, -1),
    "the answered stress is applied with the wrong sign: it pulls the soft body back where the jump is positive":
        (1, 1, -1, -1),
    "the answered stress is applied to the soft body only": (1, 1, 1, 0),
    "the answered stress is applied to the hard body only": (1, 1, 0, 1),
    "the answered stress is not applied": (1, 1, 0, 0),
    "the answered stress is applied with the wrong sign to the soft body": (1, 1, -1, 1),
    "the answered stress is applied with the wrong sign to the hard body": (1, 1, 1, -1),
    "both masses must be twice those sent, or dt half of that sent": (.5, .5, .5, .5),
    "both masses must be half of those sent, or dt twice that sent": (2, 2, 2, 2),
    "mass_soft must be twice that sent": (.5, 1, .5, 1),
    "mass_soft must be half of that sent": (2, 1, 2, 1),
    "mass_hard must be twice that sent": (1, .5, 1, .5),
    "mass_hard must be half of that sent": (1, 2, 1, 2),
}
# The same for the balance in stick form, [V]now = (stick stress - s) / Z: factors of the stick stress, of the answer,
# and of the old jump in addition.
STICK = {
    "stick_stress has the wrong sign": (-1, 1, 0),
    "jump has the wrong sign: it is V_soft - V_hard": (-1, -1, 0),
    "stick_stress lacks the part of the old jump, impedance times jump": (1, 1, 1),
    "the answered stress is applied with the wrong sign: it pulls the soft body back where the jump is positive":
        (1, -1, 0),
    "the answered stress is not applied": (1, 0, 0),
    "impedance must be twice that sent, or the answered stress is applied to one side only": (1, .5, 0),
    "impedance must be half of that sent": (1, 2, 0),
    "jump is that of the predictor of a Newmark scheme: send that of the whole step before": (2, 2, -1),
}
SWAPPED = "the two sides of the stresses, or of the masses, are swapped"


def tolerance(jump):
    """Returns the accepted difference (m/s) from a jump (m/s)."""
    return RELATIVE * numpy.abs(jump) + ABSOLUTE


def mistakes(step, dt_now, rows, now):
    """Returns the texts of the mistakes that explain the jumps `now` (rows, components) of the rows of a step, in
    m/s."""
    def answered(component):
        return step.answer.stress[rows] if now.shape[1] == 1 else step.answer.stress[rows, component]

    def stick_jump(stick, answer, old):
        z = step.value("impedance")[rows]
        return numpy.stack([old * step.value("jump", c)[rows] + (stick * step.value("stick_stress", c)[rows]
                            - answer * answered(c)) / z for c in range(now.shape[1])], axis=1)

    def new_jump(soft, hard, to_soft, to_hard, dt=step.dt, crossed=False):
        parts = []
        for component in range(now.shape[1]):
            jump, s_soft, s_hard = (step.value(name, component)[rows]
                                    for name in ("jump", "stress_soft", "stress_hard"))
            m_soft, m_hard = step.value("mass_soft")[rows], step.value("mass_hard")[rows]
            own = (m_hard, m_soft) if crossed else (m_soft, m_hard)
            parts.append(jump + dt * (soft * s_soft / own[0] + hard * s_hard / own[1])
                         - dt * answered(component) * (to_soft / m_soft + to_hard / m_hard))
        return numpy.stack(parts, axis=1)

    def explains(jump):
        return (numpy.abs(now - jump) <= tolerance(now)).all()

    if (BY_NAME["impedance"].number, 0) in step.columns:
        return [text for text, factors in STICK.items() if explains(stick_jump(*factors))]
    found = [text for text, factors in FAR_FIELD.items() if explains(new_jump(*factors))]
    if explains(new_jump(1, 1, 1, 1, crossed=True)):
        found.append(SWAPPED)
    lengths = {
        "the velocities advance by the dt of this step, not by that of the last one": dt_now,
        "the velocities advance by the dt of the step before the last one": step.dt_before,
        "the velocities advance by the mean of the last dt and this one": (step.dt + dt_now) / 2,
        "the velocities advance by the mean of the last dt and the one before":
            (step.dt + step.dt_before) / 2 if step.dt_before else 0.0,
    }
    found += [text for text, dt in lengths.items()
              if dt > 0 and abs(dt - step.dt) > 1e-9 * step.dt and explains(new_jump(1, 1, 1, 1, dt=dt))]
    return found


class ClosureCheck:
    """Compares each request of a session with the answer that it continues from. mode: "warn" watches the first 100
    steps and warns once (ClosureWarning); "error" watches every step and raises ClosureError before the step is sent;
    "off" does nothing, for hosts whose jump has other changes, too, as where an interface turns."""

    def __init__(self, mode):
        if mode not in ("warn", "error", "off"):
            raise MessageError(Code.SHAPE, f"closure is {mode!r}", 'Use "warn", "error" or "off".', "closure")
        self.mode, self._steps, self._last, self._trial = mode, 0, None, None
        self.reported = None if mode == "off" else set()

    def tell(self, warning):
        """Passes on a warning of the server, one for each field that it is about."""
        field = warning.split(":")[0]
        if self.reported is not None and field not in self.reported:
            self.reported.add(field)
            warnings.warn(warning, ClosureWarning, stacklevel=4)

    def compare(self, columns, frame, nodes, named, dt, commit_previous):
        last = self._trial if commit_previous else self._last
        if last is None or last.named != named:
            return  # nothing to compare, or all nodes after some of them
        if nodes is last.nodes or numpy.array_equal(nodes, last.nodes):
            before = after = slice(None)
        else:
            _, before, after = numpy.intersect1d(last.nodes, nodes, return_indices=True)
        now = frame[[i for i, (number, _) in enumerate(columns) if number == JUMP]][:, after].T
        answered = numpy.reshape(last.answer.jump_new[before], now.shape)
        ratio = numpy.abs(now - answered) / tolerance(now)
        ratio[(last.answer.outcome[before] & FAILED) != 0] = 0  # a node without an answer has no answered jump
        if not (ratio > 1).any():
            return
        row, component = numpy.unravel_index(ratio.argmax(), ratio.shape)
        chosen = numpy.arange(last.frame.shape[1])[before]
        some = numpy.unique([row, *range(0, len(chosen), len(chosen) // 256 + 1)])
        found = mistakes(last, dt, chosen[some], now[some]) if "stress" in last.answer.columns else []
        text = (
            f"closure: the host brings a jump of {now[row, component]:.9g} m/s for node {nodes[after][row]}; its last "
            f"step was answered with {answered[row, component]:.9g} m/s, and a host that applies the answered stress has "
            f"that jump but for rounding ({(ratio > 1).any(axis=1).sum()} of {len(ratio)} nodes differ). " +
            (f"One change explains it: {'; or: '.join(found)}."
             if found else "No single mistake in signs, sides, masses or dt explains it. Are stresses in Pa and masses in "
             "kg/m2, is the answer applied times the area, is the jump that before the forces act? The guide's table of "
             "hosts (client/README.md) has hosts that change velocities in other ways."))
        if self.mode == "error":
            raise ClosureError(Code.NOT_CLOSED, text,
                               'The step was not sent. Correct the host, or open with closure="warn".', "jump",
                               [int(nodes[after][row])])
        self.mode = "off"
        warnings.warn(text, ClosureWarning, stacklevel=4)

    def answered(self, columns, frame, nodes, named, dt, answer, committed):
        known = "jump_new" in answer.columns and "outcome" in answer.columns
        self._trial = Step(self._last.dt if self._last else 0.0, dt, columns, frame, nodes, named,
                           answer) if known else None
        if committed:
            self.committed()

    def committed(self):
        self._last, self._trial, self._steps = self._trial, None, self._steps + 1
        if self.mode == "warn" and self._steps >= STEPS_WATCHED:
            self.mode = "off"
            self.forget()

    def rolled_back(self):
        self._trial = None

    def forget(self):
        self._last = self._trial = None
