#!/usr/bin/env python3
"""Pictures of one or more runs of cone_target: the cone's free-surface velocity, and, with the runs side by side, shape and temperature at
the end with the temperature of the flank on its own scale, and space-time maps along the interface (friction regime, interface temperature,
sliding velocity, shear stress: DLP Figs 16-22; pressure) up to the last contact. Runs with free slip or stick appear only in the first picture, unless there are no other runs.

    plot_cone.py RUN [RUN ...] --out DIRECTORY       RUN: a directory that shearbus-hydro wrote
"""
import argparse
import json
import pathlib
import sys

import h5py
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt  # noqa: E402
import numpy as np  # noqa: E402
from matplotlib.collections import PolyCollection  # noqa: E402
from matplotlib.colors import BoundaryNorm, ListedColormap  # noqa: E402

LAWS = {"subgrid": "subgrid service", "coulomb_tresca": "law (5)", "free_slip": "free slip", "stick": "stick"}
REGIMES = ["open", "stick", "Coulomb", "Tresca", "Tresca, melting"]
REGIME_COLOURS = ["#f2f2f2", "#3b6fb6", "#8cc084", "#e0a030", "#b5302a"]


class Run:
    def __init__(self, directory):
        self.directory = pathlib.Path(directory)
        with h5py.File(self.directory / "interface.h5") as f:
            law = f["meta"].attrs["interface_law"]
            self.law = law.decode() if isinstance(law, bytes) else str(law)
            self.time = f["time"][:] * 1e6
            self.height = f["height"][:] * 1e3
            self.flank = np.column_stack((f["radius"][-1] * 1e3, self.height[-1]))
            self.maps = {name: f[name][:] for name in ("regime", "interface_temperature", "sliding_velocity", "shear_stress", "pressure")}
        closed = np.flatnonzero((self.maps["regime"] > 0).any(axis=1))
        self.last_contact = self.time[closed[-1]] if closed.size else self.time[-1]
        self.summary = json.loads((self.directory / "summary.json").read_text())
        with h5py.File(self.directory / "free_surface.h5") as f:
            self.surface_time = f["time"][:] * 1e6
            self.surface_velocity = f["axial_velocity"][:]
        fields = self.directory / "fields"
        with h5py.File(fields / "mesh.h5") as f:
            self.quads = f["quads"][:]
        with h5py.File(max(fields.glob("[0-9]*.h5"))) as last:
            self.end = last["time"][0] * 1e6
            self.place = last["place"][:, :2] * 1e3
            self.temperature = last["temperature"][:]

    @property
    def label(self):
        return LAWS.get(self.law, self.law)


def shapes(runs, out):
    figure, (above, below) = plt.subplots(2, len(runs), figsize=(4.8 * len(runs), 8.6), squeeze=False, sharey="row", layout="constrained",
                                          height_ratios=(3, 1.2))
    top = max(np.percentile(run.temperature, 99.7) for run in runs)
    hottest = max(400.0, max(run.maps["interface_temperature"].max() for run in runs))
    for shape, flank, run in zip(above, below, runs):
        zones = PolyCollection(run.place[run.quads], array=run.temperature, cmap="inferno", edgecolor="face", linewidth=0.1)
        zones.set_clim(300.0, top)
        shape.add_collection(zones)
        nodes = shape.scatter(*run.flank.T, c=run.maps["interface_temperature"].max(axis=0), cmap="cool", vmin=300.0, vmax=hottest, s=14, zorder=3)
        shape.autoscale()
        shape.set_aspect("equal")
        shape.set_title(f"{run.label}, {run.end:.1f} µs")
        shape.set_xlabel("r (mm)")
        flank.plot(run.height[0], run.maps["interface_temperature"].max(axis=0), label="highest")
        flank.plot(run.height[0], run.maps["interface_temperature"][-1], "--", label=f"at {run.time[-1]:.1f} µs")
        flank.set_title("zones at the flank" if run.law == "coulomb_tresca" else "interface")
        flank.set_xlabel("z of the interface node at the start (mm)")
        flank.grid(alpha=0.3)
    above[0].set_ylabel("z (mm)")
    below[0].set_ylabel("temperature of the flank (K)")
    below[0].set_ylim(280.0, 1.05 * hottest)
    below[0].legend(fontsize=8)
    figure.colorbar(zones, ax=above.tolist(), label="temperature of the zones (K)", shrink=0.8, extend="max")
    figure.colorbar(nodes, ax=above.tolist(), label="dots: highest temperature of the flank (K)", shrink=0.8)
    figure.savefig(out / "cone_temperature.png", dpi=130)


