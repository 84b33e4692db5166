#!/usr/bin/python3
"""The envelope from stability.json: rows by physics. Colour: what the most laborious step of eight nodes asked for; number: share
of the heat a molten interface would take; a cross: broken; blank: not about it.   plot_stability.py stability.json [--out FILE.png]"""
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
from matplotlib.colors import LogNorm  # noqa: E402
from pictures import arguments  # noqa: E402


def effort(cell):
    return max(1, cell["layer_sums"] + cell["limit_values"] + cell["newton_steps"])


def main():
    study, out = arguments(__doc__)
    rows = [row["name"] for row in study["rows"]]
    physics = study["physics"]
    cells = {(cell["row"], cell["physics"]): cell for cell in study["cells"]}
    field = [[float("nan")] * len(physics) for _ in rows]
    figure, axes = plt.subplots(figsize=(0.42 * len(physics) + 3.4, 0.3 * len(rows) + 2.6))
    for r, row in enumerate(rows):
        for p, name in enumerate(physics):
            cell = cells[row, name]
            if cell["verdict"] == "not asked":
                continue
            field[r][p] = effort(cell)
            broken = cell["verdict"] == "broken"
            share = cell["bound_share"]
            axes.text(p, r, "x" if broken else f"{share:.2f}".lstrip("0") if share else "", ha="center", va="center",
                      fontsize=11 if broken else 5, color="red" if broken else "black")
    picture = axes.imshow(field, norm=LogNorm(1, 2e4), cmap="YlGnBu", aspect="auto", alpha=0.75)
    axes.set_xticks(range(len(physics)), physics, rotation=55, ha="right", fontsize=6)
    axes.set_yticks(range(len(rows)), [f"{row['name']}: {row['what']}" for row in study["rows"]], fontsize=6)
    bar = figure.colorbar(picture, fraction=0.03, pad=0.01)
    bar.set_label("evaluations, most in a step of eight nodes", fontsize=6)
    bar.ax.tick_params(labelsize=6)
    held = sum(cell["verdict"] == "held" for cell in cells.values())
    asked = sum(cell["verdict"] != "not asked" for cell in cells.values())
    axes.set_title(f"Stability: {held} of {asked} held ({study['date']}). Numbers: share of the heat a molten interface would take",
                   fontsize=7)
    figure.tight_layout()
    figure.savefig(out, dpi=72)
    print(f"written: {out}")


if __name__ == "__main__":
    main()
