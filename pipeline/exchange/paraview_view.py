"""A script for ParaView that opens a run as its pictures show it. It runs where ParaView is, not this project."""
import json
from pathlib import Path

from pipeline.base.palette import rgb
from pipeline.pictures.paint import paint_of
from pipeline.scenes.model import Scene
from pipeline.scenes.retina import side_word
from pipeline.scenes.shown_liquids import liquid_around, shown_liquids

SCRIPT = '''"""Open this run in ParaView 5.10 or newer as its pictures show it, without the map of the fundus.

    paraview --script=view_run.py                      to turn it and to play it
    pvpython view_run.py picture.png [TIME]            a picture at a time in s (default: the last)
"""
import os
import sys

from paraview.simple import *

SCENE = @scene@
FOLDER = os.path.dirname(os.path.abspath(__file__)) if "__file__" in globals() else @folder@
EDGE, INK, BREAK = [0.10, 0.13, 0.17], [0.1, 0.1, 0.1], [0.84, 0.15, 0.16]
VIEW = [1.0, 0.32, 0.55]


def part(name):
    return ExtractBlock(registrationName=name, Input=run, Selectors=["/Root/" + name])


def beyond(source, array, value, above, name):
    """The part of a mesh on one side of a value."""
    clip = Clip(registrationName=name, Input=source, ClipType="Scalar", Scalars=["POINTS", array], Value=value)
    clip.Invert = 0 if above else 1
    return clip


def half_of(source, side, name):
    """The half away from a side along x."""
    clip = Clip(registrationName=name, Input=source, ClipType="Plane")
    clip.ClipType.Origin, clip.ClipType.Normal = [0.0, 0.0, 0.0], [side, 0.0, 0.0]
    clip.Invert = 1
    return clip


def smooth(source):
    """A surface with normals, under whichever of its names ParaView has the filter."""
    known = globals()
    return (known.get("SurfaceNormals") or known["GenerateSurfaceNormals"])(Input=source, FeatureAngle=180.0)


def new_view(direction, scale, title):
    """A white view with parallel projection toward the center, from a direction."""
    view = CreateView("RenderView")
    AssignViewToLayout(view=view, layout=layout, hint=cells.pop(0))
    view.UseColorPaletteForBackground, view.Background = 0, [1.0, 1.0, 1.0]
    view.OrientationAxesVisibility = 0
    write(view, title, "Upper Left Corner")
    cameras.append((view, direction, scale))
    return view


def aim(view, direction, scale):
    view.CameraParallelProjection = 1
    view.CameraFocalPoint, view.CameraViewUp = CENTER, [0.0, 1.0, 0.0]
    view.CameraPosition = [c + 4.0 * SIZE * d for c, d in zip(CENTER, direction)]
    view.CameraParallelScale = scale * SIZE


def write(view, text, place):
    words = Show(Text(registrationName=text, Text=text), view)
    words.WindowLocation, words.Color, words.FontSize = place, INK, 9


def in_one_color(source, view, color, opacity=1.0):
    display = Show(source, view)
    display.ColorArrayName = ["POINTS", ""]
    display.AmbientColor = display.DiffuseColor = color
    display.Opacity, display.Specular = opacity, 0.1
    return display


def by_fraction(source, view, array):
    """Color by a share of oil: aqueous and oil as in the pictures, mixtures between them."""
    display = Show(source, view)
    ColorBy(display, ("POINTS", array))
    colors = GetColorTransferFunction(array)
    colors.ColorSpace = "Lab"
    colors.RGBPoints = [0.0, *SCENE["without"], 1.0, *SCENE["oil"]]
    display.Specular, display.Ambient, display.Diffuse = 0.0, 0.65, 0.4
    display.SetScalarBarVisibility(view, False)
    return display, colors


def breaks():
    """The edges of the breaks of the retina; regions are numbered after them."""
    quads = Threshold(registrationName="breaks", Input=part("places"), Scalars=["CELLS", "place"],
                      LowerThreshold=0.0, UpperThreshold=SCENE["breaks"] - 0.5)
    return FeatureEdges(registrationName="edges of the breaks", Input=ExtractSurface(Input=quads), BoundaryEdges=1,
                        FeatureEdges=0, NonManifoldEdges=0, ManifoldEdges=0, Coloring=0)


def section_view():
    """The section through the optic axis: the share of the liquids that are shown."""
    view = new_view([1.0, 0.0, 0.0], 0.72, "section, seen from the patient's left")
    share = Calculator(registrationName="share", Input=part("section"), ResultArrayName=SCENE["words"],
                       Function=SCENE["share"])
    # A clip of an image would lose the array that has just been computed.
    inside = Threshold(registrationName="cavity", Input=share, Scalars=["POINTS", "signed_distance"],
                       LowerThreshold=-1.0, UpperThreshold=0.0)
    display, colors = by_fraction(inside, view, SCENE["words"])
    display.Ambient, display.Diffuse = 1.0, 0.0
    display.SetScalarBarVisibility(view, True)
    bar = GetScalarBar(colors, view)
    bar.Title, bar.ComponentTitle, bar.WindowLocation = SCENE["words"], "", "Lower Center"
    bar.Orientation, bar.TitleColor, bar.LabelColor = "Horizontal", INK, INK
    bar.RangeLabelFormat, bar.TitleFontSize, bar.LabelFontSize = "%.0f", 9, 8
    line = in_one_color(Contour(registrationName="interface of the section", Input=inside, Isosurfaces=[0.5],
                                ContourBy=["POINTS", SCENE["words"]]), view, EDGE)
    line.LineWidth, line.Position = 3.0, [0.01 * SIZE, 0.0, 0.0]


def eye_views():
    """The eye opened into two halves: the wall painted by what touches it, and the interface in it."""
    wall, interface = part("wall"), smooth(part("interface"))
    edge = Contour(registrationName="contact line", Input=wall, ContourBy=["POINTS", "contact_distance"],
                   Isosurfaces=[0.0])
    touched = {array: beyond(wall, "contact_distance", 0.0, above, name) for array, above, name in (
        ("oil_fraction_covered", True, "touched wall"), ("oil_fraction_bare", False, "bare wall"))}
    red = breaks() if SCENE["breaks"] else None
    for half, side in SCENE["halves"].items():
        view = new_view([side * VIEW[0], *VIEW[1:]], 0.60, half + " half of the eye, from inside")
        for array, source in touched.items():
            by_fraction(half_of(source, side, array + ", " + half), view, array)
        in_one_color(half_of(interface, side, "interface, " + half), view, SCENE["oil"])
        line = in_one_color(half_of(edge, side, "contact line, " + half), view, EDGE)
        line.LineWidth, line.RenderLinesAsTubes = 3.0, 1
        if red is not None:
            line = in_one_color(half_of(red, side, "breaks, " + half), view, BREAK)
            line.LineWidth, line.RenderLinesAsTubes = 4.0, 1


def bodies_view():
    """The liquids of a container, or of a scene in two dimensions, in their colors."""
    flat = SCENE["dimension"] == 2
    view = new_view([0.0, 0.0, 1.0] if flat else [0.55, 0.42, 1.0], 0.5 if flat else 0.7, "bodies of the liquids")
    in_one_color(part("wall"), view, [0.4, 0.4, 0.4]).SetRepresentationType("Feature Edges" if not flat else "Surface")
    for name, color in SCENE["colors"].items():
        in_one_color(part(name), view, color, 1.0 if flat else 0.8).LineWidth = 3.0


run = PVDReader(registrationName=SCENE["title"], FileName=os.path.join(FOLDER, "run.pvd"))
run.UpdatePipelineInformation()
times = run.TimestepValues if hasattr(run.TimestepValues, "__len__") else [run.TimestepValues]
scene = GetAnimationScene()
scene.UpdateAnimationUsingDataTimeSteps()
scene.AnimationTime = float(sys.argv[2]) if len(sys.argv) > 2 else times[-1]
run.UpdatePipeline(scene.AnimationTime)
cavity = part("wall")
cavity.UpdatePipeline(scene.AnimationTime)
bounds = cavity.GetDataInformation().GetBounds()
CENTER = [0.5 * (bounds[k] + bounds[k + 1]) for k in (0, 2, 4)]
SIZE = max(bounds[k + 1] - bounds[k] for k in (0, 2, 4))
Delete(cavity)
layout, cameras = CreateLayout(SCENE["title"]), []
if SCENE["painted"]:
    left = layout.SplitHorizontal(0, 0.56)
    below = layout.SplitVertical(left + 1, 0.5)
    cells = [left, below, below + 1]
    section_view()
    eye_views()
else:
    cells = [0]
    bodies_view()
write(cameras[0][0], SCENE["title"], "Lower Left Corner")
clock = Show(AnnotateTimeFilter(registrationName="clock", Input=run, Format="t = {time:.2f} s"), cameras[0][0])
clock.WindowLocation, clock.Color, clock.FontSize = "Upper Right Corner", INK, 12
RenderAllViews()  # which moves every camera once
for one in cameras:
    aim(*one)
RenderAllViews()
if len(sys.argv) > 1:
    SaveScreenshot(sys.argv[1], layout, ImageResolution=[1600, 900])
'''


