"""What every program writes, where nothing more can be written: one line, exit code 1, and no file that looks whole.
A limit of the size of files stands for a full disk: the same calls fail at the same places, without a disk of its own."""
import os
import signal
import stat
import subprocess
import time
import unittest

import replay_support as support
import served
from served import OPTIONS

PROBLEMS = support.PROBLEMS


class Programs(support.ReplayTest):
    def limited(self, size, program, *arguments):
        """Runs a program whose files have at most `size` bytes."""
        return self.ran(program, *arguments, preexec_fn=served.file_limit(size))

    def assert_refused(self, run, *names):
        self.assertEqual(run.returncode, 1, run.stderr)
        lines = [line for line in run.stderr.splitlines() if "warning" not in line and ": note: " not in line]
        self.assertEqual(len(lines), 1, run.stderr)
        self.assertRegex(lines[0], "File too large|No space left|could not be written|cannot write|cannot be written")
        for name in names:
            self.assertIn(name, lines[0])

    def files(self, directory):
        return [file.name for file in directory.rglob("*") if file.is_file()]


class Outputs(Programs):
    def test_a_replay_leaves_no_result(self):
        self.write(**support.velocity_history(steps=300, nodes=20))
        arguments = (self.history, "--scene", support.EXAMPLES / "paper_velocity_driven_graded.toml", "--out", self.out)
        run = self.ran("replay", *arguments)
        self.assertEqual(run.returncode, 0, run.stderr)
        whole = self.out.stat().st_size
        self.out.unlink()
        history = self.history.stat().st_size
        for share in (0.0, 0.1, 0.5, 0.9, 0.999):
            with self.subTest(share):
                self.assert_refused(self.limited(int(share * whole), "replay", *arguments), "result.h5")
                self.assertEqual(self.files(self.path), ["history.h5"])
        self.assertEqual(self.history.stat().st_size, history)

    def test_a_column_leaves_no_history(self):
        scene = PROBLEMS / "sliding_to_a_stop.toml"
        out = self.path / "out"
        arguments = (scene, "--out", out, "--no-plot", "--no-progress")
        self.assertEqual(self.ran("hydro", *arguments).returncode, 0)
        sizes = {file.name: file.stat().st_size for file in out.rglob("*") if file.is_file()}
        for size in (0, 500, sizes["history.h5"] // 2, sizes["history.h5"] - 1):
            for file in out.iterdir():
                file.unlink()
            with self.subTest(size):
                run = self.limited(size, "hydro", *arguments)
                self.assert_refused(run)
                for name in self.files(out):
                    self.assertFalse(name.endswith(".partial"), name)
                    self.assertEqual((out / name).stat().st_size, sizes[name], f"{name} is whole or not there")

    def test_two_dimensions_leave_whole_frames_and_dumps_only(self):
        scene = PROBLEMS / "cone_al_steel_coarse.toml"
        for size in (0, 3000, 20000):
            with self.subTest(size):
                out = self.path / f"out{size}"
                run = self.limited(size, "hydro", scene, "--interface-law", "free_slip", "--out", out, "--no-plot", "--no-progress", "--dump-every", "2")
                if "OMP: Error #179" in run.stderr:
                    self.skipTest("LLVM's OpenMP runtime needs a file of its own before the program writes any")
                self.assert_refused(run)
                self.assertEqual([name for name in self.files(out) if name.endswith((".partial", ".tmp"))], [])

    def test_a_map_leaves_whole_files_only(self):
        out = self.path / "map"
        arguments = ("map", support.EXAMPLES / "validity_map.toml", "--out", out, "--pressures", "3", "--velocities", "3",
                     "--times", "1e-8")
        for size in (0, 100):
            self.assert_refused(self.limited(size, "study", *arguments), "nodes.csv")
            self.assertEqual(self.files(out), [])

    def test_keys_come_in_pairs(self):
        for size in (0, 60):  # the second limit lets the public key through, or the first line of the secret one
            self.assert_refused(self.limited(size, "ctl", "keygen", self.path / "key"))
            self.assertEqual(self.files(self.path), [])

    def test_a_full_standard_output_is_told(self):
        self.write(**support.velocity_history())
        scene = support.EXAMPLES / "paper_velocity_driven_graded.toml"
        for program, *arguments in (("ctl", "reference"), ("ctl", "materials"), ("ctl", "check", scene),
                                    ("hydro", PROBLEMS / "sliding_to_a_stop.toml", "--check"),
                                    ("replay", self.history, "--scene", scene, "--check")):
            with self.subTest(program), open("/dev/full", "w", encoding="utf8") as full:
                run = self.ran(program, *arguments, stdout=full)
                self.assertEqual(run.returncode, 1, run.stderr)
                self.assertRegex(run.stderr, f"(shearbus-{program}|cannot write)")

    def test_a_full_standard_error_is_no_abort(self):
        for program, *arguments in (("ctl", "check", "/nowhere"), ("hydro", "/nowhere"), ("replay", "/nowhere", "--scene", "/nowhere", "--check")):
            with self.subTest(program), open("/dev/full", "w", encoding="utf8") as full:
                self.run_program(getattr(OPTIONS, program), *arguments, code=1, capture_output=False, stderr=full)

    def test_closed_streams_do_not_become_files(self):
        self.write(**support.velocity_history())
        command = [OPTIONS.replay, self.history, "--scene", support.EXAMPLES / "paper_velocity_driven_graded.toml",
                   "--out", self.out]
        shell = ["/bin/sh", "-c", 'exec "$@" <&- >&- 2>&-', "sh", *map(str, command)]
        self.assertEqual(subprocess.run(shell, timeout=60, check=False).returncode, 0)
        with support.h5py.File(self.out) as file:
            self.assertEqual(file["time"].shape, (5,))


class Options(Programs):
    def assert_usage(self, program, *arguments):
        run = self.ran(program, *arguments)
        self.assertEqual(run.returncode, 2, run.stdout + run.stderr)

    def test_a_study_looks_at_its_output_before_the_work(self):
        for verb, *scene in (("precision", support.EXAMPLES / "paper_velocity_driven.toml", "--quick"), ("tolerance", "--quick"), ("stability",),
                             ("map", support.EXAMPLES / "validity_map.toml"), ("mesh",), ("fit", PROBLEMS / "two_half_spaces.toml", "--parameter", "interface.friction_coefficient=0.1:0.6")):
            for file in (self.path / "file", self.path / f"{verb}.json")[:1 if verb in ("mesh", "fit") else 2]:
                with self.subTest(verb, file=file.name):
                    file.write_text("mine")
                    run = self.ran("study", verb, *scene, "--out", file if file.name == "file" else self.path)
                    self.assertEqual((run.returncode, run.stdout), (1, ""), run.stderr)
                    self.assertIn(str(file), run.stderr)
                    self.assertEqual(file.read_text(), "mine")

    def test_a_time_that_no_run_reaches_is_refused(self):
        study = ("map", support.EXAMPLES / "validity_map.toml", "--out", self.path / "map")
        self.assert_usage("study", *study, "--times", "1e30")
        self.assert_usage("study", *study, "--times", "1e-8", "--dt", "1e-30")

    def test_directories_are_no_checkpoints(self):
        run = self.ran("ctl", "compare", self.path, self.path)
        self.assertEqual(run.returncode, 2)
        self.assertIn(f"{self.path}: no file; expected a checkpoint", run.stderr)
        self.assertNotIn("bad_alloc", run.stderr)

    @unittest.skipIf(os.geteuid() != 0, "another user is made by root alone")
    def test_a_directory_of_another_user_is_refused_with_the_cause(self):
        self.path.chmod(0o755)
        (self.path / "kept").mkdir(mode=0o755)
        run = self.ran("hydro", PROBLEMS / "two_half_spaces.toml", "--out", self.path / "kept", "--no-plot", user=65534)
        self.assertEqual(run.returncode, 1, run.stderr)
        self.assertIn(f"{self.path}/kept/.lock: cannot be written: Permission denied", run.stderr)
        self.assertIn("Write into a directory of your own.", run.stderr)


class ServerProcess(Programs):
    def serve(self, *arguments, wrap=(), **options):
        bus = self.path / "bus"
        server = served.program(self, *wrap, OPTIONS.server, "--bind", f"ipc://{bus}", "--threads", "1", *arguments, **options)
        served.until(self, lambda: self.ping() == 0, server)
        return server

    def ping(self):
        return self.ran("ctl", "ping", "--server", f"ipc://{self.path / 'bus'}").returncode

    def test_a_reader_of_the_log_that_leaves_stops_nothing(self):
        server = self.serve("--log-level", "trace", stderr=subprocess.PIPE)
        server.stderr.close()
        for _ in range(3):
            self.assertEqual(self.ping(), 0)
        server.terminate()
        self.assertEqual(server.wait(timeout=20), 0)

    def test_a_terminal_that_hangs_up_stops_in_order(self):
        server = self.serve(stderr=subprocess.DEVNULL)
        server.send_signal(signal.SIGHUP)
        self.assertEqual(server.wait(timeout=20), 0)

    def test_nohup_is_heeded(self):
        server = self.serve(wrap=["/usr/bin/nohup"], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        server.send_signal(signal.SIGHUP)
        time.sleep(0.3)
        self.assertEqual(self.ping(), 0)

    def test_a_log_of_the_largest_size_stops_nothing(self):
        log = self.path / "log"
        server = self.serve("--log-file", log, "--log-level", "trace", stderr=subprocess.DEVNULL, preexec_fn=served.file_limit(600))
        for _ in range(3):
            self.assertEqual(self.ping(), 0)
        self.assertLessEqual(log.stat().st_size, 600)
        server.terminate()
        self.assertEqual(server.wait(timeout=20), 0)

    def test_the_log_is_written_by_its_owner_alone(self):
        log = self.path / "log"
        self.serve("--log-file", log, preexec_fn=lambda: os.umask(0))
        self.assertEqual(stat.S_IMODE(log.stat().st_mode) & 0o027, 0, oct(log.stat().st_mode))

    def test_closed_streams_do_not_become_state(self):
        state = self.path / "state"
        wrap = ["/bin/sh", "-c", 'exec "$@" <&- >&- 2>&-', "sh"]
        server = self.serve("--state-dir", state, "--log-level", "trace", wrap=wrap)
        for number in (0, 1, 2):
            self.assertEqual(os.readlink(f"/proc/{server.pid}/fd/{number}"), "/dev/null")

    @unittest.skipIf(os.geteuid() != 0, "files of another owner are made by root alone")
    def test_keys_of_another_owner_are_refused(self):
        self.assertEqual(self.ran("ctl", "keygen", self.path / "key").returncode, 0)
        for name, what in (("key.public", "let anybody in"), ("key.secret", "knows the secret key")):
            os.chown(self.path / name, 12345, 12345)
            run = self.ran("server", "--bind", "tcp://127.0.0.1:*", "--curve-secret", self.path / "key.secret",
                                   "--authorized-keys", self.path / "key.public")
            self.assertEqual(run.returncode, 1, run.stderr)
            self.assertIn("uid 12345", run.stderr)
            self.assertIn(what, run.stderr)
            os.chown(self.path / name, 0, 0)


if __name__ == "__main__":
    served.main()
