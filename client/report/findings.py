"""What runs have found, in words and numbers: the head of a report."""
import numpy as np

NOTHING = "–"  # the text of a number that is not known
ROUNDING = 1e-12  # a smaller relative residual is rounding


def number(value, digits=3):
    """Returns a number with so many significant digits, without an exponent where that is short."""
    if value is None or not np.isfinite(value):
        return NOTHING
    if value == 0 or 1e-3 <= abs(value) < 1e6:
        decimals = max(0, digits - 1 - int(np.floor(np.log10(abs(value))))) if value else 0
        return f"{value:,.{decimals}f}"
    return f"{value:.{digits - 1}e}"


def verdicts(run):
    """Returns (text, "good" or "look") of what a reader wants to know first."""
    found = [("incomplete: the run did not reach its end", "look")] if run.incomplete else []
    for key, what in (("energy_residual", "energy"), ("momentum_residual", "momentum")):
        if key in run.summary:
            residual = abs(run.summary[key])
            found.append((f"{what} closed to {'rounding' if residual < ROUNDING else f'{residual:.0e}'}", "good" if residual < 1e-9 else "look"))
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
        found.append((f"friction work: {100 * used:.0f} % of what heats an interface to melting, at most" if used <= 1.0 else
                      f"friction work: {100 * used:.0f} % of what heats an interface to melting", "good" if used <= 1.0 else "look"))
    tolerance = run.scene.get("layer", {}).get("tolerance")
    if tolerance:
        estimate = float(np.nanmax(run["error_estimate"])) if "error_estimate" in run else None
        known = f", estimated error {estimate:.1e}" if estimate is not None else ""
        found.append((f"tolerance {tolerance:g}{known}", "good" if estimate is None or estimate <= tolerance else "look"))
    return found


def hottest(run):
    return run.summary.get("peak_interface_temperature_k") or float(run["hottest"])


def displaced(run):
    """Returns how far metal moved against metal over 1 mm on both sides of the interface (m, mean), which the zones of
    the hydrocode decide less than the slip; None where the run does not tell."""
    bands = [band for band in run.summary.get("displacement", []) if band["band_m"] == 1e-3]
    told = bands[0].get("mean_m", bands[0].get("displacement_m")) if bands else None  # of columns one each
    return None if told is None else float(np.mean(told))


def farther(slip, than):
    """Returns how far a slip is in comparison: "4.9 times farther", "8.0 % less far", "as far"."""
    if min(slip, than) <= 0:
        return f"{number(slip * 1e3)} mm"
    ratio, word = max(slip, than) / min(slip, than), "farther" if slip > than else "less far"
    return f"{number(ratio, 2)} times {word}" if ratio >= 2 else f"{number(100 * abs(slip / than - 1), 2)} % {word}" if ratio >= 1.0005 else "as far"


def verdict(runs):
    """Returns what a report says in words, two sentences: how far the metals moved or slid, how hot the interface became, what held it, or how
    the runs differ. runs: with histories."""
    if not runs:
        return ""
    first, rest = runs[0], runs[1:]
    moved = displaced if all(run.two_dimensions and displaced(run) for run in runs) else lambda run: run.mean(run.slip())
    what = "metal moved {} mm against metal, over 1 mm on both sides and" if moved is displaced else "the interface slid {} mm,"
    if "regime" in first and not (first["regime"] > 0).any():
        text = "the contact was open in the whole run: nothing slid, and friction heated nothing"
    else:
        molten = 100 * float((first.molten_time() > 0).mean())
        text = (f"{what.format(number(moved(first) * 1e3))} on the mean, and the interface reached {number(hottest(first), 4)} K; "
                f"{f'{number(molten, 2)} %' if molten else 'none'} of the nodes came within 1 % of melting")
    sentences = [f"{first.label}: {text}" if rest else text[0].upper() + text[1:]]
    shares = {name: first.summary[f"slip_share_{name}"] for name in ("coulomb", "tresca", "melting") if f"slip_share_{name}" in first.summary}
    if not rest and any(shares.values()):
        name = max(shares, key=shares.get)
        held = {"coulomb": "the friction coefficient times pressure (Coulomb)", "tresca": "the strength of the softer metal (Tresca)", "melting": "the strength of a metal about to melt"}
        sentences.append(f"Most of the slip, {100 * shares[name]:.0f} %, was limited by {held[name]}")
    sentences += [f"{other.label}: {farther(moved(other), moved(first))}, and {number(hottest(other), 4)} K" for other in rest[:3]]
    return ". ".join(sentences) + "."


def five_numbers(runs):
    """Returns rows (label, unit, what it is, [text per run]) of up to five large numbers: those that a run has."""
    summary = lambda run, *keys: next((run.summary[key] for key in keys if key in run.summary), None)
    heat_key = next((key for key in ("friction_heat_j", "friction_heat_j_per_m", "friction_work_j_per_m2") if key in runs[0].summary), None)

    def heat(run):
        if heat_key == "friction_work_j_per_m2" and (layer := run.summary.get("layer_energy")):  # means of the columns
            return layer["heat_to_soft_j_per_m2"] + layer["heat_to_hard_j_per_m2"]
        if heat_key == "friction_work_j_per_m2":  # of all columns
            return run.summary[heat_key] / run.summary["columns"] if heat_key in run.summary else None
        if heat_key:
            return summary(run, heat_key)
        return float(run["heat"].mean()) if run.table and run["heat"] is not None else None

    def service(run):
        if run.summary.get("run_time_s") and "solver_time_s" in run.summary:
            return (run.summary["solver_time_s"] + run.summary["bus_time_s"]) / run.summary["run_time_s"]
        return run.summary.get("waiting_share", run.summary.get("service_share")) if run.law == "subgrid" else None

    percent = lambda value: None if value is None else 100 * value
    unit = {"friction_heat_j": "J", "friction_heat_j_per_m": "J/m"}.get(heat_key, "J/m²")
    rows = [("slip", "mm", "mean of the interface", lambda run: run.mean(run.slip()) * 1e3),
            ("displacement", "mm", "metal against metal over ±1 mm, mean of the interface", lambda run: displaced(run) and displaced(run) * 1e3),
            ("hottest", "K", "interface temperature", hottest),
            ("friction heat", unit, "of the whole interface" if heat_key and "work" not in heat_key else "into the layers, mean over the nodes", heat),
            ("at melting", "%", "of the nodes came within 1 % of the melting temperature", lambda run: 100 * float((run.molten_time() > 0).mean())),
            ("waiting for answers", "%", "of the run time, for the subgrid server", lambda run: percent(service(run)))]
    found = [(label, unit, what, [number(value(run)) for run in runs]) for label, unit, what, value in rows]
    return [row for row in found if any(text != NOTHING for text in row[3])]
