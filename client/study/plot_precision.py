#!/usr/bin/python3
"""Draws error against run time from precision.json: one panel per problem with every setting in grey, one line per
grid and method over the step length; three named settings; and the efficient front. The numbers are in the study's
own table. plot_precision.py precision.json [--out FILE.png]"""
from pictures import arguments, save, style

NAMED = {  # integrator, cells, accuracy of the modes, grading -> label and colour
    ("backward_euler", 500, 0.0, 1.0): ("500 cells, backward Euler (the paper's)", style.SECOND),
    ("sdirk2", 30, 0.0, 1.25): ("30 cells x1.25, SDIRK2", "#8a7f2d"),
    ("sdirk2", 0, 1e-3, 1.0): ("modes 1e-3, SDIRK2", "#2a8fbd"),
}
FRONT = "efficient: nothing is better and faster"
UNRESOLVED = {"facecolor": "#ebebeb", "edgecolor": style.FAINT, "linewidth": 0.5}


def panel(axes, problem):
    """Draws a problem. Returns the settings of its lines."""
    lines = {}
    for run in problem["runs"]:
        if run["temperature_error"] is not None:
            lines.setdefault((run["integrator"], run["cells"], run["modes_accuracy"], run["grading"]), []).append(run)
    for key, runs in sorted(lines.items(), key=lambda item: item[0] in NAMED):
        label, colour = NAMED.get(key, (None, style.GRID))
        axes.plot([r["ns_per_node"] * 1e-3 for r in runs], [max(r["temperature_error"], 1e-9) for r in runs], color=colour,
                  linewidth=1.8 if label else 0.8, marker="o" if label else None, markersize=4)
    front = sorted((r["ns_per_node"] * 1e-3, r["temperature_error"]) for r in problem["runs"] if r["efficient"])
    axes.plot(*zip(*front), color=style.INK, linewidth=2.6, zorder=4)
    resolved = 10 * problem["uncertainty"]  # as kResolved of precision.cpp
    if resolved > 1e-9:
        axes.axhspan(1e-9, resolved, **UNRESOLVED)
    axes.set(xscale="log", yscale="log", ylim=(1e-8, 1), title=problem["title"])
    axes.set_yticks([1e-8, 1e-6, 1e-4, 1e-2, 1])
    axes.grid()
    return set(lines)


def main():
    study, out = arguments(__doc__)
    problems = study["problems"]
    columns = min(3, len(problems) + 1)
    rows = -(-(len(problems) + 1) // columns)  # with a place for the legend
    figure, grid = style.figure(rows, columns, (3.6 * columns, 3.1 * rows + 0.3), squeeze=False, sharey=True)
    flat = list(grid.flat)
    drawn = set().union(*(panel(axes, problem) for axes, problem in zip(flat, problems)))
    for row in grid:
        row[0].set_ylabel("largest error of T0 / (T_melt - T_ref)", fontsize=9)
    keys = [style.plt.Line2D([], [], color=style.INK, linewidth=2.6, label=FRONT)]
    keys += [style.plt.Line2D([], [], color=colour, linewidth=1.8, marker="o", markersize=4, label=label) for key, (label, colour) in NAMED.items() if key in drawn]
    keys += [style.plt.Line2D([], [], color=style.GRID, label="all other settings"), style.Patch(**UNRESOLVED, label="not resolved by the reference")]
    for axes in flat[len(problems):]:
        axes.axis("off")
    flat[len(problems)].legend(handles=keys, fontsize=10, loc="center")
    for axes in [a for i, a in enumerate(flat) if i < len(problems) and i + columns >= len(problems)]:
        axes.set_xlabel("processor time of a node's run (µs)")
    save(figure, out, study)


if __name__ == "__main__":
    main()
