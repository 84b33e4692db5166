"""Runs the job scripts of deploy/slurm in a Slurm of its own on this machine: munge, slurmctld and two slurmd from Debian packages.
Exit code 77: something that this needs is missing, and the last line says what."""
import argparse
import contextlib
import os
import pathlib
import pwd
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served

OPTIONS = None
SKIPPED = 77
NODES = 2
NEEDED = {"munged": "munge", "slurmctld": "slurmctld", "slurmd": "slurmd", "sbatch": "slurm-client"}
PATH = os.environ["PATH"] + ":/usr/sbin:/sbin"

CONF = """
ClusterName=test
SlurmctldHost={host}(127.0.0.1)
SlurmctldPort={ports[0]}
SlurmUser={user}
SlurmdUser={user}
AuthType=auth/munge
AuthInfo=socket={directory}/munge/socket
CredType=cred/munge
StateSaveLocation={directory}/ctld
SlurmdSpoolDir={directory}/spool-%n
SlurmctldPidFile={directory}/slurmctld.pid
SlurmdPidFile={directory}/slurmd-%n.pid
SlurmctldLogFile={directory}/slurmctld.log
SlurmdLogFile={directory}/slurmd-%n.log
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SwitchType=switch/none
MpiDefault=none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerType=sched/builtin
SchedulerParameters=batch_sched_delay=0,sched_min_interval=100000
ReturnToService=2
JobAcctGatherType=jobacct_gather/none
AccountingStorageType=accounting_storage/none
SlurmdParameters=config_overrides
KillWait=5
MinJobAge=600
{nodes}
PartitionName=test Nodes=n[1-2] Default=YES MaxTime=INFINITE State=UP
"""


def free_ports(count):
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket()) for _ in range(count)]
        for each in sockets:
            each.bind(("127.0.0.1", 0))
        return [each.getsockname()[1] for each in sockets]


def missing():
    """Returns why the tests cannot run here, or None."""
    absent = [package for program, package in NEEDED.items() if not shutil.which(program, path=PATH)]
    if absent:
        return f"packages are missing: {', '.join(absent)} (deploy/packages/slurm.txt)"
    if os.geteuid() != 0:
        return "only root can start two slurmd on one machine"
    return None


class Slurm:
    """The daemons, and the environment in which the commands of Slurm find them."""

    def __init__(self, directory):
        self.directory, self.processes = directory, []
        ports = free_ports(1 + NODES)
        host = socket.gethostname()
        cpus = 4  # config_overrides: whatever the machine has
        nodes = "\n".join(f"NodeName=n{i + 1} NodeHostname={host} NodeAddr=127.0.0.1 Port={ports[1 + i]} CPUs={cpus} State=UNKNOWN"
                          for i in range(NODES))
        conf = directory / "slurm.conf"
        conf.write_text(CONF.format(host=host, ports=ports, user=pwd.getpwuid(os.geteuid()).pw_name, directory=directory, nodes=nodes))
        self.environment = {**os.environ, "PATH": PATH, "SLURM_CONF": str(conf)}
        (directory / "ctld").mkdir()
        munge = directory / "munge"
        munge.mkdir()
        key = munge / "key"
        key.write_bytes(os.urandom(128))
        for path, mode in ((munge, 0o755), (key, 0o600)):
            path.chmod(mode)
            shutil.chown(path, "munge", "munge")
        files = [f"--{name}-file={munge}/{name}" for name in ("pid", "log", "seed")]
        self.start("munged", "--foreground", f"--key-file={key}", f"--socket={munge}/socket", *files, user="munge")
        self.wait_for(lambda: (munge / "socket").exists(), "munge")
        self.start("slurmctld", "-D", "-f", conf)
        for i in range(NODES):
            (directory / f"spool-n{i + 1}").mkdir()
            self.start("slurmd", "-D", "-N", f"n{i + 1}", "-f", conf)
        self.wait_for(lambda: self.run("sinfo", "-h", "-o", "%T %D").stdout.split() == ["idle", str(NODES)], "both nodes")

    def start(self, *command, user=None):
        with (self.directory / f"{command[0]}.out").open("ab") as output:
            self.processes.append(subprocess.Popen([str(word) for word in command], env=self.environment, user=user, group=user,
                                                   extra_groups=[] if user else None, stdin=subprocess.DEVNULL, stdout=output,
                                                   stderr=output))

    def run(self, *command):
        return subprocess.run([str(word) for word in command], env=self.environment, capture_output=True, text=True, timeout=60)

    def wait_for(self, condition, what, seconds=60):
        end = time.monotonic() + seconds
        while not condition():
            if time.monotonic() > end:
                logs = "\n".join(f"{p.name}: {p.read_text(errors='replace')[-1500:]}" for p in self.directory.glob("*.log"))
                raise AssertionError(f"{what}: not within {seconds} s\n{logs}")
            time.sleep(0.1)

    def end(self):
        for process in reversed(self.processes):
            process.terminate()
            try:
                process.wait(20)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        # What is left of a job that a failed test has left behind. All of it has the environment of these daemons.
        ours = f"SLURM_CONF={self.environment['SLURM_CONF']}".encode()
        for entry in pathlib.Path("/proc").glob("[0-9]*/environ"):
            with contextlib.suppress(OSError):
                if ours in entry.read_bytes().split(b"\0"):
                    os.kill(int(entry.parent.name), signal.SIGKILL)


