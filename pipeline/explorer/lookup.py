"""Shapes between those of a table, as the page finds them too (``model.js``); a test holds both to the same numbers.

Directions: an eye that is its own mirror image, left and right, up and down, needs a quarter of them. Around the axis
the wall differs from a body of revolution as the cosine and the sine of twice the azimuth, which three azimuths tell.
Equations: docs/methods/equilibrium.md.
"""
import dataclasses

import numpy as np

from pipeline.explorer.cases import AZIMUTHS, FILLS, LATITUDES, MERIDIANS, TILTS
from pipeline.explorer.table import SHARE_STEP, SHIFT_STEP, Table, gap_of, margin_of, view_of


@dataclasses.dataclass(frozen=True)
class Looked:
    """What a table says of a direction and a fill.

    Attributes
    ----------
    margin, gap : (latitudes, meridians), m, in the frame of the eye. low, high : (4,) of shares. shift : (2,), m.
    view : (3,), m, the viewpoint of the gap, in the frame of the eye.
    """

    margin: np.ndarray
    gap: np.ndarray
    view: np.ndarray
    low: np.ndarray
    high: np.ndarray
    shift: np.ndarray


def look_up(table: Table, toward: np.ndarray, fill: float) -> Looked | None:
    """Return what lies between the shapes around a direction (3,) and a fill; None where one of them was not found."""
    meridian = np.degrees(np.arctan2(toward[0], toward[1])) % 360.0
    tilt = np.degrees(np.arccos(np.clip(-toward[2] / np.linalg.norm(toward), -1.0, 1.0)))
    azimuth = min(meridian % 180.0, 180.0 - meridian % 180.0)
    margin, gap = np.zeros((2, len(LATITUDES), len(MERIDIANS)))
    doubt, view = np.zeros(10), np.zeros(3)
    for one, of_tilt in _between(tilt, TILTS):
        for two, of_azimuth in zip(range(len(AZIMUTHS)), _of_azimuths(azimuth), strict=True):
            for three, of_fill in _between(_unfilled(fill), _unfilled(np.array(FILLS))):
                weight = of_tilt * of_azimuth * of_fill
                if weight == 0.0:
                    continue
                if not table.margin[one, two, three].any():
                    return None
                margin += weight * table.margin[one, two, three]
                gap += weight * gap_of(table.gap[one, two, three])
                doubt += weight * table.doubt[one, two, three]
                view += weight * view_of(table.view[one, two, three])
    if meridian % 180.0 > 90.0:
        margin, gap = (field[:, -np.arange(len(MERIDIANS))] for field in (margin, gap))
        view[1] = -view[1]
    doubt = np.maximum(doubt, 0.0)
    low, high = SHARE_STEP * doubt[:4], SHARE_STEP * doubt[4:8]
    if toward[1] < 0.0:  # the tables are of a tamponade that goes up
        low, high = low[[0, 2, 1, 3]], high[[0, 2, 1, 3]]
    sine, cosine = np.sin(np.radians(meridian)), np.cos(np.radians(meridian))
    point = np.array([sine * view[0] + cosine * view[1], cosine * view[0] - sine * view[1], view[2]])
    return Looked(_turned(margin_of(margin), meridian), _turned(gap, meridian), point, low, high,
                  SHIFT_STEP * doubt[8:])


def _unfilled(fill):
    """What fills are interpolated over: about the width of what is left to the aqueous."""
    return -np.sqrt(1.0 - fill)


def _between(value: float, nodes: np.ndarray) -> list[tuple[int, float]]:
    """The two nodes around a value, and their weights."""
    index = int(np.clip(np.searchsorted(nodes, value, side="right") - 1, 0, len(nodes) - 2))
    share = float(np.clip((value - nodes[index]) / (nodes[index + 1] - nodes[index]), 0.0, 1.0))
    return [(index, 1.0 - share), (index + 1, share)]


def _of_azimuths(azimuth: float) -> np.ndarray:
    """Weights (3,) of ``AZIMUTHS``."""
    cosine, sine = np.cos(np.radians(2.0 * azimuth)), np.sin(np.radians(2.0 * azimuth))
    return np.array([0.5 + 0.5 * cosine - 0.5 * sine, sine, 0.5 - 0.5 * cosine - 0.5 * sine])  # (R10)


def _turned(field: np.ndarray, meridian: float) -> np.ndarray:
    """A field whose meridians count from one, degrees, with meridians that count from 12 o'clock."""
    place = (MERIDIANS - meridian) / (MERIDIANS[1] - MERIDIANS[0])
    column = np.floor(place).astype(int)
    share = place - column
    return (1.0 - share) * field[:, column % len(MERIDIANS)] + share * field[:, (column + 1) % len(MERIDIANS)]
