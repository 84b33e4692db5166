#!/usr/bin/python3
"""How much of a coupled answer is the mesh's? Runs a cone scene on meshes that halve, extrapolates each answer
to zones of no width, and prints error against run time.

    shearbus-study mesh [SCENE.toml] [--meshes 0.5e-3,0.25e-3,0.125e-3] [--law subgrid] [--out DIR]

Answers: displacement of metal against metal over +-0.5 and +-1 mm and slip (means over the interface nodes),
friction impulse, and the highest velocity of the free surface on the axis. With three meshes whose
differences fall the order is theirs, between 0.5 and 2; otherwise it is 1. The column "zones" is the error to
the extrapolated answer. The two other errors are those of the middle mesh: "dt" the change with half the
Courant number, "layer" the change with twice the cells of the layer (or, with heat modes, a tenth of their
error). first_zone_m is scaled with the zones. Writes mesh.json and mesh.png to --out."""
import json
import math
import pathlib
import subprocess
import sys
import tempfile
from argparse import SUPPRESS

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "client/report"))
import output  # noqa: E402
from scene_text import value_of, with_value  # noqa: E402
from terminal import Parser, complain, positive_numbers  # noqa: E402

ANSWERS = (("displacement_1mm", "metal over +-1 mm", "mm", 1e3), ("displacement_0.5mm", "over +-0.5 mm", "mm", 1e3), ("slip", "slip", "mm", 1e3),
           ("impulse", "friction impulse", "Pa s", 1.0), ("free_surface", "free surface, highest", "m/s", 1.0))
CONE = "hydro.cone_target."
RESULT = ("a result of shearbus-study mesh", lambda head: b'"study": "mesh"' in head)


class Fault(Exception):
    pass


def on_mesh(text, zone):
    width, first = (value_of(text, CONE + key) for key in ("zone_width_m", "first_zone_m"))
    if width is None:
        raise Fault("the scene has no [hydro.cone_target] with zone_width_m, expected a cone; see hydro_stub/problems/cone_al_steel.toml")
    text = with_value(text, CONE + "zone_width_m", zone)
    return with_value(text, CONE + "first_zone_m", first * zone / width) if first is not None else text


def finer_layer(text):
    if value_of(text, "layer.heat") == "modes":
        return with_value(text, "layer.modes.accuracy", 0.1 * (value_of(text, "layer.modes.accuracy") or 1e-6))
    cells, grading = value_of(text, "layer.cells") or 500, value_of(text, "layer.grading") or 1.0
    return with_value(with_value(text, "layer.cells", 2 * cells), "layer.grading", math.sqrt(grading))


def run(hydro, text, law, out):
    """Returns the answers of a run, its number of steps and its processor time (s)."""
    import h5py
    out.mkdir(parents=True, exist_ok=True)
    (out / "scene.toml").write_text(text)
    done = subprocess.run([hydro, out / "scene.toml", "--interface-law", law, "--out", out / "run", "--no-plot", "--no-progress"],
                          capture_output=True, text=True)
    if done.returncode != 0:
        raise Fault("; ".join(done.stderr.strip().removeprefix("shearbus-hydro: ").splitlines()))
    summary = json.loads((out / "run/summary.json").read_text())
    answers = {f"displacement_{band['band_m'] * 1e3:g}mm": band["mean_m"] for band in summary.get("displacement", [])}
    answers.update(slip=summary["mean_slip_m"], impulse=summary["mean_friction_impulse_pa_s"])
    if (out / "run/free_surface.h5").exists():
        with h5py.File(out / "run/free_surface.h5") as file:
            answers["free_surface"] = float(file["axial_velocity"][:, -1].max())
    return {"provenance": summary["provenance"], "answers": answers, "steps": summary["steps"], "zones": summary["zones"], "cpu_s": summary["cpu_time_s"]}


def extrapolated(values):
    """Returns the answer on zones of no width, from meshes that halve, coarsest first, and the order."""
    order = 1.0
    if len(values) >= 3:
        before, last = values[-2] - values[-3], values[-1] - values[-2]
        if last != 0.0 and before / last > 1.0:
            order = min(2.0, max(0.5, math.log2(before / last)))
    return values[-1] + (values[-1] - values[-2]) / (2.0**order - 1.0), order


