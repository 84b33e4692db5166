"""Common parts of the studies' pictures: the command line, and small files."""
import argparse
import json
import pathlib

from PIL import Image


def arguments(description):
    """Returns the study from its JSON file, and the path of its picture: next to that file unless --out names another."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("study", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path)
    options = parser.parse_args()
    return json.loads(options.study.read_text()), options.out or options.study.with_suffix(".png")


def save_small(figure, out):
    figure.savefig(out, dpi=110)
    Image.open(out).convert("P", palette=Image.Palette.ADAPTIVE, colors=48).save(out, optimize=True)  # a third of the size
    print(f"written: {out}")
