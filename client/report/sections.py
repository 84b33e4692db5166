"""The parts of a report: numbers, texts and pictures of runs, as plain values for the template report.html."""
import base64
import html
import io
import os
import re
import subprocess
import urllib.parse

import matplotlib.colors
import matplotlib.pyplot as plt
import numpy as np
import plot_cone
import plot_histories
import style
from PIL import Image
from findings import ROUNDING, five_numbers, hottest, number, verdict, verdicts
from runs import Fault, read
from terminal import read_json

THEMED = {style.INK: "currentColor", style.GRID: "var(--grid)", style.FAINT: "var(--faint)", style.OPEN: "var(--open)", plot_histories.BAND: "var(--band)"}
SHARES = ("#2a8fbd", "#a8a29a", "#8a5ba6")  # parts of a bar, with style.SECOND
BODIES = ("#2a8fbd55", "#8a8a8a55", "#8a5ba655", "#c8553d55")
SMALL = (3.5, 2.25)  # inches of a small picture
MAP = (4.2, 3.1)  # inches of a map: as wide as a telephone, so that its texts stay readable there
# What the outcome flags mean for a reader who does not know the solvers, by their words in the legend of /outcome.
FLAGS = {"substepped": "solved in shorter substeps", "multiple roots": "more than one stress balances the step",
         "outside domain": "the slip differs from the jump by more than a tenth, as in a layer that is still elastic",
         "sudden": "stress or slip changed so much that shorter steps may give another jump", "asleep": "at rest, not solved"}
MAP_DPI = 200  # pixels an inch of the coloured areas
LARGEST_PICTURE = 1500  # pixels across of a picture that is given


def svg(figure, name, title):
    """Returns a figure as inline SVG whose ink and paper follow the theme of the page; all its ids begin with `name`."""
    out = io.StringIO()
    for axis in figure.axes:
        if axis.get_facecolor() == (1.0, 1.0, 1.0, 1.0):
            axis.set_facecolor("none")
    with plt.rc_context({"svg.fonttype": "none", "svg.hashsalt": name}):
        figure.savefig(out, format="svg", facecolor="none", dpi=MAP_DPI, metadata={key: None for key in ("Date", "Creator", "Format", "Type")})
    plt.close(figure)
    text = out.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.S)
    text = re.sub(r"(data:image/png;base64,)([^\"]+)", lambda found: found[1] + few_colours(found[2]), text)
    text = re.sub(r'\b(id="|url\(#|xlink:href="#)', rf"\g<1>{name}-", text)
    text = text.replace("xlink:href", "href").replace(' xmlns:xlink="http://www.w3.org/1999/xlink"', "").replace(' xmlns="http://www.w3.org/2000/svg"', "")
    text = re.sub(r'<svg([^>]*?) width="[^"]*"', rf'<svg\1 role="img" aria-label="{html.escape(title, quote=True)}"', text, count=1)
    text = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text, count=1)
    for colour, themed in THEMED.items():
        text = text.replace(colour, themed)
    return text


def lines(runs):
    """Returns the label of each run and the colour of its lines in the theme of the page."""
    return [(run.label, THEMED.get(run.colour, run.colour)) for run in runs]


