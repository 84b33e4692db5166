#!/usr/bin/python3
"""Pictures of one or more runs of cone_target: the cone's free-surface velocity; shape and temperature at the end,
two laws left and right of the axis, with the temperature of the flank on its own scale; slip and displacement of metal
against metal along the flank; and space-time maps along the
interface (regime, interface temperature, sliding speed, shear stress: DLP Figs 16-22; pressure) up to the last
contact. Runs with free slip or stick appear only in the first picture, unless there are no other runs.

    plot_cone.py RUN [RUN ...] --out DIRECTORY       RUN: a directory that shearbus-hydro wrote
"""
import pathlib
from terminal import Parser, end_with, printable
import begin  # noqa: F401

import numpy as np
import style
from matplotlib.collections import PolyCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon
from matplotlib.patheffects import withStroke
from runs import Fault, read

NODES = "interface node: its {} at the start (mm)"
LEVELS = (350, 500, 750, 1000, 1250)  # contours of the interface temperature (K)
ISOLINES = "#7fd6ff"  # seen on the dark and on the bright end of the scale, and no other line
FRONT = {"color": "black", "lw": 1.6, "ls": (0, (2.2, 1.8)),  # on a white line without gaps
         "path_effects": [withStroke(linewidth=2.4, foreground="white", dashes={"dash_offset": 0, "dash_list": None})]}
WHERE = {"coulomb_tresca": ", of the zones at the flank"}  # what the temperature of a law without a layer is
SURFACE = {0.0: "on the axis", 0.5: "at half the radius"}  # by the share of the radius
SURFACE_LABEL = "velocity of the cone's free surface (m/s)"
MAPS = ("regime", "interface_temperature", "sliding_velocity", "shear_stress", "pressure")


def main_runs(runs):
    """Returns the runs whose law has a layer or a temperature of its own, or all if there are none."""
    return [run for run in runs if run.law not in ("free_slip", "stick", "constant")] or runs


def shown(run, name):
    """Returns a map [T, N] in the unit of the pictures, masked where the contact is open; sliding as a speed."""
    return np.ma.masked_where(run["regime"] == 0, run.drawn(name))


def zones(axis, run, frame, values, side, **colours):
    """Draws the zones of a frame left (side -1) or right (1) of the axis."""
    corners = (frame["place"] * 1e3 * (side, 1))[run.quads()]
    drawn = PolyCollection(corners, array=values, edgecolor="none", antialiased=False, rasterized=True, **colours)
    axis.add_collection(drawn)
    return drawn


def outlines(run, frame):
    """Returns {body: [n, 2] corners of its outline in mm}: the edges that one zone alone has, as one loop."""
    found, quads = {}, run.quads()
    for body in np.unique(frame["body"]):
        own = quads[frame["body"] == body]
        edges = np.stack([own, np.roll(own, -1, axis=1)], axis=-1).reshape(-1, 2)
        _, first, count = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
        after = dict(edges[first[count == 1]])
        loop = [next(iter(after))]
        while after[loop[-1]] != loop[0] and len(loop) < len(after):
            loop.append(after[loop[-1]])
        found[int(body)] = frame["place"][loop] * 1e3
    return found


def sides(runs):
    """Returns (run, side) of a mirrored picture: two runs, or one run on both sides."""
    return [(runs[0], -1), (runs[1] if len(runs) > 1 else runs[0], 1)]


