"""A friction law of the user's own: compiled against the header of the package, loaded by the administrator of a server, named
in a scene, in both strategies. Laws that break their word fail their nodes, and the server lives."""
import pathlib
import shutil
import subprocess
import sys
import tempfile

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
import shearbus
from served import OPTIONS, SOURCE

# Bad laws in C++, by name: what limit() does where the pressure is above 200 MPa.
BAD = {"throws": "throw 1;", "no_number": "return 0.0 / 0.0 * point->slip;", "negative": "return -1.0;",
       "not_monotone": "return mu * (point->slip < 1.0 ? 1.0 : 0.5);"}
BAD_LAW = """#include <shearbus/friction_law.h>
static double limit(const shearbus_contact_point* point) {
  const double mu = point->friction_coefficient * point->pressure;
  if (point->pressure > 2e8) { %s }
  return mu;
}
extern "C" const shearbus_friction_law shearbus_friction_law_of_library;
const shearbus_friction_law shearbus_friction_law_of_library = {SHEARBUS_FRICTION_LAW_VERSION, 0, SHEARBUS_CONSTANT, SHEARBUS_CONSTANT, 0, limit, nullptr};
"""


def scene(law, strategy="force_driven"):
    strength = {"yield_strength_pa": 10e9} if strategy == "force_driven" else {}
    return served.scene(strategy, layer={"cells": 20, "grading": 1.2, "far_boundary": "half_space"},
                        interface={"friction_coefficient": 0.1, **strength, "friction_law": f"own:{law}"})


