"""The conformity kit: plays problems with exact answers into the coupling routine of a host, and holds it to the
protocol and to closure. `shearbus-ctl rehearse` runs it, as does `python3 -m shearbus.conformity`."""
import math
import os
import subprocess
import tempfile
import threading
import time

from . import lossy_proxy, mock_server
from ._door import Refused

PROBLEM_CHECKS = ["pressure", "first_jump", "half_zones", "closure", "jump", "long_enough", "closed"]
RESTART_AFTER = 10
# Scenario -> problem, checks of the report.
SCENARIOS = {
    "two_half_spaces": ("two_half_spaces", mock_server.PROTOCOL),
    "finite_plate": ("finite_plate", PROBLEM_CHECKS),
    "losses": ("two_half_spaces", mock_server.REPEATED + ["sequence", "closure", "jump", "closed"]),
    "restart": ("two_half_spaces", mock_server.RESTARTED + ["sequence", "closure", "jump", "closed"]),
    "softening_friction": ("softening_friction", PROBLEM_CHECKS),
    "stick_slip_brake": ("stick_slip_brake", PROBLEM_CHECKS + ["rest"]),
    "flash_to_melting": ("flash_to_melting", PROBLEM_CHECKS),
    "opening_and_closing": ("opening_and_closing", PROBLEM_CHECKS),
    "turned_line": ("turned_line", PROBLEM_CHECKS),
    "without_strength": ("without_strength", PROBLEM_CHECKS + ["far_stresses", "rest"]),
}
DEFAULT = ("two_half_spaces", "finite_plate", "losses", "restart")  # the others need a host whose start or pressure can be chosen


def play(scenario, client, delay):
    """Runs a client, a function of (endpoint, problem) that returns None or why it failed, through a scenario. delay
    (s): of a reply that the proxy holds back. Returns {check: None, or why it failed}."""
    problem, checks = SCENARIOS[scenario]
    server = mock_server.MockServer(problem,
                                    RESTART_AFTER if scenario == "restart" else None,
                                    varying=scenario == "losses")
    over = threading.Event()
    with tempfile.TemporaryDirectory(prefix="shearbus-") as directory:
        endpoint = back = f"ipc://{directory}/mock"
        threads = [threading.Thread(target=server.serve, args=(back, over.is_set, False))]
        proxy = lossy_proxy.LossyProxy(delay)
        if scenario == "losses":
            endpoint = f"ipc://{directory}/proxy"
            threads.append(threading.Thread(target=proxy.serve, args=(endpoint, back, over.is_set)))
        for thread in threads:
            thread.start()
        try:
            failure = client(endpoint, problem)
        finally:
            over.set()
            for thread in threads:
                thread.join()
    results = {**server.report.results(checks), "exit": failure}
    if scenario == "losses" and set(proxy.done) != set(lossy_proxy.FAULTS):
        results["survival"] = f"of the faults of the proxy only {sorted(set(proxy.done))} came up"
    elif scenario == "losses":
        results["survival"] = failure
    return results


def command_client(command, timeout):
    """Returns the client that a command is: @endpoint and @problem stand in it for both, and SHEARBUS_ENDPOINT is the
    endpoint, too. timeout (s): of one run. The client raises Refused for a command that cannot be started."""
    def client(endpoint, problem):
        words = [word.replace("@endpoint", endpoint).replace("@problem", problem) for word in command]
        environment = {**os.environ, "SHEARBUS_ENDPOINT": endpoint}
        try:
            code = subprocess.run(words, timeout=timeout, stdin=subprocess.DEVNULL, env=environment).returncode
        except subprocess.TimeoutExpired:
            return f"not at its end after {timeout:g} s"
        except OSError as fault:
            raise Refused(f"the host cannot be started: {fault}; give its command behind --") from None
        return None if code == 0 else f"exit code {code}"
    return client


def judge(client, delay, server=None, scenarios=DEFAULT):
    """Plays the scenarios, and the problems against a real server if one is given. Prints what failed. Returns (checks
    that hold, checks)."""
    good = total = 0
    for scenario in scenarios:
        results = play(scenario, client, delay)
        good, total = good + tell(results, f"{scenario}, "), total + len(results)
    if server:
        for problem in dict.fromkeys(SCENARIOS[scenario][0] for scenario in scenarios):
            why = client(server, problem)
            good, total = good + (why is None), total + 1
            if why is not None:
                print(f"failed: real server, {problem}: expected: the host gets to its end; found: {why}")
    print(f"your client: {good} of {total}")
    return good, total


def tell(results, scenario=""):
    """Prints what failed, {check: None, or why it failed}. Returns the number of checks that hold."""
    unseen = [check for check, why in results.items() if why == mock_server.UNSEEN]
    for check, why in results.items():
        if why is not None and check not in unseen:
            print(f"failed: {scenario}{check}: expected: {mock_server.CHECKS.get(check, 'the host gets to its end')}; found: {why}")
    if unseen:
        sent = set(results) - {*unseen, "exit", "survival"}
        print(f"failed: {scenario}{'never seen: ' + ', '.join(unseen) if sent else 'the host sent no request to the endpoint that it was given'}")
    return sum(why is None for why in results.values())


def await_host(endpoint, problem, timeout=math.inf):
    """Serves a problem at an endpoint until a host has closed its session, until an interrupt, or for a time (s). Prints what failed.
    Returns (checks that hold, checks). Raises Refused for an endpoint that cannot be had."""
    server, end = mock_server.MockServer(problem), time.monotonic() + timeout

    def ready(bound):
        print(f"waiting at {bound} for a host with the problem {problem}; an interrupt ends it", flush=True)

    try:
        server.serve(endpoint, lambda: time.monotonic() > end, ready=ready)
    except KeyboardInterrupt:
        print()
    results = server.report.results(SCENARIOS[problem][1])
    good = tell(results)
    print(f"your client: {good} of {len(results)}")
    return good, len(results)
