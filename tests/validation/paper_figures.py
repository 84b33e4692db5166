#!/usr/bin/python3
"""Figures 12 to 22 of the paper by one command: runs the scenes, draws a PNG for each figure and writes what agrees with the paper, and
what does not, in numbers.

    paper_figures.py -o DIR [--bin build/bin] [--only 12,16] [--coarse]

F. Dambakizi, P. Le Tallec, J.-P. Perlat, "Multiscale thermomechanical modeling of shock-driven dry friction in hydrodynamics". DIR gets
figure_NN.png, the runs (runs/NAME, kept, and used again by the next call with the same options and programs) and figures.json: a list of
{"figure", "title", "file", "scene", "agrees", "differs", "note"}: "agrees" and "differs" are lists of sentences computed from the runs, "note" is of
--coarse: wide zones and few steps, for a look in a minute. The paper gives no curve of Figs 12 to 22 in numbers: compared are its statements, and, for Figs 13 and
14, the independent solution of tests/measured.toml. Pictures are those of client/report and of `shearbus-study map`."""
import functools
import hashlib
import json
import pathlib
import subprocess
import sys

import numpy as np

ROOT = pathlib.Path(__file__).resolve().parents[2]
PROBLEMS, EXAMPLES = ROOT / "hydro_stub/problems", ROOT / "client/examples"

sys.path[:0] = [str(ROOT / room) for room in ("client/report", "client/study", "client/study/map")]
import mesh  # noqa: E402
import plot_cone  # noqa: E402
import plot_histories  # noqa: E402
import plot_map  # noqa: E402
import style  # noqa: E402
from runs import Run  # noqa: E402
from scene_text import value_of  # noqa: E402
from terminal import Parser  # noqa: E402

LAWS = ("coulomb_tresca", "subgrid")
STICK, COULOMB, TRESCA, MELTING = 1, 2, 3, 4  # positions in style.REGIMES
read = functools.cache(Run)

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

    def used(self, found):
        self.made.append(found.provenance)
        return found

    def paper_case(self):
        """The paper's pair: 100 m/s at 11.2 GPa for 1 us in steps of 1 ns, with profiles. Returns the result of shearbus-replay."""
        scene = EXAMPLES / "paper_velocity_driven.toml"
        where = self.run("paper_velocity_driven", scene.read_text(),
                         [sys.executable, EXAMPLES / "make_history.py", "constant", "{}/history.h5"],
                         [self.command("shearbus-replay"), "{}/history.h5", "--scene", scene, "--out", "{}/result.h5", "--no-progress",
                          "--profile-nodes", "0", "--profile-times", ",".join(f"{t:g}" for t in PROFILE_TIMES)])
        return self.used(read(where / "result.h5"))

    def map(self):
        """Limits of the velocity-driven model over pressure and jump."""
        scene = EXAMPLES / "validity_map.toml"
        size = ["--pressures", 6, "--velocities", 16, "--dt", 2e-9] if self.coarse else ["--pressures", 13, "--velocities", 49, "--dt", 1e-9]
        return self.used(plot_map.Map(self.run("validity_map", scene.read_text(), [self.command("shearbus-study"), "map", scene, "--out", "{}",
                                                                                   "--times", 1e-7, 1e-6, *size])))

    def cone(self, scene, law, wider=1):
        """Returns a run of a scene of cone_target, on zones so many times as wide as the scene's."""
        text = (PROBLEMS / f"{scene}.toml").read_text()
        text = mesh.on_mesh(text, wider * (0.5e-3 if self.coarse else value_of(text, mesh.CONE + "zone_width_m")))
        suffix = f"-x{wider}" if wider != 1 else ""
        file = self.out / "runs" / f"{scene}{suffix}.toml"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
        return self.used(read(self.run(f"{scene}-{law}{suffix}", text,
                                       [self.command("shearbus-hydro"), file, "--interface-law", law, "--out", "{}", "--no-plot", "--no-progress"])))

    def cones(self, scene):
        return [self.cone(scene, law) for law in LAWS]

    def on_two(self, scene, law, value, form="{:.0f}"):
        """Returns the text of a number of a run on the scene's zones, with that on zones twice as wide."""
        fine, coarse = (form.format(value(self.cone(scene, law, wider))) for wider in (1, 2))
        return f"{fine} ({coarse} on zones twice as wide)"


