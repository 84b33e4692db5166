"""Plays problems with exact answers into the coupling routine of a host, by a mock server that holds the host to the
protocol and to closure. Prints what failed and, last, "your client: 41 of 43".

shearbus-ctl rehearse [--problem NAME] [--timeout S] ENDPOINT
    waits for one run of a host that was started by hand
shearbus-ctl rehearse [--server ENDPOINT] [--scenario NAME]... [--timeout S] [--delay S] -- COMMAND...
    starts the host for each scenario: the first two problems, messages that are lost, doubled and delayed, a restart of the
    server; "all" stands for these and all problems. In the command @endpoint and @problem stand for both; a host of the client libraries needs no @endpoint,
    because the environment has SHEARBUS_ENDPOINT. Its exit code says whether it got to its end.

Problems, with any mesh and at least 20 steps: aluminium (2703 kg/m3, 27.6 GPa), z > 0, slides at 100 m/s on steel
(7900 kg/m3, 77 GPa), both elastic, under 1 GPa. The mock server answers the friction of the problem, 0.05 times the pressure where
none is named, whatever the law of the scene.
    two_half_spaces   the jump is 92.184 m/s from the first step on
    finite_plate      0.5 mm of aluminium with a free back: the jump falls by 11.58 m/s every 312.9 ns
The others are played where they are named (client/examples/problems has their answers):
    softening_friction    the half-spaces under 11.2 GPa; friction falls with heat: 185.99 MPa and 70.93 m/s at 100 ns
    stick_slip_brake      the plate at 30 m/s stops after 625.8 ns and rests; 0.1 GPa from 1.1 us on let it slip back
    flash_to_melting      the half-spaces at 400 m/s, 0.1 times the pressure: 1220 K from 274.7 ns on, with ever less friction
    opening_and_closing   the half-spaces under -0.5 GPa from 100 to 200 ns: 100 m/s meanwhile, 92.184 m/s before and after
    turned_line           two_half_spaces on a line at 30 degrees to the x axis; with two tangential components the axes are yours
    without_strength      bodies without shear stress, of which 27.03 and 79 g/m2 move with the interface (half zones of 20 um, or
                          cells of 10 um): the jump falls by 2.482 m/s each ns and is 0 from 40.28 ns on"""
import argparse
import math
import signal
import sys

from .._terminal import Parser, complain, positive_number
from . import DEFAULT, SCENARIOS, await_host, command_client, judge
from ._door import Refused, check_endpoint
from .problems import Problem


def interrupt(*_):
    raise KeyboardInterrupt


def end_as_by_interrupt():
    """Other requests to end are taken as an interrupt: sockets are removed, and started hosts end. nohup is respected."""
    for number in (signal.SIGTERM, signal.SIGHUP):
        if signal.getsignal(number) != signal.SIG_IGN:
            signal.signal(number, interrupt)


def main(words):
    parser = Parser(prog="shearbus-ctl rehearse", description=__doc__, usage=argparse.SUPPRESS)
    parser.add_argument("endpoint", nargs="?", help="tcp://host:port or ipc://path, for a host started by hand")
    parser.add_argument("--problem", choices=Problem.NAMES, default=Problem.NAMES[0])
    parser.add_argument("--server", help="endpoint of a real server, against which the host is run at the end")
    parser.add_argument("--scenario", action="append", choices=[*SCENARIOS, "all"], help="only this one, repeatable")
    parser.add_argument("--timeout", type=positive_number,
                        help="of one run of the host, in s (120); with ENDPOINT of the wait for it and its run (none)")
    parser.add_argument("--delay", type=positive_number, default=8.0,
                        help="of a delayed reply, in s (8): longer than the client waits before it repeats a request")
    at = words.index("--") if "--" in words else len(words)
    options, command = parser.parse_args(words[:at]), words[at + 1:]
    if bool(options.endpoint) == bool(command):
        parser.error("expected either an ENDPOINT or -- and the command of a host")
    for name in ("server", "scenario", "delay") if options.endpoint else ("problem",):
        if getattr(options, name) != parser.get_default(name):
            parser.error(f"--{name} is without effect with {'an ENDPOINT' if options.endpoint else 'a COMMAND'}; leave it out")
    end_as_by_interrupt()
    try:
        if options.endpoint:
            check_endpoint(options.endpoint)
    except Refused as fault:
        parser.error(str(fault))
    try:
        if options.endpoint:
            good, total = await_host(options.endpoint, options.problem, options.timeout or math.inf)
        else:
            good, total = judge(command_client(command, options.timeout or 120.0), options.delay, options.server,
                                tuple(SCENARIOS) if "all" in (options.scenario or ()) else options.scenario or DEFAULT)
    except Refused as fault:
        complain(parser.prog, fault)
        return 1
    except KeyboardInterrupt:
        complain(parser.prog, "interrupted before the last scenario")
        return 1
    return good < total


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
