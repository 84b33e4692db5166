"""The server program on state directories that something has happened to: files lost, emptied, zeroed, replaced or
taken from another directory, a lock file removed, a disk that takes no more. A replay is the host."""
import os
import shutil
import signal
import subprocess

import replay_support as support
import served
from served import OPTIONS


class StateDirectory(support.ReplayTest):
    def setUp(self):
        super().setUp()
        self.state = self.path / "state"
        self.write(**support.velocity_history(steps=12, nodes=4))

    def start(self, *arguments, bus=None, state=None, preexec=None):
        """Starts a server. Its process gets the members `text`, a function that returns its log."""
        return served.start(self, self.log(), OPTIONS.server, "--bind", bus or self.bus, "--threads", "1",
                            "--state-dir", state or self.state, *arguments, preexec_fn=preexec)

    def serve(self, *arguments, **options):
        server = self.start(*arguments, **options)
        served.until(self, lambda: "listening on" in server.text(), server)
        return server

    def refused(self, *arguments, words=(), **options):
        server = self.start(*arguments, **options)
        try:
            code = server.wait(timeout=10)
        except subprocess.TimeoutExpired:
            self.fail("it started: " + server.text())
        self.assertEqual(code, 1, server.text())
        for word in words:
            self.assertIn(word, server.text())

    def stop(self, server, number=signal.SIGTERM):
        server.send_signal(number)
        return server.wait(timeout=20)

    def run_host(self):
        run = self.replay("--server", self.bus)
        self.assertEqual(run.returncode, 0, run.stderr)

    def segments(self, state=None):
        return sorted((state or self.state).glob("journal-*.log"))

    def test_a_directory_in_place_of_a_checkpoint_stops_nothing(self):
        for _ in range(2):
            server = self.serve()
            self.run_host()
            self.assertEqual(self.stop(server), 0)
        newest = sorted(self.state.glob("checkpoint-*.h5"))[-1]
        for kind in ("directory", "pipe", "link"):
            newest.rename(self.path / "kept")
            {"directory": newest.mkdir, "pipe": lambda: os.mkfifo(newest), "link": lambda: newest.symlink_to("/dev/zero")}[kind]()
            server = self.serve()
            self.assertIn(newest.name, server.text())
            self.assertIn("not loaded", server.text())
            self.assertIn("replayed", server.text())
            self.stop(server, signal.SIGKILL)
            newest.rmdir() if kind == "directory" else newest.unlink()
            (self.path / "kept").rename(newest)

    def test_lost_last_records_are_refused_under_power_and_told_under_process(self):
        server = self.serve("--durability", "power")
        self.run_host()
        self.stop(server, signal.SIGKILL)
        [segment] = self.segments()
        whole = segment.read_bytes()
        for what, data in {"zeroed": whole[:300] + bytes(len(whole) - 300), "cut": whole[: len(whole) // 2], "empty": b"",
                           "all zeros": bytes(len(whole)), "missing": None}.items():
            with self.subTest(what):
                broken = self.path / what.replace(" ", "")
                shutil.copytree(self.state, broken)
                if data is None:
                    (broken / segment.name).unlink()
                else:
                    (broken / segment.name).write_bytes(data)
                before = {file.name: file.read_bytes() for file in broken.iterdir()}
                self.refused("--durability", "power", state=broken, bus=f"ipc://{broken}-bus", words=[segment.name])
                self.assertEqual({file.name: file.read_bytes() for file in broken.iterdir()}, before)
                if what in ("empty", "all zeros", "missing"):
                    server = self.serve("--durability", "process", state=broken)
                    self.assertIn("LOST: " + segment.name, server.text())
                    self.stop(server, signal.SIGKILL)
                    if data is not None:
                        self.assertEqual((broken / segment.name).read_bytes(), data, "evidence stays")
                    self.stop(self.serve("--durability", "power", state=broken))

    def test_without_the_lock_file_a_second_server_is_still_refused(self):
        server = self.serve()
        (self.state / "lock").unlink()
        self.refused(bus="ipc://" + str(self.path / "second"), words=["another server holds the state directory"])
        self.run_host()
        self.assertTrue((self.state / "lock").exists(), "the first server has locked a new file")
        self.assertEqual(self.stop(server), 0)

    def test_without_its_lock_file_an_address_is_still_refused(self):
        server = self.serve()
        (self.path / "bus.lock").unlink()
        self.refused(state=self.path / "second", words=["another process listens on", "does not hold the lock file"])
        self.run_host()
        self.stop(server, signal.SIGKILL)
        self.serve()  # the socket of a dead server is no obstacle

    def test_what_needs_the_operator_is_logged_at_any_level(self):
        server = self.start("--log-level", "error", "--record", self.path / "records", preexec=served.file_limit(8192))
        served.until(self, (self.path / "bus").exists, server)
        for _ in range(4):
            self.run_host()
        self.assertGreater(len(self.segments()), 1, "the largest size of a file starts another segment")
        (self.path / "bus").unlink()
        served.until(self, lambda: "ALARM: the socket" in server.text(), server)
        self.assertEqual(self.stop(server), 0)
        self.assertIn(" error ALARM: the checkpoint could not be written", server.text())
        self.assertRegex(server.text(), " error ALARM: session [0-9a-f]{8} is not recorded( any further)?: .*File too large")
        self.assertNotIn(" info ", server.text())
        newest = self.segments()[-1]
        newest.unlink()
        server = self.start("--log-level", "error")
        served.until(self, (self.path / "bus").exists, server)
        self.run_host()
        self.assertIn(" error LOST: " + newest.name, server.text())


if __name__ == "__main__":
    served.main()