class Order:
    """Which law rubs and moves more in a scene, on its own zones and on zones twice as wide: means over the interface of the displacement of
    metal against metal over +-1 mm, of the friction impulse and of the slip, as arrays [mesh, (law (5), subgrid model)]."""

    def __init__(self, programs, scene):
        summaries = [[programs.cone(scene, law, wider).summary for law in LAWS] for wider in (1, 2)]
        values = {"displacement": lambda of: next(band["mean_m"] for band in of["displacement"] if band["band_m"] == 1e-3),
                  "impulse": lambda of: of["mean_friction_impulse_pa_s"], "slip": lambda of: of["mean_slip_m"]}
        self.answers = {name: np.array([[value(of) for of in laws] for laws in summaries]) for name, value in values.items()}
        self.ratios = {name: found[:, 1] / found[:, 0] for name, found in self.answers.items()}  # of the subgrid model to law (5)
        self.moves_less, self.rubs_more = (self.ratios["displacement"] < 1.0).all(), (self.ratios["impulse"] > 1.0).all()

    def sentence(self):
        moved, slid = (100.0 * (self.ratios[name] - 1.0) for name in ("displacement", "slip"))
        rubbed, (law5, subgrid) = self.ratios["impulse"], 1e3 * self.answers["displacement"][0]
        return (f"metal against metal over +-1 mm {law5:.3f} mm with law (5), {subgrid:.3f} mm with the subgrid model "
                f"({moved[0]:+.0f} %, on zones twice as wide {moved[1]:+.0f} %); "
                f"friction impulse x {rubbed[0]:.2f} (x {rubbed[1]:.2f}); slip {slid[0]:+.0f} % ({slid[1]:+.0f} %)")


def hottest(run):
    return run["interface_temperature"].max()


def highest_pressure(run):
    return run.drawn("pressure").max()


def fastest_slip(run):
    return np.nanmax(run.drawn("sliding_velocity"))


# -- figures: each returns the figure and the scene; said(holds, sentence) adds a sentence to those that agree with the paper where it holds,
# else to those that differ --

PROFILE_TIMES = (2e-8, 1e-7, 2.8e-7, 6e-7, 1e-6)
# The paper's case, steps of 1 ns: an independent solution of the same discrete equations (tests/measured.toml, "Exact solutions").
EXACT = {"T0_K": 1218.945925353, "stress_Pa": 142.6492093e6, "steps": 1000}
NO_CURVE = "The paper's curve is not published in numbers: its shape alone can be compared."


def profiles(programs, said):
    said(False, NO_CURVE)
    group = programs.paper_case()["profiles"]
    time, z = group["time"], group["position"] * 1e6
    Y, T, ep, s = (group[name][:, 0] for name in ("layer_flow_stress", "layer_temperature", "layer_plastic_strain", "layer_shear_stress"))
    made, axes = style.figure(2, 2, (9.5, 7.0), sharex=True)
    colours = style.plt.cm.viridis(np.linspace(0.9, 0.0, len(time)))
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
         f"at most {far * 1e-6:.0f} MPa (at z = {z[last.argmax()]:.1f} µm); {100 * reached:.0f} % of that is reached at 1 µm.")
    excess = np.nanmax(np.sqrt(3) * s / Y - 1.0)
    said(excess < 1e-6, f"No vertex is loaded beyond its flow stress: sqrt(3) s exceeds Y by at most {max(excess, 0.0):.1e} of Y, at any time and z.")
    early = Y[0].max() - Y[0].min()
    said(early < 0.2 * Y[0].max(), f"At {time[0] * 1e6:g} µs the profile is nearly level ({Y[0].min() * 1e-6:.0f} to {Y[0].max() * 1e-6:.0f} MPa).")
    return made, "paper_velocity_driven"


def history(programs, number, name):
    """Returns the picture of a quantity of the paper's case, its times (us) and its values."""
    run = programs.paper_case()
    made, axis = style.figure(1, 1, (6.4, 4.2), legend=True)
    _, melts = plot_histories.draw_history(axis, run, np.array([0]), name, plot_histories.colours([run]))
    if melts:
        style.legend_below(made, [style.plt.Line2D([], [], color=style.FAINT, lw=1.0, ls="--", label=style.MELTING_LABEL)])
    axis.set(xlabel="time (µs)", title=f"Fig. {number}: {name.replace('_', ' ')}, 100 m/s at 11.2 GPa")
    return made, run.time, run[name][:, 0]


