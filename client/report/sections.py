"""The parts of a report: numbers, texts and pictures of runs, as plain values for the template report.html."""
import base64
import html
import io
import json
import re
import subprocess

import matplotlib.pyplot as plt
import numpy as np
import plot_cone
import plot_histories
import style
from PIL import Image
from runs import Fault, Run
from style import law_colour

THEMED = {style.INK: "currentColor", style.GRID: "var(--grid)", style.FAINT: "var(--faint)", style.OPEN: "var(--open)"}
SHARES = ("#2a8fbd", "#a8a29a", "#8a5ba6")  # parts of a bar, with style.SECOND
BODIES = ("#2a8fbd55", "#8a8a8a55", "#8a5ba655", "#c8553d55")
SMALL = (3.5, 2.25)  # inches of a small picture
LARGEST_PICTURE = 1500  # pixels across of a picture that is given


def number(value, digits=3):
    """Returns a number with so many significant digits, without an exponent where that is short."""
    if value is None or not np.isfinite(value):
        return "–"
    if value == 0 or 1e-3 <= abs(value) < 1e6:
        decimals = max(0, digits - 1 - int(np.floor(np.log10(abs(value))))) if value else 0
        return f"{value:,.{decimals}f}"
    return f"{value:.{digits - 1}e}"


def svg(figure, name, title):
    """Returns a figure as inline SVG whose ink follows the theme of the page; all its ids begin with `name`."""
    out = io.StringIO()
    with plt.rc_context({"svg.fonttype": "none", "svg.hashsalt": name}):
        figure.savefig(out, format="svg", transparent=True, metadata={key: None for key in ("Date", "Creator", "Format", "Type")})
    plt.close(figure)
    text = out.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.S)
    text = re.sub(r'\b(id="|url\(#|xlink:href="#)', rf"\g<1>{name}-", text)
    text = text.replace("xlink:href", "href").replace(' xmlns:xlink="http://www.w3.org/1999/xlink"', "").replace(' xmlns="http://www.w3.org/2000/svg"', "")
    text = re.sub(r'<svg([^>]*?) width="[^"]*"', rf'<svg\1 role="img" aria-label="{html.escape(title, quote=True)}"', text, count=1)
    text = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", text, count=1)
    for colour, themed in THEMED.items():
        text = text.replace(colour, themed)
    return text


def png(figure, footer=""):
    """Returns a figure as data URL, and the largest width that a page shows it at, in pixels of the page."""
    width = int(120 * figure.get_figwidth())
    return "data:image/png;base64," + base64.b64encode(style.save(figure, None, footer, colours=256)).decode(), width


def picture(src, title, text="", wide=False):
    """src: SVG, or what png() returns. A wide picture is scrolled on a narrow screen."""
    src, width = (src, None) if isinstance(src, str) else src
    return {"src": src, "width": width, "title": title, "text": text, "wide": wide}


# -- head and numbers --


def verdicts(run):
    """Returns (text, "good" or "look") of what a reader wants to know first."""
    found = []
    for key, what in (("energy_residual", "energy"), ("momentum_residual", "momentum")):
        if key in run.summary:
            residual = abs(run.summary[key])
            found.append((f"{what} closed to {'rounding' if residual < 1e-14 else f'{residual:.0e}'}", "good" if residual < 1e-9 else "look"))
    flags = run["outcomes"] if run.table else {}
    if flags:
        found.append((f"{sum(flags.values()):,} flagged node-steps", "look"))
    elif "flagged_node_steps" in run.summary:
        count = run.summary["flagged_node_steps"]
        found.append((f"{count:,} node-steps flagged" if count else "no flagged step", "look" if count else "good"))
    elif run.table and "outcome" in run.table:
        found.append(("no flagged step", "good"))
    if "bound_used_most" in run.summary:
        used = run.summary["bound_used_most"]
        found.append((f"{100 * used:.0f} % of the heat bound used", "good" if used <= 1.0 else "look"))
    tolerance = run.scene.get("layer", {}).get("tolerance")
    if tolerance:
        estimate = float(np.nanmax(run["error_estimate"])) if "error_estimate" in run else None
        known = f", estimated error {estimate:.1e}" if estimate is not None else ""
        found.append((f"tolerance {tolerance:g}{known}", "good" if estimate is None or estimate <= tolerance else "look"))
    return found


