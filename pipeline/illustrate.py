"""Stage: surfaces of a segment -> an illustration of every frame, for a movie that patients and students understand.

    snakemake -j2 outputs/tamponade/draft/film.mp4

A picture takes about as long as the simulation of its frame, so this runs on request only. One that was stopped goes on
after the last picture that it has drawn.
"""
import argparse
import json
import os
from pathlib import Path

from pipeline.base.cli import run
from pipeline.base.errors import UserError
from pipeline.base.files import replacing, write_text
from pipeline.base.frame_files import find_frames, read_frame
from pipeline.base.progress import progress
from pipeline.base.vtk_files import read_vtk
from pipeline.illustration.illustrator import Illustrator, oils_of
from pipeline.illustration.style import Style, add_style, style_of
from pipeline.scenes.load import load_resolved
from pipeline.scenes.model import Scene
from pipeline.surfaces.surface_files import read_surfaces

SAMPLES = 2
DONE_WITH = "drawn_with.json"       # style of the pictures that are there already


def illustrate(scene: Scene, eye, frames: Path, surfaces: Path, output: Path, last: Path, style: Style,
               depends: str = "") -> None:
    """Draw every frame of a folder; the folder of pictures appears by rename.

    Parameters
    ----------
    last : folder of the frames whose last one decides along which plane the eye is opened.
    depends : pictures drawn with another one are drawn again.
    """
    begun = output.with_name(f"{output.name}.begun")
    wanted = json.dumps([repr(style), depends, str(frames)])
    mark = begun / DONE_WITH
    if not mark.is_file() or mark.read_text(encoding="utf-8") != wanted:
        for path in begun.glob("*"):
            path.unlink()
        begun.mkdir(parents=True, exist_ok=True)
        write_text(mark, wanted)
    paths = find_frames(frames)
    illustrator = None
    with progress(len(paths), f"{scene.name}: illustrate {frames.name}") as bar:
        for path in paths:
            picture = begun / f"{path.stem}.png"
            if not picture.is_file():
                if illustrator is None:
                    illustrator = Illustrator(scene, eye, read_frame(find_frames(last)[-1]).gravity, style)
                frame = read_frame(path)
                with replacing(picture) as partial:
                    illustrator.picture(frame, read_surfaces(surfaces, path.stem, oils_of(scene))).save(partial, "PNG")
            bar.update()
    mark.unlink()
    os.replace(begun, output)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.illustrate", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("scene", type=Path, metavar="scene.json", help="resolved scene")
    parser.add_argument("eye", type=Path, metavar="eye.vtp", help="surface of the cavity")
    parser.add_argument("frames", type=Path, metavar="FRAMES_DIR", help="folder of frames")
    parser.add_argument("surfaces", type=Path, metavar="SURFACES_DIR", help="folder of the reconstruct stage")
    parser.add_argument("--output", required=True, type=Path, metavar="DIR", help="folder of pictures to write")
    parser.add_argument("--last", type=Path, metavar="FRAMES_DIR",
                        help="frames of the last segment, which decide along which plane the eye is opened "
                             "(default: those that are drawn)")
    parser.add_argument("--depends", default="", help="pictures drawn with another one are drawn again")
    add_style(parser, "960x540", SAMPLES, "legend")
    options = parser.parse_args(arguments)
    style = style_of(options, SAMPLES)
    scene = load_resolved(options.scene)
    if scene.container is not None or scene.dimension != 3:
        raise UserError(f"{scene.name}: has no eye to illustrate; its movie is movie.mp4")
    if options.output.exists():
        raise UserError(f"{options.output}: is there already; remove it or name another folder with --output")
    illustrate(scene, read_vtk(options.eye), options.frames, options.surfaces, options.output,
               options.last or options.frames, style, options.depends)
    print(f"{options.output}: drawn by {style.renderer}")


if __name__ == "__main__":
    run(main)
