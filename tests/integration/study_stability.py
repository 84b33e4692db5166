#!/usr/bin/python3
"""shearbus-study stability as a user runs it, on one row: table, JSON and exit code say the same."""
import argparse
import json
import pathlib
import subprocess
import tempfile


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--study", required=True)
    program = parser.parse_args().study
    with tempfile.TemporaryDirectory() as out:
        ran = subprocess.run([program, "stability", "--row", "near_melting", "--out", out], capture_output=True, text=True)
        assert ran.returncode == 0, ran.stdout + ran.stderr
        assert (pathlib.Path(out) / "stability.png").stat().st_size > 10000
        study = json.loads((pathlib.Path(out) / "stability.json").read_text())
        assert study["commit"] and study["processor"] and [row["name"] for row in study["rows"]] == ["near_melting"], study
        assert len(study["cells"]) == len(study["physics"]) > 15
        for cell in study["cells"]:
            assert cell["verdict"] == "held" and cell["reason"] == "", cell
            assert cell["node_steps"] > 1000 and cell["heat_residual"] < 1e-12 and 0 <= cell["bound_share"] <= 1.13, cell
            assert cell["layer_sums"] + cell["limit_values"] + cell["newton_steps"] > 0, cell
        assert "near_melting" in ran.stdout and "BROKEN" not in ran.stdout
        ran = subprocess.run([program, "stability", "--row", "nothing"], capture_output=True, text=True)
        assert ran.returncode == 1 and "nothing" in ran.stderr, ran
    print("shearbus-study stability answers as it should")


if __name__ == "__main__":
    main()
