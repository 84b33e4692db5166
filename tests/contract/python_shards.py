#!/usr/bin/python3
"""The Python client on several servers: the names that all clients share, the bits of one server, shards that are killed, and tickets that C and Python
hand to each other."""
import ctypes
import pathlib
import sys
import tempfile
import threading
import unittest

import numpy

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import OPTIONS
import shearbus
from shearbus import _library
from shearbus.columns import BY_NAME

SCENE = served.scene("velocity_driven", layer={"thickness_m": 20e-6, "cells": 30, "grading": 1.1})
NODES = [(7919 * i) % 2**20 for i in range(1, 41)]  # in no order


def drive(nodes, step=0):
    ids = numpy.asarray(nodes, float)
    return {"jump": 20 + ids % 97 + step, "pressure": 5e9 + 1e5 * (ids % 1009)}


def mixed(x):
    """The mixing function of SplitMix64 (proto/WIRE.md, "Several servers"), of an array of uint64."""
    x = (x ^ (x >> numpy.uint64(30))) * numpy.uint64(0xbf58476d1ce4e5b9)
    x = (x ^ (x >> numpy.uint64(27))) * numpy.uint64(0x94d049bb133111eb)
    return x ^ (x >> numpy.uint64(31))


def shard_of(nodes, shards):
    """The shard of each node, as the page says."""
    seeds = mixed(numpy.asarray(nodes, numpy.uint64))
    return numpy.argmax([mixed(seeds + numpy.uint64((k + 1) * 0x9e3779b97f4a7c15 % 2**64)) for k in range(shards)], axis=0)


def ticket_of_shard(ticket, shard, shards):
    """The ticket by which one server alone knows its part of a session, as the page says."""
    session, token = (bytes.fromhex(part) for part in ticket.split(":"))
    mask = int(mixed(numpy.array([(shards << 32) + shard + 1], numpy.uint64))[0])
    own = (int.from_bytes(session[:8], "little") ^ mask).to_bytes(8, "little") + session[8:]
    return f"{own.hex()}:{token.hex()}"


class CHost:
    """A host of the C library: opens a session, or resumes one by a ticket."""

    def __init__(self, endpoint, ticket=None):
        self.library = ctypes.CDLL(OPTIONS.library)
        self.library.shearbus_node_count.restype = ctypes.c_size_t
        self.library.shearbus_node_ids.restype = ctypes.POINTER(ctypes.c_uint64)
        self.session = ctypes.c_void_p()
        options = _library.Options(endpoint=endpoint.encode(), scene_text=SCENE.encode())
        if ticket is None:
            ids = numpy.array(NODES, numpy.uint64)
            code = self.library.shearbus_open(ctypes.byref(self.session), ctypes.byref(options), ctypes.c_size_t(len(ids)), ids.ctypes.data_as(ctypes.c_void_p),
                                              None, None)
        else:
            code = self.library.shearbus_resume(ctypes.byref(self.session), ctypes.byref(options), ticket.encode(), None)
        assert code == 0, code

    @property
    def nodes(self):
        return self.library.shearbus_node_ids(self.session)[:self.library.shearbus_node_count(self.session)]

    def step(self, step, trial=False):
        values = {name: numpy.ascontiguousarray(column) for name, column in drive(self.nodes, step).items()}
        stress = numpy.empty(len(self.nodes))
        columns = [_library.Column(BY_NAME[name].number, 0, array.ctypes.data, 0) for name, array in (*values.items(), ("stress", stress))]
        request = _library.Request(dt_s=1e-9, mode=int(trial), n=len(self.nodes), inputs=(_library.Column * 2)(*columns[:2]), n_inputs=2,
                                   outputs=(_library.Column * 1)(columns[2]), n_outputs=1)
        code = self.library.shearbus_step(self.session, ctypes.byref(request), None, None)
        assert code == 0, code
        return stress

    def leave(self):
        ticket = ctypes.create_string_buffer(80)
        assert self.library.shearbus_ticket(self.session, ticket, None) == 0
        self.library.shearbus_leave(ctypes.byref(self.session))
        return ticket.value.decode()


class Servers(list):
    """Durable servers, each with a socket and an endpoint file of its own."""

    def __init__(self, test, path, count):
        self.files = path / "endpoints"
        self.files.mkdir()
        super().__init__(served.Server(test, path, "--endpoint-file", self.files / str(number), name=f"bus{number}") for number in range(count))
        self.endpoints = [server.endpoint for server in self]
        self.endpoint = ",".join(self.endpoints)


