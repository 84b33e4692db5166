#!/usr/bin/python3
"""Draws histories of shearbus-hydro in one dimension, or results of shearbus-replay: temperature, shear stress and
sliding speed of the interface against time, and a map of regimes where there are many columns. Several runs stand
side by side.

    plot_histories.py RUN [RUN ...] --out DIRECTORY      RUN: a directory that shearbus-hydro wrote, or a file of results
"""
import pathlib
import warnings
from terminal import Parser, end_with, printable
import begin  # noqa: F401

import matplotlib.pyplot as plt
import numpy as np
import style
from matplotlib.colors import ListedColormap, Normalize
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from runs import Fault, read

MOST_LINES = 8   # lines in one panel; with more columns, some lines and the band of all columns
MOST_PANELS = 6  # panels side by side
BAND = "#ebebeb"
LINES = ListedColormap(plt.cm.viridis(np.linspace(0.2, 0.88, 256)))
SHOWN = ("interface_temperature", "shear_stress", "sliding_velocity")


def jump(run):
    """Returns the initial velocity jump of each column, or its highest sliding speed where the jump is unknown (m/s)."""
    return np.abs(run["velocity_jump"][0]) if "velocity_jump" in run else np.abs(run["sliding_velocity"]).max(axis=0)


def jump_label(runs):
    return "initial velocity jump (m/s)" if all("velocity_jump" in run for run in runs) else "highest sliding speed (m/s)"


def pressure_varies(run):
    return "pressure" in run and bool(np.any(run["pressure"] != run["pressure"][0]))


def groups(run):
    """Returns (title, columns) for each initial pressure, with the columns in the order of their initial jump."""
    order = np.argsort(jump(run), kind="stable")
    if "pressure" not in run or pressure_varies(run) or np.unique(run["pressure"][0]).size > 3 * MOST_PANELS:
        return [("", order)]
    first = run["pressure"][0]
    return [(f"P = {value * 1e-9:g} GPa", order[first[order] == value]) for value in sorted(set(first), reverse=True)]


