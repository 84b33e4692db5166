"""Event logs of the server and of clients: what is in them, what a death, a full disk or damage does to them, what recording
costs."""
import os
import pathlib
import resource
import signal
import struct

import numpy as np
import replay_support as support
import served
import shearbus
from replay_support import EXAMPLES
from served import OPTIONS
from shearbus.conformity.mock_server import read, xxh3

GRADED = EXAMPLES / "paper_velocity_driven_graded.toml"
SERVER, CLIENT = 1, 2
# Bodies of the requests that a log has (proto/shearbus/v1/envelope.proto).
VERBS = {17: "open_session", 18: "downscale", 19: "commit", 20: "rollback", 21: "close_session", 23: "resume_session",
         24: "mark", 25: "register_nodes", 26: "retire_nodes", 27: "offer_nodes", 28: "accept_nodes"}


def read_log(path):
    """Returns (recorder, scene, records) of an event log as proto/files/event_log.md describes it; a record is the four frames."""
    data = pathlib.Path(path).read_bytes()
    magic, version, size, _, _, recorder, scene, _, _ = struct.unpack_from("<8sII16sQIIQQ", data)
    assert (magic, version, size) == (b"SHBEVLG\n", 1, 64)
    at, records, last = 64 + scene, [], 0
    while at < len(data):
        index, ns, *lengths, _ = struct.unpack_from("<QQ4IQ", data, at)
        assert index == len(records) and ns > last
        last, at, frames = ns, at + 40, []
        for length in lengths:
            frames.append(data[at:at + length])
            at += length
        at += 8
        records.append(frames)
    assert at == len(data)
    return recorder, data[64:64 + scene].decode(), records


def verbs(records):
    """Names of the requests' bodies, with the code of each refusal."""
    said = []
    for request, _, reply, _ in records:
        name = next(VERBS[number] for number in read(request) if number in VERBS)
        code = read(read(reply)[9][0])[1][0] if reply else None
        said.append(name if code == shearbus.Code.OK else f"{name} {shearbus.Code(code).name if code else 'unanswered'}")
    return said


class RecordTest(support.ReplayTest):
    def setUp(self):
        super().setUp()
        self.records = self.path / "records"
        os.environ.pop("SHEARBUS_RECORD", None)

    def serve(self, *arguments, limit=None):
        """Starts a server that can be killed. Its process gets the member `text`, a function that returns its log."""
        return served.serve(self, self.log(), OPTIONS.server, "--bind", self.bus, "--threads", "1", *arguments,
                            preexec_fn=limit and served.file_limit(limit))

    def logs(self):
        return sorted(self.records.glob("session-*.log"))

    def the_log(self):
        self.assertEqual(len(self.logs()), 1)
        return self.logs()[0]

    def again(self, *arguments, code=0):
        """Replays event logs. Returns the printed text."""
        return self.tool("replay", *arguments, code=code)

    def talk(self, bus):
        """Everything a session of a few nodes can say. Returns the verbs as a log must have them."""
        jump = np.linspace(50.0, 100.0, len(bus.nodes))
        for i in range(3):
            bus.step(1e-9, jump=jump, pressure=11.2e9)
        with bus.trial(1e-9, jump=2 * jump, pressure=11.2e9) as trial:
            trial.reject()
        with bus.trial(1e-9, jump=jump, pressure=11.2e9):
            pass
        with self.assertRaises(shearbus.ContentError):
            bus.step(-1e-9, jump=jump, pressure=11.2e9)
        bus.mark("dump")
        bus.step(1e-9, jump=50.0, pressure=-1.0)
        bus.register([77, 78], initial_temperature=400.0)
        bus.step(1e-9, nodes=[77, int(bus.nodes[0])], jump=20.0, pressure=5e9)
        bus.retire([78])
        bus.rollback_to("dump")
        bus.step(2e-9, jump=jump, pressure=11.2e9)
        return ["open_session", *["downscale"] * 3, "downscale", "rollback", "downscale", "commit", "downscale INVALID_VALUE",
                "mark", "downscale", "register_nodes", "downscale", "retire_nodes", "rollback", "downscale"]


