"""At which fill oil touches which part of the retina: one table for an eye, an oil and a posture, and its files.

Of all shapes that are found at a fill of ``FILLS`` the one with least energy counts; with the others the answers are
less certain.
Equations: docs/methods/equilibrium.md.
"""
import csv
import dataclasses
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from pipeline.base.errors import UserError
from pipeline.base.files import write_text
from pipeline.base.tables import csv_of
from pipeline.cavity.rays import interpolation
from pipeline.equilibrium.contact import shares
from pipeline.equilibrium.least import Resting
from pipeline.equilibrium.rest import Liquids
from pipeline.equilibrium.star_cavity import DRAFT
from pipeline.scenes.retina import ORA, direction

FILLS = (0.5, 0.6, 0.7, 0.75, 0.8, 0.825, 0.85, 0.875, 0.9, 0.92, 0.94, 0.96, 0.975, 0.985, 0.995)
MERIDIANS, LATITUDES = np.arange(0.0, 360.0, 15.0), np.append(np.arange(0.0, ORA, 5.0), ORA)
SHARES = ("wall", "retina", "superior", "inferior", "macula")
FARTHEST = 4e-3     # m: farther from the contact line distances say nothing on when it comes
TOUCH, TOUCH_BY_BOTH, COVERED = "touch.csv", "touch_by_both.csv", "shares.csv"
KEYS = ("density_difference [kg/m3]", "tension [mN/m]", "contact_angle [deg]", "posture")
Key = tuple[str, str, str, str]


@dataclasses.dataclass(frozen=True)
class Touch:
    """What oil touches at rest in one posture.

    Attributes
    ----------
    needed : (latitudes, meridians), smallest fill from which on a point of the retina is touched; the least of
        ``FILLS`` where it is touched at that already, and 1 where it is not even at the largest.
    needed_by_both : the same, where two shapes are at rest and both must touch.
    shares : (fills, names of ``SHARES``), covered shares.
    """

    needed: np.ndarray
    needed_by_both: np.ndarray
    shares: np.ndarray

    def fill_for(self, meridian: np.ndarray, latitude: np.ndarray, by_both: bool = False) -> float:
        """Return the smallest fill that touches all points of meridians and latitudes (k,) in degrees."""
        needed = self.needed_by_both if by_both else self.needed
        around = (meridian % 360.0) / (MERIDIANS[1] - MERIDIANS[0])
        column = np.floor(around).astype(int)
        row = np.clip(np.searchsorted(LATITUDES, latitude, side="right") - 1, 0, len(LATITUDES) - 2)
        across = (latitude - LATITUDES[row]) / (LATITUDES[row + 1] - LATITUDES[row])
        values = 0.0
        for step_row, weight_row in ((0, 1.0 - across), (1, across)):
            for step, weight in ((0, 1.0 - (around - column)), (1, around - column)):
                values = values + weight_row * weight * needed[row + step_row, (column + step) % len(MERIDIANS)]
        return float(np.max(values))

    def shares_at(self, fill: float) -> dict[str, float]:
        """Return the covered shares at a fill."""
        return {name: float(np.interp(fill, FILLS, values)) for name, values in zip(SHARES, self.shares.T, strict=True)}

    def mirrored(self) -> "Touch":
        """Return the table of a posture that is this one seen in a mirror, for an eye that is its own mirror image."""
        other = -np.arange(len(MERIDIANS))
        return dataclasses.replace(self, needed=self.needed[:, other], needed_by_both=self.needed_by_both[:, other])


def key_of(liquids: Liquids, posture: str) -> Key:
    """Return what tells the tables of an eye apart."""
    return (f"{liquids.density_difference:g}", f"{1e3 * liquids.tension:.6g}",
            f"{np.degrees(liquids.contact_angle):.6g}", posture)


