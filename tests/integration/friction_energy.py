"""The friction energy of nodes over a run (scenes with friction_energy = true): the sums of the ledger's heat of either body, bit by bit, through
trials, marks, absences, a killed server and a resumed session; refused where the ledger is."""
import pathlib
import signal
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
import shearbus  # noqa: E402
from served import EXAMPLES, OPTIONS  # noqa: E402

ONE_SIDED = (EXAMPLES / "softening_friction.toml").read_text(encoding="utf8")
TWO_SIDED = ONE_SIDED + '[hard_layer]\nthickness_m = 30e-6\n'
SUMS = ["friction_energy_soft", "friction_energy_hard"]
STEP = ["heat_to_soft", "heat_to_hard"]
WANTED = SUMS + STEP + ["interface_work", "plastic_work"]
IMPEDANCE = 1 / (1 / np.sqrt(2703 * 27.6e9) + 1 / np.sqrt(7900 * 77e9))


def summing(scene):
    return "friction_energy = true\n" + scene


class FrictionEnergy(served.Served):
    def setUp(self):
        super().setUp()
        self.serve()

    def serve(self):
        self.server = served.serve(self, self.log(), OPTIONS.server, "--bind", self.bus, "--threads", "1", "--state-dir", self.path / "state")

    def open(self, scene, nodes=(1, 2, 3), **more):
        return shearbus.open(scene, nodes=list(nodes), endpoint=self.bus, want=WANTED, check_closure="off", **more)

    def step(self, session, pressure=11.2e9, do="step", jump=100.0, **more):
        """A step of nodes whose host is two half-spaces; returns the sums and the heats, shape (2, nodes)."""
        nodes = len(more.get("nodes", session.nodes))
        pressures = pressure * np.linspace(1.0, 0.8, nodes)
        answer = getattr(session, do)(1e-9, jump=np.full(nodes, jump), pressure=pressures, impedance=np.full(nodes, IMPEDANCE),
                                      stick_stress=np.full(nodes, IMPEDANCE * jump), **more)
        value = lambda names: np.array([getattr(answer, name) for name in names])
        return value(SUMS), value(STEP), answer

    def test_they_are_the_sums_of_the_ledger(self):
        for scene in (ONE_SIDED, TWO_SIDED):
            with self.subTest(scene=scene[-40:]), self.open(summing(scene)) as session:
                expected, work = np.zeros((2, 3)), np.zeros(3)
                for _ in range(30):
                    sums, heats, answer = self.step(session)
                    expected += heats
                    work += answer.interface_work
                    self.assertTrue((sums == expected).all(), f"{sums} is not {expected}")
                np.testing.assert_allclose(sums.sum(0), work, rtol=1e-9)
                self.assertTrue((sums > 0).all())

    def test_shares_are_those_of_effusivities(self):
        b = np.array([117 / np.sqrt(48.9e-6), 16.1 / np.sqrt(4.076e-6)])
        with self.open(summing(ONE_SIDED)) as session:
            for _ in range(10):
                sums, _, _ = self.step(session)
            np.testing.assert_allclose(sums[0] / sums[1], b[0] / b[1], rtol=1e-9)
        # Where both bodies are resolved nothing is assumed, and the shares come out so: not 117 to 16.1, as conductivities are.
        with self.open(summing(TWO_SIDED)) as session:
            for _ in range(200):
                sums, _, _ = self.step(session)
            np.testing.assert_allclose(sums[0] / sums[1], b[0] / b[1], rtol=0.03)

    def test_trials_marks_and_absence(self):
        with self.open(summing(ONE_SIDED)) as session:
            before, _, _ = self.step(session)
            tried, heats, _ = self.step(session, do="trial")
            self.assertTrue((tried == before + heats).all())
            session.rollback()
            after, heats, _ = self.step(session)
            self.assertTrue((after == before + heats).all())
            session.mark("here")
            for _ in range(3):
                later, _, _ = self.step(session)
            session.rollback_to("here")
            again, heats, _ = self.step(session)
            self.assertTrue((again == after + heats).all() and (again < later).all())
            self.step(session, nodes=[2], absent_nodes="open")  # the others are open, and friction gives them nothing
            sums, heats, _ = self.step(session)
            self.assertTrue((sums[:, [0, 2]] == again[:, [0, 2]] + heats[:, [0, 2]]).all())
            self.assertTrue((sums[:, 1] > again[:, 1] + heats[:, 1]).all())
            held, heats, _ = self.step(session, pressure=-1.0)
            self.assertTrue((held == sums).all() and (heats == 0).all())

    def test_a_killed_server_and_a_successor_go_on(self):
        session = self.open(summing(ONE_SIDED))
        expected = np.zeros((2, 3))
        for _ in range(5):
            sums, heats, _ = self.step(session)
            expected += heats
        self.server.send_signal(signal.SIGKILL)
        self.server.wait()
        self.serve()
        sums, heats, _ = self.step(session)
        expected += heats
        self.assertTrue((sums == expected).all())
        ticket = session.ticket
        session.leave()
        with shearbus.resume(ticket, endpoint=self.bus, want=WANTED, check_closure="off") as session:
            sums, heats, _ = self.step(session)
            self.assertTrue((sums == expected + heats).all())
        said = self.server.text()
        self.assertNotIn(" opened by ", said, "the server before told it")
        self.assertIn(" resumed by ", said)

    def test_nodes_that_move_to_another_session_take_their_sums_along(self):
        with self.open(summing(ONE_SIDED), domain="run") as giver, self.open(summing(ONE_SIDED), nodes=(7,), domain="run") as taker:
            for _ in range(4):
                given, _, _ = self.step(giver)
                kept, _, _ = self.step(taker)
            self.assertEqual(list(taker.accept(giver.offer([3, 2]))), [3, 2])
            self.assertEqual((list(giver.nodes), list(taker.nodes)), ([1], [7, 3, 2]))
            sums, heats, _ = self.step(giver)
            self.assertTrue((sums == given[:, :1] + heats).all())
            sums, heats, _ = self.step(taker)
            self.assertTrue((sums == np.hstack([kept, given[:, [2, 1]]]) + heats).all())
            taker.retire([7])
            self.assertEqual(list(taker.nodes), [3, 2])

    def test_a_scene_without_the_key_has_no_sums(self):
        with self.assertRaisesRegex(shearbus.Error, "friction_energy"):
            with self.open(ONE_SIDED) as session:
                self.step(session)
        with shearbus.open(ONE_SIDED, nodes=[1], endpoint=self.bus) as plain, \
                shearbus.open(summing(ONE_SIDED), nodes=[1], endpoint=self.bus) as sums:
            self.assertEqual(sums.bytes_per_node - plain.bytes_per_node, 4 * 8)  # two values, committed and trial

    def test_refused_where_the_ledger_is(self):
        isothermal = ONE_SIDED.replace('far_boundary = "half_space"', 'far_boundary = "isothermal"')
        inertia = ('name = "i"\nstrategy = "velocity_driven"\n[soft]\nmaterial = "aluminium_dlp"\n[hard]\nmaterial = "steel_dlp"\n'
                   '[layer]\ncells = 50\ninertia = true\n')
        for scene in (isothermal, inertia):
            with self.assertRaisesRegex(shearbus.Error, "friction_energy sums the energy ledger"):
                shearbus.open(summing(scene), nodes=[1], endpoint=self.bus)


if __name__ == "__main__":
    served.main()
