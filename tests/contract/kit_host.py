#!/usr/bin/python3
"""The host of client/examples/host.py on the problems of the conformity kit, and hosts and clients made
wrong on purpose: a client by a proxy that spoils what the right one sends and receives.

kit_host.py ENDPOINT PROBLEM [FAULT]

The fault "stick_form" is none: the same host in stick form."""
import contextlib
import importlib.util
import pathlib
import sys
import tempfile
import threading

import zmq

SOURCE = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(SOURCE / "client/python"))
import numpy  # noqa: E402
import shearbus  # noqa: E402
from shearbus.conformity.mock_server import EPOCH, OK, WIRE_TYPES, read, varint, write  # noqa: E402
from shearbus.conformity.problems import Problem  # noqa: E402

spec = importlib.util.spec_from_file_location("host", SOURCE / "client/examples/host.py")
example = importlib.util.module_from_spec(spec)
spec.loader.exec_module(example)

STEPS = {"two_half_spaces": 100, "finite_plate": 350, "softening_friction": 100, "stick_slip_brake": 1000, "flash_to_melting": 450,
         "opening_and_closing": 300, "turned_line": 100, "without_strength": 60}
NODES, ANGLE = 3, numpy.radians(30.0)  # of turned_line, whose columns of zones are those of both components of each node
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
    "pressure_of_the_start": ("pressure", "opening_and_closing"),
    "friction_without_stick": ("rest", "stick_slip_brake"),
    "friction_while_open": ("closure", "opening_and_closing"),
    "friction_of_cold_metal": ("closure", "softening_friction"),
    "friction_past_melting": ("closure", "flash_to_melting"),
    "friction_along_x": ("closure", "turned_line"),
    "masses_of_cells": ("half_zones", "without_strength"),
    "stress_of_a_solid": ("far_stresses", "without_strength"),
}


def run(endpoint, problem, fault=None, nodes=NODES, plate_zones=PLATE_ZONES, end=None, jump=None, scene=None, **options):
    """Runs a host on a problem, in its own jump (m/s) if one is given, and until a time (s) instead of STEPS. Returns the rows of play().
    Raises shearbus.Error if it cannot."""
    of, dt = Problem(problem), example.DT
    plate = of.finite and fault != "plate_without_a_back"
    if of.finite:
        dt = DEPTH / plate_zones * numpy.sqrt(2703.0 / 27.6e9)
    steps = int(end / dt) + 2 if end else STEPS[problem]
    transit = 2 * dt if fault == "whole_first_step_of_long_zones" else dt
    tangent = [numpy.cos(ANGLE), numpy.sin(ANGLE)] if problem == "turned_line" else [1.0]
    example.NODES = nodes * len(tangent)
    soft = example.Body(2703.0, 27.6e9, jump or of.jump, +1, plate_zones if plate else steps, transit)
    hard = example.Body(7900.0, 77e9, 0.0, -1, steps, transit)
    soft.velocity *= numpy.tile(tangent, nodes)[:, None]
    if of.masses:
        soft.half_mass, hard.half_mass = of.masses
    masses = [body.half_mass * (2 if fault in ("masses_of_whole_zones", "masses_of_cells") else 1) for body in (soft, hard)]
    area = 0.9 if fault == "small_area" else 1.0  # that the host takes for the area of a node, relative to the true one
    masses = [mass / area for mass in masses]
    if fault == "sides_swapped":
        masses.reverse()
    scene = scene or f"tangential_components = {len(tangent)}\n" + example.SCENE.read_text()
    options = {"connect_deadline": 5.0, "reply_deadline": 2.0, "retry_after": RETRY_S, "check_closure": "off", **options}
    with contextlib.ExitStack() as stack:
        if fault in Spoiler.FAULTS:
            endpoint = stack.enter_context(Spoiler(endpoint, fault)).endpoint
        bus = shearbus.open(scene, range(nodes), endpoint, **options)
        rows = play(bus, of, fault, steps, dt, soft, hard, masses, area)
        if fault == "never_closes":
            bus.leave()
        bus.__exit__(None)
    return rows


def play(bus, problem, fault, steps, dt, soft, hard, masses, area):
    """Plays a run of a host into a session. Returns of the first node in each step: its middle (s), the velocities of both faces and the stress
    by their components, and T0."""
    pressure_at = Problem("two_half_spaces").pressure if fault == "pressure_of_the_start" else problem.pressure
    shaped = lambda rows: rows.reshape(-1, 2) if bus.components == 2 else rows
    first, rows = None, []
    for step in range(steps):
        if step == 12 and fault in (None, "stick_form"):  # a restart dump, and a restart from it, change nothing
            if bus.mark("dump") != ["dump"]:
                raise AssertionError("no mark of this name")
            bus.rollback_to("dump")
        length = dt if step > 0 or (fault or "").startswith("whole_first_step") else dt / 2
        jump = shaped(soft.velocity[:, 0] - hard.velocity[:, 0])
        inputs = {"stress_soft": shaped(soft.stress[:, 0]) / area * (-1 if fault == "sign_of_a_stress" else 1),
                  "stress_hard": shaped(hard.stress[:, 0]) / area, "mass_soft": masses[0], "mass_hard": masses[1]}
        if fault in ("stick_form", "impedance_of_one_side", "stick_stress_without_jump"):
            z = 1 / (length * (1 / masses[0] + 1 / masses[1]))
            free = length * (inputs["stress_soft"] / masses[0] + inputs["stress_hard"] / masses[1])
            inputs = {"stick_stress": z * (free + (0 if fault == "stick_stress_without_jump" else jump)),
                      "impedance": masses[0] / length if fault == "impedance_of_one_side" else z}
        answer = bus.step(length, jump=-jump if fault == "sign_of_the_jump" else jump,
                          pressure=1.0 if fault == "pressure_in_gpa" else pressure_at(step * dt), step=step, **inputs)
        first = answer.stress if first is None else first
        stress = answer.stress if fault != "stress_of_the_first_step_for_ever" else first * 1.01
        if fault == "friction_without_stick" and abs(stress[0]) > 0:
            stress = numpy.copysign(example.FRICTION * 0.5e9, stress)
        if fault in ("friction_while_open", "friction_of_cold_metal", "friction_past_melting"):
            stress = first
        if fault == "friction_along_x":
            stress = stress * [1, 0]
        stress = stress.reshape(-1) * area
        soft.accelerate(length, stress)
        hard.accelerate(length, 0.0 if fault == "one_side_only" else stress)
        if problem.masses is None or fault == "stress_of_a_solid":
            for body in (soft, hard):
                body.deform(dt)
        rows.append(((step + 0.5) * dt, *(values[:bus.components].copy() for values in (soft.velocity[:, 0], hard.velocity[:, 0], stress)),
                     answer.temperature[0]))
    return rows


