#!/usr/bin/python3
"""Draws what each option of the physics does, from the scenes that show it: makes the histories, replays them with the option and without,
and
draws options_layer.png, options_heat.png, options_contact.png and options_friction.png.

    plot_options.py --bin build/bin --out DIR [--keep DIR]

--keep DIR: where histories and results stay."""
import pathlib
import re
import subprocess
import sys
import tempfile
from terminal import Parser, end_with
import begin  # noqa: F401

import h5py
import numpy as np
import style
from runs import meta_of, provenance_of

ROOT = pathlib.Path(__file__).resolve().parents[2]
EXAMPLES, PROBLEMS = ROOT / "client/examples", ROOT / "hydro_stub/problems"
ASLEEP = 32  # bit of /outcome
WITH, WITHOUT = style.INK, style.SECOND


class Fault(Exception):
    pass


class Replays:
    def __init__(self, programs, work):
        self.hydro, self.replay, self.work = programs / "shearbus-hydro", programs / "shearbus-replay", work
        self.made = []  # provenance of the results since the last picture

    def run(self, *words):
        done = subprocess.run([str(word) for word in words], capture_output=True, text=True)
        if done.returncode != 0:
            raise Fault(done.stderr.strip())

    def __call__(self, scene, history, *keys):
        """Replays a scene with other values of keys. history: words of make_history.py. Returns the columns of the result, [steps, nodes],
        time in us."""
        name = "-".join([scene.stem, *keys])
        file, out = self.work / f"{name}-history.h5", self.work / f"{name}.h5"
        self.run(sys.executable, EXAMPLES / "make_history.py", history[0], file, *history[1:])
        self.run(self.replay, file, "--scene", scene, "--out", out, "--no-progress", *(word for key in keys for word in ("--set", key)))
        return self.columns_of(out)

    def host(self, scene, *lines):
        """Runs a scene of shearbus-hydro with other lines in place of its own for the same keys. Returns the columns of its history."""
        text, out = scene.read_text(), self.work / "-".join([scene.stem, *(line.split(" ")[0] for line in lines)])
        for line in lines:
            text = re.sub(rf"(?m)^{line.split(' ')[0]} = .*", line, text)
        out.mkdir(exist_ok=True)
        (out / "scene.toml").write_text(text)
        self.run(self.hydro, out / "scene.toml", "--out", out / "run", "--no-plot", "--no-progress")
        return self.columns_of(out / "run/history.h5")

    def columns_of(self, file):
        with h5py.File(file) as result:
            columns = {name: data[:] for name, data in result.items() if isinstance(data, h5py.Dataset)}
            self.made.append(provenance_of(meta_of(result)[0], "", {"scene": "shipped scenes"}))
        columns["time"] = columns["time"] * 1e6
        return columns


def lines(axis, run, column, scale, label, colour, dashes="-", nodes=slice(None)):
    axis.plot(run["time"], scale * run[column][:, nodes], dashes, color=colour, lw=1.4, label=label)


# -- panels: each draws on an axis, from its scene with and without an option, and returns the title --


def inertia(axis, replay):
    scene, history = EXAMPLES / "sudden_start.toml", ("constant", "--velocity", 20, "--dt", 1e-10, "--steps", 400)
    for run, label, colour in ((replay(scene, history), "layer with mass", WITH), (replay(scene, history, "layer.inertia=false"), "without", WITHOUT)):
        axis.plot(1e3 * run["time"], 1e-6 * run["shear_stress"], color=colour, lw=1.4, label=label)
    axis.set(xlabel="time (ns)", ylabel=style.QUANTITIES["shear_stress"][0])
    return "layer.inertia: waves cross the layer"


def rates(axis, replay, displacement=2e-6, thickness=20e-6):
    scene, history = EXAMPLES / "copper_rates.toml", ("rates", "--pressure", 5e9, "--dt", 1e-10, "--steps", 250)
    for run, label, colour in ((replay(scene, history), "Preston, Tonks, Wallace", WITH), (replay(scene, history, "soft.material=copper_ofhc"), "Steinberg, Cochran, Guinan", WITHOUT)):
        jump = run["velocity_jump"][0]
        stress = [np.interp(1e6 * displacement / v, run["time"], s) for v, s in zip(jump, run["shear_stress"].T)]
        axis.semilogx(jump / thickness, 1e-6 * np.array(stress), "o-", ms=3, color=colour, lw=1.4, label=label)
    axis.set(xlabel="shear rate of the layer (1/s)", ylabel="stress after 2 µm (MPa)")
    return "soft.flow_law: copper at high rates"


