#!/usr/bin/python3
"""One picture of the physics, from two runs of cone_target with the subgrid server and with another law: the cone
with the temperature of its interface on both sides, the temperature across the layer of one node, and the history of
that node.

    plot_overview.py SUBGRID OTHER --out FILE.png [--time MICROSECONDS]

The temperature across the interface is that of the heat which friction gave to both bodies, stress times growth of
the slip distance as recorded, conducted into two half-spaces (exact for heat that is constant between two rows). The script ends with an error where
this differs at z = 0 from the recorded interface temperature by more than 3 %."""
import pathlib
from terminal import Parser, end_with, printable, real_number
import begin  # noqa: F401

import numpy as np
import plot_cone
import style
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from plot_history import regime_band
from runs import Fault, read
from scipy.special import erfc

MOST_WRONG = 0.03  # of the rise of the temperature at z = 0
DEPTH = 30e-6  # m, of the profile into each body


def ierfc(x):
    return np.exp(-x * x) / np.sqrt(np.pi) - x * erfc(x)


def profile(run, node, row, z):
    """Returns the temperature (K) at the places z (m; > 0 soft, < 0 hard) of a node at the end of a row of the
    history."""
    soft, hard = run.scene["soft"], run.scene["hard"]
    begin, end = np.concatenate(([0.0], run.table["time"][:row])), run.table["time"][: row + 1]
    heat = run["shear_stress"][: row + 1, node] * np.diff(run["slip_distance"][: row + 1, node], prepend=0.0) / (end - begin)
    effusivity = [body["thermal_conductivity_w_per_m_k"] / np.sqrt(body["thermal_diffusivity_m2_per_s"]) for body in (soft, hard)]
    rise = np.zeros_like(z)
    for body, side, own in ((soft, z >= 0, effusivity[0]), (hard, z < 0, effusivity[1])):
        conductivity, diffusivity = body["thermal_conductivity_w_per_m_k"], body["thermal_diffusivity_m2_per_s"]
        for since, sign in ((end[-1] - begin, 1.0), (end[-1] - end, -1.0)):  # heat from `begin` on, less heat from `end` on
            reach = 2.0 * np.sqrt(diffusivity * np.maximum(since, 1e-30))
            part = reach / conductivity * ierfc(np.abs(z[side])[:, None] / reach) * (since > 0)
            rise[side] += sign * (part * heat * own / sum(effusivity)).sum(axis=1)
    return run.scene["layer"]["initial_temperature_k"] + rise


def checked_profile(run, node, row, z):
    found, recorded = profile(run, node, row, np.zeros(1))[0], run["interface_temperature"][row, node]
    if abs(found - recorded) > MOST_WRONG * (run["interface_temperature"][:, node].max() - run.scene["layer"]["initial_temperature_k"]):
        raise Fault(f"{run.path}: the recorded heat gives {found:.1f} K at the interface of node {run.nodes[node]}, recorded are {recorded:.1f} K")
    return profile(run, node, row, z)


def cone(figure, axis, runs, time):
    """Draws zones by pressure, in grey, and the flank by the temperature of the interface."""
    span = {"cmap": style.COLOUR_MAPS["temperature"], "norm": style.plt.Normalize(300.0, 1250.0)}
    frames = [(run, run.frame(time), side) for run, side in plot_cone.sides(runs)]
    highest = max(frame["pressure"].max() for _, frame, _ in frames) * 1e-9
    for run, frame, side in frames:
        plot_cone.zones(axis, run, frame, frame["pressure"] * 1e-9, side, cmap="Greys", clim=(0.0, 1.3 * highest))
        for loop in plot_cone.outlines(run, frame).values():
            axis.add_patch(plot_cone.Polygon(loop * (side, 1), fill=False, edgecolor=style.FAINT, lw=0.5))
        row = int(np.abs(run.time - frame["time"]).argmin())
        points = np.column_stack((side * run["radius"][row], run["height"][row])) * 1e3
        heat = run["interface_temperature"][row]
        line = LineCollection(np.stack([points[:-1], points[1:]], axis=1), array=0.5 * (heat[1:] + heat[:-1]), lw=5.5, capstyle="round", **span)
        axis.add_collection(LineCollection([points], colors=[style.INK], lw=7.0, capstyle="round"))
        axis.add_collection(line)
        axis.text(10.5 * side, 22.0, run.label.replace(" (", "\n("), ha="center", va="bottom", fontsize=9)
    axis.set(xlim=(-15.5, 15.5), ylim=(-6, 25.5))
    axis.set_aspect("equal")
    axis.axis("off")
    for text, place in (("flyer", (0, -3.5)), ("cone", (0, 7)), ("confinement", (11.0, 12))):
        axis.annotate(text, place, ha="center", fontsize=9, color=style.INK, bbox={"boxstyle": "round,pad=0.2", "fc": "#ffffffb0", "ec": "none"})
    figure.colorbar(line, ax=axis, orientation="horizontal", label="temperature of the interface (K)", extend="both", shrink=0.9, pad=0.02, aspect=30)
    return frames[0][1]["time"]


