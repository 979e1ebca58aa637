"""Views of one field by ParaView, as its users script them: set the camera, save a screenshot.

`research.benchmarks.hook.paraview` has pvbatch run this, in ParaView's own Python: only its modules and the standard library are
at hand.
"""

from __future__ import annotations

import json
import time
from pathlib import Path
from typing import Any


def draw(path: str) -> None:
    """Draw the request in the JSON file `path` and write the processor seconds beside it, as `hook_views.draw` does."""
    from paraview import simple
    from vtkmodules.vtkCommonCore import vtkMultiThreader

    vtkMultiThreader.SetGlobalMaximumNumberOfThreads(1)  # of the ray caster without OpenGL
    request = json.loads(Path(path).read_text())
    view = scene(simple, request)
    side, seconds = request["pixels"], []
    for number, camera in enumerate(request["pinholes"]):
        begun = time.process_time()
        view.CameraPosition, view.CameraFocalPoint = camera["position"], camera["target"]
        view.CameraViewUp, view.CameraViewAngle = camera["up"], camera["angle"]
        picture = str(Path(request["pictures"]) / f"{number}.png")
        simple.SaveScreenshot(picture, view, ImageResolution=[side, side], TransparentBackground=int(request["alpha"]))
        seconds.append(time.process_time() - begun)
    version = f"ParaView {simple.paraview.__version__} on {driver(view)}"
    answer = {"views": seconds, "step": None, "version": version}
    Path(request["answer"]).write_text(json.dumps(answer))


def scene(simple: Any, request: dict[str, Any]) -> Any:
    """A view of the field as a volume: no light, no axes, black, VTK's linear interpolation; the step is ParaView's own."""
    last, spacing = request["size"] - 1, request["spacing"]
    field = simple.ImageReader(FileNames=[request["field"]], FileDimensionality=3, ScalarArrayName="values")
    field.DataScalarType, field.DataByteOrder = "float", "LittleEndian"
    field.DataExtent, field.DataSpacing, field.DataOrigin = [0, last] * 3, [spacing] * 3, [request["origin"]] * 3
    view = simple.CreateView("RenderView")
    view.ViewSize, view.OrientationAxesVisibility = [request["pixels"]] * 2, 0
    view.UseColorPaletteForBackground, view.Background, view.UseFXAA = 0, [0.0, 0.0, 0.0], 0
    volume = simple.Show(field, view)
    volume.Representation, volume.VolumeRenderingMode = "Volume", request["mode"]
    simple.ColorBy(volume, ("POINTS", "values"))
    colors, opacities = simple.GetColorTransferFunction("values"), simple.GetOpacityTransferFunction("values")
    colors.AutomaticRescaleRangeMode, colors.ColorSpace, colors.Discretize = "Never", "RGB", 0
    colors.RGBPoints = [number for point in request["colors"] for number in point]
    opacities.Points = [number for value, opacity in request["opacities"] for number in (value, opacity, 0.5, 0.0)]
    volume.LookupTable, volume.ScalarOpacityFunction = colors, opacities
    volume.ScalarOpacityUnitDistance, volume.Shade, volume.InterpolationType = request["unit"], 0, "Linear"
    return view


def driver(view: Any) -> str:
    """The name of OpenGL's renderer."""
    lines = view.GetRenderWindow().ReportCapabilities().splitlines()
    return next((line.split(":", 1)[1].strip() for line in lines if line.startswith("OpenGL renderer string")), "")