def turning(axis, replay):
    run = replay(EXAMPLES / "turning_contact.toml", ("turning", "--velocity", 20, "--pressure", 0.3e9))
    lines(axis, run, "shear_stress", 1e-6, "s, first component", WITH)
    lines(axis, run, "shear_stress_second", 1e-6, "s, second", style.RUNS[2])
    axis.plot(run["time"], 0.3e-6 * np.maximum(run["pressure"], 0.0), ":", color=style.FAINT, label="µ P")
    asleep = (run["outcome"][:, 0] & ASLEEP) > 0
    axis.fill_between(run["time"], 0, 1, where=asleep, transform=axis.get_xaxis_transform(), color=style.GRID, label="asleep")
    axis.set(ylim=(-150, 100), xlabel="time (µs)", ylabel=style.QUANTITIES["shear_stress"][0])
    return "two components, Coulomb limit, sleep"


def pressure(axis, replay):
    scene, history = EXAMPLES / "under_pressure.toml", ("pressures",)
    for keys, label, colour in (((), "Simon, compressed", WITH), (("soft.melting_curve=constant", "soft.pressure_term=linear"), "neither", WITHOUT),
                                (("soft.melting_curve=lindemann", "soft.pressure_term=linear"), "Lindemann", style.RUNS[2])):
        run = replay(scene, history, *keys)
        axis.plot(1e-9 * run["pressure"][-1], 1e-6 * run["shear_stress"][-1], "o-", ms=3, color=colour, lw=1.4, label=label)
    axis.set(xlabel=style.QUANTITIES["pressure"][0], ylabel="stress after 1 µs (MPa)", ylim=(0, None))
    return "soft.melting_curve, soft.pressure_term"


def drive(axis, replay):
    history = ("constant",)
    lines(axis, replay(EXAMPLES / "paper_velocity_driven.toml", history), "shear_stress", 1e-6, "layer_shear", WITH)
    lines(axis, replay(EXAMPLES / "interface_slip.toml", history), "shear_stress", 1e-6, "interface_slip", WITHOUT)
    axis.set(xlabel="time (µs)", ylabel=style.QUANTITIES["shear_stress"][0], ylim=(0, None))
    return "velocity_driven.drive: the paper's case"


def section_6(axis, replay):
    scene = PROBLEMS / "paper_section_6.toml"
    for keys, label, colour in (((), "as the scene", WITH), (("contact_fraction = 1.0",), "contact everywhere", style.RUNS[2]), (("taylor_quinney_factor = 1e-9",), "plastic work heats nothing", WITHOUT)):
        lines(axis, replay.host(scene, *keys), "interface_temperature", 1.0, label, colour, nodes=[1])
    axis.set(xlabel="time (µs)", ylabel=style.QUANTITIES["interface_temperature"][0])
    return "[junctions], plastic_layer, Taylor-Quinney"


def section_4(axis, replay):
    scene, history = EXAMPLES / "paper_section_4.toml", ("constant", "--dt", 2e-10, "--steps", 1000)
    for keys, label, colour, dashes in (((), "layer with mass", WITH, "-"), (("layer.inertia=false",), "without", WITHOUT, "--")):
        lines(axis, replay(scene, history, *keys), "interface_temperature", 1.0, label, colour, dashes, nodes=[0])
    axis.set(xlabel="time (µs)", ylabel=style.QUANTITIES["interface_temperature"][0])
    return "inertia, [junctions], Taylor-Quinney"


def steady(axis, replay):
    scene, history = EXAMPLES / "steady_sliding.toml", ("imposed", "--velocity", 100, "--pressure", 1e9, "--dt", 4e-9)
    eight = {key: f"[{','.join([value] * 8)}]" for key, value in (("thermal_conductivity_table_w_per_m_k", "15"), ("specific_heat_table_j_per_kg_k", "477"))}
    slopes = ["soft.thermal_conductivity_slope_per_k=0", "soft.specific_heat_slope_per_k=0", *(f"hard.{key}={values}" for key, values in eight.items())]
    for run, label, dashes, colour in ((replay(scene, history), "as the scene", "-", WITH), (replay(scene, history, *slopes), "k, c constant", "--", WITHOUT),
                                       (replay(scene, history, "layer.far_boundary=half_space"), "half-spaces", ":", style.RUNS[2])):
        lines(axis, run, "interface_temperature", 1.0, [label, None], colour, dashes, nodes=[0, 3])
    for node in (0, 3):
        place = run["time"][-1], run["interface_temperature"][-1, node]
        axis.annotate(f"{run['velocity_jump'][0, node]:g} m/s", place, ha="right", va="bottom", fontsize=8)
    axis.set(xlabel="time (µs)", ylabel=style.QUANTITIES["interface_temperature"][0])
    return "isothermal faces, k(T), thermal_softening"


