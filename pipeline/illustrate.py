"""Stage: surfaces of a segment -> an illustration of every frame, for a movie that patients and students understand.

    snakemake -j2 outputs/tamponade/draft/film.mp4

This takes about as long as the simulation at draft, so it runs on request only, and says how long when it starts. One
that was stopped goes on after the last picture that it has drawn.
"""
import itertools
import json
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from pipeline.base.checksum import checksum_at_end
from pipeline.base.cli import run, stage_parser
from pipeline.base.errors import UserError
from pipeline.base.files import replacing, write_text
from pipeline.base.frame_files import find_frames, read_frame
from pipeline.base.progress import progress
from pipeline.base.threads import library_threads
from pipeline.base.vtk_files import read_vtk
from pipeline.illustration.illustrator import Illustrator, oils_of
from pipeline.illustration.style import Style, add_files, add_style, style_of
from pipeline.scenes.load import load_resolved
from pipeline.scenes.model import Scene
from pipeline.surfaces.surface_files import read_surfaces

SAMPLES = 1
DONE_WITH = "drawn_with.json"       # style of the pictures that are there already
# Of one core of an AMD EPYC, measured: s per picture and for every path through a pixel, at 960 x 540 pixels.
OF_PICTURE, OF_PATH, PIXELS = 2.2, 1.9, 960 * 540


def illustrate(scene: Scene, eye, frames: Path, surfaces: Path, output: Path, last: Path, style: Style,
               depends: str = "") -> None:
    """Draw every frame of a folder; the folder of pictures appears by rename.

    Parameters
    ----------
    last : folder of the frames whose last one decides along which plane the eye is opened.
    depends : pictures drawn with another one are drawn again, as are those of other frames or surfaces.
    """
    begun = output.with_name(f"{output.name}.begun")
    shown = [path for folder in (frames, surfaces) for path in sorted(folder.glob("frame_*.vt?"))]
    wanted = json.dumps([repr(style), depends, *map(checksum_at_end, [*shown, *find_frames(last)[-1:]])])
    mark = begun / DONE_WITH
    if not mark.is_file() or mark.read_text(encoding="utf-8") != wanted:
        for path in begun.glob("*"):
            path.unlink()
        begun.mkdir(parents=True, exist_ok=True)
        write_text(mark, wanted)
    paths = find_frames(frames)
    wanting = [path for path in paths if not _picture_of(path, begun).is_file()]
    with progress(len(paths), f"{scene.name}: illustrate {frames.name}") as bar:
        bar.update(len(paths) - len(wanting))
        if wanting:
            gravity = read_frame(find_frames(last)[-1]).gravity
            _draw(wanting, Illustrator(scene, eye, gravity, style, film=True), surfaces, begun, bar.update)
    mark.unlink()
    os.replace(begun, output)


def expected_minutes(scene: Scene, style: Style) -> float:
    """How long all pictures of a scene take by Mitsuba, min."""
    of_one = (OF_PICTURE + style.samples * OF_PATH) * style.size[0] * style.size[1] / PIXELS
    return scene.frame_count * of_one / (style.threads or library_threads()) / 60.0


def _picture_of(frame: Path, folder: Path) -> Path:
    return folder / f"{frame.stem}.png"


def _draw(paths: list[Path], illustrator: Illustrator, surfaces: Path, folder: Path, done) -> None:
    """Draw frames into a folder. While one is traced the next one is prepared beside it, and the last one written."""
    def prepared(path: Path):
        frame = read_frame(path)
        return frame, illustrator.liquids(frame, read_surfaces(surfaces, path.stem, oils_of(illustrator.scene)))

    def write(picture, path: Path, frame, liquids) -> None:
        with replacing(_picture_of(path, folder)) as partial:
            illustrator.with_words(picture, frame, liquids).save(partial, "PNG")
        done()

    with ThreadPoolExecutor(1) as beside:
        following, written = beside.submit(prepared, paths[0]), None
        for path, after in itertools.zip_longest(paths, paths[1:]):
            frame, liquids = following.result()
            if after is not None:
                following = beside.submit(prepared, after)
            picture = illustrator.picture(frame, liquids)
            if written is not None:
                written.result()
            written = beside.submit(write, picture, path, frame, liquids)
        written.result()


def main(arguments: list[str] | None = None) -> None:
    """Command line."""
    parser = stage_parser("illustrate", __doc__)
    add_files(parser)
    parser.add_argument("--output", required=True, type=Path, metavar="DIR", help="folder of pictures to write")
    parser.add_argument("--last", type=Path, metavar="FRAMES_DIR",
                        help="frames of the last segment, which decide along which plane the eye is opened "
                             "(default: those that are drawn)")
    parser.add_argument("--depends", default="", help="pictures drawn with another one are drawn again")
    add_style(parser, "960x540", SAMPLES, "legend")
    options = parser.parse_args(arguments)
    style = style_of(options, SAMPLES)
    scene = load_resolved(options.scene)
    if scene.container is not None:
        raise UserError(f"{scene.name}: has no eye to illustrate; its movie is movie.mp4")
    if options.output.exists():
        raise UserError(f"{options.output}: is there already; remove it or name another folder with --output")
    if style.renderer == "mitsuba":
        print(f"{scene.name}: the {scene.frame_count} pictures of the film take about "
              f"{max(1, round(expected_minutes(scene, style)))} min; what is drawn is kept", flush=True)
    illustrate(scene, read_vtk(options.eye), options.frames, options.surfaces, options.output,
               options.last or options.frames, style, options.depends)
    print(f"{options.output}: drawn by {style.renderer}")


if __name__ == "__main__":
    run(main)
