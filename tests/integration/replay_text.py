"""Tables of text as shearbus-replay reads them by Python: the same numbers whether numpy reads all rows or they are read one by one, and
what a run leaves where it ends early."""
import os
import pathlib
import signal
import subprocess
import sys
import time
from unittest import mock

import replay_support as support
import served
from replay_support import EXAMPLES, velocity_history
from served import OPTIONS

CLIENT = EXAMPLES.parent
sys.dont_write_bytecode = True
sys.path += [str(CLIENT / "replay"), str(CLIENT / "report")]
import csv_table
import units

GRADED = EXAMPLES / "paper_velocity_driven_graded.toml"
PLAIN = "time [us],node,pressure [GPa],velocity_jump [m/s]\n" + "".join(f"{t},{node},1{node}.{t},{1e2 / 3 * t!r}\n" for t in (1, 2, 3) for node in (7, 8))


class Ways(support.ReplayTest):
    """The two ways to read rows."""

    def table(self, text, way, **options):
        file = self.path / "table.csv"
        file.write_bytes(text if isinstance(text, bytes) else text.encode())
        other = {"_read_all": "_read_one_by_one", "_read_one_by_one": "_read_all"}[way]
        with mock.patch.object(csv_table.CsvTable, other, side_effect=ValueError("the other way")):
            return csv_table.CsvTable(file, **options)

    def test_both_ways_read_the_same_bits(self):
        semicolons, texts = PLAIN.replace(",", ";"), PLAIN.replace("7,", "7,a b,").replace("8,", "8,\xe9 x,").replace("node,", "node,{},")
        for what, text in {
            "plain": PLAIN, "no end": PLAIN.rstrip("\n"), "CR LF": PLAIN.replace("\n", "\r\n"), "CR": PLAIN.replace("\n", "\r"),
            "empty lines": PLAIN.replace("\n", "\n\n"), "head of comments": "# a\n\n#b\n" + PLAIN, "byte order mark": "\ufeff" + PLAIN,
            "UTF-16": PLAIN.encode("utf-16"), "blanks": PLAIN.replace(",", " , "), "tabs": PLAIN.replace(",", "\t"), "semicolons": semicolons,
            "decimal comma": semicolons.replace(".", ","), "sep": "sep=|\n" + PLAIN.replace(",", "|"),
            "quoted": "\n".join(",".join(f'"{cell}"' for cell in line.split(",")) for line in PLAIN.splitlines()),
            "remark": texts.format("remark"), "pair": texts.format("pair"), "long ids": PLAIN.replace(",7,", ",18446744073709551615,"),
            "signs": PLAIN.replace(",1", ",+1"), "too small": PLAIN.replace("33.3", "1e-400").replace("66.6", "-1e-400")}.items():
            with self.subTest(what):
                fast, slow = self.table(text, "_read_all"), self.table(text, "_read_one_by_one")
                self.assertEqual(fast.times.tobytes(), slow.times.tobytes())
                self.assertEqual(fast.ids.tobytes(), slow.ids.tobytes())
                self.assertEqual(fast.texts, slow.texts)
                self.assertEqual({name: values.tobytes() for name, values in fast.values.items()},
                                 {name: values.tobytes() for name, values in slow.values.items()})
                self.assertEqual(fast.values["pressure"].shape, (3, 2))

    def test_what_numpy_does_not_read_alike_is_left_to_the_rows(self):
        """Each of these is refused, or has a meaning that numpy does not know."""
        semicolons, rows = PLAIN.replace(",", ";"), PLAIN.splitlines()
        first = "\n".join(["{}," + rows[0], *(f"a,{row}" for row in rows[1:]), "#a,4,7,17.4,1", "#a,4,8,18.4,1"])
        for name in ("remark", "pair"):
            self.assertEqual(len(self.table(first.format(name), "_read_one_by_one").times), 3)
        fortran = PLAIN.replace("17.1", "1.71D+01").replace("33.3", "333d-1")
        self.assertEqual(*(self.table(text, "_read_one_by_one").values["pressure"].tobytes() for text in (fortran, PLAIN)))
        for text in (fortran, first.format("remark"), first.format("pair"), PLAIN.replace("17.1", "nan"), PLAIN.replace("17.1", "1e999"), PLAIN.replace("17.1", ""), PLAIN.replace("17.1", "1_0"),
                     PLAIN.replace("17.1", "0x1"), PLAIN.replace("17.1", "1;2"), PLAIN.replace("17.1", "1 2"), PLAIN.replace(",7,", ",-7,"), PLAIN.replace(",7,", ",7.5,"),
                     PLAIN.replace(",7,", ",18446744073709551616,"), PLAIN.replace("17.1,", "17.1,5,"), semicolons.replace("17.1", "17,1"),
                     semicolons.replace("17.1", "1.000,5"), PLAIN.replace("17.1", "17.1 # x"), PLAIN.replace("7,", "7,x,").replace("node,", "node,remark,")):
            with self.subTest(text), self.assertRaisesRegex(ValueError, "other way"):
                self.table(text, "_read_all")

    def test_units_are_known_in_any_usual_spelling(self):
        for unit, si, factor in (("kg m-2", "kg/m2", 1.0), ("kg.m^-2", "kg/m2", 1.0), ("kg·m⁻²", "kg/m2", 1.0), ("g/cm2", "kg/m2", 10.0), ("µs", "s", 1e-6),
                                 ("microseconds", "s", 1e-6), ("s-1", "1/s", 1.0), ("1/us", "1/s", 1e6), ("MPa s m-1", "Pa s/m", 1e6), ("mm/us", "m/s", 1e3)):
            self.assertEqual(units.factor_to_si(unit, si), factor, unit)
        for unit in ("psi", "mpa", "s", "Pa/s", "", "Pa2", "m" * 1000):
            self.assertIsNone(units.factor_to_si(unit, "Pa"), unit)

    def test_what_belongs_to_a_node_does_not_change(self):
        for name, values in (("initial_temperature [K]", "300 300 301 300 300 300"), ("pair", "a b c b a b"), ("parameter/a.b", "1 2 3 2 1 2")):
            lines = PLAIN.splitlines()
            text = "\n".join(f"{line},{value}" for line, value in zip(lines, [name, *values.split()]))
            with self.assertRaisesRegex(ValueError, f"table.csv, line 4: {name.split()[0]} of node 7 changes from .* at 2e-06 s"):
                self.table(text, "_read_all")

    def test_what_is_no_number_in_si_and_what_is_no_utf_8(self):
        with self.assertRaisesRegex(ValueError, "table.csv, line 3: pressure is 1e[+]308 in its unit, which is no finite number in Pa"):
            self.table(PLAIN.replace("18.1", "1e308"), "_read_all")
        text = PLAIN.replace("7,", "7,a,").replace("8,", "8,\xe9,").replace("node,", "node,pair,")
        with self.assertRaisesRegex(ValueError, r"table.csv, line 3: pair is .*, which is no UTF-8. Save the table as UTF-8"):
            self.table(text.encode("latin-1"), "_read_all")

    def test_lengths_of_steps_agree_with_the_times(self):
        text = "time [us],dt [us],pressure [GPa]\n1,{},11\n2,{},11\n"
        self.assertEqual(list(self.table(text.format(0.5, 1), "_read_all").dts), [0.5e-6, 1e-6])
        for lengths, fault in (((1, 0.5), "line 3: dt is 5e-07 s; the step from 1e-06 to 2e-06 s takes 1e-06 s"), ((1, 0), "line 3: dt is 0 s")):
            with self.assertRaisesRegex(ValueError, fault):
                self.table(text.format(*lengths), "_read_all")


