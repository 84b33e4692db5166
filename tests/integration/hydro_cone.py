"""Tests of shearbus-hydro on a cone: its result files are complete, readable, and agree with the summary."""
import itertools
import json
import os
import pathlib
import re
import signal
import subprocess
import sys
import xml.etree.ElementTree

import h5py
import numpy

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import OPTIONS, PROBLEMS


class Cone(served.Served):
    def scene(self, name="cone_al_steel_coarse", **changes):
        return served.edited(PROBLEMS / f"{name}.toml", self.path / "cone.toml", **{"zone_width_m": 1e-3, "end_time_s": 5e-6, **changes})

    def hydro(self, *arguments, **more):
        return self.run_program(OPTIONS.hydro, *arguments, **more)

    def ran(self, scene, *arguments, out="out"):
        """Runs a scene without pictures. Returns the directory and the summary of the run, and the process with what it printed."""
        directory = self.path / out
        done = self.hydro(scene, "--out", directory, "--no-plot", *arguments)
        return directory, json.loads((directory / "summary.json").read_text()), done

    def test_results_are_whole_and_pictures_are_drawn(self):
        out = self.path / "out"
        done = self.hydro(self.scene(), "--interface-law", "coulomb_tresca", "--out", out)
        self.assertFalse(list(out.glob("*.partial")))
        summary = json.loads((out / "summary.json").read_text())
        self.assertLess(abs(summary["energy_residual"]), 1e-12)
        self.assertLess(abs(summary["momentum_residual"]), 1e-12)
        origin = summary["provenance"]
        self.assertEqual((origin["program"], origin["scene"]), ("shearbus-hydro", summary["scene"]))
        self.assertIn("--interface-law coulomb_tresca", origin["command"])
        self.assertNotIn("exchange", done.stdout, "a law of this process exchanges nothing")
        shares = [summary[f"share_{r}"] for r in ("open", "stick", "coulomb", "tresca", "melting")]
        self.assertAlmostEqual(sum(shares), 1.0, places=12)
        with h5py.File(out / "interface.h5") as f:
            self.assertEqual(f["meta"].attrs["commit"], origin["commit"])
            self.assertEqual(f["shear_stress"].shape, f["pressure"].shape)
            self.assertGreater(f["time"].shape[0], 50)
            self.assertTrue(numpy.isfinite(f["interface_temperature"][:]).all())
            stress, pressure = f["shear_stress"][:], f["pressure"][:]
            self.assertTrue((stress[pressure == 0.0] == 0.0).all())
            self.assertGreater(stress.max(), 50e6)
        with h5py.File(out / "free_surface.h5") as f:
            self.assertGreater(f["axial_velocity"][-1, 0], 500.0)
        self.fields_are_as_the_sidecar_says(out)
        self.assertEqual(len(list(out.glob("cone_*.png"))), 8)

    def test_the_summary_says_what_the_flank_saw_and_the_bound_holds_at_every_node(self):
        path = self.scene()
        slip = {}
        for law in ("subgrid", "coulomb_tresca"):
            out, summary, done = self.ran(path, "--interface-law", law, out=law)
            slip[law] = summary["mean_slip_m"]
            self.assertEqual(summary["published"], {"pressure_pa": 10e9, "sliding_velocity_m_per_s": 400.0})
            self.assertRegex(done.stdout, r"flank, highest +pressure [\d.]+ GPa .*published: up to 10 GPa, 400 m/s")
            nodes = summary["interface"]
            with h5py.File(out / "interface.h5") as f:
                numpy.testing.assert_array_equal(nodes["slip_m"], f["slip_distance"][-1])
                self.assertTrue((numpy.array(nodes["peak_pressure_pa"]) >= f["pressure"][:].max(axis=0)).all())
                for name in ("pressure", "sliding_velocity"):
                    peak = next(key for key in nodes if name in key)
                    self.assertEqual(max(nodes[peak]), summary[peak])
                self.assertEqual("bound_used" in f, law == "subgrid", "law (5) does not stay below melting by itself")
                if law == "subgrid":
                    used = f["bound_used"][:]
                    self.assertTrue((used >= 0.0).all() and (used <= 1.0).all())
                    self.assertGreater(used.max(), 0.5)
                    self.assertGreaterEqual(summary["bound_used_most"], used.max())
                    numpy.testing.assert_array_equal(nodes["bound_used"], used[-1])
                    share = 100 * summary["bound_used_most"]
                    self.assertRegex(done.stdout, rf"friction below melting +did at most {share:.1f} % .* of the work that an interface below melting can take up")
                else:
                    self.assertNotIn("below melting", done.stdout)
            shares = [100 * summary[f"slip_share_{name}"] for name in ("coulomb", "tresca", "melting")]
            self.assertIn("Coulomb {:.1f} %, Tresca {:.1f} %, melting {:.1f} % of the slip distance".format(*shares), done.stdout)
            self.assertLessEqual(sum(shares), 100 + 1e-9)
            self.assertIn("Coulomb: friction coefficient times pressure", done.stdout)
            if law == "subgrid":  # the residual of the layers' energy is relative to the work, and the summary says why it is no rounding
                layer = summary["layer_energy"]
                found = layer["energy_residual_j_per_m2"] / layer["interface_work_j_per_m2"]
                self.assertIn(f"energy {found:.1e} of the work\n", done.stdout)
                self.assertEqual("more than rounding" in done.stdout, abs(found) > 1e-12)
        self.assertLess(slip["subgrid"], 0.7 * slip["coulomb_tresca"])

    def test_every_law_keeps_energy_and_axial_momentum_and_slides_in_its_order(self):
        slip, hottest = {}, {}
        for law in ("free_slip", "coulomb_tresca", "subgrid", "stick"):
            _, summary, _ = self.ran(self.scene(end_time_s="4e-6"), "--interface-law", law, out=law)
            self.assertLess(abs(summary["energy_residual"]), 1e-13, law)
            self.assertLess(abs(summary["momentum_residual"]), 1e-12, law)
            slip[law], hottest[law] = summary["mean_slip_m"], summary["peak_interface_temperature_k"]
            self.assertEqual(summary["friction_heat_j"] > 0.0, law != "free_slip", law)
        self.assertGreater(slip["free_slip"], max(slip["coulomb_tresca"], slip["subgrid"]))
        self.assertGreater(slip["coulomb_tresca"], 10 * slip["stick"])
        self.assertGreater(hottest["subgrid"], 2 * hottest["coulomb_tresca"], "the layer has a peak that zones cannot have")

    def test_what_converges_is_reported_next_to_the_slip(self):
        out, summary, done = self.ran(self.scene("cone_al_steel", first_zone_m="1e-3"))
        self.assertNotIn("Y*", done.stderr, "the layer flows: no warning")
        nodes = summary["interface"]
        bands = {band["band_m"]: band["mean_m"] for band in summary["displacement"]}
        self.assertEqual(list(bands), [0.5e-3, 1e-3])
        self.assertLess(summary["mean_slip_m"], bands[0.5e-3])
        self.assertLess(bands[0.5e-3], bands[1e-3])
        self.assertAlmostEqual(bands[1e-3], numpy.average(nodes["displacement_one_mm_m"], weights=nodes["length_m"]), delta=1e-12)
        self.assertAlmostEqual(summary["mean_friction_impulse_pa_s"], numpy.average(nodes["friction_impulse_pa_s"], weights=nodes["length_m"]), delta=1e-9)
        self.assertEqual(set(nodes["layer_thickness_m"]), {0.5e-3}, "half a wall zone, the same for all nodes")
        self.assertAlmostEqual(summary["metal_peak_strength"]["stress_pa"] / 301e6, 1.0, delta=0.01)
        self.assertEqual(summary["nodes_above_critical_jump"], sum(share > 1 for share in nodes["critical_jump_share"]))
        self.assertRegex(done.stdout, r"metal against metal +mean [\d.]+ mm over \+-0.5 mm, [\d.]+ mm over \+-1 mm of the interface\n")
        self.assertRegex(done.stdout, r"interface strength +680 MPa cold; Y\* 301 MPa, .*on fine zones the metal shears in place of slip\n")
        with h5py.File(out / "interface.h5") as f:
            numpy.testing.assert_array_equal(f["displacement_one_mm"][-1], nodes["displacement_one_mm_m"])

    def test_zones_stay_warm_and_no_stress_turns_for_one_row(self):
        for first in ("1e-3", "50e-6"):
            with self.subTest(first):
                out, *_ = self.ran(self.scene("cone_al_steel", first_zone_m=first, end_time_s="8e-6"), out=first)
                for file in sorted(out.glob("fields/0*.h5")):  # from 300 K; the metals tear at 290 and 293 K along their isentropes
                    with h5py.File(file) as f:
                        self.assertGreater(f["temperature"][:].min(), 285.0, file.name)
                with h5py.File(out / "interface.h5") as f:
                    stress = f["shear_stress"][:]
                alone = (stress[1:-1] * stress[:-2] < 0) & (stress[1:-1] * stress[2:] < 0) & (numpy.abs(stress[1:-1]) > 50e6)
                self.assertEqual(alone.sum(), 0, "the stress of a node turns for one row")

    def test_halved_zones_change_displacement_and_impulse_by_two_percent_at_most(self):
        bonded = {"friction_coefficient": 1.0, "yield_strength_pa": 5e9}  # no metal beside it is as strong
        for name, changes in (("cone_al_steel", {}), ("cone_al_steel_slow", {}), ("cone_al_steel_hot", {}), ("cone_al_steel", bonded)):
            displacement, impulse = [], []
            for width in ("0.5e-3", "0.25e-3"):
                with self.subTest(name, width=width, **changes):
                    scene = self.scene(name, zone_width_m=width, first_zone_m=width, end_time_s="12e-6", **changes)
                    _, summary, _ = self.ran(scene, out=f"{name}{width}{len(changes)}")
                    displacement.append(summary["displacement"][1]["mean_m"])
                    impulse.append(summary["mean_friction_impulse_pa_s"])
            self.assertAlmostEqual(displacement[0] / displacement[1], 1.0, delta=0.02, msg=f"{name} {changes}")
            self.assertAlmostEqual(impulse[0] / impulse[1], 1.0, delta=0.02, msg=f"{name} {changes}")

    def test_an_interface_stronger_than_its_metal_warns_and_a_layer_of_another_thickness_is_refused(self):
        done = self.hydro(self.scene(), "--check")
        self.assertRegex(done.stderr, r"^shearbus-hydro: warning: interface.yield_strength_pa = 6.8e\+08 Pa is above Y\* = 3.0\d*e\+08 Pa, .* set interface.plastic_layer = true\n")
        path = self.scene("cone_al_steel")
        path.write_text(path.read_text().replace("cells = 40 ", "thickness_m = 20e-6\ncells = 40 "))
        done = self.hydro(path, "--check", code=1)
        self.assertRegex(done.stderr, r"cone.toml:\d+:1: layer.thickness_m = 2e-05 m, but half the wall zones is .*leave layer.thickness_m out")
        done = self.hydro(self.scene("cone_al_steel", first_zone_m=2e-3), "--check", code=1)
        self.assertRegex(done.stderr, r"cone.toml:\d+:1: hydro.cone_target.first_zone_m = 0.002 m is more than the other zones' 0.001 m")

    def test_friction_heat_of_law_5_goes_as_deep_as_it_conducts(self):
        hottest = {}
        for depth in ("zone", "diffusion"):
            path = self.scene("cone_al_steel", first_zone_m="5e-6", end_time_s="1.5e-6")
            path.write_text(path.read_text() + f'\n[hydro.coulomb_tresca]\nheat_depth = "{depth}"\n')
            _, summary, done = self.ran(path, "--interface-law", "coulomb_tresca", out=depth)
            self.assertLess(abs(summary["energy_residual"]), 1e-12)
            hottest[depth] = summary["peak_interface_temperature_k"]
            self.assertEqual(done.stderr, "", "nothing melts")
        self.assertGreater(hottest["zone"] - 300, 1.2 * (hottest["diffusion"] - 300))

    def test_a_run_whose_law_5_brings_a_thin_zone_to_melting_says_so_once(self):
        path = self.scene("cone_al_steel", first_zone_m="5e-6", end_time_s="2e-6", flyer_speed_m_per_s="568.0")
        out = self.path / "out"
        first = served.program(self, OPTIONS.hydro, path, "--interface-law", "coulomb_tresca", "--out", out, "--no-plot", stdout=subprocess.DEVNULL, stderr=subprocess.PIPE)
        said = first.stderr.readline()
        first.send_signal(signal.SIGINT)
        _, rest = first.communicate(timeout=250)
        self.assertEqual(first.returncode, 3, rest)
        self.assertEqual(self.hydro("--restart", out, "--no-plot").stderr, "", "the warning is not repeated")
        self.assertRegex(said, r"^shearbus-hydro: warning: hydro.cone_target.first_zone_m: with law \(5\) a zone at the interface, 5 um thick, "
                         r"is at 0\.99 T_melt after 1\.\d+ us\. .*raise first_zone_m or set hydro.coulomb_tresca.heat_depth = \"diffusion\"[^\n]*\n$")

    def test_layers_that_start_at_the_temperature_of_the_shocked_zones(self):
        path, text = self.path, self.scene().read_text()
        summaries, starts = {}, {}
        for start in ("scene", "shocked"):
            (path / "cone.toml").write_text(text.replace('interface_law = "subgrid"', f'interface_law = "subgrid"\nlayer_start = "{start}"'))
            out, summaries[start], _ = self.ran(path / "cone.toml", out=start)
            with h5py.File(out / "interface.h5") as f:
                starts[start] = f["interface_temperature"][0]
                self.assertEqual("initial_temperature" in f, start == "shocked")
                if start == "shocked":
                    temperature = f["initial_temperature"][:]
                    loaded = f["pressure"][0] > 0
                    # until contact loads a node, its layer stays as it starts
                    numpy.testing.assert_array_equal(starts[start][~loaded], temperature[~loaded])
                    self.assertGreater((~loaded).sum(), 10)
        # A run without friction has these temperatures, and the scene's run has none of them at first.
        done = self.hydro(path / "cone.toml", "--out", path / "free", "--no-plot", "--interface-law", "free_slip", code=1)
        self.assertIn("layer_start shocked is for the layers of interface_law subgrid; this run has free_slip", done.stderr)
        (path / "free.toml").write_text(text)
        self.ran(path / "free.toml", "--interface-law", "free_slip", out="free")
        with h5py.File(path / "free/interface.h5") as f:
            numpy.testing.assert_array_less(temperature, f["zone_temperature"][:].max(axis=0) + 1.0)
        numpy.testing.assert_array_equal(starts["scene"][~loaded], 300.0)
        self.assertTrue(((temperature > 301.0) & (temperature < 450.0)).all(), temperature)
        self.assertGreater(temperature.mean(), 330.0)
        self.assertEqual(summaries["shocked"]["interface"]["start_temperature_k"], temperature.tolist())
        self.assertNotIn("start_temperature_k", summaries["scene"]["interface"])
        for name in ("mean_slip_m", "friction_heat_j"):
            self.assertNotEqual(summaries["shocked"][name], summaries["scene"][name])
        (path / "one.toml").write_text((PROBLEMS / "two_half_spaces.toml").read_text().replace("[hydro]\n", '[hydro]\nlayer_start = "shocked"\n'))
        done = self.hydro(path / "one.toml", "--check", code=1)
        self.assertRegex(done.stderr, r"one.toml:\d+:1: layer_start shocked needs zones that a shock heats; shear_column has none")

    def test_flow_stress_as_printed_gives_the_figures_and_the_hot_scene_reverses_the_order(self):
        def summaries(name):
            return [self.ran(self.scene(name), "--interface-law", law, out=f"{name}-{law}")[1] for law in ("coulomb_tresca", "subgrid")]

        law5, subgrid = summaries("cone_as_printed")
        self.assertGreater(law5["slip_share_coulomb"], 0.8)  # Fig. 18
        self.assertGreater(subgrid["slip_share_tresca"], 2 * law5["slip_share_tresca"])  # Fig. 19
        self.assertLess(subgrid["mean_slip_m"], 0.9 * law5["mean_slip_m"])
        self.assertGreater(subgrid["peak_interface_temperature_k"], 700)
        self.assertLess(law5["peak_interface_temperature_k"], 400)
        law5, subgrid = summaries("cone_al_steel_hot")
        self.assertGreater(subgrid["mean_slip_m"], 1.2 * law5["mean_slip_m"])
        self.assertGreater(subgrid["slip_share_melting"], 0.5)

    def fields_are_as_the_sidecar_says(self, out):
        tree = xml.etree.ElementTree.parse(out / "fields.xmf")
        grids = tree.findall(".//Grid[@GridType='Uniform']")
        times = [float(g.find("Time").get("Value")) for g in grids]
        self.assertEqual(len(times), 25)
        self.assertEqual(times[0], 0.0)
        self.assertEqual(times[-1], 5e-6)
        for number, grid in enumerate(grids):
            for item in grid.iter("DataItem"):
                name, path = item.text.split(":")
                self.assertIn(name, ("fields/mesh.h5", f"fields/{number:05}.h5"))
                with h5py.File(out / name) as f:
                    self.assertEqual(tuple(map(int, item.get("Dimensions").split())), f[path].shape)
            with h5py.File(out / f"fields/{number:05}.h5") as f:
                self.assertEqual(f["time"][0], times[number])
        with h5py.File(out / "fields/mesh.h5") as mesh, h5py.File(out / "fields/00000.h5") as first:
            self.assertLess(mesh["quads"][:].max(), first["place"].shape[0])
            numpy.testing.assert_allclose(first["temperature"][:], 300.0, rtol=1e-12)

    def test_neither_threads_nor_overlap_change_a_bit(self):
        wide = {"zone_width_m": "0.22e-3", "end_time_s": "0.25e-6"}  # bodies large enough to be computed by several threads
        path = self.scene(**wide).rename(self.path / "wide.toml")
        deep = self.scene("cone_al_steel", zone_width_m="0.45e-3", first_zone_m="5e-6", end_time_s="0.15e-6")
        deep.write_text(deep.read_text() + '\n[hydro.coulomb_tresca]\nheat_depth = "diffusion"\n')

        def runs(scene, law, *ways):
            for threads, flag in ways:
                out = self.path / f"{law}{threads}{flag}"
                self.hydro(scene, "--interface-law", law, "--out", out, "--no-plot", flag,
                           env={**os.environ, "OMP_NUM_THREADS": str(threads), "OMP_WAIT_POLICY": "passive"})
                yield out

        for first, *others in (runs(path, "subgrid", (1, "--overlap"), (1, "--no-overlap"), (3, "--overlap"), (3, "--no-overlap")),
                               runs(deep, "coulomb_tresca", (1, "--overlap"), (3, "--overlap"))):
            for other, name in itertools.product(others, ("interface.h5", "fields/00024.h5")):
                with h5py.File(first / name) as a, h5py.File(other / name) as b:
                    for quantity in a:
                        if quantity != "meta":
                            numpy.testing.assert_array_equal(a[quantity][...], b[quantity][...], err_msg=f"{other} {name} {quantity}")

    def test_threads_wait_briefly_unless_told(self):
        path = self.scene()

        def spins(**chosen):
            environment = {name: value for name, value in os.environ.items() if name not in ("OMP_WAIT_POLICY", "GOMP_SPINCOUNT")}
            done = self.hydro(path, "--check", "--interface-law", "stick", env={**environment, "OMP_DISPLAY_ENV": "verbose", "OMP_NUM_THREADS": "2", **chosen})
            found = re.findall(r"GOMP_SPINCOUNT = '(\d+)'", done.stderr)
            if not found:
                self.skipTest("another runtime than libgomp")
            return found[-1]

        self.assertEqual(spins(), "3000")
        self.assertEqual(spins(OMP_WAIT_POLICY="passive"), "0")
        self.assertEqual(spins(GOMP_SPINCOUNT="7"), "7")
        self.assertNotEqual(spins(OMP_NUM_THREADS="1"), "3000", "one thread waits for none")

    def test_wrong_geometry_is_refused_by_place(self):
        done = self.hydro(self.scene(zone_width_m="6e-3"), "--check", "--interface-law", "stick", code=1)
        self.assertRegex(done.stderr, r"cone\.toml:\d+:\d+: .*zone_width_m|zones of 0\.006 m")


if __name__ == "__main__":
    served.main()
