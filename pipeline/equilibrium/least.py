"""Oil at rest in a cavity: the shape of least energy of all that are found from several points and starts.

Everybody asks here where oil rests: scenes, plans, sequences, the explorer, studies. A shape is found when a point sees
all of its surface, and no one point sees all shapes: a fill that surrounds the middle of the cavity is seen from the
axis, a smaller one from its own middle, one between from both. Equations: docs/methods/equilibrium.md.
"""
import dataclasses
import functools
from collections.abc import Callable, Sequence

import numpy as np

from pipeline.equilibrium.contact import Contact, shares
from pipeline.equilibrium.energy import length_of
from pipeline.equilibrium.rest import Liquids, Rest, at_rest, refined_start
from pipeline.equilibrium.small_fills import Ball, middle_of, seen, seen_from_its_middle
from pipeline.equilibrium.star_cavity import COARSE, DRAFT, Level, StarCavity, levels_of, viewpoint_of
from pipeline.scenes.model import Eye

SMALL, LARGE = 0.5, 0.75    # fills below are seen from their own middle, those between from both; above, it is the same
ALIKE = 1e-3            # of the energy: views of one shape from two points differ by less
AXIS = 0.1e-3           # m: what is nearer to the middle plane is in it
UNLIKE = 0.015          # of a part of the retina, from which two shapes are two: few directions blur by less
UPWARD = 5e-4           # of the energy: of two shapes that are each other's mirror image the superior one is taken
SAME = 1e-5             # of the energy, of one shape that two starts from one point come to
HIGHER, HIGHEST = 0.5, 0.98  # a start from a larger fill: share of what is missing to a full cavity; at most
BEYOND = 0.5            # of what four times as many directions change: what still more would, likely (R11)
TOPPLED = 2e-3          # m, by which a contact line moves that is another one: nothing follows for more directions


@dataclasses.dataclass(frozen=True)
class Found:
    """A shape at rest, with ever more directions.

    Attributes
    ----------
    rests : the shape, from few directions to many.
    energy : J, of the last, with the weight counted from the origin.
    """

    rests: tuple[Rest, ...]
    energy: float

    @property
    def rest(self) -> Rest:
        """The shape with most directions."""
        return self.rests[-1]


