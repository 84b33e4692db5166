"""Sessions of several pairs and with parameters after kill -9 of the server: what is reported, what is
refused, and the bits of a run to which nothing happens. Each answer is compared with that of a server that lives."""
import os
import pathlib
import signal
import sys

import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
import shearbus

MU, CONDUCTIVITY = "interface.friction_coefficient", "soft.thermal_conductivity_w_per_m_k"
SCENE = served.scene("force_driven", layer={"thickness_m": 50e-6, "cells": 30, "grading": 1.14},
                     interface={"friction_coefficient": 0.3, "yield_strength_pa": 60e6},
                     pair={"copper": {"soft": {"material": "copper_ofhc"}}, "weak": {"interface": {"friction_coefficient": 0.1, "yield_strength_pa": 20e6}}})
NODES = np.arange(40, 49)
PAIR = ["", "copper", "weak"] * 3
PARAMETERS = {MU: np.linspace(0.1, 0.3, 9), CONDUCTIVITY: np.repeat([100.0, 150.0, 200.0], 3)}
LATE = dict(nodes=[7], pair="weak", parameters={MU: [0.15], CONDUCTIVITY: [120.0]})
STEP = dict(jump=40.0, pressure=0.1e9, stress_soft=0.0, stress_hard=0.0, mass_soft=2.7, mass_hard=7.9)


class Resumed(served.Served):
    def server(self, name):
        return served.Server(self, self.path, name=name)

    def open(self, endpoint):
        return shearbus.open(SCENE, NODES, endpoint, pair=PAIR, parameters=PARAMETERS, check_closure="off")

    def step(self, session):
        answer = session.step(1e-9, **STEP)
        order = np.argsort(session.nodes)
        return np.stack([answer.stress, answer.temperature, answer.jump_new])[:, order].copy()

    def expect_all(self, session):
        """The report of a resumed session is what its nodes were registered with."""
        pairs = dict(zip([*NODES, 7], [*PAIR, "weak"]))
        self.assertEqual(session.resumed_pair, [pairs[node] for node in session.nodes.tolist()])
        for key, values in PARAMETERS.items():
            known = dict(zip([*NODES, 7], [*values, *LATE["parameters"][key]]))
            np.testing.assert_array_equal(session.resumed_parameters[key], [known[node] for node in session.nodes.tolist()])

    def refuse_others(self, ticket, endpoint):
        """A host with other pairs, parameters or nodes is refused with a reason; the session stays as it is."""
        good = dict(nodes=NODES, pair=PAIR, parameters=PARAMETERS)
        other_mu = PARAMETERS[MU].copy()
        other_mu[4] = 0.25
        for change, reason, nodes in (
                (dict(pair=["copper"] * 9), r'node 40 has the pair "" in the session, the host "copper" \(6 of 9', [40, 42, 43, 45, 46, 48]),
                (dict(parameters={MU: other_mu}), rf"{MU} of node 44 is 0.2 in the session, 0.25 of the host \(1 of 9", [44]),
                (dict(parameters={"soft.density_kg_per_m3": np.ones(9)}), "soft.density_kg_per_m3 is no parameter of the nodes", []),
                (dict(nodes=np.arange(41, 50)), r"node 40 has|node 41 has|node 49 is not in the session", None)):
            with self.assertRaisesRegex(shearbus.SessionError, reason) as caught:
                shearbus.resume(ticket, endpoint, check_closure="off", **(good | change))
            self.assertEqual(caught.exception.code, shearbus.Code.RESUME_REFUSED)
            if nodes is not None:
                self.assertEqual(list(caught.exception.nodes), nodes)

    def follow(self, endpoint, disasters):
        """Steps a session through the disasters and a twin without them."""
        calm = self.server("calm")
        with self.open(calm.endpoint) as twin:
            session = self.open(endpoint)
            for one in (twin, session):
                one.register(**LATE)
            np.testing.assert_array_equal(self.step(session), self.step(twin))
            self.assertEqual(len(set(self.step(twin)[1])), 10, "each node has a temperature of its own")
            self.step(session)
            for disaster in disasters:
                ticket = session.ticket
                disaster()
                np.testing.assert_array_equal(self.step(session), self.step(twin), "the client goes on")
                session.leave()  # as if the host had died
                disaster()
                self.refuse_others(ticket, endpoint)
                session = shearbus.resume(ticket, endpoint, check_closure="off", record=True, nodes=[*NODES, 7], pair=[*PAIR, "weak"],
                                          parameters={key: [*values, *LATE["parameters"][key]] for key, values in PARAMETERS.items()})
                self.expect_all(session)
                np.testing.assert_array_equal(self.step(session), self.step(twin), "the successor goes on")
            session.history.to_hdf5(self.path / "h.h5")  # a file of a resumed session has its pairs
            session.close()

    def test_kills_and_stops_of_one_server(self):
        server = self.server("bus")

        def kill():
            server.end()
            server.start()

        def stop():
            server.end(signal.SIGTERM)
            server.start()
        self.follow(server.endpoint, (kill, stop, kill))

    def test_kills_of_one_of_several_servers(self):
        servers = [self.server(f"shard{k}") for k in range(3)]

        def kill():
            victim = servers.pop(0)
            victim.end()
            victim.start()
            servers.append(victim)
        self.follow(",".join(server.endpoint for server in servers), (kill, kill))

    def test_a_refused_resumption_takes_the_session_from_nobody(self):
        server = self.server("bus")
        with self.open(server.endpoint) as session:
            self.step(session)
            with self.assertRaises(shearbus.SessionError):
                shearbus.resume(session.ticket, server.endpoint, nodes=NODES, pair=["weak"] * 9)
            self.step(session)  # its client has it still

    def test_a_session_of_one_pair_tells_none(self):
        server = self.server("bus")
        session = shearbus.open(SCENE[:SCENE.index("[pair")], NODES, server.endpoint, check_closure="off")
        session.leave()
        with self.assertRaisesRegex(shearbus.SessionError, 'node 41 has the pair "" in the session, the host "copper"'):
            shearbus.resume(session.ticket, server.endpoint, nodes=NODES, pair=PAIR)
        with shearbus.resume(session.ticket, server.endpoint, nodes=NODES) as again:
            self.assertIsNone(again.resumed_pair)
            self.assertEqual(again.resumed_parameters, {})


if __name__ == "__main__":
    os.environ.pop("SHEARBUS_RECORD", None)
    served.main("server")
