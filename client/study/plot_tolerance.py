#!/usr/bin/python3
"""Draws the delivered against the requested error from tolerance.json, one line per problem, the largest over its
numbers of host steps; below the diagonal the request is met. Left: the error of T0, and of random histories the largest of T0, impulse
and heat (bars from the median to the largest); right: the cost.
plot_tolerance.py tolerance.json [--out FILE.png]"""
from pictures import arguments, save, style

COLOURS = (style.INK, "#2a8fbd", "#8a7f2d", style.SECOND, "#8a5ba6")


def main():
    study, out = arguments(__doc__)
    figure, (errors, costs) = style.figure(1, 2, (11, 4.4))
    labels = ([], [])
    for problem, colour in zip(study["problems"], COLOURS):
        requests = sorted({run["requested"] for run in problem["runs"]}, reverse=True)
        of = lambda request: [run for run in problem["runs"] if run["requested"] == request]
        worst = [max(max(1.0 if run["temperature_error"] is None else run["temperature_error"], 1e-9) for run in of(request)) for request in requests]
        cost = [max(run["ns_per_node_step"] for run in of(request)) * 1e-3 for request in requests]
        for axes, values, ends in zip((errors, costs), (worst, cost), labels):
            axes.plot(requests, values, color=colour, marker="o", markersize=4, linewidth=1.8)
            ends.append((requests[-1], values[-1], problem["name"], colour))
    for run in study.get("histories", []):
        median, largest = (run["requested"] * run[key] for key in ("median_of_request", "largest_of_request"))
        errors.plot([run["requested"] * 1.12] * 2, (median, largest), color=style.FAINT, linewidth=5, solid_capstyle="butt", zorder=1)
    span = [run["requested"] for problem in study["problems"] for run in problem["runs"]]
    errors.plot((min(span), max(span)), (min(span), max(span)), color=style.FAINT, linewidth=1.2, linestyle="--")
    errors.annotate("requested", (max(span), max(span)), color=style.FAINT, fontsize=9, va="bottom", ha="left")
    errors.set(ylabel="largest error of T0 / (T_melt - T_ref) delivered", ylim=(1e-9, 1))
    costs.set(ylabel="processor time of a node's step (µs), most")
    for axes in (errors, costs):
        axes.set(xscale="log", yscale="log", xlabel="tolerance requested")
        axes.invert_xaxis()
        axes.grid()
    style.round_ticks(costs.yaxis)
    handles = [style.plt.Line2D([], [], color=colour, linewidth=1.8, label=label) for _, _, label, colour in labels[0]]
    if "histories" in study:
        handles.append(style.plt.Line2D([], [], color=style.FAINT, linewidth=5, label=f"{study['histories'][0]['histories']} random histories"))
    errors.legend(handles=handles, loc="lower left")
    save(figure, out, study)


if __name__ == "__main__":
    main()
