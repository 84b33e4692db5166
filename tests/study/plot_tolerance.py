#!/usr/bin/python3
"""Draws the delivered against the requested error from tolerance.json, one line per problem and number of host steps; below the diagonal
the request is met. Left: the error of T0; right: its cost.   plot_tolerance.py tolerance.json [--out FILE.png]"""
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from pictures import arguments, save_small  # noqa: E402

COLOURS = ("tab:blue", "tab:orange", "tab:green", "tab:red", "tab:purple")
DASHES = (":", "--", "-")


def main():
    study, out = arguments(__doc__)
    figure, (errors, costs) = plt.subplots(1, 2, figsize=(8.0, 3.6))
    for problem, colour in zip(study["problems"], COLOURS):
        by_steps = {}
        for run in problem["runs"]:
            by_steps.setdefault(run["steps"], []).append(run)
        for (steps, runs), dashes in zip(sorted(by_steps.items()), DASHES):
            x = [r["requested"] for r in runs]
            errors.plot(x, [max(r["temperature_error"] or 1.0, 1e-9) if r["temperature_error"] != 0 else None for r in runs],
                        dashes, color=colour, marker=".", markersize=4, linewidth=0.9, label=f"{problem['name']}, {steps} steps")
            costs.plot(x, [r["ns_per_node_step"] * 1e-3 for r in runs], dashes, color=colour, marker=".", markersize=4, linewidth=0.9)
    ends = (1e-6, 1e-1)
    errors.plot(ends, ends, color="black", linewidth=1.2, label="requested")
    errors.set(ylabel="largest |T0 error| / (T_melt - T_ref) delivered", ylim=(1e-8, 1))
    costs.set(ylabel="CPU time of a node's step, µs")
    for axes in (errors, costs):
        axes.set(xscale="log", yscale="log", xlabel="tolerance requested")
        axes.invert_xaxis()
        axes.grid(alpha=0.3, linewidth=0.4)
        axes.tick_params(labelsize=7)
        axes.xaxis.label.set_fontsize(8)
        axes.yaxis.label.set_fontsize(8)
    costs.legend(*errors.get_legend_handles_labels(), fontsize=5, loc="upper left")
    figure.suptitle(f"Tolerances, {study['date']}, {study['processor']}", fontsize=8)
    figure.tight_layout()
    save_small(figure, out)


if __name__ == "__main__":
    main()
