"""The movie of a run for its page: as it is, or smaller where it is large."""
import subprocess
import tempfile
from pathlib import Path

from pipeline.pictures.movie_file import H264

MOST_BYTES = 4_000_000
WIDTH = 960  # pixels of a smaller copy
MARGIN = 0.8  # of the rate that the bytes allow: the encoder may exceed it


def movie_within(path: Path, most: int = MOST_BYTES) -> bytes:
    """Return a movie in so many bytes at most, encoded again where it has more."""
    if path.stat().st_size <= most:
        return path.read_bytes()
    import imageio_ffmpeg

    reader = imageio_ffmpeg.read_frames(path)
    seconds = next(reader)["duration"]
    reader.close()
    rate = str(int(MARGIN * 8 * most / seconds))
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / path.name
        subprocess.run([imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-i", str(path), "-an", "-vf",
                        f"scale='min({WIDTH},iw)':-2", *H264, "-b:v", rate, "-maxrate", rate, "-bufsize", rate,
                        str(copy)],
                       check=True, stdin=subprocess.DEVNULL)
        return copy.read_bytes()
