#!/usr/bin/python3
"""Figures 12 to 22 of the paper by one command: runs the scenes, draws a PNG for each figure and writes what agrees with the paper, and
what does not, in numbers.

    paper_figures.py -o DIR [--bin build/bin] [--only 12,16] [--coarse]

F. Dambakizi, P. Le Tallec, J.-P. Perlat, "Multiscale thermomechanical modeling of shock-driven dry friction in hydrodynamics". DIR gets
figure_NN.png, the runs (runs/NAME, kept, and used again by the next call with the same options and programs) and figures.json: a list of
{"figure", "title", "file", "scene", "agrees", "differs", "note"}: "agrees" and "differs" are lists of sentences computed from the runs, "note" is of
--coarse: wide zones and few steps, for a look in a minute. The paper gives no curve of Figs 12 to 22 in numbers: compared are its statements, and, for Figs 13 and
14, the independent solution of tests/measured.toml."""
import hashlib
import json
import pathlib
import re
import subprocess
import sys

import h5py
import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROBLEMS, EXAMPLES = ROOT / "hydro_stub/problems", ROOT / "client/examples"

sys.path.insert(0, str(ROOT / "client/report"))
import style  # noqa: E402
from matplotlib.collections import PolyCollection  # noqa: E402
from runs import meta_of, provenance_of, scene_of  # noqa: E402
from terminal import Parser  # noqa: E402

plt, INK, FAINT = style.plt, style.INK, style.FAINT
REGIMES = tuple(style.REGIMES.values())
LAWS = {law: style.LAWS[law] for law in ("subgrid", "coulomb_tresca")}
SIGNED, SIZE, TEMPERATURE = (style.COLOUR_MAPS[kind] for kind in ("signed", "size", "temperature"))


def figure(rows, columns, size, **options):
    return style.figure(rows, columns, size, squeeze=False, **options)


# -- runs --


class Programs:
    """Runs the programs of `bin`; a run is kept below DIR/runs and made again only where its inputs or a program changed."""

    def __init__(self, directory, out, coarse):
        self.directory, self.out, self.coarse = directory, out, coarse
        self.done, self.made = {}, []  # runs by name; provenance of those that a figure used

    def command(self, name):
        path = self.directory / name
        if not path.exists():
            sys.exit(f"{path} is missing: build the programs, or name their directory with --bin")
        return path

    def run(self, name, inputs, *commands):
        """Makes DIR/runs/NAME by commands (lists of words, of which {} is that directory) unless it is there, from equal inputs."""
        if name in self.done:
            return self.done[name]
        target = self.out / "runs" / name
        programs = {words[0]: (pathlib.Path(words[0]).stat().st_size, pathlib.Path(words[0]).stat().st_mtime_ns) for words in commands}
        stamp = hashlib.sha256(repr((inputs, [[str(w) for w in words] for words in commands], sorted(map(str, programs.items())))).encode()).hexdigest()
        if not (target / "stamp").exists() or (target / "stamp").read_text() != stamp:
            print(f"run {name}", flush=True)
            target.mkdir(parents=True, exist_ok=True)
            (target / "stamp").unlink(missing_ok=True)
            for words in commands:
                made = subprocess.run([str(word).replace("{}", str(target)) for word in words], capture_output=True, text=True)
                if made.returncode != 0:
                    sys.exit(f"{name}: {' '.join(map(str, words))}: {made.stderr.strip()}")
            (target / "stamp").write_text(stamp)
        self.done[name] = target
        return target

    def paper_case(self):
        """The paper's pair: 100 m/s at 11.2 GPa for 1 us in steps of 1 ns, with profiles. Returns the result of shearbus-replay."""
        scene = EXAMPLES / "paper_velocity_driven.toml"
        where = self.run("paper_velocity_driven", scene.read_text(),
                         [sys.executable, EXAMPLES / "make_history.py", "constant", "{}/history.h5"],
                         [self.command("shearbus-replay"), "{}/history.h5", "--scene", scene, "--out", "{}/result.h5", "--no-progress",
                          "--profile-nodes", "0", "--profile-times", ",".join(f"{t:g}" for t in PROFILE_TIMES)])
        file = h5py.File(where / "result.h5")
        meta, text = meta_of(file)
        self.made.append(provenance_of(meta, scene_of(text)["name"]))
        return file

    def map(self):
        """Limits of the velocity-driven model over pressure and jump. Returns map.json."""
        scene = EXAMPLES / "validity_map.toml"
        size = ["--pressures", 6, "--velocities", 16, "--dt", 2e-9] if self.coarse else ["--pressures", 13, "--velocities", 49, "--dt", 1e-9]
        where = self.run("validity_map", scene.read_text(), [self.command("shearbus-study"), "map", scene, "--out", "{}",
                                                             "--times", 1e-7, 1e-6, *size])
        found = json.loads((where / "map.json").read_text())
        self.made.append(found["provenance"])
        return found

    def cone(self, scene, law, wider=1):
        """Returns a run of a scene of cone_target, on zones so many times as wide as the scene's."""
        text = (PROBLEMS / f"{scene}.toml").read_text()
        widths = re.findall(r"(?m)^zone_width_m = (\S+)", text)
        if len(widths) != 1:
            sys.exit(f"{scene}: expected one line zone_width_m = ..., found {len(widths)}")
        width = wider * (0.5e-3 if self.coarse else float(widths[0]))
        scale = width / float(widths[0])
        text = re.sub(r"(?m)^(zone_width_m|first_zone_m) = (\S+)", lambda key: f"{key[1]} = {scale * float(key[2]):.9g}", text)
        name = f"{scene}-{law}" + (f"-x{wider}" if wider != 1 else "")
        file = self.out / "runs" / (f"{scene}.toml" if wider == 1 else f"{scene}-x{wider}.toml")
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        made = Cone(self.run(name, text, [self.command("shearbus-hydro"), file, "--interface-law", law, "--out", "{}", "--no-plot", "--no-progress"]), law)
        self.made.append(made.summary["provenance"])
        return made

    def on_two(self, scene, law, value, form="{:.0f}"):
        """Returns the text of a number of a run on the scene's zones, with that on zones twice as wide."""
        fine, coarse = (form.format(value(self.cone(scene, law, wider))) for wider in (1, 2))
        return f"{fine} ({coarse} on zones twice as wide)"


