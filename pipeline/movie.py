"""Stage: pictures -> one movie (H.264, plays everywhere)."""
import argparse
from pathlib import Path

from pipeline.cli import run
from pipeline.errors import UserError
from pipeline.files import replacing
from pipeline.progress import progress

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
    import imageio_ffmpeg
    import numpy as np
    from PIL import Image, UnidentifiedImageError

    with Image.open(images[0]) as first:
        size = first.size
    even = tuple(length - length % 2 for length in size)       # yuv420p halves the color planes
    with replacing(output) as temporary, progress(len(images), "movie") as bar:
        writer = imageio_ffmpeg.write_frames(
            str(temporary), even, fps=fps, codec="libx264", pix_fmt_out="yuv420p", macro_block_size=1,
            quality=None, output_params=["-crf", str(QUALITY), "-movflags", "+faststart"], ffmpeg_log_level="error")
        writer.send(None)
        try:
            for path in images:
                try:
                    with Image.open(path) as image:
                        pixels = np.ascontiguousarray(image.convert("RGB"))
                except (UnidentifiedImageError, OSError) as error:
                    raise UserError(f"{path}: is no picture ({error}); run the render stage again") from error
                if pixels.shape[1::-1] != size:
                    raise UserError(f"{path}: is {pixels.shape[1]} x {pixels.shape[0]} pixels, "
                                    f"but the first picture is {size[0]} x {size[1]}; run the render stage again")
                writer.send(np.ascontiguousarray(pixels[:even[1], :even[0]]))
                bar.update()
        finally:
            writer.close()


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
