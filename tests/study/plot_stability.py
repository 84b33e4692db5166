#!/usr/bin/python3
"""Draws the envelope from stability.json, rows against physics. The colour shows the largest effort of a step of eight nodes, in
evaluations; the number is the share of the heat that a molten interface would take, in brackets if the row did not reach its regime; a
cross marks a broken invariant; blank cells do not apply. For a single scene the evaluations are printed, too.   plot_stability.py
stability.json [--out FILE.png]"""
import textwrap

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.colors import LogNorm  # noqa: E402
from pictures import arguments  # noqa: E402


def effort(cell):
    return max(1, cell["layer_sums"] + cell["limit_values"] + cell["newton_steps"])


def text_of(cell, alone):
    if cell["verdict"] == "broken":
        return {"s": "x", "fontsize": 11, "color": "red"}
    share = f"{cell['bound_share']:.2f}".lstrip("0") if cell["bound_share"] else ""
    if cell["verdict"] == "not met":
        share = f"({share})"
    return {"s": f"{share}   {effort(cell)}" if alone else share, "fontsize": 5, "color": "black"}


def main():
    study, out = arguments(__doc__)
    rows = [row["name"] for row in study["rows"]]
    physics = study["physics"]
    alone = study["scene"] is not None
    cells = {(cell["row"], cell["physics"]): cell for cell in study["cells"]}
    field = [[float("nan")] * len(physics) for _ in rows]
    figure, axes = plt.subplots(figsize=(6 if alone else 0.42 * len(physics) + 3.4, 0.3 * len(rows) + (1.5 if alone else 2.6)))
    for r, row in enumerate(rows):
        for p, name in enumerate(physics):
            cell = cells[row, name]
            if cell["verdict"] != "not asked":
                field[r][p] = effort(cell)
                axes.text(p, r, ha="center", va="center", **text_of(cell, alone))
    picture = axes.imshow(field, norm=LogNorm(1, 2e4), cmap="YlGnBu", aspect="auto", alpha=0.75)
    axes.set_xticks(range(len(physics)), physics, rotation=0 if alone else 55, ha="center" if alone else "right", fontsize=6)
    axes.set_yticks(range(len(rows)), [f"{row['name']}: {row['what']}" for row in study["rows"]], fontsize=6)
    bar = figure.colorbar(picture, fraction=0.06 if alone else 0.03, pad=0.03 if alone else 0.01, aspect=40)
    bar.set_label("evaluations, most in a step of eight nodes", fontsize=6)
    bar.ax.tick_params(labelsize=6)
    held = sum(cell["verdict"] == "held" for cell in cells.values())
    asked = sum(cell["verdict"] != "not asked" for cell in cells.values())
    told = "share of the heat a molten interface would take" + (", evaluations" if alone else "")
    title = f"Stability: {held} of {asked} held ({study['date']}). Numbers: {told}"
    if alone:
        title += "\n" + textwrap.fill(f"{study['scene']['physics']}; {study['scene']['host']}", 105)
    figure.suptitle(title, fontsize=7 if not alone else 6)
    figure.tight_layout()
    figure.savefig(out, dpi=110 if alone else 72)
    print(f"written: {out}")


if __name__ == "__main__":
    main()
