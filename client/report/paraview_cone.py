"""The cone in ParaView, from the files of one run of cone_target: the interface as a surface of revolution, left with
its temperature, right with its slip distance, inside of the section through the bodies with their pressure.

    pvbatch paraview_cone.py RUN --out FILE.png [--time MICROSECONDS]

RUN is a directory that shearbus-hydro wrote: the bodies are read from fields.xmf, the interface from interface.h5.
Debian's ParaView draws on a screen only; without one: xvfb-run -a -s "-noreset -screen 0 1920x1200x24" pvbatch ..."""
import pathlib

import h5py
import numpy
import style
from paraview import simple
from terminal import Parser, printable, read_json, real_number
from vtkmodules.util.numpy_support import numpy_to_vtk
from vtkmodules.vtkCommonCore import vtkPoints
from vtkmodules.vtkCommonDataModel import vtkCellArray, vtkPolyData

QUANTITIES = (("interface_temperature", "interface temperature (K)", 1.0, "Inferno (matplotlib)"), ("slip_distance", "slip distance (mm)", 1e3, "Viridis (matplotlib)"))
APART = 46e-3  # m between the axes of the two cones


def interface(run, time):
    """Returns the interface at a time (s) as a poly-line in the plane of r and z, with QUANTITIES, and the time of
    the row."""
    with h5py.File(pathlib.Path(run) / "interface.h5") as file:
        row = int(numpy.abs(file["time"][:] - time).argmin())
        points, line, found = vtkPoints(), vtkCellArray(), vtkPolyData()
        line.InsertNextCell(file["node_id"].size)
        for i, (r, z) in enumerate(zip(file["radius"][row], file["height"][row])):
            points.InsertNextPoint(r, z, 0.0)
            line.InsertCellPoint(i)
        found.SetPoints(points)
        found.SetLines(line)
        for name, _, factor, _ in QUANTITIES:
            values = numpy_to_vtk(file[name][row] * factor, deep=True)
            values.SetName(name)
            found.GetPointData().AddArray(values)
        return found, float(file["time"][row])


def producer(data):
    made = simple.TrivialProducer()
    made.GetClientSideObject().SetOutput(data)
    return made


def moved(source, x):
    """Returns the source with the axis of symmetry along z of the picture, at x."""
    made = simple.Transform(Input=source)
    made.Transform.Rotate = [90.0, 0.0, 0.0]
    made.Transform.Translate = [x, 0.0, 0.0]
    return made


def scene(run, time):
    """Returns a view with the cone at a time (s)."""
    fields = simple.XDMFReader(FileNames=[str((pathlib.Path(run) / "fields.xmf").resolve())])
    fields.UpdatePipelineInformation()
    frame = min(fields.TimestepValues, key=lambda value: abs(value - time))
    line, row_time = interface(run, frame)
    view = simple.CreateView("RenderView")
    view.ViewSize, view.Background, view.UseColorPaletteForBackground, view.OrientationAxesVisibility = [1800, 860], [1.0, 1.0, 1.0], 0, 0
    view.ViewTime = frame
    both = simple.Reflect(Input=fields, Plane="X", Center=0.0, CopyInput=1)
    for x, (name, label, _, colours) in zip((-0.5 * APART, 0.5 * APART), QUANTITIES):
        bodies = simple.Show(moved(both, x), view)
        simple.ColorBy(bodies, ("CELLS", "pressure"))
        bodies.Ambient, bodies.Diffuse = 1.0, 0.0
        pressure = simple.GetColorTransferFunction("pressure")
        pressure.ApplyPreset("Grayscale", True)
        pressure.InvertTransferFunction()
        pressure.RescaleTransferFunction(-1e9, 8e9)  # no pressure is grey, not the white of the paper
        bodies.SetScalarBarVisibility(view, False)
        turned = simple.Transform(Input=producer(line))
        turned.Transform.Rotate = [90.0, 0.0, 0.0]
        surface = simple.RotationalExtrusion(Input=turned, Resolution=90, Capping=0, Angle=-180.0)
        placed = simple.Transform(Input=surface)
        placed.Transform.Translate = [x, 0.0, 0.0]
        shown = simple.Show(placed, view)
        simple.ColorBy(shown, ("POINTS", name))
        shown.Ambient, shown.Diffuse = 0.45, 0.65
        table = simple.GetColorTransferFunction(name)
        table.ApplyPreset(colours, True)
        low, high = 300.0 if name == "interface_temperature" else 0.0, line.GetPointData().GetArray(name).GetRange()[1]
        table.RescaleTransferFunction(low, high)
        shown.SetScalarBarVisibility(view, True)
        bar = simple.GetScalarBar(table, view)
        bar.Title, bar.ComponentTitle, bar.Orientation = label, "", "Horizontal"
        bar.WindowLocation, bar.ScalarBarLength = "Any Location", 0.28
        bar.Position = [0.11 if x < 0 else 0.61, 0.04]
        bar.TitleColor = bar.LabelColor = [0.1, 0.1, 0.1]
        bar.TitleFontSize, bar.LabelFontSize, bar.RangeLabelFormat, bar.AutomaticLabelFormat, bar.LabelFormat = 22, 20, "%.4g", 0, "%.4g"
        bar.AddRangeLabels, bar.UseCustomLabels, bar.CustomLabels = 0, 1, list(numpy.arange(low, high, float(f"{(high - low) / 4:.1g}")))
    text = simple.Show(simple.Text(Text=f"{pathlib.Path(run).resolve().name}, {1e6 * row_time:.2f} µs; sections: pressure from -1 (white) to 8 GPa (black)"), view)
    text.Color, text.FontSize, text.WindowLocation = [0.1, 0.1, 0.1], 20, "Upper Center"
    footer = simple.Show(simple.Text(Text=style.provenance_text(read_json(pathlib.Path(run) / "summary.json")["provenance"])), view)
    footer.Color, footer.FontSize, footer.WindowLocation = [0.5, 0.5, 0.5], 12, "Lower Right Corner"
    view.CameraFocalPoint, view.CameraPosition, view.CameraViewUp = [0.0, 0.0, 0.0043], [0.0, -0.085, 0.0423], [0.0, 0.0, 1.0]
    view.CameraParallelProjection, view.CameraParallelScale = 1, 0.0225
    return view


def main():
    parser = Parser(description=__doc__)
    parser.add_argument("run", type=pathlib.Path)
    parser.add_argument("--out", type=pathlib.Path, required=True)
    parser.add_argument("--time", type=real_number, default=4.0, help="µs, default 4")
    options = parser.parse_args()
    simple._DisableFirstRenderCameraReset()
    view = scene(options.run, options.time * 1e-6)
    simple.SaveScreenshot(str(options.out), view)
    print(f"  picture                 {printable(options.out)}")


if __name__ == "__main__":
    main()
