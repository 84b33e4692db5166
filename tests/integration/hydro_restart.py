"""Kills the hydrocode, the server, or both at random moments and continues the runs. The results at the end must be, to the bit, those of a
run that was never interrupted."""
import os
import pathlib
import random
import re
import shutil
import signal
import subprocess
import sys
import time

import h5py
import numpy

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import OPTIONS, PROBLEMS

SEED = int(os.environ.get("SHEARBUS_SEED", "1"))
KILLS = int(os.environ.get("SHEARBUS_RESTART_KILLS", "4"))  # kills in each test


def with_profiles(scene):
    """Gives the layers cells in place of modes, and asks for profiles at some times. Law (5) has none of either."""
    text, found = re.subn(r'(?ms)^heat = "modes".*?^\[layer\.modes\].*?(?=^\[)', "cells = 30\ngrading = 1.2\n\n", scene.read_text())
    assert found == 1
    text = text.replace("[hydro]\n", '[hydro]\nlayer_start = "shocked"\n')
    scene.write_text(text + "\n[hydro.profiles]\nnode = [0, 7]\ntime_s = [4e-6, 0.5e-6, 1e-6, 1.5e-6, 2e-6]\n")


class Restart(served.Served):
    def setUp(self):
        super().setUp()
        self.random = random.Random(f"{SEED} {self.id()}")
        self.scene = served.edited(PROBLEMS / "cone_al_steel_coarse.toml", self.path / "cone.toml", zone_width_m=1e-3, end_time_s=5e-6)

    def start(self, *command):
        return served.program(self, *command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)

    def serve(self):
        return self.start(OPTIONS.server, "--bind", self.bus, "--state-dir", self.path / "state", "--log-level", "off")

    def undisturbed(self, *arguments):
        out = self.path / "undisturbed"
        self.run_program(OPTIONS.hydro, self.scene, "--out", out, "--no-plot", *arguments)
        return out

    def hydro(self, *arguments):
        out = self.path / "run"
        where = ("--restart", out) if list(out.glob("restart/dump-*.h5")) else (self.scene, "--out", out, *arguments)
        server = ("--server", self.bus) if "--server" in arguments else ()
        return out, self.start(OPTIONS.hydro, *where, *(server if where[0] == "--restart" else ()), "--no-plot", "--dump-every", 10)

    def wait_for_a_new_dump(self, out, process):
        """Waits for a new dump and a random time more, so that the kill falls anywhere in the steps or dumps that follow."""
        before = set(out.glob("restart/dump-*.h5"))
        served.until(self, lambda: set(out.glob("restart/dump-*.h5")) - before or process.poll() is not None, patience=60)
        time.sleep(self.random.uniform(0.0, 0.1))

    def finished(self, out, process, reference):
        printed, _ = process.communicate(timeout=300)
        self.assertEqual(process.returncode, 0, printed)
        self.assertFalse((out / "restart").exists())
        served.assert_same_run(self, out, reference)
        return printed

    def until_stopped(self, out, start, ready, how):
        """Starts runs until one gets the signal before its end, which it may reach first where this test waits long for a processor. Returns
        the ended process and what it printed."""
        for _ in range(10):
            process = start()
            ready(process)
            process.send_signal(how)
            printed, _ = process.communicate(timeout=60)
            if process.returncode != 0 and ((out / "restart").exists() or how != signal.SIGKILL):
                return process, printed
            self.assertIn(process.returncode, (0, -signal.SIGKILL), printed)
            shutil.rmtree(out)
        return self.fail("every run ended before the signal")

    def interrupted(self, out, how, code, *command):
        """Sends a signal to a run that has begun. Returns what it printed."""

        def begun(process):
            served.until(self, lambda: (out / "fields.xmf").exists() or process.poll() is not None)

        process, printed = self.until_stopped(out, lambda: self.start(*command), begun, how)
        self.assertEqual(process.returncode, code, printed)
        return printed

    def killed(self, *arguments, dumps=1):
        """Returns the directory of a run that was killed when it, begun or gone on with, had written this many dumps."""
        out = self.path / "run"

        def ready(process):
            for _ in range(dumps):
                self.wait_for_a_new_dump(out, process)

        process, printed = self.until_stopped(out, lambda: self.hydro(*arguments)[1], ready, signal.SIGKILL)
        self.assertEqual(process.returncode, -signal.SIGKILL, printed)
        return out

    def ended_anyhow(self, out, reference, *arguments):
        """Goes on with a killed run, unless it was killed behind its end."""
        if (out / "restart").exists():
            self.finished(*self.hydro(*arguments), reference)
        else:
            served.assert_same_run(self, out, reference)

    def killed_again_and_again(self, *arguments):
        reference = self.undisturbed(*(a for a in arguments if a not in ("--server", self.bus)))
        for _ in range(KILLS):
            out = self.killed(*arguments)
        self.ended_anyhow(out, reference, *arguments)

    def test_local_law(self):
        self.killed_again_and_again("--interface-law", "coulomb_tresca")

    def test_server_in_the_process(self):
        with_profiles(self.scene)
        self.killed_again_and_again()
        with h5py.File(self.path / "run/interface.h5") as file:
            profiles = file["profiles"]
            numpy.testing.assert_allclose(profiles["time"], [0.5e-6, 1e-6, 1.5e-6, 2e-6, 4e-6], atol=8e-8)
            self.assertEqual(profiles["layer_temperature"].shape, (5, 2, profiles["position"].shape[0]))
            self.assertGreater(profiles["layer_temperature"][-1, 1, 0], 320.0)

    def test_plastic_layers_whose_thickness_follows_from_the_zones(self):
        served.edited(PROBLEMS / "cone_al_steel.toml", self.scene, zone_width_m=1e-3, end_time_s=3e-6)
        self.killed_again_and_again()

    def test_hydro_killed_beside_a_server(self):
        self.serve()
        self.killed_again_and_again("--server", self.bus)

    def test_server_killed_under_a_hydro(self):
        reference = self.undisturbed()
        server = self.serve()
        out, process = self.hydro("--server", self.bus)
        for _ in range(KILLS):
            self.wait_for_a_new_dump(out, process)
            server.kill()
            server.wait()
            time.sleep(self.random.uniform(0.0, 0.2))
            server = self.serve()
        self.finished(out, process, reference)

    def test_both_killed(self):
        reference = self.undisturbed()
        for _ in range(KILLS):
            server = self.serve()
            out, process = self.hydro("--server", self.bus)
            self.wait_for_a_new_dump(out, process)
            for victim in self.random.sample([server, process], 2):
                victim.kill()
                victim.wait()
        self.serve()
        self.ended_anyhow(out, reference, "--server", self.bus)

    def test_interrupted_run_says_how_to_go_on(self):
        reference = self.undisturbed("--interface-law", "coulomb_tresca")
        out = self.path / "run"
        printed = self.interrupted(out, signal.SIGINT, 3, OPTIONS.hydro, self.scene, "--out", out, "--no-plot", "--interface-law", "coulomb_tresca")
        self.assertIn(f"go on with: shearbus-hydro --restart {out}", printed)
        self.assertFalse((out / "interface.h5").exists())
        self.assertFalse(list(out.rglob("*.partial")))
        self.refused(OPTIONS.hydro, self.scene, "--out", out, "--no-plot", "--interface-law", "coulomb_tresca",
                     said="holds restart dumps of a run that was stopped")
        self.finished(out, self.start(OPTIONS.hydro, "--restart", out, "--no-plot"), reference)

    def test_layers_that_end_with_the_process_are_not_dumped(self):
        out = self.path / "run"
        printed = self.interrupted(out, signal.SIGTERM, 1, OPTIONS.hydro, self.scene, "--out", out, "--no-plot")
        self.assertIn("no restart dump: the layers live in this process", printed)

    def test_damaged_dump_gives_way_to_the_one_before(self):
        reference = self.undisturbed("--interface-law", "coulomb_tresca")
        out = self.killed("--interface-law", "coulomb_tresca", dumps=2)
        dumps = sorted(out.glob("restart/dump-*.h5"))
        self.assertGreaterEqual(len(dumps), 2)  # three if the kill came between writing a dump and removing the oldest
        bytes_ = bytearray(dumps[-1].read_bytes())
        with h5py.File(dumps[-1]) as f:
            place = f["numbers/cycle/velocity"].id.get_chunk_info(0).byte_offset
        bytes_[place + 1001] ^= 4
        dumps[-1].write_bytes(bytes_)
        process = self.start(OPTIONS.hydro, "--restart", out, "--no-plot")
        printed, _ = process.communicate(timeout=60)
        self.assertIn("a restart dump is damaged", printed)
        self.assertEqual(process.returncode, 0, printed)
        served.assert_same_run(self, out, reference)

    def test_killed_after_its_results_were_whole(self):
        """Kills a run before it closes its session, and at the removal of its only dump, when the session is closed."""
        if subprocess.run(["strace", "-o", "/dev/null", "true"], check=False, capture_output=True).returncode != 0:
            self.skipTest("strace is not installed or may not trace")
        reference = self.undisturbed()
        self.serve()
        for place, file, call in (("before", "ended", "close"), ("after", "dump-000000000050.h5", "unlink")):
            for server in ((), ("--server", self.bus)):
                with self.subTest(place=place, server=server):
                    out = self.path / f"{place}-{len(server)}"
                    killed = self.start("strace", "-f", "-o", "/dev/null", "-P", out / "restart" / file, "-e", f"inject={call}:signal=KILL",
                                        OPTIONS.hydro, self.scene, "--out", out, *server, "--no-plot", "--dump-every", 50)
                    printed, _ = killed.communicate(timeout=300)
                    self.assertEqual(killed.returncode, -signal.SIGKILL, printed)
                    said = "the run had ended, and its results are whole"
                    self.assertIn(said, self.run_program(OPTIONS.hydro, "--restart", out, "--check").stdout)
                    self.assertTrue((out / "restart/dump-000000000050.h5").exists())
                    self.assertIn(said, self.finished(out, self.start(OPTIONS.hydro, "--restart", out, "--no-plot"), reference))
        sessions = self.run_program(OPTIONS.ctl, "sessions", "--server", self.bus).stdout
        self.assertEqual(len(sessions.splitlines()), 1, sessions)  # the heading

    def test_a_run_that_is_killed_as_it_removes_results_leaves_none_that_look_whole(self):
        if subprocess.run(["strace", "-o", "/dev/null", "true"], check=False, capture_output=True).returncode != 0:
            self.skipTest("strace is not installed or may not trace")
        whole = self.undisturbed()
        for name in ("interface.h5", "free_surface.h5", "fields/00000.h5", "fields.xmf"):
            with self.subTest(name):
                out = shutil.copytree(whole, self.path / name.replace("/", "-"))
                killed = self.start("strace", "-f", "-o", "/dev/null", "-P", out / name, "-e", "inject=unlink,unlinkat:signal=KILL", OPTIONS.hydro, self.scene, "--out", out, "--no-plot")
                printed, _ = killed.communicate(timeout=300)
                self.assertEqual(killed.returncode, -signal.SIGKILL, printed)
                self.assertFalse((out / "summary.json").exists())

    def interrupted_while_its_server_is_away(self, away, back):
        """Interrupts a run whose server has been sent `away`. After 3 s, in which it waits, back(server, process) is called. Returns the directory
        of the run, its ended process, what it printed and the dumps before. A run that ends earlier is begun anew."""
        for _ in range(10):
            server = self.serve()
            out, process = self.hydro("--server", self.bus)
            self.wait_for_a_new_dump(out, process)
            server.send_signal(away)
            time.sleep(0.5)
            before = set(out.glob("restart/dump-*.h5"))
            process.send_signal(signal.SIGINT)
            time.sleep(3.0)
            waited = process.poll() is None
            back(server, process)
            printed, _ = process.communicate(timeout=60)
            if waited and process.returncode != 0:
                return out, process, printed, before
            server.kill()
            server.wait()
            shutil.rmtree(out)
            shutil.rmtree(self.path / "state")
        self.fail("every run ended before its server went away")

    def test_an_interrupted_run_waits_for_a_slow_server_and_writes_its_dump(self):
        served.edited(self.scene, self.scene, zone_width_m=0.5e-3)
        reference = self.undisturbed()
        out, process, printed, before = self.interrupted_while_its_server_is_away(signal.SIGSTOP, lambda server, process: server.send_signal(signal.SIGCONT))
        self.assertEqual(process.returncode, 3, printed)
        self.assertIn(f"go on with: shearbus-hydro --restart {out}", printed)
        self.assertTrue(set(out.glob("restart/dump-*.h5")) - before, printed)
        self.finished(*self.hydro("--server", self.bus), reference)

    def test_a_second_interrupt_ends_the_wait_for_a_server_that_is_gone(self):
        served.edited(self.scene, self.scene, zone_width_m=0.5e-3)
        _, process, printed, _ = self.interrupted_while_its_server_is_away(signal.SIGKILL, lambda server, process: process.send_signal(signal.SIGTERM))
        self.assertEqual(process.returncode, 3, printed)
        self.assertIn("shearbus-hydro: interrupted; waits for the server; another interrupt ends the run at once\n", printed)
        self.assertRegex(printed, r"shearbus-hydro: interrupted in step \d+, to [\d.e-]+ s, while the server did not answer; shearbus-hydro --restart goes on from the newest dump\n")

    def test_commands_to_go_on_are_as_a_shell_reads_them(self):
        out = self.path / "my run"
        printed = self.interrupted(out, signal.SIGINT, 3, OPTIONS.hydro, self.scene, "--out", out, "--interface-law", "coulomb_tresca", "--no-plot")
        self.assertIn(f"go on with: shearbus-hydro --restart '{out}'\n", printed)
        self.refused(OPTIONS.hydro, self.scene, "--out", out, said=f"Go on with it (--restart '{out}')")

    def test_restart_of_nothing(self):
        self.refused(OPTIONS.hydro, "--restart", self.path / "none", said="holds no restart dump")
        self.run_program(OPTIONS.hydro, "--restart", self.path, self.scene, code=2)

    def test_session_that_is_gone(self):
        server = self.serve()
        self.killed("--server", self.bus)
        server.kill()
        server.wait()
        shutil.rmtree(self.path / "state")
        self.serve()
        out, process = self.hydro("--server", self.bus)
        printed, _ = process.communicate(timeout=60)
        self.assertEqual(process.returncode, 1, printed)
        self.assertIn("UNKNOWN_SESSION", printed)


if __name__ == "__main__":
    served.main()
