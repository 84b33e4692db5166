#!/usr/bin/python3
"""Draws histories of shearbus-hydro (or results of shearbus-replay): temperature, shear stress and sliding velocity of the
interface against time, and a map of regimes where there are many columns. Several files stand side by side.

    plot_histories.py subgrid/history.h5 coulomb_tresca/history.h5 --out pictures
"""
import argparse
import pathlib
import sys
import tomllib

import h5py
import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

MOST_ROWS = 1500      # rows of a history that are drawn: more would be finer than a picture's pixels
MOST_LINES = 8        # lines in one panel; with more columns, some lines and the band of all columns
MOST_PANELS = 6       # panels side by side
REGIMES = [("open", "#d9d9d9"), ("stick", "#4477aa"), ("Coulomb", "#ccbb44"), ("Tresca", "#ee6677"), ("melting", "#7a0019")]
QUANTITIES = [
    ("interface_temperature", "interface temperature (K)", 1.0),
    ("shear_stress", "shear stress (MPa)", 1e-6),
    ("sliding_velocity", "sliding velocity (m/s)", 1.0),
]


class History:
    """One file, thinned to the rows that a picture can show."""

    def __init__(self, path):
        self.path = path
        with h5py.File(path, "r") as file:
            missing = [name for name, _, _ in QUANTITIES if name not in file]
            if missing or "time" not in file:
                raise ValueError(f"expected the datasets time, {', '.join(n for n, _, _ in QUANTITIES)}; "
                                 f"missing {', '.join(missing) or 'time'}: not a result of shearbus-hydro or shearbus-replay")
            steps = file["time"].shape[0]
            self.rows = np.unique(np.linspace(0, steps - 1, min(steps, MOST_ROWS)).round().astype(int))
            self.time = file["time"][:][self.rows] * 1e6
            self.values = {name: self.read(file[name]) * scale for name, _, scale in QUANTITIES}
            self.regime = self.read(file["regime"]) if "regime" in file else None
            self.pressure = self.read(file["pressure"]) if "pressure" in file else None
            self.jump = file["velocity_jump"][0, :] if "velocity_jump" in file else np.abs(self.values["sliding_velocity"][0])
            meta = file["meta"] if "meta" in file else None
            self.scene = self.scene_of(meta)
            law = meta.attrs.get("interface_law", "") if meta is not None else ""
        self.law = {"subgrid": "subgrid model", "coulomb_tresca": "Coulomb–Tresca (DLP 5)"}.get(law, law or path.stem)

    def read(self, dataset):
        step = max(1, dataset.chunks[0] if dataset.chunks else dataset.shape[0])
        parts = []
        # reads chunk by chunk, because the whole need not fit into memory
        for start in range(0, dataset.shape[0], step):
            wanted = self.rows[(self.rows >= start) & (self.rows < start + step)]
            if wanted.size:
                parts.append(dataset[start:start + step][wanted - start])
        return np.concatenate(parts)

    @staticmethod
    def scene_of(meta):
        if meta is None:
            return {}
        text = meta["scene"][()] if "scene" in meta else meta.attrs.get("scene", "")
        try:
            return tomllib.loads(text.decode() if isinstance(text, bytes) else str(text))
        except tomllib.TOMLDecodeError:
            return {}

    @property
    def melting_temperature(self):
        return self.scene.get("soft", {}).get("melting_temperature_k")

    @property
    def pressure_varies(self):
        return self.pressure is not None and bool(np.any(self.pressure != self.pressure[0]))

    def groups(self):
        """Returns (title, columns) for each initial pressure, with columns sorted by their initial jump."""
        if self.pressure is None or self.pressure_varies:
            return [("", np.argsort(self.jump, kind="stable"))]
        result = []
        for value in sorted(set(self.pressure[0]), reverse=True):
            columns = np.flatnonzero(self.pressure[0] == value)
            result.append((f"P = {value * 1e-9:g} GPa", columns[np.argsort(self.jump[columns], kind="stable")]))
        return result


def panels_of(histories):
    """Returns (history, title, columns) for each panel column: sorted by pressure, then by file."""
    groups = [history.groups() for history in histories]
    most = max(1, MOST_PANELS // len(histories))
    chosen = []
    for own in groups:
        kept = np.unique(np.linspace(0, len(own) - 1, min(most, len(own))).round().astype(int))
        chosen.append([own[i] for i in kept])
    panels = []
    for rank in range(max(len(own) for own in chosen)):
        for history, own in zip(histories, chosen):
            if rank < len(own):
                title, columns = own[rank]
                panels.append((history, "\n".join(t for t in (history.law, title) if t), columns))
    return panels, sum(map(len, groups)) - len(panels)


def legend_beside(axis, handles, title):
    legend = axis.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.02, 1.03), title=title, frameon=False, borderaxespad=0.0)
    legend._legend_box.align = "left"


