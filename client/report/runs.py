"""Reads what shearbus-hydro and shearbus-replay leave: one Run for a directory of shearbus-hydro, in one or two
dimensions, or for a file of results. Whatever is missing in a run is None or empty; a file that is no result raises
Fault with the reason."""
import collections
import contextlib
import itertools
import os
import pathlib
import resource

import h5py
import numpy as np
from style import QUANTITIES, REGIMES, RUNS, law_colour, law_label, provenance_text
from terminal import read_json, read_toml

MOST_ROWS = 1500  # rows of a history that are kept: more would be finer than the pixels of a picture
NEEDED = ("interface_temperature", "shear_stress", "sliding_velocity")


class Fault(Exception):
    """A run that cannot be read: what was expected, what was found."""


def check_texts(path):
    """Raises ValueError if a process that reads the attributes of a file does not survive it: HDF5 1.10 trusts the heap
    that holds their texts. A child process tries it. The twin of proto/files/recording_trial.hpp."""
    def read(_, item):
        for name in item.attrs:
            with contextlib.suppress(Exception):
                item.attrs[name]

    child = os.fork()
    if child == 0:
        with contextlib.suppress(Exception):
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            resource.setrlimit(resource.RLIMIT_CPU, (5, 5))
            os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
            with h5py.File(path) as file:
                read("", file)
                file.visititems(read)
        os._exit(0)
    if os.waitpid(child, 0)[1] != 0:
        raise ValueError("is damaged: HDF5 does not survive its texts, such as attributes units")