class Server(RecordTest):
    def test_a_log_has_everything_and_replays_to_the_same_bits(self):
        self.serve("--record", self.records)
        with shearbus.open(GRADED, range(5), self.bus) as bus:
            expected, scene = self.talk(bus), bus.scene
        recorder, head, records = read_log(self.the_log())
        self.assertEqual((recorder, head), (SERVER, scene))
        self.assertEqual(verbs(records), [*expected, "close_session"])
        self.assertEqual(self.the_log().stat().st_mode & 0o777, 0o600)
        self.assertEqual(self.records.stat().st_mode & 0o777, 0o700)
        self.assertIn("equal to the recorded ones, to the last bit", self.again(self.the_log()))
        self.assertIn("within 5.0 s", self.again(self.the_log(), "--server", f"ipc://{self.path}/nobody", code=1))
        self.assertIn("equal to the recorded ones, to the last bit", self.again(self.the_log(), "--server", self.bus))

    def test_nodes_that_move_are_replayed_from_the_logs_of_both_sessions(self):
        self.serve("--record", self.records, "--record-session", "job 7")
        with shearbus.open(GRADED, range(4), self.bus, domain="job 7") as one, \
                shearbus.open(GRADED, (), self.bus, domain="job 7") as two, shearbus.open(GRADED, [1], self.bus) as other:
            one.step(1e-9, jump=80.0, pressure=11.2e9)
            other.step(1e-9, jump=80.0, pressure=11.2e9)
            two.accept(one.offer([1, 3]))
            for _ in range(3):
                one.step(1e-9, jump=80.0, pressure=11.2e9)
                two.step(1e-9, jump=60.0, pressure=11.2e9)
        self.assertEqual(len(self.logs()), 2, "the session outside of the domain is not recorded")
        self.assertIn("equal to the recorded ones", self.again(self.records))
        alone = next(log for log in self.logs() if "accept_nodes" in verbs(read_log(log)[2]))
        self.assertIn("UNKNOWN_TRANSFER", self.again(alone, code=1))

    def test_a_log_goes_on_after_kill_and_a_torn_tail(self):
        where = ("--record", self.records, "--state-dir", self.path / "state")
        server = self.serve(*where)
        bus = shearbus.open(GRADED, range(3), self.bus)
        for _ in range(5):
            bus.step(1e-9, jump=80.0, pressure=11.2e9)
        server.send_signal(signal.SIGKILL)
        server.wait()
        whole = len(read_log(self.the_log())[2])
        index, begin = struct.pack("<Q", whole), struct.pack("<Q4I", 2**62, 60, 0, 0, 0)
        with open(self.the_log(), "ab") as log:  # a record that was being written
            log.write(index + begin + struct.pack("<Q", xxh3(index + begin)) + bytes(30))
        self.assertIn("ends in an incomplete record", self.again(self.the_log()))
        self.serve(*where)
        for _ in range(5):
            bus.step(1e-9, jump=80.0, pressure=11.2e9)
        bus.close()
        said = verbs(read_log(self.the_log())[2])
        self.assertEqual(len(said) - whole, said[whole:].count("resume_session") + 6 + said.count("downscale EPOCH"))
        self.assertEqual(said.count("downscale"), 10)
        self.assertIn("equal to the recorded ones", self.again(self.the_log()))

    def test_a_full_disk_ends_the_recording_and_no_answer(self):
        server = self.serve("--record", self.records, limit=30_000)
        with shearbus.open(GRADED, range(20), self.bus) as bus:
            answers = [bus.step(1e-9, jump=80.0, pressure=11.2e9).temperature[3] for _ in range(60)]
        self.assertEqual(len(set(answers)), 60)
        self.assertEqual(server.text().count("is not recorded any further"), 1, server.text())
        self.assertIn("File too large", server.text())
        said = verbs(read_log(self.the_log())[2])
        self.assertTrue(2 < said.count("downscale") < 60)
        self.assertIn("equal to the recorded ones", self.again(self.the_log()))

    def test_a_damaged_log_is_refused_with_the_place(self):
        self.serve("--record", self.records)
        with shearbus.open(GRADED, range(3), self.bus) as bus:
            for _ in range(5):
                bus.step(1e-9, jump=80.0, pressure=11.2e9)
        data = bytearray(self.the_log().read_bytes())
        data[len(data) * 3 // 4] ^= 1
        self.the_log().write_bytes(data)
        self.assertRegex(self.again(self.the_log(), code=1), r"byte \d+: .* does not match its sum")
        data[len(data) * 3 // 4] ^= 1
        first = 64 + struct.unpack_from("<I", data, 44)[0]
        second = first + 48 + sum(struct.unpack_from("<4I", data, first + 16))
        self.the_log().write_bytes(data[:second] + bytes(40) + data[second + 40:])  # zeros at the end of a file alone are a torn tail
        self.assertRegex(self.again(self.the_log(), code=1), f"byte {second}: the header of a record does not match its sum")
        self.the_log().write_bytes(data[:second] + bytes(len(data) - second))
        self.assertIn("ends in an incomplete record", self.again(self.the_log()))
        for bad in (b"SHBEVLG\n" + bytes(56), bytes(data[:40])):
            self.the_log().write_bytes(bad)
            self.assertRegex(self.again("export", self.the_log(), "--out", self.out, code=1), "version 0|not an event log")

    def test_a_directory_that_cannot_be_used_is_refused_at_the_start(self):
        (self.path / "file").write_text("")
        self.assertIn("is no directory", self.tool("server", "--bind", self.bus, "--record", self.path / "file", code=1))
        self.tool("server", "--bind", self.bus, "--record-session", "a", code=2)


class Clients(RecordTest):
    def test_the_python_client_writes_what_the_server_writes(self):
        self.serve("--record", self.records)
        own = self.path / "own.log"
        os.environ["SHEARBUS_RECORD"] = str(own)
        with shearbus.open(GRADED, range(5), self.bus) as bus:
            expected = self.talk(bus)
        os.environ["SHEARBUS_RECORD"] = str(own)
        with self.assertLogs("shearbus", "WARNING") as said, shearbus.open(GRADED, range(5), self.bus) as bus:
            bus.step(1e-9, jump=80.0, pressure=11.2e9)  # the file is there already: the second session is not recorded
        self.assertEqual(sum("is not recorded: " in line for line in said.output), 1)
        recorder, _, records = read_log(own)
        self.assertEqual((recorder, verbs(records)), (CLIENT, [*expected, "close_session"]))
        of_server = next(log for log in self.logs() if len(read_log(log)[2]) == len(records))
        self.assertEqual(records, read_log(of_server)[2], "the same frames")
        self.assertIn("equal to the recorded ones", self.again(own))
        self.assertIn("equal: 17 requests, 9 of them steps", self.again("compare", own, of_server))

    def test_the_python_client_goes_on_in_a_directory_and_on_a_full_disk(self):
        self.serve("--state-dir", self.path / "state")
        os.environ["SHEARBUS_RECORD"] = str(self.records) + "/"
        bus = shearbus.open(GRADED, range(5), self.bus)
        bus.step(1e-9, jump=80.0, pressure=11.2e9)
        ticket = bus.ticket
        bus.leave()
        bus = shearbus.resume(ticket, self.bus)
        bus.step(1e-9, jump=80.0, pressure=11.2e9)
        self.assertEqual(verbs(read_log(self.the_log())[2]),
                         ["open_session", "downscale", "resume_session", "resume_session", "downscale"])
        soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (self.the_log().stat().st_size + 100, hard))
        try:
            with self.assertLogs("shearbus", "WARNING") as said:
                for _ in range(3):
                    bus.step(1e-9, jump=80.0, pressure=11.2e9)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        bus.close()
        self.assertEqual(len(said.output), 1)
        self.assertEqual(len(read_log(self.the_log())[2]), 5)
        self.assertIn("equal to the recorded ones", self.again(self.the_log()))

    def test_a_host_in_c_is_recorded_without_a_change(self):
        os.environ["SHEARBUS_RECORD"] = f"{self.records}/"
        self.tool("contract_c", OPTIONS.server, EXAMPLES / "constant_friction.toml")
        self.assertGreater(len(self.logs()), 3)
        said = [verb for log in self.logs() for verb in verbs(read_log(log)[2])]
        for verb in ("downscale", "commit", "rollback", "mark", "register_nodes", "offer_nodes", "accept_nodes"):
            self.assertIn(verb, said)
        self.assertIn("equal to the recorded ones", self.again(self.records))

    def fortran_host(self, place):
        if not self.starts:
            self.serve()
        os.environ["SHEARBUS_RECORD"] = place
        return self.tool("contract_fortran", EXAMPLES / "constant_friction.toml", self.bus)

    def test_a_host_in_fortran_is_recorded_without_a_change(self):
        self.assertNotIn("not recorded", self.fortran_host(f"{self.records}/"))
        self.assertIn("equal to the recorded ones", self.again(self.records))

    def test_a_place_at_fault_is_a_line_for_people_and_no_fault_of_the_host(self):
        self.assertIn("is not recorded: cannot make", self.fortran_host(str(self.path / "none" / "file")))
        (self.path / "file").write_text("kept")
        said = self.fortran_host(str(self.path / "file"))
        self.assertIn("is not recorded: ", said)
        self.assertIn("file exists already; name a new file, or a directory with / at its end", said)
        self.assertEqual((self.path / "file").read_text(), "kept")

    def test_a_log_that_cannot_be_opened_is_told_and_no_fault_of_the_host(self):
        log = self.path / "none" / "log"
        os.environ["SHEARBUS_LOG"] = str(log)
        self.addCleanup(os.environ.pop, "SHEARBUS_LOG", None)
        said = self.fortran_host(f"{self.records}/")
        self.assertIn(f"SHEARBUS_LOG: {log} cannot be opened: No such file or directory; it gets no lines", said)
        log.parent.mkdir()
        self.assertNotIn("cannot be opened", self.fortran_host(f"{self.records}/"))

    def test_a_line_that_the_log_cannot_take_is_not_lost(self):
        self.serve()
        os.environ["SHEARBUS_LOG"] = "/dev/full"
        self.addCleanup(os.environ.pop, "SHEARBUS_LOG", None)
        said = self.fortran_host(str(self.path / "none" / "file"))
        self.assertIn("is not recorded: ", said)
        self.assertIn("SHEARBUS_LOG: /dev/full could not be written, and lacks this line", said)


if __name__ == "__main__":
    served.main()
