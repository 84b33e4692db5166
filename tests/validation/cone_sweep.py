#!/usr/bin/python3
"""The coupled cone: zones of the hydrocode against accuracy of the layer. Where is the layer's error below the hydrocode's?

    cone_sweep.py --hydro build/bin/shearbus-hydro [--zones 2e-3,1e-3,0.5e-3] [--end 12e-6] [--out DIR]

Each layer runs with each zone width, in time steps that the hydrocode chooses. A run gives the friction heat and the mean slip of the whole
interface, and T0 of every node at every output. The error of a layer is its distance to the best layer in the same zones. The error of the
zones is the distance to zones half as wide, both with the best layer; T0 is compared only within the same zones, because other zones have
other nodes. Writes cone_sweep.json and prints the table."""
import json
import pathlib
import subprocess
import sys

import h5py
import numpy

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / room) for room in ("client/report", "tests/support")]
import served  # noqa: E402
from terminal import Parser, positive_number, positive_numbers  # noqa: E402

SCENE = ROOT / "hydro_stub/problems/cone_al_steel_hot.toml"
BEST, HALVED = "modes 1e-6, sdirk2", "zones half as wide (hydro error)"
MELTING_RANGE = 1220.0 - 300.0  # T_melt - T_ref of the scene's aluminium [K]
COMMON = 'thickness_m = 100e-6\nfar_boundary = "half_space"'
LAYERS = {  # keys of [layer] that replace the scene's
    BEST: 'heat = "modes"\nmodes.accuracy = 1e-6\ntime_integrator = "sdirk2"',
    "profile, 640 cells x1.0075, sdirk2": 'cells = 640\ngrading = 1.0075\ntime_integrator = "sdirk2"',
    "profile, 160 cells x1.03": "cells = 160\ngrading = 1.03",
    "profile, 80 cells x1.06": "cells = 80\ngrading = 1.06",
    "profile, 40 cells x1.12": "cells = 40\ngrading = 1.12",
    "profile, 20 cells x1.25": "cells = 20\ngrading = 1.25",
    "profile, 10 cells x1.6": "cells = 10\ngrading = 1.6",
    "profile, 5 cells x2": "cells = 5\ngrading = 2",
    "profile, 80 cells x1.06, sdirk2": 'cells = 80\ngrading = 1.06\ntime_integrator = "sdirk2"',
    "modes 1e-3": 'heat = "modes"\nmodes.accuracy = 1e-3',
    "modes 1e-3, sdirk2": 'heat = "modes"\nmodes.accuracy = 1e-3\ntime_integrator = "sdirk2"',
}


def run(hydro, layer, zone, end, out):
    """Returns the summary of a run, with the temperature of every node at every output."""
    out.mkdir(parents=True, exist_ok=True)
    scene = served.edited(SCENE, out / "scene.toml", zone_width_m=zone, end_time_s=end)
    before, _, rest = scene.read_text().partition("[layer]\n")
    scene.write_text(f"{before}[layer]\n{COMMON}\n{LAYERS[layer]}\n\n{rest[rest.index('[interface]'):]}")
    done = subprocess.run([hydro, scene, "--out", out / "run", "--no-plot", "--no-progress"], capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{scene}: {done.stderr.strip()}")
    with h5py.File(out / "run/interface.h5") as file:
        return {**json.loads((out / "run/summary.json").read_text()), "temperature": file["interface_temperature"][:]}


def distance(one, other):
    found = {key: abs(one[key] / other[key] - 1.0) for key in ("friction_heat_j", "mean_slip_m")}
    a, b = one["temperature"], other["temperature"]
    if a.shape == b.shape:  # the same zones and the same number of outputs
        apart = numpy.abs(a - b) / MELTING_RANGE
        found |= {"temperature_rms": float(numpy.sqrt(numpy.mean(apart**2))), "temperature_max": float(apart.max())}
    return found


def main():
    parser = Parser(description=__doc__)
    parser.add_argument("--hydro", type=pathlib.Path, required=True)
    parser.add_argument("--zones", type=positive_numbers, default="2e-3,1e-3,0.5e-3", help="zone widths, m, each half the one before")
    parser.add_argument("--layers", default="", help="only layers whose name contains this (and the best)")
    parser.add_argument("--end", type=positive_number, default=12e-6, help="s")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("out/study"))
    options = parser.parse_args()
    zones = options.zones
    if any(abs(a / b - 2) > 1e-9 for a, b in zip(zones, zones[1:])):
        sys.exit("cone_sweep.py: --zones: each zone width is to be half the one before")
    layers = [name for name in LAYERS if name == BEST or options.layers in name]
    runs = {(zone, layer): run(options.hydro, layer, zone, options.end, options.out / "cone" / f"{number}-{place}")
            for number, zone in enumerate(zones) for place, layer in enumerate(layers)}
    rows = [(zone, layer, distance(one, runs[zone, BEST])) for (zone, layer), one in runs.items() if layer != BEST]
    rows += [(zone, HALVED, distance(runs[zone, BEST], runs[finer, BEST])) for zone, finer in zip(zones, zones[1:])]
    print(f"{'zones':>8} {'layer':<34} {'heat':>9} {'slip':>9} {'T0 rms':>9} {'T0 max':>9}   (errors)")
    for zone, layer, error in rows:
        print(f"{zone * 1e3:5.2f} mm {layer:<34} " + " ".join(f"{value:9.1e}" for value in error.values()))
    path = options.out / "cone_sweep.json"
    path.write_text(json.dumps({"study": "cone", "provenance": runs[zones[0], BEST]["provenance"], "best": BEST,
                                "rows": [{"zone_width_m": zone, "layer": layer, "error": error} for zone, layer, error in rows]}, indent=1))
    print(f"written: {path}")


if __name__ == "__main__":
    main()