def thinned(dataset, rows):
    """Returns these rows of a dataset, read chunk by chunk, because the whole need not fit into memory."""
    own_rows = np.split(rows, np.flatnonzero(np.diff(rows // rows_of_chunk(dataset))) + 1)
    return np.concatenate([dataset[own[0] : own[-1] + 1][own - own[0]] for own in own_rows if own.size])


def rows_of_chunk(dataset):
    return dataset.chunks[0] if dataset.chunks else max(1, dataset.shape[0])


def chunks(dataset):
    """Yields the rows of a dataset, chunk by chunk."""
    step = rows_of_chunk(dataset)
    return (dataset[begin : begin + step] for begin in range(0, dataset.shape[0], step))


def text_of(value):
    return value.decode() if isinstance(value, bytes) else str(value)


def meta_of(file):
    """Returns the attributes of a history's /meta as texts, and the text of its scene."""
    meta = file.get("meta")
    found = {key: text_of(value) for key, value in meta.attrs.items()} if meta is not None else {}
    return found, text_of(meta["scene"][()]) if meta is not None and "scene" in meta else found.pop("scene", "")


def scene_of(text):
    """Returns the scene of a text; one that is no TOML is empty."""
    try:
        return read_toml(text)
    except ValueError:
        return {}


def with_changes(meta, text):
    """Returns a text about the scene of a run, with what the replay changed in that scene."""
    return f"{text} with {meta['changes']}" if text and meta.get("changes") else text


def provenance_of(meta, scene, known=()):
    """Returns the facts of a footer: those of /meta, or those that are known otherwise."""
    scene = with_changes(meta, scene)
    facts = {"program": "producer", "version": "server_version", "commit": "commit", "date": "created", "machine": "machine"}
    found = {"scene": scene, **{key: meta.get(name, "") for key, name in facts.items()}, **dict(known)}
    return {**found, "date": found["date"][:10]}


def regimes_of(values, data):
    """Returns the regimes that a dataset names as positions in style.REGIMES. Raises ValueError for one that is unknown."""
    names = list(REGIMES)
    codes = h5py.check_enum_dtype(data.dtype) or {name: code for code, name in enumerate(names)}
    if unknown := sorted(codes.keys() - set(names)):
        raise ValueError(f"has regimes that this version does not know: {', '.join(unknown)}")
    position = np.zeros(256, dtype="u1")
    for name, code in codes.items():
        position[code] = names.index(name)
    return position[values]


def slip_of(file):
    """Returns the slip distance of each node while its contact is closed: an open one has a velocity, too."""
    lengths = file["dt"][:] if "dt" in file else np.diff(file["time"][:], prepend=0.0)
    is_open = list(REGIMES).index("OPEN")
    slip, begin = 0.0, 0
    for velocity in chunks(file["sliding_velocity"]):
        rows = slice(begin, begin + len(velocity))
        closed = regimes_of(file["regime"][rows], file["regime"]) != is_open if "regime" in file else True
        slip = slip + (np.abs(velocity) * lengths[rows, None] * closed).sum(axis=0)
        begin = rows.stop
    return slip


def table_of(path):
    """Returns a history or a result as {name: array} with time (s), node_id, regime as positions in style.REGIMES,
    and meta."""
    check_texts(path)
    with h5py.File(path) as file:
        missing = [name for name in ("time", "node_id", *NEEDED) if name not in file]
        if missing:
            raise Fault(f"{path}: expected a result of shearbus-hydro or shearbus-replay; it has no dataset {', '.join(missing)}")
        steps = file["time"].shape[0]
        rows = np.unique(np.linspace(0, steps - 1, min(steps, MOST_ROWS)).round().astype(int))
        found = {"time": file["time"][:][rows], "node_id": file["node_id"][:]}
        found["rows"], found["steps"] = rows, steps
        for name, data in file.items():
            if isinstance(data, h5py.Dataset) and data.ndim == 2 and data.shape == (steps, found["node_id"].size):
                found[name] = thinned(data, rows)
        if "regime" in found:
            found["regime"] = regimes_of(found["regime"], file["regime"])
        found["meta"], found["scene"] = meta_of(file)
        found["outcomes"] = outcome_counts(file) if "outcome" in file else {}
        found["hottest"] = max(part.max() for part in chunks(file["interface_temperature"]))
        found["heat"] = sum(part.sum(axis=0) for part in chunks(file["friction_heat"])) if "friction_heat" in file else None
        found["slip"] = slip_of(file)
        found["pairs"] = collections.Counter(text.decode() if isinstance(text, bytes) else text for text in file["pair"][:]) if "pair" in file else {}
        found["parameters"] = {key: data[:] for key, data in file["parameter"].items()} if isinstance(file.get("parameter"), h5py.Group) else {}
        if "profiles" in file:
            found["profiles"] = {name: data[:] for name, data in file["profiles"].items()}
    return found


def outcome_counts(file):
    """Returns meaning -> number of node-steps, from the bits of /outcome and its attribute `legend`."""
    data = file["outcome"]
    count = sum(np.bincount(part.ravel(), minlength=256) for part in chunks(data))
    legend = [part.strip().split(" ", 1) for part in text_of(data.attrs.get("legend", "")).split(",") if " " in part.strip()]
    meanings = {int(bit): meaning for bit, meaning in legend if bit.isdigit()}
    codes = np.arange(256)
    return {meanings.get(bit, f"bit {bit}"): int(count[(codes & bit) > 0].sum()) for bit in (1 << i for i in range(8)) if count[(codes & bit) > 0].any()}


def flat(table, prefix=""):
    """Returns {key with dots: value} of a scene."""
    found = {}
    for key, value in table.items():
        found.update(flat(value, f"{prefix}{key}.") if isinstance(value, dict) else {prefix + key: value})
    return found


def what_differs(scenes, names, paths):
    """Returns a word for each of several runs of one law that tells it from the others: the scene's name, the keys in
    which the scenes differ, or the file."""
    if len(set(names)) == len(names):
        return names
    tables = [flat(scene) for scene in scenes]
    differing = [key for key in dict.fromkeys(key for table in tables for key in table)
                 if key not in ("name", "source") and len({repr(table.get(key)) for table in tables}) > 1]
    words = [", ".join(f"{key} = {table[key]:g}" if isinstance(table.get(key), float) else f"{key} = {table.get(key, 'absent')}" for key in differing) for table in tables]
    if 0 < len(differing) <= 2 and len(set(words)) == len(words):
        return words
    paths = [pathlib.Path(path) for path in paths]
    stems = [path.stem if path.is_file() else path.name for path in paths]
    return stems if len(set(stems)) == len(stems) else [str(path) for path in paths]


def tell_apart(runs):
    """Gives each of several runs a label and a colour of its own: those of its law, and where runs have one law, what else
    tells them apart."""
    laws = [run.law for run in runs]
    if len(set(laws)) == len(laws):
        return runs
    for law in set(laws):
        same = [run for run in runs if run.law == law]
        for run, word in zip(same, what_differs([run.scene for run in same], [run.name for run in same], [run.path for run in same]) if len(same) > 1 else ()):
            run.label = word if len(set(laws)) == 1 else f"{law_label(law)}, {word}"
    for i, run in enumerate(runs):
        run.colour = RUNS[i % len(RUNS)]
    return runs


def read(paths):
    """Returns the runs of these paths, told apart. Raises Fault."""
    return tell_apart([Run(path) for path in paths])


class Run:
    """One run. Times in µs, everything else in SI.

    path, law, label, colour: where it is, the name of its interface law, how pictures call and draw it. scene, scene_text: effective
    scene. summary: summary.json. incomplete: whether a directory has none, because the run did not reach its end. provenance: facts for a footer. table: {name: [T, N] array} of the interface, or
    None; time [T]; nodes [N] ids; place [N]: z or r (place_name) of each node at the start (m) in two dimensions,
    else None. fields: directory of the frames, or None. surface: time (µs) and axial velocity [T, N] of the free surface, from
    the axis outwards, or None."""

    def __init__(self, path):
        self.path = self.reading = path = pathlib.Path(path)
        self.two_dimensions = path.is_dir() and (path / "fields.xmf").is_file()
        try:
            self._read(path)
        except (OSError, KeyError, IndexError, ValueError) as fault:
            raise Fault(f"{self.reading}: cannot be read: {fault}") from fault

    def _read(self, path):
        if not path.exists():
            raise Fault(f"{path}: there is no such run")
        self.summary, self.table, self.fields, self.surface = {}, None, None, None
        history = path / ("interface.h5" if self.two_dimensions else "history.h5") if path.is_dir() else path
        report = path / "summary.json" if path.is_dir() else path.with_suffix(".json")
        if report.is_file():
            self.reading = report
            self.summary = read_json(report)
        self.reading = path
        if history.is_file():
            self.reading = history
            self.table = table_of(history)
        elif not self.two_dimensions:
            raise Fault(f"{path}: expected a directory that shearbus-hydro wrote, or a result of shearbus-replay; found neither fields.xmf nor history.h5")
        self.reading = path
        if self.two_dimensions:
            self.fields = path / "fields"
            self.frames = sorted(self.fields.glob("[0-9]*.h5"))
            if not self.frames:
                raise Fault(f"{path}: has no frame of the fields; the run did not begin")
            if (path / "free_surface.h5").is_file():
                with h5py.File(path / "free_surface.h5") as file:
                    self.surface = (file["time"][:] * 1e6, file["axial_velocity"][:][:, np.argsort(file["radius"][0], kind="stable")])
        self.incomplete = path.is_dir() and not self.summary
        meta = self.table["meta"] if self.table else {}
        self.scene_text = self.table["scene"] if self.table else self._scene_of_mesh()
        if path.is_dir():
            self._check_origin(history.name)
        self.scene = scene_of(self.scene_text)
        self.law = meta.get("interface_law") or self.summary.get("interface_law") or "subgrid"
        self.label, self.colour = law_label(self.law), law_colour(self.law)
        self.name = self.scene.get("name") or meta.get("scene_name") or path.stem
        self.title, self.source = with_changes(meta, self.name), with_changes(meta, self.scene.get("source", ""))
        self.provenance = provenance_of(meta, self.name, self.summary.get("provenance", {}))
        if self.table:
            self.time, self.nodes = self.table["time"] * 1e6, self.table["node_id"]
            self.place, self.place_name = None, ""
            if "height" in self.table:  # along the axis that the interface follows
                self.place_name, name = ("z", "height") if np.ptp(self.table["height"][0]) >= np.ptp(self.table["radius"][0]) else ("r", "radius")
                self.place = self.table[name][0]

    def _check_origin(self, history):
        """Raises Fault unless all files of the directory are of one run."""
        others = [name for name in (("history.h5",) if self.two_dimensions else ("interface.h5", "free_surface.h5")) if (self.path / name).is_file()]
        if others:
            raise Fault(f"{self.path}: expected the files of one run, found {'fields.xmf' if self.two_dimensions else history} and {others[0]}, which is of a run of another kind; move the files of one of them elsewhere")
        known = {history: {**self.table["meta"], "scene": self.scene_text}} if self.table else {}
        if self.two_dimensions:
            known["fields"] = {"scene": self._scene_of_mesh()}
            if (self.path / "free_surface.h5").is_file():
                with h5py.File(self.path / "free_surface.h5") as file:
                    known["free_surface.h5"], _ = meta_of(file)
        known["summary.json"] = {**self.summary.get("provenance", {}), "scene": self.scene_text, "interface_law": self.summary.get("interface_law")}
        for (one, ours), (other, theirs) in itertools.combinations(known.items(), 2):
            for key in ("interface_law", "scene", "date", "command", "commit"):
                if ours.get(key) and theirs.get(key) and ours[key] != theirs[key]:
                    values = f": {ours[key]} and {theirs[key]}" if key != "scene" else ""
                    raise Fault(f"{self.path}: expected the files of one run, found another {key} in {one} than in {other}{values}; run the scene again")

    def _scene_of_mesh(self):
        with h5py.File(self.fields / "mesh.h5") as file:
            return bytes(file["scene"][:]).decode() if "scene" in file else ""

    def __contains__(self, name):
        return self.table is not None and name in self.table

    def __getitem__(self, name):
        return self.table[name]

    def drawn(self, name):
        """Returns the history of a quantity in the unit of the pictures: sliding as a speed, and none where the contact is
        open."""
        values = self[name] * QUANTITIES[name][1]
        if name != "sliding_velocity":
            return values
        return np.where(self["regime"] > 0, np.abs(values), np.nan) if "regime" in self else np.abs(values)

    @property
    def last_contact(self):
        """Time (µs) of the last row in which any node was closed; the end of the run where no row has a regime."""
        if "regime" not in self:
            return self.time[-1]
        closed = np.flatnonzero((self["regime"] > 0).any(axis=1))
        return self.time[closed[-1]] if closed.size else self.time[-1]

    def slip(self):
        """Returns the slip distance of each node at the end (m)."""
        if "slip_distance" in self:
            return self["slip_distance"][-1]
        return np.array(self.summary.get("slip_distance_m", self["slip"]))

    def mean(self, values):
        """Returns the mean of values, one per node, over the length of the interface, on which a node at an end has half a
        place; over the nodes where they are no line."""
        length = self.summary.get("interface", {}).get("length_m")
        return float(np.average(values, weights=length if length and len(length) == len(values) else None))

    def molten_time(self):
        """Returns the time that each node spent in the regime MELTING (µs)."""
        melting = self["regime"] == list(REGIMES).index("MELTING") if "regime" in self else np.zeros((len(self.time), len(self.nodes)), dtype=bool)
        return (melting * np.diff(self.time, prepend=0.0)[:, None]).sum(axis=0)

    def selected(self):
        """Returns {node index: reasons} of the nodes that are worth a look: hottest, fastest, longest molten, and one
        that never slips or slips least."""
        found = {}
        molten, slip = self.molten_time(), self.slip()
        choices = [("hottest", self["interface_temperature"].max(axis=0).argmax()), ("fastest", np.abs(self["sliding_velocity"]).max(axis=0).argmax())]
        choices += [("longest molten", molten.argmax())] * bool(molten.any()) + [("slips least", slip.argmin())]
        kept = self["profiles"]["node_id"][:4] if "profiles" in self else []
        choices += [("with profiles", np.flatnonzero(self.nodes == node)[0]) for node in kept if node in self.nodes]
        for reason, node in choices:
            found.setdefault(int(node), []).append(reason)
        return found

    def quads(self):
        with h5py.File(self.fields / "mesh.h5") as file:
            return file["quads"][:]

    def frame(self, time=None):
        """Returns the frame at or just after a time (µs), by default the last: {"time" (µs), "place" [M, 2], zone
        quantities [Z]}."""
        path = self.frames[-1]
        for candidate in self.frames if time is not None else ():
            with h5py.File(candidate) as file:
                if file["time"][0] * 1e6 >= time - 1e-9:
                    path = candidate
                    break
        with h5py.File(path) as file:
            found = {name: data[:] for name, data in file.items()}
        found["time"] = found["time"][0] * 1e6
        found["place"], found["velocity"] = found["place"][:, :2], found["velocity"][:, :2]
        return found

    def kinetic_energy(self, frame):
        """Returns the kinetic energy of each body of a frame: J in axisymmetry, J/m in plane strain. Nodes share the
        mass of their zones."""
        quads = self.quads()
        corners = frame["place"][quads]
        x, y = corners[..., 0], corners[..., 1]
        area = 0.5 * ((x[:, 2] - x[:, 0]) * (y[:, 3] - y[:, 1]) - (x[:, 3] - x[:, 1]) * (y[:, 2] - y[:, 0]))
        turn = 2 * np.pi * x.mean(axis=1) if self.axisymmetric else 1.0
        mass = frame["density"] * np.abs(area) * turn
        speed = (frame["velocity"] ** 2).sum(axis=1)[quads].mean(axis=1)
        return np.bincount(frame["body"].astype(int), weights=0.5 * mass * speed)

    @property
    def axisymmetric(self):
        return "friction_heat_j" in self.summary

    def footer(self):
        zones = f"{self.summary['zones']} zones" if "zones" in self.summary else ""
        return " · ".join(part for part in (provenance_text(self.provenance), zones) if part)
