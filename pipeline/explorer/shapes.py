"""Shapes at rest at all fills, as fields on one grid of angles.

A grid of angles has a row for every latitude and a column for every meridian. Meridians count from the one that the
tamponade goes to, so that fields of neighboring directions are alike: the eye is nearly a body of revolution.
"""
import dataclasses
import functools

import numpy as np

from pipeline.cavity.rays import interpolation
from pipeline.equilibrium.contact import Contact, shares
from pipeline.equilibrium.least import Found, Resting
from pipeline.equilibrium.rest import Rest, at_rest
from pipeline.equilibrium.star_cavity import DRAFT, icosphere
from pipeline.explorer.cases import LATITUDES, MERIDIANS, Tamponade
from pipeline.scenes.model import Eye
from pipeline.scenes.retina import direction, globe_radius

PARTS = ("retina", "superior", "inferior", "macula")
REACH, BEND = 0.75, 0.8     # of the viewpoint toward the tamponade, over the radius of the globe, at no fill
FROM_FOLLOWING = 0.3        # fills below are seen from their own middle alone: this point may lie in the lens
LEAN = 0.1                  # degrees off the axis


@dataclasses.dataclass(frozen=True)
class Shape:
    """One shape at rest.

    Attributes
    ----------
    margin : (latitudes, meridians), m, to the contact line, of the points of the wall around the center of the globe;
        positive where the tamponade touches.
    gap : (latitudes, meridians), m, between tamponade and wall, around the viewpoint.
    view : (3,), m, the viewpoint: toward the meridian that the tamponade goes to, a quarter of a turn on, to the front.
    shares : of ``PARTS``, (4,). low, high : what they may be less and more, (4,), with another contact angle or shape.
    """

    margin: np.ndarray
    gap: np.ndarray
    view: np.ndarray
    shares: np.ndarray
    low: np.ndarray
    high: np.ndarray


class Views:
    """An eye, and the points from which a tamponade in it is seen together with the whole wall."""

    def __init__(self, eye: Eye):
        self.resting = Resting.of(eye)
        self.wall = self.resting.cavity()
        self._globe = globe_radius(self.wall.wall)

    def shapes(self, tamponade: Tamponade, toward: np.ndarray, fill: float) -> list[Found]:
        """Return the shapes at rest of a tamponade that goes toward a direction (3,), the one of least energy first."""
        viewpoint = None if fill < FROM_FOLLOWING else (
            self.wall.viewpoint + REACH * self._globe * (1.0 - fill) ** BEND * toward)
        # Up where it floats: what turns one into the other turns it back.
        return self.resting.shapes(tamponade.liquids, tamponade.toward(toward), fill, viewpoint=viewpoint)


def shape_at(views: Views, tamponade: Tamponade, meridian: float, tilt: float, fill: float) -> Shape | None:
    """Return the shape of least energy; None where none was found.

    Parameters
    ----------
    meridian, tilt : degrees, of the place of the retina that the tamponade goes to.
    """
    # What may lean to any side from the front leans to the meridian.
    toward = direction(np.array([meridian]), np.array([min(tilt, 180.0 - LEAN)]))[0]
    found = views.shapes(tamponade, toward, fill)
    if not found:
        return None
    plain, wall = found[0].rests[0], views.wall
    others = [at_rest(plain.cavity, dataclasses.replace(tamponade.liquids, contact_angle=angle),
                      tamponade.toward(toward), fill, plain.distance) for angle in tamponade.other_angles]
    least, coarse = views.resting.contact(found[0]), Contact.of(plain).on(wall)
    pairs = [*((Contact.of(other).on(wall), coarse) for other in others if other.settled),
             *((views.resting.contact(one), least) for one in found[1:])]
    changes = np.array([np.zeros(4), *(parts_of(one) - parts_of(reference) for one, reference in pairs)])
    rest = found[0].rest
    view = _across(meridian) @ rest.cavity.viewpoint
    return Shape(_field(least, meridian), _gaps(rest, meridian), view, parts_of(least), -changes.min(axis=0),
                 changes.max(axis=0))


def parts_of(contact: Contact) -> np.ndarray:
    """Return the covered shares (4,) of ``PARTS``."""
    found = shares(contact)
    return np.array([found[part] for part in PARTS])


def _across(meridian: float) -> np.ndarray:
    """Rows: toward the meridian, a quarter of a turn on from it, and to the front, (3, 3)."""
    return np.array([*direction(np.array([meridian, meridian + 90.0]), np.array([90.0, 90.0])), [0.0, 0.0, 1.0]])


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
