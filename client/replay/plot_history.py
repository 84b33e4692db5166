#!/usr/bin/python3
"""Draws one node of a history or of a result of shearbus-replay: pressure, velocity jump and slip, shear stress, interface
temperature, and a band of the regime. Several files of the same steps complete each other.

    plot_history.py result.h5 history.h5 --out picture.png [--node ID]
"""
import argparse
import sys

import h5py
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.patches import Patch

MOST_ROWS = 4000  # more would be finer than the pixels of the picture
REGIMES = [("open", "#d9d9d9"), ("stick", "#4477aa"), ("Coulomb", "#ccbb44"), ("Tresca", "#ee6677"), ("melting", "#7a0019")]
PANELS = [
    ("P (GPa)", [("pressure", "", 1e-9)]),
    ("V (m/s)", [("velocity_jump", "[V]", 1.0), ("sliding_velocity", "slip [v]", 1.0)]),
    ("s (MPa)", [("shear_stress", "", 1e-6)]),
    ("T0 (K)", [("interface_temperature", "", 1.0)]),
]


def read(paths, node):
    """Returns the time (s), the id of the node and its quantities by name."""
    found, ids, time = {}, None, None
    for path in paths:
        with h5py.File(path) as file:
            if "time" not in file or "node_id" not in file:
                raise ValueError(f"{path}: not a history or a result, it has no time and node_id")
            if ids is not None and not (np.array_equal(ids, file["node_id"]) and np.array_equal(time, file["time"])):
                raise ValueError(f"{path}: has other nodes or times than {paths[0]}")
            ids, time = file["node_id"][:], file["time"][:]
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
            for name in ["regime", *(name for _, lines in PANELS for name, _, _ in lines)]:
                if name in file and name not in found and file[name].ndim == 2:
                    found[name] = file[name][:, column][rows]
    return time[rows], node, found


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("files", nargs="+", help="HDF5 files of the same steps")
    parser.add_argument("--out", required=True, help="the picture, PNG")
    parser.add_argument("--node", type=int, help="id of the node; default: the hottest")
    options = parser.parse_args()
    try:
        time, node, values = read(options.files, options.node)
        panels = [(label, lines) for label, lines in PANELS if any(name in values for name, _, _ in lines)]
        if not panels:
            raise ValueError(f"{options.files[0]}: has nothing to draw")
    except (OSError, ValueError) as fault:
        sys.exit(f"plot_history.py: {fault}")
    heights = [3] * len(panels) + ([0.5] if "regime" in values else [])
    figure, axes = plt.subplots(len(heights), 1, sharex=True, squeeze=False, figsize=(8, 0.6 * sum(heights) + 1),
                                gridspec_kw={"height_ratios": heights}, constrained_layout=True)
    axes = axes[:, 0]
    for axis, (label, lines) in zip(axes, panels):
        for name, legend, scale in lines:
            if name in values:
                axis.plot(time * 1e6, values[name] * scale, lw=1.2, label=legend)
        axis.set_ylabel(label)
        axis.grid(alpha=0.3)
        if sum(name in values for name, _, _ in lines) > 1:
            axis.legend(fontsize="small")
    if "regime" in values:
        edges = np.concatenate([[2 * time[0] - time[min(1, len(time) - 1)]], time]) * 1e6
        colours = np.array([matplotlib.colors.to_rgb(colour) for _, colour in REGIMES])
        band = colours[np.clip(values["regime"].astype(int), 0, len(REGIMES) - 1)]
        changes = np.flatnonzero(np.diff(values["regime"].astype(int), prepend=-1))
        for begin, end in zip(changes, [*changes[1:], len(time)]):
            axes[-1].axvspan(edges[begin], edges[end], color=band[begin])
        axes[-1].set_yticks([])
        axes[-1].set_ylabel("regime", rotation=0, ha="right", va="center")
        axes[-1].legend(handles=[Patch(color=colour, label=name) for i, (name, colour) in enumerate(REGIMES)
                                 if i in values["regime"]], ncols=5, fontsize="small", loc="upper left",
                        bbox_to_anchor=(0.0, -0.8))
    axes[-1].set_xlabel("time (µs)", loc="right")
    axes[0].set_title(f"node {node}")
    figure.savefig(options.out, dpi=120)


if __name__ == "__main__":
    main()
