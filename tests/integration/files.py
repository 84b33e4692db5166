"""What programs do with files: outputs replace nothing but older files of their kind, two runs do not share one output,
and histories are read as they say, or refused by name."""
import csv
import os
import stat
import subprocess
import time
import unittest

import replay_support as support
import served
from replay_support import h5py, np
from served import OPTIONS

PROBLEMS = support.PROBLEMS
SCENE = support.EXAMPLES / "paper_velocity_driven_graded.toml"


class Files(support.ReplayTest):
    def assert_refused(self, run, *texts, code=1):
        self.assertEqual(run.returncode, code, run.stdout + run.stderr)
        for text in texts:
            self.assertIn(text, run.stderr)
        self.assertLess(len(run.stderr), 3000, run.stderr[:3000])
        self.assertEqual([file.name for file in self.path.rglob("*.partial")], [])


class Outputs(Files):
    def setUp(self):
        super().setUp()
        self.write(**support.velocity_history())
        self.scene = self.path / "scene.toml"
        self.scene.write_bytes(SCENE.read_bytes())

    def assert_kept(self, file, *command, texts=(), code=1):
        before = file.read_bytes()
        self.assert_refused(self.ran(*command), *texts, code=code)
        self.assertEqual(file.read_bytes(), before)

    def test_a_result_replaces_no_input(self):
        (self.path / "other.h5").hardlink_to(self.history)
        self.assert_kept(self.history, "replay", self.history, "--scene", self.scene, "--out", self.path / "other.h5",
                         texts=["is the history itself"])
        self.assert_kept(self.scene, "replay", self.history, "--scene", self.scene, "--out", self.scene, texts=["is the scene itself"])

    def test_a_result_replaces_only_a_result(self):
        for name, contents in (("notes.txt.h5", b"my notes\n"), ("data.csv", b"a,b\n1,2\n")):
            file = self.path / name
            file.write_bytes(contents)
            self.assert_kept(file, "replay", self.history, "--scene", self.scene, "--out", file, texts=[name, "no other file is replaced"])
        foreign = self.path / "foreign.h5"
        with h5py.File(foreign, "w") as made:
            made["x"] = 1.0
        self.assert_kept(foreign, "replay", self.history, "--scene", self.scene, "--out", foreign, texts=["a history or result (HDF5)"])
        for name in ("result.h5", "result.csv"):
            self.out = self.path / name
            self.out.touch()  # an empty file holds nothing to lose
            for _ in range(2):
                run = self.replay(scene=self.scene)
                self.assertEqual(run.returncode, 0, run.stderr)
            self.assertIn("(replaced)", run.stdout)

    def test_a_picture_replaces_only_a_picture(self):
        self.result(scene=self.scene)
        self.assert_kept(self.out, "replay", "plot", self.out, "--out", self.out, texts=["ends in .png"], code=2)
        named = self.path / "result.png"
        named.hardlink_to(self.out)
        self.assert_kept(self.out, "replay", "plot", self.out, "--out", named, texts=["itself"])
        text = self.path / "notes.png"
        text.write_bytes(self.scene.read_bytes())
        self.assert_kept(text, "replay", "plot", self.out, "--out", text, texts=["a picture (PNG)"])
        picture = self.path / "p.png"
        for _ in range(2):
            self.assertEqual(self.ran("replay", "plot", self.out, "--out", picture).returncode, 0)

    def test_a_report_replaces_only_a_report(self):
        self.result(scene=self.scene)
        self.assert_kept(self.out, "report", self.out, "-o", self.out, texts=["is an input"])
        self.assert_kept(self.scene, "report", self.out, "-o", self.scene, texts=["is not a report of shearbus"])
        page = self.path / "page.html"
        for _ in range(2):
            run = self.ran("report", self.out, "-o", page)
            self.assertEqual(run.returncode, 0, run.stderr)
        for node in ("-1", "18446744073709551616", "1_0", ""):
            self.refused("/usr/bin/python3", support.EXAMPLES.parent / "report/plot_history.py", self.out, "--out", page, "--node", node, code=2,
                         said="whole number")

    def test_an_endpoint_file_replaces_only_its_kind(self):
        for option in ("--endpoint-file", "--log-file"):
            self.assert_kept(self.scene, "server", "--bind", f"ipc://{self.path / 'bus'}", option, self.scene,
                             texts=["scene.toml", "no other file is replaced"])

    def test_a_run_replaces_no_summary_of_others(self):
        out = self.path / "run"
        out.mkdir()
        for name in ("history.h5", "summary.json"):
            (out / name).write_text("mine")
            self.assert_kept(out / name, "hydro", PROBLEMS / "sliding_to_a_stop.toml", "--out", out, "--no-plot", texts=[name])
            (out / name).unlink()

    def test_an_own_link_is_followed(self):
        real = self.path / "scratch" / "real.h5"
        real.parent.mkdir()
        self.out.symlink_to(real)
        for _ in range(2):
            self.result(scene=self.scene)
            self.assertTrue(self.out.is_symlink())
            self.assertTrue(real.is_file())

    @unittest.skipIf(os.geteuid() != 0, "files of another user are made by root alone")
    def test_a_link_of_another_user_is_not_followed(self):
        shared = self.path / "shared"
        shared.mkdir()
        shared.chmod(0o1777)
        victim = self.path / "victim"
        for name, option in (("e", "--endpoint-file"), ("l", "--log-file")):
            (shared / name).symlink_to(victim)
            os.chown(shared / name, 12345, 12345, follow_symlinks=False)
            self.assert_refused(self.ran("server", "--bind", f"ipc://{self.path / 'bus'}", option, shared / name),
                                "symbolic link of user 12345")
        (shared / "r.h5").symlink_to(victim)
        os.chown(shared / "r.h5", 12345, 12345, follow_symlinks=False)
        self.assert_refused(self.replay("--out", shared / "r.h5", scene=self.scene, out=False), "symbolic link of user 12345")
        (shared / "f").write_bytes(b"")
        os.chown(shared / "f", 12345, 12345)
        self.assert_refused(self.ran("server", "--bind", f"ipc://{self.path / 'bus'}", "--endpoint-file", shared / "f"),
                            "belongs to user 12345")
        self.assertFalse(victim.exists())

    def test_a_place_that_cannot_be_written_is_named_with_its_option_and_what_to_do(self):
        bus = f"ipc://{self.path / 'bus'}"
        for words, said in ((("--bind", bus, "--log-file", "/proc/self/log"), "--log-file /proc/self/log cannot be opened for writing"),
                            (("--bind", "ipc:///proc/self/fd/bus"), "choose a path (--bind) where this user may write")):
            self.assert_refused(self.ran("server", *words), said)

    def test_devices_and_directories_are_no_results(self):
        for file in ("/dev/null", self.path):
            self.assert_refused(self.replay("--out", file, scene=self.scene, out=False), str(file))
        self.assertTrue(stat.S_ISCHR(os.stat("/dev/null").st_mode))