def few_colours(encoded):
    """Returns a picture with transparent places in 256 colours, which makes it smaller. encoded: PNG in base64."""
    out = io.BytesIO()
    image = Image.open(io.BytesIO(base64.b64decode(encoded))).convert("RGBA")
    image.quantize(256, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(out, format="png", optimize=True)
    return base64.b64encode(out.getvalue()).decode()


def panel(size=MAP):
    """Returns a figure of one panel and its axis, without the room that pictures keep for a footer."""
    figure, axis = style.figure(1, 1, size)
    figure.get_layout_engine().set(rect=(0, 0, 1, 1))
    return figure, axis


def colour_bar(figure, axis, image, label, extend, contours=None, shrink=1.0):
    bar = figure.colorbar(image, ax=axis, label=label, extend=extend, pad=0.02, shrink=shrink)
    bar.solids.set_rasterized(True)
    if contours is not None:
        bar.add_lines(contours, erase=False)


# -- the case --


def outline_figure(run):
    figure, axis = style.figure(1, 1, (4.6, 3.6))
    for body, loop in plot_cone.outlines(run, run.frame(-1.0)).items():
        edge = np.vstack([loop, loop[:1]])
        if run.axisymmetric:  # the axis is no edge of a body
            on_axis = np.flatnonzero((np.abs(edge[:-1, 0]) < 1e-6) & (np.abs(edge[1:, 0]) < 1e-6)) + 1
            edge = np.insert(edge, on_axis, np.nan, axis=0)
        for side in (-1, 1) if run.axisymmetric else (1,):
            axis.add_patch(plt.Polygon(loop * (side, 1), facecolor=BODIES[body % len(BODIES)], edgecolor="none"))
            axis.plot(*(edge * (side, 1)).T, color=style.INK, lw=0.7)
        middle = (0.0 if run.axisymmetric and loop[:, 0].min() < 1e-6 else loop[:, 0].mean(), 0.5 * (loop[:, 1].min() + loop[:, 1].max()))
        axis.annotate(body_name(run, body), middle, ha="center", va="center", fontsize=9)
    axis.autoscale_view()
    axis.xaxis.set_major_formatter(lambda x, _: f"{abs(x):g}")
    axis.set_aspect("equal")
    axis.set(xlabel="r (mm)" if run.axisymmetric else "x (mm)", ylabel="z (mm)" if run.axisymmetric else "y (mm)")
    return figure


def body_name(run, body):
    if "cone_target" in run.scene.get("hydro", {}):
        return ("cone", "confinement", "flyer")[body] if body < 3 else f"body {body + 1}"
    return f"body {body + 1}"


def span(values, factor=1.0, unit=""):
    """Returns the text of the values' range: "100 m/s", "1 to 30 m/s"."""
    low, high = np.nanmin(values) * factor, np.nanmax(values) * factor
    return f"{number(low)} {unit}" if low == high or number(low) == number(high) else f"{number(low)} to {number(high)} {unit}"


def speeds(run):
    """Returns the text of the velocity jumps of a run: those at the start, or all where they are inputs that vary."""
    if "velocity_jump" not in run:
        return "sliding up to " + span(plot_histories.jump(run), 1.0, "m/s")
    jumps, given = np.abs(run["velocity_jump"]), run.scene.get("strategy") == "velocity_driven"
    return span(jumps if given else jumps[0], 1.0, "m/s")


def columns_figure(run):
    """Two bodies above each other, the upper one sliding."""
    figure, axis = style.figure(1, 1, (5.6, 2.6))
    soft, hard = (run.scene.get(key, {}).get("material", key) for key in ("soft", "hard"))
    axis.add_patch(plt.Rectangle((0, 0), 10, 1, facecolor=BODIES[0], edgecolor=style.INK, lw=0.8))
    axis.add_patch(plt.Rectangle((0, -1), 10, 1, facecolor=BODIES[1], edgecolor=style.INK, lw=0.8))
    axis.annotate("", (8.8, 0.5), (6.6, 0.5), arrowprops={"arrowstyle": "-|>", "color": style.INK})
    axis.text(0.3, 0.5, f"soft: {soft}", va="center")
    axis.text(0.3, -0.5, f"hard: {hard}", va="center")
    axis.text(7.7, 0.66, speeds(run), ha="center", va="bottom", fontsize=9)
    layer = run.scene.get("layer", {}).get("thickness_m")
    axis.text(5.0, 0.06, f"layer: {layer * 1e6:g} µm" if layer else "", ha="center", va="bottom", fontsize=8)
    axis.set(xlim=(-0.2, 10.2), ylim=(-1.1, 1.1))
    axis.axis("off")
    return figure


MATERIAL_ROWS = (("density_kg_per_m3", "density", "kg/m³", 1), ("shear_modulus_pa", "shear modulus", "GPa", 1e-9),
                 ("yield_strength_pa", "yield strength", "MPa", 1e-6), ("yield_strength_max_pa", "highest yield strength", "MPa", 1e-6),
                 ("melting_temperature_k", "melting temperature at rest", "K", 1), ("thermal_conductivity_w_per_m_k", "conductivity", "W/(m K)", 1),
                 ("specific_heat_j_per_kg_k", "specific heat", "J/(kg K)", 1))


def material_sources(control):
    """Returns {material: its sources}, as shearbus-ctl prints them; empty where the program is missing."""
    if not control.is_file():
        return {}
    printed = subprocess.run([control, "materials"], capture_output=True, text=True, timeout=20).stdout
    return {name: " ".join(text.split()) for name, text in re.findall(r"^(\S+)\n((?:  .*\n?)+)", printed, re.M)}


def the_case(run, sources):
    soft, hard = run.scene.get("soft", {}), run.scene.get("hard", {})
    rows = [(label, unit, *(number(body[key] * factor) if key in body else "–" for body in (soft, hard))) for key, label, unit, factor in MATERIAL_ROWS
            if key in soft or key in hard]
    sketch = outline_figure(run) if run.two_dimensions else columns_figure(run)
    cone, pressure = run.scene.get("hydro", {}).get("cone_target", {}), span(run["pressure"], 1e-9, "GPa") if "pressure" in run else ""
    soft_name, hard_name = (body.get("material", "") for body in (soft, hard))
    facts = [("flyer", f"{number(cone['flyer_speed_m_per_s'])} m/s, {hard_name}" if "flyer_speed_m_per_s" in cone else ""), ("cone", soft_name if cone else ""), ("confinement", hard_name if cone else ""),
             ("velocity jump", "" if cone or not run.table else speeds(run)), ("pressure", pressure), ("strategy", run.scene.get("strategy", "")), ("friction coefficient", run.scene.get("interface", {}).get("friction_coefficient", "")),
             ("melting curve", soft.get("melting_curve", "")), ("heat", run.scene.get("layer", {}).get("heat", "")), ("time integrator", run.scene.get("layer", {}).get("time_integrator", "")),
             ("tolerance", run.scene.get("layer", {}).get("tolerance", ""))]
    if "pairs" in run:
        pairs = [f"{count} of [pair.{name}]" if name else f"{count} of these" for name, count in sorted(run["pairs"].items())]
        facts += [("tables of the nodes", ", ".join(pairs)), *((f"{key} of the nodes", span(values)) for key, values in run["parameters"].items())]
    return {"sketch": svg(sketch, "case", "the bodies at the start"), "sketch_title": "the bodies at the start" if run.two_dimensions else "each column: two bodies, one jump",
            "materials": rows, "names": [body.get("material", "own constants") for body in (soft, hard)], "source": run.source,
            "sources": [(body["material"], sources[body["material"]]) for body in (soft, hard) if body.get("material") in sources],
            "facts": [(name, value) for name, value in facts if value != ""]}


# -- fields and maps --


def map_group(runs, name):
    """Returns the panels of one quantity along the interface: one for each run, and the difference of two."""
    label, span, extend = plot_cone.map_scale(runs, name)
    panels = []

    def finish(figure, axis, title, key):
        axis.set(xlim=(0.0, plot_cone.last_time(runs)), xlabel="time (µs)", ylabel=plot_cone.NODES.format(runs[0].place_name).replace(": ", ":\n"), title=title)
        panels.append(svg(figure, f"map-{name}-{key}", f"{label} {title}".strip()))

    for i, run in enumerate(runs):
        figure, axis = panel()
        image, contours, _ = plot_cone.draw_map(axis, run, name, span)
        if name != "regime":
            colour_bar(figure, axis, image, label, extend, contours)
        finish(figure, axis, run.label if len(runs) > 1 else "", i)
    if plot_cone.have_difference(runs, name):
        figure, axis = panel()
        image, extend = plot_cone.draw_difference(axis, runs, name)
        colour_bar(figure, axis, image, f"difference of {label}", extend)
        finish(figure, axis, plot_cone.difference_title(runs), "difference")
    return panels


def film(runs):
    """Returns pictures of the zones at three times until the contact opens, on one scale."""
    times, panels = [share * max(run.last_contact for run in runs) for share in (0.5, 0.75, 1.0)], []
    span = style.limits("temperature", *(run.frame(time)["temperature"] for run in runs for time in times), percentile=99.7)
    for i, time in enumerate(times):
        figure, axis = panel((4.6, 3.4))
        drawn, extend, at, highest = plot_cone.mirrored(axis, runs, time, limits=span)
        colour_bar(figure, axis, drawn, f"temperature at {at:.3g} µs (K)\nup to {highest:.0f}", extend, shrink=0.75)
        panels.append(svg(figure, f"film-{i}", f"temperature of the zones at {at:.3g} µs"))
    return panels


def cone_fields(runs):
    """Returns the groups of pictures of runs in two dimensions: {"title", "text", "panels": [SVG]}."""
    interfaces = plot_cone.main_runs([run for run in runs if run.table and run.place is not None])
    found, shown = [], interfaces[:2] or runs[:1]
    figure, axis = panel((4.6, 3.6))
    drawn, extend, time, highest = plot_cone.mirrored(axis, shown)
    colour_bar(figure, axis, drawn, f"temperature of the zones at {time:.3g} µs (K)\nup to {highest:.0f}", extend)
    panels = [svg(figure, "final", "temperature of the zones at the end")]
    if interfaces:
        figure, axis = panel((4.6, 3.6))
        plot_cone.draw_flank(axis, shown)
        panels.append(svg(figure, "flank", "temperature along the interface, highest and at the end"))
    hidden = f" The zones hide the layer: the second picture shows the temperature of the interface itself, highest and (dashed) at {time:.3g} µs." if interfaces else ""
    if "cone_target" in shown[0].scene.get("hydro", {}):
        hidden += " Hot zones on the axis, and at the edge of the face that the flyer has hit, are heated by the waves that meet there: with free slip, without any friction, they are as hot."
    if interfaces:
        found.append({"title": "while the bodies touch", "text": f"Temperature of the zones, {' and '.join(run.label for run in shown)}.", "panels": film(shown)})
    found.append({"title": "last state written" if any(run.incomplete for run in shown) else "final state", "text": f"{' and '.join(run.label for run in shown)}.{hidden}", "panels": panels})
    for name in plot_cone.MAPS if interfaces else ():
        shares = [f"{run.label}: {100 * run.summary['slip_share_coulomb']:.0f} % of the slip is Coulomb" for run in interfaces if "slip_share_coulomb" in run.summary]
        unit = style.QUANTITIES[name][0].split("(")[1].rstrip(")") if name != "regime" else ""
        largest = lambda run: hottest(run) if name == "interface_temperature" else float(np.nanmax(np.abs(run.drawn(name))))
        highest = ", ".join(f"{run.label} {number(largest(run), 4)} {unit}" for run in interfaces) if name != "regime" else ""
        levels = plot_cone.isolines(*(plot_cone.shown(run, name) for run in interfaces)) if name == "interface_temperature" else []
        thin = f". Thin lines: {', '.join(map(str, levels))} K" if levels else ""
        text = {"regime": ". ".join(shares), "interface_temperature": f"Highest: {highest}{thin}",
                "sliding_velocity": f"Highest: {highest}. Grey: the contact is open, nothing slides",
                "shear_stress": f"Largest: {highest}. Its sign is that of the slip",
                "pressure": f"Highest: {highest}. It limits Coulomb friction, and raises the melting temperature"}.get(name, "")
        title = {"regime": "friction regime"}.get(name, name.replace("_", " "))
        found.append({"title": title, "text": text + "." if text else "", "panels": map_group(interfaces, name)})
    moving, begin = plot_cone.surfaces(runs)
    if moving:
        panels = []
        for i, where in enumerate(plot_cone.SURFACE):
            figure, axis = panel((4.2, 2.6))
            plot_cone.draw_surface(axis, moving, begin, where)
            axis.set_ylabel(plot_cone.SURFACE_LABEL.replace("cone's ", "cone's\n"))
            panels.append(svg(figure, f"surface-{i}", f"{plot_cone.SURFACE_LABEL} {plot_cone.SURFACE[where]}"))
        found.append({"title": "free surface", "text": "What a velocimeter behind the cone would see.", "panels": panels,
                      "lines": lines(moving)})
    return found


def history_fields(runs):
    """Returns the groups of pictures of runs in one dimension and results, one group for each quantity."""
    panels, left_out = plot_histories.panels_of(runs)
    panels.sort(key=lambda entry: runs.index(entry[0]))  # equal pressures stand below each other
    columns = max(sum(entry[0] is run for entry in panels) for run in runs)
    columns = columns if columns > 1 else len(panels)
    scale, label, found = plot_histories.colours(runs), plot_histories.jump_label(runs), []
    for name in plot_histories.quantities(runs):
        figures, notes = [], [f"{left_out} groups of columns are left out."] * bool(left_out)
        for run, title, nodes_of_panel in panels:
            figure, axis = panel((4.2, 2.6))
            banded, melts = plot_histories.draw_history(axis, run, nodes_of_panel, name, scale)
            axis.set(xlabel="time (µs)", title=title if len(panels) > 1 else "")
            figures.append((figure, axis))
            notes += ["The band has all columns."] * banded + [f"Dashed: {style.MELTING_LABEL}."] * melts
        low, high = min(axis.get_ylim()[0] for _, axis in figures), max(axis.get_ylim()[1] for _, axis in figures)
        for _, axis in figures:
            axis.set_ylim(low, high)
        found.append({"title": style.QUANTITIES[name][0].split(" (")[0], "text": " ".join(dict.fromkeys(notes)), "columns": columns,
                      "panels": [svg(figure, f"history-{name}-{i}", f"{name.replace('_', ' ')} against time") for i, (figure, _) in enumerate(figures)]})
    low, high = scale.get_clim()
    if scale.by_jump:
        stops = ", ".join(matplotlib.colors.to_hex(plot_histories.LINES(x)) for x in np.linspace(0, 1, 6))
        found[0]["scale"] = {"stops": stops, "low": number(low), "high": number(high), "label": label}
    if plot_histories.has_many(runs):
        figures = []
        for i, (run, title, nodes_of_panel) in enumerate(panels):
            figure, axis = panel()
            plot_histories.draw_regimes(axis, run, nodes_of_panel, label)
            axis.set_title(title if len(panels) > 1 else "")
            figures.append(svg(figure, f"regimes-{i}", "friction regime of the columns against time"))
        found.append({"title": "friction regime", "text": "", "columns": columns, "has_regimes": True, "panels": figures})
    return found


def fields(runs):
    """Returns the groups of pictures of the final state, of the maps, of the histories and of the free surface."""
    flat, round_ = [run for run in runs if run.table and not run.two_dimensions], [run for run in runs if run.two_dimensions]
    several = any(run.nodes.size > 1 for run in flat)  # the only node of a run is drawn as a selected node
    return (cone_fields(round_) if round_ else []) + (history_fields(flat) if several else [])


# -- selected nodes --


def history_panel(runs, index, node, quantity):
    label = style.QUANTITIES[quantity][0]
    figure, axis = panel(SMALL)
    regimes = runs[0]["regime"][:, node] if "regime" in runs[0] else None
    changes = np.flatnonzero(np.diff(regimes.astype(int), prepend=-1)) if regimes is not None else []
    edges = np.concatenate(([runs[0].time[0]], runs[0].time))
    colours = [colour for _, colour in style.REGIMES.values()]
    for begin, end in zip(changes, [*changes[1:], len(runs[0].time)]):
        axis.axvspan(edges[begin], edges[end], ymax=0.045, color=colours[regimes[begin]], lw=0)
    for run in runs:
        same = np.flatnonzero(run.nodes == runs[0].nodes[node])
        if same.size and quantity in run:
            values = run.drawn(quantity)[:, same[0]]
            rows = np.unique(np.linspace(0, len(values) - 1, 400).round().astype(int))
            axis.plot(run.time[rows], values[rows], color=run.colour, lw=1.5)
    low, high = axis.get_ylim()
    axis.set_ylim(low - 0.06 * (high - low), high)
    axis.set(xlabel="time (µs)", ylabel=label, xlim=(0, min(1.1 * max(run.last_contact for run in runs), runs[0].time[-1])))
    axis.grid()
    return svg(figure, f"node{index}-{quantity[:5]}", f"{label} of the node against time")


def profile_panel(run, node, index):
    """Returns the temperature across the layer of a node at up to three times, where the run kept it; else None."""
    kept = run["profiles"] if run.table and "profiles" in run.table else None
    if kept is None or run.nodes[node] not in kept["node_id"]:
        return None
    column = int(np.flatnonzero(kept["node_id"] == run.nodes[node])[0])
    entries = np.unique(np.linspace(0, len(kept["time"]) - 1, min(3, len(kept["time"]))).round().astype(int))
    figure, axis = panel(SMALL)
    for entry, shade in zip(entries, np.linspace(0.3, 0.8, len(entries))):
        axis.plot(kept["position"] * 1e6, kept["layer_temperature"][entry][column], color=plt.cm.plasma(shade), lw=1.5, label=f"{kept['time'][entry] * 1e6:.2f} µs")
    axis.set(xlabel="z across the interface (µm)", ylabel="temperature (K)")
    axis.legend(fontsize=8)
    axis.grid()
    return svg(figure, f"node{index}-profile", "temperature across the layer of the node")


def nodes(runs):
    """Returns the selected nodes of the first run: title and small pictures, with the pressure where it varies."""
    first, found = runs[0], []
    for index, (node, reasons) in enumerate(first.selected().items()):
        where = f", at {first.place_name} = {first.place[node] * 1e3:.1f} mm" if first.place is not None else ""
        names = ["shear_stress", "interface_temperature", "sliding_velocity"] + ["pressure"] * bool("pressure" in first and np.ptp(first["pressure"][:, node]) > 0)
        panels = [history_panel(runs, index, node, name) for name in names]
        profile = profile_panel(first, node, index)
        found.append({"title": f"node {first.nodes[node]}{where}{': ' + ', '.join(reasons) if len(first.nodes) > 1 else ''}", "panels": panels + ([profile] if profile else [])})
    return found


# -- ledger and cost --


def bars(parts, name, unit):
    """Returns a stacked bar as HTML values: [(label, text, share in percent, colour)]. parts: [(label, value,
    colour)]."""
    whole = sum(max(value, 0.0) for _, value, _ in parts) or 1.0
    return {"title": name, "parts": [(label, f"{number(value)} {unit}", 100 * max(value, 0.0) / whole, colour) for label, value, colour in parts]}


def share(residual):
    """Returns the text of a residual relative to what is balanced."""
    return f"{residual:.0e} (rounding)" if abs(residual) < ROUNDING else f"{residual:.1e}"


def ledger(run):
    """Returns the bars of the energy and the residuals of a run."""
    found, summary = [], run.summary
    if run.two_dimensions and len(run.frames) > 1:
        begin, end = (run.kinetic_energy(run.frame(time)) for time in (-1.0, None))
        unit = "J" if run.axisymmetric else "J/m"
        heat = summary.get("friction_heat_j", summary.get("friction_heat_j_per_m", 0.0))
        if begin.sum() > 0 and end.sum() <= begin.sum():
            colours = ("#2a8fbd", "#7fbbd8", "#bcdcec")
            parts = [(f"kinetic energy of the {body_name(run, i)}", value, colours[i % 3]) for i, value in enumerate(end)]
            parts += [("heat of friction", heat, style.SECOND), ("deformation and compression", begin.sum() - end.sum() - heat, SHARES[1])]
            found.append(bars(parts, f"kinetic energy of the start, {number(begin.sum())} {unit}, at {run.frame()['time']:.3g} µs", unit))
    layer = summary.get("layer_energy", {})
    if layer.get("interface_work_j_per_m2"):
        left = layer["interface_work_j_per_m2"] - layer["energy_residual_j_per_m2"] - sum(layer[f"{term}_j_per_m2"] for term in ("heat_to_soft", "heat_to_hard", "elastic_energy"))
        cold = left if left > 1e-9 * layer["interface_work_j_per_m2"] else 0.0
        parts = [("heat to the soft body", layer["heat_to_soft_j_per_m2"], style.SECOND), ("heat to the hard body", layer["heat_to_hard_j_per_m2"], SHARES[1]),
                 ("plastic work that stays cold", cold, SHARES[2]), ("elastic energy", layer["elastic_energy_j_per_m2"], SHARES[0])]
        found.append(bars([part for part in parts if part[1]], f"work of the interface stress, {number(layer['interface_work_j_per_m2'])} J/m², mean of the nodes", "J/m²"))
    keys = (("energy_residual", "energy of the hydrocode"), ("momentum_residual", "momentum of the hydrocode"))
    rows = [(what, share(summary[key])) for key, what in keys if key in summary]
    note = ""
    if layer.get("interface_work_j_per_m2"):
        missing = layer["energy_residual_j_per_m2"] / layer["interface_work_j_per_m2"]
        rows += [("heat in the layers", share(layer["heat_residual_j_per_m2"] / (layer["heat_to_soft_j_per_m2"] + layer["heat_to_hard_j_per_m2"] or 1.0))),
                 ("work of the interface stress", share(missing))]
        if abs(missing) > ROUNDING:
            note = ("The last is more than rounding: in a step that stops or turns the slip, the work is that of the mean jump and the heat that of the slip. "
                    "It is of first order in the length of the step.")
    return {"label": run.label, "bars": found, "rows": rows, "note": note, "comparisons": summary.get("comparisons", [])}


def cost(run):
    summary, parts, total = run.summary, [], run.summary.get("run_time_s")
    if total and "solver_time_s" in summary:
        parts = [("hydrocode", summary["hydro_time_s"], SHARES[0]), ("solver of the layers", summary["solver_time_s"], style.SECOND),
                 ("bus", summary["bus_time_s"], SHARES[1]), ("output", summary["output_time_s"], style.FAINT)]
    elif total and "waiting_share" in summary:
        waited = summary["waiting_share"] * total
        parts = [("waiting for answers" if run.law == "subgrid" else "interface law", waited, style.SECOND), ("hydrocode and output", total - waited, SHARES[0])]
    rows = [(name, f"{summary[key]:,}") for key, name in (("zones", "zones"), ("columns", "columns"), ("steps", "steps"), ("steps_taken_back", "steps taken back")) if key in summary]
    rows += [("run time", f"{number(total)} s")] if total else []
    if total and run.law == "subgrid" and "waiting_share" in summary and summary.get("service_share"):
        rows.append(("work of the subgrid server", f"{number(100 * summary['service_share'])} % of the run time; while it is under way the hydrocode goes on, and then waits"))
    omitted = summary.get("omitted", {})
    if omitted.get("parts"):
        rows.append(("left out", ", ".join(str(part) for part in omitted["parts"])))
        rows.append(("bytes of state per node", f"{omitted['bytes_per_node']} ({omitted['bytes_per_node_with_everything']} with everything)"))
    flags = [(word, FLAGS.get(word, ""), count) for word, count in run["outcomes"].items()] if run.table else []
    return {"label": run.label, "bars": [bars(parts, f"run time, {number(total)} s", "s")] if parts else [], "rows": rows, "flags": flags}


# -- the paper --


def paper(directory):
    """Returns the figures of figures.json in a directory: [{"figure", "title", "src", "agrees": [...], "differs":
    [...], "note"}]."""
    if directory is None:
        return []
    try:
        listed = read_json(directory / "figures.json")
        found = []
        for entry in listed:
            picture = directory / entry["file"]
            if picture.parent != directory or not picture.is_file():
                raise ValueError(f"{entry['file']}: expected the name of a picture in the same directory")
            image = Image.open(picture).convert("RGB")
            image.thumbnail((LARGEST_PICTURE, 3 * LARGEST_PICTURE))
            out = io.BytesIO()
            image.quantize(256, dither=Image.Dither.NONE).save(out, format="png", optimize=True)
            several = lambda value: [value] if isinstance(value, str) else list(value)
            found.append({"figure": entry["figure"], "title": entry["title"], "width": image.width * 5 // 8, "src": "data:image/png;base64," + base64.b64encode(out.getvalue()).decode(),
                          "agrees": several(entry.get("agrees", [])), "differs": several(entry.get("differs", [])), "note": entry.get("note", "")})
        return found
    except (OSError, ValueError, KeyError, TypeError) as fault:
        raise Fault(f"{directory}: expected figures.json, a list of figures with figure, title and file, and their pictures: {fault}") from fault


def link(file, page):
    """Returns the link to a file from a page, as long as both stay where they are."""
    return urllib.parse.quote(os.path.relpath(file.resolve(), page.resolve().parent))


def report(paths, figures, control, command, page):
    """Returns the values of the template for these runs. figures: directory of the paper's figures, or None; control:
    path of shearbus-ctl; page: where the report will be. Raises Fault."""
    runs, of_the_paper = read(paths), paper(figures)
    compared = [run for run in runs if run.table]
    main = plot_cone.main_runs(compared)
    footer = style.provenance_text(*(run.provenance for run in runs))
    first = main[0] if main else runs[0]
    return {
        "names": list(dict.fromkeys(run.title for run in runs)),
        "runs": [{"label": run.label, "colour": THEMED.get(run.colour, run.colour), "path": str(run.path), "verdicts": verdicts(run), "provenance": run.provenance,
                  "time": run.summary.get("run_time_s")} for run in runs],
        "verdict": verdict(main), "numbers": five_numbers(main) if main else [], "number_runs": lines(main),
        "fields_title": "Fields and maps" if any(run.two_dimensions for run in runs) else "Histories", "along_interface": main and main[0].two_dimensions and any("pressure" in run for run in main),
        "case": the_case(first, material_sources(control)), "fields": fields(runs), "nodes": nodes(main) if main else [],
        "has_profiles": any("profiles" in run.table for run in main), "ledgers": [found for found in map(ledger, runs) if found["bars"] or found["rows"] or found["comparisons"]],
        "costs": [found for found in map(cost, runs) if found["bars"] or found["rows"] or found["flags"]],
        "paper": of_the_paper, "scene_text": first.scene_text, "regimes": list(style.REGIMES.values()),
        "files": [(run.label, str(run.path), sorted((p.name, link(p, page), p.stat().st_size) for p in (run.path.iterdir() if run.path.is_dir() else [run.path]) if p.is_file()))
                  for run in runs],
        "provenance": footer, "command": command, "number": number, "replayed": not first.path.is_dir(),
    }