class Live(unittest.TestCase):
    def servers(self, count):
        directory = tempfile.TemporaryDirectory(prefix="shearbus-")
        self.addCleanup(directory.cleanup)
        return Servers(self, pathlib.Path(directory.name), count)

    def open(self, servers, nodes=NODES, scene=SCENE, **options):
        bus = shearbus.open(scene, nodes, servers.endpoint, **options)
        self.addCleanup(bus.leave)
        return bus

    def refused(self, code, call, text=""):
        with self.assertRaises(shearbus.Error) as caught:
            call()
        self.assertEqual(caught.exception.code.name, code, caught.exception)
        self.assertIn(text, str(caught.exception))
        return caught.exception


class Names(Live):
    def test_a_list_names_each_server_once(self):
        for text, told in (("tcp://a:1,", "empty endpoint"), ("tcp://a:1,,tcp://b:1", "empty endpoint"), ("tcp://a:1, ,tcp://b:1", "empty endpoint"),
                           (",tcp://a:1", "empty endpoint"), ("tcp://a:1,tcp://b:1,tcp://a:1", "tcp://a:1 is named twice")):
            self.refused("INVALID_VALUE", lambda: shearbus.open(SCENE, NODES, text), told)
        with tempfile.TemporaryDirectory() as directory:
            self.refused("INVALID_VALUE", lambda: shearbus.open(SCENE, NODES, f"file://{directory}"), "no endpoint files")

    def test_each_server_has_the_nodes_that_the_page_says(self):
        servers = self.servers(3)
        bus = self.open(servers)
        bus.leave()
        on = shard_of(NODES, 3)
        for number, endpoint in enumerate(servers.endpoints):
            part = shearbus.resume(ticket_of_shard(bus.ticket, number, 3), endpoint)
            self.assertEqual(part.nodes.tolist(), [node for node, shard in zip(NODES, on) if shard == number])
            part.leave()


class Bits(Live):
    def play(self, bus):
        """Makes calls of every kind. Returns the arrays of their answers, ordered by node where the order is the servers'."""
        found = []

        def keep(answer):
            found.extend(getattr(answer, name).copy() for name in answer.columns)
            found.append(answer.state_version)

        keep(bus.step(1e-9, **drive(bus.nodes)))
        with bus.trial(2e-9, **drive(bus.nodes, 1)) as trial:
            keep(trial)
        with bus.trial(2e-9, **drive(bus.nodes, 2)) as trial:
            trial.reject()
        some = bus.nodes[3:29:2]
        keep(bus.step(1e-9, nodes=some, **drive(some, 3)))
        keep(bus.step(1e-9, nodes=some, absent_nodes="keep", want="ledger", **drive(some, 3)))
        layers = bus.profiles(bus.nodes[::3], pressure=numpy.linspace(1e9, 2e9, len(bus.nodes[::3])))
        found += [value for name, value in sorted(vars(layers).items()) if value is not None]
        self.refused("SHAPE", lambda: bus.profiles([]))
        self.refused("UNKNOWN_NODE", lambda: bus.profiles([999_999]))
        self.assertEqual(bus.mark("one"), ["one"])
        bus.retire(bus.nodes[5:9])
        bus.register([2**63, 5, 4], [350.0, 400.0, 450.0])
        keep(bus.step(1e-9, **drive(bus.nodes, 4)))
        found.append(bus.nodes)
        found.append(bus.rollback_to("one"))
        found.append(bus.nodes)
        bus.trial(1e-9, **drive(bus.nodes, 5))
        keep(bus.trial(1e-9, commit_previous=True, **drive(bus.nodes, 6)))
        found += [bus.commit(), bus.rollback()]
        keep(bus.step(1e-9, nodes=[], jump=1.0, pressure=1e9))
        keep(bus.step(1e-9, **drive(bus.nodes, 7)))
        found.append(bus.close().node_steps)
        return found

    def test_are_those_of_one_server(self):
        expected = self.play(self.open(self.servers(1)))
        for count in (2, 3, 5):
            found = self.play(self.open(self.servers(count)))
            self.assertEqual(len(found), len(expected))
            for one, other in zip(found, expected):
                numpy.testing.assert_array_equal(one, other, f"{count} shards")

    def test_of_two_tangential_components(self):
        def play(bus):
            jump = numpy.stack([drive(bus.nodes)["jump"], numpy.arange(len(bus.nodes))], axis=1)
            first = bus.step(1e-9, jump=jump, pressure=1e9)
            bus.trial(1e-9, jump=2 * jump, pressure=1e9)
            second = bus.trial(1e-9, jump=jump, pressure=2e9, commit_previous=True)
            return [first.stress, first.temperature, second.stress, second.outcome, bus.commit(), bus.profiles(bus.nodes).layer_shear_stress]

        scene = f"tangential_components = 2\n{SCENE}"
        found = [play(self.open(self.servers(count), scene=scene)) for count in (1, 3)]
        self.assertEqual(found[0][0].shape, (len(NODES), 2))
        for one, other in zip(*found):
            numpy.testing.assert_array_equal(one, other)

    def test_of_nodes_that_move_between_two_sessions(self):
        servers, one = self.servers(3), self.servers(1)
        answers = []
        for each in (one, servers):
            giver, taker = self.open(each, domain="run"), self.open(each, nodes=(), domain="run")
            giver.step(1e-9, **drive(giver.nodes))
            moved = giver.nodes[:11]
            taken = taker.accept(giver.offer(moved))
            self.assertEqual(set(taken), set(moved))
            self.assertEqual(list(giver.nodes), NODES[11:])
            order = numpy.argsort(taken)
            answers.append([taker.step(1e-9, **drive(taker.nodes, 1)).stress[order], giver.step(1e-9, **drive(giver.nodes, 1)).stress])
            self.refused("UNKNOWN_TRANSFER", lambda: taker.accept(b"x" * 16))
            self.refused("NODE_OWNED", lambda: taker.register([*taken[:0], *giver.nodes[:1], 999_999]))
            self.assertEqual(len(taker.nodes), 11)
            taker.register([999_999])
        for found, expected in zip(*answers):
            numpy.testing.assert_array_equal(found, expected)


