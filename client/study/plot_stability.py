#!/usr/bin/python3
"""Draws the envelope from stability.json as a map, physics against rows of the campaign. The colour shows the largest
effort of a step of eight nodes, in evaluations; a cross marks a broken invariant, a ring a row that did not reach its
regime; blank cells do not apply. Prints the ten cells with the most effort. For a single scene: bars, with the share of
the heat that a molten interface would take. plot_stability.py stability.json [--out FILE.png]"""
import textwrap

import numpy as np
from matplotlib.colors import LogNorm
from pictures import arguments, save, style


def effort(cell):
    return max(1, cell["layer_sums"] + cell["limit_values"] + cell["wave_evaluations"])


def of_one_scene(study, cells):
    """Bars of one scene, one for each row that applies."""
    asked = [(row, cells[row["name"], study["physics"][0]]) for row in study["rows"]]
    asked = [(row, cell) for row, cell in asked if cell["verdict"] != "not asked"][::-1]
    figure, axes = style.figure(1, 1, (9, 0.3 * len(asked) + 1.6))
    colours = {"held": style.FAINT, "not met": style.GRID, "broken": style.SECOND}
    axes.barh(range(len(asked)), [effort(cell) for _, cell in asked], color=[colours[cell["verdict"]] for _, cell in asked])
    for i, (_, cell) in enumerate(asked):
        share = f"   {cell['bound_share']:.2f} of melting" if cell["bound_share"] else ""
        axes.text(effort(cell) * 1.1, i, f"{effort(cell)}{share}{'' if cell['verdict'] == 'held' else '   ' + cell['verdict']}", va="center", fontsize=9)
    axes.set_yticks(range(len(asked)), [f"{row['name']}: {row['what']}" for row, _ in asked])
    axes.set(xscale="log", xlim=(0.8, 40 * max(effort(cell) for _, cell in asked)), xlabel="evaluations, most in a step of eight nodes")
    axes.set_title(textwrap.fill(f"{study['scene']['physics']}; {study['scene']['host']}", 100), fontsize=8, loc="right")
    return figure


def of_all(study, cells):
    rows, physics = [row["name"] for row in study["rows"]], study["physics"]
    field = np.full((len(physics), len(rows)), np.nan)
    figure, axes = style.figure(1, 1, (10, 0.18 * len(physics) + 2.0))
    marks = {"broken": {"marker": "x", "color": style.SECOND, "s": 60, "lw": 2}, "not met": {"marker": "o", "facecolor": "none", "edgecolor": style.INK, "s": 30}}
    for (row, name), cell in cells.items():
        place = rows.index(row), physics.index(name)
        if cell["verdict"] != "not asked":
            field[place[::-1]] = effort(cell)
        if cell["verdict"] in marks:
            axes.scatter(*place, **marks[cell["verdict"]])
    picture = axes.imshow(field, norm=LogNorm(1, 2e5), cmap="YlGnBu", aspect="auto")
    axes.set_xticks(range(len(rows)), rows, rotation=90, fontsize=9)
    axes.set_yticks(range(len(physics)), physics, fontsize=8)
    axes.set_xticks(np.arange(-0.5, len(rows)), minor=True)
    axes.set_yticks(np.arange(-0.5, len(physics)), minor=True)
    axes.grid(which="minor", color="white", linewidth=1.2)
    axes.tick_params(which="both", length=0)
    figure.colorbar(picture, label="evaluations, most in a step of eight nodes", fraction=0.03, pad=0.01, extend="max")
    asked = [cell for cell in cells.values() if cell["verdict"] != "not asked"]
    held = sum(cell["verdict"] == "held" for cell in asked)
    axes.set_title(f"{held} of {len(asked)} combinations of input and physics keep every invariant")
    print("| row | physics | evaluations |\n|---|---|---|")
    for cell in sorted(asked, key=effort, reverse=True)[:10]:
        print(f"| {cell['row']} | {cell['physics']} | {effort(cell):,} |")
    return figure


def main():
    study, out = arguments(__doc__)
    cells = {(cell["row"], cell["physics"]): cell for cell in study["cells"]}
    save((of_all if study["scene"] is None else of_one_scene)(study, cells), out, study)


if __name__ == "__main__":
    main()
