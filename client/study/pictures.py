"""Common parts of the studies' pictures: the command line, the look (client/report/style.py) and the footer."""
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[2] / "client/report"))
import style  # noqa: E402
from terminal import Parser, read_json  # noqa: E402


def arguments(description):
    """Returns the study from its JSON file, and the path of its picture: next to that file unless --out names
    another."""
    parser = Parser(description=description)
    parser.add_argument("study", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path)
    options = parser.parse_args()
    return read_json(options.study), options.out or options.study.with_suffix(".png")


def save(figure, out, study):
    """Writes a picture with the study's provenance as footer."""
    made = study["provenance"]
    known = {**made, "scene": pathlib.Path(made["scene"]).stem, "program": f"shearbus-study {study['study']}", "machine": study["processor"]}
    style.save(figure, out, [known], colours=128)
    print(f"written: {out}")
