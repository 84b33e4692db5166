"""Tests of tests/validation/paper_figures.py: some figures from coarse runs, their sentences, and what is refused."""
import json
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import OPTIONS, SOURCE


class PaperFigures(served.Served):
    def program(self, *arguments, code=0):
        program = SOURCE / "tests/validation/paper_figures.py"
        return self.run_program(sys.executable, "-B", program, "-o", self.path, "--bin", f"{OPTIONS.build}/bin", *arguments, code=code)

    def figures(self, only):
        done = self.program("--coarse", "--only", only)
        return {entry["figure"]: entry for entry in json.loads((self.path / "figures.json").read_text(encoding="utf-8"))}, done.stdout

    def test_figures_have_a_picture_and_sentences_with_numbers(self):
        figures, printed = self.figures("12,14,18")
        self.assertEqual(list(figures), [12, 14, 18])
        for number, entry in figures.items():
            self.assertEqual(set(entry), {"figure", "title", "file", "scene", "agrees", "differs", "note"})
            self.assertEqual((self.path / entry["file"]).read_bytes()[:4], b"\x89PNG")
            self.assertIn(entry["title"], printed)
            self.assertTrue(any(letter.isdigit() for letter in " ".join(entry["agrees"])), number)
        agrees = {number: " ".join(entry["agrees"]) for number, entry in figures.items()}
        self.assertIn("No vertex is loaded beyond its flow stress", agrees[12])
        self.assertIn("peaks at 293.4 MPa after 0.28 \u00b5s and has fallen to 142.6 MPa", agrees[14])
        self.assertIn("Mainly Coulomb, measured by slip", agrees[18])
        self.assertIn("Only with (14) as it is printed", " ".join(figures[18]["differs"]))
        again, printed = self.figures("18")
        self.assertEqual(list(again), [18])
        self.assertNotIn("run cone", printed, "a run of the same inputs is used again")
        self.assertEqual(again[18], figures[18])

    def test_the_order_of_the_laws_is_told_of_two_meshes_and_of_every_cone(self):
        figures, _ = self.figures("21,22")
        agrees, differs = (" ".join(figures[21][kind]) for kind in ("agrees", "differs"))
        self.assertIn("Less sliding with the subgrid model, as displacement of the metal", agrees)
        self.assertRegex(agrees, r"metal against metal over \+-1 mm \S+ mm with law \(5\), \S+ mm with the subgrid model \(-\d+ %, on zones twice as wide -\d+ %\)")
        self.assertIn("cone_al5083_steel: metal against metal", differs)
        self.assertIn("Its interface is weaker than the metal beside it", differs)
        self.assertRegex(" ".join(figures[22]["agrees"]), r"impulse of s x 1\.\d+, on zones twice as wide x 1\.\d+")

    def test_what_is_no_figure_and_what_is_missing_are_refused(self):
        self.assertIn("expected numbers from 12 to 22", self.program("--only", "11", code=2).stderr)
        self.assertIn("shearbus-replay is missing", self.program("--only", "12", "--bin", self.path, code=1).stderr)


if __name__ == "__main__":
    served.main()