class Cone:
    """A run of cone_target. Maps have the shape [time, node]; the place of a node is its height at the start."""

    def __init__(self, directory, law):
        self.directory, self.law, self.label, self.colour = directory, law, *LAWS[law]
        self.summary = json.loads((directory / "summary.json").read_text())
        with h5py.File(directory / "interface.h5") as file:
            self.time, self.place = file["time"][:] * 1e6, file["height"][0] * 1e3
            self.regime, self.T0 = file["regime"][:], file["interface_temperature"][:]
            self.slip, self.stress, self.pressure = file["sliding_velocity"][:], file["shear_stress"][:] * 1e-6, file["pressure"][:]
            self.flank = np.column_stack((file["radius"][-1], file["height"][-1])) * 1e3
        rows = np.diff(self.time, append=self.time[-1])[:, None] * 1e-6
        self.distance = np.where(self.regime > 0, np.abs(self.slip), 0.0) * rows  # slip of each row and node (m)
        closed = np.flatnonzero((self.regime > 0).any(axis=1))
        self.last_contact = self.time[closed[-1]] if closed.size else self.time[-1]

    def slip_share(self, regime):
        """Share of the slip of the whole interface that happened in a regime."""
        slip = self.distance * self.summary["interface"]["length_m"]
        return slip[self.regime == regime].sum() / slip.sum() if slip.sum() > 0 else 0.0

    def share(self, regime):
        """Share of the rows of closed nodes in a regime."""
        return (self.regime == regime).sum() / max(1, (self.regime > 0).sum())

    def closed(self, values):
        return np.ma.masked_where(self.regime == 0, values)

    def end(self):
        """Returns time (us), corners of the zones (mm) and their temperature of the last frame."""
        with h5py.File(self.directory / "fields/mesh.h5") as mesh, h5py.File(max((self.directory / "fields").glob("[0-9]*.h5"))) as last:
            return last["time"][0] * 1e6, last["place"][:, :2][mesh["quads"][:]] * 1e3, last["temperature"][:]