def draw_histories(histories, title, target):
    panels, left_out = panels_of(histories)
    quantities = list(QUANTITIES)
    if any(h.pressure_varies for h in histories):
        quantities.append(("pressure", "pressure (GPa)", 1e-9))
    figure, axes = plt.subplots(len(quantities), len(panels), sharex=True, sharey="row", squeeze=False,
                                figsize=(1.2 + max(3.3 * len(panels), 5.4), 2.35 * len(quantities) + 1.1), layout="constrained")
    jumps = np.concatenate([h.jump[c] for h, _, c in panels])
    span = (jumps.min(), jumps.max())
    colour = lambda v: plt.cm.viridis(0.92 * ((v - span[0]) / (span[1] - span[0]) if span[1] > span[0] else 0.35))
    drawn = set()
    banded = False
    for p, (history, name, columns) in enumerate(panels):
        chosen = columns
        if columns.size > MOST_LINES:
            chosen = columns[np.unique(np.linspace(0, columns.size - 1, 6).round().astype(int))]
        for q, (key, label, scale) in enumerate(quantities):
            axis = axes[q, p]
            values = history.pressure * scale if key == "pressure" else history.values[key]
            if key == "pressure":
                axis.plot(history.time, values[:, columns[0]], color="0.25", lw=1.2)
                axis.axhline(0.0, color="0.6", lw=0.7)
            else:
                if columns.size > chosen.size:
                    banded = True
                    axis.fill_between(history.time, values[:, columns].min(axis=1), values[:, columns].max(axis=1), color="0.93", lw=0)
                for c in chosen:
                    axis.plot(history.time, values[:, c], color=colour(history.jump[c]), lw=1.3)
                    drawn.add(round(float(history.jump[c]), 1))
            if key == "interface_temperature" and history.melting_temperature:
                axis.axhline(history.melting_temperature, color="#7a0019", lw=0.9, ls="--")
            if p == 0:
                axis.set_ylabel(label)
            axis.grid(color="0.92", lw=0.6)
            axis.set_axisbelow(True)
            axis.set_xlim(0.0, history.time[-1])
        axes[0, p].set_title(name)
        axes[-1, p].set_xlabel("time (µs)")
    handles = [Line2D([], [], color=colour(v), lw=1.6, label=f"{v:g} m/s") for v in sorted(drawn)]
    if banded:
        handles.append(Patch(color="0.93", label="range of all columns"))
    if any(h.melting_temperature for h in histories):
        handles.append(Line2D([], [], color="#7a0019", lw=0.9, ls="--", label="melting"))
    legend_beside(axes[0, -1], handles, "initial jump")
    figure.suptitle(title)
    figure.savefig(target, dpi=150)
    plt.close(figure)
    return left_out


def draw_regimes(histories, title, target):
    panels, _ = panels_of(histories)
    figure, axes = plt.subplots(1, len(panels), sharey=True, squeeze=False, figsize=(1.6 + 3.4 * len(panels), 4.4), layout="constrained")
    colours = ListedColormap([c for _, c in REGIMES])
    norm = BoundaryNorm(np.arange(len(REGIMES) + 1) - 0.5, len(REGIMES))
    for axis, (history, name, columns) in zip(axes[0], panels):
        jumps = history.jump[columns]
        regular = columns.size > 1 and np.all(np.diff(jumps) > 0)
        rows = jumps if regular else np.arange(columns.size)
        axis.pcolormesh(history.time, rows, history.regime[:, columns].T, cmap=colours, norm=norm, shading="nearest", rasterized=True)
        axis.set_xlim(0.0, history.time[-1])
        axis.set_title(name)
        axis.set_xlabel("time (µs)")
        axis.set_ylabel("initial jump (m/s)" if regular else "column, by initial jump")
        axis.label_outer()
    seen = np.unique(np.concatenate([h.regime[:, c].ravel() for h, _, c in panels]))
    legend_beside(axes[0, -1], [Patch(color=REGIMES[r][1], label=REGIMES[r][0]) for r in seen], "regime")
    figure.suptitle(title)
    figure.savefig(target, dpi=150)
    plt.close(figure)


def main():
    parser = argparse.ArgumentParser(description="Draws histories of shearbus-hydro, several side by side.")
    parser.add_argument("histories", nargs="+", type=pathlib.Path, help="HDF5 files, or directories with a history.h5")
    parser.add_argument("--out", type=pathlib.Path, default=pathlib.Path("."), help="directory for the pictures")
    options = parser.parse_args()
    plt.rcParams.update({"font.size": 9.5, "axes.titlesize": 10, "figure.titlesize": 12, "axes.spines.top": False,
                         "axes.spines.right": False, "legend.fontsize": 9})
    histories = []
    for path in options.histories:
        try:
            histories.append(History(path / "history.h5" if path.is_dir() else path))
        except (OSError, ValueError, KeyError) as error:
            print(f"plot_histories: {path}: {error}", file=sys.stderr)
            return 1
    options.out.mkdir(parents=True, exist_ok=True)
    title = " / ".join(dict.fromkeys(h.scene.get("name", h.path.stem) for h in histories))
    left_out = draw_histories(histories, title, options.out / "histories.png")
    print(f"  pictures                {options.out / 'histories.png'}" + (f" ({left_out} panels left out)" if left_out else ""))
    if all(h.regime is not None for h in histories) and any(h.regime.shape[1] > MOST_LINES for h in histories):
        draw_regimes(histories, title, options.out / "regimes.png")
        print(f"                          {options.out / 'regimes.png'}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