def temperature_history(programs, said):
    said(False, NO_CURVE)
    made, time, T0 = history(programs, 13, "interface_temperature")
    said(T0.max() < 1220.0, f"The interface approaches melting and never reaches it: {T0.max():.3f} K of 1220 K.")
    near = next((t for t, T in zip(time, T0) if T >= 0.99 * 1220.0), time[-1])
    said(near < time[-1], f"It passes 0.99 T_melt at {near:.3f} µs.")
    apart = abs(T0[EXACT["steps"] - 1] / EXACT["T0_K"] - 1)
    said(apart < 1e-6, f"At 1 µs T0 is {T0[EXACT['steps'] - 1]:.3f} K, {apart:.1e} from an independent solution of the same equations.")
    return made, "paper_velocity_driven"


def stress_history(programs, said):
    said(False, NO_CURVE)
    made, time, s = history(programs, 14, "shear_stress")
    peak = s.argmax()
    said(0 < peak < len(s) - 1, f"Rise, peak and thermal fall: the stress peaks at {s[peak] * 1e-6:.1f} MPa after {time[peak]:.2f} µs and has fallen "
         f"to {s[-1] * 1e-6:.1f} MPa at {time[-1]:.0f} µs.")
    apart = abs(s[EXACT["steps"] - 1] / EXACT["stress_Pa"] - 1)
    said(apart < 1e-6, f"At 1 µs it is {s[EXACT['steps'] - 1] * 1e-6:.3f} MPa, {apart:.1e} from an independent solution of the same equations.")
    return made, "paper_velocity_driven"


def domain(programs, said):
    found = programs.map()
    made = plot_map.draw_limits(found)
    made.suptitle("Fig. 15: domain of the velocity-driven model")
    limits = [found.line(i, "domain_limit_m_per_s") for i in range(len(found.times))]
    said(all(np.nanmin(np.diff(limit)) > 0 for limit in limits),
         f"The jump that the layer must be given to carry it rises with the pressure: {np.nanmin(limits[-1]):.3g} m/s at {found.pressure[0]:g} GPa, "
         f"{np.nanmax(limits[-1]):.3g} m/s at {found.pressure[-1]:g} GPa (after {plot_map.microseconds(found.times[-1])}).")
    ratio = limits[0] / limits[-1]
    said(False, f"The paper's line has no time; ours moves: it is {np.nanmin(ratio):.1f} to {np.nanmax(ratio):.1f} times as high after "
         f"{plot_map.microseconds(found.times[0])} as after {plot_map.microseconds(found.times[-1])}. So which line the paper's is cannot be said.")
    return made, "validity_map"


def shape(number, law, programs, said):
    """Figs 16 and 17: zones at the end, those of the law on the left, and the temperature along the flank on its own scale."""
    law5, subgrid = programs.cones("cone_al_steel")
    made = plot_cone.shape_and_flank([law5, subgrid] if law == "coulomb_tresca" else [subgrid, law5])
    made.suptitle(f"Fig. {number}: shape and temperature with {'law (5)' if law == 'coulomb_tresca' else 'the subgrid model'}")
    on_two = functools.partial(programs.on_two, "cone_al_steel")
    zones_reach, layer_reaches = (on_two(one, hottest, "{:.0f} K") for one in LAWS)
    if law == "coulomb_tresca":
        said(hottest(law5) < 0.5 * (300.0 + hottest(subgrid)),
             f"Law (5) shows no heating of the interface, which in the subgrid model reaches {layer_reaches}.")
        said(False, f"Law (5) heats zones, which conduct nothing: the thinner, the more, here to {zones_reach}.")
    else:
        said(hottest(subgrid) > 1.5 * hottest(law5), f"The subgrid model heats the interface strongly, to {layer_reaches} at the end of the cone.")
        said(subgrid.frame()["temperature"].max() > 0.9 * hottest(subgrid),
             "The heated layer is micrometres thick and no zone shows it, so that the flank needs a scale of its own.")
    order = Order(programs, "cone_al_steel")
    said(order.rubs_more and order.moves_less, f"More friction and less sliding with the subgrid model: {order.sentence()}.")
    said(False, f"Geometry and flyer are ours: the flank sees {on_two('coulomb_tresca', highest_pressure, '{:.1f} GPa')} and "
         f"{on_two('coulomb_tresca', fastest_slip, '{:.0f} m/s')}, the paper's up to 10 GPa and 400 m/s.")
    return made, "cone_al_steel"