def touch_of(resting: Resting, liquids: Liquids, down: np.ndarray,
             advance: Callable[[float], object] = lambda count: None, cuts: int = DRAFT) -> Touch:
    """Let the oil come to rest at all fills.

    Parameters
    ----------
    cuts : of the directions of the shape of least energy; others have 2,562.
    advance : called with the number of fills, after each.
    """
    wall = resting.cavity(cuts)
    meridian, latitude = (grid.ravel() for grid in np.meshgrid(MERIDIANS, LATITUDES))
    corners, weights = interpolation(wall.wall, wall.faces, direction(meridian, latitude))
    # At a fill without any shape nothing is known to be touched.
    least, both = np.full((2, len(FILLS), len(meridian)), -FARTHEST)
    covered = np.full((len(FILLS), len(SHARES)), np.nan)
    for index, fill in enumerate(FILLS):
        found = resting.shapes(liquids, down, fill)
        for finer in range(DRAFT + 1, cuts + 1):
            found[:1] = [one for one in (resting.finer(first, liquids, down, finer) for first in found[:1])
                         if one.rest.settled]
        contacts = [resting.contact(one, cuts, beyond=True) for one in found]
        if contacts:
            margins = np.array([(one.margin[corners] * weights).sum(axis=1) for one in contacts])
            least[index], both[index] = np.clip([margins[0], margins.min(axis=0)], -FARTHEST, FARTHEST)
            parts = shares(contacts[0])
            covered[index] = [parts[name] for name in SHARES]
        advance(1)
    needed, by_both = (fills_needed(one).reshape(len(LATITUDES), len(MERIDIANS)) for one in (least, both))
    return Touch(needed, by_both, covered)


def fills_needed(margin: np.ndarray) -> np.ndarray:
    """Smallest fill from which on the margin, (fills, k), stays above zero, (k,)."""
    fills = np.array(FILLS)
    bare = margin <= 0.0
    last = len(fills) - 1 - bare[::-1].argmax(axis=0)
    column = np.arange(margin.shape[1])
    following = np.minimum(last + 1, len(fills) - 1)
    below, above = margin[last, column], margin[following, column]
    share = -below / np.where(above > below, above - below, 1.0)
    found = fills[last] + share * (fills[following] - fills[last])  # (R8)
    return np.select([~bare.any(axis=0), last == len(fills) - 1], [fills[0], 1.0], found)


def write_tables(folder: Path, tables: dict[Key, Touch]) -> None:
    """Write the tables of an eye into a folder: three CSV files."""
    touch, by_both, covered = [], [], []
    for key, table in tables.items():
        for lines, needed in ((touch, table.needed), (by_both, table.needed_by_both)):
            lines += [(*key, f"{latitude:g}", *(f"{100 * value:.1f}" for value in row))
                      for latitude, row in zip(LATITUDES, needed, strict=True)]
        covered += [(*key, f"{100 * fill:g}", *(f"{100 * value:.1f}" for value in row))
                    for fill, row in zip(FILLS, table.shares, strict=True)]
    chart = (*KEYS, "latitude [deg]", *(f"meridian {one:g} deg: fill [%]" for one in MERIDIANS))
    shared = (*KEYS, "fill [%]", *(f"{name} [%]" for name in SHARES))
    for name, head, rows in ((TOUCH, chart, touch), (TOUCH_BY_BOTH, chart, by_both), (COVERED, shared, covered)):
        write_text(folder / name, csv_of(head, rows))


def read_tables(folder: Path) -> dict[Key, Touch]:
    """Read the tables of an eye; none where there is no folder.

    Raises
    ------
    UserError : a file is damaged.
    """
    files = [folder / name for name in (TOUCH, TOUCH_BY_BOTH, COVERED)]
    if not all(file.is_file() for file in files):
        return {}
    try:
        parts = [_grouped(file) for file in files]
        tables = {key: Touch(*(part[key] for part in parts)) for key in parts[0]}
    except (ValueError, KeyError, IndexError) as error:
        raise UserError(f"{folder}: its tables are damaged ({error}); remove the folder, and they are made again"
                        ) from error
    chart = (len(LATITUDES), len(MERIDIANS))
    if any((table.needed.shape, table.needed_by_both.shape, table.shares.shape)
           != (chart, chart, (len(FILLS), len(SHARES))) for table in tables.values()):
        raise UserError(f"{folder}: its tables are of another size; remove the folder, and they are made again")
    return tables


def _grouped(path: Path) -> dict[Key, np.ndarray]:
    """Numbers of a file behind its keys and its first number, key -> (rows, columns), as shares of one."""
    with path.open(newline="", encoding="utf-8") as file:
        lines: Iterable[list[str]] = list(csv.reader(file))[1:]
    groups: dict[Key, list] = {}
    for line in lines:
        groups.setdefault((line[0], line[1], line[2], line[3]), []).append([float(cell) for cell in line[5:]])
    return {key: np.array(rows) / 100.0 for key, rows in groups.items()}