class TwoRuns(Files):
    def start(self, program, *arguments):
        return served.program(self, getattr(OPTIONS, program), *arguments, stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    def test_of_two_replays_to_one_file_each_success_is_true(self):
        for delay in (0.0, 0.05, 0.2):
            names = ("a.h5", "b.h5")
            for name, steps in zip(names, (60000, 40000)):
                self.history = self.path / name
                self.write(**support.velocity_history(steps=steps))
            runs = {}
            for name in names:
                runs[name] = self.start("replay", self.path / name, "--scene", SCENE, "--out", self.out)
                time.sleep(delay)
            faults = {name: run.communicate(timeout=60)[1] for name, run in runs.items()}
            done = [name for name, run in runs.items() if run.returncode == 0]
            with h5py.File(self.out) as file:
                self.assertEqual([file["meta"].attrs["input_file"]], done, faults)
            for name in set(names) - set(done):
                self.assertRegex(faults[name], "another run (writes here|has written this file)")
            for file in self.path.glob("result*"):
                file.unlink()

    def test_a_directory_has_one_writer(self):
        scene = served.edited(PROBLEMS / "cone_al_steel_coarse.toml", self.path / "long.toml", end_time_s=1e-3)
        out = self.path / "run"
        first = self.start("hydro", scene, "--interface-law", "free_slip", "--out", out, "--no-plot")
        served.until(self, (out / ".lock").exists, first)
        second = self.ran("hydro", scene, "--interface-law", "free_slip", "--out", out, "--no-plot")
        self.assertIsNone(first.poll())
        self.assertEqual(second.returncode, 1, second.stderr)
        self.assertIn("another run writes here", second.stderr)
        first.kill()
        first.wait()
        short = self.ran("hydro", PROBLEMS / "sliding_to_a_stop.toml", "--out", out, "--no-plot")
        self.assertEqual(short.returncode, 0, short.stderr)  # the lock of a dead run holds nobody up
        self.assertFalse((out / ".lock").exists())

    def test_what_killed_runs_left_is_removed(self):
        self.write(**support.velocity_history())
        left = self.path / "result.h5.00beef.partial"
        left.write_bytes(b"x")
        os.utime(left, (1, 1))
        self.result()
        self.assertFalse(left.exists())


class Histories(Files):
    def attribute(self, dataset, value):
        with h5py.File(self.history, "a") as file:
            file[dataset].attrs["units"] = value

    def test_units_are_converted_or_refused(self):
        self.write(**support.velocity_history())
        plain = self.result()
        scaled = support.velocity_history()
        scaled["pressure"] = np.full((5, 3), 11.2)
        scaled["velocity_jump"] = np.full((5, 3), 0.1)
        scaled["time"] = scaled["time"] * 1e6
        for unit in ("km/s", "km s-1", "km.s^-1", "km s**-1"):
            self.write(**scaled)
            self.attribute("pressure", "GPa")
            self.attribute("velocity_jump", unit)
            self.attribute("time", np.bytes_("\u00b5s".encode()))
            found = self.result()
            for name in ("shear_stress", "interface_temperature"):
                np.testing.assert_allclose(found[name], plain[name], rtol=1e-12)
        self.attribute("pressure", "psi")
        self.assert_refused(self.replay(), "/pressure", '"psi"', "GPa")
        self.attribute("pressure", 1.0)
        self.assert_refused(self.replay(), "/pressure", "units")

    def test_damaged_texts_of_variable_length_are_refused(self):
        """HDF5 1.10 dies of some damage in the heap where h5py writes attributes, or never ends: no program of ours does."""
        self.write(**support.velocity_history())
        self.attribute("pressure", "GPa")
        self.attribute("velocity_jump", "km/s")
        whole = self.history.read_bytes()
        heap = whole.index(b"GCOL")
        attributes = [at for at in range(len(whole)) if whole.startswith(b"units\0", at)]
        places = [heap + 24, *range(heap + 49, heap + 56), *(at + i for at in attributes for i in (53, 54, 55))]  # of those tried
        refused = 0
        for place in places:
            damaged = bytearray(whole)
            damaged[place] ^= 0xff
            self.history.write_bytes(damaged)
            run = self.ran("replay", self.history, "--scene", SCENE, "--out", self.out)
            self.assertIn(run.returncode, (0, 1), f"byte {place}: {run.stderr}")
            self.assertNotIn("infinite loop", run.stderr)
            if "HDF5 does not survive its texts" in run.stderr:
                refused += 1
                self.assertIn("is damaged", run.stderr)
        self.assertGreater(refused, 4)

    def test_the_units_of_a_start_are_those_of_the_time(self):
        parts = support.velocity_history()
        self.write(**(parts | {"time": 100.0 + parts["time"] * 1e6, "t0": 100.0}))
        self.attribute("time", "us")
        self.assertIn("0.0001 to 0.000100005 s", self.result()["text"])

    def test_a_clock_that_begins_late(self):
        late = support.velocity_history()
        late["time"] = 1e-3 + late["time"]
        self.write(**late)
        self.assert_refused(self.replay(), "first step", "t0", "/dt")
        self.write(**late, dt=np.full(5, 1e-9))
        self.assertIn("0.001 to 0.001 s", self.result()["text"])
        self.write(**late, t0=1e-3)
        self.result()
        table = self.path / "late.csv"
        table.write_text("time [us],pressure [GPa],velocity_jump [m/s]\n100.1,11,100\n100.2,11,100\n")
        self.assert_refused(self.replay("--steps", history=table), "line 2", "dt [s]", "--points")
        self.assertEqual(self.replay("--points", history=table).returncode, 0)

    def test_values_that_are_elsewhere_or_nowhere(self):
        parts = support.velocity_history()
        fifo = self.path / "fifo"
        os.mkfifo(fifo)

        def made(make):
            self.write(**(parts | {"pressure": None}))
            with h5py.File(self.history, "a") as file:
                make(file)
            return self.ran("replay", self.history, "--scene", SCENE, "--out", self.out, timeout=20)

        def virtual(file, source, name):
            layout = h5py.VirtualLayout((5, 3), "f8")
            layout[...] = h5py.VirtualSource(str(source), "x", (5, 3))
            file.create_virtual_dataset(name, layout, fillvalue=1e9)

        self.assert_refused(made(lambda f: virtual(f, "absent.h5", "pressure")), "/pressure is a virtual dataset")
        self.assert_refused(made(lambda f: virtual(f, fifo, "pressure")), "/pressure is a virtual dataset")
        self.assert_refused(made(lambda f: f.create_dataset("pressure", (5, 3), "f8", external=[(str(fifo), 0, 120)])),
                            "/pressure has its values in another file")

        def external(name):
            def make(file):
                file[name] = h5py.ExternalLink(str(fifo), "/x")
            return make
        self.assert_refused(made(external("pressure")), "/pressure is a link to another file")
        self.assert_refused(made(lambda f: (external("g")(f), f.__setitem__("pressure", h5py.SoftLink("/g/pressure")))),
                            "/pressure is a link to another file")
        whole = parts["pressure"]
        self.write(**parts)
        for name in ("parameter", "pair", "dt", "initial_temperature"):
            with h5py.File(self.history, "a") as file:
                external(name)(file)
            self.assert_refused(self.ran("replay", self.history, "--scene", SCENE, "--out", self.out, timeout=20),
                                f"/{name} is a link to another file")
            with h5py.File(self.history, "a") as file:
                del file[name]

        def holes(file):
            file.create_dataset("pressure", (5, 3), "f8", chunks=(1, 3))[:4] = whole[:4]
        self.assert_refused(made(holes), "/pressure has 5 chunks, of which 1 were never written")
        self.assert_refused(made(lambda f: f.create_dataset("pressure", (5, 3), "f8")), "/pressure was made", "never written")
        self.assert_refused(made(lambda f: f.create_dataset("pressure", data=whole, compression="lzf")), "LZF", "h5repack", "gzip")
        run = made(lambda f: f.create_dataset("pressure", data=whole, compression="gzip", shuffle=True, chunks=(2, 2)))
        self.assertEqual(run.returncode, 0, run.stderr)

    def test_names_that_are_nearly_right(self):
        parts = support.velocity_history()
        self.write(**(parts | {"pressure": None, "Presure": parts["pressure"]}))
        self.assert_refused(self.replay(), "/pressure [T,N]", 'did you mean pressure by "Presure"?', "node_id")
        nodes = len(parts["node_id"])
        self.write(**(parts | {"initial_temprature": np.full(nodes, 400.0), "interface_temperature": np.full((3, nodes), 1.0)}))
        run = self.replay()
        self.assertEqual(run.returncode, 0, run.stderr)
        said = run.stdout + run.stderr
        self.assertIn("/initial_temprature is not used; did you mean /initial_temperature?", said)
        self.assertNotIn("/interface_temperature", said)

    def test_pipes_and_devices_hang_nothing(self):
        self.write(**support.velocity_history())
        fifo = self.path / "fifo"
        os.mkfifo(fifo)
        csv_fifo = self.path / "fifo.csv"
        os.mkfifo(csv_fifo)
        for arguments in ((fifo, "--scene", SCENE, "--out", self.out), (csv_fifo, "--points", "--scene", SCENE, "--out", self.out),
                          (self.history, "--scene", fifo, "--out", self.out), ("export", fifo, "--out", self.out),
                          ("compare", fifo, fifo), ("--capsule", fifo), ("plot", fifo, "--out", self.path / "p.png")):
            with self.subTest(arguments[0]):
                run = self.ran("replay", *arguments, timeout=20)
                self.assertIn(run.returncode, (1, 2))
                self.assertIn("fifo", run.stderr)
        self.assert_refused(self.ran("ctl", "check", fifo, timeout=20), "is a pipe")
        self.assert_refused(self.ran("hydro", fifo, timeout=20), "is a pipe")


class Tables(Files):
    def table(self, text, *arguments, name="table.csv", encoding="utf8"):
        file = self.path / name
        file.write_bytes(text if isinstance(text, bytes) else text.encode(encoding))
        return self.replay(*(arguments or ("--points",)), history=file)

    HEAD = "time [us];pressure [GPa];velocity_jump [m/s]\n"

    def assert_read(self, run):
        self.assertEqual(run.returncode, 0, run.stderr)

    def test_line_ends_and_encodings(self):
        text = self.HEAD + "0;11,2;100\n0,25;11;98\n"
        self.assert_read(self.table(b"\xfe\xff" + text.encode("utf-16-be")))
        self.assert_refused(self.table(text.encode("utf-16-le")), "zero byte", "UTF-8")
        self.assert_refused(self.table(text.encode("utf-16") + b"\x3d\xd8"), "half a pair")
        self.assert_refused(self.table(text.encode("utf-16") + b"1"), "odd number of bytes")
        self.assert_read(self.table(f"# \U0001f600\n{text}", encoding="utf-16"))

    def test_one_decimal_sign(self):
        self.assert_refused(self.table(self.HEAD + "0;11;100\n0.05;11,2;100\n"), "line 3", "decimal comma", "line 3 a decimal point")

    def test_a_long_line(self):
        self.assert_refused(self.table(self.HEAD + "1" * 20_000_000), "line 2", "more than 1048576 characters")

    def test_names_that_are_nearly_right(self):
        run = self.table("Time,pressure [GPa],velocity_jump [m/s]\n0,11,100\n1,11,100\n")
        self.assert_refused(run, "line 1", '"Time"', "did you mean time?", "--columns time:s,pressure:GPa,velocity_jump:m/s")
        run = self.table("time [us],pressure [GPa],velocity_jmp [m/s]\n0,11,100\n1,11,100\n")
        self.assert_refused(run, "did you mean velocity_jump?", "--columns time:us,pressure:GPa,velocity_jump:m/s")
        run = self.table("t,P [GPa]\n0,11\n1,11\n")
        self.assert_refused(run, '"t", "P [GPa]"')
        self.assert_refused(self.table("0,11\n1,11\n", "--points", "--columns", "tyme:us,pressure:GPa"), '"tyme"')

    def test_lines_are_named(self):
        head = "# gauge\ntime [us],node,pressure [GPa],velocity_jump [m/s]\n"
        rows = "1,7,11,100\n1,8,11,100\n2,7,11,100\n"
        self.assert_refused(self.table(head + rows, "--steps"), "line 5", "node 8", "2e-06 s")
        self.assert_refused(self.table(head + rows + "2,9,11,100\n", "--steps"), "line 6", "node 9", "node 8")
        self.assert_refused(self.table(head + "1,7,11,100\n1,7,11,100\n", "--steps"), "line 4", "node 7", "line 3")
        self.assert_refused(self.table(head + rows + "2,8,11,100\n1,7,11,100\n1,8,11,100\n", "--steps"), "line 7", "not after")

    def test_ids_are_exact(self):
        ids = [2**64 - 1, 2**53 + 1, 0]
        rows = "".join(f"{t},{node},11.2,100\n" for t in (1, 2) for node in ids)
        self.out = self.path / "result.csv"
        run = self.table("time [us],node,pressure [GPa],velocity_jump [m/s]\n" + rows, "--steps")
        self.assert_read(run)
        with open(self.out, encoding="utf8", newline="") as file:
            found = list(csv.DictReader(file))
        self.assertEqual([int(row["node_id"]) for row in found], ids * 2)
        first = self.out.read_text(encoding="utf8")
        again = self.replay("--steps", history=self.out, out=False, scene=SCENE)
        self.out = self.path / "again.csv"
        again = self.replay("--steps", history=self.path / "result.csv")
        self.assert_read(again)
        self.assertEqual(self.out.read_text(encoding="utf8"), first)  # a result is a history
        for node in ("18446744073709551616", "-1", "1.5", "1e20", ""):
            run = self.table(f"time [us],node,pressure [GPa],velocity_jump [m/s]\n1,{node},11,100\n", "--steps")
            self.assert_refused(run, "line 2", "whole number")

    def test_what_no_result_as_text_has(self):
        self.write(**support.velocity_history())
        self.out = self.path / "result.csv"
        self.assert_read(self.replay())
        self.assert_refused(self.replay("--profile-nodes", "10", "--profile-times", "1e-9"), "--profile-nodes")
        self.out = self.path / "result.txt"
        self.assert_refused(self.replay(), ".txt")


class Numbers(Files):
    def test_of_command_lines(self):
        self.write(**support.velocity_history())
        replay = (self.history, "--scene", SCENE, "--out", self.out)
        server = ("--bind", f"ipc://{self.path / 'bus'}")
        whole = [("replay", "export", "log", "--out", self.out, "--node"), ("replay", "plot", self.history, "--out", "p.png", "--node"),
                 ("replay", *replay, "--profile-times", "1e-9", "--profile-nodes"), ("server", *server, "--threads"),
                 ("server", *server, "--nodes-per-task"), ("server", *server, "--drop-record"), ("server", *server, "--allow-uid"),
                 ("server", *server, "--state-memory-mb"), ("ctl", "watch", "--server", server[1], "--looks"),
                 ("ctl", "top", "--server", server[1], "--count"), ("hydro", PROBLEMS / "sliding_to_a_stop.toml", "--dump-every")]
        for command in whole:
            for value in ("-1", "18446744073709551616", "", "0x10"):
                with self.subTest(command=command[-1], value=value):
                    self.assert_refused(self.ran(*command, value), command[-1].lstrip("-"), code=2)
        real = [("replay", *replay, "--points", "--dt"), ("replay", *replay, "--rtol"), ("ctl", "ping", "--server", server[1], "--timeout"),
                ("server", *server, "--checkpoint-every"), ("hydro", PROBLEMS / "sliding_to_a_stop.toml", "--dump-interval")]
        for command in real:
            for value in ("inf", "1e309", "", "1,5"):
                with self.subTest(command=command[-1], value=value):
                    self.assert_refused(self.ran(*command, value), command[-1].lstrip("-"), code=2)

    def test_a_leading_zero_is_no_octal(self):
        self.write(**support.velocity_history())
        self.assertEqual(self.replay("--profile-nodes", "010", "--profile-times", "1e-9").returncode, 0)  # node 10

    def test_a_fault_of_set_is_its_own(self):
        self.write(**support.velocity_history())
        scene = self.path / "scene.toml"
        text = SCENE.read_text(encoding="utf8")
        scene.write_text(text, encoding="utf8")
        run = self.replay("--set", "layer.cells=-3", scene=scene)
        self.assert_refused(run, "--set layer.cells=-3: ")
        self.assertNotIn("scene.toml:", run.stderr)
        scene.write_text(text.replace('"aluminium_dlp"', '"unobtainium"'), encoding="utf8")
        line = next(i for i, t in enumerate(scene.read_text(encoding="utf8").splitlines(), 1) if "unobtainium" in t)
        self.assert_refused(self.replay("--set", "layer.cells=30", scene=scene), f"scene.toml:{line}:")

    def test_a_check_says_what_it_leaves_out(self):
        run = self.ran("ctl", "check", PROBLEMS / "two_half_spaces.toml")
        self.assertEqual(run.returncode, 0, run.stderr)
        self.assertIn("valid without its table [hydro]", run.stderr)
        self.assertIn("two_half_spaces.toml --check", run.stderr)
        self.assertNotIn("[hydro]", self.ran("ctl", "check", SCENE).stderr)

    def test_scene_or_restart(self):
        both = self.ran("hydro", PROBLEMS / "sliding_to_a_stop.toml", "--restart", self.path)
        self.assert_refused(both, "give one of them", code=2)
        self.assertNotIn("required", both.stderr)
        self.assert_refused(self.ran("hydro"), "required", code=2)


if __name__ == "__main__":
    served.main()