def replaced(header, number, value):
    """Returns a header whose field `number` has another value, or is left out for None."""
    fixed = {field: {1: "fixed64", 5: "fixed32"}.get(kind) for field, kind in WIRE_TYPES.items()}
    fields = {**read(header), number: [] if value is None else [value]}
    return write([(field, (fixed[field], one) if fixed.get(field) else one) for field in sorted(fields) for one in fields[field]])


MINOR, REQUEST_ID, SEQUENCE, EPOCH_FIELD, STATUS = 3, 4, 6, 7, 9  # fields of the envelope
STEP = 18  # body of a request, and of the reply to it


class Spoiler:
    """A proxy that makes a right client wrong in the way that `fault` names. Each socket of the client gets one of its own to
    the server, but for a client that repeats on the same socket."""

    FAULTS = ("sequence_skips", "no_epoch", "same_request_id", "wrong_sum", "repeats_other_bytes", "repeats_on_the_same_socket",
              "takes_any_reply", "goes_on_after_a_restart")

    def __init__(self, server, fault):
        self.server, self.fault, self.seen, self.ids = server, fault, set(), []
        self.step, self.adopted = None, False
        self.answered, self.late = set(), None  # ids of the requests that the client has an answer to; a second answer to one
        self.directory = tempfile.TemporaryDirectory(prefix="shearbus-")
        self.endpoint = f"ipc://{self.directory.name}/spoiler"
        self.over = threading.Event()
        self.thread = threading.Thread(target=self.serve)

    def __enter__(self):
        self.thread.start()
        return self

    def __exit__(self, *_):
        self.over.set()
        self.thread.join()
        self.directory.cleanup()

    def serve(self):
        with zmq.Context() as context, context.socket(zmq.ROUTER) as front:
            front.bind(self.endpoint)
            links = {}
            while not self.over.is_set():
                poller = zmq.Poller()
                for socket in (front, *links.values()):
                    poller.register(socket, zmq.POLLIN)
                ready = dict(poller.poll(10))
                if front in ready:
                    peer, *frames = front.recv_multipart()
                    self.peer = peer
                    one = b"" if self.fault == "repeats_on_the_same_socket" else peer
                    if one not in links:
                        links[one] = context.socket(zmq.DEALER)
                        links[one].connect(self.server)
                    links[one].send_multipart(self.request(frames))
                    if self.late and STEP in read(frames[0]):
                        front.send_multipart([peer, *self.taken_for_the_last(self.late)])
                        self.late = None
                for one, socket in links.items():
                    if socket in ready:
                        frames = self.reply(socket.recv_multipart(), socket)
                        if frames:
                            front.send_multipart([one or self.peer, *frames])
            for socket in links.values():
                socket.close(0)

    def request(self, frames):
        """Returns the frames that the wrong client sends."""
        header, *payload = frames
        fields = read(header)
        again, number = header in self.seen, fields[REQUEST_ID][0]
        self.seen.add(header)
        self.ids.append(number)
        if self.fault == "sequence_skips" and fields.get(SEQUENCE, [0])[0]:
            header = replaced(header, SEQUENCE, fields[SEQUENCE][0] + 1)
        elif self.fault == "no_epoch" or self.adopted:
            header = replaced(header, EPOCH_FIELD, None)
        elif self.fault == "same_request_id":
            header = replaced(header, REQUEST_ID, self.ids[0])
        elif self.fault == "wrong_sum" and payload:
            payload = [payload[0][:-1] + b"\x01"]
        elif self.fault == "repeats_other_bytes" and again:
            header += varint(MINOR << 3) + b"\x00"  # protocol_minor = 0, written out
        if STEP in fields:
            self.step = [header, *payload]
        return [header, *payload]

    def reply(self, frames, socket):
        """Returns the frames that the client takes for the reply to its last request; None for none."""
        header = frames[0]
        code = read(read(header)[STATUS][0])[1][0] if STATUS in read(header) else OK
        if self.fault == "goes_on_after_a_restart" and code == EPOCH:
            self.adopted = True
            socket.send_multipart([replaced(self.step[0], EPOCH_FIELD, None), *self.step[1:]])
            return None
        if self.fault == "takes_any_reply" and read(header)[REQUEST_ID][0] in self.answered:
            self.late = frames if STEP in read(header) else self.late
            return None
        return self.taken_for_the_last(frames) if self.fault in ("same_request_id", "takes_any_reply") else frames

    def taken_for_the_last(self, frames):
        self.answered.add(self.ids[-1])
        return [replaced(frames[0], REQUEST_ID, self.ids[-1]), *frames[1:]]


if __name__ == "__main__":
    run(*sys.argv[1:])
