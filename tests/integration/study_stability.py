#!/usr/bin/python3
"""Runs `shearbus-study stability` as a user does, on one row and on scenes of the user's own. Table, JSON, picture and exit code agree;
scenes without a layer are refused; values that no solver can handle are reported."""
import argparse
import json
import pathlib
import subprocess
import tempfile

# Metals, thickness, initial state and host all differ from the paper's.
SCENE = """
name = "mine"
strategy = "force_driven"
[soft]
material = "copper_ofhc"
[hard]
material = "steel_304"
[layer]
thickness_m = 5e-6
cells = 30
grading = 1.1
far_boundary = "half_space"
initial_temperature_k = 77.0
[interface]
friction_coefficient = 0.2
yield_strength_pa = 300e6
[hydro]
end_time_s = 1e-6
[hydro.shear_column]
length_m = 1e-3
zones = 100
velocity_jump_m_per_s = [50.0]
pressure_pa = [20e9, 3e9]
"""
OF_LAYERS = ("hardening", "saturation", "host_shear")  # rows that need a layer that deforms; the layer of SCENE does not


def run(program, *arguments):
    return subprocess.run([program, "stability", *map(str, arguments)], capture_output=True, text=True)


def study(program, out, *arguments):
    ran = run(program, *arguments, "--out", out)
    assert ran.returncode == 0, ran.stdout + ran.stderr
    assert "BROKEN" not in ran.stdout, ran.stdout
    return json.loads((pathlib.Path(out) / "stability.json").read_text()), ran.stdout


def one_row(program, out):
    found, text = study(program, out, "--row", "near_melting")
    assert (pathlib.Path(out) / "stability.png").stat().st_size > 10000
    assert found["commit"] and found["processor"] and [row["name"] for row in found["rows"]] == ["near_melting"], found
    assert found["scene"] is None and len(found["cells"]) == len(found["physics"]) > 15
    for cell in found["cells"]:
        assert cell["verdict"] == "held" and cell["reason"] == "", cell
        assert cell["node_steps"] > 1000 and cell["heat_residual"] < 1e-12 and 0 <= cell["bound_share"] <= 1.13, cell
        assert cell["layer_sums"] + cell["limit_values"] + cell["wave_evaluations"] > 0, cell
    assert "near_melting" in text
    ran = run(program, "--row", "nothing")
    assert ran.returncode == 1 and "nothing" in ran.stderr and "near_melting" in ran.stderr, ran


def own_scene(program, out, scene):
    scene.write_text(SCENE)
    found, text = study(program, out, scene, "--random", 4000, "--steps", 200)
    assert (pathlib.Path(out) / "stability.png").stat().st_size > 10000
    told = found["scene"]
    assert told["name"] == "mine" and told["file"] == str(scene) and "copper_ofhc on steel_304" in told["physics"], told
    # The host's values come from the scene: its largest pressure, its zones, and the time of a shear wave across a zone. None is the
    # paper's.
    assert told["pressure_pa"] == 20e9 and told["soft_zone_width_m"] == 1e-5 and 2e-9 < told["dt_s"] < 6e-9, told
    assert f"mine: {told['physics']}" in text and f"host: {told['host']}" in text, text
    assert found["physics"] == ["mine"] and not found["controls"], found
    verdicts = {cell["row"]: cell["verdict"] for cell in found["cells"]}
    assert len(verdicts) > 20 and all((v == "not asked") == (row in OF_LAYERS) for row, v in verdicts.items()), verdicts
    assert all(v != "broken" for v in verdicts.values()) and verdicts["three_roots"] == "held", verdicts
    (drawn,) = found["random"]
    assert drawn["name"] == "mine" and drawn["node_steps"] == 4000 and not drawn["faults"], drawn
    # Values that the scene does not give, or that the command line replaces.
    found, _ = study(program, out, scene, "--row", "pressure", "--pressure", 1e9, "--zone-width", 4e-6, "--dt", 1e-10, "--no-plot")
    told = found["scene"]
    assert (told["pressure_pa"], told["hard_zone_width_m"], told["dt_s"]) == (1e9, 4e-6, 1e-10) and "--pressure" in told["host"], told


def shipped_scenes(program, out, source):
    found, _ = study(program, out, source / "hydro_stub/problems/cone_al_steel_coarse.toml", "--no-plot", "--random", 4000)
    assert abs(found["scene"]["pressure_pa"] - 7.69e9) < 0.1e9 and "modes" in found["scene"]["physics"], found["scene"]
    assert {cell["verdict"] for cell in found["cells"]} == {"held", "not asked"}, found["cells"]
    for name in ("interface_slip", "paper_velocity_driven_graded"):
        study(program, out, source / f"client/examples/{name}.toml", "--no-plot", "--random", 400, "--steps", 20)


def refused(program, scene, text, *expected):
    scene.write_text(text)
    ran = run(program, scene, "--no-plot")
    assert ran.returncode == 1 and all(part in ran.stderr for part in (scene.name, *expected)), ran


def bad_scenes(program, out, scene, source):
    problems = source / "hydro_stub/problems/verification"
    refused(program, scene, (problems / "taylor_bar.toml").read_text(), "no bodies slide", "shear_column")
    refused(program, scene, (problems / "oblique_free_slip.toml").read_text(), "free_slip", '"subgrid"')
    refused(program, scene, SCENE.replace('"copper_ofhc"', '"cheese"'), "cheese")
    refused(program, scene, SCENE.replace("= 77.0", "= 2000.0"), ":13:1", "layer.initial_temperature_k", "starts solid")
    refused(program, scene, SCENE.replace("[20e9, 3e9]", "[-1e9]"), "pressure above 0", "--pressure")
    ran = run(program, "--pressure", "1e9")
    assert ran.returncode == 1 and "name the scene" in ran.stderr, ran
    # A metal that conducts no heat is unphysical; the server accepts it, and the campaign reports it.
    scene.write_text(SCENE.replace('"copper_ofhc"', '"copper_ofhc"\nthermal_conductivity_w_per_m_k = 1e-300'))
    ran = run(program, scene, "--row", "fourier_number", "--no-plot", "--out", out)
    assert ran.returncode == 1 and "BROKEN fourier_number, mine" in ran.stdout, ran
    (cell,) = json.loads((pathlib.Path(out) / "stability.json").read_text())["cells"]
    assert cell["verdict"] == "broken" and cell["reason"], cell


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--study", required=True)
    parser.add_argument("--source", type=pathlib.Path, required=True)
    options = parser.parse_args()
    with tempfile.TemporaryDirectory() as out:
        scene = pathlib.Path(out) / "mine.toml"
        one_row(options.study, out)
        own_scene(options.study, out, scene)
        shipped_scenes(options.study, out, options.source)
        bad_scenes(options.study, out, scene, options.source)
    print("shearbus-study stability answers as it should")


if __name__ == "__main__":
    main()
