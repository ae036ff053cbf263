"""Scripts of pages: their own, and the libraries that a page holds, so that it asks no network for anything."""
import json
from pathlib import Path

from markupsafe import Markup

from pipeline.base.packages import Package

HERE = Path(__file__).parent
VENDOR = HERE / "vendor"
LIBRARIES = (Package("three.js", "0.180.0", "MIT"), Package("uPlot", "1.6.32", "MIT"))  # of vendor

# Browsers refuse whatever the page would ask others for.
POLICY = Markup('<meta http-equiv="Content-Security-Policy" content="default-src \'none\'; img-src data:; '
                'media-src data: blob:; style-src \'unsafe-inline\'; script-src \'unsafe-inline\'">\n'
                '<link rel="icon" href="data:,">')


def library(file: str, style: str = "") -> Markup:
    """Return a library of ``vendor``, with its style and its license, as a page holds it."""
    license = Markup("<!--\n{}\n-->\n").format(Markup(_text(VENDOR / f"LICENSE.{file.partition('.')[0]}")))
    sheet = Markup("<style>{}</style>\n").format(Markup(_text(VENDOR / style))) if style else Markup()
    return license + sheet + Markup("<script>{}</script>").format(Markup(_text(VENDOR / file)))


def called(file: str, function: str, root: str, values: object) -> Markup:
    """Return a script of this folder and its call with an element and values; no text in them can end the script."""
    text = json.dumps(values, separators=(",", ":"), ensure_ascii=True).replace("<", "\\u003c")
    return Markup(f'<script>\n{_text(HERE / file)}{function}(document.querySelector("{root}"), {text});\n</script>')


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8")
