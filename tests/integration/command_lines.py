#!/usr/bin/python3
"""The command lines of all programs and scripts: --version, --help, what a misspelt word gets, and that nothing off a terminal has colours."""
import argparse
import json
import os
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import unittest

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served  # noqa: E402
from served import OPTIONS, SOURCE  # noqa: E402

KEYS = ["program", "version", "commit", "build", "compiler", "protocol", "numerics", "libzmq", "hdf5", "protobuf", "registers"]


def programs():
    return [OPTIONS.server, OPTIONS.ctl, OPTIONS.hydro, OPTIONS.replay, OPTIONS.study]


def run(*command, **more):
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, timeout=60, **more)


class Programs(unittest.TestCase):
    def test_version_says_what_the_program_is(self):
        found = []
        for program in programs():
            with self.subTest(program=program.name):
                text = run(program, "--version")
                self.assertEqual(text.returncode, 0, text.stderr)
                lines = text.stdout.splitlines()
                self.assertRegex(lines[0], rf"^{program.name} \d+\.\d+\.\d+$")
                answer = run(program, "--version", "--json")
                self.assertEqual(answer.returncode, 0, answer.stderr)
                version = json.loads(answer.stdout)
                self.assertEqual(list(version), KEYS)
                self.assertEqual(version.pop("program"), program.name)
                for key, value in list(version.items())[1:]:
                    self.assertRegex(text.stdout, rf"\n  {key} +{re.escape(value)}(\n|$)")
                for key in ("version", "protocol", "libzmq", "hdf5", "protobuf"):
                    self.assertRegex(version[key], r"^\d+\.\d+(\.\d+)?$", key)
                self.assertRegex(version["compiler"], r"^(GNU|Clang) \d+")
                self.assertIn(version["registers"], ("4 doubles (AVX2)", "2 doubles"))
                found.append(version)
        self.assertEqual(len({json.dumps(version) for version in found}), 1, "all programs are of one build")
        head = run("git", "-C", SOURCE, "rev-parse", "--short=12", "HEAD") if (SOURCE / ".git").exists() else None
        if head is not None and head.returncode == 0:
            self.assertRegex(found[0]["commit"], r"^[0-9a-f]{12}(\+dirty)?$", "a build of a repository knows its commit")

    def test_the_report_says_its_version_in_the_form_of_the_other_programs(self):
        entries = json.loads(run(OPTIONS.report, "--version", "--json").stdout)
        self.assertEqual(list(entries), ["program", "version", "commit", "python", "jinja2", "matplotlib", "numpy", "h5py", "PIL"])
        other = json.loads(run(OPTIONS.ctl, "--version", "--json").stdout)
        self.assertEqual((entries["version"], entries["commit"]), (other["version"], other["commit"]))
        text = run(OPTIONS.report, "--version").stdout.splitlines()
        self.assertEqual(text[0], f"shearbus-report {other['version']}")
        form = [len(re.match(r"  \w+ +", line)[0]) for line in run(OPTIONS.ctl, "--version").stdout.splitlines()[1:]]
        self.assertEqual([re.match(r"  (\w+) +(.*)", line).groups() for line in text[1:]], list(entries.items())[2:])
        self.assertEqual({len(re.match(r"  \w+ +", line)[0]) for line in text[1:]}, set(form))
        for wrong, said in ((["--json"], "--json needs --version"), ([], "required: RUN")):
            done = run(OPTIONS.report, *wrong)
            self.assertEqual(done.returncode, 2)
            self.assertIn(said, done.stderr)

    def test_what_cannot_be_printed_is_no_success(self):
        for program in programs():
            for option in ("--help", "--version"):
                with self.subTest(program=program.name, option=option), open("/dev/full", "w") as full:
                    done = subprocess.run([program, option], stdout=full, stderr=subprocess.PIPE, text=True, timeout=60)
                    self.assertEqual(done.returncode, 1, done.stderr)
                    self.assertIn("standard output could not be written", done.stderr)

    def test_help_is_for_people(self):
        for program in programs():
            commands = [[]]
            top = run(program, "--help").stdout
            if "Subcommands:\n" in top:
                commands += [[name] for name in re.findall(r"^  ([a-z]+)\b", top.split("Subcommands:\n")[1], re.M) if name != "rehearse"]
            for command in commands:
                with self.subTest(program=program.name, command=command):
                    done = run(program, *command, "--help")
                    self.assertEqual(done.returncode, 0, done.stderr)
                    for leak in ("ENUM", "UINT", "FLOAT", "{false}", "{true}", "->", "INT in", ":POSITIVE", "Excludes:", "Needs:", str(program.parent)):
                        self.assertNotIn(leak, done.stdout)
                    self.assertRegex(done.stdout, rf"Usage: {program.name}\b")
                    self.assertLessEqual(max(map(len, done.stdout.splitlines())), 120, done.stdout)
            self.assertIn("Examples:\n  " + program.name, top)
            self.assertIn("Exit codes: 0", top)

    def test_a_misspelt_word_gets_the_nearest_known_one_and_exit_code_2(self):
        for command, expected in (
            (["shearbus-server", "--bind", "ipc:///nowhere/s", "--stat-dir", "x"], "--stat-dir is no option of shearbus-server; did you mean --state-dir?"),
            (["shearbus-server", "--bin", "ipc:///nowhere/s"], "--bin is no option of shearbus-server; did you mean --bind?"),
            (["shearbus-server", "--bind", "ipc:///nowhere/s", "--durability", "powr"],
             "--durability: expected none, process or power, found powr; did you mean power?"),
            (["shearbus-server", "bogus"], "bogus is no argument of shearbus-server; --bind is required"),
            (["shearbus-server", "--bind", "ipc:///nowhere/s", "--accept-empty"], "--accept-empty requires --state-dir"),
            (["shearbus-server", "--bind", "ipc:///nowhere/s", "--durability", "power"], "--durability requires --state-dir"),
            (["shearbus-server", "--bind", "ipc:///no/s", "--bind", "ipc:///no/./s"], "--bind ipc:///no/./s is given twice; leave out one of the two"),
            (["shearbus-server", "--bind", "inproc://x"], "--bind inproc://x: no other process reaches it; expected ipc:// or tcp://"),
            (["shearbus-server", "--bind", "ipc:///no/s", "--threads", "5000"], "--threads: 5000 is out of range, expected 0 to 4096"),
            (["shearbus-server", "--bind", "ipc:///no/s", "--log-file", "a", "--log-file", "b"], "--log-file is given 2 times, expected once"),
            (["shearbus-ctl", "stats"], "stats is no command of shearbus-ctl; did you mean status?"),
            (["shearbus-ctl"], "A subcommand is required"),
            (["shearbus-ctl", "keygen", "keys/"], 'NAME: expected a name of files, found "keys/"'),
            (["shearbus-ctl", "status", "--sever", "ipc:///nowhere/s"], "--sever is no option of shearbus-ctl status; did you mean --server?"),
            (["shearbus-ctl", "top", "--server", "ipc:///nowhere/s", "--by", "hotest"],
             "--by: expected hottest, fastest or molten, found hotest; did you mean hottest?"),
            (["shearbus-ctl", "ping", "--server", "tcp://nowhere:1", "--key", "x"],
             "--server-key and --key go together: the server's public key and one's own secret key"),
            (["shearbus-hydro", "x.toml", "--interface-law", "foo"],
             "--interface-law: expected subgrid, coulomb_tresca, free_slip, stick or constant, found foo"),
            (["shearbus-replay", __file__], f"--scene: a history needs it, and {__file__} is no event log"),
            (["shearbus-hydro"], "SCENE, or --restart DIR, is required"),
            (["shearbus-replay", "a.h5", "--scen", "x.toml"], "--scen is no option of shearbus-replay; did you mean --scene?"),
            (["shearbus-study", "precison"], "precison is no command of shearbus-study; did you mean precision?"),
        ):
            with self.subTest(command=command):
                done = run(pathlib.Path(OPTIONS.build, "bin", command[0]), *command[1:])
                self.assertEqual((done.returncode, done.stdout), (2, ""), done.stderr)
                self.assertEqual(done.stderr.splitlines()[0], f"{command[0]}: {expected}")
                self.assertIn(f"Run {command[0]} --help", done.stderr)


