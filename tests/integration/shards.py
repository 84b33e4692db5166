"""Hosts in C, C++, Fortran and Python and shearbus-hydro on several servers: what they print and write is what they do with one server."""
import os
import pathlib
import re
import subprocess
import sys

import h5py
import numpy

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import EXAMPLES, OPTIONS

PYTHON_HOST = "host.py"


class Shards(served.Served):
    def start(self, directory, number, *options):
        name = f"{directory.name}-{number}"
        with open(self.path / f"{name}.log", "a", encoding="utf-8") as log:
            return served.program(self, OPTIONS.server, "--bind", f"ipc://{self.path}/{name}/s", "--endpoint-file", directory / str(number),
                                  "--threads", 1, *options, stderr=log)

    def serve(self, name, count):
        """Starts servers that write endpoint files; returns the directory of the files."""
        directory = self.path / name
        directory.mkdir()
        for number in range(count):
            self.start(directory, number)
        self.wait(directory, count)
        return directory

    def wait(self, directory, count):
        for number in range(count):
            self.run_program(OPTIONS.ctl, "wait", "--server", f"file://{directory / str(number)}", "--timeout", "60")

    def sockets(self, directory):
        return [re.search('endpoint = "(.*)"', file.read_text())[1] for file in sorted(directory.iterdir())]

    def run_host(self, host, endpoint, scene="constant_friction.toml", code=0):
        program = [sys.executable, "-B", EXAMPLES / host] if host == PYTHON_HOST else [host]
        done = subprocess.run([*program, EXAMPLES / scene], env={**os.environ, "SHEARBUS_ENDPOINT": endpoint}, capture_output=True, text=True, timeout=300)
        self.assertEqual(done.returncode == 0, code == 0, done.stdout + done.stderr)
        return done.stdout + (done.stderr if code else "")

    def test_hosts_in_every_language_are_answered_as_by_one_server(self):
        one = f"file://{self.serve('one', 1)}"
        hosts = (OPTIONS.example_c, OPTIONS.example_cxx, OPTIONS.example_fortran, PYTHON_HOST)
        expected = {host: self.run_host(host, one) for host in hosts}
        for count in (2, 3, 5):
            directory = self.serve(f"of{count}", count)
            for host in hosts:
                self.assertRegex(expected[host], r"T0|\[V\]")
                self.assertEqual(self.run_host(host, f"file://{directory}"), expected[host], f"{host} on {count} servers")
                self.assertEqual(self.run_host(host, ",".join(self.sockets(directory))), expected[host])

    def test_a_list_that_is_no_list_is_refused_with_its_fault(self):
        first, _ = self.sockets(self.serve("two", 2))
        (self.path / "empty").mkdir()
        for endpoint, fault in ((f"{first},{first}", "is named twice"), (f"{first},", "has an empty endpoint"),
                                (f"{first},file://{self.path}/two/0", "is a server that another endpoint of the list names"),
                                (f"{first},nonsense://x", "No such|cannot be|UNREACHABLE"), (f"file://{self.path}/empty", "has no endpoint files")):
            for host in (OPTIONS.example_c, OPTIONS.example_fortran, PYTHON_HOST):
                self.assertRegex(self.run_host(host, endpoint, code=1), fault)

    def datasets(self, out):
        found = {}
        for path in sorted(out.glob("*.h5")):
            with h5py.File(path) as file:
                file.visititems(lambda key, item: found.update({f"{path.name}/{key}": item[()]}) if isinstance(item, h5py.Dataset) else None)
        self.assertTrue(any("stress" in key for key in found), found.keys())
        return found

    def hydro(self, *words):
        self.run_program(OPTIONS.hydro, *words, "--no-plot")

    def test_the_hydrocode_goes_on_from_a_dump_after_host_and_server_were_killed(self):
        scene = served.edited(served.PROBLEMS / "cone_al_steel_coarse.toml", self.path / "cone.toml", zone_width_m=1e-3, end_time_s=5e-6)
        whole, run, servers = self.path / "whole", self.path / "run", self.path / "servers"
        self.hydro(scene, "--out", whole, "--server", f"file://{self.serve('one', 1)}")
        servers.mkdir()
        options = [("--state-dir", self.path / f"states-{number}") for number in range(3)]
        processes = [self.start(servers, number, *options[number]) for number in range(3)]
        self.wait(servers, 3)
        host = served.program(self, OPTIONS.hydro, scene, "--out", run, "--no-plot", "--dump-every", 20, "--server", f"file://{servers}",
                              stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        served.until(self, lambda: list(run.glob("restart/dump-*.h5")), host, 60)
        for process in (host, processes[1]):
            process.kill()
            process.wait()
        self.start(servers, 1, *options[1])
        self.hydro("--restart", run)
        expected, found = self.datasets(whole), self.datasets(run)
        self.assertEqual(found.keys(), expected.keys())
        for key, values in expected.items():
            numpy.testing.assert_array_equal(found[key], values, key)


if __name__ == "__main__":
    served.main()
