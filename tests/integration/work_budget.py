"""A server in the way of one request that needs very much work: the others are answered meanwhile, it can be stopped,
and a start that finds the request in the journal can be stopped, too, tells how far it is, and can leave its session
out."""
import pathlib
import signal
import subprocess
import sys
import threading
import time

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
import shearbus  # noqa: E402
from served import OPTIONS  # noqa: E402

BODIES = '[soft]\nmaterial = "copper_ofhc_jc"\n[hard]\nmaterial = "steel_dlp"\n[layer]\nfar_boundary = "half_space"\n'
HARD_WORK = 'name = "hard work"\nstrategy = "velocity_driven"\ntolerance = 1e-6\n'
PLAIN = served.scene("velocity_driven")
OVER_BUDGET = shearbus.Outcome.FAILED | shearbus.Outcome.OVER_BUDGET
PATIENCE_S = 20.0  # far more than an answer takes on a machine that others use, far less than the work of the step
NODES = 300
DT = 1e-6


def step(session, nodes, dt=DT):
    return session.step(dt, jump=np.linspace(100.0, 300.0, nodes), pressure=np.full(nodes, 5e9))


class Work(served.Served):
    def serve(self, *arguments, durable=True, ready="listening on"):
        state = ["--state-dir", self.path / "state"] if durable else []
        return served.serve(self, self.log(), OPTIONS.server, "--bind", self.bus, "--threads", "1", *state, *arguments, ready=ready)

    def until(self, holds, server):
        served.until(self, holds, server, PATIENCE_S)

    def open(self, scene, nodes, **options):
        session = shearbus.open(scene, nodes=nodes, endpoint=self.bus, **{"reply_deadline": PATIENCE_S, **options})
        self.addCleanup(session.leave)
        return session

    def ask_much(self):
        """Opens a session and leaves a step of very much work with the server. Returns the session."""
        session = shearbus.open(HARD_WORK + BODIES, nodes=range(NODES), endpoint=self.bus, reply_deadline=3600,
                                retry_after=3600)

        def ask():
            try:
                step(session, NODES)
            except shearbus.Error:
                pass
        threading.Thread(target=ask, daemon=True).start()
        return session

    def asked_much(self, server):
        """Starts the step and waits until the server has begun it."""
        before = self.journaled()
        session = self.ask_much()
        self.until(lambda: self.journaled() > before + NODES * 16, server)
        return session

    def journaled(self):
        return sum(file.stat().st_size for file in (self.path / "state").glob("journal-*.log"))

    def stop(self, server, number=signal.SIGTERM):
        server.send_signal(number)
        return server.wait(timeout=PATIENCE_S)

    def ctl(self, *arguments):
        return subprocess.run([OPTIONS.ctl, *arguments, "--server", self.bus], capture_output=True, text=True,
                              timeout=60, check=False)

    def test_a_node_beyond_its_budget_has_no_answer_and_the_same_bits_in_any_batch(self):
        self.serve(durable=False)
        scene = HARD_WORK + "work_budget = 2e6\n" + BODIES
        together = self.open(scene, range(12))
        jump = np.where(np.arange(12) % 3 == 0, 0.0, np.linspace(50.0, 400.0, 12))
        pressure = np.where(np.arange(12) % 3 == 0, -1.0, 5e9)
        whole = together.step(DT, jump=jump, pressure=pressure)
        self.assertEqual(set(whole.outcome[1::3]) | set(whole.outcome[2::3]), {OVER_BUDGET})
        self.assertFalse(np.any(whole.outcome[::3] & shearbus.Outcome.FAILED), "an open contact needs little work")
        self.assertTrue(np.all(whole.temperature == 300.0), "the states are kept")
        self.assertTrue(np.all(whole.slip[1::3] == 0.0))
        alone = self.open(scene, range(12))
        for node in range(12):
            one = alone.step(DT, nodes=[node], jump=jump[node:node + 1], pressure=pressure[node:node + 1])
            for column in ("stress", "slip", "temperature", "friction_heat", "regime", "outcome"):
                self.assertEqual(getattr(one, column).tobytes(), getattr(whole, column)[node:node + 1].tobytes())
        # The law is of first order, and the tolerance holds the heat of the rise of the stress, too: slowly.
        shorter = together.step(1e-12, jump=0.01 * jump, pressure=pressure)
        self.assertFalse(np.any(shorter.outcome & shearbus.Outcome.FAILED), "a shorter, slower step needs less work")

    def test_all_or_nothing_refuses_a_step_beyond_the_budget(self):
        self.serve(durable=False)
        session = self.open(HARD_WORK + "work_budget = 2e6\n" + BODIES, range(2))
        with self.assertRaises(shearbus.Error) as fault:
            session.step(DT, jump=np.full(2, 200.0), pressure=np.full(2, 5e9), all_or_nothing=True)
        self.assertEqual(fault.exception.code, shearbus.Code.STEP_FAILED)
        self.assertIn("work_budget", str(fault.exception))

    def test_a_scene_may_not_ask_for_more_than_the_server_grants(self):
        self.serve(durable=False)
        with self.assertRaises(shearbus.Error) as fault:
            self.open(HARD_WORK + "work_budget = 1e13\n" + BODIES, [1])
        self.assertEqual(fault.exception.code, shearbus.Code.LIMIT)
        self.assertIn("--max-work-budget", str(fault.exception))
        with self.assertRaises(shearbus.Error) as fault:
            self.open('work_budget = 1e6\n' + PLAIN, [1])
        self.assertIn("tolerance", str(fault.exception))

    def test_the_budget_of_a_session_outlives_a_start_with_other_options(self):
        server = self.serve("--max-work-budget", "1e12")
        session = self.open(HARD_WORK + "work_budget = 5e11\n" + BODIES, [1])
        first = session.step(1e-12, jump=[200.0], pressure=[5e9])
        self.stop(server, signal.SIGKILL)
        server = self.serve()
        again = session.step(1e-12, jump=[200.0], pressure=[5e9])
        self.assertNotEqual(first.temperature[0], again.temperature[0])
        self.assertRegex(str(session.scene), r"work_budget = 5(e11|e\+11|00000000000)")

    def test_others_are_answered_while_a_step_of_much_work_is_computed(self):
        server = self.serve()
        other = self.open(PLAIN, range(100))
        step(other, 100, 1e-9)
        much = self.asked_much(server)
        longest = 0.0
        for _ in range(20):
            begun = time.monotonic()
            step(other, 100, 1e-9)
            longest = max(longest, time.monotonic() - begun)
        print(f"longest answer to another session while 300 nodes need minutes: {longest:.3f} s")
        self.assertLess(longest, 5.0)
        self.assertIn("300", self.ctl("sessions").stdout)
        begun = time.monotonic()
        self.assertEqual(self.stop(server), 0)
        self.assertLess(time.monotonic() - begun, PATIENCE_S)
        self.assertIsNotNone(much)

    def test_a_recovery_tells_how_far_it_is_and_can_be_stopped_and_a_session_left_out(self):
        server = self.serve()
        other = self.open(PLAIN, range(10))
        reference = [step(other, 10, 1e-9)]
        much = self.asked_much(server)
        reference.append(step(other, 10, 1e-9))
        sick = much.ticket[:32]
        self.stop(server, signal.SIGKILL)

        server = self.serve(ready="recovering: ")
        self.assertIn("of session " + sick[:8], server.text())
        told = self.ctl("status")
        self.assertNotEqual(told.returncode, 0)
        self.assertIn("RECOVERING", told.stderr)
        self.assertIn("%", told.stderr)
        self.assertEqual(self.stop(server), 0)
        self.assertIn("stopped during the recovery", server.text())

        server = self.serve("--drop-session", sick)
        self.assertIn("dropped: ", server.text())
        self.assertTrue(list((self.path / "state").glob("dropped-*")), "what is dropped is set aside")
        third = step(other, 10, 1e-9)
        self.stop(server, signal.SIGKILL)
        server = self.serve()
        self.assertNotIn("300", self.ctl("sessions").stdout)
        fourth = step(other, 10, 1e-9)

        self.serve_twin(reference + [third, fourth])

    def serve_twin(self, answers):
        """The same steps on a server to which nothing happens have the same bits."""
        self.bus = "ipc://" + str(self.path / "twin")
        self.serve(durable=False)
        twin = self.open(PLAIN, range(10))
        for answer in answers:
            same = step(twin, 10, 1e-9)
            for column in ("stress", "slip", "temperature"):
                self.assertEqual(getattr(same, column).tobytes(), getattr(answer, column).tobytes())


if __name__ == "__main__":
    served.main()
