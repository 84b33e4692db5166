"""Tests of client/report/plot_options.py: the scenes that show the options run by its one command, and show what their comments say."""
import pathlib
import subprocess
import sys
import tempfile
import unittest

import h5py
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import OPTIONS

ASLEEP = 32  # bit of /outcome


class OptionScenes(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        cls.out = pathlib.Path(cls.scratch.name)
        programs = cls.out / "bin"
        programs.mkdir()
        for name in ("replay", "hydro"):
            (programs / f"shearbus-{name}").symlink_to(getattr(OPTIONS, name))
        cls.done = subprocess.run([sys.executable, "-B", served.SOURCE / "client/report/plot_options.py", "--bin", programs, "--out", cls.out, "--keep", cls.out / "kept"],
                                  capture_output=True, text=True, timeout=600)

    @classmethod
    def tearDownClass(cls):
        cls.scratch.cleanup()

    def result(self, name):
        self.assertEqual(self.done.returncode, 0, self.done.stderr)
        with h5py.File(self.out / f"kept/{name}.h5") as file:
            return {key: data[:] for key, data in file.items() if isinstance(data, h5py.Dataset)}

    def test_pictures_stay_small(self):
        self.assertEqual(self.done.returncode, 0, self.done.stderr)
        for name in ("layer", "heat", "contact", "friction"):
            self.assertLess((self.out / f"options_{name}.png").stat().st_size, 60_000)

    def test_sliding_between_baths_becomes_that_of_steady_conduction(self):
        found = self.result("steady_sliding")
        mu, slope, conductivity, thickness, melting = 0.1, 1e-3, 16.2, 2e-6, 2380.0
        rows, values = [300.0, 400.0, 600.0, 800.0, 1000.0, 1200.0, 1500.0, 2500.0], [14.9, 16.6, 19.8, 22.6, 25.4, 28.0, 31.7, 31.7]
        T = np.linspace(300.0, 2300.0, 200001)
        k = np.interp(T, rows, values) + conductivity * (1.0 + slope * (T - 300.0))
        carried = np.concatenate(([0.0], np.cumsum(0.5 * (k[1:] + k[:-1]) * np.diff(T)))) / thickness
        for i, v in enumerate(found["sliding_velocity"][-1]):
            # mu (1 - (T0 - 300 K) / (T_melt - 300 K)) P v is what both bodies carry
            rise = T[np.argmax(carried >= mu * (1.0 - (T - 300.0) / (melting - 300.0)) * 1e9 * v)] - 300.0
            self.assertAlmostEqual(found["interface_temperature"][-1, i] - 300.0, rise, delta=2e-3 * rise)

    def test_a_wave_crosses_the_layer_and_is_the_impedance_times_the_jump(self):
        found = self.result("sudden_start")
        soft = np.sqrt(2703.0 * 27.6e9)
        early = found["time"] < 5e-9
        self.assertAlmostEqual(np.median(found["shear_stress"][early]) / (soft * 20.0), 1.0, delta=0.01)

    def test_waves_between_two_plates_climb_to_the_friction_that_stops_them(self):
        found, without = self.result("plates_with_waves"), self.result("plates_with_waves-layer.inertia=false")
        jump, friction = np.array([1.25, 2.5, 3.75, 5.0]), 0.2 * 0.5e9
        early = found["time"] < 5e-9
        np.testing.assert_allclose(np.median(found["shear_stress"][early], axis=0), np.sqrt(2703.0 * 27.6e9) * jump, rtol=0.01)
        self.assertAlmostEqual(without["shear_stress"][0, 3] / friction, 1.0, delta=1e-9)
        self.assertAlmostEqual(found["shear_stress"][:, 3].max() / friction, 1.0, delta=1e-9)
        # both stop: the impulse of friction is the momentum that the plates exchange
        mass = 1.0 / (1.0 / (2703.0 * 1e-3) + 1.0 / (7900.0 * 1e-3))
        impulse = 1e-10 * np.cumsum(found["shear_stress"], axis=0)
        np.testing.assert_allclose(found["velocity_jump_new"], jump - impulse / mass, rtol=0, atol=1e-9)
        self.assertLess(np.abs(found["velocity_jump_new"][-100:, 3]).max(), 0.5)

    def test_the_jump_does_the_work_that_heats_and_what_the_waves_keep(self):
        found = self.result("paper_section_4")
        heat, work = found["friction_heat"][:, 0].sum(), (found["shear_stress"][:, 0] * 100.0 * 2e-10).sum()
        self.assertLess(heat, work)
        self.assertGreater(heat, 0.85 * work)

    def test_the_stress_follows_the_sliding_and_the_open_contact_sleeps(self):
        found = self.result("turning_contact")
        stress = np.hypot(found["shear_stress"][:, 0], found["shear_stress_second"][:, 0])
        slides = found["regime"][:, 0] == 2
        np.testing.assert_allclose(stress[slides], 0.3 * found["pressure"][slides, 0], rtol=1e-9)
        self.assertGreater(((found["outcome"][:, 0] & ASLEEP) > 0).sum(), 100)
        self.assertTrue((stress[found["regime"][:, 0] == 0] == 0).all())

    def test_plates_that_brake_each_other_stop_within_the_tolerance(self):
        found = self.result("brake")
        jump = found["velocity_jump_new"]
        self.assertTrue((jump[-1] == 0.0).all())
        # m [V]' = -(mu_inf + (mu_0 - mu_inf) exp(-theta [V])) P has the time of stop ln((mu_inf exp(theta V0) + d) / (mu_inf + d)) m / (mu_inf P theta)
        mass = 1.0 / (1.0 / (2703.0 * 1e-3) + 1.0 / (7900.0 * 1e-3))
        for i, v in enumerate((15.0, 30.0, 45.0, 60.0)):
            stop = np.log((0.1 * np.exp(0.1 * v) + 0.2) / 0.3) * mass / (0.1 * 0.2e9 * 0.1)
            self.assertAlmostEqual(found["time"][np.flatnonzero(jump[:, i] == 0.0)[0]] / stop, 1.0, delta=0.02)

    def test_pressure_raises_the_stress_of_an_interface_that_melts(self):
        with_pressure, without = self.result("under_pressure"), self.result("under_pressure-soft.melting_curve=constant-soft.pressure_term=linear")
        self.assertTrue((np.diff(with_pressure["shear_stress"][-1]) > 0).all())
        self.assertTrue((np.diff(without["shear_stress"][-1, 3:]) < 0).all())

    def test_friction_follows_the_pressure_along_the_slip(self):
        found = self.result("pressure_memory")
        known, length, creep, dt = np.zeros(4), 1e-6, 1.0, 1e-9
        for slip, pressure, stress in zip(found["sliding_velocity"], found["pressure"], found["shear_stress"]):
            known = pressure + (known - pressure) * np.exp(-(slip + creep) * dt / length)
            np.testing.assert_allclose(stress, 0.1 * known, rtol=1e-9)
        self.assertGreater(stress[3], 0.99e8)

    def test_a_layer_slides_under_steady_rate_and_state_friction(self):
        mu, a, b, pressure = 0.1, 0.005, 0.008, 0.5e9
        for name in ("rate_and_state", "rate_and_state-interface.state_evolution=slip"):
            stress = self.result(name)["shear_stress"][:, 0]
            for step, v in ((499, 1.0), (999, 10.0)):
                steady = pressure * a * np.arcsinh(0.5 * v * np.exp((mu - b * np.log(v)) / a))
                self.assertAlmostEqual(stress[step] / steady, 1.0, delta=5e-3)
            self.assertGreater(stress[500:600].max() - stress[499], 0.5 * a * np.log(10.0) * pressure)

    def test_copper_knows_its_rate(self):
        ptw = self.result("copper_rates")["shear_stress"].max(axis=0)
        self.assertTrue((np.diff(ptw[1:]) > 0).all())


if __name__ == "__main__":
    served.main()