def mirrored(axis, runs, time=None, name="temperature", scale=1.0, limits=None):
    """Draws one zone quantity, the first run left of the axis and the second right of it. limits: of style.limits(), of
    this picture if none are given. Returns what a colour bar needs, the arrows, the time, and the highest value."""
    frames = [(run, run.frame(time), side) for run, side in sides(runs)]
    span, extend = limits or style.limits("temperature", *(frame[name] * scale for _, frame, _ in frames), percentile=99.7)
    for run, frame, side in frames:
        drawn = zones(axis, run, frame, frame[name] * scale, side, cmap=style.COLOUR_MAPS["temperature"], clim=(span["vmin"], span["vmax"]))
        for loop in outlines(run, frame).values():
            axis.add_patch(Polygon(loop * (side, 1), fill=False, edgecolor="white", lw=0.7))
    axis.autoscale_view()
    axis.set_aspect("equal")
    axis.set_xlabel("r (mm)")
    axis.set_ylabel("z (mm)")
    axis.xaxis.set_major_formatter(lambda x, _: f"{abs(x):g}")
    for run, _, side in frames if len(runs) > 1 else ():
        axis.text(0.25 if side < 0 else 0.75, 1.01, run.label.replace(" (", "\n("), transform=axis.transAxes, ha="center", va="bottom", fontsize=9)
    return drawn, extend, frames[0][1]["time"], max(frame[name].max() * scale for _, frame, _ in frames)


def draw_flank(axis, runs):
    """Draws the temperature of the interface along the flank: highest, and dashed at the end."""
    for run in runs:
        heat, colour = run["interface_temperature"], run.colour
        axis.plot(run.place * 1e3, heat.max(axis=0), color=colour, lw=1.8)
        axis.plot(run.place * 1e3, heat[-1], "--", color=colour, lw=1.2)
    axis.set(xlabel=NODES.format(runs[0].place_name), ylabel="temperature of the flank (K)", ylim=(280, None))
    axis.grid()


def shape_and_flank(runs):
    runs = runs[:2]
    figure, (shape, flank) = style.figure(1, 2, (11, 5.0), legend=True, width_ratios=(1.25, 1))
    drawn, extend, time, highest = mirrored(shape, runs)
    figure.colorbar(drawn, ax=shape, label=f"temperature of the zones at {time:.1f} µs (K), up to {highest:.0f}", extend=extend, shrink=0.85)
    draw_flank(flank, runs)
    flank.set_title("the flank, on a scale of its own", fontsize=10)
    style.legend_below(figure, [Line2D([], [], color=run.colour, lw=1.8, label=run.label + WHERE.get(run.law, "")) for run in runs] +
                       [Line2D([], [], color=style.FAINT, lw=1.8, label="highest"), Line2D([], [], color=style.FAINT, ls="--", label=f"at {time:.1f} µs")])
    return figure


def displacement(runs):
    """Draws, along the flank, how far each run slipped and how far metal moved against metal over bands around it."""
    figure, axis = style.figure(1, 1, (9.5, 4.4), legend=True)
    bands = (("slip_distance", "-", "slip of the interface"), ("displacement_half_mm", "--", "metal over ±0.5 mm"),
             ("displacement_one_mm", ":", "metal over ±1 mm"))
    for run in runs:
        for name, dashes, _ in bands:
            axis.plot(run.place * 1e3, run[name][-1] * 1e3, dashes, color=run.colour, lw=1.6)
    axis.set(xlabel=NODES.format(runs[0].place_name), ylabel="distance at the end (mm)", ylim=(0, None))
    axis.grid()
    style.legend_below(figure, [Line2D([], [], color=run.colour, lw=1.8, label=run.label) for run in runs] +
                       [Line2D([], [], color=style.FAINT, ls=dashes, lw=1.8, label=label) for _, dashes, label in bands])
    return figure


def front(run):
    """Returns when the shock reaches each node (µs): the first time its pressure exceeds a tenth of the highest of all
    nodes; NaN if it never does."""
    above = run["pressure"] > 0.1 * max(run["pressure"].max(), 0.0)
    return np.where(above.any(axis=0), run.time[above.argmax(axis=0)], np.nan)


def melting_outline(axis, run):
    melting = run["regime"] == list(style.REGIMES).index("MELTING")
    if melting.any():
        axis.contour(run.time, run.place * 1e3, melting.T.astype(float), levels=[0.5], colors=[style.MELTING], linewidths=1.1)
    return bool(melting.any())


