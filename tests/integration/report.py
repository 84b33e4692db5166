"""shearbus-report on runs that the test makes: what is in the page, that its HTML is valid, and, in a browser without
a screen, that nothing overflows, overlaps or is missing at the width of a phone and of a desk, light and dark. Where
Chromium is missing, only its part is skipped."""
import argparse
import contextlib
import io
import json
import os
import pathlib
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest

import h5py
import numpy as np

sys.path[:0] = [str(pathlib.Path(__file__).resolve().parents[2] / room) for room in ("client/report", "tests/support")]
import browser as browsers  # noqa: E402
import plot_cone  # noqa: E402
import plot_histories  # noqa: E402
import report as report_program  # noqa: E402
import runs  # noqa: E402
import served  # noqa: E402
import style  # noqa: E402
from findings import number  # noqa: E402
from served import OPTIONS, SOURCE  # noqa: E402

LARGEST = 3_000_000  # bytes of a report
# Returns the faults of a page: what is wider than the screen, pictures that are missing, texts that lie upon each
# other.
FAULTS = r"""
(() => {
  const faults = [];
  for (const e of document.querySelectorAll("details")) e.open = true;
  const width = document.documentElement.clientWidth;
  if (document.documentElement.scrollWidth > width) {
    const wide = [...document.querySelectorAll("body *")].filter(e => e.getBoundingClientRect().right > width + 1);
    faults.push("overflows to " + document.documentElement.scrollWidth + ": " + wide.slice(0, 3).map(e => e.outerHTML.slice(0, 80)).join(" | "));
  }
  // No part of the page may scroll sideways.
  for (const e of document.querySelectorAll("body *"))
    if (e.scrollWidth > e.clientWidth + 1 && ["auto", "scroll"].includes(getComputedStyle(e).overflowX)) faults.push("scrolls sideways: " + e.outerHTML.slice(0, 80));
  // In the dark no picture stands in a white box.
  if (matchMedia("(prefers-color-scheme: dark)").matches) for (const e of document.querySelectorAll("svg path, svg rect"))
    if (getComputedStyle(e).fill === "rgb(255, 255, 255)" && e.getBoundingClientRect().width > 0.4 * e.ownerSVGElement.getBoundingClientRect().width)
      faults.push("white box: " + e.ownerSVGElement.getAttribute("aria-label"));
  const rows = {};  // how far the pictures of each row of the maps reach, as a share of the width
  for (const e of document.querySelectorAll(".group svg")) {
    const area = e.closest(".groups").getBoundingClientRect(), r = e.closest(".group").getBoundingClientRect();
    rows[Math.round(r.top)] = Math.max(rows[Math.round(r.top)] || 0, (e.getBoundingClientRect().right - area.left) / area.width);
  }
  for (const image of document.images) if (!(image.complete && image.naturalWidth > 0)) faults.push("image is missing: " + image.alt);
  const texts = [];
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node; (node = walker.nextNode());) {
    if (!node.data.trim() || node.parentElement.closest("details:not([open]) > :not(summary)")) continue;
    const range = document.createRange();
    range.selectNodeContents(node);
    for (const r of range.getClientRects()) if (r.width > 1 && r.height > 1 && getComputedStyle(node.parentElement).visibility === "visible")
      texts.push({r, text: node.data.trim(), parent: node.parentElement, clip: node.parentElement.closest("pre")});
  }
  for (let i = 0; i < texts.length; ++i) for (let j = i + 1; j < texts.length; ++j) {
    const a = texts[i], b = texts[j];
    if (a.parent === b.parent || a.clip !== b.clip && (a.clip || b.clip)) continue;
    const w = Math.min(a.r.right, b.r.right) - Math.max(a.r.left, b.r.left), h = Math.min(a.r.bottom, b.r.bottom) - Math.max(a.r.top, b.r.top);
    if (w > 1.5 && h > 0.35 * Math.min(a.r.height, b.r.height)) faults.push("texts overlap: " + a.text.slice(0, 40) + " / " + b.text.slice(0, 40));
  }
  return {faults, paper: getComputedStyle(document.body).backgroundColor, height: document.documentElement.scrollHeight, texts: texts.length, rows: Object.values(rows)};
})()
"""


def run(*words, code=0):
    done = subprocess.run([str(word) for word in words], capture_output=True, text=True, timeout=250)
    assert done.returncode == code, f"{words}: {done.returncode}\n{done.stdout}{done.stderr}"
    return done


