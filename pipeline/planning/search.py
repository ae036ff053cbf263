"""From a break to the fills that cover it, for every oil and posture; tables that are missing are made.

The tables of the default eye are in ``config/oil_at_rest``; those of others are kept in a folder of outputs.
"""
import dataclasses
import functools
import hashlib
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from pipeline.base.digest import call_digest
from pipeline.base.progress import progress
from pipeline.base.words import duration
from pipeline.cavity.eye_files import eye_files
from pipeline.cavity.rays import interpolation
from pipeline.equilibrium.least import Resting
from pipeline.equilibrium.rest import Liquids
from pipeline.equilibrium.star_cavity import FINE
from pipeline.planning.bracket import verdict
from pipeline.planning.chart import UNCERTAIN
from pipeline.planning.settings import postures
from pipeline.planning.touch import FILLS, Touch, key_of, read_tables, touch_of, write_tables
from pipeline.scenes.load import PROJECT_CONFIG
from pipeline.scenes.model import Eye, Material
from pipeline.scenes.retina import Patch, direction

MAP = PROJECT_CONFIG / "oil_at_rest"    # of the default eye
CACHE = Path("outputs") / "plans"
#: Of a fill that is needed; the share of the retina at a fill is at most 0.6 points off (docs/methods/equilibrium.md).
FILL_ERROR = 0.01
NEARLY = 1e-9            # of a fill
SHAPE_SECONDS = 0.8      # of a core of 3 GHz, for all that is tried at a fill: the mean of fills and postures


class Tables:
    """Tables of one eye: read where there are any, else made and kept.

    Parameters
    ----------
    eye : parametric or a mesh of the user's.
    cache : folder of tables that were made before.
    """

    def __init__(self, eye: Eye, cache: Path = CACHE):
        self.eye = eye
        self._folder = cache / call_digest("pipeline.planning.touch", (), _values(eye))
        self._kept = read_tables(self._folder)
        self.shipped = dataclasses.replace(eye, side=Eye().side) == Eye()
        self._known = (read_tables(MAP) if self.shipped else {}) | self._kept

    @functools.cached_property
    def resting(self) -> Resting:
        """The eye, in which oil comes to rest."""
        return Resting.of(self.eye)

    def __contains__(self, case: tuple[Liquids, str]) -> bool:
        return key_of(*case) in self._known

    def of(self, cases: Sequence[tuple[Liquids, str]]) -> list[Touch]:
        """Return the tables of liquids and postures."""
        missing = list(dict.fromkeys(case for case in cases if case not in self))
        if missing:
            self._make(missing)
        return [self._known[key_of(*case)] for case in cases]

    def fill_for(self, case: tuple[Liquids, str], points: tuple[np.ndarray, np.ndarray]) -> float:
        """Return the smallest fill that touches all points, meridians and latitudes (k,) in degrees.

        Tables know some fills, and between them the edge of the oil may jump in an eye that is not smooth. So in any
        eye but the shipped one the shape at that fill is looked at, and more is filled in until it covers.
        """
        fill = self.of([case])[0].fill_for(*points)
        if self.shipped or not FILLS[0] < fill <= FILLS[-1] or self.covers(case, points, fill):
            return fill
        above = next((one for one in FILLS if one > fill and self.covers(case, points, one)), None)
        if above is None:
            return 1.0
        while above - fill > 0.5 * FILL_ERROR:
            middle = 0.5 * (fill + above)
            fill, above = (fill, middle) if self.covers(case, points, middle) else (middle, above)
        return above

    def covers(self, case: tuple[Liquids, str], points: tuple[np.ndarray, np.ndarray], fill: float) -> bool:
        """Tell whether the shape at rest at a fill touches all points, as far as its edge is certain."""
        wall = self.resting.cavity()
        corners, weights = interpolation(wall.wall, wall.faces, direction(*points))
        least = self.resting.least(case[0], postures()[case[1]], fill)
        if least is None:
            return False
        margin = self.resting.contact(least, beyond=True).margin
        return float((margin[corners] * weights).sum(axis=1).min()) > -UNCERTAIN

    def _make(self, cases: Iterable[tuple[Liquids, str]]) -> None:
        cases = list(cases)
        with progress(len(FILLS) * len(cases), "oil at rest", unit="fill") as bar:
            for liquids, posture in cases:
                bar.set_postfix_str(posture.replace("_", " "))
                self._kept[key_of(liquids, posture)] = touch_of(self.resting, liquids, postures()[posture], bar.update)
                write_tables(self._folder, self._kept)
        self._known |= self._kept


