"""Colors that mean the same everywhere: of the liquids in an eye, and of curves.

Oil is ivory, aqueous is blue, gas is nearly white: people with any of the three kinds of color blindness tell oil and
gas from aqueous, and so does a gray print. ``config/materials.yaml`` says the same of the liquids.
"""
import numpy as np

OIL, AQUEOUS, GAS = "#f4e6bd", "#2878be", "#f1edf9"
# Those of Okabe and Ito, told apart by people with any of the three kinds of color blindness.
COLORS = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#000000")
DASHES = ("-", "--", "-.", ":")


def rgb(color: str) -> np.ndarray:
    """Red, green and blue (3,) uint8 of ``#rrggbb``."""
    return np.array([int(color[k:k + 2], 16) for k in (1, 3, 5)], np.uint8)


def ramp(first: str, last: str, count: int) -> np.ndarray:
    """Colors (count, 3) uint8 at equal steps for the eye from one color to another: a straight line in CIE Lab."""
    from skimage.color import lab2rgb, rgb2lab

    ends = rgb2lab(np.stack([rgb(first), rgb(last)])[None] / 255.0)[0]
    share = np.linspace(0.0, 1.0, count)[:, None]
    return (lab2rgb(((1.0 - share) * ends[0] + share * ends[1])[None])[0] * 255.0).round().astype(np.uint8)


def curve_style(number: int) -> dict[str, str]:
    """Return color and dashes of a curve, counted from 0: neighbors in a legend differ in both."""
    return {"color": COLORS[number % len(COLORS)], "linestyle": DASHES[number % len(DASHES)]}