def view_script(scene: Scene, folder: Path, *, painted: bool) -> str:
    """Return the text of the script.

    Parameters
    ----------
    folder : of the run, for ParaViews that do not tell a script where it is.
    painted : whether the walls of the run tell what touches them.
    """
    first = liquid_around(scene) or scene.liquids[0]
    facts = {
        "title": f"{scene.title or scene.name} ({scene.accuracy})",
        "dimension": scene.dimension, "painted": int(painted), "breaks": len(scene.breaks),
        # The half that is shown, and the side along x that the camera is on.
        "halves": {side_word(side < 0.0, scene.eye.side == "right"): side for side in (1.0, -1.0)} if scene.eye else {},
        "share": f"{'1 - ' if len(scene.liquids) > 1 else ''}fraction_{first.name}",
        "words": "oil volume fraction" if any("oil" in one.name for one in shown_liquids(scene)) else "volume fraction",
        "colors": {liquid.name: _shares(rgb(liquid.color)) for liquid in scene.liquids},
        "oil": _shares(paint_of(scene).covered), "without": _shares(paint_of(scene).bare),
    }
    words = json.dumps(facts, indent=4, ensure_ascii=False)
    return SCRIPT.replace("@folder@", repr(str(folder))).replace("@scene@", words)


def _shares(color) -> list[float]:
    """Red, green and blue from 0 to 1."""
    return [round(int(part) / 255, 3) for part in color]