def overview(runs, time):
    main = runs[0]
    node = int(np.nanmax(main["interface_temperature"][:], axis=0).argmax())
    figure = style.plt.figure(figsize=(9.6, 4.7), layout="constrained")
    figure.get_layout_engine().set(rect=(0.004, 0.105, 0.992, 0.885), wspace=0.06)
    grid = figure.add_gridspec(4, 3, width_ratios=(1.3, 0.85, 1.0), height_ratios=(3, 3, 3, 0.6))
    left = figure.add_subplot(grid[:, 0])
    left.set_title(f"behind the shock, at {cone(figure, left, runs, time):.1f} µs")

    axis = figure.add_subplot(grid[:, 1])
    z = np.linspace(-DEPTH, DEPTH, 401)
    peak = int(main["interface_temperature"][:, node].argmax())
    begin = int((main["interface_temperature"][:, node] > 0.5 * (300 + main["interface_temperature"][peak, node])).argmax())
    rows = (begin, peak, min(len(main.time) - 1, peak + 2 * (peak - begin) + 20))
    for row, shade in zip(rows, (0.15, 0.5, 0.8)):
        axis.plot(z * 1e6, checked_profile(main, node, row, z), color=style.plt.cm.plasma(shade), lw=1.8, label=f"{main.time[row]:.1f} µs")
    axis.axvline(0.0, color=style.FAINT, lw=0.8)
    axis.set(xlim=(-DEPTH * 1e6, DEPTH * 1e6), xlabel="steel ← z (µm) → aluminium", ylabel="temperature (K)", title="across its interface")
    axis.legend(loc="upper left", handlelength=1.2)
    axis.grid()

    axes = [figure.add_subplot(grid[0, 2])]
    axes += [figure.add_subplot(grid[i, 2], sharex=axes[0]) for i in range(1, 4)]
    start = 0.85 * main.time[(main["pressure"][:, node] > 0.02 * main["pressure"][:, node].max()).argmax()]
    for axis, name, label in zip(axes, ("shear_stress", "sliding_velocity", "interface_temperature"), ("stress\n(MPa)", "sliding\n(m/s)", "temperature\n(K)")):
        for run in runs:
            axis.plot(run.time, run.drawn(name)[:, node], color=run.colour, lw=1.6)
        axis.set_ylabel(label, fontsize=9)
        axis.tick_params(labelbottom=False)
        axis.grid()
    regime_band(axes[-1], main.time, main["regime"][:, node])
    axes[-1].set(xlabel="time (µs)", xlim=(start, 1.02 * main.last_contact))
    axes[0].set_title(f"one node, {main.place[node] * 1e3:.0f} mm up the cone")
    figure.align_ylabels(axes)
    seen = np.unique(main["regime"][main.time > start, node])
    handles = [Line2D([], [], color=run.colour, lw=1.8, label=run.label) for run in runs] + style.regime_handles(seen)
    figure.legend(handles=handles, loc="lower center", bbox_to_anchor=(0.5, 0.035), ncols=len(handles), columnspacing=1.4, handlelength=1.4)
    return figure


def main():
    parser = Parser(description=__doc__)
    parser.add_argument("subgrid", type=pathlib.Path)
    parser.add_argument("other", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--time", type=real_number, default=4.0, help="µs, of the left picture (default 4)")
    options = parser.parse_args()
    runs = read([options.subgrid, options.other])
    if flat := [run for run in runs if not run.two_dimensions or run.table is None]:
        raise Fault(f"{flat[0].path}: expected a run of cone_target")
    style.save(overview(runs, options.time), options.out, [run.provenance for run in runs])
    print(f"  picture                 {printable(options.out)}")


if __name__ == "__main__":
    end_with(main, Fault, OSError)