def difference(run, other, name):
    """Returns the map of `run` less that of `other` at the times of `run`, masked where either is open."""
    on_time = lambda values: np.column_stack([np.interp(run.time, other.time, values[:, i]) for i in range(values.shape[1])])
    both = (run["regime"] > 0) & (on_time((other["regime"] > 0).astype(float)) > 0.99)
    return np.ma.masked_where(~both, np.nan_to_num(shown(run, name).data) - on_time(np.nan_to_num(shown(other, name).data)))


def map_scale(runs, name):
    """Returns the label, the limits and the arrows of the colour scale that the maps of these runs share, which shows
    every value; of regimes the label alone."""
    if name == "regime":
        return "friction regime", {}, "neither"
    label, _, kind = style.QUANTITIES[name]
    return label, *style.limits(kind, *(shown(run, name) for run in runs), percentile=100)


def isolines(*maps):
    """Returns those LEVELS that cross one of these maps of the interface temperature."""
    return [level for level in LEVELS if any(values.min() < level < values.max() for values in maps)]


def draw_map(axis, run, name, span):
    """Draws the map of one quantity of a run, grey where the contact is open, with the line of the shock. Returns what
    a colour bar needs, the contours or None, and whether a node melts."""
    nodes = run.place * 1e3  # the height moves with the metal: each node keeps its line
    lines, molten = None, False
    if name == "regime":
        values, colours = np.ma.masked_equal(run["regime"], 0), style.regime_colours()
    else:
        values, colours = shown(run, name), {"cmap": style.COLOUR_MAPS[style.QUANTITIES[name][2]], **span}
    image = style.space_time(axis, run.time, nodes, values, **colours)
    if name != "regime":
        levels = isolines(values) if name == "interface_temperature" else []
        lines = axis.contour(run.time, nodes, values.T, levels=levels, colors=ISOLINES, linewidths=0.9) if levels else None
        molten = melting_outline(axis, run)
    axis.plot(front(run), nodes, **FRONT)
    return image, lines, molten


def draw_difference(axis, runs, name):
    """Draws the map of the first run less that of the second. Returns what a colour bar needs, and its arrows."""
    values = difference(*runs, name)
    span, extend = style.limits("signed", values, percentile=100)
    return style.space_time(axis, runs[0].time, runs[0].place * 1e3, values, cmap=style.COLOUR_MAPS["signed"], **span), extend


def have_difference(runs, name):
    return name in ("sliding_velocity", "pressure") and len(runs) == 2 and np.array_equal(runs[0].nodes, runs[1].nodes)


def difference_title(runs):
    """Returns the title of the difference of two runs, the first less the second."""
    return f"{runs[0].label}\nless {runs[1].label}"


def last_time(runs):
    return 1.1 * max(run.last_contact for run in runs)


