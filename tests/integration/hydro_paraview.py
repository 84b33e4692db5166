"""Reads the fields of a run with both of ParaView's own readers: every frame, its time, the mesh and the values of every array."""
import pathlib
import shutil
import subprocess
import sys
import tempfile
import unittest

import h5py
import numpy
from PIL import Image
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOXdmf2 import vtkXdmfReader
from vtkmodules.vtkIOXdmf3 import vtkXdmf3Reader

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "support"))
import served
from served import OPTIONS, PROBLEMS, SOURCE

ZONE_ARRAYS = {"temperature", "pressure", "density", "plastic_strain", "equivalent_stress", "body"}


class ParaView(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.scratch = tempfile.TemporaryDirectory()
        directory = pathlib.Path(cls.scratch.name)
        scene = served.edited(PROBLEMS / "cone_al_steel_coarse.toml", directory / "cone.toml", zone_width_m="2e-3\nframes = 4", end_time_s=4e-6)
        cls.out = directory / "run"
        subprocess.run([OPTIONS.hydro, scene, "--interface-law", "coulomb_tresca", "--out", cls.out,
                        "--no-plot"], check=True, stdout=subprocess.DEVNULL, timeout=250)

    @classmethod
    def tearDownClass(cls):
        cls.scratch.cleanup()

    def reads(self, reader):
        reader.SetFileName(str(self.out / "fields.xmf"))
        reader.UpdateInformation()
        information = reader.GetOutputInformation(0)
        key = reader.GetExecutive().TIME_STEPS()
        times = [information.Get(key, i) for i in range(information.Length(key))]
        with h5py.File(self.out / "fields" / "mesh.h5") as f:
            quads = f["quads"][:]
        self.assertEqual(len(times), 5)
        for number, time in enumerate(times):
            with h5py.File(self.out / "fields" / f"{number:05}.h5") as f:
                self.assertEqual(time, f["time"][0])
                reader.UpdateTimeStep(time)
                grid = reader.GetOutputDataObject(0)
                while grid.IsA("vtkMultiBlockDataSet"):
                    grid = grid.GetBlock(0)
                numpy.testing.assert_array_equal(vtk_to_numpy(grid.GetPoints().GetData()), f["place"][:])
                velocity = vtk_to_numpy(grid.GetPointData().GetArray("velocity"))
                numpy.testing.assert_array_equal(velocity, f["velocity"][:])
                self.assertEqual(grid.GetNumberOfCells(), len(quads))
                for zone in (0, len(quads) // 2, len(quads) - 1):
                    corners = grid.GetCell(zone).GetPointIds()
                    self.assertEqual([corners.GetId(i) for i in range(4)], list(quads[zone]))
                arrays = {grid.GetCellData().GetArrayName(i) for i in range(grid.GetCellData().GetNumberOfArrays())}
                self.assertLessEqual(ZONE_ARRAYS, arrays)
                for name in ZONE_ARRAYS:
                    numpy.testing.assert_array_equal(vtk_to_numpy(grid.GetCellData().GetArray(name)), f[name][:], err_msg=name)

    def test_the_script_draws(self):
        if not shutil.which("xvfb-run"):
            self.skipTest("xvfb is missing")
        picture = pathlib.Path(self.scratch.name) / "cone.png"
        done = subprocess.run(["xvfb-run", "-a", "-s", "-noreset -screen 0 1920x1200x24", "pvpython", str(SOURCE / "client/report/paraview_cone.py"),
                               str(self.out), "--out", str(picture), "--time", "3"], capture_output=True, text=True, timeout=250)
        self.assertEqual(done.returncode, 0, done.stderr[-2000:])
        image = Image.open(picture).convert("RGB")
        seen = {tuple(colour) for _, colour in image.getcolors(1 << 24)}
        grey = {(r, g, b) for r, g, b in seen if r == g == b}
        self.assertGreater(len(grey), 30)  # the sections, by their pressure
        self.assertGreater(len(seen - grey), 200)  # the interface

    def test_xdmf2_reader(self):
        self.reads(vtkXdmfReader())

    def test_xdmf3_reader(self):
        self.reads(vtkXdmf3Reader())


if __name__ == "__main__":
    served.main()
