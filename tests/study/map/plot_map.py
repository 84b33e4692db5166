#!/usr/bin/python3
"""Draws the results of `shearbus-study map`: slip carried, time to melting, friction coefficient and temperature over pressure and
velocity. Three lines show the velocity below which the layer sticks although slip is imposed, the velocity below which the velocity-driven
model is outside its domain, and the velocity above which the interface has melted.

    plot_map.py DIR [--out DIR]
"""
import argparse
import csv
import json
import pathlib
import sys

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.lines import Line2D

LINES = [  # key in map.json, meaning, style
    ("sticking_below_m_per_s", "sticks below", {"color": "black", "linestyle": "-"}),
    ("domain_limit_m_per_s", "outside the domain below", {"color": "black", "linestyle": "--"}),
    ("melting_above_m_per_s", "melting above", {"color": "#7a0019", "linestyle": "-."}),
]
PANELS = [  # column of nodes.csv, title, colour map, scale, logarithmic
    ("slip_share", "share of the imposed slip carried", "viridis", 1.0, False),
    ("friction_coefficient", "friction coefficient s/P", "magma", 1.0, True),
    ("interface_temperature_k", "interface temperature (K)", "inferno", 1.0, False),
]


class Map:
    def __init__(self, directory):
        self.json = json.loads((directory / "map.json").read_text())
        self.pressure = np.array(self.json["pressure_pa"]) * 1e-9
        self.velocity = np.array(self.json["velocity_jump_m_per_s"])
        self.times = [seen["time_s"] for seen in self.json["observations"]]
        with open(directory / "nodes.csv", newline="") as file:
            rows = list(csv.DictReader(file))
        shape = (len(self.times), self.pressure.size, self.velocity.size)
        if len(rows) != np.prod(shape):
            raise ValueError(f"{directory / 'nodes.csv'} has {len(rows)} rows, expected {np.prod(shape)} as map.json says")
        number = lambda text: float(text) if text else np.nan
        self.columns = {name: np.array([number(row[name]) for row in rows]).reshape(shape) for name in rows[0]}

    def line(self, time, key):
        values = self.json["observations"][time][key]
        return np.array([np.nan if v is None else v for v in values])


def axes_of(ax, title):
    ax.set(xscale="log", yscale="log", title=title, xlabel="pressure (GPa)", ylabel="velocity jump (m/s)")


def draw_lines(ax, the_map, time, colors=None):
    for key, _, style in LINES:
        ax.plot(the_map.pressure, the_map.line(time, key), linewidth=1.8, **(style | (colors or {})))


def legend():
    return [Line2D([], [], label=meaning, **style) for _, meaning, style in LINES]


def microseconds(time):
    return f"{time * 1e6:g} µs"


def draw_fields(the_map, path):
    figure, axes = plt.subplots(len(PANELS), len(the_map.times), figsize=(4.2 * len(the_map.times), 3.6 * len(PANELS)),
                                squeeze=False, sharex=True, sharey=True, constrained_layout=True)
    for row, (name, title, colors, scale, logarithmic) in zip(axes, PANELS):
        values = the_map.columns[name] * scale
        low, high = np.nanmin(values), np.nanmax(values)
        norm = {"norm": LogNorm(max(low, 1e-4 * high), high)} if logarithmic else {"vmin": low, "vmax": high}
        for time, ax in enumerate(row):
            image = ax.pcolormesh(the_map.pressure, the_map.velocity, values[time].T, cmap=colors, shading="nearest", **norm)
            draw_lines(ax, the_map, time, {"color": "white"} if name != "slip_share" else None)
            axes_of(ax, f"{title}, {microseconds(the_map.times[time])}" if time == 0 else microseconds(the_map.times[time]))
            ax.label_outer()
        figure.colorbar(image, ax=row, location="right")
    axes[0][0].legend(handles=legend(), fontsize=7, loc="lower right")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def draw_limits(the_map, path):
    figure, (left, right) = plt.subplots(1, 2, figsize=(12, 5), constrained_layout=True)
    shades = plt.cm.viridis(np.linspace(0.0, 0.85, len(the_map.times)))
    for time, shade in enumerate(shades):
        draw_lines(left, the_map, time, {"color": shade})
    axes_of(left, "the lines move with the time of observation")
    left.set_ylim(the_map.velocity[0], the_map.velocity[-1])
    left.legend(handles=[Line2D([], [], color=shade, label=microseconds(t)) for t, shade in zip(the_map.times, shades)]
                + [Line2D([], [], color="grey", linestyle=style["linestyle"], label=meaning) for _, meaning, style in LINES],
                fontsize=7, loc="upper right", ncol=2)
    melting = the_map.columns["melting_time_s"][-1] * 1e6
    if np.isfinite(melting).any():
        image = right.pcolormesh(the_map.pressure, the_map.velocity, melting.T, cmap="plasma_r", shading="nearest",
                                 norm=LogNorm(np.nanmin(melting), np.nanmax(melting)))
        right.contour(the_map.pressure, the_map.velocity, melting.T, levels=[t * 1e6 for t in the_map.times], colors="black", linewidths=1)
        figure.colorbar(image, ax=right, label="time to melting, 0.99 T_melt (µs)")
    axes_of(right, f"time to melting (blank: later than {microseconds(the_map.times[-1])})")
    right.set_ylim(the_map.velocity[0], the_map.velocity[-1])
    figure.savefig(path, dpi=110)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=pathlib.Path, help="what shearbus-study map wrote")
    parser.add_argument("--out", type=pathlib.Path, help="where the pictures go (default: the same directory)")
    options = parser.parse_args()
    out = options.out or options.directory
    try:
        the_map = Map(options.directory)
    except (OSError, ValueError, KeyError) as fault:
        print(f"plot_map.py: {fault}", file=sys.stderr)
        return 1
    out.mkdir(parents=True, exist_ok=True)
    for name, draw in (("limits.png", draw_limits), ("fields.png", draw_fields)):
        draw(the_map, out / name)
        print(out / name)
    return 0


if __name__ == "__main__":
    sys.exit(main())