class Order:
    """Which law rubs and moves more in a scene, on its own zones and on zones twice as wide: means over the interface of the displacement of
    metal against metal over +-1 mm, of the friction impulse and of the slip, as pairs (law (5), subgrid model)."""

    def __init__(self, programs, scene):
        self.meshes = []
        for wider in (1, 2):
            law5, subgrid = (programs.cone(scene, law, wider).summary for law in ("coulomb_tresca", "subgrid"))
            self.meshes.append({"displacement": [next(band["mean_m"] for band in of["displacement"] if band["band_m"] == 1e-3) for of in (law5, subgrid)],
                                "impulse": [of["mean_friction_impulse_pa_s"] for of in (law5, subgrid)],
                                "slip": [of["mean_slip_m"] for of in (law5, subgrid)]})

    def change(self, answer):
        """The subgrid model against law (5), on both meshes, in per cent."""
        return [100.0 * (mesh[answer][1] / mesh[answer][0] - 1.0) for mesh in self.meshes]

    def times(self):
        return [mesh["impulse"][1] / mesh["impulse"][0] for mesh in self.meshes]

    def moves_less(self):
        return all(change < 0.0 for change in self.change("displacement"))

    def rubs_more(self):
        return all(times > 1.0 for times in self.times())

    def sentence(self):
        moved, rubbed, slid = self.change("displacement"), self.times(), self.change("slip")
        of = [mesh["displacement"] for mesh in self.meshes]
        return (f"metal against metal over +-1 mm {1e3 * of[0][0]:.3f} mm with law (5), {1e3 * of[0][1]:.3f} mm with the subgrid model ({moved[0]:+.0f} %, on zones twice as "
                f"wide {moved[1]:+.0f} %); friction impulse x {rubbed[0]:.2f} (x {rubbed[1]:.2f}); slip {slid[0]:+.0f} % ({slid[1]:+.0f} %)")


def highest_pressure(run):
    return run.pressure.max() * 1e-9


def fastest_slip(run):
    return np.abs(run.closed(run.slip)).max()


# -- figures: each returns the figure, the scene and the sentences (agrees, differs) --

PROFILE_TIMES = (2e-8, 1e-7, 2.8e-7, 6e-7, 1e-6)
# The paper's case, steps of 1 ns: an independent solution of the same discrete equations (tests/measured.toml, "Exact solutions").
EXACT = {"T0_K": 1218.945925353, "stress_Pa": 142.6492093e6, "steps": 1000}
NO_CURVE = "The paper's curve is not published in numbers: its shape alone can be compared."


def said(holds, sentence, agrees, differs):
    """Adds a sentence to those that agree where a claim of the paper holds in this run, else to those that differ."""
    (agrees if holds else differs).append(sentence)


def figure_12(programs):
    agrees, differs = [], [NO_CURVE]
    with programs.paper_case() as file:
        group = file["profiles"]
        time, z = group["time"][:], group["position"][:] * 1e6
        Y, T, ep, s = (group[name][:, 0] for name in ("layer_flow_stress", "layer_temperature", "layer_plastic_strain", "layer_shear_stress"))
    made, axes = figure(2, 2, (9.5, 7.0), sharex=True)
    colours = plt.cm.viridis(np.linspace(0.9, 0.0, len(time)))
    for axis, values, label in zip(axes.flat, (Y * 1e-6, np.sqrt(3) * s * 1e-6, T, ep), (
            "flow stress Y (MPa)", r"load $\sqrt{3}\,s$ (MPa)", "temperature T (K)", "plastic strain (1)")):
        for row, t, colour in zip(values, time, colours):
            axis.plot(z, row, color=colour, lw=1.6, label=f"{t * 1e6:g} µs")
        axis.set_ylabel(label)
        axis.set_ylim(bottom=0)
        axis.grid()
    axes[1, 1].set_yscale("log")
    axes[1, 1].set_ylim(np.nanmin(ep[ep > 0]) if (ep > 0).any() else 1e-3, None)
    for axis in axes[1]:
        axis.set_xlabel("distance from the interface z (µm)")
        axis.set_xlim(0, z[-1])
    near = axes[0, 0].inset_axes([0.42, 0.12, 0.54, 0.5])
    for row, colour in zip(Y, colours):
        near.plot(z, row * 1e-6, color=colour, lw=1.3, marker=".", ms=3)
    near.set(xlim=(0, 0.5), ylim=(0, None))
    near.set_title("next to the interface", fontsize=8)
    near.set_xlabel("z (µm)", fontsize=7, labelpad=1)
    near.set_ylabel("Y (MPa)", fontsize=7, labelpad=1)
    near.tick_params(labelsize=7)
    axes[0, 1].legend(title="time", loc="lower left")
    made.suptitle("Fig. 12: profiles across the layer, 100 m/s at 11.2 GPa")
    last, far = Y[-1], Y[-1].max()
    reached = np.interp(1.0, z, last) / far  # at the paper's scale; half of it is reached within the first cell
    said(last[0] < 0.9 * far, f"The layer softens towards the interface: at {time[-1] * 1e6:g} µs Y is {last[0] * 1e-6:.0f} MPa at z = 0 and "
         f"at most {far * 1e-6:.0f} MPa (at z = {z[last.argmax()]:.1f} µm); {100 * reached:.0f} % of that is reached at 1 µm.", agrees, differs)
    excess = np.nanmax(np.sqrt(3) * s / Y - 1.0)
    said(excess < 1e-6, f"No vertex is loaded beyond its flow stress: sqrt(3) s exceeds Y by at most {max(excess, 0.0):.1e} of Y, at any time and z.",
         agrees, differs)
    early = Y[0].max() - Y[0].min()
    said(early < 0.2 * Y[0].max(), f"At {time[0] * 1e6:g} µs the profile is nearly level ({Y[0].min() * 1e-6:.0f} to {Y[0].max() * 1e-6:.0f} MPa).", agrees, differs)
    return made, "paper_velocity_driven", agrees, differs


