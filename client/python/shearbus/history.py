"""The history of a session: what was sent and answered in every step that was kept."""
import contextlib
import datetime
import os
import tempfile
import tomllib
import warnings
from typing import Any, NamedTuple

import numpy

from ._contract import Outcome, Regime
from .answer import html_table, shown, unit_of
from .columns import BY_NAME, BY_NUMBER

__all__ = ["History"]

MASSES = ("mass_soft", "mass_hard")
REGIMES = {name: number for name, number in vars(Regime).items() if name.isupper()}
LEGENDS = {
    "regime": ", ".join(f"{number} {name.lower()}" for name, number in REGIMES.items()),
    "outcome": "0 ok, or a sum of: " + ", ".join(f"{number} {name.lower().replace('_', ' ')}" for name, number in vars(Outcome).items()
                                                 if name.isupper() and number & (number - 1) == 0)
}


@contextlib.contextmanager
def _partial(path):
    """Gives the name of a new file beside the history, which gets the history's name once it is whole."""
    import h5py

    path = os.path.realpath(path)  # a link is followed
    if os.path.lexists(path) and not (os.path.isfile(path) and os.path.getsize(path) == 0):
        kind = None
        with contextlib.suppress(OSError, KeyError), h5py.File(path) as older:
            if isinstance(older.get("meta", getlink=True), h5py.HardLink):
                kind = older["meta"].attrs.get("format")
        if kind != "shearbus-history":
            raise FileExistsError(f"{path}: is there and is no history; remove or rename it, or write elsewhere")
    number, partial = tempfile.mkstemp(prefix=os.path.basename(path) + ".", suffix=".partial", dir=os.path.dirname(path))
    os.close(number)
    try:
        yield partial
        mask = os.umask(0)
        os.umask(mask)
        os.chmod(partial, 0o666 & ~mask)
        os.replace(partial, path)
    except BaseException:
        os.unlink(partial)
        raise


class Row(NamedTuple):
    dt: float
    time: float
    step: int
    columns: tuple  # (number, component) of the request
    frame: Any  # the request's values, one row per column
    answer: Any