class Report(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        cls.path = path = pathlib.Path(cls.scratch.name)
        problems = SOURCE / "hydro_stub/problems"
        served.edited(problems / "cone_al_steel_coarse.toml", path / "cone.toml", zone_width_m="1.25e-3\nframes = 6", end_time_s=5e-6)
        cls.cones = [path / law for law in ("subgrid", "coulomb_tresca")]
        for out in cls.cones:
            run(OPTIONS.hydro, path / "cone.toml", "--interface-law", out.name, "--out", out, "--no-plot", "--no-progress")
        cls.column = path / "column"
        run(OPTIONS.hydro, problems / "sliding_to_a_stop.toml", "--out", cls.column, "--no-plot", "--no-progress")
        run("/usr/bin/python3", SOURCE / "client/examples/make_history.py", "ramp", path / "history.h5", "--steps", 200)
        cls.result = path / "result.h5"
        run(OPTIONS.replay, path / "history.h5", "--scene", SOURCE / "client/examples/paper_velocity_driven.toml", "--out", cls.result)
        with h5py.File(cls.result, "a") as file:  # profiles of a node, as a run keeps them
            file["profiles/time"], file["profiles/node_id"] = file["time"][[50, 150]], file["node_id"][-1:]
            file["profiles/position"], file["profiles/layer_temperature"] = [-1e-6, 0.0, 1e-6], [[[300.0, 600.0, 400.0]], [[310.0, 700.0, 500.0]]]
            count = len(file["node_id"])
            file["pair"], file["parameter/interface.friction_coefficient"] = [""] * (count - 1) + ["brass"], np.linspace(0.1, 0.3, count)
        cls.reports = {}
        for name, words in {"cone": [*cls.cones, "--figures", cls.paper()], "one": cls.cones[:1], "column": [cls.column], "replay": [cls.result]}.items():
            cls.reports[name] = path / f"{name}.html"
            if name == "replay":
                run(OPTIONS.report, *words, "-o", cls.reports[name])
            else:
                assert cls.program(*words, "-o", cls.reports[name]) == 0

    @classmethod
    def tearDownClass(cls):
        cls.scratch.cleanup()

    @classmethod
    def paper(cls):
        """Returns a directory with figures of the paper."""
        directory = cls.path / "figures"
        figure, axis = style.figure(1, 1, (6, 3))
        axis.plot([0, 1])
        style.save(figure, directory / "figure_12.png", [])
        (directory / "figures.json").write_text(json.dumps([{"figure": "12", "title": "profiles", "file": "figure_12.png", "agrees": ["It falls."], "differs": "By a fifth.", "note": "A quick look."}] * 2))
        return directory

    def test_the_free_surface_begins_on_the_axis(self):
        with h5py.File(self.cones[0] / "free_surface.h5") as file:
            on_axis = file["axial_velocity"][:, int(file["radius"][0].argmin())]
            self.assertGreater(file["radius"][0, 0], file["radius"][0, -1], "the file follows the surface, from the rim")
        np.testing.assert_array_equal(runs.Run(self.cones[0]).surface[1][:, 0], on_axis)

    def test_a_footer_has_scene_program_version_commit_and_date(self):
        for path in (self.cones[0], self.column, self.result):
            block = runs.Run(path).provenance
            facts = [block[fact] for fact in ("scene", "program", "version", "commit")] + [block["date"][:10]]
            self.assertNotIn("", facts)
            for fact in facts:
                self.assertIn(fact, style.provenance_text(block))

    def test_an_open_contact_does_not_look_like_zero(self):
        zero = style.plt.colormaps[style.COLOUR_MAPS["signed"]](0.5)
        self.assertGreater(min(zero[:3]), 0.1 + int(style.OPEN[1:3], 16) / 255)

    def test_the_page_says_what_the_run_found(self):
        page = self.reports["cone"].read_text()
        summary = json.loads((self.cones[0] / "summary.json").read_text())
        for text in ("cone_al_steel_coarse", "Coulomb–Tresca (DLP 5)", f"{summary['peak_interface_temperature_k']:,.0f}", f"{summary['friction_heat_j']:.1f}",
                     "energy closed to", "aluminium_dlp: DLP tables", "Selected nodes", "hottest", "left out", "Figure 12: profiles", "It falls.", "By a fifth.", "[hydro.cone_target]"):
            self.assertTrue(text in page, text)
        self.assertEqual(page.count("A quick look."), 1, "the note of two figures")
        column = self.reports["column"].read_text()
        work = json.loads((self.column / "summary.json").read_text())
        for text in ("sliding_to_a_stop", "solver of the layers", f"{work['friction_work_j_per_m2'] / work['columns']:,.0f}"):
            self.assertTrue(text in column, text)
        layer = summary["layer_energy"]
        residual = layer["energy_residual_j_per_m2"] / layer["interface_work_j_per_m2"]
        self.assertGreater(abs(residual), 1e-12)
        self.assertRegex(page, rf"<td>work of the interface stress</td><td>{residual:.1e}</td>")
        self.assertTrue("more than rounding" in page and "more than rounding" not in column)
        replay = self.reports["replay"].read_text()
        self.assertTrue("velocity_driven" in replay)
        self.assertTrue("temperature across the layer of the node" in replay)
        self.assertTrue("1 of [pair.brass]" in replay and "0.100 to 0.300" in replay)
        self.assertFalse("kept no profiles" in replay)
        self.assertTrue("kept no profiles" in column)

    def test_a_run_without_an_interface_has_a_report(self):
        run(OPTIONS.hydro, SOURCE / "hydro_stub/problems/verification/patch_test.toml", "--out", self.path / "patch", "--no-plot", "--no-progress")
        self.assertEqual(self.program(self.path / "patch", "-o", self.path / "patch.html"), 0)

    def test_runs_of_one_law_are_told_apart_by_label_and_colour(self):
        others = []
        for value in ("100e6", "200e6"):
            others.append(self.path / f"result-{value}.h5")
            run(OPTIONS.replay, self.path / "history.h5", "--scene", SOURCE / "client/examples/paper_velocity_driven.toml", "--set", f"soft.yield_strength_pa={value}", "--out", others[-1])
        copy = self.path / "copy.h5"
        shutil.copy(others[0], copy)
        for paths, labels in ((others, ["soft.yield_strength_pa = 1e+08", "soft.yield_strength_pa = 2e+08"]), ([self.column, self.result], ["sliding_to_a_stop", "paper_velocity_driven"]),
                              ([others[0], copy], ["result-100e6", "copy"]), (self.cones, ["subgrid server", "Coulomb–Tresca (DLP 5)"])):
            found = runs.read(paths)
            self.assertEqual([one.label for one in found], labels)
            self.assertEqual(len({one.colour for one in found}), len(found))
        self.assertEqual(self.program(*others, "-o", self.path / "two.html"), 0)
        page = self.reports["two"] = self.path / "two.html"
        for label in ("soft.yield_strength_pa = 1e+08", "soft.yield_strength_pa = 2e+08"):
            self.assertIn(f"<strong>{label}</strong>", page.read_text())
        for value in ("100e6", "200e6"):  # a what-if does not pass for the original
            self.assertIn(f"paper_velocity_driven with soft.yield_strength_pa={value}", re.search("<h1>(.*?)</h1>", page.read_text())[1])
        # Runs that end at other times are drawn to their own ends.
        figure, _ = plot_histories.histories(runs.read([self.column, others[0]]))
        ends = [axis.get_xlim()[1] for axis in figure.axes[:2]]
        plot_histories.plt.close(figure)
        self.assertEqual(ends, [runs.Run(path).time[-1] for path in (self.column, others[0])])
        # Drawn over each other they are another picture than either of them.
        pictures = []
        for i, files in enumerate(([others[0]], [others[1]], others, [*others, self.path / "history.h5"])):
            run(OPTIONS.replay, "plot", *files, "--out", self.path / f"{i}.png")
            pictures.append((self.path / f"{i}.png").read_bytes())
        self.assertEqual(len(set(pictures[:3])), 3)
        (self.path / "exp.csv").write_text("time [us],pressure [GPa]\n1,2\n")
        for wrong, text in ((self.path / "exp.csv", "exp.csv: expected a result or a history in HDF5"), (self.path / "gone.h5", "gone.h5: cannot be opened: No such file or directory")):
            done = subprocess.run([OPTIONS.replay, "plot", others[0], wrong, "--out", self.path / "no.png"], capture_output=True, text=True, timeout=200)
            self.assertEqual(done.returncode, 1)
            self.assertIn(text, done.stderr)
            self.assertNotIn("Traceback", done.stderr)

    def test_the_head_says_in_words_what_was_found(self):
        found = []
        for cone in self.cones:
            summary = json.loads((cone / "summary.json").read_text())
            found.append((next(band["mean_m"] for band in summary["displacement"] if band["band_m"] == 1e-3), summary["peak_interface_temperature_k"]))
        verdict = re.search(r'<p class="verdict">(.*?)</p>', self.reports["cone"].read_text())[1]
        self.assertIn(f"subgrid server: metal moved {number(1e3 * found[0][0])} mm against metal", verdict)
        self.assertIn(f"the interface reached {number(found[0][1], 4)} K", verdict)
        compared = re.search(r"Coulomb–Tresca \(DLP 5\): ([\d.]+) % (farther|less far), and ([\d.]+) K\.$", verdict)
        self.assertIsNotNone(compared, verdict)
        self.assertAlmostEqual(float(compared[1]) * (1 if compared[2] == "farther" else -1), 100 * (found[1][0] / found[0][0] - 1), delta=0.5)
        self.assertEqual(compared[3], number(found[1][1], 4))
        for name, text in (("one", "Metal moved"), ("column", "The interface slid"), ("replay", "The interface slid")):
            self.assertRegex(self.reports[name].read_text(), rf'<p class="verdict">{text} [\d.e-]+ mm')

    def test_the_case_names_the_flyer_and_the_cards_agree_with_the_bars(self):
        page, summary = self.reports["cone"].read_text(), json.loads((self.cones[0] / "summary.json").read_text())
        self.assertIn("<td>flyer</td><td>400 m/s, steel_dlp</td>", page)
        self.assertIn("<td>cone</td><td>aluminium_dlp</td>", page)
        share = 100 * summary["waiting_share"]
        self.assertRegex(page, rf"waiting for answers</div><div class=\"big\">{share:.3g}")
        self.assertIn(f"({share:.1f} %)", page.split("waiting for answers: ")[1].split("<")[0])

    def test_files_of_a_run_are_links(self):
        targets = [name for name in re.findall(r'<td><a href="([^"]+)">', self.reports["cone"].read_text()) if not name.startswith("#")]
        self.assertIn("subgrid/interface.h5", targets)
        for name in targets:
            self.assertTrue((self.reports["cone"].parent / name).is_file(), name)

    def test_nothing_slides_on_an_open_contact(self):
        found = runs.Run(self.result)
        is_open = found["regime"] == 0
        self.assertTrue(is_open.any() and (np.abs(found["sliding_velocity"][is_open]) > 1.0).any())  # the answer is a velocity there, too
        self.assertTrue(np.isnan(found.drawn("sliding_velocity")[is_open]).all())
        self.assertTrue(np.isfinite(found.drawn("sliding_velocity")[~is_open]).all())

    def test_leaders_cross_no_label_and_legends_have_no_lonely_row(self):
        figure, axis = style.figure(1, 1, (5.5, 4.2), legend=True)
        heights = {"free slip": 552.0, "Coulomb–Tresca (DLP 5)": 550.0, "subgrid server": 548.0, "stick": 400.0}
        for height in heights.values():
            axis.plot([0, 1], [0, height])
        axis.set_xlim(0, 1)
        style.legend_below(figure, 2 * style.regime_handles(range(4)))
        figure.canvas.draw()
        (legend,) = figure.legends
        self.assertEqual(legend._ncols, 4, "eight entries are too wide for one row, and stand in two equal ones")
        self.assertTrue(0 < legend.get_window_extent().x0 and legend.get_window_extent().x1 < figure.bbox.x1)
        style.label_ends(axis, [(1.0, height, label, style.INK) for label, height in heights.items()])
        figure.canvas.draw()
        left = min(style.plt.Text.get_window_extent(text).x0 for text in axis.texts)  # of an annotation it has the leader, too
        for text in axis.texts:
            leader = text.arrow_patch.get_path().transformed(text.arrow_patch.get_transform()).vertices
            self.assertLessEqual(leader[:, 0].max(), left)
        style.plt.close(figure)
        self.assertNotEqual(plot_cone.ISOLINES, plot_cone.FRONT["color"])

    def test_the_scale_of_a_map_shows_every_value_and_lines_stand_at_theirs(self):
        found = [runs.Run(cone) for cone in self.cones]
        for name in plot_cone.MAPS[1:]:
            _, span, extend = plot_cone.map_scale(found, name)
            values = [plot_cone.shown(run, name) for run in found]
            self.assertEqual(extend, "neither", name)
            self.assertEqual(max(abs(span["vmin"]) if span["vmin"] < 0 else 0.0, span["vmax"]), max(max(abs(v.min()), v.max()) for v in values), name)
        figure = plot_cone.space_time(found, "interface_temperature")
        hottest = max(run["interface_temperature"].max() for run in found)
        levels = [level for level in plot_cone.LEVELS if level < hottest]
        self.assertGreater(len(levels), 1)
        drawn = {at for line in figure.axes[-1].collections for path in getattr(line, "get_segments", list)() for at in path[:, 1]}
        self.assertEqual({round(at) for at in drawn if min(abs(at - level) for level in levels) < 1.0}, set(levels))
        style.plt.close(figure)
        self.assertIn(f"Thin lines: {', '.join(map(str, levels))} K.", self.reports["cone"].read_text())

    def test_an_interrupt_gets_one_line(self):
        for command in ([OPTIONS.report, *self.cones, "-o", self.path / "no.html"], [sys.executable, SOURCE / "client/report/plot_cone.py", *self.cones, "--out", self.path / "no"]):
            for library, delay in (("multiarray", 0.1), ("ft2font", 0.4)):  # while libraries load, while it works
                # A test in the background inherits that interrupts are ignored.
                with subprocess.Popen(list(map(str, command)), stderr=subprocess.PIPE, text=True, preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler)) as program:
                    maps = pathlib.Path(f"/proc/{program.pid}/maps")
                    served.until(self, lambda: library in maps.read_text(), program)
                    time.sleep(delay)
                    program.send_signal(signal.SIGINT)
                    said = program.communicate(timeout=60)[1]
                self.assertEqual((program.returncode, said.count("\n")), (-signal.SIGINT, 1), said)
                self.assertTrue(said.endswith(": interrupted\n"), said)
        self.assertEqual(list(self.path.glob("no.html*")), [])

    def test_an_interrupt_where_python_ignores_exceptions_is_not_lost(self):
        lines = ["import os, signal, terminal, time", "class Gone:", " def __del__(self): os.kill(os.getpid(), signal.SIGINT)",
                 "signal.signal(signal.SIGINT, signal.default_int_handler)", "terminal.Parser()", "Gone()", "time.sleep(60)"]
        done = subprocess.run([sys.executable, "-B", "-c", "\n".join(lines)], cwd=SOURCE / "client/report", stderr=subprocess.PIPE, text=True, timeout=50)
        self.assertEqual((done.returncode, done.stderr), (-signal.SIGINT, "-c: interrupted\n"))

    def test_a_section_without_content_is_left_out(self):
        for name, left_out in (("cone", []), ("column", ["paper"]), ("replay", ["paper", "ledger"])):
            page = self.reports[name].read_text()
            for section in ("case", "fields", "nodes", "ledger", "cost", "paper", "scene"):
                for part in (f'id="{section}"', f'href="#{section}"'):
                    self.assertEqual(part in page, section not in left_out, (name, part))
            bodies = re.findall(r"<h2[^>]*>.*?</h2>(.*?)</section>", page, re.S)
            self.assertEqual(len(bodies), 7 - len(left_out))
            for body in bodies:
                self.assertGreater(len(re.sub(r"<[^>]*>|\s", "", body)), 40, (name, body[:200]))

    def test_the_page_is_one_file_without_network_or_script(self):
        for report in self.reports.values():
            page = re.sub(r'<td><a href="[^":]+">', "", report.read_text())  # the files of the run, which a reader may open
            self.assertLess(len(page), LARGEST)
            self.assertNotRegex(page, r"(?i)<script|<link|@import|\son\w+=")
            self.assertEqual([found for found in re.findall(r"""(?:src|href|url\()=?["'(]?([^"')\s>]+)""", page) if not found.startswith(("#", "data:image/"))], [])
            ids = re.findall(r'\bid="([^"]+)"', page)
            self.assertEqual(len(ids), len(set(ids)), "an id is there twice")

    def test_html_is_valid(self):
        try:
            import html5lib
        except ImportError:
            self.skipTest("python3-html5lib is missing")
        for report in self.reports.values():
            parser = html5lib.HTMLParser(strict=False)
            parser.parse(report.read_text())
            self.assertEqual([(place, code) for place, code, _ in parser.errors], [])
        parser.parse("<!DOCTYPE html><title>x</title><p><b>unclosed</p>")
        self.assertNotEqual(parser.errors, [])

    def test_layout_in_a_browser(self):
        if not browsers.CHROMIUM.exists():
            self.skipTest("chromium is missing")
        browser = browsers.Browser(self.path / "profile")
        look = lambda url, width, theme: (browser.resize(width, theme), browser.open(url), browser.value(FAULTS))[-1]
        try:
            for name, report in self.reports.items():
                for width, theme in ((360, "light"), (360, "dark"), (1400, "light"), (1400, "dark")):
                    if name == "one" and (width, theme) != (1400, "dark") and not OPTIONS.screenshots:
                        continue
                    if name in ("column", "replay") and (width < 1000) != (theme == "light") and not OPTIONS.screenshots:
                        continue
                    found = look(report.as_uri(), width, theme)
                    self.assertEqual(found["faults"], [], f"{name} at {width} pixels, {theme}")
                    self.assertGreater(found["texts"], 50)
                    if name in ("cone", "one"):  # the maps fill the page, of one run and of two
                        self.assertGreater(min(found["rows"]), 0.85, f"{name} at {width} pixels: {found['rows']}")
                    self.assertEqual(found["paper"], {"light": "rgb(255, 255, 255)", "dark": "rgb(22, 24, 27)"}[theme])
                    if OPTIONS.screenshots:
                        OPTIONS.screenshots.mkdir(parents=True, exist_ok=True)
                        browser.screenshot(OPTIONS.screenshots / f"{name}-{width}-{theme}.png", width, min(found["height"], 16000))
            # The check itself notices a page with each fault.
            (self.path / "bad.html").write_text('<!DOCTYPE html><body style="margin:0"><svg width="100" height="50"><rect width="90" height="40" fill="#ffffff"/></svg>'
                                                '<p style="width:100px;overflow-x:auto;white-space:nowrap">a line that is far too long</p><div style="width:2000px">wide</div><img src="gone.png" alt="gone">'
                                                '<p style="position:absolute;top:50px">one text</p><p style="position:absolute;top:52px">other text</p>')
            faults = " ".join(look((self.path / "bad.html").as_uri(), 360, "dark")["faults"])
            for fault in ("overflows to", "scrolls sideways: <p", "white box", "image is missing: gone", "texts overlap"):
                self.assertIn(fault, faults)
        finally:
            browser.close()

    def test_bad_input_gets_one_line_and_leaves_no_file(self):
        empty, broken = self.path / "empty", self.path / "broken"
        empty.mkdir()
        shutil.copytree(self.cones[0], broken)
        (broken / "interface.h5").write_bytes((broken / "interface.h5").read_bytes()[:3000])
        bad_summary = self.path / "bad_summary"
        shutil.copytree(self.column, bad_summary)
        (bad_summary / "summary.json").write_text("{")
        deep, elsewhere, piped = self.path / "deep", self.path / "elsewhere", self.path / "piped"
        shutil.copytree(self.column, deep)
        (deep / "summary.json").write_text("[" * 100_000)
        for figures, file in ((elsewhere, self.column / "x.png"), (piped, "pipe.png")):
            figures.mkdir()
            (figures / "figures.json").write_text(json.dumps([{"figure": "12", "title": "t", "file": str(file)}]))
        os.mkfifo(piped / "pipe.png")
        pipe = self.path / "pipe"
        pipe.mkdir()
        os.mkfifo(pipe / "figures.json")
        both, laws, surfaces = (self.path / name for name in ("both", "laws", "surfaces"))
        for made, file in ((both, self.column / "history.h5"), (laws, self.cones[1] / "summary.json"), (surfaces, self.cones[1] / "free_surface.h5")):
            shutil.copytree(self.cones[0], made)
            shutil.copy(file, made)
        out = self.path / "no.html"
        damaged = self.path / "damaged.h5"
        with h5py.File(damaged, "w") as file:
            file["time"], file["node_id"] = [1e-9], [1]
            for name in ("interface_temperature", "shear_stress", "sliding_velocity"):
                file[name] = [[1.0]]
            meta = file.create_group("meta")
            meta.attrs["scene_name"], meta.attrs["producer"] = "abc", "def"
        content = bytearray(damaged.read_bytes())
        content[content.index(b"GCOL") + 50] ^= 0xff  # of the size of the second text
        damaged.write_bytes(content)
        for words, text in (([damaged], "HDF5 does not survive its texts"), ([self.path / "gone"], "no such run"), ([empty], "neither fields.xmf nor history.h5"), ([self.path / "cone.toml"], "cannot be read"),
                           ([self.path / "history.h5"], "no dataset"), ([broken], "interface.h5"), ([both], "found fields.xmf and history.h5"),
                           ([laws], "found another interface_law in interface.h5 than in summary.json: subgrid and coulomb_tresca"), ([surfaces], "in interface.h5 than in free_surface.h5"), ([bad_summary], "summary.json"), ([deep], "nested too deep"),
                           ([self.column, "--figures", elsewhere], "in the same directory"), ([self.column, "--figures", piped], "in the same directory"),
                           ([self.column, "--figures", pipe], "no regular file"),
                           ([self.column, "--figures", empty], "figures.json")):
            said = self.refused(*words, "-o", out)
            self.assertIn(text, said)
            self.assertEqual(said.count("\n"), 1, said)
            self.assertTrue(said.startswith("shearbus-report: "))
        self.assertEqual(list(self.path.glob("no.html*")), [])
        self.assertIn("gone", self.refused(self.column, "-o", empty / "gone" / "x.html"))
        run(OPTIONS.report, self.path / "gone", "-o", out, code=1)
        run(OPTIONS.report, code=2)

    def test_a_run_that_was_stopped_is_incomplete(self):
        stopped = self.path / "stopped"
        shutil.copytree(self.cones[0], stopped, ignore=shutil.ignore_patterns("*.json", "interface.h5", "free_surface.h5"))
        self.assertEqual(self.program(stopped, "-o", self.path / "stopped.html"), 0)
        page = (self.path / "stopped.html").read_text()
        for text in ("incomplete: the run did not reach its end", "last state written"):
            self.assertIn(text, page)
            self.assertNotIn(text, self.reports["one"].read_text() + self.reports["replay"].read_text())

    def test_each_kind_of_run_has_its_pictures(self):
        for program, run, other in ((plot_cone, self.column, "plot_histories.py"), (plot_histories, self.cones[0], "plot_cone.py")):
            words, sys.argv = sys.argv, ["plot", str(run), "--out", str(self.path / "none")]
            try:
                with self.assertRaisesRegex(program.Fault, f"{run}: expected a run .*, which {other} draws"):
                    program.main()
            finally:
                sys.argv = words
        self.assertFalse((self.path / "none").exists())

    def test_an_output_that_nobody_reads_gets_one_line(self):
        plot = [sys.executable, SOURCE / "client/report/plot_histories.py"]
        for command in ([OPTIONS.report, "--help"], [OPTIONS.report, "--version"], [*plot, "--help"], [OPTIONS.report, self.column, "-o", self.path / "told.html"],
                        [*plot, self.column, "--out", self.path / "told"]):
            read, write = os.pipe()
            os.close(read)
            for out in (write, os.open("/dev/full", os.O_WRONLY)):
                done = subprocess.run(list(map(str, command)), stdout=out, stderr=subprocess.PIPE, text=True, timeout=100)
                os.close(out)
                self.assertEqual((done.returncode, done.stderr.count("\n")), (1, 1), done.stderr)
                self.assertIn(": standard output could not be written: ", done.stderr)

    def test_a_report_without_a_name_is_put_into_its_first_run(self):
        run(OPTIONS.report, self.column)
        (self.column / "report.html").unlink()  # fails if it is not there

    @classmethod
    def program(cls, *words):
        """Runs the program in this process, because most of its time is that of imports. Returns its exit code."""
        words, sys.argv = sys.argv, ["shearbus-report", *map(str, words)]
        try:
            with contextlib.redirect_stdout(io.StringIO()):
                return report_program.main("0", OPTIONS.report.parent)
        finally:
            sys.argv = words

    def refused(self, *words):
        """Returns what the program says to a command line that it must refuse."""
        with contextlib.redirect_stderr(io.StringIO()) as said:
            self.assertEqual(self.program(*words), 1)
        return said.getvalue()


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--screenshots", type=pathlib.Path, help="directory that keeps the pictures of the pages")
    served.main(parser=parser)
