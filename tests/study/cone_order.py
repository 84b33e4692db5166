#!/usr/bin/python3
"""Which law slides more? The mean slip of a cone scene with law (5) and with the subgrid service, for several widths of zones.

    cone_order.py --hydro build/bin/shearbus-hydro [SCENE.toml] [--zones 0.5e-3,0.25e-3,0.125e-3] [--out DIR]

Prints one row per width: mean slip with law (5) and with the service, the reduction of slip by the service in percent, and of both laws
the displacement of metal against metal over +-0.5 and +-1 mm, the friction impulse, the share of slip under Coulomb friction, the hottest interface and the highest pressure and sliding velocity of the flank. The last line
gives the spread of the reduction over the widths, largest less smallest. Two runs go side by side."""
import concurrent.futures
import json
import pathlib
import re
import subprocess
import sys
import tempfile

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "client/report"))
from terminal import Parser, positive_numbers  # noqa: E402

LAWS = ("coulomb_tresca", "subgrid")


def run(hydro, scene, zone, law, out):
    """Returns the summary of a run."""
    directory = out / f"{scene.stem}-{zone:g}-{law}"
    directory.mkdir(parents=True, exist_ok=True)
    widths = re.findall(r"(?m)^zone_width_m = (\S+)", scene.read_text())
    if len(widths) != 1:
        sys.exit(f"{scene}: expected one line zone_width_m = ..., found {len(widths)}")
    width = float(widths[0])
    text = re.sub(r"(?m)^zone_width_m = \S+", f"zone_width_m = {zone:g}", scene.read_text())
    if "first_zone_m" in text:  # the zones at the flank are as wide as the others, or graded in the same proportion
        first = float(re.search(r"(?m)^first_zone_m = (\S+)", text)[1]) * zone / width
        text = re.sub(r"(?m)^first_zone_m = \S+", f"first_zone_m = {first:g}", text)
    (directory / "scene.toml").write_text(text)
    done = subprocess.run([hydro, directory / "scene.toml", "--interface-law", law, "--out", directory / "run", "--no-plot", "--no-progress"],
                          capture_output=True, text=True)
    if done.returncode != 0:
        sys.exit(f"{directory / 'scene.toml'} with {law}: {done.stderr.strip()}")
    return json.loads((directory / "run/summary.json").read_text())


def row(zone, law5, subgrid):
    def both(key, scale, digits=0):
        return f"{law5[key] * scale:.{digits}f}, {subgrid[key] * scale:.{digits}f}"

    def moved(summary):
        return " / ".join(f"{band['mean_m'] * 1e3:.3f}" for band in summary["displacement"])

    reduction = 100 * (1 - subgrid["mean_slip_m"] / law5["mean_slip_m"])
    print(f"| {zone * 1e3:g} mm | {both('mean_slip_m', 1e3, 3)} mm | {reduction:.1f} % | {moved(law5)}, {moved(subgrid)} mm "
          f"| {both('mean_friction_impulse_pa_s', 1)} Pa s | {both('slip_share_coulomb', 100)} % "
          f"| {both('peak_interface_temperature_k', 1)} K | {both('peak_pressure_pa', 1e-9, 1)} GPa "
          f"| {both('peak_sliding_velocity_m_per_s', 1)} m/s |", flush=True)
    return reduction


def main():
    parser = Parser(description=__doc__)
    parser.add_argument("scene", type=pathlib.Path, nargs="?", default=ROOT / "hydro_stub/problems/cone_al_steel.toml")
    parser.add_argument("--hydro", type=pathlib.Path, required=True)
    parser.add_argument("--zones", type=positive_numbers, default="0.5e-3,0.25e-3,0.125e-3", help="zone widths, m")
    parser.add_argument("--out", type=pathlib.Path, help="keeps the runs")
    options = parser.parse_args()
    zones = options.zones
    with tempfile.TemporaryDirectory() as scratch, concurrent.futures.ThreadPoolExecutor(2) as pool:
        out = options.out or pathlib.Path(scratch)
        runs = {(zone, law): pool.submit(run, options.hydro, options.scene, zone, law, out) for zone in zones for law in LAWS}
        print("| zones | mean slip: law (5), subgrid | reduction | displacement over +-0.5 / +-1 mm | friction impulse | Coulomb, of slip | hottest | pressure | sliding velocity |")
        print("|---|---|---|---|---|---|---|---|---|")
        reductions = [row(zone, *(runs[zone, law].result() for law in LAWS)) for zone in zones]
    print(f"spread of the reduction: {max(reductions) - min(reductions):.1f} %")
    return 0


if __name__ == "__main__":
    sys.exit(main())