class Runs(support.ReplayTest):
    def setUp(self):
        super().setUp()
        self.scratch = self.path / "scratch"
        self.scratch.mkdir()
        self.table = self.path / "table.csv"
        self.table.write_text(PLAIN)

    def run_replay(self, *words, **environment):
        return self.ran("replay", *words, env=os.environ | {"TMPDIR": str(self.scratch)} | environment)

    def test_nothing_is_left_where_the_history_was_made(self):
        for text, code in ((PLAIN, 0), (PLAIN.replace("17.1", "x"), 1), (PLAIN.replace("velocity_jump [m/s]", "remark"), 1)):
            self.table.write_text(text)
            run = self.run_replay(self.table, "--steps", "--scene", GRADED, "--out", self.out)
            self.assertEqual(run.returncode, code, run.stderr)
            self.assertEqual(list(self.scratch.iterdir()), [])
        run = self.run_replay(self.table, "--steps", "--scene", GRADED, "--out", self.out, TMPDIR=str(self.path / "absent"))
        self.assertEqual(run.returncode, 1)
        self.assertRegex(run.stderr, "TMPDIR names no directory .*absent")

    def test_an_interrupt_ends_both_programs_and_leaves_nothing(self):
        self.table.write_text(PLAIN.splitlines()[0] + "\n" + "".join(f"{t},7,11.5,{t / 7!r}\n" for t in range(1, 2_000_000)))
        command = [OPTIONS.replay, str(self.table), "--steps", "--scene", str(GRADED), "--out", str(self.out)]
        with subprocess.Popen(command, env=os.environ | {"TMPDIR": str(self.scratch)}, stderr=subprocess.PIPE, text=True, start_new_session=True) as run:
            self.child_of(run)
            time.sleep(0.5)
            os.killpg(run.pid, signal.SIGINT)  # as a terminal does
            _, said = run.communicate(timeout=60)
        self.assertEqual(run.returncode, 1)
        self.assertEqual(said.strip(), "shearbus-replay: interrupted; no result is written")
        self.assertEqual([*self.scratch.iterdir(), *self.path.glob("result*")], [])
        with subprocess.Popen(command, env=os.environ | {"TMPDIR": str(self.scratch)}, stderr=subprocess.PIPE, text=True) as run:
            child = self.child_of(run)
            os.kill(child, signal.SIGKILL)  # as the system does where memory ends
            _, said = run.communicate(timeout=60)
        self.assertEqual(run.returncode, 1)
        self.assertRegex(said, "shearbus-replay: .*python3 was ended: Killed, as the system does where memory ends")
        for delay in (0.0, 0.5):  # while Python starts, while it reads
            with subprocess.Popen(command, env=os.environ | {"TMPDIR": str(self.scratch)}) as run:
                self.child_of(run)
                time.sleep(delay)
                run.kill()
            end = time.monotonic() + 30
            while list(self.scratch.iterdir()) and time.monotonic() < end:
                time.sleep(0.05)
            self.assertEqual(list(self.scratch.iterdir()), [], delay)

    def child_of(self, run):
        end = time.monotonic() + 30
        while time.monotonic() < end:
            if children := pathlib.Path(f"/proc/{run.pid}/task/{run.pid}/children").read_text().split():
                return int(children[0])
            time.sleep(0.01)
        raise AssertionError("Python was not started")

    def test_without_the_packages_of_python_histories_are_replayed(self):
        (self.path / "h5py.py").write_text("raise ImportError('No module named h5py')")
        without = {"PYTHONPATH": str(self.path)}
        self.write(**velocity_history())
        run = self.run_replay(self.history, "--points", "--scene", GRADED, "--out", self.out, **without)
        self.assertEqual(run.returncode, 0, run.stderr)
        run = self.run_replay(self.history, "--dt", "5e-10", "--scene", GRADED, "--out", self.path / "result.csv", **without)
        self.assertEqual(run.returncode, 0, run.stderr)
        for code, words in ((1, (self.table, "--steps", "--scene", GRADED, "--out", self.out)), (2, ("compare", self.history, self.history))):
            run = self.run_replay(*words, **without)
            self.assertEqual(run.returncode, code)
            self.assertEqual(run.stderr.count("\n"), 1, run.stderr)
            self.assertIn("python3-h5py", run.stderr)

    def test_comparison_of_text_and_history(self):
        self.assertEqual(self.run_replay(self.table, "--steps", "--scene", GRADED, "--out", self.out).returncode, 0)
        text = self.path / "result.csv"
        self.assertEqual(self.run_replay(self.table, "--steps", "--scene", GRADED, "--out", text).returncode, 0)
        run = self.run_replay("compare", self.out, text)
        self.assertEqual((run.returncode, run.stdout[:26]), (0, "equal: 3 steps of 2 nodes,"), run.stdout + run.stderr)
        rows = text.read_text().splitlines()
        rows[3] = rows[3].replace("66.66", "66.67")
        text.write_text("\n".join(rows))
        run = self.run_replay("compare", self.out, text)
        self.assertEqual(run.returncode, 1)
        self.assertRegex(run.stdout, r"^step 1 \(ends at 2e-06 s\): velocity_jump of node 7 is 66\.66\d* in result.h5, 66\.67\d* in result.csv \(1 of 16 values")
        self.assertEqual(self.run_replay("compare", self.out, text, "--rtol", "1e-3").returncode, 0)
        run = self.run_replay("compare", self.out, text, "--rtol", "1e-9")
        self.assertRegex(run.stdout, r"(?m)^velocity_jump: 1 of 6 values differ; largest difference 0\.0\d* \(.* of the larger\), at node 7, step 1 \(ends at 2e-06 s\): ")
        self.assertIn("different within 1e-09: 3 steps of 2 nodes", run.stdout)
        text.write_text("\n".join(rows[:-2]))
        self.assertIn("result.h5 has 3 steps, result.csv has 2", self.run_replay("compare", self.out, text, "--rtol", "1").stdout)


if __name__ == "__main__":
    served.main()
