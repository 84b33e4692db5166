#!/usr/bin/python3
"""The host of client/examples/host.py on both problems of the conformity kit, and hosts and clients made
wrong on purpose.

kit_host.py ENDPOINT PROBLEM [FAULT]

The fault "stick_form" is none: the same host in stick form."""
import importlib.util
import pathlib
import sys

SOURCE = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(SOURCE / "client/python"))
import numpy  # noqa: E402
import shearbus  # noqa: E402

spec = importlib.util.spec_from_file_location("host", SOURCE / "client/examples/host.py")
example = importlib.util.module_from_spec(spec)
spec.loader.exec_module(example)

STEPS = {"two_half_spaces": 100, "finite_plate": 350}
DEPTH, PLATE_ZONES = 0.5e-3, 100  # of the plate, m
RETRY_S = 0.1
# Fault -> the check of the kit that must notice it, and the scenario that shows it.
FAULTS = {
    "sign_of_a_stress": ("closure", "two_half_spaces"),
    "sign_of_the_jump": ("first_jump", "two_half_spaces"),
    "sides_swapped": ("half_zones", "two_half_spaces"),
    "one_side_only": ("closure", "two_half_spaces"),
    "masses_of_whole_zones": ("closure", "two_half_spaces"),
    "whole_first_step": ("first_step", "two_half_spaces"),
    "whole_first_step_of_long_zones": ("first_step", "two_half_spaces"),  # the jump after it is right by chance
    "pressure_in_gpa": ("pressure", "two_half_spaces"),
    "stress_of_the_first_step_for_ever": ("closure", "finite_plate"),
    "plate_without_a_back": ("jump", "finite_plate"),
    "small_area": ("jump", "two_half_spaces"),
    "impedance_of_one_side": ("closure", "two_half_spaces"),
    "stick_stress_without_jump": ("far_stresses", "two_half_spaces"),
    "sequence_skips": ("sequence", "two_half_spaces"),
    "no_epoch": ("epoch", "two_half_spaces"),
    "wrong_sum": ("payload_sum", "two_half_spaces"),
    "never_closes": ("closed", "two_half_spaces"),
    "same_request_id": ("request_id", "two_half_spaces"),
    "repeats_other_bytes": ("repeats", "losses"),
    "repeats_on_the_same_socket": ("fresh_socket", "losses"),
    "takes_any_reply": ("closure", "losses"),
    "goes_on_after_a_restart": ("restart", "restart"),
}


def run(endpoint, problem, fault=None):
    """Runs a host on a problem. Raises shearbus.Error if it cannot."""
    steps, dt = STEPS[problem], example.DT
    plate = problem == "finite_plate" and fault != "plate_without_a_back"
    if problem == "finite_plate":
        dt = DEPTH / PLATE_ZONES * numpy.sqrt(2703.0 / 27.6e9)
    transit = 2 * dt if fault == "whole_first_step_of_long_zones" else dt
    soft = example.Body(2703.0, 27.6e9, example.INITIAL_JUMP, +1, PLATE_ZONES if plate else steps, transit)
    hard = example.Body(7900.0, 77e9, 0.0, -1, steps, transit)
    masses = [body.half_mass * (2 if fault == "masses_of_whole_zones" else 1) for body in (soft, hard)]
    area = 0.9 if fault == "small_area" else 1.0  # that the host takes for the area of a node, relative to the true one
    masses = [mass / area for mass in masses]
    if fault == "sides_swapped":
        masses.reverse()
    bus = shearbus.open(example.SCENE,
                        range(3),
                        endpoint,
                        connect_deadline=5.0,
                        reply_deadline=2.0,
                        retry_after=RETRY_S, closure="off")
    spoil(bus, fault)
    nodes, first = slice(0, 3), None
    for step in range(steps):
        length = dt if step > 0 or (fault or "").startswith("whole_first_step") else dt / 2
        jump = (soft.velocity[:, 0] - hard.velocity[:, 0])[nodes]
        inputs = {"stress_soft": soft.stress[nodes, 0] / area * (-1 if fault == "sign_of_a_stress" else 1),
                  "stress_hard": hard.stress[nodes, 0] / area, "mass_soft": masses[0], "mass_hard": masses[1]}
        if fault in ("stick_form", "impedance_of_one_side", "stick_stress_without_jump"):
            z = 1 / (length * (1 / masses[0] + 1 / masses[1]))
            free = length * (inputs["stress_soft"] / masses[0] + inputs["stress_hard"] / masses[1])
            inputs = {"stick_stress": z * (free + (0 if fault == "stick_stress_without_jump" else jump)),
                      "impedance": masses[0] / length if fault == "impedance_of_one_side" else z}
        answer = bus.step(length, jump=-jump if fault == "sign_of_the_jump" else jump,
                          pressure=1.0 if fault == "pressure_in_gpa" else 1e9, step=step, **inputs)
        first = answer.stress[0] if first is None else first
        stress = answer.stress[0] if fault != "stress_of_the_first_step_for_ever" else first * 1.01
        stress = stress * area
        soft.accelerate(length, stress)
        hard.accelerate(length, 0.0 if fault == "one_side_only" else stress)
        for body in (soft, hard):
            body.deform(dt)
    if fault == "never_closes":
        bus.leave()
    bus.__exit__(None)


def spoil(bus, fault):
    """Makes the client wrong in the way that `fault` names."""
    connection = bus._connection
    if fault == "sequence_skips":
        bus._sequence += 1
    elif fault == "no_epoch":
        bus._epoch = 0
    elif fault == "same_request_id":
        number = connection.next_request_id()
        connection.next_request_id = lambda: number
    elif fault == "wrong_sum":
        frames = bus._frames
        bus._frames = lambda *arguments: [
            f if i == 0 else bytes(f)[:-1] + b"\x01" for i, f in enumerate(frames(*arguments))
        ]
    elif fault == "repeats_other_bytes":
        send, sent = connection._send, []

        def send_with_another_id(frames):
            if frames[0] in sent:
                frames = [bytes(frames[0]) + b"\x18\x00", *frames[1:]]  # protocol_minor = 0, written out
            sent.append(frames[0])
            return send(frames)
        connection._send = send_with_another_id
    elif fault == "repeats_on_the_same_socket":
        connection.close = lambda: None
    elif fault == "takes_any_reply":
        receive = connection._receive

        def receive_any(request_id, until, started):
            original = shearbus.connection.header.REPLY_HEADER.decode

            def decode(data):
                found = original(data)
                found.request_id = request_id
                return found
            shearbus.connection.header.REPLY_HEADER.decode = decode
            try:
                return receive(request_id, until, started)
            finally:
                shearbus.connection.header.REPLY_HEADER.decode = original
        connection._receive = receive_any
    elif fault == "goes_on_after_a_restart":
        def adopt(_):
            bus._epoch = 0
            return 0
        bus._follow_restart = adopt


if __name__ == "__main__":
    run(*sys.argv[1:])