def paper_history(programs):
    with programs.paper_case() as file:
        return file["time"][:] * 1e6, file["interface_temperature"][:, 0], file["shear_stress"][:, 0]


def history(programs, number, name, values, unit, horizontal=()):
    made, axes = figure(1, 1, (6.4, 4.2))
    axis = axes[0, 0]
    axis.plot(paper_history(programs)[0], values, color=INK, lw=1.8)
    for level, label in horizontal:
        axis.axhline(level, color=FAINT, lw=0.9, ls="--")
        axis.annotate(label, (0.02, level), xycoords=("axes fraction", "data"), va="bottom", color=FAINT, fontsize=9)
    axis.set(xlabel="time (µs)", ylabel=f"{name} ({unit})", xlim=(0, None), title=f"Fig. {number}: {name}, 100 m/s at 11.2 GPa")
    axis.grid()
    return made


def figure_13(programs):
    agrees, differs = [], [NO_CURVE]
    time, T0, _ = paper_history(programs)
    made = history(programs, 13, "interface temperature", T0, "K", ((1220.0, "melting, 1220 K"),))
    said(T0.max() < 1220.0, f"The interface approaches melting and never reaches it: {T0.max():.3f} K of 1220 K.", agrees, differs)
    near = next((t for t, T in zip(time, T0) if T >= 0.99 * 1220.0), time[-1])
    said(near < time[-1], f"It passes 0.99 T_melt at {near:.3f} µs.", agrees, differs)
    apart = abs(T0[EXACT["steps"] - 1] / EXACT["T0_K"] - 1)
    said(apart < 1e-6, f"At 1 µs T0 is {T0[EXACT['steps'] - 1]:.3f} K, {apart:.1e} from an independent solution of the same equations.", agrees, differs)
    return made, "paper_velocity_driven", agrees, differs


def figure_14(programs):
    agrees, differs = [], [NO_CURVE]
    time, _, s = paper_history(programs)
    made = history(programs, 14, "shear stress", s * 1e-6, "MPa")
    peak = s.argmax()
    said(0 < peak < len(s) - 1, f"Rise, peak and thermal fall: the stress peaks at {s[peak] * 1e-6:.1f} MPa after {time[peak]:.2f} µs and has fallen to "
         f"{s[-1] * 1e-6:.1f} MPa at {time[-1]:.0f} µs.", agrees, differs)
    apart = abs(s[EXACT["steps"] - 1] / EXACT["stress_Pa"] - 1)
    said(apart < 1e-6, f"At 1 µs it is {s[EXACT['steps'] - 1] * 1e-6:.3f} MPa, {apart:.1e} from an independent solution of the same equations.", agrees, differs)
    return made, "paper_velocity_driven", agrees, differs