def panels_of(runs):
    """Returns (run, title, columns) for each panel, in the order of pressure, then of runs, and the number of panels
    left out."""
    most = max(1, MOST_PANELS // len(runs))
    chosen = []
    for run in runs:
        own = groups(run)
        kept = np.unique(np.linspace(0, len(own) - 1, min(most, len(own))).round().astype(int))
        chosen.append([own[i] for i in kept])
    panels = [(run, "\n".join(text for text in (run.label, own[rank][0]) if text), own[rank][1])
              for rank in range(max(map(len, chosen))) for run, own in zip(runs, chosen) if rank < len(own)]
    return panels, sum(len(groups(run)) for run in runs) - len(panels)


def colours(runs):
    """Returns the colours of the lines by their jump, neither too dark nor too light for any paper."""
    jumps = np.concatenate([jump(run) for run in runs])
    scale = plt.cm.ScalarMappable(Normalize(jumps.min(), jumps.max() if jumps.max() > jumps.min() else jumps.min() + 1.0), LINES)
    scale.by_jump = any(np.ptp(jump(run)) > 0 for run in runs)  # else each run has its own colour
    return scale


def quantities(runs):
    return list(SHOWN) + ["pressure"] * any(pressure_varies(run) for run in runs)


def draw_history(axis, run, columns, name, scale):
    """Draws one quantity of some columns against time. Returns whether a band stands for lines that are left out, and
    whether the melting temperature is drawn."""
    label = style.QUANTITIES[name][0]
    values = run.drawn(name)
    chosen = columns if columns.size <= MOST_LINES else columns[np.unique(np.linspace(0, columns.size - 1, 6).round().astype(int))]
    banded = columns.size > chosen.size
    if banded:
        with warnings.catch_warnings():  # no column slides at some times
            warnings.simplefilter("ignore", RuntimeWarning)
            axis.fill_between(run.time, np.nanmin(values[:, columns], axis=1), np.nanmax(values[:, columns], axis=1), color=BAND, lw=0)
    for column in chosen:
        axis.plot(run.time, values[:, column], color=scale.to_rgba(jump(run)[column]) if scale.by_jump else run.colour, lw=1.4)
    melting = run.scene.get("soft", {}).get("melting_temperature_k")
    melts = name == "interface_temperature" and melting and run.scene["soft"].get("melting_curve", "constant") == "constant"
    if melts:
        axis.axhline(0.99 * melting, color=style.FAINT, lw=1.0, ls="--")
    axis.set_ylabel(label)
    axis.grid()
    axis.set_xlim(0.0, run.time[-1])
    return banded, bool(melts)


def histories(runs):
    """Returns the figure of the histories and the number of panels that it leaves out."""
    panels, left_out = panels_of(runs)
    names = quantities(runs)
    figure, axes = style.figure(len(names), len(panels), (1.6 + max(2.7 * len(panels), 5.0), 2.2 * len(names) + 1.0), legend=True,
                                sharex="col", sharey="row", squeeze=False)  # runs may end at other times
    scale = colours(runs)
    found = np.array([draw_history(axis, run, columns, name, scale) for p, (run, _, columns) in enumerate(panels) for axis, name in zip(axes[:, p], names)])
    for p, (_, title, _) in enumerate(panels):
        axes[0, p].set_title(title)
        axes[-1, p].set_xlabel("time (µs)")
        for axis in axes[:, p] if p > 0 else ():
            axis.set_ylabel("")
    if scale.by_jump:
        figure.colorbar(scale, ax=list(axes[:, -1]), label=jump_label(runs), shrink=0.6, pad=0.03)
    banded, melts = found.any(axis=0)
    handles = [Patch(color=BAND, label="range of all columns")] * bool(banded)
    handles += [Line2D([], [], color=style.FAINT, lw=1.0, ls="--", label=style.MELTING_LABEL)] * bool(melts)
    if handles:
        style.legend_below(figure, handles)
    return figure, left_out


def draw_regimes(axis, run, columns, label):
    """Draws the map of the regimes of some columns. label: of their jump."""
    rows = jump(run)[columns]
    regular = columns.size > 1 and np.all(np.diff(rows) > 0)
    style.space_time(axis, run.time, rows if regular else np.arange(columns.size), np.ma.masked_equal(run["regime"][:, columns], 0), **style.regime_colours())
    axis.set(xlim=(0.0, min(1.1 * run.last_contact, run.time[-1])), xlabel="time (µs)", ylabel=label if regular else f"column, by {label[:-6]}")


def regimes(runs):
    panels, _ = panels_of(runs)
    figure, axes = style.figure(1, len(panels), (1.2 + 2.7 * len(panels), 4.4), legend=True, sharey=True, squeeze=False)
    for axis, (run, title, columns) in zip(axes[0], panels):
        draw_regimes(axis, run, columns, jump_label(runs))
        axis.set_title(title)
        axis.label_outer()
    style.legend_below(figure, style.regime_handles(np.concatenate([np.unique(run["regime"][:, columns]) for run, _, columns in panels])))
    return figure


def has_many(runs):
    """Returns whether the runs have enough columns for a map of regimes."""
    return all("regime" in run for run in runs) and any(run["regime"].shape[1] > MOST_LINES for run in runs)


def pictures(runs):
    """Yields (name of the file, figure, number of panels left out) of all pictures of these runs."""
    yield "histories.png", *histories(runs)
    if has_many(runs):
        yield "regimes.png", regimes(runs), 0


def main():
    parser = Parser(description=__doc__)
    parser.add_argument("runs", nargs="+", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("."), help="directory for the pictures")
    options = parser.parse_args()
    runs = read(options.runs)
    if cones := [run for run in runs if run.two_dimensions]:
        raise Fault(f"{cones[0].path}: expected a run of columns or a result, found a run in two dimensions, which plot_cone.py draws")
    for name, figure, left_out in pictures(runs):
        style.save(figure, options.out / name, [run.provenance for run in runs])
        print(f"  picture                 {printable(options.out / name)}" + (f" ({left_out} panels left out)" if left_out else ""))


if __name__ == "__main__":
    end_with(main, Fault, OSError)