class Rehearsal(served.Served):
    """The socket at which shearbus-ctl rehearse waits for a host."""

    def setUp(self):
        super().setUp()

    def start(self, *command, until):
        process = served.program(self, *command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
        served.until(self, lambda: until in process.stdout.readline(), process)
        return process

    def rehearse(self, endpoint, code, said, *options):
        done = run(OPTIONS.ctl, "rehearse", *options, endpoint)
        self.assertEqual((done.returncode, done.stdout), (code, ""), done.stderr)
        self.assertIn(said, done.stderr)
        self.assertNotIn("Traceback", done.stderr)

    def test_a_wrong_endpoint_is_a_line_of_what_was_expected(self):
        for endpoint in ("bogus", "file:///x", "tcp://127.0.0.1:99999", "tcp://127.0.0.1", "ipc://"):
            self.rehearse(endpoint, 2, f'expected ipc://PATH, or tcp://ADDRESS:PORT with a port up to 65535 (*: any that is free); found "{endpoint}"')
        self.rehearse(f"ipc://{self.path}/{'x' * 120}", 2, "at most 107 bytes")
        self.rehearse(f"ipc://{self.path}/s", 2, "--scenario is without effect with an ENDPOINT", "--scenario", "all")
        self.rehearse(f"ipc://{self.path}/absent/x", 1, f"there is no directory {self.path}/absent; create it")
        (self.path / "file").write_text("precious")
        self.rehearse(f"ipc://{self.path}/file", 1, "not a socket")
        self.rehearse("tcp://192.0.2.1:5999", 1, "cannot listen on tcp://192.0.2.1:5999")
        self.assertEqual((self.path / "file").read_text(), "precious")

    def test_the_wait_for_a_host_ends_in_time(self):
        done = run(OPTIONS.ctl, "rehearse", "--timeout", "0.2", f"ipc://{self.path}/s")
        self.assertEqual((done.returncode, done.stderr), (1, ""))
        self.assertIn("the host sent no request", done.stdout)

    def test_the_socket_of_a_server_is_not_taken(self):
        endpoint = f"ipc://{self.path}/s"
        server = self.start(OPTIONS.server, "--bind", endpoint, until="listening on")
        self.rehearse(endpoint, 1, f"a server listens on {endpoint}")
        (self.path / "s.lock").unlink()
        self.rehearse(endpoint, 1, f"a server listens on {endpoint}")
        self.assertNotIn("mock", run(OPTIONS.ctl, "ping", "--server", endpoint).stdout)
        server.terminate()
        self.assertNotIn("ALARM", server.communicate(timeout=30)[0])

    def test_the_socket_goes_with_the_rehearsal(self):
        endpoint = f"ipc://{self.path}/s"
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            kit = self.start(OPTIONS.ctl, "rehearse", endpoint, until="waiting at")
            refused = run(OPTIONS.server, "--bind", endpoint)
            self.assertEqual(refused.returncode, 1)
            self.assertIn("another server listens on", refused.stderr)
            kit.send_signal(number)
            said = kit.communicate(timeout=30)[0]
            self.assertEqual(kit.returncode, 1, said)
            self.assertIn("your client: 0 of", said)
            self.assertFalse((self.path / "s").exists())


# What no program takes for a number, and further texts that it takes for no whole one.
NO_NUMBERS = ("", " ", "nan", "inf", "-inf", "1e309", "0x10", "1_0", " 1", "1 ", "1,5", "\u0663", "+-5", "1" * 101)
NO_COUNTS = (*NO_NUMBERS, "-1", "+1", "1.5", "1e3", str(2**64))


def python_programs():
    """Yields (program, option, its number is whole, command up to the value) of the Python programs that pages name."""
    python = ["/usr/bin/python3", "-B"]
    for program, option, whole, command in (
        ("fit", "--starts", True, [OPTIONS.study, "fit", "x.toml", "--parameter", "a.b=1:2"]),
        ("mesh", "--meshes", False, [OPTIONS.study, "mesh"]),
        ("map", "--dt", False, [OPTIONS.study, "map", "x.toml", "--out", "x"]),
        ("map", "--pressures", True, [OPTIONS.study, "map", "x.toml", "--out", "x"]),
        ("rehearse", "--timeout", False, [OPTIONS.ctl, "rehearse", "ipc:///nowhere/s"]),
        ("rehearse", "--delay", False, [OPTIONS.ctl, "rehearse", "ipc:///nowhere/s"]),
        ("plot_history.py", "--node", True, [*python, SOURCE / "client/report/plot_history.py", "x.h5", "--out", "x.png"]),
        ("plot_overview.py", "--time", False, [*python, SOURCE / "client/report/plot_overview.py", "x", "y", "--out", "x.png"]),
        ("make_history.py", "--steps", True, [*python, SOURCE / "client/examples/make_history.py", "ramp", "/dev/null"]),
        ("make_history.py", "--dt", False, [*python, SOURCE / "client/examples/make_history.py", "ramp", "/dev/null"]),
        ("make_history.py", "--velocity", False, [*python, SOURCE / "client/examples/make_history.py", "ramp", "/dev/null"]),
        ("make_history.py", "--pressure", False, [*python, SOURCE / "client/examples/make_history.py", "constant", "/dev/null"]),
        ("cone_sweep.py", "--end", False, [*python, SOURCE / "tests/validation/cone_sweep.py", "--hydro", "x"]),
        ("run.py", "--cpus", True, [*python, SOURCE / "tests/bench/run.py", "--bin", "/nowhere"]),
        ("scale.py", "--steps", True, [*python, SOURCE / "tests/bench/scale.py"]),
        ("network.py", "--delays", False, [*python, SOURCE / "tests/bench/network.py"]),
        ("soak.py", "--seed", True, [*python, SOURCE / "tests/durability/soak.py"])):
        yield program, option, whole, [*command, option]


class PythonPrograms(unittest.TestCase):
    def test_an_example_says_in_a_line_why_it_cannot_go_on(self):
        examples = SOURCE / "client/examples"
        without = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        client = {**without, "PYTHONPATH": str(SOURCE / "client/python"), "LC_ALL": "C"}
        for words, code, said, environment in (
                (["make_history.py", "constant", "/dev/null/x.h5"], 1, "/dev/null/x.h5 cannot be written", without),
                (["make_history.py", "constant", "/dev/full"], 1, "/dev/full cannot be written", without),
                (["host.py"], 1, "the Python client cannot be loaded", without), (["sweep.py"], 1, "the Python client cannot be loaded", without),
                (["host.py", "--help"], 0, "", client), (["sweep.py", "--help"], 0, "", client),
                (["host.py", "bogus"], 1, "host.py: ", client), (["sweep.py", "bogus"], 1, "sweep.py: ", client)):
            with self.subTest(words=words):
                done = run("/usr/bin/python3", "-B", examples / words[0], *words[1:], env=environment)
                self.assertEqual(done.returncode, code, done.stderr)
                self.assertIn(said, done.stderr)
                self.assertNotIn("Traceback", done.stderr)
                self.assertLessEqual(len(done.stderr.splitlines()), 2, done.stderr)

    def test_lines_of_the_library_have_its_name_unless_the_host_logs(self):
        for configured, expected in (("", "shearbus: waiting for x\n"), ("logging.basicConfig(); ", "WARNING:shearbus:waiting for x\n")):
            done = run("/usr/bin/python3", "-B", "-c", f"import logging; {configured}from shearbus import _library; _library.say(b'waiting for x')",
                       env={**os.environ, "PYTHONPATH": str(SOURCE / "client/python")})
            self.assertEqual(done.stderr, expected)

    def test_numbers_have_the_rule_of_the_other_programs(self):
        for program, option, whole, command in python_programs():
            values = NO_COUNTS if whole else NO_NUMBERS
            if program != "make_history.py":  # which has a reader of its own; starting Python takes long
                values = ("", "inf", "1_0", "-1" if whole else "nan")
            for value in values:
                with self.subTest(program=program, option=option, value=value):
                    command[-1] = f"{option}={value}"
                    done = run(*command)
                    self.assertEqual(done.returncode, 2, done.stderr)
                    self.assertIn(option, done.stderr)
                    self.assertIn("number", done.stderr)
                    self.assertNotIn("Traceback", done.stderr)

    def test_the_reader_is_that_of_the_other_programs(self):
        """By the reader of shearbus-server: what one takes, the other takes."""
        sys.path.insert(0, str(SOURCE / "client/report"))
        import terminal
        for text in (*NO_COUNTS, "1", "007", "1e2", "+1e2", "1.", ".5", "2.5E+1", "1e-400", "1e", "e1", ".", "1.e1", "+", "1f", "--1"):
            for reader, option in ((terminal.whole_number, "--threads"), (terminal.real_number, "--checkpoint-every")):
                try:
                    reader(text)
                    taken = True
                except argparse.ArgumentTypeError:
                    taken = False
                said = run(OPTIONS.server, f"{option}={text}", "--bind", "nowhere").stderr
                with self.subTest(text=text, option=option):
                    self.assertEqual(f"{option}: expected" not in said, taken, said)

    def test_a_fault_is_one_line_without_commands_to_the_terminal(self):
        done = run(OPTIONS.report, "--x\x1b[2J\nforged")
        self.assertEqual(done.returncode, 2)
        self.assertIn("--x\\x1b[2J\\nforged", done.stderr)
        self.assertEqual(len(done.stderr.splitlines()), 2, done.stderr)


class Scripts(unittest.TestCase):
    def test_help_prints_the_comment_and_starts_nothing(self):
        for script in ("run", "test", "fuzz", "sanitize", "endure", "build", "coverage", "tidy", "docs/build"):
            with self.subTest(script=script):
                file = SOURCE / "deploy" / script
                done = run(file, "--help", env={**os.environ, "SHEARBUS_BUILD_DIR": "/nonexistent/build"})
                self.assertEqual(done.returncode, 0, done.stderr)
                comment = re.match(r"#!.*\n((?:# ?.*\n)+)", file.read_text())[1]
                self.assertEqual(done.stdout, re.sub("^# ?", "", comment, flags=re.M))

    def test_an_interrupt_ends_the_main_job_at_once_with_one_line(self):
        with tempfile.TemporaryDirectory() as place:
            place = pathlib.Path(place)
            (place / "bin").mkdir()
            (place / "build.ninja").touch()
            hydro = f"trap 'echo stopped: $0 >&2' INT\ntouch {place}/started-$$\nwhile sleep 0.1; do :; done"
            for name, does in (("cmake", "exit 0"), ("dpkg-query", "echo install ok installed"), ("bin/shearbus-server", "exec sleep 100"), ("bin/shearbus-hydro", hydro)):
                (place / name).write_text(f"#!/bin/bash\n{does}\n")
                (place / name).chmod(0o755)
            environment = {**os.environ, "PATH": f"{place}:{os.environ['PATH']}", "SHEARBUS_BUILD_DIR": str(place), "SHEARBUS_OUT": str(place / "out")}
            job = served.program(self, SOURCE / "deploy/run", env=environment, start_new_session=True, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE,
                                 preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler))
            served.until(self, lambda: len(list(place.glob("started-*"))) == 2, job)
            os.killpg(job.pid, signal.SIGINT)
            said = job.communicate(timeout=20)[1]
            self.assertEqual((job.returncode, said), (130, "\ndeploy/run: interrupted\n"))
            for file in place.glob("started-*"):
                served.until(self, lambda: not pathlib.Path(f"/proc/{file.name.split('-')[1]}/exe").exists(), patience=20)

    def test_an_unknown_sanitizer_is_refused_by_the_name_of_the_script(self):
        for words, found in (((), "nothing"), (("foo",), "foo")):
            done = run(SOURCE / "deploy/sanitize", *words)
            self.assertEqual((done.returncode, done.stderr), (2, f"deploy/sanitize: expected address or thread, found {found}\n"))

    def test_sourced_by_a_user_prepare_changes_no_shell(self):
        """With set -e the next command that fails would close the terminal."""
        file = SOURCE / "deploy/prepare.sh"
        done = run("bash", "--norc", "-ic", f"source {file}; false; echo still here $-")
        self.assertRegex(done.stdout, r"still here (?!\S*[eu])")
        self.assertIn("deploy/build programs", done.stderr)

    def test_the_job_script_leaves_a_temporary_directory_whose_name_is_too_long_for_a_socket(self):
        with tempfile.TemporaryDirectory() as place:  # a job that is its launch_server alone
            pathlib.Path(place, "job.sh").write_text('directory=/d; serve() { echo "$2"; }; run_job() { launch_server 0; }\n')
            for directory, expected in (("/scratch", "/scratch"), ("/" + 91 * "s", "/" + 91 * "s"), ("/" + 92 * "s", "/tmp"), ("/" + 60 * "\u00e9", "/tmp"), ("", "/tmp")):
                done = run("bash", SOURCE / "deploy/slurm/one_node.sbatch",
                           env={**os.environ, "SHEARBUS_SLURM": place, "SLURM_JOB_ID": "7", "TMPDIR": directory, "LC_ALL": "C.UTF-8"})
                self.assertEqual((done.stdout, done.stderr), (f"ipc://{expected}/shearbus-7/bus\n", ""))

    def test_headings_have_no_colours_off_a_terminal_or_with_no_color(self):
        say = f"source {SOURCE}/deploy/prepare.sh; say heading"
        self.assertEqual(run("bash", "-c", say).stdout, "\n== heading\n")
        on_terminal = run("script", "-qec", f"bash -c '{say}'", "/dev/null")
        self.assertIn("\x1b[1m", on_terminal.stdout)
        quiet = run("script", "-qec", f"bash -c '{say}'", "/dev/null", env={**os.environ, "NO_COLOR": "1"})
        self.assertNotIn("\x1b", quiet.stdout)
        self.assertIn("== heading", quiet.stdout)


if __name__ == "__main__":
    served.main()