def figure_15(programs):
    agrees, differs = [], []
    found = programs.map()
    made, axes = figure(1, 1, (6.8, 4.8))
    axis = axes[0, 0]
    pressure = np.array(found["pressure_pa"]) * 1e-9
    styles = ("--", "-")
    for seen, line in zip(found["observations"], styles):
        for key, colour, label in (("sticking_below_m_per_s", REGIMES[1][1], "sticks below"), ("domain_limit_m_per_s", INK, "carries 90 % of the slip above"),
                                   ("melting_above_m_per_s", style.MELTING, "melts above")):
            values = np.array([np.nan if v is None else v for v in seen[key]])
            if np.isnan(values).all():
                continue  # the sweep has no such jump
            axis.loglog(pressure, values, line, color=colour, lw=1.6, label=f"{label}, {seen['time_s'] * 1e6:g} µs")
    axis.set(xlabel="pressure (GPa)", ylabel="imposed velocity jump (m/s)", title="Fig. 15: domain of the velocity-driven model")
    axis.grid(which="major")
    axis.legend(loc="center left", bbox_to_anchor=(1.0, 0.5))
    limits = [np.array([np.nan if v is None else v for v in seen["domain_limit_m_per_s"]]) for seen in found["observations"]]
    rising = all(np.nanmin(np.diff(limit)) > 0 for limit in limits)
    said(rising, f"The jump that the layer must be given to carry it rises with the pressure: {np.nanmin(limits[-1]):.3g} m/s at {pressure[0]:g} GPa, "
         f"{np.nanmax(limits[-1]):.3g} m/s at {pressure[-1]:g} GPa (after {found['observations'][-1]['time_s'] * 1e6:g} µs).", agrees, differs)
    ratio = np.nanmedian(limits[0] / limits[-1])
    differs.append(f"The paper's line has no time; ours moves: it is {ratio:.1f} times as high after {found['observations'][0]['time_s'] * 1e6:g} µs as after "
                   f"{found['observations'][-1]['time_s'] * 1e6:g} µs. So which line the paper's is cannot be said.")
    return made, "validity_map", agrees, differs


def shape(programs, number, law):
    """Figs 16 and 17: zones at the end, with the temperature of the interface as dots on the flank, and along the flank on its own scale."""
    agrees, differs = [], []
    law5, subgrid = programs.cone("cone_al_steel", "coulomb_tresca"), programs.cone("cone_al_steel", "subgrid")
    run, other = (law5, subgrid) if law == "coulomb_tresca" else (subgrid, law5)
    made, axes = figure(1, 2, (9.0, 4.8), legend=True, width_ratios=(0.8, 1))
    time, corners, temperature = run.end()
    top = np.percentile(np.concatenate([temperature, other.end()[2]]), 99.7)
    zones = PolyCollection(corners, array=temperature, cmap=TEMPERATURE, edgecolor="face", linewidth=0.1, clim=(300.0, top), rasterized=True)
    axes[0, 0].add_collection(zones)
    axes[0, 0].autoscale_view()
    axes[0, 0].set_aspect("equal", anchor="W")
    axes[0, 0].set(xlabel="r (mm)", ylabel="z (mm)", title=f"{run.label}, {time:.1f} µs")
    made.colorbar(zones, ax=axes[0, 0], label=f"temperature of the zones (K), up to {temperature.max():.0f}", extend="max", shrink=0.85)
    hottest = max(law5.T0.max(), subgrid.T0.max())
    drawn = []
    for one in (law5, subgrid):
        label, strong = "law (5), zones" if one is law5 else "subgrid server, T0", one is run
        drawn += axes[0, 1].plot(one.place, one.T0.max(axis=0), color=one.colour, lw=2.0 if strong else 1.0, label=f"{label}: highest")
        drawn += axes[0, 1].plot(one.place, one.T0[-1], "--", color=one.colour, lw=1.3 if strong else 0.8, label=f"{label}: at {one.time[-1]:.1f} µs")
    axes[0, 1].set(xlabel="interface node: its z at the start (mm)", ylabel="temperature of the flank (K)", ylim=(280.0, 1.05 * hottest),
                   title="the flank, on a scale of its own")
    axes[0, 1].grid()
    style.legend_below(made, drawn)
    made.suptitle(f"Fig. {number}: shape and temperature with {'law (5)' if law == 'coulomb_tresca' else 'the subgrid model'}")
    zones_reach, layer_reaches = (programs.on_two("cone_al_steel", one.law, lambda run: run.T0.max(), "{:.0f} K") for one in (law5, subgrid))
    if law == "coulomb_tresca":
        said(law5.T0.max() < 0.5 * (300.0 + subgrid.T0.max()), f"Law (5) shows no heating of the interface, which in the subgrid model reaches {layer_reaches}.", agrees, differs)
        differs.append(f"Law (5) heats zones, which conduct nothing: the thinner, the more, here to {zones_reach}.")
    else:
        said(subgrid.T0.max() > 1.5 * law5.T0.max(), f"The subgrid model heats the interface strongly, to {layer_reaches} at the end of the cone.", agrees, differs)
        said(temperature.max() > 0.9 * subgrid.T0.max(), "The heated layer is micrometres thick and no zone shows it, so that the flank needs a scale of its own.", agrees, differs)
    order = Order(programs, "cone_al_steel")
    said(order.rubs_more() and order.moves_less(), f"More friction and less sliding with the subgrid model: {order.sentence()}.", agrees, differs)
    differs.append(f"Geometry and flyer are ours: the flank sees {programs.on_two('cone_al_steel', 'coulomb_tresca', highest_pressure, '{:.1f} GPa')} and {programs.on_two('cone_al_steel', 'coulomb_tresca', fastest_slip, '{:.0f} m/s')}, the paper's up to 10 GPa and 400 m/s.")
    return made, "cone_al_steel", agrees, differs


