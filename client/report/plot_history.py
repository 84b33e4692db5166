#!/usr/bin/python3
"""Draws one node of histories and of results of shearbus-replay: pressure, velocity jump and slip, shear stress,
interface temperature, and a band of the regime. Files of answers are drawn over each other, each in its colour; a
history of inputs alone completes those that have its steps.

    plot_history.py result.h5 [other.h5 ...] [history.h5] --out picture.png [--node ID]
"""
import pathlib
import sys
from terminal import Parser, complain, whole_number
import begin  # noqa: F401

import h5py
import numpy as np
import style
from matplotlib.lines import Line2D
from runs import check_texts, chunks, meta_of, provenance_of, regimes_of, scene_of, tell_apart

MOST_ROWS = 4000  # more would be finer than the pixels of the picture
PANELS = [  # label, lines: (quantity, label in a legend)
    (style.QUANTITIES["pressure"][0], [("pressure", "")]),
    ("velocity (m/s)", [("velocity_jump", "jump"), ("sliding_velocity", "slip")]),
    (style.QUANTITIES["shear_stress"][0], [("shear_stress", "")]),
    (style.QUANTITIES["interface_temperature"][0], [("interface_temperature", "")]),
]


class File:
    """A history or a result: path, time (s), ids, law, name and scene of the run, facts of the footer, and the columns of a
    node, which take() reads."""

    def __init__(self, path):
        self.path, self.colour = pathlib.Path(path), style.INK
        if not self.path.is_file():
            raise ValueError(f"{path}: there is no such file")
        if not h5py.is_hdf5(path):
            raise ValueError(f"{path}: expected a result or a history in HDF5, or an event log; found another kind of file. "
                             "A table of text is not drawn; a replay to HDF5 is: shearbus-replay TABLE.csv --scene SCENE.toml --out RESULT.h5")
        try:
            check_texts(path)
        except ValueError as fault:
            raise ValueError(f"{path}: {fault}") from None
        with h5py.File(path) as file:
            if "time" not in file or "node_id" not in file:
                raise ValueError(f"{path}: not a history or a result, it has no time and node_id")
            self.ids, self.time = file["node_id"][:], file["time"][:]
            self.answers = any(name in file for name in ("interface_temperature", "sliding_velocity", "shear_stress"))
            meta, text = meta_of(file)
        self.scene = scene_of(text)
        self.law, self.name = meta.get("interface_law", "subgrid"), self.scene.get("name", self.path.stem)
        self.label = style.law_label(self.law)
        self.provenance = provenance_of(meta, meta.get("scene_name") or self.scene.get("name"))  # the table of an event log has the scene alone

    def hottest(self):
        """Returns the id of the hottest node, of the first one where no temperature is known."""
        with h5py.File(self.path) as file:
            if "interface_temperature" not in file or not len(self.time):
                return int(self.ids[0])
            peaks = [part.max(axis=0) for part in chunks(file["interface_temperature"])]
            return int(self.ids[np.argmax(np.max(peaks, axis=0))])

    def take(self, node):
        """Reads the columns of a node."""
        if node not in self.ids:
            raise ValueError(f"{self.path}: has no node {node}")
        column = int(np.flatnonzero(self.ids == node)[0])
        self.rows = np.unique(np.linspace(0, len(self.time) - 1, min(len(self.time), MOST_ROWS)).astype(int))
        with h5py.File(self.path) as file:
            self.values = {name: file[name][:, column][self.rows] for name in ["regime", *(name for _, lines in PANELS for name, _ in lines)]
                           if name in file and file[name].ndim == 2}
            if "regime" in self.values:
                try:
                    self.values["regime"] = regimes_of(self.values["regime"], file["regime"])
                except ValueError as fault:
                    raise ValueError(f"{self.path}: {fault}") from None
        if "sliding_velocity" in self.values and "regime" in self.values:  # nothing slides on an open contact
            self.values["sliding_velocity"] = np.where(self.values["regime"] > 0, self.values["sliding_velocity"], np.nan)

    def complete(self, other):
        """Takes what this file lacks from one of the same steps."""
        if not (np.array_equal(self.ids, other.ids) and np.array_equal(self.time, other.time)):
            raise ValueError(f"{other.path}: has other nodes or times than {self.path}")
        self.values = {**other.values, **self.values}


