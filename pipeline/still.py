"""Stage: surfaces of one frame -> an illustration: the opened eye with its liquids, labeled, for talks and title pages.

Drawn by Mitsuba 3, or by PyVista where that is not installed; the picture says which. The liquids are those of the
simulation, the eye around them is a scheme (``pipeline.illustration``). Containers are drawn as bodies in a glass box.
"""
from pathlib import Path

from PIL import Image

from pipeline.base.cli import run, stage_parser
from pipeline.base.errors import UserError
from pipeline.base.files import replacing
from pipeline.base.frame_files import FrameData, frame_at
from pipeline.base.vtk_files import read_vtk
from pipeline.illustration.illustrator import Illustrator, oils_of
from pipeline.illustration.style import Style, add_files, add_style, style_of
from pipeline.scenes.model import Scene
from pipeline.surfaces.surface_files import read_surfaces

SAMPLES = 4


def draw(scene: Scene, eye: Path, frame: FrameData, surfaces: dict, style: Style) -> Image.Image:
    """The still of a frame; ``surfaces`` is a dict liquid -> pyvista.PolyData.

    Raises
    ------
    UserError : the scene is in two dimensions.
    """
    if scene.dimension == 2:
        raise UserError(f"{scene.name}: is in two dimensions, but a still shows bodies in space; "
                        "its pictures are in images/")
    if scene.container is None:
        oils = {name: surfaces[name] for name in oils_of(scene)}
        illustrator = Illustrator(scene, read_vtk(eye), frame.gravity, style)
        liquids = illustrator.liquids(frame, oils)
        return illustrator.with_words(illustrator.picture(frame, liquids), frame, liquids)
    from pipeline.pictures.container_still import container_still

    return container_still(scene, frame, surfaces, style.size)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = stage_parser("still", "Draw one frame as a labeled illustration of the opened eye.")
    add_files(parser)
    parser.add_argument("--output", required=True, type=Path, metavar="still.png", help="picture to write")
    parser.add_argument("--time", type=float, metavar="SECONDS", help="the frame nearest to it (default: the last)")
    add_style(parser, "1280x720", SAMPLES, "names")
    options = parser.parse_args(arguments)
    style = style_of(options, SAMPLES)
    if not options.eye.is_file():
        raise UserError(f"{options.eye}: no such file; run the eye stage first")

    from pipeline.scenes.load import load_resolved

    scene = load_resolved(options.scene)
    name, frame = frame_at(options.frames, options.time)
    picture = draw(scene, options.eye, frame, read_surfaces(options.surfaces, name, frame.liquids), style)
    with replacing(options.output) as partial:
        picture.save(partial, format="PNG")
    print(f"{options.output}: t = {frame.time:.2f} s, drawn by {style.renderer}")


if __name__ == "__main__":
    run(main)
