#!/usr/bin/python3
"""Warnings about a scene reach the user of a host in every language on standard error, and of `shearbus-ctl check`; a sound scene draws none.

scene_warnings.py --endpoint ENDPOINT --ctl CTL --scene constant_friction.toml --hosts HOST..."""
import argparse
import os
import pathlib
import subprocess
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import OPTIONS

WEAK = "the layer that flows should be the weaker body"
UNUSUAL = "interface.yield_strength_pa = 0.2 Pa is unusual: values from 1e5 to 5e10 Pa are expected. Is it in Pa?"


class SceneWarnings(served.Served):
    def test_every_host_shows_the_warnings_about_a_scene(self):
        sound = OPTIONS.scene.read_text()
        swapped = sound.replace("[soft]", "[other]").replace("[hard]", "[soft]").replace("[other]", "[hard]")
        unusual = served.edited(OPTIONS.scene, self.path / "unusual", yield_strength_pa=0.2).read_text()
        environment = {name: value for name, value in os.environ.items() if name != "SHEARBUS_LOG"}
        for text, expected in ((sound, None), (swapped, WEAK), (unusual, UNUSUAL)):
            scene = self.path / "scene.toml"
            scene.write_text(text)
            for command in [[host] for host in OPTIONS.hosts] + [[OPTIONS.ctl, "check", scene]]:
                with self.subTest(command, expected=expected):
                    said = subprocess.run(command, capture_output=True, text=True, timeout=100,
                                          env={**environment, "SHEARBUS_SCENE": str(scene), "SHEARBUS_ENDPOINT": OPTIONS.endpoint}).stderr
                    warnings = [line for line in said.splitlines() if "warning: " in line and "closure: " not in line]
                    self.assertEqual(len(warnings), bool(expected), said)
                    self.assertTrue(all(expected in warning for warning in warnings), said)


if __name__ == "__main__":
    parser = argparse.ArgumentParser()
    parser.add_argument("--scene", type=pathlib.Path, required=True)
    parser.add_argument("--hosts", nargs="+", required=True)
    served.main("endpoint", "ctl", parser=parser)