def read(paths, node):
    """Returns the files that are drawn, told apart, and the id of the node."""
    files = [File(path) for path in paths]
    drawn = [file for file in files if file.answers] or files[:1]
    node = drawn[0].hottest() if node is None else node
    for file in files:
        file.take(node)
    for other in files:
        if other not in drawn:
            for file in drawn:
                file.complete(other)
    return tell_apart(drawn), node


def regime_band(axis, time, regime):
    """Fills an axis with the regimes of steps that end at these times."""
    edges = np.concatenate([[2 * time[0] - time[min(1, len(time) - 1)]], time])
    changes = np.flatnonzero(np.diff(regime.astype(int), prepend=-1))
    colours = [colour for _, colour in style.REGIMES.values()]
    for begin, end in zip(changes, [*changes[1:], len(time)]):
        axis.axvspan(edges[begin], edges[end], color=colours[min(int(regime[begin]), len(colours) - 1)], lw=0)
    axis.set_yticks([])


def main():
    parser = Parser(description=__doc__.split("\n\n")[0])
    parser.add_argument("files", nargs="+", help="HDF5 files: results, which are drawn over each other, and a history that completes them")
    parser.add_argument("--out", required=True, help="the picture, PNG")
    parser.add_argument("--node", type=whole_number, help="id of the node; default: the hottest")
    options = parser.parse_args()
    try:
        files, node = read(options.files, options.node)
        panels = [(label, lines) for label, lines in PANELS if any(name in file.values for file in files for name, _ in lines)]
        if not panels:
            raise ValueError(f"{options.files[0]}: has nothing to draw")
    except (OSError, ValueError) as fault:
        complain("plot_history.py", fault)
        sys.exit(1)
    banded = [file for file in files if "regime" in file.values]
    heights = [3] * len(panels) + [0.5] * len(banded)
    figure, axes = style.figure(len(heights), 1, (8, 0.62 * sum(heights) + 1.2), legend=bool(banded) or len(files) > 1, sharex=True, squeeze=False,
                                gridspec_kw={"height_ratios": heights})
    axes = axes[:, 0]
    dashes = {"sliding_velocity": "--"} if len(files) > 1 else {}
    for axis, (label, lines) in zip(axes, panels):
        for file in files:
            for name, legend in lines:
                if name in file.values:
                    colour = {"color": file.colour} if len(files) > 1 else {}
                    axis.plot(file.time[file.rows] * 1e6, file.values[name] * style.QUANTITIES[name][1], dashes.get(name, "-"), lw=1.4, label=legend, **colour)
        axis.set_ylabel(style.folded(label, 24))
        axis.grid()
        if sum(any(name in file.values for file in files) for name, _ in lines) > 1:
            handles = {text.get_label(): text for text in reversed(axis.get_lines())}
            axis.legend(handles=[handles[legend] for _, legend in lines if legend in handles])
    for axis, file in zip(axes[len(panels):], banded):
        regime_band(axis, file.time[file.rows] * 1e6, file.values["regime"])
        label = "regime" if len(banded) == 1 else style.folded(file.label, 22)
        axis.set_ylabel(label, rotation=0, ha="right", va="center", color=file.colour, fontsize=9 if label.count("\n") < 2 else 7)
    if banded or len(files) > 1:
        handles = [Line2D([], [], color=file.colour, lw=1.6, label=file.label) for file in files] if len(files) > 1 else []
        style.legend_below(figure, handles + (style.regime_handles(np.unique(np.concatenate([file.values["regime"] for file in banded]))) if banded else []))
    axes[-1].set_xlabel("time (µs)")
    axes[0].set_title(f"node {node}")
    style.save(figure, pathlib.Path(options.out), [file.provenance for file in files])


if __name__ == "__main__":
    main()