def figure_16(programs):
    return shape(programs, 16, "coulomb_tresca")


def figure_17(programs):
    return shape(programs, 17, "subgrid")


def space_time(axis, run, values, **colours):
    image = style.space_time(axis, run.time, run.place, values, **colours)
    axis.set(xlabel="time (µs)", xlim=(0.0, 1.05 * run.last_contact))
    return image


def branches(programs, number, law):
    """Figs 18 and 19: the branch of the friction law along the flank, and the slip that each branch carries."""
    agrees, differs = [], []
    run = programs.cone("cone_as_printed", law)
    made, axes = figure(1, 2, (9.5, 4.4), legend=True, width_ratios=(2.2, 1))
    space_time(axes[0, 0], run, run.closed(run.regime), **style.regime_colours())
    axes[0, 0].set_ylabel("interface node: its z at the start (mm)")
    style.legend_below(made, style.regime_handles(np.unique(run.regime)))
    names, shares = zip(*((name, run.slip_share(i)) for i, (name, _) in enumerate(REGIMES) if i > 1))
    axes[0, 1].barh(names, 100 * np.array(shares), color=[colour for _, colour in REGIMES[2:]])
    axes[0, 1].set(xlabel="share of the slip (%)", xlim=(0, 100))
    axes[0, 1].invert_yaxis()
    made.suptitle(f"Fig. {number}: branch of the friction law with {'law (5)' if law == 'coulomb_tresca' else 'the subgrid model'}")
    coulomb, tresca = (lambda run: 100 * run.slip_share(2)), (lambda run: 100 * (run.slip_share(3) + run.slip_share(4)))
    by_coulomb, by_tresca = (programs.on_two("cone_as_printed", law, share, "{:.0f} %") for share in (coulomb, tresca))
    if law == "coulomb_tresca":
        with_min = programs.on_two("cone_al_steel", law, lambda run: 100 * run.slip_share(2), "{:.0f} %")
        said(coulomb(run) > 50, f"Mainly Coulomb, measured by slip: {by_coulomb} of the slip of the interface.", agrees, differs)
        differs.append(f"Only with (14) as it is printed, Y = Y_max g: with min, and the load of cone_al_steel, Coulomb friction carries {with_min} of the slip.")
    else:
        inner = (run.regime >= 3).any(axis=0)
        around = (run.regime == 2).any(axis=0)
        said(tresca(run) > 50, f"Tresca friction carries {by_tresca} of the slip, Coulomb friction {by_coulomb}; {programs.on_two('cone_as_printed', law, lambda run: 100 * (run.regime >= 3).any(axis=0).mean(), '{:.0f} %')} of the nodes are at the "
             f"Tresca limit at some time.", agrees, differs)
        edges = [run.regime[:, i][run.regime[:, i] > 1] for i in np.flatnonzero(inner & around)]
        first = np.mean([steps[0] == 2 or steps[-1] == 2 for steps in edges]) if edges else 0.0
        said(first > 0.5, f"Tresca is surrounded by Coulomb: of the nodes that see both, {100 * first:.0f} % begin or end their slip under Coulomb friction.", agrees, differs)
        differs.append("The interface also sticks, more so on finer zones: the load that gives the paper's Fig. 18 is low, "
                       f"{programs.on_two('cone_as_printed', law, highest_pressure, '{:.1f} GPa')} at most.")
    return made, "cone_as_printed", agrees, differs


