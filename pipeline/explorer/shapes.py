"""Shapes at rest at all fills, seen from a point that follows the tamponade, as fields on one grid of angles.

A grid of angles has a row for every latitude and a column for every meridian. Meridians count from the one that the
tamponade goes to, so that fields of neighboring directions are alike: the eye is nearly a body of revolution.
"""
import dataclasses
import functools

import numpy as np

from pipeline.cavity.rays import interpolation
from pipeline.equilibrium.contact import Contact, shares
from pipeline.equilibrium.rest import Rest, at_rest
from pipeline.equilibrium.star_cavity import COARSE, DRAFT, StarCavity, cavity_of, icosphere, levels_of
from pipeline.explorer.cases import LATITUDES, MERIDIANS, Tamponade
from pipeline.scenes.model import Eye
from pipeline.scenes.retina import direction, globe_radius

PARTS = ("retina", "superior", "inferior", "macula")
REACH, BEND = 0.75, 0.8     # of the viewpoint toward the tamponade, over the radius of the globe, at no fill
UNLIKE = 0.005              # of the covered retina, from which two shapes are two


@dataclasses.dataclass(frozen=True)
class Shape:
    """One shape at rest.

    Attributes
    ----------
    margin : (latitudes, meridians), m, to the contact line, of the points of the wall around the center of the globe;
        positive where the tamponade touches.
    gap : (latitudes, meridians), m, between tamponade and wall, around the viewpoint.
    shares : of ``PARTS``, (4,). low, high : what they may be less and more, (4,), with another contact angle or shape.
    """

    margin: np.ndarray
    gap: np.ndarray
    shares: np.ndarray
    low: np.ndarray
    high: np.ndarray


class Cavities:
    """The cavity of an eye, seen from the points that see the tamponade."""

    def __init__(self, eye: Eye):
        self._level = levels_of(eye)[0]
        coarse = cavity_of(eye, COARSE)
        self.middle, self.globe = coarse.viewpoint, globe_radius(coarse.wall)
        self._seen: dict[int, StarCavity] = {}

    def viewpoint(self, toward: np.ndarray, fill: float) -> np.ndarray:
        """Return the point (3,), m, from which a tamponade that goes toward a direction is seen."""
        return self.middle + REACH * self.globe * (1.0 - fill) ** BEND * toward

    def seen(self, toward: np.ndarray, fill: float, cuts: int) -> StarCavity:
        """Return the cavity seen from there; the last one of every number of cuts is kept."""
        viewpoint = self.viewpoint(toward, fill)
        kept = self._seen.get(cuts)
        if kept is None or not np.array_equal(kept.viewpoint, viewpoint):
            kept = self._seen[cuts] = StarCavity.of_level(self._level, viewpoint, cuts)
        return kept


def shape_at(cavities: Cavities, tamponade: Tamponade, meridian: float, tilt: float, fill: float) -> Shape | None:
    """Return the shape of least energy; None where none was found.

    Parameters
    ----------
    meridian, tilt : degrees, of the place of the retina that the tamponade goes to.
    """
    toward = direction(np.array([meridian]), np.array([tilt]))[0]
    down, coarse = tamponade.toward(toward), cavities.seen(toward, fill, COARSE)
    plain, rests = rests_at(cavities, tamponade, toward, fill)
    if not rests:
        return None
    least = Contact.of(rests[0])
    others = [(Contact.of(at_rest(coarse, dataclasses.replace(tamponade.liquids, contact_angle=angle), down, fill,
                                  plain.distance)), Contact.of(plain)) for angle in tamponade.other_angles]
    pairs = [*others, *((Contact.of(rest), least) for rest in rests[1:])]
    changes = np.array([np.zeros(4), *(parts_of(one) - parts_of(reference) for one, reference in pairs)])
    return Shape(_field(least, meridian), _gaps(rests[0], meridian), parts_of(least), -changes.min(axis=0),
                 changes.max(axis=0))


def rests_at(cavities: Cavities, tamponade: Tamponade, toward: np.ndarray, fill: float) -> tuple[Rest, list[Rest]]:
    """Return the shape that few directions find, and those of more directions, the one with least energy first.

    Starts: the tamponade drawn together and, where few directions tell the shapes apart, the tamponade at the wall.
    """
    down = tamponade.toward(toward)  # up where it floats: what turns one into the other turns it back
    coarse, fine = (cavities.seen(toward, fill, cuts) for cuts in (COARSE, DRAFT))
    first = at_rest(coarse, tamponade.liquids, down, fill)
    second = at_rest(coarse, tamponade.liquids, down, fill, coarse.radius)
    rests = [at_rest(fine, tamponade.liquids, down, fill)]
    if not rests[0].settled or _unlike(first, second):
        rests.append(at_rest(fine, tamponade.liquids, down, fill, fine.radius))
    return (min((first, second), key=lambda rest: (not rest.settled, rest.energy)),
            sorted((rest for rest in rests if rest.settled), key=lambda rest: rest.energy))


def parts_of(contact: Contact) -> np.ndarray:
    """Return the covered shares (4,) of ``PARTS``."""
    found = shares(contact)
    return np.array([found[part] for part in PARTS])


def _unlike(one: Rest, other: Rest) -> bool:
    if not (one.settled and other.settled):
        return True
    return bool(np.abs(parts_of(Contact.of(one)) - parts_of(Contact.of(other))).max() > UNLIKE)


def _grid(meridian: float) -> np.ndarray:
    around, down = np.meshgrid(MERIDIANS + meridian, LATITUDES)
    return direction(around.ravel(), down.ravel())


def _field(contact: Contact, meridian: float) -> np.ndarray:
    corners, weights = interpolation(contact.cavity.wall, contact.cavity.faces, _grid(meridian))
    return (contact.margin[corners] * weights).sum(axis=1).reshape(len(LATITUDES), len(MERIDIANS))


@functools.lru_cache(maxsize=8)
def _weights(meridian: float, cuts: int) -> tuple[np.ndarray, np.ndarray]:
    return interpolation(*icosphere(cuts), _grid(meridian))


def _gaps(rest: Rest, meridian: float) -> np.ndarray:
    corners, weights = _weights(meridian, DRAFT)
    gap = rest.cavity.radius - rest.distance
    return (gap[corners] * weights).sum(axis=1).reshape(len(LATITUDES), len(MERIDIANS))
