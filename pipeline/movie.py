"""Stage: pictures -> one movie (H.264, plays everywhere)."""
import argparse
import contextlib
import errno
import os
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

from PIL import Image

from pipeline.base.cli import run
from pipeline.base.errors import UserError
from pipeline.base.files import replacing
from pipeline.base.progress import progress
from pipeline.base.threads import library_threads

QUALITY = 18            # constant rate factor of x264: visually without loss


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


def write_movie(images: list[Path], output: Path, fps: float) -> None:
    """Encode the pictures at ``fps`` frames per second; the movie appears by rename.

    Raises
    ------
    UserError : a picture cannot be read or differs in size from the first.
    """
    width, height = size = read_picture(images[0]).size
    even = (width - width % 2, height - height % 2)     # yuv420p halves the color planes
    with replacing(output) as temporary, encoder(temporary, even, fps, output) as send, \
            progress(len(images), "movie") as bar:
        for path in images:
            picture = read_picture(path)
            if picture.size != size:
                raise UserError(f"{path}: is {picture.width} x {picture.height} pixels, "
                                f"but the first picture is {width} x {height}; run the render stage again")
            send(picture.crop((0, 0, *even)).tobytes())
            bar.update()


def read_picture(path: Path) -> Image.Image:
    """Read a picture in RGB.

    Raises
    ------
    UserError : it is none.
    """
    try:
        with Image.open(path) as image:
            return image.convert("RGB")
    except OSError as error:        # PIL.UnidentifiedImageError is one
        raise UserError(f"{path}: is no picture ({error}); run the render stage again") from error


@contextlib.contextmanager
def encoder(path: Path, size: tuple[int, int], fps: float, name: Path) -> Iterator[Callable[[bytes], object]]:
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
               "-s", f"{size[0]}x{size[1]}", "-r", str(fps), "-i", "-", "-an", "-c:v", "libx264",
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


def main(arguments: list[str] | None = None) -> None:
    """Command line: ``python -m pipeline.movie IMAGES_DIR... --output movie.mp4``."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.movie", description="Make a movie of all pictures.")
    parser.add_argument("folders", nargs="+", type=Path, metavar="IMAGES_DIR", help="folders of pictures")
    parser.add_argument("--output", required=True, type=Path, metavar="movie.mp4", help="movie to write")
    parser.add_argument("--fps", type=float, default=24.0, help="pictures per second (default: %(default)g)")
    options = parser.parse_args(arguments)
    if not 0 < options.fps <= 240:
        raise UserError(f"--fps is {options.fps:g}, but must be above 0 and at most 240")
    write_movie(find_images(options.folders), options.output, options.fps)


if __name__ == "__main__":
    run(main)
