"""Stage: pictures -> a movie (H.264, plays everywhere), and what slides and papers want of it.

The movie lasts 8 s at least: it plays at 1, 0.5, 0.25, 0.2 ... times real time, as its corner says, with every picture
as often as that needs, and the last one stays for a while.
"""
import argparse
import contextlib
import errno
import os
import subprocess
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from PIL import Image, ImageDraw

from pipeline.base.cli import run
from pipeline.base.errors import UserError
from pipeline.base.files import replacing
from pipeline.base.progress import progress
from pipeline.base.threads import library_threads
from pipeline.pictures.marks import FAINT_INK, font, write
from pipeline.pictures.moments import read_picture, write_animation, write_moments
from pipeline.pictures.pace import Pace, pace_of, speed_in_words
from pipeline.scenes.load import load_resolved

QUALITY = 18            # constant rate factor of x264: visually without loss
SMALLEST = 9            # letters, pixels


def find_images(folders: list[Path]) -> list[Path]:
    """All pictures of the folders, in the order of their frame numbers.

    Raises
    ------
    UserError : there is none.
    """
    images = sorted((path for folder in folders for path in Path(folder).glob("frame_*.png")), key=lambda p: p.name)
    if not images:
        raise UserError(f"{', '.join(map(str, folders))}: no pictures (frame_*.png); run the render stage first")
    return images


def write_movie(images: Sequence[Path], output: Path, pace: Pace, corner: str = "") -> None:
    """Encode the pictures; the movie appears by rename.

    Parameters
    ----------
    corner : what is written into that of every picture.

    Raises
    ------
    UserError : a picture cannot be read or differs in size from the first.
    """
    width, height = size = read_picture(images[0]).size
    even = (width - width % 2, height - height % 2)     # yuv420p halves the color planes
    with replacing(output) as temporary, encoder(temporary, even, pace, output) as send, \
            progress(len(images), str(output)) as bar:
        for path in images:
            picture = read_picture(path)
            if picture.size != size:
                raise UserError(f"{path}: is {picture.width} x {picture.height} pixels, "
                                f"but the first picture is {width} x {height}; run the render stage again")
            picture = picture.crop((0, 0, *even))
            write_into_corner(picture, corner)
            send(picture.tobytes())
            bar.update()


@contextlib.contextmanager
def encoder(path: Path, size: tuple[int, int], pace: Pace, name: Path) -> Iterator[Callable[[bytes], object]]:
    """Run ffmpeg and yield a function that takes the bytes of one RGB picture after the other.

    Parameters
    ----------
    path : file to write.
    size : width and height in pixels, even numbers.
    name : file that errors name.

    Raises
    ------
    OSError : ffmpeg could not write or encode the movie.
    """
    import imageio_ffmpeg

    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-v", "error", "-f", "rawvideo", "-pix_fmt", "rgb24",
               "-s", f"{size[0]}x{size[1]}", "-r", f"{pace.rate:.9g}", "-i", "-", "-an",
               "-vf", f"tpad=stop_mode=clone:stop_duration={pace.hold:.9g},fps={pace.repeats * pace.rate:.9g}",
               "-c:v", "libx264", "-preset", "veryfast",
               "-threads", str(library_threads()), "-pix_fmt", "yuv420p", "-crf", str(QUALITY),
               "-movflags", "+faststart", str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE) as ffmpeg:
        try:
            yield ffmpeg.stdin.write
            complaints = ffmpeg.communicate()[1].decode(errors="replace")
        except BrokenPipeError:     # it has ended; why is the next question
            complaints = ffmpeg.stderr.read().decode(errors="replace")
        except BaseException:
            ffmpeg.kill()
            raise
        finally:
            with contextlib.suppress(BrokenPipeError):
                ffmpeg.stdin.close()
    if ffmpeg.returncode:
        if os.strerror(errno.ENOSPC) in complaints:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        first = (complaints.strip().splitlines() or [f"exit code {ffmpeg.returncode}"])[0]
        raise OSError(f"{name}: ffmpeg could not encode the movie ({first})")


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
    parser = argparse.ArgumentParser(prog="python -m pipeline.movie", description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", nargs="+", type=Path, metavar="IMAGES_DIR", help="folders of pictures")
    parser.add_argument("--output", required=True, type=Path, metavar="movie.mp4", help="movie to write")
    parser.add_argument("--scene", type=Path, metavar="scene.json",
                        help="resolved scene, which knows the time between pictures; without it no speed is told")
    parser.add_argument("--fps", type=float, help="pictures per second, each shown once, the last one too "
                                                  "(default: as the movie needs to last 8 s)")
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
    interval = scene.output.frame_interval if scene else None
    pace = pace_of(len(images), interval)
    if options.fps is not None:
        pace = Pace(options.fps, 0.0, options.fps * interval if interval else None)
    speed = speed_in_words(pace.speed, scene.output.second_means) if scene else ""
    write_movie(images, options.output, pace, speed)
    if options.animation:
        write_animation(images, options.animation, pace, lambda picture: write_into_corner(picture, speed))
    if options.poster:
        with replacing(options.poster) as partial:
            read_picture(images[-1]).save(partial)
    if options.moments:
        write_moments(images, options.moments)
    print(f"{options.output}: {len(images)} pictures, {pace.duration(len(images)):.3g} s{speed and f', {speed}'}")


if __name__ == "__main__":
    run(main)
