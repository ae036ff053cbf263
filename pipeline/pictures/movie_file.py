"""A movie file that plays everywhere: H.264 (High, 4:2:0) in the colors of BT.709, its index in front."""
import contextlib
import errno
import os
import subprocess
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from PIL import Image

from pipeline.base.errors import UserError
from pipeline.base.files import replacing
from pipeline.base.progress import progress
from pipeline.base.threads import library_threads
from pipeline.pictures.moments import read_picture
from pipeline.pictures.pace import Pace

QUALITY = "18"          # constant rate factor of x264: visually without loss
# What players assume of movies from 720 lines on; without a word on it some take the older BT.601, and colors shift.
BT709 = ("scale=out_color_matrix=bt709:out_range=tv:flags=accurate_rnd+full_chroma_int,format=yuv420p,"
         "setparams=colorspace=bt709:color_primaries=bt709:color_trc=bt709:range=tv")
H264 = ("-c:v", "libx264", "-profile:v", "high", "-movflags", "+faststart")


def write_movie(images: Sequence[Path], output: Path, pace: Pace,
                mark: Callable[[Image.Image], object] | None = None) -> None:
    """Encode pictures of one size as a movie, which appears by rename.

    Width and height become even by leaving out the last column or row: the colors of four pixels are kept together.

    Parameters
    ----------
    images : files of the pictures, in order; each is read when its turn comes.
    pace : how fast they follow each other.
    mark : draws on every picture, RGB and of even size.

    Raises
    ------
    UserError : a picture cannot be read or differs in size from the first.
    OSError : ffmpeg could not write or encode the movie.
    """
    width, height = size = read_picture(images[0]).size
    even = (width - width % 2, height - height % 2)
    with replacing(output) as temporary, encoder(temporary, even, pace, output) as send, \
            progress(len(images), str(output)) as bar:
        for path in images:
            picture = read_picture(path)
            if picture.size != size:
                raise UserError(f"{path}: is {picture.width} x {picture.height} pixels, "
                                f"but the first picture is {width} x {height}; run the render stage again")
            picture = picture.crop((0, 0, *even))
            if mark is not None:
                mark(picture)
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
               "-vf", f"tpad=stop_mode=clone:stop_duration={pace.hold:.9g},fps={pace.repeats * pace.rate:.9g},{BT709}",
               *H264, "-preset", "veryfast", "-crf", QUALITY, "-threads", str(library_threads()), str(path)]
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