class Resting:
    """A cavity in which oil comes to rest, with the points that it is seen from.

    Parameters
    ----------
    level : negative in the cavity, a function of points (..., 3) in m.
    viewpoint : (3,), m, that sees the whole wall.
    others : points (3,), m, around which a small fill may lie too.
    """

    def __init__(self, level: Level, viewpoint: np.ndarray, others: Sequence[np.ndarray] = ()):
        self._level, self._viewpoint, self._others = level, viewpoint, others
        self._seen: dict[int, StarCavity] = {}
        self._elsewhere: dict[int, StarCavity] = {}

    @classmethod
    def of(cls, eye: Eye) -> "Resting":
        """Look at an eye from its axis, and for small fills from before the lens or near it.

        Raises
        ------
        UserError : the user's mesh cannot be used, or no point sees its whole wall.
        """
        levels = levels_of(eye)
        return cls(levels[0], viewpoint_of(eye, levels), [viewpoint_of(eye, levels, from_front=True)])

    def cavity(self, cuts: int = DRAFT, viewpoint: np.ndarray | None = None) -> StarCavity:
        """Return the cavity as a point sees it that sees its whole wall; of others than the usual one the last is kept.
        """
        usual = viewpoint is None or np.array_equal(viewpoint, self._viewpoint)
        kept, point = (self._seen, self._viewpoint) if usual else (self._elsewhere, viewpoint)
        if cuts not in kept or not np.array_equal(kept[cuts].viewpoint, point):
            kept[cuts] = StarCavity.of_level(self._level, point, cuts)
        return kept[cuts]

    def shapes(self, liquids: Liquids, down: np.ndarray, fill: float, cuts: int = DRAFT,
               viewpoint: np.ndarray | None = None) -> list[Found]:
        """Return the shapes at rest that are found, the one of least energy first; none where none is found.

        Starts, with 642 directions, from the axis: the oil drawn together, the oil at the wall, the shape of a larger
        fill; from its own middle: a ball driven to the wall, and one on the axis, for what lies behind the lens. What
        these find is taken on to more directions, and compared then: few tell energies of two views to 1 % only.

        Parameters
        ----------
        down : (3,), unit vector of gravity in the frame of the cavity.
        fill : share of the cavity that is oil.
        cuts : of the directions of the shapes.
        viewpoint : (3,), m, that sees the whole wall, and the oil, to look from in place of that on the axis.
        """
        found = self._coarse(liquids, down, fill, viewpoint)
        for finer in range(COARSE + 1, cuts + 1):
            found = _different([one for one in (self.finer(one, liquids, down, finer) for one in found)
                                if one.rest.settled], self.contact)
        return found

    def least(self, liquids: Liquids, down: np.ndarray, fill: float, cuts: int = DRAFT) -> Found | None:
        """Return the shape of least energy; None where none is found.

        More than 2,562 directions are given to the one shape that has least energy with these.
        """
        found = self.shapes(liquids, down, fill, min(cuts, DRAFT))
        if not found:
            return None
        best = found[0]
        for finer in range(DRAFT + 1, cuts + 1):
            best = self.finer(best, liquids, down, finer)
        return best if best.rest.settled else None

    def finer(self, found: Found, liquids: Liquids, down: np.ndarray, cuts: int) -> Found:
        """Return the same shape with four times as many directions too."""
        rest = found.rest
        cavity = self.cavity(cuts, rest.cavity.viewpoint) if rest.cavity.whole is None else seen(
            self._level, rest.cavity.viewpoint, cuts, rest.cavity.whole, rest.cavity.reach)
        finer = at_rest(cavity, liquids, down, rest.fill, refined_start(rest, cavity, cuts))
        return Found((*found.rests, finer), energy(finer, liquids))

    def contact(self, found: Found, cuts: int | None = None, *, beyond: bool = False) -> Contact:
        """Return where a shape touches the whole wall.

        Parameters
        ----------
        cuts : of the wall; by default those of the shape.
        beyond : take what the last directions changed on to ever more of them. (R11)
        """
        wall = self.cavity(found.rest.cavity.cuts if cuts is None else cuts)
        contact = Contact.of(found.rest).on(wall)
        if not beyond or len(found.rests) < 2:
            return contact
        change = contact.margin - Contact.of(found.rests[-2]).on(wall).margin
        likely = np.where(np.abs(change) < TOPPLED, BEYOND * change, 0.0)
        return dataclasses.replace(contact, depth=contact.margin + likely)

    def _coarse(self, liquids: Liquids, down: np.ndarray, fill: float, viewpoint: np.ndarray | None) -> list[Found]:
        """Shapes with 642 directions."""
        rests = [] if viewpoint is None and fill < SMALL else self._from(viewpoint, liquids, down, fill)
        if fill < LARGE or not any(rest.settled for rest in rests):
            whole, toward = self.cavity().volume, -np.sign(liquids.density_difference) * np.asarray(down, float)
            for start in (self._ball.start(toward, fill * whole), *self._others):
                rests.append(seen_from_its_middle(self._level, whole, liquids, down, fill, start))
        found: list[Found] = []
        for one in [Found((rest,), energy(rest, liquids)) for rest in rests if rest.settled]:
            if not any(_same(one, other) for other in found):
                found.append(one)
        return found

    def _from(self, viewpoint: np.ndarray | None, liquids: Liquids, down: np.ndarray, fill: float) -> list[Rest]:
        cavity = self.cavity(COARSE, viewpoint)
        larger = at_rest(cavity, liquids, down, min(fill + HIGHER * (1.0 - fill), HIGHEST)).distance
        return [at_rest(cavity, liquids, down, fill, start) for start in (None, cavity.radius, larger)]

    @functools.cached_property
    def _ball(self) -> Ball:
        return Ball(self.cavity(COARSE))


def energy(rest: Rest, liquids: Liquids) -> float:
    """Energy in J, with the weight counted from the origin, so that views from several points can be compared."""
    cavity = rest.cavity
    volume = float(cavity.solid @ rest.distance[cavity.faces].prod(axis=1)) / 6.0
    return liquids.tension * length_of(cavity) ** 2 * rest.energy + volume * float(cavity.viewpoint @ rest.pull)


def _same(one: Found, other: Found) -> bool:
    """Whether two starts from one point have come to one shape."""
    here, there = one.rest.cavity.viewpoint, other.rest.cavity.viewpoint
    return (bool(np.abs(here - there).max() < 1e-6)
            and abs(one.energy - other.energy) < SAME * abs(other.energy))


def _different(found: list[Found], contact: Callable[[Found], Contact]) -> list[Found]:
    """Shapes that differ, the one of least energy first; of two views of one that of the whole wall counts."""
    def rank(one: Found) -> float:
        inferior = middle_of(one.rest)[1] < -AXIS
        return one.energy + abs(one.energy) * (ALIKE * (one.rest.cavity.whole is not None) + UPWARD * inferior)

    if len(found) < 2:
        return found
    kept: list[tuple[Found, np.ndarray]] = []
    for one in sorted(found, key=rank):
        parts = np.array(list(shares(contact(one)).values()))
        if all(np.abs(parts - other).max() > UNLIKE for _, other in kept):
            kept.append((one, parts))
    return [one for one, _ in kept]
