"""How illustrations are drawn, and the options of the command line for it."""
import argparse
import dataclasses

from pipeline.base.errors import UserError
from pipeline.base.threads import checked_threads
from pipeline.illustration import mitsuba_picture
from pipeline.illustration.looks import LOOKS

RENDERERS = ("mitsuba", "pyvista")


@dataclasses.dataclass(frozen=True)
class Style:
    """How an illustration is drawn: its renderer, look, size in pixels, paths of light per pixel, and threads."""

    renderer: str
    look: str = "illustration"
    size: tuple[int, int] = (1280, 720)
    samples: int = 4
    threads: int = 1
    letters: bool = True


def chosen_renderer(wanted: str | None) -> str:
    """Return the renderer that is asked for; without a wish Mitsuba where it is installed, else PyVista.

    Raises
    ------
    UserError : Mitsuba is asked for and not installed.
    """
    installed = mitsuba_picture.available()
    if wanted == "mitsuba" and not installed:
        raise UserError('--renderer is mitsuba, which is not installed; install it with pip install '
                        '"eye-oil-pipeline[illustration]", or draw with --renderer pyvista')
    return wanted or ("mitsuba" if installed else "pyvista")


def size_of(text: str) -> tuple[int, int]:
    """Width and height of "1280x720"."""
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal() and 16 <= int(width) <= 8192 and 16 <= int(height) <= 8192):
        raise argparse.ArgumentTypeError(f"is {text}, but must be such as 1280x720, 16 to 8192 pixels each")
    return int(width), int(height)


def add_style(parser: argparse.ArgumentParser, size: str, samples: int) -> None:
    """Add the options of a :class:`Style` to a command line."""
    parser.add_argument("--size", type=size_of, default=size_of(size), metavar="WIDTHxHEIGHT",
                        help=f"pixels, 16 to 8192 each (default: {size})")
    parser.add_argument("--look", choices=sorted(LOOKS), default="illustration",
                        help="illustration: ivory oil and blue water, both clear (default); "
                             "paper: white oil, as Song et al.")
    parser.add_argument("--renderer", choices=RENDERERS,
                        help="default: mitsuba where it is installed, else pyvista")
    parser.add_argument("--samples", type=int, default=samples, metavar="N",
                        help=f"paths of light through every pixel, of mitsuba (default: {samples}): more than ten "
                             "times as many change hardly anything after the denoiser")
    parser.add_argument("--without-names", action="store_true", help="no words in the picture")
    parser.add_argument("--threads", type=int, default=0, metavar="N", help="default: as many as are useful")


def style_of(options: argparse.Namespace) -> Style:
    """Return the style that a command line asks for.

    Raises
    ------
    UserError : there is no such style here.
    """
    if options.samples < 1:
        raise UserError(f"--samples is {options.samples}, but must be at least 1")
    return Style(chosen_renderer(options.renderer), options.look, options.size, options.samples,
                 checked_threads(options.threads, "--threads"), not options.without_names)
