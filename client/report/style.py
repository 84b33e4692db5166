"""One look for all pictures of shearbus: colours of the regimes and of the interface laws, units, sizes, and a footer
that says where the numbers come from. A picture is drawn with these names and saved by save()."""
import io
import pathlib
import re
import sys

import matplotlib
import output

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from matplotlib.colors import BoundaryNorm, ListedColormap  # noqa: E402
from matplotlib.patches import Patch  # noqa: E402
from matplotlib.ticker import FuncFormatter, LogLocator, NullLocator  # noqa: E402
from PIL import Image  # noqa: E402

DPI = 200
INK, SECOND, GRID, FAINT = "#1a1a1a", "#c8553d", "#d9d9d9", "#7d7d7d"
# The values of Regime (proto/shearbus/v1/downscale.proto) by name: label and colour. The smallest difference of two
# colours, over normal sight, deuteranopia and protanopia, is 29 (CIE 1976; open and Coulomb), and 41 without "open".
REGIMES = {
    "OPEN": ("open", "#d0d0d0"),  # not the white of zero in a signed map
    "STICK": ("stick", "#4477AA"),
    "COULOMB": ("Coulomb", "#009E73"),
    "TRESCA": ("Tresca", "#DDAA33"),
    "MELTING": ("Tresca, melting", "#4a0012"),
}
OPEN, MELTING = REGIMES["OPEN"][1], REGIMES["MELTING"][1]
MELTING_LABEL = "within 1 % of the melting temperature"
# Interface laws of shearbus-hydro by their name in a scene: label and colour of a line.
LAWS = {
    "subgrid": ("subgrid server", INK),
    "coulomb_tresca": ("Coulomb–Tresca (DLP 5)", SECOND),
    "free_slip": ("free slip", "#2a8fbd"),
    "stick": ("stick", "#8a7f2d"),
    "constant": ("constant friction", "#8a5ba6"),
}
# Quantities of a history: label with unit, factor from SI to it, kind of its colour scale.
QUANTITIES = {
    "shear_stress": ("shear stress (MPa)", 1e-6, "signed"),
    "sliding_velocity": ("sliding speed (m/s)", 1.0, "size"),
    "interface_temperature": ("interface temperature (K)", 1.0, "temperature"),
    "pressure": ("pressure (GPa)", 1e-9, "size"),
    "velocity_jump": ("velocity jump (m/s)", 1.0, "signed"),
    "slip_distance": ("slip distance (mm)", 1e3, "size"),
}
COLOUR_MAPS = {"signed": "RdBu_r", "size": "viridis", "temperature": "inferno"}

plt.rcParams.update({
    "font.size": 10, "axes.titlesize": 11, "axes.labelsize": 10, "figure.titlesize": 12, "legend.fontsize": 9, "xtick.labelsize": 9,
    "ytick.labelsize": 9, "axes.spines.top": False, "axes.spines.right": False, "axes.edgecolor": INK, "axes.labelcolor": INK,
    "text.color": INK, "xtick.color": INK, "ytick.color": INK, "grid.color": GRID, "grid.linewidth": 0.6, "axes.axisbelow": True,
    "axes.prop_cycle": matplotlib.cycler(color=[INK, SECOND, "#2a8fbd", "#8a7f2d", "#8a5ba6"]), "legend.frameon": False,
})


def folded(text, width):
    """Returns a text in lines of at most this width, broken behind blanks, dots and underscores."""
    lines = [""]
    for piece in re.findall(r"[^ ._]+[ ._]*", text):
        if lines[-1] and len(lines[-1] + piece.rstrip()) > width:
            lines.append("")
        lines[-1] += piece
    return "\n".join(line.rstrip() for line in lines)


def law_label(law):
    return LAWS[law][0] if law in LAWS else str(law)


def law_colour(law):
    return LAWS[law][1] if law in LAWS else FAINT


# Lines of runs that the law does not tell apart: far from each other, and from the paper, light or dark.
RUNS = (INK, SECOND, "#2a8fbd", "#8a5ba6", "#3f9b4f", "#b58900", "#d45fa0", "#8a7f2d")


def regime_colours():
    """Returns the colour map and the norm of an array of positions in REGIMES."""
    return {"cmap": ListedColormap([colour for _, colour in REGIMES.values()]), "norm": BoundaryNorm(np.arange(len(REGIMES) + 1) - 0.5, len(REGIMES))}


def regime_handles(seen):
    """Returns legend entries for the positions in REGIMES that a picture shows."""
    rows = list(REGIMES.values())
    return [Patch(facecolor=rows[i][1], edgecolor=FAINT, linewidth=0.5, label=rows[i][0]) for i in sorted(set(int(i) for i in seen))]


def space_time(axis, time, place, values, **colours):
    """Draws a map of masked values [time, place]; what is masked has the colour of an open contact, whose legend entry is
    regime_handles([0]). Returns what a colour bar needs."""
    axis.set_facecolor(OPEN)
    return axis.pcolormesh(time, place, values.T, shading="nearest", rasterized=True, **colours)


def round_ticks(axis):
    """Labels a logarithmic axis at 1, 2 and 5 of each decade."""
    axis.set_major_locator(LogLocator(subs=(1, 2, 5)))
    axis.set_minor_locator(NullLocator())
    axis.set_major_formatter(FuncFormatter(lambda value, _: f"{value:g}"))


