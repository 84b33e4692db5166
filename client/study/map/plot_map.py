#!/usr/bin/python3
"""Draws the results of `shearbus-study map`: slip carried, time to melting, friction coefficient and temperature over pressure and
velocity. Three lines show the velocity below which the layer sticks although slip is imposed, the velocity below which the velocity-driven
model is outside its domain, and the velocity above which the interface has melted.

    plot_map.py DIR [--out DIR]
"""
import csv
import pathlib
import sys

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[3] / "client/report"))
import style  # noqa: E402
from terminal import Parser, complain, read_json  # noqa: E402

LINES = [  # key in map.json, meaning, style
    ("sticking_below_m_per_s", "sticks below", {"color": style.INK, "linestyle": "-"}),
    ("domain_limit_m_per_s", "outside the domain below", {"color": style.INK, "linestyle": "--"}),
    ("melting_above_m_per_s", "melting above", {"color": style.MELTING, "linestyle": "-."}),
]
PANELS = [  # column of nodes.csv, title, colour map, scale, logarithmic
    ("slip_share", "share of the imposed slip carried", "viridis", 1.0, False),
    ("friction_coefficient", "friction coefficient s/P", "magma", 1.0, True),
    ("interface_temperature_k", "interface temperature (K)", "inferno", 1.0, False),
]


class Map:
    def __init__(self, directory):
        self.json = read_json(directory / "map.json")
        self.provenance = {**self.json.get("provenance", {}), "program": "shearbus-study map"}
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
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def draw_lines(ax, the_map, time, colors=None):
    for key, _, line in LINES:
        ax.plot(the_map.pressure, the_map.line(time, key), linewidth=1.8, **(line | (colors or {})))


def handles(color=None):
    return [Line2D([], [], label=meaning, **(line | ({"color": color} if color else {}))) for _, meaning, line in LINES]


def microseconds(time):
    return f"{time * 1e6:g} µs"


def draw_fields(the_map):
    count = len(the_map.times)
    figure, axes = style.figure(len(PANELS), count, (1.2 + 3.2 * count, 0.8 + 2.9 * len(PANELS)), legend=True, squeeze=False, sharex=True, sharey=True)
    for row, (name, title, colors, scale, logarithmic) in zip(axes, PANELS):
        values = the_map.columns[name] * scale
        low, high = np.nanmin(values), np.nanmax(values)
        norm = {"norm": LogNorm(max(low, 1e-4 * high), high)} if logarithmic else {"vmin": low, "vmax": high}
        for time, ax in enumerate(row):
            image = ax.pcolormesh(the_map.pressure, the_map.velocity, values[time].T, cmap=colors, shading="gouraud", rasterized=True, **norm)
            draw_lines(ax, the_map, time, {"color": "white"} if name != "slip_share" else None)
            axes_of(ax, microseconds(the_map.times[time]))
            ax.label_outer()
        figure.colorbar(image, ax=list(row), location="right", label=title)
    style.legend_below(figure, handles(style.FAINT))
    return figure


def draw_limits(the_map):
    figure, (left, right) = style.figure(1, 2, (11, 4.8), legend=True)
    shades = style.plt.cm.viridis(np.linspace(0.0, 0.85, len(the_map.times)))
    for time, shade in enumerate(shades):
        draw_lines(left, the_map, time, {"color": shade})
    axes_of(left, "the lines move with the time of observation")
    left.set_ylim(the_map.velocity[0], the_map.velocity[-1])
    left.grid()
    left.legend(handles=[Line2D([], [], color=shade, lw=3, label=microseconds(t)) for t, shade in zip(the_map.times, shades)], loc="upper right")
    melting = np.ma.masked_invalid(the_map.columns["melting_time_s"][-1] * 1e6)
    axes_of(right, f"time to melting (grey: later than {microseconds(the_map.times[-1])})")
    right.set_facecolor(style.GRID)
    if melting.count() > 3:
        levels = np.geomspace(melting.min(), melting.max() * (1 + 1e-9), 16)
        image = right.contourf(the_map.pressure, the_map.velocity, melting.T, levels=levels, cmap="plasma_r", norm=LogNorm(levels[0], levels[-1]))
        if seen := [t * 1e6 for t in the_map.times if levels[0] < t * 1e6 < levels[-1]]:
            right.clabel(right.contour(the_map.pressure, the_map.velocity, melting.T, levels=seen, colors=style.INK, linewidths=1), fmt="%g µs", fontsize=9)
        style.round_ticks(figure.colorbar(image, ax=right, label=f"time to {style.MELTING_LABEL} (µs)").ax.yaxis)
    right.set(xlim=the_map.pressure[[0, -1]], ylim=the_map.velocity[[0, -1]])
    style.legend_below(figure, handles(style.FAINT))
    return figure


def main():
    parser = Parser(description=__doc__)
    parser.add_argument("directory", type=pathlib.Path, help="what shearbus-study map wrote")
    parser.add_argument("--out", type=pathlib.Path, help="where the pictures go (default: the same directory)")
    options = parser.parse_args()
    out = options.out or options.directory
    try:
        the_map = Map(options.directory)
    except (OSError, ValueError, KeyError) as fault:
        complain("plot_map.py", fault)
        return 1
    out.mkdir(parents=True, exist_ok=True)
    for name, draw, colours in (("limits.png", draw_limits, 64), ("fields.png", draw_fields, None)):
        style.save(draw(the_map), out / name, [the_map.provenance], colours)
        print(out / name)
    return 0


if __name__ == "__main__":
    sys.exit(main())