class Jobs(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        scratch = tempfile.TemporaryDirectory(prefix="shearbus-slurm-")
        cls.addClassCleanup(scratch.cleanup)
        cls.root = pathlib.Path(scratch.name)
        cls.root.chmod(0o755)  # munge enters it
        daemons = cls.root / "slurm"
        daemons.mkdir()
        cls.slurm = Slurm(daemons)
        cls.addClassCleanup(cls.slurm.end)
        cls.scene = served.edited(served.PROBLEMS / "cone_al_steel_coarse.toml", cls.root / "cone.toml", zone_width_m=1e-3, end_time_s=OPTIONS.end_time)
        cls.reference = cls.root / "undisturbed"
        done = subprocess.run([OPTIONS.bin / "shearbus-hydro", cls.scene, "--out", cls.reference, "--no-plot"], capture_output=True,
                              text=True, timeout=300)
        assert done.returncode == 0, done.stderr

    def setUp(self):
        self.directory = self.root / self.id().rpartition(".")[2]
        self.directory.mkdir()
        # Continues from a dump if there is one, as a user's script does.
        self.host = self.directory / "host.sh"
        self.host.write_text(f"""#!/bin/bash
out=$PWD/run-${{SLURM_PROCID:-0}}
where=(--server "$SHEARBUS_ENDPOINT" ${{SHEARBUS_SECRET_KEY_FILE:+--key "$SHEARBUS_SECRET_KEY_FILE"}} --no-plot --dump-every 5)
if compgen -G "$out/restart/dump-*.h5" >/dev/null; then exec shearbus-hydro --restart "$out" "${{where[@]}}"; fi
exec shearbus-hydro {self.scene} --out "$out" "${{where[@]}}"
""")
        self.host.chmod(0o755)

    def submit(self, script, *command, options=(), environment=None):
        """Submits a job script of deploy/slurm and returns the number of the job."""
        slurm = pathlib.Path(OPTIONS.source) / "deploy/slurm"
        variables = {**self.slurm.environment, "SHEARBUS_SLURM": str(slurm), "PATH": f"{OPTIONS.bin}:{PATH}",
                     "SHEARBUS_JOB_DIR": str(self.directory / "job"), "SHEARBUS_SERVER_OPTIONS": "--threads 1",
                     **(environment or {})}
        done = subprocess.run(["sbatch", "--parsable", "--output", self.directory / "output", "--chdir", self.directory, *options,
                               slurm / script, *map(str, command)], env=variables, capture_output=True, text=True, timeout=60)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout.strip()

    def show(self, job):
        text = self.slurm.run("scontrol", "show", "job", job).stdout
        return dict(word.partition("=")[::2] for word in text.split())

    def output(self):
        path = self.directory / "output"
        logs = [f"{p.name}: {p.read_text(errors='replace')}" for p in sorted(self.directory.glob("job/*.log"))]
        return "\n".join([path.read_text(errors="replace") if path.exists() else "no output", *logs])

    def ended(self, job, seconds=150):
        """Waits for the end of a job and returns its state and exit code."""
        end = time.monotonic() + seconds
        while (found := self.show(job))["JobState"] in ("PENDING", "CONFIGURING", "RUNNING", "COMPLETING", "SUSPENDED"):
            self.assertLess(time.monotonic(), end, self.output())
            time.sleep(0.1)
        return found["JobState"], int(found["ExitCode"].split(":")[0])

    def until(self, condition, what, seconds=120):
        end = time.monotonic() + seconds
        while not (found := condition()):
            self.assertLess(time.monotonic(), end, f"{what}\n{self.output()}")
            time.sleep(0.02)
        return found

    def dump(self):
        return self.until(lambda: list(self.directory.glob("run-0/restart/dump-*.h5")), "no dump came")

    def process(self, pattern):
        """Returns the process whose command line has `pattern` and a path of this test."""
        for entry in pathlib.Path("/proc").glob("[0-9]*/cmdline"):
            with contextlib.suppress(OSError):
                words = entry.read_bytes().decode(errors="replace").split("\0")
                if pathlib.Path(words[0]).name == pattern and str(self.directory) in " ".join(words):
                    return int(entry.parent.name)
        return None


class Short(Jobs):
    def test_one_node(self):
        job = self.submit("one_node.sbatch", self.host)
        self.assertEqual(self.ended(job), ("COMPLETED", 0), self.output())
        self.assertGreater(served.assert_same_run(self, self.directory / "run-0", self.reference), 10)
        self.assertEqual(list(self.directory.glob("job/endpoints/*")), [], "a server has left its file behind")

    def test_a_server_and_a_host_on_each_node_with_keys_of_the_job(self):
        job = self.submit("several_nodes.sbatch", self.host)
        self.assertEqual(self.ended(job), ("COMPLETED", 0), self.output())
        for rank in range(NODES):
            self.assertGreater(served.assert_same_run(self, self.directory / f"run-{rank}", self.reference), 10)
            log = (self.directory / f"job/server-{rank}.log").read_text()
            self.assertIn("listening on tcp://", log)
            self.assertIn("clients by tcp need this server key", log)
        self.assertEqual((self.directory / "job/job.secret").stat().st_mode & 0o777, 0o600)

    def test_one_host_on_the_servers_of_all_nodes_one_of_which_dies(self):
        job = self.submit("several_nodes.sbatch", self.host, environment={"SHEARBUS_ONE_HOST": "1"})
        self.dump()
        os.kill(self.until(lambda: self.process("shearbus-server"), "no server runs"), signal.SIGKILL)
        self.assertEqual(self.ended(job), ("COMPLETED", 0), self.output())
        self.assertIn("it is started again", self.output())
        self.assertGreater(served.assert_same_run(self, self.directory / "run-0", self.reference), 10)
        self.assertEqual([path.name for path in self.directory.glob("run-*")], ["run-0"])
        for number in range(NODES):
            self.assertRegex((self.directory / f"job/server-{number}.log").read_text(), r"session \S+ opened by")

    def test_a_host_that_dies_ends_the_job_within_30_seconds(self):
        job = self.submit("one_node.sbatch", self.host)
        self.dump()
        host = self.until(lambda: self.process("shearbus-hydro"), "no host runs")
        os.kill(host, signal.SIGKILL)
        killed = time.monotonic()
        state, code = self.ended(job)
        self.assertLess(time.monotonic() - killed, 30)
        self.assertEqual((state, code), ("FAILED", 128 + signal.SIGKILL), self.output())
        self.assertTrue(list(self.directory.glob("job/states-0/checkpoint-*.h5")), "the server has written no checkpoint")
        self.assertIn("sessions of server 0 were open", self.output())

    def test_a_signal_before_the_limit_leaves_a_dump_and_a_checkpoint_from_which_the_next_job_continues(self):
        job = self.submit("one_node.sbatch", self.host)
        self.dump()
        self.slurm.run("scancel", "--batch", "--signal=USR1", job)
        self.assertEqual(self.ended(job), ("FAILED", 3), self.output())
        self.assertTrue(list(self.directory.glob("job/states-0/checkpoint-*.h5")), "the server has written no checkpoint")
        self.assertTrue(list(self.directory.glob("run-0/restart/dump-*.h5")))
        again = self.submit("one_node.sbatch", self.host)
        self.assertEqual(self.ended(again), ("COMPLETED", 0), self.output())
        served.assert_same_run(self, self.directory / "run-0", self.reference)

    def test_a_server_that_cannot_start_fails_the_job_at_once(self):
        job = self.submit("one_node.sbatch", self.host, environment={"SHEARBUS_SERVER_OPTIONS": "--durability sometimes"})
        self.assertEqual(self.ended(job, 30), ("FAILED", 1), self.output())
        self.assertIn("does not start", self.output())

    @unittest.skipUnless(shutil.which("mpirun"), "mpirun is missing")
    def test_an_mpi_host_over_both_nodes(self):
        self.assertTrue(OPTIONS.mpi_host, "no MPI host was built")
        root = {"OMPI_ALLOW_RUN_AS_ROOT": "1", "OMPI_ALLOW_RUN_AS_ROOT_CONFIRM": "1"}
        scene = pathlib.Path(OPTIONS.source) / "client/examples/constant_friction.toml"
        printed = []
        for ranks in (1, NODES):  # the host compares its answers with the exact ones, and prints the same on any number of ranks
            job = self.submit("mpi.sbatch", "-n", ranks, OPTIONS.mpi_host, scene, options=["--ntasks-per-node=1"], environment=root)
            self.assertEqual(self.ended(job), ("COMPLETED", 0), self.output())
            printed.append([line for line in self.output().splitlines() if line.startswith("node ")])
        self.assertEqual(len(printed[0]), 10)
        self.assertEqual(printed[1], 2 * printed[0], "the answers depend on the ranks")


class Long(Jobs):
    def test_a_job_queued_again_in_mid_run_gives_the_same_bits(self):
        job = self.submit("one_node.sbatch", self.host)
        self.dump()
        done = self.slurm.run("scontrol", "requeue", job)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertEqual(self.ended(job, 400), ("COMPLETED", 0), self.output())
        self.assertEqual(self.show(job)["Restarts"], "1")
        self.assertGreater(served.assert_same_run(self, self.directory / "run-0", self.reference), 10)


def main():
    global OPTIONS
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--bin", type=pathlib.Path, required=True, help="directory of the programs")
    parser.add_argument("--source", required=True)
    parser.add_argument("--mpi-host", type=pathlib.Path)
    parser.add_argument("--end-time", default="5e-6", help="of the hydro problem, in s")
    parser.add_argument("tests", nargs="*", default=["Short"])
    OPTIONS = parser.parse_args()
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(1))  # the daemons end with this program
    reason = missing()
    if reason:
        print(f"skipped: {reason}")
        return SKIPPED
    return 0 if unittest.main(argv=[sys.argv[0], "-v", *OPTIONS.tests], exit=False).result.wasSuccessful() else 1


if __name__ == "__main__":
    sys.exit(main())