def branches(number, law, programs, said):
    """Figs 18 and 19: the branch of the friction law along the flank, with the slip that Coulomb friction carries."""
    run = programs.cone("cone_as_printed", law)
    made = plot_cone.space_time([run], "regime")
    made.suptitle(f"Fig. {number}: branch of the friction law with {'law (5)' if law == 'coulomb_tresca' else 'the subgrid model'}")
    on_two = functools.partial(programs.on_two, "cone_as_printed", law)
    coulomb = lambda run: 100 * run.summary["slip_share_coulomb"]
    tresca = lambda run: 100 * (run.summary["slip_share_tresca"] + run.summary["slip_share_melting"])
    at_limit = lambda run: (run["regime"] >= TRESCA).any(axis=0)
    if law == "coulomb_tresca":
        said(coulomb(run) > 50, f"Mainly Coulomb, measured by slip: {on_two(coulomb, '{:.0f} %')} of the slip of the interface.")
        said(False, "Only with (14) as it is printed, Y = Y_max g: with min, and the load of cone_al_steel, Coulomb friction carries "
             f"{programs.on_two('cone_al_steel', law, coulomb, '{:.0f} %')} of the slip.")
    else:
        said(tresca(run) > 50, f"Tresca friction carries {on_two(tresca, '{:.0f} %')} of the slip, Coulomb friction {on_two(coulomb, '{:.0f} %')}; "
             f"{on_two(lambda run: 100 * at_limit(run).mean(), '{:.0f} %')} of the nodes are at the Tresca limit at some time.")
        regime = run["regime"]
        slips = [regime[:, i][regime[:, i] > STICK] for i in np.flatnonzero(at_limit(run) & (regime == COULOMB).any(axis=0))]
        first = np.mean([steps[0] == COULOMB or steps[-1] == COULOMB for steps in slips]) if slips else 0.0
        said(first > 0.5,
             f"Tresca is surrounded by Coulomb: of the nodes that see both, {100 * first:.0f} % begin or end their slip under Coulomb friction.")
        said(False, "The interface also sticks, more so on finer zones: the load that gives the paper's Fig. 18 is low, "
             f"{on_two(highest_pressure, '{:.1f} GPa')} at most.")
    return made, "cone_as_printed"


def interface_temperature(programs, said):
    run = programs.cone("cone_al_steel", "subgrid")
    made = plot_cone.space_time([run], "interface_temperature")
    made.suptitle("Fig. 20: interface temperature with the subgrid model")
    on_two = functools.partial(programs.on_two, "cone_al_steel", "subgrid")
    T0 = run["interface_temperature"]
    heated = (T0.max(axis=0) > 600.0).mean()
    said(heated > 0.5, f"{'Most' if heated > 0.5 else 'Less than half'} of the nodes pass 600 K, the hottest reaches {on_two(hottest, '{:.0f} K')}; "
         "the paper's flank heats as a whole.")
    melts = lambda run: 100 * (run["regime"] == MELTING).any(axis=0).mean()
    said(False, f"{on_two(melts, '{:.0f} %')} of the nodes come within 1 % of T_melt(P), which here rises with the pressure (Lindemann); "
         "the paper's is constant.")
    at_end = lambda run: np.median(run["interface_temperature"][-1])
    said(at_end(run) < 0.9 * np.median(T0.max(axis=0)),
         f"After contact it cools: the median of the flank is {on_two(at_end, '{:.0f} K')} at {run.time[-1]:.1f} µs.")
    return made, "cone_al_steel"


# The other cones, and why one may not have the paper's order.
WEAK = "Its interface is weaker than the metal beside it and never above the Tresca limit of law (5), so that it cannot stop the slip, and heat weakens it further."
OTHER_SCENES = {"cone_al_steel_slow": "", "cone_as_printed": "", "cone_al_steel_hot": WEAK, "cone_al5083_steel": WEAK}


def sliding(programs, said):
    runs = programs.cones("cone_al_steel")
    made = plot_cone.space_time(runs, "sliding_velocity")
    made.suptitle("Fig. 21: sliding velocity")
    order = Order(programs, "cone_al_steel")
    said(order.moves_less, f"Less sliding with the subgrid model, as displacement of the metal: {order.sentence()}.")
    said(False,
         "How far the interface itself slips depends on the zones where it is stronger than the metal beside it, as here: "
         "the metal shears in its place.")
    for scene, why in OTHER_SCENES.items():
        other = Order(programs, scene)
        holds = other.rubs_more and other.moves_less
        said(holds, f"{scene}: {other.sentence()}." + ("" if holds else f" {why}"))
    law5, subgrid = (programs.on_two("cone_al_steel", law, fastest_slip, "{:.0f} m/s") for law in LAWS)
    said(300.0 < fastest_slip(runs[1]) < 500.0, f"The fastest slip of a closed node is {subgrid}, with law (5) {law5}; published are up to 400 m/s.")
    return made, "cone_al_steel"