def five_numbers(runs):
    """Returns rows (label, unit, what it is, [text per run]) of the five large numbers."""
    summary = lambda run, *keys: next((run.summary[key] for key in keys if key in run.summary), None)
    heat_key = next((key for key in ("friction_heat_j", "friction_heat_j_per_m", "friction_work_j_per_m2") if key in runs[0].summary), None)

    def heat(run):
        if heat_key:
            return summary(run, heat_key)
        return float(run["heat"].mean()) if run.table and run["heat"] is not None else None

    def service(run):
        if run.summary.get("run_time_s") and "solver_time_s" in run.summary:
            return (run.summary["solver_time_s"] + run.summary["bus_time_s"]) / run.summary["run_time_s"]
        return run.summary.get("service_share") if run.law == "subgrid" else None

    percent = lambda value: None if value is None else 100 * value
    unit = {"friction_heat_j": "J", "friction_heat_j_per_m": "J/m"}.get(heat_key, "J/m²")
    rows = [("slip", "mm", "mean over the nodes", lambda run: run.slip().mean() * 1e3),
            ("hottest", "K", "interface temperature", lambda run: summary(run, "peak_interface_temperature_k") or float(run["hottest"])),
            ("friction heat", unit, "of the whole interface" if heat_key and "work" not in heat_key else "into the layers, mean over the nodes", heat),
            ("at melting", "%", "of the nodes at some time: T0 from 0.99 T_melt on", lambda run: 100 * float((run.molten_time() > 0).mean())),
            ("service", "%", "share of the run time", lambda run: percent(service(run)))]
    return [(label, unit, what, [number(value(run)) for run in runs]) for label, unit, what, value in rows]


# -- the case --


def outline_figure(run):
    figure, axis = style.figure(1, 1, (4.6, 3.6))
    for body, loop in plot_cone.outlines(run, run.frame(-1.0)).items():
        for side in (-1, 1) if run.axisymmetric else (1,):
            axis.add_patch(plt.Polygon(loop * (side, 1), facecolor=BODIES[body % len(BODIES)], edgecolor=style.INK, lw=0.7))
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


def columns_figure(run):
    """Two bodies above each other, the upper one sliding."""
    figure, axis = style.figure(1, 1, (5.6, 2.6))
    soft, hard = (run.scene.get(key, {}).get("material", key) for key in ("soft", "hard"))
    axis.add_patch(plt.Rectangle((0, 0), 10, 1, facecolor=BODIES[0], edgecolor=style.INK, lw=0.8))
    axis.add_patch(plt.Rectangle((0, -1), 10, 1, facecolor=BODIES[1], edgecolor=style.INK, lw=0.8))
    axis.annotate("", (8.8, 0.5), (6.6, 0.5), arrowprops={"arrowstyle": "-|>", "color": style.INK})
    axis.text(0.3, 0.5, f"soft: {soft}", va="center")
    axis.text(0.3, -0.5, f"hard: {hard}", va="center")
    jumps = plot_histories.jump(run)
    known = "" if "velocity_jump" in run else "sliding up to "
    axis.text(7.7, 0.66, known + (f"{number(jumps.min())} to {number(jumps.max())} m/s" if np.ptp(jumps) > 0 else f"{number(jumps[0])} m/s"), ha="center", va="bottom", fontsize=9)
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
    facts = [("strategy", run.scene.get("strategy", "")), ("friction coefficient", run.scene.get("interface", {}).get("friction_coefficient", "")),
             ("melting curve", soft.get("melting_curve", "")), ("heat", run.scene.get("layer", {}).get("heat", "")), ("time integrator", run.scene.get("layer", {}).get("time_integrator", "")),
             ("tolerance", run.scene.get("layer", {}).get("tolerance", ""))]
    return {"sketch": picture(svg(sketch, "case", "the bodies at the start"), "the bodies at the start" if run.two_dimensions else "each column: two bodies, one jump"),
            "materials": rows, "names": [body.get("material", "own constants") for body in (soft, hard)], "source": run.scene.get("source", ""),
            "sources": [(body["material"], sources[body["material"]]) for body in (soft, hard) if body.get("material") in sources],
            "facts": [(name, value) for name, value in facts if value != ""]}


# -- fields and maps --


