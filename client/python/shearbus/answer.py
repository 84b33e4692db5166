"""What a session answers: the columns of a step, a trial that waits for a decision, the profiles of layers."""
import contextlib
import html
import struct

import numpy

from ._contract import Outcome, Regime
from ._values import frozen
from .columns import BY_NAME, BY_NUMBER, PROFILE
from .errors import Error

__all__ = ["Answer", "Outcome", "Profiles", "Regime", "Trial"]

RESULT = struct.Struct("@N6QdQdi")  # shearbus_result
SHOWN = 5  # rows of a representation


class Answer:
    """The answer to a step. Each column of the reply is an attribute: stress, slip, temperature, jump_new,
    friction_heat, regime, outcome, ..., a read-only array of shape (N,), or (N, 2) with two tangential components, in
    SI units and in the order of the request's rows.

    nodes: ids of the rows; state_version: number of commits so far; flagged_nodes: rows with an outcome other than
    success and asleep; solver_s, service_s, round_trip_s: times; replayed: whether the server sent a kept reply;
    largest_closure (m/s), closure_node, layer_time (s): the largest difference of a node's jump from the jump that it
    was answered before, the node, and the time of its layer; 0 with check_closure="off"."""

    FACTS = ("state_version", "flagged_nodes", "solver_s", "service_s", "round_trip_s", "largest_closure", "closure_node",
             "layer_time", "replayed")

    def __init__(self, nodes, layout, block, result):
        """layout: {column: (dtype, shape, offset in the block)}; block: the bytes of the columns, which nobody can write;
        result: those of a shearbus_result."""
        self.nodes, self._layout, self._block, self._result = nodes, layout, block, result

    @property
    def columns(self):
        """Names of the columns of the reply."""
        return tuple(self._layout)

    def __getattr__(self, name):
        own = self.__dict__
        if name not in self.FACTS or "_result" not in own:
            hint = "; ask for it with want=" if name in BY_NAME else ""
            raise AttributeError(f"the reply has no column {name}: it has {', '.join(own.get('_layout', ()))}{hint}")
        _, _, flagged, version, solver, service, round_trip, closure, node, time, replayed = RESULT.unpack_from(self._result)
        own.update(zip(self.FACTS, (version, flagged, solver * 1e-9, service * 1e-9, round_trip * 1e-9, closure, node, time,
                                    bool(replayed))))
        return own[name]

    def __getstate__(self):
        return {name: value for name, value in self.__dict__.items() if name in ("nodes", "_layout", "_block", "_result")}

    def __setstate__(self, state):
        self.__dict__.update(state)

    def __dir__(self):
        return [*(name for name in super().__dir__() if name not in BY_NAME), *self.FACTS, *self._layout]

    def __repr__(self):
        lines = [f"<{type(self).__name__} of {len(self.nodes)} nodes, state version {self.state_version}, "
                 f"{self.flagged_nodes} flagged"]
        lines += [f"  {name:<18} {numpy.array2string(getattr(self, name), threshold=2 * SHOWN, edgeitems=SHOWN // 2)}{unit_of(name)}"
                  for name in self._layout]
        return "\n".join(lines) + ">"

    def _repr_html_(self):
        rows = [*range(len(self.nodes))]
        if len(rows) > 2 * SHOWN:
            rows = [*rows[:SHOWN], None, *rows[-SHOWN:]]
        table = [["node", *(name + unit_of(name) for name in self._layout)]]
        table += [["..."] * len(table[0]) if row is None else
                  [self.nodes[row], *(shown(getattr(self, name)[row]) for name in self._layout)] for row in rows]
        return html_table(f"{type(self).__name__} of {len(self.nodes)} nodes, state version {self.state_version}, "
                          f"{self.flagged_nodes} flagged", table)


class _Values:
    """A column of an Answer, made an array when it is first asked for."""

    def __init__(self, name):
        self.name = name

    def __get__(self, answer, kind):
        if answer is None:
            return self
        if self.name not in answer._layout:
            return answer.__getattr__(self.name)
        dtype, shape, begin = answer._layout[self.name]
        array = answer.__dict__[self.name] = numpy.ndarray(shape, dtype, answer._block, begin)
        return array


for _name in BY_NAME:
    setattr(Answer, _name, _Values(_name))


class Trial(Answer):
    """The answer to a trial, and the `with` block that decides it: leaving the block commits the trial; an exception,
    or reject() before the end of the block, rolls it back."""

    _session = None
    _rejected = False

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

    def __init__(self, nodes, state_version, arrays):
        """arrays: {number of a column: array (components, N, V)}."""
        self.nodes, self.state_version = nodes, state_version
        for number in PROFILE:
            array = arrays[number]
            name = BY_NUMBER[number].name
            if numpy.isnan(array).all():
                array = None
            elif name in ("position", "width"):
                array = frozen(array[0, 0].copy())
            else:
                array = frozen(array[0] if len(array) == 1 else numpy.stack(array, axis=-1))
            setattr(self, name, array)

    def __repr__(self):
        return f"<Profiles of {len(self.nodes)} nodes at {len(self.position)} vertices>"


def unit_of(name):
    unit = BY_NAME[name].unit
    return f" [{unit}]" if unit else ""


def shown(value):
    if numpy.ndim(value):
        return ", ".join(map(shown, value))
    return f"{value:.6g}" if isinstance(value, (float, numpy.floating)) else str(value)


def html_table(title, rows):
    """Returns an HTML table of rows of cells; the first row is its head."""
    def line(cells, tag):
        return "<tr>" + "".join(f"<{tag}>{html.escape(str(cell))}</{tag}>" for cell in cells) + "</tr>"

    return (f"<table><caption>{html.escape(title)}</caption>{line(rows[0], 'th')}"
            f"{''.join(line(row, 'td') for row in rows[1:])}</table>")
