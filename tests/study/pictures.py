"""What the pictures of the studies share: how they are called, and how they are kept small."""
import argparse
import json
import pathlib

from PIL import Image


def arguments(description):
    """The study as its JSON file holds it, and where its picture goes: beside that file unless --out says otherwise."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("study", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path)
    options = parser.parse_args()
    return json.loads(options.study.read_text()), options.out or options.study.with_suffix(".png")


def save_small(figure, out):
    figure.savefig(out, dpi=110)
    Image.open(out).convert("P", palette=Image.Palette.ADAPTIVE, colors=48).save(out, optimize=True)  # a third of the size
    print(f"written: {out}")
