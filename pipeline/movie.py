"""Stage: pictures -> a movie (H.264, plays everywhere), and what slides and papers want of it.

The movie shows 24 pictures per second, and the last one stays for a while. Where there are so few that it would be over
in less than 3 s, it plays at 0.5, 0.25, 0.2, 0.1 ... times real time. Its corner says how fast.
"""
from pathlib import Path

from PIL import Image, ImageDraw

from pipeline.base.cli import run, stage_parser
from pipeline.base.errors import UserError
from pipeline.base.files import replacing
from pipeline.base.sequences import PICTURES_AGAIN, in_sequence
from pipeline.pictures.marks import FAINT_INK, font, write
from pipeline.pictures.moments import read_picture, write_animation, write_moments
from pipeline.pictures.movie_file import write_movie
from pipeline.pictures.pace import Pace, pace_of, speed_in_words
from pipeline.runs.segments import check_segments
from pipeline.scenes.load import load_resolved

SMALLEST = 9            # letters, pixels


def find_images(folders: list[Path]) -> list[Path]:
    """All pictures of the folders, in the order of their frame numbers.

    Raises
    ------
    UserError : there is none.
    """
    folders = list(folders)
    images = in_sequence((path for folder in folders for path in Path(folder).glob("frame_*.png")), PICTURES_AGAIN)
    if not images:
        raise UserError(f"{', '.join(map(str, folders))}: no pictures (frame_*.png); run the render stage first")
    return images


def write_into_corner(picture: Image.Image, text: str) -> None:
    """Write on white in the lower right corner of a picture; nothing without a text."""
    if not text:
        return
    draw, size = ImageDraw.Draw(picture), max(round(0.026 * picture.height), SMALLEST)
    right, bottom = picture.width - 0.5 * size, picture.height - 0.5 * size
    box = draw.textbbox((right, bottom), text, font=font(size), anchor="rs")
    draw.rectangle([box[0] - 0.3 * size, box[1] - 0.3 * size, *picture.size], fill=(255, 255, 255))
    write(draw, (right, bottom), text, size, color=FAINT_INK, anchor="rs")


def main(arguments: list[str] | None = None) -> None:
    """Command line: ``python -m pipeline.movie IMAGES_DIR... --scene scene.json --output movie.mp4``."""
    parser = stage_parser("movie", __doc__)
    parser.add_argument("folders", nargs="+", type=Path, metavar="IMAGES_DIR", help="folders of pictures")
    parser.add_argument("--output", required=True, type=Path, metavar="movie.mp4", help="movie to write")
    parser.add_argument("--scene", type=Path, metavar="scene.json",
                        help="resolved scene, which knows the time between pictures; without it no speed is told")
    parser.add_argument("--fps", type=float, help="pictures per second, each shown once, the last one too "
                                                  "(default: 24, or fewer where there are few)")
    parser.add_argument("--animation", type=Path, metavar="FILE.gif",
                        help="the movie for slides, at most 4 MiB (.gif or .webp)")
    parser.add_argument("--poster", type=Path, metavar="FILE.png", help="the last picture")
    parser.add_argument("--moments", type=Path, metavar="FILE.png", help="eight moments on one sheet")
    options = parser.parse_args(arguments)
    if options.fps is not None and not 0 < options.fps <= 240:
        raise UserError(f"--fps is {options.fps:g}, but must be above 0 and at most 240")
    if options.animation is not None and options.animation.suffix not in (".gif", ".webp"):
        raise UserError(f"--animation is {options.animation}, but must end in .gif or .webp")
    images = find_images(options.folders)
    scene = load_resolved(options.scene) if options.scene else None
    if scene:
        check_segments(scene, images, PICTURES_AGAIN)
    interval = scene.output.frame_interval if scene else None
    pace = pace_of(len(images), interval)
    if options.fps is not None:
        pace = Pace(options.fps, 0.0, options.fps * interval if interval else None)
    second_means = scene.output.second_means if scene else None
    speed = speed_in_words(pace.speed, second_means) if scene else ""

    def mark(picture: Image.Image) -> None:
        write_into_corner(picture, speed)

    write_movie(images, options.output, pace, mark)
    if options.animation:
        write_animation(images, options.animation, pace, mark)
    if options.poster:
        with replacing(options.poster) as partial:
            read_picture(images[-1]).save(partial)
    if options.moments:
        write_moments(images, options.moments)
    print(f"{options.output}: {pace.in_words(len(images), second_means)}")


if __name__ == "__main__":
    run(main)