def space_time(runs, name):
    """Draws the maps of one quantity side by side, and their difference where two runs have the same nodes. Returns
    the figure."""
    compared = have_difference(runs, name)
    count = len(runs) + compared
    figure, axes = style.figure(1, count, (4.3 * count + 1.2, 4.6), legend=True, squeeze=False, sharey=True)
    label, span, extend = map_scale(runs, name)
    drawn = [draw_map(axis, run, name, span) for axis, run in zip(axes[0], runs)]
    for axis, run in zip(axes[0], runs):
        share = run.summary.get("slip_share_coulomb") if name == "regime" else None
        axis.set_title(run.label + (f"\nCoulomb {100 * share:.0f} % of the slip" if share is not None else ""))
    if name != "regime":
        bar = figure.colorbar(drawn[-1][0], ax=list(axes[0][: len(runs)]), label=label, extend=extend, pad=0.02)
        for _, lines, _ in drawn:
            if lines is not None:
                bar.add_lines(lines, erase=False)
    if compared:
        image, extend = draw_difference(axes[0][-1], runs, name)
        axes[0][-1].set_title(difference_title(runs))
        figure.colorbar(image, ax=axes[0][-1], label=f"difference of {label}", extend=extend)
    for axis in axes[0]:
        axis.set_xlim(0.0, last_time(runs))
        axis.set_xlabel("time (µs)")
    axes[0][0].set_ylabel(NODES.format(runs[0].place_name))
    handles = [Line2D([], [], **FRONT, label="shock: a tenth of the highest pressure")]
    if name == "regime":
        handles = style.regime_handles(np.concatenate([np.unique(run["regime"]) for run in runs])) + handles
    else:
        handles = style.regime_handles([0]) + handles + [Line2D([], [], color=style.MELTING, lw=1.1, label=style.MELTING_LABEL)] * any(molten for _, _, molten in drawn)
    levels = sorted({float(level) for _, lines, _ in drawn if lines is not None for level in lines.levels})
    if levels:
        handles.append(Line2D([], [], color=ISOLINES, lw=0.9, label=", ".join(f"{level:g}" for level in levels) + " K"))
    style.legend_below(figure, handles)
    return figure


def surfaces(runs):
    """Returns the runs that have a free surface, and the time at which it begins to move (µs)."""
    runs = [run for run in runs if run.surface is not None]
    starts = [time[(np.abs(speed) > 1.0).any(axis=1)][0] if (np.abs(speed) > 1.0).any() else time[0] for time, speed in (run.surface for run in runs)]
    return runs, min(starts, default=0.0)


def draw_surface(axis, runs, begin, where):
    """Draws the velocity of the free surface of these runs at a share of its radius."""
    for run in runs:
        time, speed = run.surface
        axis.plot(time, speed[:, int(where * (speed.shape[1] - 1))], color=run.colour, lw=1.5)
    axis.set(xlabel="time (µs)", title=SURFACE[where], xlim=(0.9 * begin, max(run.surface[0][-1] for run in runs)))
    axis.grid()


def free_surface(runs):
    runs, begin = surfaces(runs)
    figure, axes = style.figure(1, 2, (11, 4.2), sharey=True)
    for axis, where in zip(axes, SURFACE):
        draw_surface(axis, runs, begin, where)
    axes[0].set_ylabel(SURFACE_LABEL)
    figure.canvas.draw()
    for axis, where in zip(axes, SURFACE):
        style.label_ends(axis, [(run.surface[0][-1], run.surface[1][-1, int(where * (run.surface[1].shape[1] - 1))], run.label, run.colour)
                                for run in runs])
    return figure


OF_LINES = ("cone_displacement.png", "cone_regime.png", "cone_free_surface.png")  # few colours


def pictures(runs):
    """Yields (name of the file, figure) of all pictures of these runs."""
    if main := main_runs([run for run in runs if run.table is not None]):
        yield "cone_temperature.png", shape_and_flank(main)
        if all("displacement_one_mm" in run for run in main):
            yield "cone_displacement.png", displacement(main)
        for name in MAPS:
            yield f"cone_{name}.png", space_time(main, name)
    if any(run.surface is not None for run in runs):
        yield "cone_free_surface.png", free_surface(runs)


def main():
    parser = Parser(description=__doc__)
    parser.add_argument("runs", nargs="+", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    options = parser.parse_args()
    runs = read(options.runs)
    if flat := [run for run in runs if not run.two_dimensions]:
        raise Fault(f"{flat[0].path}: expected a run in two dimensions, found one of columns or a result, which plot_histories.py draws")
    for name, figure in pictures(runs):
        style.save(figure, options.out / name, [run.provenance for run in runs], colours=64 if name in OF_LINES else None)
        print(f"  picture                 {printable(options.out / name)}")


if __name__ == "__main__":
    end_with(main, Fault, OSError)
