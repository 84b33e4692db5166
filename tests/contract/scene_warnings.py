#!/usr/bin/python3
"""Warnings about a scene reach the user of a host in every language on standard error, and of `shearbus-ctl check`; a sound scene draws none.

scene_warnings.py --endpoint ENDPOINT --ctl CTL --scene constant_friction.toml HOST..."""
import argparse
import os
import pathlib
import subprocess
import sys
import tempfile

WEAK = "the layer that flows should be the weaker body"
UNUSUAL = "interface.yield_strength_pa = 0.2 Pa is unusual: values from 1e5 to 5e10 Pa are expected. Is it in Pa?"


def said(command, endpoint, scene):
    environment = {**os.environ, "SHEARBUS_SCENE": str(scene), "SHEARBUS_ENDPOINT": endpoint}
    environment.pop("SHEARBUS_LOG", None)
    return subprocess.run([str(word) for word in command], capture_output=True, text=True, timeout=100, env=environment).stderr


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--endpoint", required=True)
    parser.add_argument("--ctl", required=True)
    parser.add_argument("--scene", type=pathlib.Path, required=True)
    parser.add_argument("hosts", nargs="+")
    options = parser.parse_args()
    sound = options.scene.read_text()
    swapped = sound.replace("[soft]", "[other]").replace("[hard]", "[soft]").replace("[other]", "[hard]")
    scenes = {"sound": (sound, None), "swapped": (swapped, WEAK), "unusual": (with_small_yield(sound), UNUSUAL)}
    wrong = []
    with tempfile.TemporaryDirectory(prefix="shearbus-") as scratch:
        for name, (text, expected) in scenes.items():
            scene = pathlib.Path(scratch) / f"{name}.toml"
            scene.write_text(text)
            for command in [[host] for host in options.hosts] + [[options.ctl, "check", scene]]:
                found = said(command, options.endpoint, scene)
                warnings = [line for line in found.splitlines() if "warning: " in line and "closure: " not in line]
                if (len(warnings) != 1 or expected not in warnings[0]) if expected else warnings:
                    wrong.append(f"{command[0]}, {name}: expected {expected}, found {found!r}")
    print("\n".join(wrong) if wrong else f"{len(options.hosts)} hosts and shearbus-ctl show the warnings about a scene")
    return bool(wrong)


def with_small_yield(text):
    lines = ["yield_strength_pa = 0.2" if line.startswith("yield_strength_pa") else line for line in text.splitlines()]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.exit(main())
