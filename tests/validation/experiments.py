#!/usr/bin/python3
"""Runs the scenes of hydro_stub/problems/validation with the catalog's coppers and compares them with what was measured.

    tests/validation/experiments.py --hydro build/bin/shearbus-hydro [--metal NAME ...] [--out DIR] [--picture FILE]

Plates: velocity of the free surface: its plateau, the time at which half of it is reached, the foot before the
shock. Bar: radius of the side at rest, foot and root mean square. Prints a row for each metal; --picture draws the
curves. tests/measured.toml has the numbers, integration.hydro_experiments holds them."""
import json
import pathlib
import re
import subprocess
import sys
import tempfile

import h5py
import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "client/report"))
from terminal import Parser  # noqa: E402

METALS = ("copper_ofhc", "copper_ofhc_jc", "copper_ofhc_ptw")
SCENES = ("copper_plates", "copper_bar")


def measured(scene):
    return np.loadtxt(ROOT / f"tests/validation/curves/{scene}.csv", delimiter=",", comments="#", skiprows=3, unpack=True)


def run(hydro, scene, metal, out, changes=()):
    """Returns the surface of a run: velocity against time of the plates' axis, or height and radius of the bar at the end."""
    text = (ROOT / f"hydro_stub/problems/validation/{scene}.toml").read_text()
    text = re.sub(r'(?m)^material = ".*"', f'material = "{metal}"', text)
    for key, value in changes:
        text, found = re.subn(rf"(?m)^{key} = \S+", f"{key} = {value}", text)
        if not found:
            raise SystemExit(f"experiments.py: {scene}.toml has no {key}")
    out.mkdir(parents=True, exist_ok=True)
    (out / "scene.toml").write_text(text)
    done = subprocess.run([hydro, out / "scene.toml", "--out", out / "run", "--no-plot", "--no-progress"], capture_output=True, text=True,
                          check=False)
    if done.returncode != 0:
        raise SystemExit(f"experiments.py: {scene} with {metal}: {done.stderr.strip()}")
    with h5py.File(out / "run/free_surface.h5") as f:
        if scene == "copper_plates":
            return f["time"][:], f["axial_velocity"][:, 0]
        return f["height"][-1], f["radius"][-1]


def plateau(time, velocity):
    return velocity[(time > 1.10e-6) & (time < 1.40e-6)].mean()


def at_half(time, velocity):
    """The first time of half the plateau's velocity; the digitised times of a rise do not increase."""
    level = 0.5 * plateau(time, velocity)
    i = int(np.argmax(velocity > level))
    return time[i - 1] + (time[i] - time[i - 1]) * (level - velocity[i - 1]) / (velocity[i] - velocity[i - 1])


def foot(time, velocity):
    """Mean velocity behind the elastic wave, before the shock."""
    return velocity[(time > 0.88e-6) & (time < 0.93e-6)].mean()


def of_plates(run_of):
    found, known = ([f(*curve) for f in (plateau, at_half, foot)] for curve in (run_of, measured("copper_plates")))
    return {"plateau_m_per_s": found[0], "plateau_measured_m_per_s": known[0], "half_s": found[1], "half_measured_s": known[1],
            "foot_m_per_s": found[2], "foot_measured_m_per_s": known[2]}


def of_bar(run_of):
    height, radius = run_of
    order = np.argsort(height)
    z, r = measured("copper_bar")
    off = np.interp(z, height[order], radius[order]) - r
    return {"rms_m": float(np.sqrt(np.mean(off**2))), "most_m": float(off[np.argmax(np.abs(off))]), "at_m": float(z[np.argmax(np.abs(off))]),
            "foot_m": float(radius[order][0]), "foot_measured_m": float(r[0]), "length_m": float(height.max())}


def compare(hydro, metals, directory, changes=None):
    """Runs both scenes with each metal; returns the curves and the residuals by metal."""
    changes = changes or {}
    curves = {m: {s: run(hydro, s, m, directory / f"{s}-{m}", changes.get(s, ())) for s in SCENES} for m in metals}
    return curves, {m: {**of_plates(c["copper_plates"]), **of_bar(c["copper_bar"])} for m, c in curves.items()}


def table(residuals):
    rows = ["metal              plateau, m/s      half of it, us    foot, m/s       bar: foot, mm    rms, mm   most, mm (at)"]
    for metal, r in residuals.items():
        rows.append(f"{metal:18} {r['plateau_m_per_s']:.1f} ({r['plateau_measured_m_per_s']:.1f})     {1e6 * r['half_s']:.4f} ({1e6 * r['half_measured_s']:.4f})  "
                    f"{r['foot_m_per_s']:5.1f} ({r['foot_measured_m_per_s']:.1f})    {1e3 * r['foot_m']:.2f} ({1e3 * r['foot_measured_m']:.2f})      "
                    f"{1e3 * r['rms_m']:.3f}     {1e3 * r['most_m']:+.2f} ({1e3 * r['at_m']:.1f})")
    return "\n".join(rows)


def draw(curves, summary, out):
    import style  # draws with matplotlib, which the comparison does not need
    figure, (plates, bar) = style.figure(1, 2, (11.0, 4.4))
    time, velocity = measured("copper_plates")
    plates.plot(1e6 * time, velocity, "ko", ms=3, label="measured")
    z, r = measured("copper_bar")
    bar.plot(1e3 * r, 1e3 * z, "ko", ms=3, label="measured")
    for metal, of in curves.items():
        plates.plot(1e6 * of["copper_plates"][0], of["copper_plates"][1], label=metal)
        order = np.argsort(of["copper_bar"][0])
        bar.plot(1e3 * of["copper_bar"][1][order], 1e3 * of["copper_bar"][0][order], label=metal)
    plates.set(xlabel="time after the impact (µs)", ylabel="velocity of the free surface (m/s)", xlim=(0.8, 1.6), title="copper on copper, 308 m/s")
    bar.set(xlabel="radius (mm)", ylabel="height above the wall (mm)", ylim=(0.0, 28.0), title="bar of copper, 214 m/s, at rest")
    for axes in (plates, bar):
        axes.legend()
    made = json.loads(summary.read_text())["provenance"]
    style.save(figure, out, [{**made, "scene": "copper_plates, copper_bar; data: Thomas 2016, Allen 1997, digitised in lanl/impala"}], colours=64)


def main():
    parser = Parser(description=__doc__)
    parser.add_argument("--hydro", required=True)
    parser.add_argument("--metal", nargs="+", default=list(METALS))
    parser.add_argument("--out", type=pathlib.Path)
    parser.add_argument("--picture", type=pathlib.Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        directory = options.out or pathlib.Path(scratch)
        curves, residuals = compare(options.hydro, options.metal, directory)
        if options.picture:
            draw(curves, next(directory.glob("*/run/summary.json")), options.picture)
    print(table(residuals))
    if options.out:
        (options.out / "experiments.json").write_text(json.dumps(residuals, indent=2) + "\n")


if __name__ == "__main__":
    main()
