"""Servers that write endpoint files, and clients that find them: the C++ programs and the Python client. Drains that end within a time."""
import json
import os
import pathlib
import re
import signal
import subprocess
import sys
import threading
import time
import urllib.request

import zmq

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
import shearbus
from served import OPTIONS


def listing(path):
    return dict(re.findall(r'^(\w+) = "(.*)"$', path.read_text(), re.M))


class EndpointFiles(served.Served):
    def setUp(self):
        super().setUp()
        self.file = self.path / "servers/one"
        self.file.parent.mkdir()
        self.endpoint = f"file://{self.file}"

    def serve(self, *arguments, bind=None, file=None):
        return served.program(self, OPTIONS.server, "--bind", bind or f"ipc://{self.path}/bus/s", "--endpoint-file", file or self.file, "--threads", 1,
                              *arguments, stderr=subprocess.PIPE, cwd=self.path)

    def serve_second(self):
        """Serves with two files, "one" and "two". Returns the second server."""
        self.serve()
        second = self.serve(bind=f"ipc://{self.path}/second/s", file=self.file.parent / "two")
        self.wait()
        self.ctl("wait", "--server", f"file://{self.file.parent}/two")
        return second

    def ended(self, process, code=0):
        said = process.communicate(timeout=30)[1]
        self.assertEqual(process.returncode, code, said)
        return said

    def ctl(self, *words, code=0, timeout=30):
        done = self.run_program(OPTIONS.ctl, *words, code=code, timeout=timeout)
        return done.stdout + done.stderr

    def wait(self, *arguments, code=0):
        return self.ctl("wait", "--server", self.endpoint, "--timeout", 20, *arguments, code=code)

    def keys(self):
        """Makes keys and returns the options of a server with them, and the client's secret file."""
        self.ctl("keygen", self.path / "server")
        self.ctl("keygen", "--operator", self.path / "own")
        return ["--curve-secret", self.path / "server.secret", "--authorized-keys", self.path / "own.public"], self.path / "own.secret"

    def session(self, **options):
        return shearbus.open(served.EXAMPLES / "constant_friction.toml", range(4), self.endpoint, check_closure="off", **options)

    def step(self, session):
        return session.step(1e-9, jump=10.0, pressure=1e8, stress_soft=0.0, stress_hard=0.0, mass_soft=1.0, mass_hard=1.0)

    def test_a_server_on_a_free_port_is_found_with_its_key_and_takes_its_file_away(self):
        options, key = self.keys()
        server = self.serve(*options, bind="tcp://*:0")
        self.wait("--key", key)
        found = listing(self.file)
        self.assertRegex(found["endpoint"], rf"^tcp://{re.escape(os.uname().nodename)}:[1-9]\d*$")
        self.assertEqual(found["server_key"], (self.path / "server.public").read_text().split()[0])
        self.assertEqual(found["host"], os.uname().nodename)
        self.assertRegex(found["epoch"], r"^[0-9a-f]{16}$")
        self.assertIn("expects clients with keys", self.ctl("ping", "--server", self.endpoint, code=1))
        with self.session(secret_key_file=key) as session:
            self.step(session)
        os.environ["SHEARBUS_SECRET_KEY_FILE"] = str(key)
        self.addCleanup(os.environ.pop, "SHEARBUS_SECRET_KEY_FILE", None)
        with self.session() as session:
            self.step(session)
        # Whoever knows the server's key insists on it, whatever the file says.
        self.ctl("keygen", self.path / "other")
        said = self.ctl("ping", "--server", self.endpoint, "--server-key", self.path / "other.public", "--key", key, "--timeout", 5,
                        code=1)
        self.assertRegex(said, "AUTH|UNREACHABLE")
        # Without the file: what an operator does who sets up keys.
        del os.environ["SHEARBUS_SECRET_KEY_FILE"]
        self.assertIn("never written over", self.ctl("keygen", self.path / "own", code=1))
        self.assertEqual(key.stat().st_mode & 0o777, 0o600)
        with_keys = ("--server", found["endpoint"], "--server-key", self.path / "server.public", "--key", key)
        self.ctl("ping", "--timeout", 20, *with_keys)
        self.assertIn("AUTH", self.ctl("ping", "--timeout", 20, "--server", found["endpoint"], code=1))
        self.run_program(OPTIONS.hydro, served.PROBLEMS / "sliding_to_a_stop.toml", "--check", *with_keys)
        server.send_signal(signal.SIGTERM)
        self.assertIn(found["server_key"], self.ended(server))
        self.assertEqual(list(self.file.parent.iterdir()), [])

    def test_a_relative_socket_is_named_by_its_whole_path(self):
        self.serve(bind="ipc://bus/s")
        self.wait()
        self.assertEqual(listing(self.file)["endpoint"], f"ipc://{self.path.resolve()}/bus/s")
        self.assertEqual(listing(self.file)["server_key"], "")

    def test_the_file_of_a_running_server_is_refused_to_another(self):
        first = self.serve()
        self.wait()
        before = self.file.read_text()
        said = self.ended(self.serve(bind=f"ipc://{self.path}/other/s"), 1)
        self.assertIn(f"{self.file} is the endpoint file of a server that runs, at ipc://{self.path}/bus/s", said)
        self.assertEqual(self.file.read_text(), before)
        # One that was killed has left its file to the next.
        first.kill()
        first.wait()
        self.serve(bind=f"ipc://{self.path}/other/s")
        served.until(self, lambda: "other" in listing(self.file)["endpoint"])

    def test_a_file_that_names_another_server_is_left_there(self):
        server = self.serve()
        self.wait()
        self.file.write_text(self.file.read_text().replace("/bus/s", "/other/s"))
        server.send_signal(signal.SIGTERM)
        self.ended(server)
        self.assertIn("/other/s", listing(self.file)["endpoint"])

    def test_a_file_that_cannot_be_written_ends_the_server_with_the_reason(self):
        self.assertIn("absent/file: there is no directory", self.ended(self.serve(file=self.path / "absent/file"), 1))
        self.assertIn("is a directory", self.ended(self.serve(file=self.path / "servers"), 1))
        self.assertIn("a character that an endpoint file cannot hold", self.ended(self.serve(bind=f'ipc://{self.path}/a"b/s'), 1))

    def test_whoever_waits_is_told_of_an_absent_incomplete_or_stale_file(self):
        def refusals():
            yield self.ctl("wait", "--server", self.endpoint, "--timeout", 0.3, code=1)
            with self.assertRaises(shearbus.Unreachable) as caught:
                self.session(connect_deadline=0.3)
            yield str(caught.exception)

        for said in refusals():
            self.assertIn(f"{self.file}: cannot be", said)
            self.assertIn("No such file", said)
        server = self.serve()
        self.wait()
        whole = self.file.read_text()
        self.file.write_text(whole[:-5])
        for said in refusals():
            self.assertIn("written only in part", said)
        self.file.write_text(whole[:whole.index("epoch")])
        for said in refusals():
            self.assertIn("has no epoch", said)
        self.file.write_text(whole)
        server.send_signal(signal.SIGSTOP)
        for said in refusals():
            self.assertIn(f"the server at ipc://{self.path}/bus/s (named by {self.endpoint}, written on", said)
            self.assertIn("lives, and did not answer", said)
            self.assertNotIn("remove the file", said)
        server.kill()
        server.wait()
        for said in refusals():
            self.assertIn(f"no server answered at ipc://{self.path}/bus/s (named by {self.endpoint}, written on", said)
            self.assertIn("leaves its file behind", said)

    def test_wait_waits_for_a_server_that_starts_later(self):
        timer = threading.Timer(0.5, self.serve)
        timer.start()
        self.addCleanup(timer.join)
        self.assertIn("answered in", self.wait())

    def test_a_session_goes_on_with_the_next_server_at_another_port(self):
        options, key = self.keys()
        options += ["--state-dir", self.path / "state"]
        server = self.serve(*options, bind="tcp://127.0.0.1:0")
        self.wait("--key", key)
        before = listing(self.file)
        with self.session(secret_key_file=key, reply_deadline=30.0) as session:
            self.step(session)
            server.kill()
            server.wait()
            self.serve(*options, bind="tcp://127.0.0.1:0")
            started = time.monotonic()
            self.step(session)  # finds the address that the first server had no more, and then the other
            self.assertLess(time.monotonic() - started, 10)
        after = listing(self.file)
        self.assertNotEqual(after["endpoint"], before["endpoint"])
        self.assertNotEqual(after["epoch"], before["epoch"])

    def test_a_program_goes_on_with_the_next_server_at_another_port(self):
        options, key = self.keys()
        options += ["--state-dir", self.path / "state"]
        server = self.serve(*options, bind="tcp://127.0.0.1:0")
        scene = served.edited(served.PROBLEMS / "cone_al_steel_coarse.toml", self.path / "cone.toml", zone_width_m=1e-3, end_time_s=5e-6)
        host = served.program(self, OPTIONS.hydro, scene, "--out", self.path / "run", "--no-plot", "--dump-every", 5, "--server", self.endpoint, "--key", key,
                              stderr=subprocess.PIPE)
        served.until(self, lambda: list((self.path / "run").glob("restart/dump-*.h5")), host, 60)
        host.send_signal(signal.SIGSTOP)
        server.kill()
        server.wait()
        self.serve(*options, bind="tcp://127.0.0.1:0")
        host.send_signal(signal.SIGCONT)
        self.ended(host)
        self.assertTrue((self.path / "run/summary.json").exists())

    def test_the_servers_of_a_directory_are_shown_by_line(self):
        self.assertIn("no endpoint files", self.ctl("status", "--all", self.file.parent, code=1))
        self.ctl("status", code=2)
        self.ctl("status", "--all", self.file.parent, "--server", self.endpoint, code=2)
        second = self.serve_second()
        with self.session():
            lines = self.ctl("status", "--all", self.file.parent).splitlines()
            self.assertEqual([line.split()[0] for line in lines], ["one", "two"])
            self.assertIn("1 session with 4 nodes", lines[0])
            self.assertIn("0 sessions with 0 nodes", lines[1])
        second.kill()
        second.wait()
        lines = self.ctl("status", "--all", self.file.parent, "--json", "--timeout", 0.5, code=1).splitlines()
        self.assertEqual([json.loads(line)["file"] for line in lines], ["one", "two"])
        self.assertIn("UNREACHABLE", json.loads(lines[1])["fault"])

    def test_other_files_of_a_directory_are_none_of_its_servers(self):
        self.serve_second()
        place = self.file.parent
        (place / "log").write_text("2026-01-01T00:00:00.000+0000 info listening on ipc://x\n" * 200)
        (place / "s.lock").touch()
        (place / "notes").write_text("version of the run: 3\n")
        began = time.monotonic()
        lines = self.ctl("status", "--all", place).splitlines()
        self.assertEqual([line.split()[0] for line in lines], ["one", "two"])
        with shearbus.open(served.EXAMPLES / "constant_friction.toml", range(4), f"file://{place}", check_closure="off") as session:
            self.step(session)
        # What no server makes an endpoint file of is not waited for.
        for name in ("log", "notes"):
            said = self.ctl("wait", "--server", f"file://{place / name}", code=1)
            self.assertIn("expected an endpoint file of a server, found another file", said)
            self.assertIn(f"{place / name}", said)
        self.assertLess(time.monotonic() - began, 15)

    def test_servers_that_do_not_answer_are_waited_for_at_once(self):
        self.serve()
        self.wait()
        for name in ("two", "three", "four"):
            (self.file.parent / name).write_text(self.file.read_text().replace("/bus/s", f"/{name}"))
        began = time.monotonic()
        lines = self.ctl("status", "--all", self.file.parent, "--timeout", 4, code=1).splitlines()
        self.assertEqual([line.split()[0] for line in lines], ["four", "one", "three", "two"])
        self.assertLess(time.monotonic() - began, 11)  # in turn it would be 12 s

    def test_the_remedy_for_an_address_without_a_server_starts_one(self):
        said = self.ctl("ping", "--server", "tcp://127.0.0.1:1", "--timeout", 0.3, code=1)
        words = re.search(r"Start it with: shearbus-server (--bind \S+ --insecure-plaintext)", said)
        self.assertIsNotNone(words, said)
        _, key = self.keys()
        said = self.ctl("ping", "--server", "tcp://127.0.0.1:1", "--server-key", self.path / "server.public", "--key", key, "--timeout", 0.3, code=1)
        self.assertIn("--bind tcp://127.0.0.1:1 --curve-secret FILE --authorized-keys FILE", said)
        for port in ("99999", "0", "x", ""):
            said = self.ctl("wait", "--server", f"tcp://127.0.0.1:{port}", code=1)
            self.assertIn(f'expected a port from 1 to 65535 at the end, found "{port}"', said)

    def relay(self, ended):
        """Passes messages on to the server; the second answer to a connection, and later ones, take 6 s."""
        front, behind, poller = zmq.Context.instance().socket(zmq.ROUTER), {}, zmq.Poller()
        front.bind(f"ipc://{self.path}/slow")
        poller.register(front, zmq.POLLIN)
        answered, held = {}, []
        while not ended.is_set():
            for socket, _ in poller.poll(50):
                if socket is not front:
                    peer = next(peer for peer, one in behind.items() if one is socket)
                    answered[peer] = answered.get(peer, 0) + 1
                    held.append((time.monotonic() + (6.0 if answered[peer] > 1 else 0.0), [peer, *socket.recv_multipart()]))
                    continue
                peer, *frames = front.recv_multipart()
                if peer not in behind:
                    behind[peer] = zmq.Context.instance().socket(zmq.DEALER)
                    behind[peer].connect(f"ipc://{self.path}/bus/s")
                    poller.register(behind[peer], zmq.POLLIN)
                behind[peer].send_multipart(frames)
            while held and held[0][0] <= time.monotonic():
                front.send_multipart(held.pop(0)[1])
        for socket in (front, *behind.values()):
            socket.close(0)

    def test_a_checkpoint_that_takes_long_is_asked_for_once(self):
        self.serve("--state-dir", self.path / "states")
        self.wait()
        ended = threading.Event()
        relay = threading.Thread(target=self.relay, args=[ended])
        relay.start()
        try:  # a lost message would be repeated after 5 s
            self.assertIn("checkpoint of", self.ctl("checkpoint", "--server", f"ipc://{self.path}/slow", "--timeout", 30))
        finally:
            ended.set()
            relay.join()
        self.assertEqual(json.loads(self.ctl("status", "--json", "--server", self.endpoint))["checkpoints"], 1)

    def test_metrics_of_a_directory_are_served_by_http(self):
        second = self.serve_second()
        exporter = served.program(self, OPTIONS.ctl, "metrics", "--all", self.file.parent, "--listen", "127.0.0.1:0", "--timeout", "0.5",
                                  stdout=subprocess.PIPE, stderr=subprocess.PIPE)
        port = int(re.search(r"port (\d+)", exporter.stdout.readline())[1])

        def scrape():
            with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=10) as answer:
                lines = answer.read().decode().splitlines()
            names = [line.split()[2] for line in lines if line.startswith("# TYPE")]
            self.assertEqual(len(names), len(set(names)), "a family has more than one place")
            return lines

        with self.session() as session:
            self.step(session)
            lines = scrape()
            for line in ('shearbus_up{server="one"} 1', 'shearbus_up{server="two"} 1', 'shearbus_nodes{server="one"} 4',
                         'shearbus_nodes{server="two"} 0', 'shearbus_request_seconds_count{verb="downscale",server="one"} 1'):
                self.assertIn(line, lines)
        second.kill()
        second.wait()
        lines = scrape()
        self.assertIn('shearbus_up{server="two"} 0', lines)
        self.assertFalse([line for line in lines if 'server="two"' in line and "shearbus_up" not in line])
        self.assertIn('shearbus_sessions{server="one"} 0', lines)
        self.assertIn("cannot listen at 127.0.0.1:99999: expected ADDRESS:PORT, with a port up to 65535",
                      self.ctl("metrics", "--server", self.endpoint, "--listen", "127.0.0.1:99999", code=1))
        self.assertIn(f"cannot listen at 127.0.0.1:{port}",
                      self.ctl("metrics", "--server", self.endpoint, "--listen", f"127.0.0.1:{port}", code=1))
        exporter.send_signal(signal.SIGTERM)
        self.ended(exporter)

    def test_a_drain_within_a_time_ends_with_a_checkpoint_and_tells_that_sessions_were_open(self):
        state = ["--state-dir", self.path / "state"]
        server = self.serve(*state)
        self.wait()
        session = self.session()
        self.step(session)
        self.ctl("drain", "--within", 1, "--server", self.endpoint, code=2)
        self.assertIn("or in 1 s", self.ctl("drain", "--exit", "--within", 1, "--server", self.endpoint))
        self.assertIn("1 session open, to continue with the next server", self.ended(server, 3))
        self.assertTrue(list((self.path / "state").glob("checkpoint-*.h5")))
        self.assertFalse(self.file.exists())
        # The next server has the session; a drain whose sessions end in time gives 0.
        server = self.serve(*state)
        self.step(session)
        self.ctl("drain", "--exit", "--within", 30, "--server", self.endpoint)
        session.close()
        self.ended(server, 0)


if __name__ == "__main__":
    served.main()