def study(options):
    text = options.scene.read_text()
    zones = options.meshes
    runs = []
    for zone in zones:
        runs.append(run(options.hydro, on_mesh(text, zone), options.law, options.out / f"{zone * 1e3:g}mm"))
        print(f"  zones of {zone * 1e3:g} mm: {runs[-1]['zones']} zones, {runs[-1]['steps']} steps, {runs[-1]['cpu_s']:.1f} s", flush=True)
    middle = len(zones) // 2 if len(zones) > 2 else 0
    at_middle = on_mesh(text, zones[middle])
    half_dt = run(options.hydro, with_value(at_middle, CONE + "courant", 0.5 * (value_of(text, CONE + "courant") or 0.7)), options.law, options.out / "half_dt")
    layer = run(options.hydro, finer_layer(at_middle), options.law, options.out / "layer") if options.law == "subgrid" else None
    rows = []
    for key, label, unit, scale in ANSWERS:
        if any(key not in made["answers"] for made in runs):
            continue
        values = [made["answers"][key] for made in runs]
        limit, order = extrapolated(values)
        relative = lambda value, exact: (value - exact) / abs(exact) if exact else 0.0
        rows.append({"answer": key, "label": label, "unit": unit, "values": values, "extrapolated": limit, "order": order,
                     "error_zones": [relative(value, limit) for value in values],
                     "finest_two": relative(values[-2], values[-1]),
                     "error_dt": relative(values[middle], half_dt["answers"][key]),
                     "error_layer": relative(values[middle], layer["answers"][key]) if layer else None, "scale": scale})
    return {"study": "mesh", "scene": options.scene.stem, "law": options.law, "zones_m": zones, "runs": runs, "rows": rows}


def table(found):
    names = [f"{zone * 1e3:g} mm" for zone in found["zones_m"]]
    print(f"\n| answer | {' | '.join(names)} | extrapolated (order) | zones: error of each, % | two finest, % | dt, % | layer, % |")
    print("|" + "---|" * (len(names) + 6))
    percent = lambda value: "" if value is None else f"{100 * value:+.2f}"
    for row in found["rows"]:
        values = " | ".join(f"{value * row['scale']:.4g}" for value in row["values"])
        print(f"| {row['label']}, {row['unit']} | {values} | {row['extrapolated'] * row['scale']:.4g} ({row['order']:.1f}) "
              f"| {', '.join(percent(error) for error in row['error_zones'])} | {percent(row['finest_two'])} | {percent(row['error_dt'])} | {percent(row['error_layer'])} |")
    print("| processor time, s | " + " | ".join(f"{made['cpu_s']:.3g}" for made in found["runs"]) + " | | | | | |")


def draw(found, out):
    import style
    figure, axis = style.figure(1, 1, (7.0, 4.4), legend=True)
    times, made = [run["cpu_s"] for run in found["runs"]], found["runs"][-1]
    drawn = []
    for row, mark in zip(found["rows"], "os^Dv"):
        drawn += axis.plot(times, [max(1e-5, abs(error)) * 100 for error in row["error_zones"]], mark + "-", label=row["label"].replace("+-", "±"))
    drawn.append(axis.axhline(2.0, color=style.FAINT, ls="--", lw=1.2, label="2 %"))
    axis.set(xscale="log", yscale="log", xlabel="processor time of the coupled run (s)", ylabel="error to the extrapolated answer (%)",
             title=f"{found['scene']}, zones of {', '.join(f'{zone * 1e3:g}' for zone in found['zones_m'])} mm")
    axis.grid()
    style.legend_below(figure, drawn)
    style.save(figure, out / "mesh.png", [{**made["provenance"], "program": f"shearbus-study mesh, law {found['law']}"}], colours=64)
    print(f"\nwritten: {out / 'mesh.png'}, {out / 'mesh.json'}")


def main():
    parser = Parser(prog="shearbus-study mesh", description=__doc__)
    parser.add_argument("scene", type=pathlib.Path, nargs="?", default=ROOT / "hydro_stub/problems/cone_al_steel.toml")
    parser.add_argument("--meshes", type=positive_numbers, default="0.5e-3,0.25e-3,0.125e-3", help="widths of zones that halve, m")
    parser.add_argument("--law", choices=("subgrid", "coulomb_tresca", "free_slip", "stick", "constant"), default="subgrid", help="interface law of the runs")
    parser.add_argument("--bin", type=pathlib.Path, required=True, help=SUPPRESS)
    parser.add_argument("--out", type=pathlib.Path, help="keeps the runs, the table and the picture")
    options = parser.parse_args()
    options.meshes.sort(reverse=True)
    if len(options.meshes) < 2 or any(not 1.99 < a / b < 2.01 for a, b in zip(options.meshes, options.meshes[1:])):
        parser.error(f"--meshes {','.join(map(str, options.meshes))}: expected at least two widths of zones that halve, as 0.5e-3,0.25e-3")
    options.hydro = options.bin / "shearbus-hydro"
    with tempfile.TemporaryDirectory() as scratch:
        keep = options.out is not None
        options.out = options.out or pathlib.Path(scratch)
        try:
            if keep:
                output.prepare(options.out, {"mesh.json": RESULT, "mesh.png": output.PICTURE})
            found = study(options)
        except (Fault, OSError, ValueError) as fault:  # ValueError: the scene is no TOML
            complain("shearbus-study: mesh", fault)
            return 1
        except KeyboardInterrupt:
            complain("shearbus-study: mesh", "interrupted")
            return 1
        table(found)
        if keep:
            output.write(options.out / "mesh.json", RESULT, (json.dumps(found, indent=2) + "\n").encode())
            draw(found, options.out)
    return 0


if __name__ == "__main__":
    sys.exit(main())