def brake(axis, replay):
    scene, history = EXAMPLES / "brake.toml", ("force_driven", "--velocity", 60, "--pressure", 0.2e9, "--dt", 20e-9, "--steps", 500)
    lines(axis, replay(scene, history), "velocity_jump_new", 1.0, ["velocity_weakening", None, None, None], WITH)
    lines(axis, replay(scene, history, "interface.velocity_decay_s_per_m=1e6"), "velocity_jump_new", 1.0, ["constant, µ_inf", None, None, None], WITHOUT, "--")
    axis.set(xlabel="time (µs)", ylabel="velocity jump (m/s)", ylim=(0, None))
    return "velocity_weakening, tolerance"


def film(axis, replay):
    scene, history = PROBLEMS / "cone_al_steel_melt.toml", ("imposed", "--velocity", 400, "--pressure", 5e9)
    lines(axis, replay(scene, history), "shear_stress", 1e-6, "the metal melts", WITH, nodes=[3])
    lines(axis, replay(PROBLEMS / "cone_al_steel_hot.toml", history), "shear_stress", 1e-6, "its strength vanishes before", WITHOUT, "--", nodes=[3])
    axis.set(xlabel="time (µs)", ylabel=style.QUANTITIES["shear_stress"][0], ylim=(0, None))
    return "[melt_film], [hard_layer]"


def memory(axis, replay):
    scene, history = EXAMPLES / "pressure_memory.toml", ("pressed", "--velocity", 40, "--pressure", 0.5e9, "--steps", 400)
    lines(axis, replay(scene, history), "shear_stress", 1e-6, ["prakash_clifton, 10 and 40 m/s", None], WITH, nodes=[0, 3])
    lines(axis, replay(scene, history, "interface.slip_length_m=1e-12"), "shear_stress", 1e-6, "µ P", WITHOUT, "--", nodes=[3])
    axis.set(xlabel="time (µs)", ylabel=style.QUANTITIES["shear_stress"][0], ylim=(0, None))
    return "friction follows the pressure along a slip"


def velocity_step(axis, replay):
    scene, history = EXAMPLES / "rate_and_state.toml", ("stepped", "--velocity", 1, "--pressure", 0.5e9, "--dt", 5e-9, "--steps", 1500)
    lines(axis, replay(scene, history), "shear_stress", 1e-6, "rate_and_state, ageing", WITH)
    lines(axis, replay(scene, history, "interface.state_evolution=slip"), "shear_stress", 1e-6, "slip law", style.RUNS[2], "--")
    lines(axis, replay(scene, history, "interface.evolution_effect=0"), "shear_stress", 1e-6, "no state", WITHOUT, ":")
    axis.set(xlabel="time (µs)", ylabel=style.QUANTITIES["shear_stress"][0], ylim=(30, 60))  # room for the legend
    return "a layer that slides at 1, 10, 1 m/s"


def plates(axis, replay):
    scene, history = EXAMPLES / "plates_with_waves.toml", ("force_driven", "--velocity", 5, "--pressure", 0.5e9, "--dt", 1e-10, "--steps", 1100)
    for run, label, colour in ((replay(scene, history), "layer with mass", WITH), (replay(scene, history, "layer.inertia=false"), "without", WITHOUT)):
        axis.plot(1e3 * run["time"], 1e-6 * run["shear_stress"][:, 3], color=colour, lw=1.4, label=label)
    axis.set(xlabel="time (ns)", ylabel=style.QUANTITIES["shear_stress"][0])
    return "layer.inertia: two plates stop each other"


PICTURES = {"options_layer": (inertia, rates, drive), "options_heat": (pressure, steady, film), "options_contact": (turning, brake, section_6),
            "options_friction": (memory, velocity_step, section_4, plates)}


def main():
    parser = Parser(description=__doc__)
    parser.add_argument("--bin", type=pathlib.Path, default=ROOT / "build/bin", help="directory of the programs")
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--keep", type=pathlib.Path)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        work = options.keep or pathlib.Path(scratch)
        work.mkdir(parents=True, exist_ok=True)
        replay = Replays(options.bin.resolve(), work.resolve())
        for name, panels in PICTURES.items():
            made, axes = style.figure(1, len(panels), (3.4 * len(panels), 3.2))
            for axis, panel in zip(axes, panels):
                axis.set_title(panel(axis, replay), fontsize=9.5)
                axis.grid()
                axis.legend(fontsize=8)
            style.save(made, options.out / f"{name}.png", replay.made, colours=32)
            replay.made.clear()
            print(f"written: {options.out / name}.png")


if __name__ == "__main__":
    end_with(main, Fault, OSError)
