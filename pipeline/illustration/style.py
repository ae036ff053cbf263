"""How illustrations are drawn, and the options of the command line for it."""
import argparse
import dataclasses
from pathlib import Path

from pipeline.base.errors import UserError
from pipeline.base.threads import checked_threads
from pipeline.illustration import mitsuba_picture
from pipeline.illustration.looks import LOOKS

RENDERERS = ("mitsuba", "pyvista")
LETTERS = ("names", "legend", "none")


@dataclasses.dataclass(frozen=True)
class Style:
    """How an illustration is drawn.

    Attributes
    ----------
    size : width and height, pixels.
    samples : paths of light through every pixel, of Mitsuba.
    letters : "names" with lines to what they name, "legend" of the liquids, which stays where it is, or "none".
    """

    renderer: str
    look: str = "illustration"
    size: tuple[int, int] = (1280, 720)
    samples: int = 4
    threads: int = 1
    letters: str = "names"


def chosen_renderer(wanted: str | None) -> str:
    """Return the renderer that is asked for; without a wish Mitsuba, and where it cannot draw, said, PyVista.

    Raises
    ------
    UserError : Mitsuba is asked for and cannot draw here.
    """
    if wanted == "pyvista":
        return wanted
    reason = mitsuba_picture.why_not()
    if not reason:
        return "mitsuba"
    if wanted == "mitsuba":
        raise UserError(f'--renderer is mitsuba, which {reason}; install it with pip install '
                        '"eye-oil-pipeline[illustration]", or draw with --renderer pyvista')
    print(f"Mitsuba {reason}: drawn by PyVista")
    return "pyvista"


def size_of(text: str) -> tuple[int, int]:
    """Width and height of "1280x720"."""
    width, _, height = text.partition("x")
    if not (width.isdecimal() and height.isdecimal() and 16 <= int(width) <= 8192 and 16 <= int(height) <= 8192):
        raise argparse.ArgumentTypeError(f"is {text}, but must be such as 1280x720, 16 to 8192 pixels each")
    return int(width), int(height)


def add_files(parser: argparse.ArgumentParser) -> None:
    """Add what an illustration is drawn from to a command line."""
    parser.add_argument("scene", type=Path, metavar="scene.json", help="resolved scene")
    parser.add_argument("eye", type=Path, metavar="eye.vtp", help="surface of the cavity")
    parser.add_argument("frames", type=Path, metavar="FRAMES_DIR", help="folder of frames")
    parser.add_argument("surfaces", type=Path, metavar="SURFACES_DIR", help="folder of the reconstruct stage")


def add_style(parser: argparse.ArgumentParser, size: str, samples: int, letters: str) -> None:
    """Add the options of a :class:`Style` to a command line, with its defaults."""
    parser.add_argument("--size", type=size_of, default=size_of(size), metavar="WIDTHxHEIGHT",
                        help=f"pixels, 16 to 8192 each (default: {size})")
    parser.add_argument("--look", choices=sorted(LOOKS), default="illustration",
                        help="illustration: ivory oil and blue water, both clear (default); "
                             "paper: white oil, as Song et al.; glass: the oil alone, with its index of refraction")
    parser.add_argument("--renderer", choices=RENDERERS,
                        help="default: mitsuba where it is installed, else pyvista")
    parser.add_argument("--samples", type=int, metavar="N",
                        help=f"paths of light through every pixel, of mitsuba (default: {samples}, as look paper "
                             f"{LOOKS['paper'].noise * samples}, as glass {LOOKS['glass'].noise * samples})")
    parser.add_argument("--letters", choices=LETTERS, default=letters,
                        help=f"names with lines to what they name, a legend of the liquids, or none "
                             f"(default: {letters})")
    parser.add_argument("--threads", type=int, default=0, metavar="N", help="default: as many as are useful")


def style_of(options: argparse.Namespace, samples: int) -> Style:
    """Return the style that a command line asks for; ``samples`` is the default of the first look.

    Raises
    ------
    UserError : there is no such style here.
    """
    if options.samples is None:
        options.samples = LOOKS[options.look].noise * samples
    if options.samples < 1:
        raise UserError(f"--samples is {options.samples}, but must be at least 1")
    return Style(chosen_renderer(options.renderer), options.look, options.size, options.samples,
                 checked_threads(options.threads, "--threads"), options.letters)
