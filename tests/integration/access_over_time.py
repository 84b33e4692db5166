"""A server over time and seen by others than its operator: a key that is taken off the list, a socket whose file is
removed, endpoints and host names that mean nothing, what a user who is no operator is told."""
import json
import os
import pathlib
import shutil
import signal
import subprocess
import sys
import time
import urllib.request

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
import shearbus  # noqa: E402
from served import EXAMPLES, OPTIONS  # noqa: E402

SCENE = EXAMPLES / "constant_friction.toml"


class OverTime(served.Served):
    def setUp(self):
        super().setUp()
        self.file = self.path / "servers/one"
        self.file.parent.mkdir()

    def serve(self, bind, *arguments):
        return served.serve(self, self.log(), OPTIONS.server, "--bind", bind, "--threads", "1", "--endpoint-file", self.file, *arguments)

    def ctl(self, *words):
        return self.run_program(OPTIONS.ctl, *words).stdout

    def keys(self):
        """Makes keys of a server, an operator and a user. Returns the server's options."""
        self.ctl("keygen", self.path / "server")
        self.ctl("keygen", "--operator", self.path / "operator")
        self.ctl("keygen", self.path / "user")
        self.authorise("operator", "user")
        return "--curve-secret", self.path / "server.secret", "--authorized-keys", self.path / "keys"

    def authorise(self, *names):
        """Replaces the list of authorised keys, as an editor does."""
        made = self.path / "keys.new"
        made.write_text("".join((self.path / f"{name}.public").read_text() for name in names))
        made.chmod(0o600)
        made.rename(self.path / "keys")

    def open(self, endpoint=None, **options):
        session = shearbus.open(SCENE, range(4), endpoint or f"file://{self.file}", check_closure="off",
                                **{"reply_deadline": served.PATIENCE_S, **options})
        self.addCleanup(session.leave)
        return session

    def step(self, session):
        return session.step(1e-9, jump=10.0, pressure=1e8, stress_soft=0.0, stress_hard=0.0, mass_soft=1.0, mass_hard=1.0)

    def connections(self, server):
        """Returns the number of established connections of the server by tcp."""
        sockets = {os.readlink(file) for file in pathlib.Path(f"/proc/{server.pid}/fd").iterdir() if file.is_symlink()}
        rows = [line.split() for line in pathlib.Path("/proc/net/tcp").read_text().splitlines()[1:]]
        return sum(f"socket:[{row[9]}]" in sockets for row in rows if row[3] == "01")

    def test_a_key_that_is_taken_off_the_list_loses_its_connections(self):
        server = self.serve("tcp://127.0.0.1:*", *self.keys())
        user, other = self.open(secret_key_file=self.path / "user.secret"), self.open(secret_key_file=self.path / "operator.secret")
        self.step(user), self.step(other)
        self.authorise("operator")
        served.until(self, lambda: "1 connections of revoked keys were closed" in server.text(), server)  # it was idle
        self.assertIn("was revoked", server.text())
        with self.assertRaises(shearbus.Error) as fault:
            self.step(user)
        # The client may have written the request before it noticed that the connection was closed.
        self.assertIn(fault.exception.code, (shearbus.Code.AUTH, shearbus.Code.UNKNOWN_OUTCOME))
        self.assertIn("does not admit this client's key", str(fault.exception))
        served.until(self, lambda: self.connections(server) == 1, server)
        with self.assertRaises(shearbus.Error) as fault:
            self.step(user)  # the same call finds no connection
        self.assertEqual(fault.exception.code, shearbus.Code.AUTH)
        self.step(other)
        # The states are as they were, and the key may come back.
        self.authorise("operator", "user")
        served.until(self, lambda: "is authorised again" in server.text(), server)
        self.step(user)

    def test_a_list_that_cannot_be_used_revokes_nothing_and_says_so(self):
        server = self.serve("tcp://127.0.0.1:*", *self.keys())
        user = self.open(secret_key_file=self.path / "user.secret")
        (self.path / "keys").chmod(0o666)
        served.until(self, lambda: "ALARM: no key is admitted" in server.text(), server)
        self.step(user)
        (self.path / "keys").chmod(0o600)
        time.sleep(1.5)
        self.step(user)
        self.assertEqual(server.text().count("ALARM"), 1)

    def test_a_user_who_is_no_operator_is_told_nothing_false(self):
        self.serve("tcp://127.0.0.1:*", *self.keys(), "--state-dir", self.path / "state")
        user = self.open(secret_key_file=self.path / "user.secret")
        self.step(user)
        told = ["status", "--server", f"file://{self.file}", "--key"]
        of_operator = self.ctl(*told, self.path / "operator.secret")
        for hidden in ("journal", "connections", "process", "turns"):
            self.assertIn(f"\n{hidden} ", of_operator)
        self.assertIn("1 of yours with 4 nodes", text := self.ctl(*told, self.path / "user.secret"))
        for hidden in ("\njournal", "\nconnections", "\nprocess", "\nturns", "ADMITTED", " 0 files", "0.0 MB resident"):
            self.assertNotIn(hidden, text)
        told.insert(1, "--json")
        for hidden in ("checkpoints", "journal_bytes", "resident_bytes", "open_files", "longest_turn_s"):
            self.assertIn(hidden, json.loads(self.ctl(*told, self.path / "operator.secret")))
            self.assertNotIn(hidden, json.loads(self.ctl(*told, self.path / "user.secret")))
        metrics = self.ctl("metrics", "--server", f"file://{self.file}", "--key", self.path / "user.secret")
        self.assertIn("shearbus_sessions 1", metrics)
        for hidden in ("admitting", "resident", "open_files", "journal", "checkpoints", "connections", "messages"):
            self.assertNotIn(f"shearbus_{hidden}", metrics)
        all_of = self.ctl("status", "--all", self.file.parent, "--key", self.path / "user.secret")
        self.assertIn("1 session of yours", all_of)

    def test_metrics_are_not_served_to_the_world_by_a_port_alone(self):
        self.serve(f"ipc://{self.path}/bus/s")
        for address in ("9464", ":9464", "+9464", "127.0.0.1:0,9464", "localhost", ""):
            self.refused(OPTIONS.ctl, "metrics", "--server", f"file://{self.file}", f"--listen={address}", code=1 if address else 2,
                         said="127.0.0.1:9464" if address else "")
        exporter = served.program(self, OPTIONS.ctl, "metrics", "--server", f"file://{self.file}", "--listen", "127.0.0.1:0", stdout=subprocess.PIPE)
        port = int(exporter.stdout.readline().split()[3].rstrip(","))
        with urllib.request.urlopen(f"http://127.0.0.1:{port}/metrics", timeout=30) as answer:
            self.assertIn("shearbus_sessions", answer.read().decode())
        for address in (f"127.0.0.1:{port}", "192.0.2.1:9464"):
            self.refused(OPTIONS.ctl, "metrics", "--server", f"file://{self.file}", f"--listen={address}", code=1,
                         said=f"cannot listen at {address}: the port is in use")

    def test_a_socket_whose_file_was_removed_is_made_again_and_connections_stay(self):
        socket = self.path / "bus/s"
        server = self.serve(f"ipc://{socket}")
        before = self.open()
        self.step(before)
        for remove in (socket.unlink, lambda: shutil.rmtree(socket.parent)):
            made = socket.stat().st_ino
            self.assertEqual(socket.stat().st_mode & 0o077, 0)
            remove()
            served.until(self, lambda: socket.exists() and socket.stat().st_ino != made, server)
            served.until(self, lambda: "was removed" in server.text(), server)
            self.step(before)
            with self.open() as after:
                self.step(after)
            self.assertEqual(socket.stat().st_mode & 0o077, 0)
            self.refused(OPTIONS.server, "--bind", f"ipc://{socket}", said="another server listens")
        self.assertEqual(server.text().count("ALARM"), 2)
        self.assertRegex(server.text(), r"(?m)^\d{4}-\d\d-\d\dT[\d:.]+[+-]\d\d:\d\d info listening on")  # a time with its zone
        server.send_signal(signal.SIGTERM)
        self.assertEqual(server.wait(timeout=served.PATIENCE_S), 0)
        self.assertFalse(socket.exists())

    def test_what_stands_in_the_place_of_a_removed_socket_is_left_alone(self):
        socket = self.path / "bus/s"
        server = self.serve(f"ipc://{socket}")
        before = self.open()
        socket.unlink()
        socket.write_text("a file of somebody")
        served.until(self, lambda: "cannot be made again" in server.text(), server)
        time.sleep(2.5)
        self.step(before)
        self.assertEqual(server.text().count("cannot be made again"), 1)
        server.send_signal(signal.SIGTERM)
        self.assertEqual(server.wait(timeout=served.PATIENCE_S), 0)
        self.assertEqual(socket.read_text(), "a file of somebody")

    def test_a_host_name_is_no_address_to_listen_on(self):
        for host in ("localhost", "nosuchhost.invalid", "eth99"):
            self.refused(OPTIONS.server, "--bind", f"tcp://{host}:7447", "--insecure-plaintext",
                         said=(f'"{host}" is neither an address nor a network interface', "tcp://127.0.0.1:7447"))

    def test_a_host_name_that_does_not_resolve_is_named(self):
        endpoint = "tcp://nosuchhost.invalid:7447"
        said = self.refused(OPTIONS.ctl, "status", "--server", endpoint, "--timeout", "0.3", said='the host name "nosuchhost.invalid" does not resolve')
        self.assertNotIn("--bind", said)
        with self.assertRaises(shearbus.Error) as fault:
            self.open(endpoint, connect_deadline=0.3)
        self.assertIn('the host name "nosuchhost.invalid" does not resolve', str(fault.exception))
        self.refused(OPTIONS.ctl, "status", "--server", "tcp://127.0.0.1:1", "--timeout", "0.3", said="no server answered")

    def test_a_host_with_ipv6_alone_is_explained(self):
        hosts = self.path / "hosts"
        hosts.write_text("127.0.0.1 localhost\nfd00::1 six.invalid\n")
        inside = f"mount --bind {hosts} /etc/hosts && exec {OPTIONS.ctl} status --server tcp://six.invalid:7447 --timeout 0.3"
        done = subprocess.run(["unshare", "--mount", "sh", "-c", inside], capture_output=True, text=True, timeout=60, check=False)
        if "unshare" in done.stderr or "mount" in done.stderr:
            self.skipTest(f"a file of hosts of its own needs root: {done.stderr.strip()}")
        self.assertIn("reached by their numbers: tcp://[fd00::1]:7447", done.stderr)


if __name__ == "__main__":
    served.main()
