#!/usr/bin/python3
"""shearbus-ctl watch on a terminal (that of tmux) and off one: what it shows, what happens when the server goes and comes, when the window
changes its size, and that the terminal is as before when the program ends or stops."""
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import time

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
from served import OPTIONS  # noqa: E402


class Served(served.Served):
    def setUp(self):
        super().setUp()
        self.server = self.start_server()

    def start_server(self):
        server = served.program(self, OPTIONS.server, "--bind", self.bus, "--state-dir", self.path / "states", "--log-file", self.path / "log")
        self.run_program(OPTIONS.ctl, "wait", "--server", self.bus)
        return server

    def stop_server(self):
        self.server.terminate()
        self.assertEqual(self.server.wait(timeout=30), 0)

    def with_session(self):
        """A host with 128 nodes, of which it steps all."""
        scene = served.edited(served.EXAMPLES / "force_driven.toml", self.path / "scene.toml", name='"backwards\\u202e"')
        host = served.program(self, shutil.which("python3", path="/usr/bin"), "-B", "-c", HOST, self.bus, scene, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        self.assertEqual(host.stdout.readline(), "open\n")
        return host

    def step(self, host):
        host.stdin.write("step\n")
        host.stdin.flush()
        return json.loads(host.stdout.readline())


HOST = """
import collections, json, sys
import numpy as np
import shearbus
n = 128
session = shearbus.open(sys.argv[2], np.arange(n), sys.argv[1])
print("open", flush=True)
for _ in sys.stdin:
    answer = session.step(1e-9, jump=np.linspace(0.0, 200.0, n), pressure=np.where(np.arange(n) % 4, 5e9, -1.0), stress_soft=np.zeros(n),
                          stress_hard=np.zeros(n), mass_soft=np.full(n, 0.027), mass_hard=np.full(n, 0.079))
    print(json.dumps(collections.Counter(int(r) for r in answer.regime)), flush=True)
"""
NAMES = ["open", "stick", "coulomb", "tresca", "melting"]


class OffTheTerminal(Served):
    def test_each_look_is_a_line_of_json_with_the_regimes_of_the_answers(self):
        host = self.with_session()
        watch = served.program(self, OPTIONS.ctl, "watch", "--server", self.bus, "--interval", "0.2", "--json", stdout=subprocess.PIPE)
        first = json.loads(watch.stdout.readline())
        self.assertEqual(first["regimes"], {"open": 128, "stick": 0, "coulomb": 0, "tresca": 0, "melting": 0})
        self.assertIsNone(first["node_steps_per_s"])
        regimes = self.step(host)
        expected = {name: regimes.get(str(r), 0) for r, name in enumerate(NAMES)}
        self.assertGreaterEqual(sum(count > 0 for count in expected.values()), 2, expected)
        rates = []
        for _ in range(20):
            line = json.loads(watch.stdout.readline())
            rates.append(line["node_steps_per_s"])
            if line["regimes"] == expected and rates[-1]:
                break
        self.assertEqual(line["regimes"], expected)
        self.assertGreater(rates[-1], 0)
        self.assertGreater(line["p99_s"], 0)
        self.assertEqual((line["sessions"], line["nodes"]), (1, 128))
        self.assertEqual(len(line["hottest"]), 3)
        self.assertGreaterEqual(line["hottest"][0]["interface_temperature_k"], line["hottest"][2]["interface_temperature_k"])
        self.stop_server()
        gone = json.loads(watch.stdout.readline())
        while gone["answers"]:
            gone = json.loads(watch.stdout.readline())
        self.assertIn("UNREACHABLE", gone["fault"])
        self.server = self.start_server()
        back = json.loads(watch.stdout.readline())
        while not back["answers"]:
            back = json.loads(watch.stdout.readline())
        self.assertEqual(back["regimes"], expected, "the server has recovered the session")
        watch.send_signal(signal.SIGTERM)
        self.assertEqual(watch.wait(timeout=10), 0)
        metrics = self.run_program(OPTIONS.ctl, "metrics", "--server", self.bus).stdout
        self.assertIn(f'shearbus_regime_nodes{{regime="stick"}} {expected["stick"]}\n', metrics)

    def test_lines_have_no_escape_codes_and_looks_end(self):
        printed = self.run_program(OPTIONS.ctl, "watch", "--server", self.bus, "--interval", "0.1", "--looks", "3").stdout
        self.assertEqual(len(printed.splitlines()), 3, printed)
        self.assertNotIn("\x1b", printed)
        self.assertIn("0 sessions, 0 nodes", printed)
        self.assertIn("; journal ", printed)

    def test_names_of_scenes_turn_no_line_around(self):
        self.step(self.with_session())
        for words in (("sessions",), ("top",), ("close", "backwards\u202e", "--idle", "0")):
            printed = self.run_program(OPTIONS.ctl, *words, "--server", self.bus).stdout
            self.assertIn("backwards\\u{202e}", printed)
            self.assertNotIn("\u202e", printed)


class OnATerminal(Served):
    def setUp(self):
        super().setUp()
        self.tmux("new-session", "-d", "-x", "100", "-y", "30", "env", "PS1=prompt> ", "bash", "--norc")
        self.addCleanup(lambda: self.tmux("kill-server"))
        self.until(lambda text: "prompt>" in text)

    def tmux(self, *words):
        environment = {key: value for key, value in os.environ.items() if key not in ("TMUX", "NO_COLOR")}
        return subprocess.run(["tmux", "-f", "/dev/null", "-S", self.path / "tmux", *words], check=True, capture_output=True, text=True, timeout=20,
                              env=environment).stdout

    def screen(self, *options):
        return self.tmux("capture-pane", "-p", *options)

    def until(self, holds, timeout_s=60):
        end = time.monotonic() + timeout_s
        while not holds(text := self.screen()):
            self.assertLess(time.monotonic(), end, text.rstrip())
            time.sleep(0.05)
        return text

    def type(self, line):
        self.tmux("send-keys", "-l", line)
        self.tmux("send-keys", "Enter")

    def watch(self, prefix=""):
        self.type(f"{prefix} {OPTIONS.ctl} watch --server {self.bus} --interval 0.2")
        self.until(lambda text: "shearbus-ctl watch" in text and "server   " in text)

    def assert_as_before(self):
        """The shell has its screen back, with what was on it, its echo and its cursor."""
        self.until(lambda text: "before" in text and "regimes" not in text)
        self.assertEqual(self.tmux("display-message", "-p", "#{alternate_on} #{cursor_flag}").split(), ["0", "1"])
        self.type("stty -a | grep -o '[-]*icanon\\|[-]*echo '")
        self.until(lambda text: "\nicanon" in text and "\necho" in text)

    def test_a_screen_with_the_rows_that_follows_the_server_and_leaves_no_trace(self):
        host = self.with_session()
        self.type("echo before")
        self.watch()
        self.step(host)
        text = self.until(lambda text: re.search(r"(coulomb|tresca) [1-9]", text) and "hottest" in text)
        for row in ("sessions    1 with 128 nodes", "regimes", "node-steps/s", "half answered within", "journal", "128 ", "K  ", "backwards\\u{202e}"):
            self.assertIn(row, text)
        self.assertIn("48;5;67m", self.screen("-e"), "the part of the bar for sticking nodes")
        self.tmux("resize-window", "-x", "50", "-y", "12")
        text = self.until(lambda text: len(text.splitlines()) <= 12)
        self.assertLessEqual(max(map(len, self.until(lambda text: "regimes" in text and "melting 0.0 %" in text).splitlines())), 50)
        self.tmux("resize-window", "-x", "100", "-y", "30")
        self.stop_server()
        self.until(lambda text: "NO ANSWER" in text)
        self.server = self.start_server()
        self.until(lambda text: "1 with 128 nodes" in text)
        self.tmux("send-keys", "C-z")
        self.until(lambda text: "Stopped" in text)
        self.assert_as_before()
        self.type("clear; echo before; fg")
        self.until(lambda text: "1 with 128 nodes" in text)
        self.tmux("send-keys", "C-c")
        self.assert_as_before()

    def test_the_key_q_and_a_signal_end_it(self):
        for end in ("q", signal.SIGTERM, "q without a server"):
            self.type("clear; echo before")
            self.watch("NO_COLOR=1")
            if end == "q without a server":
                self.stop_server()
                self.until(lambda text: "NO ANSWER" in text)
            if end != signal.SIGTERM:
                self.tmux("send-keys", "q")
            else:
                shell = self.tmux("display-message", "-p", "#{pane_pid}").strip()
                child = subprocess.run(["pgrep", "-P", shell], capture_output=True, text=True, check=True).stdout.split()[0]
                os.kill(int(child), end)
            self.assert_as_before()


if __name__ == "__main__":
    served.main()