def space_time(runs, out, name, label, scale=1.0, limits=None, cmap="viridis"):
    figure, axes = plt.subplots(1, len(runs), figsize=(5.2 * len(runs), 4.6), squeeze=False, sharey=True, layout="constrained")
    for axis, run in zip(axes[0], runs):
        nodes = run.height[0]  # the height moves with the metal: each node keeps its line
        values = run.maps[name] * scale
        if name == "regime":
            image = axis.pcolormesh(run.time, nodes, values.T, cmap=ListedColormap(REGIME_COLOURS),
                                    norm=BoundaryNorm(np.arange(-0.5, 5), 5), shading="nearest", rasterized=True)
        else:
            values = np.ma.masked_where(run.maps["regime"] == 0, values)
            image = axis.pcolormesh(run.time, nodes, values.T, cmap=cmap, vmin=limits[0], vmax=limits[1], shading="nearest", rasterized=True)
            axis.set_facecolor("#f2f2f2")  # background of open nodes
        by_slip = run.summary["slip_share_coulomb"]
        axis.set_title(f"{run.label}: Coulomb {100 * by_slip:.0f} % of slip" if name == "regime" else run.label)
        axis.set_xlim(0.0, 1.05 * max(other.last_contact for other in runs))
        axis.set_xlabel("time (µs)")
    axes[0][0].set_ylabel("z of the interface node at the start (mm)")
    bar = figure.colorbar(image, ax=axes[0].tolist(), label=label)
    if name == "regime":
        bar.set_ticks(range(5), labels=REGIMES)
    figure.savefig(out / f"cone_{name}.png", dpi=130)


def span(runs, name, scale, percentile=99.5):
    closed = np.concatenate([(run.maps[name] * scale)[run.maps["regime"] > 0] for run in runs])
    return (0.0, 1.0) if closed.size == 0 else (min(0.0, np.percentile(closed, 0.5)), np.percentile(closed, percentile))


def signed(runs, name, scale=1.0):
    """Limits and colours of a quantity with two signs: zero is white."""
    largest = max(map(abs, span(runs, name, scale)))
    return {"limits": (-largest, largest), "cmap": "RdBu_r"}


def free_surface(runs, out):
    figure, axis = plt.subplots(figsize=(7.5, 4.6), layout="constrained")
    for run in runs:
        line, = axis.plot(run.surface_time, run.surface_velocity[:, 0], label=f"{run.label}, on the axis")
        middle = run.surface_velocity.shape[1] // 2
        axis.plot(run.surface_time, run.surface_velocity[:, middle], "--", color=line.get_color(), linewidth=0.9, label=f"{run.label}, half radius")
    axis.set_xlabel("time (µs)")
    axis.set_ylabel("velocity of the cone's free surface (m/s)")
    axis.legend(fontsize=8)
    axis.grid(alpha=0.3)
    figure.savefig(out / "cone_free_surface.png", dpi=130)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("runs", nargs="+", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    runs = [Run(directory) for directory in options.runs]
    free_surface(runs, options.out)
    runs = [run for run in runs if run.law not in ("free_slip", "stick")] or runs
    shapes(runs, options.out)
    space_time(runs, options.out, "regime", "friction regime")
    space_time(runs, options.out, "interface_temperature", "interface temperature (K)",
               limits=(300.0, max(350.0, span(runs, "interface_temperature", 1.0)[1])), cmap="inferno")
    space_time(runs, options.out, "sliding_velocity", "sliding velocity (m/s)", **signed(runs, "sliding_velocity"))
    space_time(runs, options.out, "shear_stress", "shear stress (MPa)", 1e-6, **signed(runs, "shear_stress", 1e-6))
    space_time(runs, options.out, "pressure", "pressure (GPa)", 1e-9, limits=span(runs, "pressure", 1e-9))
    for picture in sorted(options.out.glob("cone_*.png")):
        print(f"  picture                 {picture}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
