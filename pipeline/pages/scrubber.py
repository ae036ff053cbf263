"""The pictures of a run, small enough for a page."""
import base64
import io

from PIL import Image

from pipeline.pictures.marks import clock
from pipeline.pictures.moments import evenly_chosen, read_picture, scaled
from pipeline.runs.run_folder import RunFolder

MOST_PICTURES = 120
MOST_BYTES = 2_500_000
WIDTHS = (800, 640, 480, 320)
QUALITY = 80  # of WebP, percent
EFFORT = 2  # 0 to 6; 4, the default, takes more than twice as long for files 3 % smaller


def pictures_over_time(run: RunFolder) -> list[tuple[str, str]]:
    """Return time in words and picture as a data URL, for all frames or for some of them at equal times."""
    chosen = evenly_chosen(run.pictures, min(MOST_PICTURES, len(run.pictures)))
    pictures = [read_picture(path) for path in chosen]
    for width in WIDTHS:
        files = [webp(scaled(picture, width)) for picture in pictures]
        if sum(map(len, files)) <= MOST_BYTES:
            break
    times = (clock(run.time_of(path), run.scene.output.second_means) for path in chosen)
    return [(time, data_url(file, "image/webp")) for time, file in zip(times, files, strict=True)]


def webp(picture: Image.Image) -> bytes:
    """Return a picture as the bytes of a WebP file."""
    file = io.BytesIO()
    picture.save(file, "WEBP", quality=QUALITY, method=EFFORT)
    return file.getvalue()


def data_url(file: bytes, kind: str) -> str:
    """Return a file as an address that holds it; kind is its media type."""
    return f"data:{kind};base64,{base64.b64encode(file).decode()}"
