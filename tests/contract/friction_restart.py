#!/usr/bin/python3
"""The templates of vendors' friction routines across a restart of their host: the host that dies after a restart file and goes on in another
process has the bits of the whole run; without the ticket, with one of another time, or without a server of its own it stops or says so.
friction_restart.py --program CALLER --scene SCENE.toml --kind exact|heat --endpoint ENDPOINT"""
import os
import pathlib
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import OPTIONS


class FrictionRestart(served.Served):
    def host(self, *part, code=0, said="", endpoint=None, **environment):
        """Runs the host. Returns its lines about nodes."""
        environment |= {"SHEARBUS_SCENE": OPTIONS.scene, "SHEARBUS_ENDPOINT": OPTIONS.endpoint if endpoint is None else endpoint}
        done = self.run_program(OPTIONS.program, OPTIONS.scene, OPTIONS.kind, *part, code=code, cwd=self.path, timeout=60,
                                env={**os.environ, **environment})
        self.assertIn(said, done.stderr)
        return [line for line in done.stdout.splitlines() if line.startswith("node")]

    def tickets(self):
        return sorted(self.path.glob("*.shearbus"))

    def test_the_layers_go_on_with_their_host(self):
        whole = self.host()
        self.assertEqual(len(whole), 2)
        for file in self.tickets():
            file.unlink()
        self.host("first")
        kept = {file: file.read_text() for file in self.tickets()}
        self.assertEqual((len(kept), list(self.path.glob("*.new"))), (2, []))
        self.assertFalse([file for file in kept if file.stat().st_mode & 0o077], "tickets are for their owner alone")
        self.assertEqual(self.host("second", said="the layers go on from t4.55"), whole)
        self.assertEqual(self.host("second"), whole, "a second time from the same restart file")
        for file, text in kept.items():
            file.write_text(text.replace("4.55", "4.95"))
        self.host("second", code=1, said="no mark of the layers has the time of the restart")
        for file in kept:
            file.write_text("no ticket\n")
        self.host("second", code=1, said="the ticket cannot be read")
        for file in kept:
            file.unlink()
        self.host("second", code=1, said="the host was restarted, and the ticket of its layers")
        cold = self.host("second", said="warning: the host was restarted with cold layers", SHEARBUS_COLD_LAYERS="1")
        self.assertEqual(cold == whole, OPTIONS.kind == "exact", (cold, whole))
        self.host("first", said="name a server by SHEARBUS_ENDPOINT", endpoint="")
        self.assertEqual(self.tickets(), [], "a host whose layers end with it writes no ticket")
        self.host("second", code=1, said="the host was restarted, and the ticket of its layers", endpoint="")


if __name__ == "__main__":
    served.main("program", "scene", "kind", "endpoint")
