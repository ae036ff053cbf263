"""Stage: surfaces of one frame -> a movie in which the camera goes to and fro before the opened eye.

    snakemake -j2 outputs/tamponade/draft/turntable.mp4
"""
import tempfile
from pathlib import Path

import numpy as np

from pipeline.base.cli import run, stage_parser
from pipeline.base.errors import UserError
from pipeline.base.frame_files import frame_at
from pipeline.base.progress import progress
from pipeline.base.vtk_files import read_vtk
from pipeline.illustration.illustrator import Illustrator, oils_of
from pipeline.illustration.style import add_files, add_style, style_of
from pipeline.pictures.movie_file import write_movie
from pipeline.pictures.pace import RATE, Pace
from pipeline.scenes.load import load_resolved
from pipeline.surfaces.surface_files import read_surfaces

SAMPLES = 2
PICTURES = 144                  # 6 s
WIDEST = np.radians(38.0)       # to either side: beyond, the cut is seen from its edge


def swings(count: int) -> np.ndarray:
    """Angles (count,) of a camera that swings once to either side, rad; the movie can be played in a loop."""
    return WIDEST * np.sin(2.0 * np.pi * np.arange(count) / count)


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = stage_parser("turntable", __doc__)
    add_files(parser)
    parser.add_argument("--output", required=True, type=Path, metavar="turntable.mp4", help="movie to write")
    parser.add_argument("--time", type=float, metavar="SECONDS", help="the frame nearest to it (default: the last)")
    parser.add_argument("--pictures", type=int, default=PICTURES, metavar="N",
                        help=f"of the whole turn, 8 to 2000, {RATE:g} per second (default: {PICTURES})")
    add_style(parser, "1280x720", SAMPLES, "legend")
    options = parser.parse_args(arguments)
    if not 8 <= options.pictures <= 2000:
        raise UserError(f"--pictures is {options.pictures}, but must be from 8 to 2000")
    style, scene = style_of(options, SAMPLES), load_resolved(options.scene)
    if scene.container is not None:
        raise UserError(f"{scene.name}: has no eye to turn; its movie is movie.mp4")
    name, frame = frame_at(options.frames, options.time)
    surfaces = read_surfaces(options.surfaces, name, oils_of(scene))
    illustrator = Illustrator(scene, read_vtk(options.eye), frame.gravity, style)
    liquids = illustrator.liquids(frame, surfaces)
    with tempfile.TemporaryDirectory() as folder, progress(options.pictures, f"{scene.name}: turn") as bar:
        paths = [Path(folder) / f"{number:05d}.png" for number in range(options.pictures)]
        for path, swing in zip(paths, swings(options.pictures), strict=True):
            picture = illustrator.picture(frame, liquids, swing)
            illustrator.with_words(picture, frame, liquids, swing).save(path)
            bar.update()
        write_movie(paths, options.output, Pace(RATE, 0.0, None))
    print(f"{options.output}: {options.pictures} pictures, drawn by {style.renderer}")


if __name__ == "__main__":
    run(main)
