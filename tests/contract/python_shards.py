#!/usr/bin/python3
"""The Python client on several servers: the division of the nodes that the page describes, the bits of one server, and tickets that C and Python hand to
each other."""
import ctypes
import pathlib
import sys

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


class Shards(served.Served):
    def servers(self, count):
        directory = self.path / str(count)
        directory.mkdir(mode=0o700)
        return Servers(self, directory, count)

    def open(self, servers, nodes=NODES, scene=SCENE, **options):
        bus = shearbus.open(scene, nodes, servers.endpoint, **options)
        self.addCleanup(bus.leave)
        return bus

    def test_each_server_has_the_nodes_that_the_page_says(self):
        servers = self.servers(3)
        bus = self.open(servers)
        bus.leave()
        on = shard_of(NODES, 3)
        for number, endpoint in enumerate(servers.endpoints):
            part = shearbus.resume(ticket_of_shard(bus.ticket, number, 3), endpoint)
            self.assertEqual(part.nodes.tolist(), [node for node, shard in zip(NODES, on) if shard == number])
            part.leave()

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
        for code, nodes in (("SHAPE", []), ("UNKNOWN_NODE", [999_999])):
            with self.assertRaisesRegex(shearbus.Error, code):
                bus.profiles(nodes)
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

    def test_answers_are_those_of_one_server(self):
        expected = self.play(self.open(self.servers(1)))
        for count in (2, 3, 5):
            found = self.play(self.open(self.servers(count)))
            self.assertEqual(len(found), len(expected))
            for one, other in zip(found, expected):
                numpy.testing.assert_array_equal(one, other, f"{count} shards")

    def test_answers_of_two_tangential_components_are_those_of_one_server(self):
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


if __name__ == "__main__":
    served.main("server", "library", "source")