def figure_18(programs):
    return branches(programs, 18, "coulomb_tresca")


def figure_19(programs):
    return branches(programs, 19, "subgrid")


def figure_20(programs):
    agrees, differs = [], []
    run = programs.cone("cone_al_steel", "subgrid")
    made, axes = figure(1, 1, (7.2, 4.4), legend=True)
    style.legend_below(made, style.regime_handles([0]))
    image = space_time(axes[0, 0], run, run.closed(run.T0), cmap=TEMPERATURE, vmin=300.0, vmax=run.T0.max())
    made.colorbar(image, ax=axes[0, 0], label="interface temperature T0 (K)")
    axes[0, 0].set(ylabel="interface node: its z at the start (mm)", title="Fig. 20: interface temperature with the subgrid model")
    on_two = lambda value, form: programs.on_two("cone_al_steel", "subgrid", value, form)
    heated = (run.T0.max(axis=0) > 600.0).mean()
    said(heated > 0.5, f"{'Most' if heated > 0.5 else 'Less than half'} of the nodes pass 600 K, the hottest reaches {on_two(lambda run: run.T0.max(), '{:.0f} K')}; the paper's flank heats as a whole.", agrees, differs)
    differs.append(f"{on_two(lambda run: 100 * (run.regime == 4).any(axis=0).mean(), '{:.0f} %')} of the nodes come within 1 % of T_melt(P), which here rises with the pressure (Lindemann); the paper's is constant.")
    said(np.median(run.T0[-1]) < 0.9 * np.median(run.T0.max(axis=0)), f"After contact it cools: the median of the flank is {on_two(lambda run: np.median(run.T0[-1]), '{:.0f} K')} at {run.time[-1]:.1f} µs.", agrees, differs)
    return made, "cone_al_steel", agrees, differs


def pair(programs, number, title, label, values):
    """Figs 21 and 22: a signed quantity of both laws side by side, zero white, cut at the last contact."""
    runs = [programs.cone("cone_al_steel", law) for law in ("coulomb_tresca", "subgrid")]
    made, axes = figure(1, 2, (10.0, 4.4), legend=True, sharey=True)
    style.legend_below(made, style.regime_handles([0]))
    largest = max(np.abs(run.closed(values(run))).max() for run in runs)
    for axis, run in zip(axes[0], runs):
        image = space_time(axis, run, run.closed(values(run)), cmap=SIGNED, vmin=-largest, vmax=largest)
        axis.set_title(run.label)
        axis.set_xlim(0.0, 1.05 * max(one.last_contact for one in runs))
    axes[0, 0].set_ylabel("interface node: its z at the start (mm)")
    made.colorbar(image, ax=axes[0].tolist(), label=label)
    made.suptitle(f"Fig. {number}: {title}")
    return made, runs


# The other cones, and why one may not have the paper's order.
WEAK = "Its interface is weaker than the metal beside it and never above the Tresca limit of law (5), so that it cannot stop the slip, and heat weakens it further."
OTHER_SCENES = {"cone_al_steel_slow": "", "cone_as_printed": "", "cone_al_steel_hot": WEAK, "cone_al5083_steel": WEAK}


