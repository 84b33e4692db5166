#!/usr/bin/python3
"""Draws error against run time from precision.json: one panel per problem, one line per grid and method over the step length, the efficient
front in black, and slopes of first and second order for reference.   plot_precision.py precision.json [--out FILE.png]"""
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from pictures import arguments, save_small  # noqa: E402

STYLES = {("backward_euler", False): ("tab:orange", "-"), ("sdirk2", False): ("tab:blue", "-"),
          ("backward_euler", True): ("tab:red", "--"), ("sdirk2", True): ("tab:green", "--")}
NAMES = {("backward_euler", False): "profile, backward Euler", ("sdirk2", False): "profile, SDIRK2",
         ("backward_euler", True): "modes, backward Euler", ("sdirk2", True): "modes, SDIRK2"}
MARKERS = {500: "s", 100: "D", 240: "^", 120: "v", 60: "o", 30: "x", 15: "+", 0: "."}


def panel(axes, problem):
    lines = {}
    for run in problem["runs"]:
        if run["temperature_error"] is not None:
            lines.setdefault((run["integrator"], run["cells"], run["grading"], run["modes_accuracy"]), []).append(run)
    for (integrator, cells, _, _), runs in lines.items():
        colour, dashes = STYLES[integrator, cells == 0]
        axes.plot([r["ns_per_node"] * 1e-3 for r in runs], [max(r["temperature_error"], 1e-9) for r in runs], dashes,
                  color=colour, marker=MARKERS.get(cells, "."), markersize=3, linewidth=0.7, alpha=0.8)
    front = sorted((r["ns_per_node"] * 1e-3, r["temperature_error"]) for r in problem["runs"] if r["efficient"])
    axes.plot(*zip(*front), color="black", linewidth=1.6, label="efficient front")
    if problem["uncertainty"] > 1e-9:
        axes.axhspan(1e-9, problem["uncertainty"], color="0.85", label="reference's own error")
    x = front[0][0] * 3, front[0][0] * 30
    for order, where in ((1, 2e-1), (2, 2e-1)):
        axes.plot(x, (where, where * 10.0**-order), color="0.5", linewidth=0.8, linestyle=":")
        axes.annotate(f"order {order}", (x[1], where * 10.0**-order), fontsize=6, color="0.4")
    axes.set(xscale="log", yscale="log", ylim=(1e-8, 1), title=problem["title"], xlabel="CPU time of a node's run, µs",
             ylabel="max |T0 error| / (T_melt - T_ref)")
    axes.title.set_fontsize(9)
    axes.xaxis.label.set_fontsize(7)
    axes.yaxis.label.set_fontsize(7)
    axes.tick_params(labelsize=6)
    axes.grid(alpha=0.3, linewidth=0.4)


def main():
    study, out = arguments(__doc__)
    problems = study["problems"]
    columns = min(3, len(problems))
    rows = -(-len(problems) // columns)
    figure, grid = plt.subplots(rows, columns, figsize=(3.6 * columns, 3.0 * rows), squeeze=False)
    flat = list(grid.flat)
    for axes, problem in zip(flat, problems):
        panel(axes, problem)
    keys = [plt.Line2D([], [], color=c, linestyle=d, label=NAMES[key]) for key, (c, d) in STYLES.items()]
    keys += [plt.Line2D([], [], color="0.3", linestyle="", marker=MARKERS[n], markersize=4,
                        label=f"{n} cells" if n else "no cells") for n in MARKERS]
    keys.append(plt.Line2D([], [], color="black", label="efficient front"))
    for axes in flat[len(problems):]:
        axes.axis("off")
    (flat[-1] if len(flat) > len(problems) else flat[0]).legend(handles=keys, fontsize=6, loc="center" if len(flat) > len(problems) else "lower left", ncol=2)
    figure.suptitle(f"Error against run time, {study['date']}, {study['processor']}", fontsize=8)
    figure.tight_layout()
    save_small(figure, out)


if __name__ == "__main__":
    main()