def limits(kind, *arrays, percentile=99.5):
    """Returns vmin, vmax and the arrows ("extend") of a colour bar for the finite values of arrays: about zero where
    both signs occur, from zero for sizes, else from the data. Values beyond the percentile are shown by the arrow."""
    values = np.concatenate([np.ma.compressed(np.ma.masked_invalid(a)) for a in arrays])
    if values.size == 0:
        return {"vmin": 0.0, "vmax": 1.0}, "neither"
    low, high = np.percentile(values, [100 - percentile, percentile])
    if kind == "signed":
        high = max(abs(low), abs(high)) or 1.0
        low = -high
    elif kind == "size":
        low = 0.0
    high = high if high > low else low + 1.0
    ends = (values.min() < low, values.max() > high)
    return {"vmin": low, "vmax": high}, {(True, True): "both", (True, False): "min", (False, True): "max", (False, False): "neither"}[ends]


def provenance_text(*blocks):
    """Returns the footer for the provenance blocks of one or more runs, with every fact once."""
    parts = []
    for key in ("scene", "program", "version", "commit", "date", "machine"):
        words = dict.fromkeys(str(block[key])[: 10 if key == "date" else None] for block in blocks if block.get(key))
        if words and " / ".join(words) not in " ".join(parts):  # some programs name their version with their name
            parts.append(" / ".join(words))
    return " · ".join(parts)


def figure(rows, columns, size, legend=False, **options):
    """Returns a figure of a size in inches and its axes, with room for a footer, and above that for
    legend_below()."""
    made, axes = plt.subplots(rows, columns, figsize=size, layout="constrained", **options)
    strip = (0.55 if legend else 0.22) / size[1]
    made.get_layout_engine().set(rect=(0.006, strip, 0.988, 0.99 - strip), wspace=0.04)
    return made, axes


def legend_below(made, handles):
    """Puts one legend below all axes of a figure made with `legend`, in as many rows as its width needs."""
    for rows in range(1, len(handles) + 1):  # none alone in the last row
        legend = made.legend(handles=handles, loc="lower center", bbox_to_anchor=(0.5, 0.17 / made.get_figheight()), ncols=-(-len(handles) // rows), borderaxespad=0.0)
        if rows == len(handles) or legend.get_window_extent(made.canvas.get_renderer()).width < made.bbox.width:
            break
        legend.remove()
    strip = (0.55 + 0.22 * (rows - 1)) / made.get_figheight()
    made.get_layout_engine().set(rect=(0.006, strip, 0.988, 0.99 - strip))


def save(made, path, blocks, colours=None):
    """Writes a figure as PNG of 200 dots an inch, with a footer of provenance blocks, and closes it; path None: returns the
    bytes. colours: size of a palette, which makes a picture of lines and areas of few colours smaller. Ends the program if
    it cannot be written."""
    footer = provenance_text(*blocks)
    points = 7 * min(1.0, 19 * made.get_figwidth() / max(1, len(footer)))  # 19 characters of size 7 fit into an inch
    made.text(0.995, 0.006, footer, ha="right", va="bottom", fontsize=points, color=FAINT)
    raw, out = io.BytesIO(), io.BytesIO()
    made.savefig(raw, dpi=DPI, format="rgba")
    size = tuple(int(inches * DPI) for inches in made.get_size_inches())
    plt.close(made)
    image = Image.frombytes("RGBA", size, raw.getvalue()).convert("RGB")
    (image.quantize(colours, dither=Image.Dither.NONE) if colours else image).save(out, format="png", optimize=bool(colours))
    if path is None:
        return out.getvalue()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        output.write(path, output.PICTURE, out.getvalue())
    except OSError as fault:
        sys.exit(f"{pathlib.Path(sys.argv[0]).name}: {fault}")
    return None


def label_ends(axis, ends, size=9):
    """Writes labels at the right end of lines, one below the other where they would overlap. ends: (x, y, label,
    colour) in data units, after the limits of the axis are final."""
    low, high = axis.get_ylim()
    gap = 1.35 * size / 72 / (axis.figure.get_figheight() * axis.get_position().height) * (high - low)
    ends = sorted(ends, key=lambda end: end[1])
    heights = [min(max(y, low), high) for _, y, _, _ in ends]
    for i in range(1, len(heights)):
        heights[i] = max(heights[i], heights[i - 1] + gap)
    excess = max(0.0, heights[-1] - high) if heights else 0.0
    for i in reversed(range(len(heights))):
        heights[i] = heights[i] - excess if i == len(heights) - 1 else min(heights[i], heights[i + 1] - gap)
    for (x, y, label, colour), height in zip(ends, heights):
        # The leader ends before the text, and crosses no other one: those lie in the same order at both ends.
        axis.annotate(label, (x, y), xytext=(axis.get_xlim()[1] + 0.05 * np.diff(axis.get_xlim())[0], height), color=colour, fontsize=size, va="center",
                      annotation_clip=False, arrowprops={"arrowstyle": "-", "color": colour, "lw": 0.6, "relpos": (0.0, 0.5), "shrinkA": 2, "shrinkB": 0})