@dataclasses.dataclass(frozen=True)
class Answer:
    """The fill that covers a break with an oil in a posture; fills are shares of the cavity.

    Attributes
    ----------
    oils : names; liquids of one density rest alike.
    posture : name of the posture.
    fill : smallest one that covers the break with its margin; above ``FILLS`` where none does.
    low, high : what it may be with another contact angle, another shape at rest and the error of the shapes; None where
        that is not known.
    shares : covered shares of the wall and the parts of the retina at this fill, or at the largest one that is allowed.
    """

    oils: tuple[str, ...]
    posture: str
    fill: float
    low: float | None
    high: float | None
    shares: dict[str, float]

    def covers(self, largest_fill: float) -> bool:
        """Tell whether the break can be covered."""
        return self.fill <= largest_fill

    def verdict(self, fill: float) -> str:
        """Return whether the break is covered at a fill, with all that is uncertain."""
        low = self.fill - FILL_ERROR if self.low is None else self.low
        high = self.fill + FILL_ERROR if self.high is None else self.high
        return verdict(fill - high + NEARLY, fill - low)


@dataclasses.dataclass(frozen=True)
class Question:
    """What is asked.

    Attributes
    ----------
    margin : m, by which the oil must reach beyond the break.
    oils : name -> liquid. other : what they displace.
    tension : N/m. contact_angle, other_angles : rad.
    """

    place: Patch
    margin: float
    oils: dict[str, Material]
    other: Material
    postures: tuple[str, ...]
    tension: float
    contact_angle: float
    other_angles: tuple[float, ...]
    largest_fill: float

    def liquids(self, oil: Material, contact_angle: float | None = None) -> Liquids:
        """Return what decides where an oil rests."""
        return Liquids(self.other.density - oil.density, self.tension, contact_angle or self.contact_angle)


def answers(question: Question, tables: Tables, radius: float) -> list[Answer]:
    """Return an answer for every density of oil and every posture, the smallest fill first.

    Parameters
    ----------
    radius : of the globe, m, to turn the margin into an angle.
    """
    points = question.place.points(np.degrees(question.margin / radius))
    alike: dict[Liquids, list[str]] = {}
    for name, oil in question.oils.items():
        alike.setdefault(question.liquids(oil), []).append(name)
    cases = [(liquids, posture) for liquids in alike for posture in question.postures]
    missing = sum(case not in tables for case in cases)
    if missing:
        _announce(len(FILLS) * (missing + len(question.other_angles)))
    tables.of(cases)  # all at once, with one progress
    fills = [tables.fill_for(case, points) for case in cases]
    best = cases[int(np.argmin(fills))]
    found = []
    for case, fill in zip(cases, fills, strict=True):
        others = [(dataclasses.replace(case[0], contact_angle=angle), case[1]) for angle in question.other_angles]
        known = case == best or all(other in tables for other in others)
        table = tables.of([case])[0]
        possible = [one.fill_for(*points, by_both) for one in (table, *tables.of(others)) for by_both in (False, True)
                    ] if known else []
        shares = table.shares_at(min(fill, question.largest_fill))
        low, high = (min(possible) - FILL_ERROR, min(max(*possible, fill) + FILL_ERROR, 1.0)) if known else (None, None)
        found.append(Answer(tuple(alike[case[0]]), case[1], fill, low, high, shares))
    return sorted(found, key=lambda answer: answer.fill)


def _announce(shapes: int) -> None:
    """Say on standard error, before it begins, how long what no table has will take."""
    print(f"No table has this yet: {shapes} shapes of oil at rest, about {duration(SHAPE_SECONDS * shapes)} of one "
          "core. Fewer oils and postures take less; what is done is kept.", file=sys.stderr, flush=True)


def write_map(question: Question) -> int:
    """Write the tables of the default eye for all oils, postures and contact angles of a question; return how many."""
    resting, tables = Resting.of(Eye()), {}
    all_liquids = dict.fromkeys(question.liquids(oil, angle) for oil in question.oils.values()
                                for angle in (question.contact_angle, *question.other_angles))
    downs, mirror = postures(), np.array([-1.0, 1.0, 1.0])
    cases = [(liquids, posture) for liquids in all_liquids for posture in question.postures]
    with progress(len(FILLS) * len(cases), "oil at rest", unit="fill") as bar:
        done: dict[tuple[Liquids, tuple[float, ...]], Touch] = {}
        for liquids, posture in cases:
            down = downs[posture]
            seen = done.get((liquids, tuple(mirror * down + 0.0)))
            if seen is not None:
                bar.update(len(FILLS))
            table = seen.mirrored() if seen is not None else touch_of(resting, liquids, down, bar.update, FINE)
            tables[key_of(liquids, posture)] = done[liquids, tuple(down + 0.0)] = table
    write_tables(MAP, tables)
    return len(tables)


def _values(eye: Eye) -> dict[str, object]:
    """What tells the shape of an eye from others: its numbers, and what is in its mesh."""
    values: dict[str, object] = dataclasses.asdict(eye)
    if eye.landmarks is None and eye.label is None:  # these turn a mesh as its side says, or tell it; else it is words
        values.pop("side")
    if eye.path:
        values["path"] = [hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else str(path)
                          for path in map(Path, eye_files(eye))]
    return values