def fields(runs, footer):
    """Returns the pictures of the final state, of the maps, and of the free surface."""
    found = []
    flat, round_ = [run for run in runs if run.table and not run.two_dimensions], [run for run in runs if run.two_dimensions]
    if round_:
        texts = {"cone_temperature.png": "The zones of the hydrocode hide the layer: the right picture shows the temperature of the interface itself.",
                 "cone_regime.png": "What held the stress at each interface node. Grey: no contact.",
                 "cone_interface_temperature.png": "Lines: 350, 500, 750, 1000 and 1250 K.", "cone_free_surface.png": "What a velocimeter behind the cone would see."}
        interfaces = [run for run in round_ if run.table and run.place is not None]
        for name, figure in plot_cone.pictures(interfaces) if interfaces else ():
            title = name[len("cone_") : -len(".png")].replace("_", " ")
            title = {"temperature": "final state", "regime": "friction regime"}.get(title, title)
            found.append(picture(png(figure, footer), title, texts.get(name, ""), wide=True))
        for run in round_ if not interfaces else ():
            figure, axis = style.figure(1, 1, (7, 4.4))
            drawn, extend, time = plot_cone.mirrored(axis, [run])
            figure.colorbar(drawn, label=f"temperature of the zones at {time:.3g} µs (K)", extend=extend)
            found.append(picture(png(figure, footer), "final state"))
    if flat:
        for name, figure, left_out in plot_histories.pictures(flat):
            text = f"{left_out} groups of columns are left out." if left_out else ""
            found.append(picture(png(figure, footer), name.removesuffix(".png"), text, wide=True))
    return found


# -- selected nodes --


def history_panel(runs, index, node, quantity):
    label, factor, _ = style.QUANTITIES[quantity]
    figure, axis = style.figure(1, 1, SMALL)
    figure.get_layout_engine().set(rect=(0, 0, 1, 1))
    regimes = runs[0]["regime"][:, node] if "regime" in runs[0] else None
    changes = np.flatnonzero(np.diff(regimes.astype(int), prepend=-1)) if regimes is not None else []
    edges = np.concatenate(([runs[0].time[0]], runs[0].time))
    colours = [colour for _, colour in style.REGIMES.values()]
    for begin, end in zip(changes, [*changes[1:], len(runs[0].time)]):
        axis.axvspan(edges[begin], edges[end], ymax=0.045, color=colours[regimes[begin]], lw=0)
    for run in runs:
        same = np.flatnonzero(run.nodes == runs[0].nodes[node])
        if same.size and quantity in run:
            values = run[quantity][:, same[0]] * factor
            values = np.abs(values) if quantity == "sliding_velocity" else values
            rows = np.unique(np.linspace(0, len(values) - 1, 400).round().astype(int))
            axis.plot(run.time[rows], values[rows], color=law_colour(run.law), lw=1.5)
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
    figure, axis = style.figure(1, 1, SMALL)
    for entry, shade in zip(entries, np.linspace(0.15, 0.75, len(entries))):
        axis.plot(kept["position"] * 1e6, kept["layer_temperature"][entry][column], color=plt.cm.plasma(shade), lw=1.5, label=f"{kept['time'][entry] * 1e6:.2f} µs")
    axis.set(xlabel="z across the interface (µm)", ylabel="temperature (K)")
    axis.legend(fontsize=8)
    axis.grid()
    return svg(figure, f"node{index}-profile", "temperature across the layer of the node")


def nodes(runs):
    """Returns the selected nodes of the first run: title and small pictures."""
    first, found = runs[0], []
    for index, (node, reasons) in enumerate(first.selected().items()):
        where = f", at {first.place_name} = {first.place[node] * 1e3:.1f} mm" if first.place is not None else ""
        panels = [history_panel(runs, index, node, name) for name in ("shear_stress", "interface_temperature", "sliding_velocity")]
        profile = profile_panel(first, node, index)
        found.append({"title": f"node {first.nodes[node]}{where}{': ' + ', '.join(reasons) if len(first.nodes) > 1 else ''}", "panels": panels + ([profile] if profile else [])})
    return found


# -- ledger and cost --


def bars(parts, name, unit):
    """Returns a stacked bar as HTML values: [(label, text, share in percent, colour)]. parts: [(label, value,
    colour)]."""
    whole = sum(max(value, 0.0) for _, value, _ in parts) or 1.0
    return {"title": name, "parts": [(label, f"{number(value)} {unit}", 100 * max(value, 0.0) / whole, colour) for label, value, colour in parts]}


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
        parts = [("heat to the soft body", layer["heat_to_soft_j_per_m2"], style.SECOND), ("heat to the hard body", layer["heat_to_hard_j_per_m2"], SHARES[1]),
                 ("plastic work in the layer", layer["plastic_work_j_per_m2"], SHARES[2]), ("elastic energy", layer["elastic_energy_j_per_m2"], SHARES[0])]
        found.append(bars([part for part in parts if part[1]], f"work of the interface stress, {number(layer['interface_work_j_per_m2'])} J/m², mean of the nodes", "J/m²"))
    keys = (("energy_residual", "energy of the run, relative"), ("momentum_residual", "momentum of the run, relative"))
    rows = [(what, f"{summary[key]:.1e}") for key, what in keys if key in summary]
    rows += [(f"layer: {name} balance", f"{layer[key]:.1e} J/m²") for name, key in (("heat", "heat_residual_j_per_m2"), ("energy", "energy_residual_j_per_m2"))
             if layer.get("interface_work_j_per_m2")]
    return {"label": run.label, "bars": found, "rows": rows, "comparisons": summary.get("comparisons", [])}


