#!/usr/bin/python3
"""Draws one node of a history or of a result of shearbus-replay: pressure, velocity jump and slip, shear stress,
interface temperature, and a band of the regime. Several files of the same steps complete each other.

    plot_history.py result.h5 history.h5 --out picture.png [--node ID]
"""
import argparse
import pathlib
import sys

import h5py
import numpy as np
import style
from printable import complain
from runs import text_of

MOST_ROWS = 4000  # more would be finer than the pixels of the picture
PANELS = [  # label, lines: (quantity, label in a legend)
    (style.QUANTITIES["pressure"][0], [("pressure", "")]),
    ("velocity (m/s)", [("velocity_jump", "jump"), ("sliding_velocity", "slip")]),
    (style.QUANTITIES["shear_stress"][0], [("shear_stress", "")]),
    (style.QUANTITIES["interface_temperature"][0], [("interface_temperature", "")]),
]


def read(paths, node):
    """Returns the time (s), the id of the node, its quantities by name, and the facts of the footer."""
    found, ids, time, known = {}, None, None, {}
    for path in paths:
        with h5py.File(path) as file:
            if "time" not in file or "node_id" not in file:
                raise ValueError(f"{path}: not a history or a result, it has no time and node_id")
            if ids is not None and not (np.array_equal(ids, file["node_id"]) and np.array_equal(time, file["time"])):
                raise ValueError(f"{path}: has other nodes or times than {paths[0]}")
            ids, time = file["node_id"][:], file["time"][:]
            meta = dict(file["meta"].attrs) if "meta" in file else {}
            for key, name in (("scene", "scene_name"), ("program", "producer"), ("version", "server_version"), ("commit", "commit"), ("date", "created"), ("machine", "machine")):
                if name in meta:
                    known.setdefault(key, text_of(meta[name])[: 10 if key == "date" else None])
            if node is None and "interface_temperature" in file:
                temperature = file["interface_temperature"]
                peaks = [temperature[i:i + 1000].max(axis=0) for i in range(0, len(time), 1000)]
                node = int(ids[np.argmax(np.max(peaks, axis=0))])
    node = int(ids[0]) if node is None else node
    if node not in ids:
        raise ValueError(f"{paths[0]}: has no node {node}")
    column = int(np.flatnonzero(ids == node)[0])
    rows = np.unique(np.linspace(0, len(time) - 1, min(len(time), MOST_ROWS)).astype(int))
    for path in paths:
        with h5py.File(path) as file:
            for name in ["regime", *(name for _, lines in PANELS for name, _ in lines)]:
                if name in file and name not in found and file[name].ndim == 2:
                    found[name] = file[name][:, column][rows]
    return time[rows], node, found, known


def regime_band(axis, time, regime):
    """Fills an axis with the regimes of steps that end at these times."""
    edges = np.concatenate([[2 * time[0] - time[min(1, len(time) - 1)]], time])
    changes = np.flatnonzero(np.diff(regime.astype(int), prepend=-1))
    colours = [colour for _, colour in style.REGIMES.values()]
    for begin, end in zip(changes, [*changes[1:], len(time)]):
        axis.axvspan(edges[begin], edges[end], color=colours[min(int(regime[begin]), len(colours) - 1)], lw=0)
    axis.set_yticks([])


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("files", nargs="+", help="HDF5 files of the same steps")
    parser.add_argument("--out", required=True, help="the picture, PNG")
    parser.add_argument("--node", type=int, help="id of the node; default: the hottest")
    options = parser.parse_args()
    try:
        time, node, values, known = read(options.files, options.node)
        panels = [(label, lines) for label, lines in PANELS if any(name in values for name, _ in lines)]
        if not panels:
            raise ValueError(f"{options.files[0]}: has nothing to draw")
    except (OSError, ValueError) as fault:
        complain("plot_history.py", fault)
        sys.exit(1)
    heights = [3] * len(panels) + [0.5] * ("regime" in values)
    figure, axes = style.figure(len(heights), 1, (8, 0.62 * sum(heights) + 1.2), legend="regime" in values, sharex=True, squeeze=False,
                                gridspec_kw={"height_ratios": heights})
    axes = axes[:, 0]
    for axis, (label, lines) in zip(axes, panels):
        for name, legend in lines:
            if name in values:
                axis.plot(time * 1e6, values[name] * style.QUANTITIES[name][1], lw=1.4, label=legend)
        axis.set_ylabel(label)
        axis.grid()
        if sum(name in values for name, _ in lines) > 1:
            axis.legend()
    if "regime" in values:
        regime_band(axes[-1], time * 1e6, values["regime"])
        axes[-1].set_ylabel("regime", rotation=0, ha="right", va="center")
        style.legend_below(figure, style.regime_handles(np.unique(values["regime"])))
    axes[-1].set_xlabel("time (µs)")
    axes[0].set_title(f"node {node}")
    style.save(figure, pathlib.Path(options.out), style.provenance_text(known))


if __name__ == "__main__":
    main()
