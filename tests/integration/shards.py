"""Hosts in C, C++, Fortran and Python and shearbus-hydro on several servers: what they print and write is what they do with one server."""
import argparse
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import time
import unittest

import h5py
import numpy

OPTIONS = None
EXAMPLES = "client/examples"
PYTHON_HOST = "host.py"


class Shards(unittest.TestCase):
    def setUp(self):
        scratch = tempfile.TemporaryDirectory()
        self.addCleanup(scratch.cleanup)
        self.path = pathlib.Path(scratch.name)
        self.processes = []
        self.addCleanup(self.end_all)

    def end_all(self):
        for process in self.processes:
            process.kill()
            process.wait()

    def start(self, directory, number, *options):
        name = f"{directory.name}-{number}"
        command = [OPTIONS.server, "--bind", f"ipc://{self.path}/{name}/s", "--endpoint-file", directory / str(number), "--threads", 1, *options]
        with open(self.path / f"{name}.log", "a", encoding="utf-8") as log:
            self.processes.append(subprocess.Popen([str(word) for word in command], stderr=log))
        return self.processes[-1]

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
            subprocess.run([OPTIONS.ctl, "wait", "--server", f"file://{directory / str(number)}", "--timeout", "60"], check=True, capture_output=True)

    def sockets(self, directory):
        return [re.search('endpoint = "(.*)"', file.read_text())[1] for file in sorted(directory.iterdir())]

    def run_host(self, host, endpoint, scene="constant_friction.toml", code=0):
        source = pathlib.Path(OPTIONS.source)
        environment = {**os.environ, "SHEARBUS_ENDPOINT": endpoint, "PYTHONPATH": str(source / "client/python")}
        program = [sys.executable, "-B", source / EXAMPLES / host] if host == PYTHON_HOST else [host]
        done = subprocess.run([*program, source / EXAMPLES / scene], env=environment, capture_output=True, text=True, timeout=120)
        self.assertEqual(done.returncode == 0, code == 0, done.stdout + done.stderr)
        return done.stdout + (done.stderr if code else "")

    def test_hosts_in_every_language_are_answered_as_by_one_server(self):
        one = f"file://{self.serve('one', 1)}"
        hosts = (OPTIONS.c_host, OPTIONS.cxx_host, OPTIONS.fortran_host, PYTHON_HOST)
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
            for host in (OPTIONS.c_host, OPTIONS.fortran_host, PYTHON_HOST):
                self.assertRegex(self.run_host(host, endpoint, code=1), fault)

    def datasets(self, out):
        found = {}
        for path in sorted(out.glob("*.h5")):
            with h5py.File(path) as file:
                file.visititems(lambda key, item: found.update({f"{path.name}/{key}": item[()]}) if isinstance(item, h5py.Dataset) else None)
        self.assertTrue(any("stress" in key for key in found), found.keys())
        return found

    def hydro(self, *words):
        subprocess.run([OPTIONS.hydro, *map(str, words), "--no-plot"], check=True, capture_output=True, timeout=120)

    def test_the_hydrocode_goes_on_from_a_dump_after_host_and_server_were_killed(self):
        text = (pathlib.Path(OPTIONS.source) / "hydro_stub/problems/cone_al_steel_coarse.toml").read_text()
        for name, value in {"zone_width_m": "1e-3", "end_time_s": "5e-6"}.items():
            text, found = re.subn(rf"(?m)^{name} = \S+", f"{name} = {value}", text)
            self.assertEqual(found, 1)
        scene = self.path / "cone.toml"
        scene.write_text(text)
        whole, run, servers = self.path / "whole", self.path / "run", self.path / "servers"
        self.hydro(scene, "--out", whole, "--server", f"file://{self.serve('one', 1)}")
        servers.mkdir()
        options = [("--state-dir", self.path / f"states-{number}") for number in range(3)]
        processes = [self.start(servers, number, *options[number]) for number in range(3)]
        self.wait(servers, 3)
        host = subprocess.Popen([OPTIONS.hydro, str(scene), "--out", str(run), "--no-plot", "--dump-every", "20", "--server", f"file://{servers}"],
                                stderr=subprocess.DEVNULL, stdout=subprocess.DEVNULL)
        self.processes.append(host)
        end = time.monotonic() + 60
        while not list(run.glob("restart/dump-*.h5")):
            self.assertLess(time.monotonic(), end)
            self.assertIsNone(host.poll(), "the host has ended before a dump was seen")
            time.sleep(0.002)
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
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("server", "ctl", "hydro", "c_host", "cxx_host", "fortran_host", "source"):
        parser.add_argument(f"--{name}", required=True)
    OPTIONS, rest = parser.parse_known_args()
    unittest.main(argv=[sys.argv[0], *rest])