def cost(run):
    summary, parts, total = run.summary, [], run.summary.get("run_time_s")
    if total and "solver_time_s" in summary:
        parts = [("hydrocode", summary["hydro_time_s"], SHARES[0]), ("solver of the layers", summary["solver_time_s"], style.SECOND),
                 ("bus", summary["bus_time_s"], SHARES[1]), ("output", summary["output_time_s"], style.FAINT)]
    elif total and "waiting_share" in summary:
        waited = summary["waiting_share"] * total
        parts = [("waiting for answers", waited, style.SECOND), ("hydrocode and output", total - waited, SHARES[0])]
    rows = [(name, number(summary[key])) for key, name in (("zones", "zones"), ("columns", "columns"), ("steps", "steps"), ("steps_taken_back", "steps taken back")) if key in summary]
    rows += [("run time", f"{number(total)} s")] if total else []
    omitted = summary.get("omitted", {})
    if omitted.get("parts"):
        rows.append(("left out", ", ".join(str(part) for part in omitted["parts"])))
        rows.append(("bytes of state per node", f"{omitted['bytes_per_node']} ({omitted['bytes_per_node_with_everything']} with everything)"))
    flags = list(run["outcomes"].items()) if run.table else []
    return {"label": run.label, "bars": [bars(parts, f"run time, {number(total)} s", "s")] if parts else [], "rows": rows, "flags": flags}


# -- the paper --


def paper(directory):
    """Returns the figures of figures.json in a directory: [{"figure", "title", "src", "agrees": [...], "differs":
    [...]}]."""
    if directory is None:
        return []
    try:
        listed = json.loads((directory / "figures.json").read_text())
        found = []
        for entry in listed:
            image = Image.open(directory / entry["file"]).convert("RGB")
            image.thumbnail((LARGEST_PICTURE, 3 * LARGEST_PICTURE))
            out = io.BytesIO()
            image.quantize(256, dither=Image.Dither.NONE).save(out, format="png", optimize=True)
            several = lambda value: [value] if isinstance(value, str) else list(value)
            found.append({"figure": entry["figure"], "title": entry["title"], "width": image.width * 5 // 8, "src": "data:image/png;base64," + base64.b64encode(out.getvalue()).decode(),
                          "agrees": several(entry.get("agrees", [])), "differs": several(entry.get("differs", []))})
        return found
    except (OSError, ValueError, KeyError, TypeError) as fault:
        raise Fault(f"{directory}: expected figures.json, a list of figures with figure, title and file, and their pictures: {fault}") from fault


def report(paths, figures, control, command):
    """Returns the values of the template for these runs. figures: directory of the paper's figures, or None; control:
    path of shearbus-ctl. Raises Fault."""
    runs, of_the_paper = [Run(path) for path in paths], paper(figures)
    compared = [run for run in runs if run.table]
    main = plot_cone.main_runs(compared)
    footer = style.provenance_text(*(run.provenance for run in runs))
    first = main[0] if main else runs[0]
    return {
        "names": list(dict.fromkeys(run.name for run in runs)),
        "runs": [{"label": run.label, "colour": law_colour(run.law), "path": str(run.path), "verdicts": verdicts(run), "provenance": run.provenance,
                  "time": run.summary.get("run_time_s")} for run in runs],
        "numbers": five_numbers(main) if main else [], "number_runs": [(run.label, law_colour(run.law)) for run in main],
        "case": the_case(first, material_sources(control)), "fields": fields(runs, footer), "nodes": nodes(main) if main else [],
        "has_profiles": any("profiles" in run.table for run in main), "ledgers": [ledger(run) for run in runs], "costs": [cost(run) for run in runs],
        "paper": of_the_paper, "scene_text": first.scene_text, "regimes": list(style.REGIMES.values()),
        "files": [(str(run.path), sorted((p.name, p.stat().st_size) for p in (run.path.iterdir() if run.path.is_dir() else [run.path]) if p.is_file())) for run in runs],
        "provenance": footer, "command": command, "number": number, "replayed": not first.path.is_dir(),
    }