class OwnFrictionLaw(served.Served):
    @classmethod
    def setUpClass(cls):
        scratch = tempfile.TemporaryDirectory(prefix="shearbus-own-")
        cls.addClassCleanup(scratch.cleanup)
        path = pathlib.Path(scratch.name)
        (path / "include/shearbus").mkdir(parents=True)  # where the package puts the header
        shutil.copy(SOURCE / "server/physics/interface/friction_law.h", path / "include/shearbus")
        cls.include = path / "include"
        include = f"-I{cls.include}"
        cls.laws = ["--friction-law", f"slip_weakening={path / 'good.so'}"]
        subprocess.run(["cc", "-shared", "-fPIC", "-Wall", "-Wextra", "-Werror", include, "-o", path / "good.so", served.EXAMPLES / "friction_law.c"], check=True)
        for name, body in BAD.items():
            (path / f"{name}.cpp").write_text(BAD_LAW % body)
            subprocess.run(["c++", "-shared", "-fPIC", "-Werror", include, "-o", path / f"{name}.so", path / f"{name}.cpp"], check=True)
            cls.laws += ["--friction-law", f"{name}={path / name}.so"]

    def setUp(self):
        super().setUp()
        self.server = served.serve(self, self.log(), OPTIONS.server, "--bind", self.bus, *self.laws)

    def open(self, text, nodes=4, **options):
        session = shearbus.open(text, nodes=range(nodes), endpoint=self.bus, reply_deadline=60.0, **options)
        self.addCleanup(session.leave)
        return session

    def forced(self, session, pressure):
        n = len(pressure)
        return session.step(1e-9, jump=np.full(n, 10.0), pressure=pressure, stress_soft=np.zeros(n), stress_hard=np.zeros(n),
                            mass_soft=np.full(n, 1e9), mass_hard=np.full(n, 1e9))

    def test_the_example_weakens_along_its_slip(self):
        session = self.open(scene("slip_weakening"))
        for step in range(1, 151):
            answer = self.forced(session, np.full(4, 1e8))
            expected = 0.1 * 1e8 * (1 - 0.5 * min(1.0, step * 1e-8 / 1e-6))
            np.testing.assert_allclose(answer.stress, expected, rtol=1e-9)

    def test_the_example_is_solved_velocity_driven(self):
        session = self.open(scene("slip_weakening", "velocity_driven"))
        for _ in range(300):
            answer = session.step(1e-9, jump=np.full(4, 20.0), pressure=np.full(4, 1e8))
        np.testing.assert_allclose(answer.stress, 0.05 * 1e8, rtol=1e-7)

    def test_a_law_that_breaks_its_word_fails_its_node_and_the_server_lives(self):
        for name in BAD:
            with self.subTest(name):
                session = self.open(scene(name))
                self.forced(session, np.full(4, 1e8))
                pressure = np.array([1e8, 3e8, 1e8, 1e8])
                answer = self.forced(session, pressure)
                failed = (np.asarray(answer.outcome) & int(shearbus.Outcome.FAILED)) != 0
                if name != "not_monotone":  # that law breaks its word where the slip is about 1 m/s
                    self.assertEqual(failed.tolist(), [False, True, False, False])
                np.testing.assert_allclose(answer.stress[[0, 2, 3]], 1e7, rtol=1e-9)
                self.assertIsNone(self.server.poll())

    def test_a_law_that_is_not_loaded_is_refused_with_a_remedy(self):
        with self.assertRaises(shearbus.Error) as refused:
            self.open(scene("nobody"))
        self.assertIn("own:nobody", str(refused.exception))
        self.assertIn("--friction-law NAME=", str(refused.exception))
        self.assertIsNone(self.server.poll())

    def test_a_replay_takes_a_law_of_its_own(self):
        bus = f"ipc://{self.path}/durable"
        durable = served.serve(self, self.path / "durable.log", OPTIONS.server, "--bind", bus, "--state-dir", self.path / "state", *self.laws)
        with shearbus.open(scene("negative"), nodes=range(4), endpoint=bus) as session:
            self.forced(session, np.full(4, 1e8))
            self.forced(session, np.array([1e8, 3e8, 1e8, 1e8]))
        (capsule,) = (self.path / "state").glob("capsule-*")
        own = ("--friction-law", next(law for law in self.laws if law.startswith("negative=")))
        self.refused(OPTIONS.replay, "--capsule", capsule, said="--friction-law NAME=/path/library.so")
        self.assertIn("the same answer, to the last bit", self.run_program(OPTIONS.replay, "--capsule", capsule, *own).stdout)
        self.refused(OPTIONS.replay, "--capsule", capsule, "--server", bus, said="--capsule excludes --server", code=2)
        durable.kill()
        durable.wait()
        errors = self.refused(OPTIONS.server, "--bind", bus, "--state-dir", self.path / "state", said="Start the server with the options that it had")
        self.assertNotIn("--accept-empty", errors)

    def test_a_law_that_crashes_names_the_session_to_be_dropped(self):
        state, bus = self.path / "crash", f"ipc://{self.path}/crashes"
        (self.path / "crash.cpp").write_text(BAD_LAW % "__builtin_trap();")
        subprocess.run(["c++", "-shared", "-fPIC", f"-I{self.include}", "-o", self.path / "crash.so", self.path / "crash.cpp"], check=True)
        command = (OPTIONS.server, "--bind", bus, "--state-dir", state, "--friction-law", f"crash={self.path / 'crash.so'}", *self.laws)
        server = served.serve(self, self.path / "crash.log", *command)
        session, other = (shearbus.open(scene(law), nodes=range(4), endpoint=bus, reply_deadline=0.5) for law in ("crash", "slip_weakening"))
        self.forced(other, np.full(4, 1e8))
        with self.assertRaises(shearbus.Error):
            self.forced(session, np.full(4, 3e8))
        self.assertLess(server.wait(), 0)
        again = subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=served.PATIENCE_S)
        self.assertLess(again.returncode, 0)
        drop = f"--drop-session {session.ticket[:8]}"
        self.assertIn(drop, again.stderr)
        server = served.serve(self, self.path / "crash.log", *command, *drop.split())
        self.forced(other, np.full(4, 1e8))
        other.close()
        session.leave()

    def test_a_library_without_a_law_stops_the_start(self):
        for given, told, code in ((f"x={self.path}/none.so", "none.so", 1), ("x", "NAME=FILE", 2),
                                  ("x=libm.so.6", "shearbus_friction_law_of_library", 1)):
            self.refused(OPTIONS.server, "--bind", f"ipc://{self.path}/other", "--friction-law", given, said=told, code=code)
        other = next(word for word in self.laws if word.endswith(".so") and not word.startswith("slip_weakening="))
        self.refused(OPTIONS.server, "--bind", f"ipc://{self.path}/other", *self.laws[:2], "--friction-law", f"slip_weakening={other.split('=')[1]}",
                     said="another law has that name")


if __name__ == "__main__":
    served.main()
