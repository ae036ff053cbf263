'''A script for ParaView that opens a run as its pictures show it.

It stands by itself: it runs where ParaView is, not this project.
'''
import json
from pathlib import Path

from pipeline.exchange.run_index import background_of, shown_liquids
from pipeline.scenes.model import Scene

SCRIPT = '''"""Open this run in ParaView 5.10 or newer as the pictures of the pipeline show it.

    paraview --script=view_run.py                      to turn it and to play it
    pvpython view_run.py picture.png [TIME]            a picture of one time in s (default: the last)
"""
import os
import sys

from paraview.simple import *

SCENE = @scene@
FOLDER = os.path.dirname(os.path.abspath(__file__)) if "__file__" in globals() else @folder@
YELLOW, ORANGE, SHELL = [1.0, 0.88, 0.30], [0.85, 0.51, 0.0], [0.87, 0.90, 0.93]


def part(name):
    """One part of the run, under its name in the browser."""
    block = ExtractBlock(registrationName=name, Input=run, Selectors=["/Root/" + name])
    # A block alone, not a tree with one block.
    return MergeBlocks(registrationName=name + " alone", Input=block, MergePoints=0, OutputDataSetType=block_kind(name))


def block_kind(name):
    return "Unstructured Grid" if name in ("particles", "section") else "Polygonal Mesh"


def show(source, view, color=None, opacity=1.0):
    """Draw in one color, lit softly."""
    display = Show(source, view)
    if color:
        ColorBy(display, None)
        display.AmbientColor = display.DiffuseColor = color
    display.Opacity, display.Specular = opacity, 0.0
    return display


def new_view(position, up, scale):
    """A white view with parallel projection, seen from a direction, m."""
    view = CreateView("RenderView")
    view.UseColorPaletteForBackground = 0
    view.Background = [1.0, 1.0, 1.0]
    view.OrientationAxesLabelColor = [0.1, 0.1, 0.1]
    view.CameraParallelProjection = 1
    view.CameraPosition, view.CameraFocalPoint = [c + 0.1 * p * scale / 0.013 for c, p in zip(CENTER, position)], CENTER
    view.CameraViewUp, view.CameraParallelScale = up, scale
    AssignViewToLayout(view=view, layout=layout, hint=hints.pop(0))
    return view


def write(view, text, place):
    words = Show(Text(registrationName=text, Text=text), view)
    words.WindowLocation, words.Color, words.FontSize = place, [0.1, 0.1, 0.1], 12


def positive(source, name, array, value, keep_above=True):
    """The part of a mesh on one side of a value."""
    clip = Clip(registrationName=name, Input=source, ClipType="Scalar", Scalars=["POINTS", array], Value=value)
    clip.Invert = 0 if keep_above else 1
    return clip


def half(source, name):
    """The half on the patient's right."""
    clip = Clip(registrationName=name, Input=source, ClipType="Plane")
    clip.ClipType.Origin, clip.ClipType.Normal = [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]
    clip.Invert = 1
    return clip


def section_view():
    """The section through the optic axis, seen from the patient's left: the share of the liquids that are shown."""
    view = new_view([1.0, 0.0, 0.0], [0.0, 1.0, 0.0], 0.58 * SIZE)
    inside = positive(part("section"), "cavity", "signed_distance", 0.0, keep_above=False)
    share = Calculator(registrationName="share", Input=inside, ResultArrayName=SCENE["words"], Function=SCENE["share"])
    display = Show(share, view)
    ColorBy(display, ("POINTS", SCENE["words"]))
    colors = GetColorTransferFunction(SCENE["words"])
    colors.ApplyPreset("Cividis", True)
    colors.RescaleTransferFunction(0.0, 1.0)
    display.SetScalarBarVisibility(view, True)
    bar = GetScalarBar(colors, view)
    bar.Title, bar.ComponentTitle, bar.WindowLocation = SCENE["words"], "", "Lower Center"
    bar.Orientation, bar.TitleColor, bar.LabelColor = "Horizontal", [0.1] * 3, [0.1] * 3
    write(view, "section, seen from the patient's left", "Upper Left Corner")
    return view


def eye_view():
    """The half of the wall on the patient's right, the liquids in it, and where they touch it."""
    view = new_view([1.0, 0.32, 0.55], [0.0, 1.0, 0.0], 0.62 * SIZE)
    show(half(part("wall"), "half of the wall"), view, SHELL)
    for number, name in enumerate(SCENE["shown"]):
        touch = positive(part(name), name + " at the wall", "depth", SCENE["at_wall"], keep_above=False)
        if "contact" not in SCENE["parts"]:
            show(half(touch, name + " touches"), view, ORANGE)
    if "contact" in SCENE["parts"]:
        show(half(positive(part("contact"), "touched", "contact_distance", 0.0), "touched half"), view, ORANGE)
    show(part("interface"), view, YELLOW if len(SCENE["shown"]) == 1 else None)
    write(view, "the eye opened: interface yellow, touched wall orange", "Upper Left Corner")
    return view


def container_view():
    """The liquids of a container in their colors."""
    view = new_view([0.0, 0.0, 1.0] if SCENE["dimension"] == 2 else [0.55, 0.42, 1.0], [0.0, 1.0, 0.0], 0.62 * SIZE)
    show(part("wall"), view, [0.4, 0.4, 0.4]).SetRepresentationType("Wireframe")
    for name, color in SCENE["colors"].items():
        show(part(name), view, color, 1.0 if SCENE["dimension"] == 2 else 0.8)
    return view


run = PVDReader(registrationName=SCENE["title"], FileName=os.path.join(FOLDER, "run.pvd"))
times = run.TimestepValues if hasattr(run.TimestepValues, "__len__") else [run.TimestepValues]
scene = GetAnimationScene()
scene.UpdateAnimationUsingDataTimeSteps()
scene.AnimationTime = float(sys.argv[2]) if len(sys.argv) > 2 else times[-1]
run.UpdatePipeline(scene.AnimationTime)
low, high = part("wall").GetDataInformation().GetBounds()[::2], part("wall").GetDataInformation().GetBounds()[1::2]
CENTER, SIZE = [0.5 * (a + b) for a, b in zip(low, high)], max(b - a for a, b in zip(low, high))
layout = CreateLayout(SCENE["title"])
split = "section" in SCENE["parts"]
left = layout.SplitHorizontal(0, 0.5) if split else 0
hints = [left, left + 1]
views = [section_view(), eye_view()] if split else [container_view()]
write(views[0], SCENE["title"], "Upper Right Corner")
clock = Show(AnnotateTimeFilter(registrationName="clock", Input=run, Format="t = {time:.2f} s"), views[-1])
clock.WindowLocation, clock.Color, clock.FontSize = "Upper Right Corner", [0.1] * 3, 14
RenderAllViews()
if len(sys.argv) > 1:
    layout.SetSize(1280, 720)
    SaveScreenshot(sys.argv[1], layout, ImageResolution=[1280, 720])
'''


def view_script(scene: Scene, parts: list[str], at_wall: float, folder: Path) -> str:
    """Return the text of the script.

    Parameters
    ----------
    parts : names of the parts of the run.
    at_wall : depth in m up to which a surface lies at the wall.
    folder : of the run, for ParaViews that do not tell a script where it is.
    """
    shown, background = shown_liquids(scene), background_of(scene)
    share = f"1 - fraction_{background}" if background else f"fraction_{scene.liquids[0].name}"
    facts = {
        "title": f"{scene.title or scene.name} ({scene.accuracy})", "dimension": scene.dimension, "parts": parts,
        "shown": shown or [liquid.name for liquid in scene.liquids], "at_wall": at_wall, "share": share,
        "words": "oil volume fraction" if any("oil" in name for name in shown) else "volume fraction",
        "colors": {liquid.name: [int(liquid.color[k:k + 2], 16) / 255 for k in (1, 3, 5)] for liquid in scene.liquids},
    }
    return SCRIPT.replace("@scene@", json.dumps(facts, indent=4)).replace("@folder@", repr(str(folder)))