class Losses(Live):
    def test_any_shard_may_be_killed_at_any_time(self):
        expected = self.open(self.servers(1))
        servers = self.servers(3)
        bus = self.open(servers, retry_after=0.2)
        stop = threading.Event()

        def killer():
            victims = numpy.random.default_rng(5)
            while not stop.wait(victims.uniform(0.02, 0.15)):
                victim = servers[victims.integers(3)]
                victim.end()
                victim.start()

        thread = threading.Thread(target=killer)
        thread.start()
        try:
            for step in range(25):
                if step % 3:
                    found = bus.step(1e-9, **drive(NODES, step))
                else:
                    with bus.trial(1e-9, **drive(NODES, step)) as found:
                        pass
                numpy.testing.assert_array_equal(found.temperature, expected.step(1e-9, **drive(NODES, step)).temperature)
                if step % 5 == 0:
                    bus.mark(f"step {step}")
        finally:
            stop.set()
            thread.join()
        self.assertEqual(bus.rollback_to("step 20"), 21)
        self.assertGreaterEqual(bus.close().node_steps, 25 * len(NODES))

    def test_a_shard_that_is_away_leaves_the_call_to_be_repeated(self):
        servers = self.servers(2)
        bus = self.open(servers, reply_deadline=0.5, retry_after=0.2)
        servers[1].stop()
        for _ in range(2):
            self.refused("UNKNOWN_OUTCOME", lambda: bus.step(1e-9, **drive(NODES)))
        self.refused("UNKNOWN_OUTCOME", lambda: bus.mark("a"))
        servers[1].go()
        # Another call first completes the interrupted one, which the shard that was there has run.
        self.refused("SEQUENCE_REUSED", lambda: bus.mark("a"))
        self.assertEqual(bus.step(1e-9, **drive(NODES, 1)).state_version, 2)
        # Of a step that no shard has run nothing remains.
        for server in servers:
            server.end()
        bus.leave()
        self.refused("UNREACHABLE", lambda: shearbus.open(SCENE, NODES, servers.endpoint, connect_deadline=0.1))

    def test_an_opening_without_an_answer_opens_once(self):
        servers = self.servers(2)
        servers[1].stop()
        threading.Timer(0.3, servers[1].go).start()

        def opening():
            return self.open(servers, domain="run", connect_deadline=5.0)

        bus = opening()
        self.refused("NODE_OWNED", opening)
        # What a refused opening had opened on some servers is closed again.
        mixed = [*range(2**30, 2**30 + 10), NODES[0]]
        self.refused("NODE_OWNED", lambda: self.open(servers, mixed, domain="run"))
        self.open(servers, mixed[:-1], domain="run").close()
        bus.close()

    def test_a_refused_step_leaves_all_shards_at_the_same_step(self):
        servers, one = self.servers(2), self.servers(1)
        ids = numpy.array(NODES, numpy.uint64)
        on = shard_of(ids, 2)
        versions = []
        for each in (one, servers):
            bus = self.open(each)
            bus.trial(1e-9, **drive(NODES))
            wrong = drive(NODES)
            wrong["pressure"][on == 1] = 1e16  # out of bounds, on one shard only
            fault = self.refused("INVALID_VALUE", lambda: bus.trial(1e-9, commit_previous=True, **wrong))
            self.assertTrue(set(fault.nodes) <= set(ids[on == 1].tolist()), fault.nodes)
            versions.append((bus.commit(), bus.step(1e-9, **drive(NODES)).stress.tolist()))
        self.assertEqual(*versions)