class History:
    """The steps of a session that were kept, in order; steps that were rolled back are not in it. A column of requests
    or replies is an attribute: an array of shape (T, N), or (T, N, 2) with two tangential components, in SI units. dt,
    time (end of the step), step: arrays (T,); nodes: ids (N,). The frames themselves are kept, so a history costs what
    its steps sent and received."""

    def __init__(self):
        self._rows, self._standing, self._marks = [], None, {}
        self._own, self._several = {}, False  # datasets of each node, by its id; whether nodes have pairs or parameters
        self._begun, self._scene = set(), ""  # nodes whose layers began in this session; effective scene

    # Called by the session.
    def _registered(self, nodes, *given):
        self._begun.update(nodes.tolist())
        self._known(nodes, *given)

    def _known(self, nodes, initial_temperature, pair, parameters):
        given = {"initial_temperature": initial_temperature, "pair": pair}
        given = {name: values for name, values in given.items() if values is not None}
        given |= {f"parameter/{key}": values for key, values in (parameters or {}).items()}
        columns = {name: [values] * len(nodes) if isinstance(values, str) or not numpy.ndim(values) else list(values)
                   for name, values in given.items()}
        for row, node in enumerate(nodes.tolist()):
            self._own[node] = {name: values[row] for name, values in columns.items()}

    def _add(self, dt, time, step, columns, frame, answer, committed):
        row = Row(dt, time or ((self._rows[-1].time if self._rows else 0.0) + dt), step, columns, frame, answer)
        self._standing = None if committed else row
        if committed:
            self._rows.append(row)

    def _commit(self):
        self._rows += [self._standing] if self._standing else []
        self._standing = None

    def _drop(self):
        self._standing = None

    def _mark(self, name, names):
        self._marks[name] = len(self._rows)
        self._marks = {kept: length for kept, length in self._marks.items() if kept in names}

    def _rollback_to(self, name):
        self._standing = None
        del self._rows[self._marks.get(name, 0):]

    def __len__(self):
        return len(self._rows)

    def _ranges(self):
        """Yields (column with its unit, smallest value, largest value)."""
        for name in self.columns:
            values = [self._values(row, name) for row in self._rows if len(row.answer.nodes)]
            if values:
                yield name + unit_of(name), shown(min(value.min() for value in values)), shown(max(value.max() for value in values))

    def _title(self):
        if not self._rows:
            return "History of no steps"
        counts = {len(row.answer.nodes) for row in self._rows}
        return (f"History of {len(self)} steps of {' to '.join(str(n) for n in sorted({min(counts), max(counts)}))} nodes, "
                f"t = {self._rows[-1].time:g} s at its end")

    def __repr__(self):
        return "\n".join([f"<{self._title()}", *(f"  {name:<24} {low} to {high}" for name, low, high in self._ranges())]) + ">"

    def _repr_html_(self):
        return html_table(self._title(), [("column", "smallest", "largest"), *self._ranges()])

    @property
    def nodes(self):
        first = self._rows[0].answer.nodes if self._rows else numpy.empty(0, numpy.uint64)
        if any(row.answer.nodes is not first and not numpy.array_equal(row.answer.nodes, first) for row in self._rows):
            raise ValueError("the steps of this history have different nodes, so they have no common rows; use table()")
        return first

    @property
    def columns(self):
        """Names of the columns that every step has."""
        names = [self._names(row) for row in self._rows]
        return tuple(name for name in (names[0] if names else ()) if all(name in other for other in names))

    @staticmethod
    def _names(row):
        sent = dict.fromkeys(BY_NUMBER[number].name for number, _ in row.columns)
        return (*sent, *row.answer.columns)

    @staticmethod
    def _values(row, name):
        parts = [row.frame[i] for i, (number, _) in enumerate(row.columns) if BY_NUMBER[number].name == name]
        return getattr(row.answer, name) if not parts else parts[0] if len(parts) == 1 else numpy.stack(parts, axis=-1)

    def __getattr__(self, name):
        if name in ("dt", "time", "step"):
            return numpy.array([getattr(row, name) for row in self._rows])
        if name.startswith("_") or name not in self.columns:
            raise AttributeError(
                f"this history has no column {name}" +
                ("" if name.startswith("_") else f": it has {', '.join(self.columns)}")
            )
        self.nodes  # refuses steps of different nodes
        return numpy.stack([self._values(row, name) for row in self._rows])

    def _flat(self, row):
        """Yields (column, suffix, values of shape (N,)) of a step."""
        for name in self._names(row):
            values = self._values(row, name)
            for component in range(values.ndim):
                yield BY_NAME[name], "_second" * component, values if values.ndim == 1 else values[:, component]

    def table(self):
        """Returns {name: array}, with an entry for each step and node: time, dt, step, node and the columns that every
        step has. The second tangential component has a name of its own, which ends in "_second"."""
        counts = [len(row.answer.nodes) for row in self._rows]
        found = {
            name: numpy.repeat([getattr(row, name) for row in self._rows], counts) for name in ("time", "dt", "step")
        }
        found["node"] = numpy.concatenate([row.answer.nodes
                                           for row in self._rows]) if self._rows else numpy.empty(0, numpy.uint64)
        flat = [{column.name + suffix: values for column, suffix, values in self._flat(row)} for row in self._rows]
        for name in flat[0] if flat else ():
            if all(name in step for step in flat):
                found[name] = numpy.concatenate([step[name] for step in flat])
        return found

    def _own_datasets(self, nodes):
        """Returns {name: array} of what the nodes were registered with, where it differs from the scene."""
        own = [self._own.get(node) for node in nodes.tolist()]
        if self._several and None in own:
            raise ValueError(f"node {nodes[own.index(None)]} came from another session, "
                             "so its pair and parameters are not known")
        own = [node or {} for node in own]
        found = {}
        for name in sorted({name for node in own for name in node}):
            without = [place for place, node in enumerate(own) if name not in node]
            if name == "pair" or not without:
                found[name] = [node.get(name, "") for node in own]
            elif name == "initial_temperature":
                found[name] = [node.get(name) or self._start_temperature(node.get("pair", "")) for node in own]
            else:
                raise ValueError(f"node {nodes[without[0]]} was registered without {name}, which other nodes have")
        return found

    def _start_temperature(self, pair):
        """Returns the temperature (K) at which the scene lets the layer of a node of this pair begin."""
        scene = tomllib.loads(self._scene)
        return scene.get("pair", {}).get(pair, {}).get("layer", scene["layer"])["initial_temperature_k"]

    def to_pandas(self):
        """Returns table() as a DataFrame. Needs pandas."""
        import pandas

        return pandas.DataFrame(self.table())

    def to_hdf5(self, path, scene=""):
        """Writes the history as proto/files/recording.md describes it, which shearbus-replay reads. scene: text of the
        scene, such as Session.scene. The file appears under its name only when it is complete, and replaces an older
        history only: FileExistsError for any other file. Needs h5py."""
        import h5py

        if not self._rows:
            raise ValueError("the history has no steps")
        nodes = self.nodes
        own = self._own_datasets(nodes)
        earlier = [node for node in nodes.tolist() if node not in self._begun]
        past = f"the layer of node {earlier[0]} began before the first step" if earlier else ""
        if past:
            warnings.warn(f"{path}: {past}; a replay lets it begin at the start, and its answers differ", stacklevel=2)
        with _partial(path) as partial, h5py.File(partial, "w", libver=("earliest", "v110")) as file:
            kept = {"shuffle": True, "compression": "gzip", "compression_opts": 1, "fletcher32": True}

            def write(name, values, unit, **options):
                data = file.create_dataset(name, data=values, **options)
                if unit:
                    data.attrs["units"] = numpy.bytes_(unit)
                return data

            write("time", self.time, "s").attrs["t0"] = self._rows[0].time - self._rows[0].dt
            write("dt", self.dt, "s")
            write("node_id", nodes, "")
            for name, values in own.items():
                write(name, values, "K" if name == "initial_temperature" else "")
            table = {}
            for row in self._rows:
                for column, suffix, values in self._flat(row):
                    table.setdefault((column, suffix), []).append(values)
            for (column, suffix), values in table.items():
                if len(values) != len(self._rows):
                    continue  # a column that some steps only have is no table
                data = numpy.stack(values)
                if column.name in MASSES and (data == data[0]).all():
                    data = data[0]  # one value per node, as a replay expects it
                options = {"dtype": h5py.enum_dtype(REGIMES, "u1")} if column.name == "regime" else {}
                data = write(column.quantity + suffix, data, column.unit, **kept, **options)
                if column.name in LEGENDS:
                    data.attrs["legend"] = LEGENDS[column.name]
                data.attrs["long_name"] = column.quantity.replace("_", " ") + suffix.replace("_", " ")
            meta = file.create_group("meta")
            meta.attrs.update({
                "format": "shearbus-history", "version": "1", "units_system": "SI", "producer": "shearbus for Python",
                "created": datetime.datetime.now(datetime.timezone.utc).strftime("%Y-%m-%dT%H:%M:%SZ")
            })
            if past:
                meta.attrs["past"] = past
            if scene:
                meta["scene"] = scene
