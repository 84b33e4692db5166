"""Texts of strangers (scenes, tables, files and their names, endpoint files) with commands to a terminal and ends of
lines in every place: no program prints them, and none makes a second line of them."""
import os
import pathlib
import re
import subprocess
import sys

import h5py
import numpy as np

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
import shearbus
from served import OPTIONS, PROBLEMS

EVIL = "x\x1b[2J\x07\u009b31m\u202e\nforged: line"
TOML = '"x\\u001b[2J\\u0007\\u009b31m\\u202e\\nforged: line"'
SCENE = served.scene("velocity_driven")
COMMANDS = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e]")


class HostileTexts(served.Served):
    def setUp(self):
        super().setUp()
        os.environ["SHEARBUS_SERVER"] = str(OPTIONS.server)  # of the sessions

    def check(self, text, what, quoted=True):
        self.assertNotRegex(text, COMMANDS, what)
        self.assertFalse([line for line in text.splitlines() if line.startswith("forged")], f"{what}: {text}")
        if quoted:
            self.assertIn("\\x1b[2J", text, f"{what}: the name is shown, escaped")

    def ran(self, program, *words, code=1, quoted=True):
        done = subprocess.run([getattr(OPTIONS, program), *map(os.fspath, words)], capture_output=True, timeout=300, check=False,
                              cwd=self.path)
        text = (done.stdout + done.stderr).decode("utf8", "surrogateescape")
        self.assertIn(done.returncode, code if isinstance(code, tuple) else (code,), text)
        self.check(text, f"{program} {words}", quoted)
        return text

    def file(self, name, text):
        path = self.path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    def scenes(self):
        """Scenes with the text in every place."""
        yield "unknown key", f"{TOML} = 1\n" + SCENE
        yield "unknown table", SCENE + f"[{TOML}]\n"
        yield "key of a table", SCENE.replace("[hard]", f"{TOML} = 1\n[hard]")
        yield "material", SCENE.replace('"steel_dlp"', TOML)
        yield "choice", SCENE.replace('"velocity_driven"', TOML)
        yield "text for a number", SCENE + f"[layer]\nthickness_m = {TOML}\n"
        yield "name of a pair", SCENE + f"[pair.{TOML}.soft]\nmaterial = 'aluminium_dlp'\n"
        yield "material of a pair", SCENE + f"[pair.a.soft]\nmaterial = {TOML}\n"
        yield "number for a table", f"soft = {TOML}\n" + SCENE.replace('[soft]\nmaterial = "aluminium_dlp"\n', "")

    def test_scenes_in_programs_and_in_refusals(self):
        session = None
        for what, text in self.scenes():
            scene = self.file("scene.toml", text)
            said = self.ran("ctl", "check", scene)
            self.assertRegex(said, r"scene\.toml:\d+:\d+: ", what)
            with self.assertRaises(shearbus.Error) as fault:
                session = shearbus.open(text, [1], check_closure="off")
            self.check(str(fault.exception) + fault.exception.field, what)
            self.check(fault.exception.text, what)
        self.assertIsNone(session)
        self.file("scene.toml", f"name = {TOML}\n" + SCENE.split("\n", 1)[1])
        self.ran("ctl", "check", "scene.toml", quoted=False)
        hydro = self.file("hydro.toml", SCENE + f"[hydro]\n{TOML} = 1\n")
        self.ran("hydro", hydro)

    def test_names_of_files(self):
        scene = self.file(EVIL + ".toml", f"{TOML} = 1\n" + SCENE)
        good = self.file("good.toml", SCENE)
        for program, *words in (("ctl", "check", scene), ("ctl", "check", scene.with_suffix(".gone")), ("hydro", scene),
                                ("replay", scene, "--scene", good, "--out", "out.h5"),
                                ("replay", self.path / EVIL, "--scene", good, "--out", "out.h5"),
                                ("report", scene),
                                ("ctl", "status", "--server", f"file://{self.path}/{EVIL}", "--timeout", "0.1"),
                                ("server", "--bind", f"ipc://{self.path}/{EVIL}/no/s"),
                                ("server", "--bind", f"ipc://{self.path}/bus/s", "--state-dir", scene),
                                ("server", "--bind", f"ipc://{self.path}/bus/s", "--log-file", scene / "log")):
            self.ran(program, *words, code=(1, 2))
        self.ran("replay", "plot", scene, "--out", "out.png", code=(1, 2), quoted=False)
        self.assertFalse((self.path / "out.h5").exists())

    def test_every_text_of_a_command_line(self):
        """Names of files that come from elsewhere reach command lines by patterns of a shell and by scripts."""
        good, column = self.file("good.toml", SCENE), PROBLEMS / "two_half_spaces.toml"
        toml, h5, csv = (self.file(EVIL + end, "a = 1\n") for end in (".toml", ".h5", ".csv"))
        inside = self.path / EVIL / "x"
        replay = (csv, "--points", "--scene", good)
        for program, *words in (
            ("study", EVIL), ("study", "map", toml), ("study", "fit", toml, "--parameter", "a.b=1:2"), ("study", "fit", good, "--parameter", EVIL),
            ("study", "fit", good, "--parameter", "a.b=1:2", "--curve", csv), ("study", "mesh", toml), ("study", "curve", toml),
            ("ctl", EVIL), ("ctl", "compare", h5, h5), ("ctl", "ping", "--server", EVIL, "--timeout", "0.1"), ("ctl", "materials", EVIL),
            ("ctl", "rehearse", "--problem", EVIL, "ipc:///nowhere/s"), ("ctl", "rehearse", "--timeout", EVIL, "ipc:///nowhere/s"),
            ("hydro", "--restart", self.path / EVIL), ("hydro", column, "--interface-law", EVIL), ("hydro", column, "--explain", EVIL), ("hydro", toml, "--explain"),
            ("replay", "compare", h5, h5), ("replay", "export", h5, "--out", "o.csv"), ("replay", "--capsule", h5), ("replay", "plot", h5, "--out", "p.png"),
            ("replay", *replay, "--out", inside.with_suffix(".h5")), ("replay", *replay, "--columns", EVIL, "--out", "o.h5"),
            ("replay", *replay, "--set", EVIL, "--out", "o.h5"), ("report", h5), ("report", h5, "-o", inside), ("report", f"--{EVIL}"),
            ("server", EVIL), ("server", "--bind", EVIL), ("server", "--bind", "ipc:///nowhere/s", "--endpoint-file", inside),
            ("server", "--bind", "tcp://127.0.0.1:*", "--curve-secret", inside, "--authorized-keys", inside)):
            said = self.ran(program, *words, code=(1, 2), quoted=False)
            self.assertNotIn("Traceback", said)
        self.ran("ctl", "keygen", inside.with_name("key"), code=(0, 1))
        self.ran("ctl", "keygen", self.path / EVIL, code=0)
        self.file(EVIL + " good.toml", SCENE)
        self.ran("ctl", "check", self.path / (EVIL + " good.toml"), code=0)
        self.ran("study", "map", served.EXAMPLES / "validity_map.toml", "--out", self.path / EVIL, "--pressures", "2", "--velocities", "2",
                         "--times", "1e-8", code=0)

    def test_tables_and_histories(self):
        scene = self.file("good.toml", SCENE)
        rows = "\n1e-9,1,100,5e9\n"
        tables = {"unit": f"time [s],node_id,velocity_jump [m/s\x1b[2J],pressure [Pa]{rows}",
                  "column": f"time [s],node_id,velocity_jump\x1b[2J [m/s],pressure [Pa]{rows}",
                  "number": "time [s],node_id,velocity_jump [m/s],pressure [Pa]\n1e-9,1,1\x1b[2J0,5e9\n",
                  "id": "time [s],node_id,velocity_jump [m/s],pressure [Pa]\n1e-9,1\x1b[2J,10,5e9\n"}
        for what, text in tables.items():
            self.ran("replay", self.file(f"{what}.csv", text), "--steps", "--scene", scene, "--out", "out.h5",
                             quoted=what != "column")  # a column that nobody asks for is not named
        for what in ("parameter", "dataset"):
            with h5py.File(self.path / "history.h5", "w") as file:
                file["time"] = [1e-9]
                file["node_id"] = np.array([1], np.uint64)
                file["pressure"], file["velocity_jump"] = [[5e9]], [[100.0]]
                file[f"parameter/{EVIL}" if what == "parameter" else EVIL] = [1.0]
            self.ran("replay", "history.h5", "--scene", scene, "--out", "out.h5", code=(0, 1), quoted=what == "parameter")

    def test_every_text_that_a_host_gives(self):
        def opened(scene=SCENE, endpoint=None, **options):
            return lambda: shearbus.open(scene, [1], endpoint, check_closure="off", connect_deadline=0.2, **options)

        place = self.path / EVIL
        with shearbus.open(SCENE, [1], check_closure="off") as session:
            calls = {"mark": lambda: session.mark(EVIL), "rollback_to": lambda: session.rollback_to(EVIL),
                     "accept": lambda: session.accept(EVIL), "want": lambda: session.step(1e-9, jump=[1.0], pressure=[1e9], want=[EVIL]),
                     "column": lambda: session.step(1e-9, **{EVIL: [1.0]}),
                     "parameters": opened(parameters={EVIL: 1.0}), "pair": opened(pair=EVIL), "domain": opened(domain=EVIL),
                     "domain of a server": opened(endpoint=f"ipc://{self.path}/none", domain=EVIL),
                     "scene": opened(place.with_suffix(".toml")), "endpoint": opened(endpoint=EVIL),
                     "ipc": opened(endpoint=f"ipc://{place}"), "tcp": opened(endpoint=f"tcp://{EVIL}:7447"),
                     "file": opened(endpoint=f"file://{place}"), "check_closure": lambda: shearbus.open(SCENE, [1], check_closure=EVIL),
                     "state_dir": opened(state_dir=f"/proc/{EVIL}"), "ticket": lambda: shearbus.resume(EVIL),
                     "server_key_file": opened(endpoint="tcp://127.0.0.1:1", server_key_file=place, secret_key_file=place),
                     "secret_key_file": opened(endpoint="tcp://127.0.0.1:1", secret_key_file=place, server_key_file=place),
                     "name": opened(endpoint=f"ipc://{self.path}/none", name=EVIL)}
            for what, call in calls.items():
                with self.subTest(what), self.assertRaises((shearbus.Error, ValueError, TypeError)) as fault:
                    call()
                said = str(fault.exception)
                self.check(said, what, quoted=False)
                self.assertEqual(len(said.splitlines()), 1, said)

    def test_endpoint_files_and_the_log(self):
        directory = self.path / "servers"
        directory.mkdir()
        contents = 'version = "{0}"\nhost = "{0}"\nserver_key = ""\nendpoint = "{1}"\nepoch = "{0}"\n'
        (directory / EVIL).write_text(contents.format("1", "ipc:///nowhere/s"))
        (directory / "content").write_text(contents.format("x\x1b[2J", "ipc:///nowhere/\x1b[2J"))  # no server writes such a file
        said = self.ran("ctl", "status", "--all", directory, "--timeout", "0.1")
        self.assertEqual(len(said.splitlines()), 1, said)
        self.ran("ctl", "status", "--server", f"file://{directory}/content", "--timeout", "0.1", quoted=False)
        self.ran("ctl", "status", "--all", directory, "--timeout", "0.1", "--json", quoted=False)
        log = self.path / "log"
        server = served.program(self, OPTIONS.server, "--bind", f"ipc://{self.path}/bus/s", "--log-file", log, stderr=subprocess.DEVNULL)
        served.until(self, lambda: log.exists() and "listening" in log.read_text(), server)
        for options in ({"domain": "a\u202eb"}, {"domain": EVIL}):
            try:
                session = shearbus.open(SCENE, [1], f"ipc://{self.path}/bus/s", check_closure="off", **options)
                session.close()
            except shearbus.Error as fault:
                self.check(str(fault), "the domain", quoted=False)
        self.check(log.read_text(), "the log", quoted=False)


if __name__ == "__main__":
    served.main()