class Successors(Live):
    def on_shards(self, bus, servers, numbers, call):
        """Makes a call on some servers of a session that was left, each by itself."""
        for number in numbers:
            part = shearbus.resume(ticket_of_shard(bus.ticket, number, len(servers)), servers[number].endpoint)
            call(part)
            part.leave()

    def test_c_and_python_hand_a_session_to_each_other(self):
        servers, one = self.servers(3), self.servers(1)
        host = CHost(servers.endpoint)
        stress = [host.step(0)]
        bus = shearbus.resume(host.leave(), servers.endpoint)
        order = {node: row for row, node in enumerate(bus.nodes.tolist())}
        rows = [order[node] for node in NODES]
        stress.append(bus.step(1e-9, **drive(bus.nodes, 1)).stress[rows])
        bus.trial(1e-9, **drive(bus.nodes, 2))
        bus.leave()
        host = CHost(servers.endpoint, bus.ticket)
        self.assertEqual(host.nodes, bus.nodes.tolist())
        stress.append(host.step(3)[rows])
        bus = shearbus.resume(host.leave(), f"file://{servers.files}")
        stress.append(bus.step(1e-9, nodes=NODES, **drive(NODES, 4)).stress)
        bus.close()
        plain = self.open(one)
        for step, found in zip((0, 1, 3, 4), stress):
            numpy.testing.assert_array_equal(found, plain.step(1e-9, **drive(NODES, step)).stress)

    def test_a_commit_that_was_under_way_is_completed(self):
        servers = self.servers(3)
        bus, plain = self.open(servers), self.open(self.servers(1))
        numpy.testing.assert_array_equal(bus.step(1e-9, **drive(NODES)).stress, plain.step(1e-9, **drive(NODES)).stress)
        for committed in (0, 1, 2):
            bus.trial(1e-9, **drive(bus.nodes, committed))
            plain.trial(1e-9, **drive(NODES, committed))
            bus.leave()
            self.on_shards(bus, servers, range(committed), lambda part: part.commit())
            bus = shearbus.resume(bus.ticket, servers.endpoint)
            self.addCleanup(bus.leave)
            plain.commit()
            if not committed:  # the trial stands on all, and the successor decides
                bus.commit()
            found = bus.step(1e-9, nodes=NODES, **drive(NODES, 9))
            expected = plain.step(1e-9, **drive(NODES, 9))
            self.assertEqual(found.state_version, expected.state_version)
            numpy.testing.assert_array_equal(found.stress, expected.stress)
        bus.leave()
        self.on_shards(bus, servers, [1], lambda part: part.trial(1e-9, **drive(part.nodes)))
        bus = shearbus.resume(bus.ticket, servers.endpoint)
        self.refused("NOTHING_TO_COMMIT", bus.commit)
        self.assertEqual(bus.step(1e-9, **drive(bus.nodes)).state_version, plain.step(1e-9, **drive(NODES)).state_version)
        bus.close()

    def test_shards_at_different_steps_are_rolled_back_to_a_common_mark(self):
        servers = self.servers(2)
        bus = self.open(servers)
        bus.mark("start")
        bus.leave()
        self.on_shards(bus, servers, [1, 1], lambda part: part.step(1e-9, **drive(part.nodes)))
        bus = shearbus.resume(bus.ticket, servers.endpoint)
        self.refused("EPOCH", lambda: bus.step(1e-9, **drive(bus.nodes)), "state versions are 0, 2")
        self.refused("EPOCH", bus.commit)
        self.assertEqual(bus.rollback_to("start"), 0)
        self.assertEqual(bus.step(1e-9, **drive(bus.nodes)).state_version, 1)
        bus.close()

    def test_a_ticket_is_of_all_servers_in_their_order(self):
        servers = self.servers(3)
        bus = shearbus.open(SCENE, NODES, ",".join(servers.endpoints[:2]))
        bus.leave()
        one, two, three = servers.endpoints
        for others in ((two, one), (one, two, three), (one, three)):
            self.refused("UNKNOWN_SESSION", lambda: shearbus.resume(bus.ticket, ",".join(others)), "all of them, in the same order")
        with shearbus.resume(bus.ticket, f"{one},{two}") as successor:
            self.assertEqual(sorted(successor.nodes.tolist()), sorted(NODES))
            self.refused("INVALID_VALUE", lambda: shearbus.open(SCENE, [1], f"{one},file://{servers.files}/0"), "another endpoint of the list names")


if __name__ == "__main__":
    served.main("server", "library", "source")
