"""Hosts in C, C++ and Fortran and shearbus-hydro on several servers: what they print and write is what they do with one server."""
import argparse
import os
import pathlib
import re
import subprocess
import sys
import tempfile
import unittest

import h5py
import numpy

OPTIONS = None
EXAMPLES = "client/examples"


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

    def serve(self, name, count):
        """Starts servers that write endpoint files; returns the directory of the files."""
        directory = self.path / name
        directory.mkdir()
        for number in range(count):
            command = [OPTIONS.server, "--bind", f"ipc://{self.path}/{name}-{number}/s", "--endpoint-file", directory / str(number), "--threads", 1]
            with open(self.path / f"{name}-{number}.log", "w", encoding="utf-8") as log:
                self.processes.append(subprocess.Popen([str(word) for word in command], stderr=log))
        for number in range(count):
            subprocess.run([OPTIONS.ctl, "wait", "--server", f"file://{directory / str(number)}", "--timeout", "60"], check=True, capture_output=True)
        return directory

    def sockets(self, directory):
        return [re.search('endpoint = "(.*)"', file.read_text())[1] for file in sorted(directory.iterdir())]

    def run_host(self, host, endpoint, scene="constant_friction.toml", code=0):
        environment = {**os.environ, "SHEARBUS_ENDPOINT": endpoint}
        done = subprocess.run([host, pathlib.Path(OPTIONS.source) / EXAMPLES / scene], env=environment, capture_output=True, text=True, timeout=120)
        self.assertEqual(done.returncode == 0, code == 0, done.stdout + done.stderr)
        return done.stdout + (done.stderr if code else "")

    def test_hosts_in_every_language_are_answered_as_by_one_server(self):
        one = f"file://{self.serve('one', 1)}"
        hosts = (OPTIONS.c_host, OPTIONS.cxx_host, OPTIONS.fortran_host)
        expected = {host: self.run_host(host, one) for host in hosts}
        for count in (2, 3, 5):
            directory = self.serve(f"of{count}", count)
            for host in hosts:
                self.assertIn("T0", expected[host])
                self.assertEqual(self.run_host(host, f"file://{directory}"), expected[host], f"{host} on {count} servers")
                self.assertEqual(self.run_host(host, ",".join(self.sockets(directory))), expected[host])

    def test_a_list_that_is_no_list_is_refused_with_its_fault(self):
        first, second = self.sockets(self.serve("two", 2))
        (self.path / "empty").mkdir()
        for endpoint, fault in ((f"{first},{first}", "is named twice"), (f"{first},", "has an empty endpoint"),
                                (f"{first},file://{self.path}/two/0", "is a server that another endpoint of the list names"),
                                (f"{first},nonsense://x", "No such|cannot be|UNREACHABLE"), (f"file://{self.path}/empty", "has no endpoint files")):
            for host in (OPTIONS.c_host, OPTIONS.fortran_host):
                self.assertRegex(self.run_host(host, endpoint, code=1), fault)
        with self.assertRaisesRegex(shearbus.Error, "names several servers, and the Python client uses one"):
            shearbus.open("none.toml\n", range(4), f"{first},{second}")
        with self.assertRaisesRegex(shearbus.Error, "names several servers"):
            shearbus.open("none.toml\n", range(4), f"file://{self.path}/two")

    def test_the_hydrocode_writes_the_same_numbers(self):
        problem = pathlib.Path(OPTIONS.source) / "hydro_stub/problems/two_half_spaces.toml"
        found = {}
        for name, count in (("one", 1), ("three", 3)):
            endpoint = ",".join(self.sockets(self.serve(name, count)))
            out = self.path / f"out-{name}"
            subprocess.run([OPTIONS.hydro, problem, "--out", out, "--no-plot", "--server", endpoint], check=True, capture_output=True, timeout=120)
            found[name] = {}
            for path in sorted(out.glob("*.h5")):
                with h5py.File(path) as file:
                    file.visititems(lambda key, item: found[name].update({f"{path.name}/{key}": item[()]}) if isinstance(item, h5py.Dataset) else None)
        self.assertEqual(found["one"].keys(), found["three"].keys())
        self.assertTrue(any("stress" in key for key in found["one"]), found["one"].keys())
        for key, values in found["one"].items():
            numpy.testing.assert_array_equal(found["three"][key], values, key)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    for name in ("server", "ctl", "hydro", "c_host", "cxx_host", "fortran_host", "source"):
        parser.add_argument(f"--{name}", required=True)
    OPTIONS, rest = parser.parse_known_args()
    sys.path.insert(0, str(pathlib.Path(OPTIONS.source) / "client/python"))
    import shearbus
    unittest.main(argv=[sys.argv[0], *rest])
