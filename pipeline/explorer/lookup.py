"""Shapes between those of tables, as the page finds them too (``model.js``); a test holds both to the same numbers.

Directions: an eye that is its own mirror image, left and right, up and down, needs a quarter of them. Around the axis
the wall differs from a body of revolution as the cosine of twice the azimuth, which two azimuths tell.
Equations: docs/methods/equilibrium.md.
"""
import dataclasses
from collections.abc import Mapping

import numpy as np

from pipeline.explorer.cases import FILLS, LATITUDES, MERIDIANS, TILTS, spread
from pipeline.explorer.interface import SIZE
from pipeline.explorer.table import SHARE_STEP, SHIFT_STEP, Table, depth_of, margin_of, mirrored
from pipeline.scenes.eye_shape import HORIZONTAL_DIAMETER, VERTICAL_DIAMETER

OVAL = (HORIZONTAL_DIAMETER / VERTICAL_DIAMETER) ** 2   # of the equator of eyes of any length


@dataclasses.dataclass(frozen=True)
class Looked:
    """What tables say of an eye, a direction and a fill.

    Attributes
    ----------
    margin : (latitudes, meridians), m, in the frame of the eye. depth : (*SIZE), m, of the lattice of the eye along
    meridian : degrees, that the tamponade goes to. low, high : (4,) of shares. shift : (2,), m.
    """

    margin: np.ndarray
    depth: np.ndarray
    meridian: float
    low: np.ndarray
    high: np.ndarray
    shift: np.ndarray


def look_up(tables: Mapping[str, Table], length: float, toward: np.ndarray, fill: float) -> Looked | None:
    """Return what lies between the shapes around an eye, a direction and a fill; None where one was not found.

    Parameters
    ----------
    tables : of one tamponade, by the length of the eye in mm.
    length : of the eye, mm. toward : (3,), where the tamponade goes. fill : share of the cavity.
    """
    meridian = float(np.degrees(np.arctan2(toward[0], toward[1])) % 360.0)
    tilt = np.degrees(np.arccos(np.clip(-toward[2] / np.linalg.norm(toward), -1.0, 1.0)))
    margin, depth, doubt = np.zeros((len(LATITUDES), len(MERIDIANS))), np.zeros(SIZE), np.zeros(10)
    names = sorted(tables, key=float)
    cosine = np.cos(np.radians(meridian)) ** 2
    for eye, of_eye in _between(length, np.array(names, float)):
        for one, of_tilt in _between(tilt, TILTS):
            for two, of_azimuth in ((0, cosine), (1, 1.0 - cosine)):  # (R10)
                for three, of_fill in _between(spread(fill), spread(np.array(FILLS))):
                    weight, table = of_eye * of_tilt * of_azimuth * of_fill, tables[names[eye]]
                    if weight == 0.0:
                        continue
                    if not table.margin[one, two, three].any():
                        return None
                    margin += weight * mirrored(margin_of(table.margin[one, two, three]))
                    depth += weight * depth_of(table.depth[one, two, three])
                    doubt += weight * table.doubt[one, two, three]
    low, high = SHARE_STEP * doubt[:4], SHARE_STEP * doubt[4:8]
    if toward[1] < 0.0:  # the tables are of a tamponade that goes up
        low, high = low[[0, 2, 1, 3]], high[[0, 2, 1, 3]]
    return Looked(_turned(margin, mirror_of(meridian)), depth, meridian, low, high, SHIFT_STEP * doubt[8:])


def mirror_of(meridian: float) -> float:
    """Meridian, degrees, to whose sides a contact line lies alike, where a tamponade goes to a meridian. (R12)"""
    around = np.radians(meridian)
    return float(np.degrees(np.arctan2(OVAL * np.sin(around), np.cos(around))))


def _between(value: float, nodes: np.ndarray) -> list[tuple[int, float]]:
    """The two nodes around a value, and their weights."""
    if len(nodes) < 2:
        return [(0, 1.0)]
    index = int(np.clip(np.searchsorted(nodes, value, side="right") - 1, 0, len(nodes) - 2))
    share = float(np.clip((value - nodes[index]) / (nodes[index + 1] - nodes[index]), 0.0, 1.0))
    return [(index, 1.0 - share), (index + 1, share)]


def _turned(field: np.ndarray, meridian: float) -> np.ndarray:
    """A field whose meridians count from one, degrees, with meridians that count from 12 o'clock."""
    place = (MERIDIANS - meridian) / (MERIDIANS[1] - MERIDIANS[0])
    column = np.floor(place).astype(int)
    share = place - column
    return (1.0 - share) * field[:, column % len(MERIDIANS)] + share * field[:, (column + 1) % len(MERIDIANS)]