def figure_21(programs):
    agrees, differs = [], []
    made, (law5, subgrid) = pair(programs, 21, "sliding velocity", "sliding velocity [v] (m/s)", lambda run: run.slip)
    order = Order(programs, "cone_al_steel")
    said(order.moves_less(), f"Less sliding with the subgrid model, as displacement of the metal: {order.sentence()}.", agrees, differs)
    differs.append("How far the interface itself slips depends on the zones where it is stronger than the metal beside it, as here: the metal shears in its place.")
    for scene, why in OTHER_SCENES.items():
        other = Order(programs, scene)
        holds = other.rubs_more() and other.moves_less()
        said(holds, f"{scene}: {other.sentence()}." + ("" if holds else f" {why}"), agrees, differs)
    fastest = [programs.on_two("cone_al_steel", run.law, fastest_slip, "{:.0f} m/s") for run in (subgrid, law5)]
    said(300.0 < fastest_slip(subgrid) < 500.0, f"The fastest slip of a closed node is {fastest[0]}, with law (5) {fastest[1]}; published are up to 400 m/s.", agrees, differs)
    return made, "cone_al_steel", agrees, differs


def figure_22(programs):
    agrees, differs = [], []
    made, (law5, subgrid) = pair(programs, 22, "shear stress", "shear stress s (MPa)", lambda run: run.stress)
    of_size = lambda run: np.average(np.diff(run.time, append=run.time[-1]) @ np.abs(run.stress), weights=run.summary["interface"]["length_m"])
    impulse = [programs.on_two("cone_al_steel", run.law, of_size, "{:.0f} Pa s") for run in (subgrid, law5)]
    order = Order(programs, "cone_al_steel")
    said(order.rubs_more(), f"More friction with the subgrid model: mean impulse of |s| over the flank {impulse[0]} against {impulse[1]}; impulse of s "
         f"x {order.times()[0]:.2f}, on zones twice as wide x {order.times()[1]:.2f}.", agrees, differs)
    highest = lambda run: np.percentile(np.abs(run.stress), 99.9)
    told = [programs.on_two("cone_al_steel", run.law, highest, "{:.0f} MPa") for run in (subgrid, law5)]
    said(highest(subgrid) > highest(law5), f"The stress with the subgrid model is higher: {told[0]} against {told[1]} with law (5).", agrees, differs)
    return made, "cone_al_steel", agrees, differs


TITLES = {
    12: "Profiles of the flow stress across the layer", 13: "Interface temperature of the paper's case", 14: "Shear stress of the paper's case",
    15: "Domain of the velocity-driven model", 16: "Shape and temperature with law (5)", 17: "Shape and temperature with the subgrid model",
    18: "Branch of the friction law along the flank, law (5)", 19: "Branch of the friction law along the flank, subgrid model",
    20: "Interface temperature in space and time", 21: "Sliding velocity in space and time", 22: "Shear stress in space and time"
}


COARSE = ("A quick look (paper_figures.py --coarse): all cones have zones of 0.5 mm, where most scenes have 0.25 mm; the map of Fig. 15 6 pressures "
          "and 16 jumps in place of 13 and 49.")


def main():
    parser = Parser(description=__doc__)
    parser.add_argument("-o", "--out", type=pathlib.Path, required=True, metavar="DIR")
    parser.add_argument("--bin", type=pathlib.Path, default=ROOT / "build/bin", help="directory of the programs")
    parser.add_argument("--only", default=",".join(map(str, TITLES)), help="numbers of figures, with commas")
    parser.add_argument("--coarse", action="store_true")
    options = parser.parse_args()
    wanted = [word.strip() for word in options.only.split(",")]
    for word in wanted:
        if word not in map(str, TITLES):
            parser.error(f"--only {word}: expected numbers from {min(TITLES)} to {max(TITLES)}")
    options.out.mkdir(parents=True, exist_ok=True)
    programs = Programs(options.bin.resolve(), options.out.resolve(), options.coarse)
    listed = []
    for number in sorted(set(map(int, wanted))):
        programs.made.clear()
        made, scene, agrees, differs = globals()[f"figure_{number}"](programs)
        name = f"figure_{number}.png"
        style.save(made, options.out / name, [block for block in programs.made if block["scene"] == scene])
        listed.append({"figure": number, "title": TITLES[number], "file": name, "scene": scene, "agrees": agrees, "differs": differs, "note": COARSE * options.coarse})
        print(f"{name}: {TITLES[number]}", flush=True)
        for word, sentences in (("agrees", agrees), ("differs", differs)):
            for sentence in sentences:
                print(f"  {word}: {sentence}")
    (options.out / "figures.json").write_text(json.dumps(listed, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