def stress(programs, said):
    runs = programs.cones("cone_al_steel")
    made = plot_cone.space_time(runs, "shear_stress")
    made.suptitle("Fig. 22: shear stress")
    impulse = lambda run: run.mean(np.diff(run.time, append=run.time[-1]) @ np.abs(run.drawn("shear_stress")))
    highest = lambda run: np.percentile(np.abs(run.drawn("shear_stress")), 99.9)
    on_two = lambda value, unit: [programs.on_two("cone_al_steel", law, value, "{:.0f} " + unit) for law in LAWS]
    order, (law5, subgrid) = Order(programs, "cone_al_steel"), on_two(impulse, "Pa s")
    said(order.rubs_more, f"More friction with the subgrid model: mean impulse of |s| over the flank {subgrid} against {law5}; impulse of s "
         f"x {order.ratios['impulse'][0]:.2f}, on zones twice as wide x {order.ratios['impulse'][1]:.2f}.")
    law5, subgrid = on_two(highest, "MPa")
    said(highest(runs[1]) > highest(runs[0]), f"The stress with the subgrid model is higher: {subgrid} against {law5} with law (5).")
    return made, "cone_al_steel"


FIGURES = {
    12: ("Profiles of the flow stress across the layer", profiles), 13: ("Interface temperature of the paper's case", temperature_history),
    14: ("Shear stress of the paper's case", stress_history), 15: ("Domain of the velocity-driven model", domain),
    16: ("Shape and temperature with law (5)", functools.partial(shape, 16, "coulomb_tresca")),
    17: ("Shape and temperature with the subgrid model", functools.partial(shape, 17, "subgrid")),
    18: ("Branch of the friction law along the flank, law (5)", functools.partial(branches, 18, "coulomb_tresca")),
    19: ("Branch of the friction law along the flank, subgrid model", functools.partial(branches, 19, "subgrid")),
    20: ("Interface temperature in space and time", interface_temperature), 21: ("Sliding velocity in space and time", sliding),
    22: ("Shear stress in space and time", stress)
}


COARSE = ("A quick look (paper_figures.py --coarse): all cones have zones of 0.5 mm, where most scenes have 0.25 mm; the map of Fig. 15 6 pressures "
          "and 16 jumps in place of 13 and 49.")


def main():
    parser = Parser(description=__doc__)
    parser.add_argument("-o", "--out", type=pathlib.Path, required=True, metavar="DIR")
    parser.add_argument("--bin", type=pathlib.Path, default=ROOT / "build/bin", help="directory of the programs")
    parser.add_argument("--only", default=",".join(map(str, FIGURES)), help="numbers of figures, with commas")
    parser.add_argument("--coarse", action="store_true")
    options = parser.parse_args()
    wanted = [word.strip() for word in options.only.split(",")]
    for word in wanted:
        if word not in map(str, FIGURES):
            parser.error(f"--only {word}: expected numbers from {min(FIGURES)} to {max(FIGURES)}")
    options.out.mkdir(parents=True, exist_ok=True)
    programs = Programs(options.bin.resolve(), options.out.resolve(), options.coarse)
    listed = []
    for number in sorted(set(map(int, wanted))):
        programs.made.clear()
        agrees, differs, (title, draw), name = [], [], FIGURES[number], f"figure_{number}.png"
        made, scene = draw(programs, lambda holds, sentence: (agrees if holds else differs).append(sentence))
        style.save(made, options.out / name, [block for block in programs.made if block["scene"] == scene])
        listed.append({"figure": number, "title": title, "file": name, "scene": scene, "agrees": agrees, "differs": differs,
                       "note": COARSE * options.coarse})
        print(f"{name}: {title}", flush=True)
        for word, sentences in (("agrees", agrees), ("differs", differs)):
            for sentence in sentences:
                print(f"  {word}: {sentence}")
    (options.out / "figures.json").write_text(json.dumps(listed, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
