"""Shapes at rest at all fills, as fields on one grid of angles and on one lattice.

A grid of angles has a row for every latitude and a column for every meridian. Meridians count from the one that the
tamponade goes to, so that fields of neighboring directions are alike: the eye is nearly a body of revolution. This
meridian is in a mirror plane of the eye, and so a field holds one side of it. Equations: docs/methods/equilibrium.md.
"""
import contextlib
import dataclasses

import numpy as np

from pipeline.base.errors import UserError
from pipeline.cavity.rays import interpolation
from pipeline.equilibrium.contact import Contact, shares
from pipeline.equilibrium.least import BEYOND, Found, Resting
from pipeline.equilibrium.rest import at_rest
from pipeline.explorer.cases import HALF, LATITUDES, MERIDIANS, Tamponade
from pipeline.explorer.interface import SIZE, Interface, Lattice, across
from pipeline.scenes.model import Eye
from pipeline.scenes.retina import direction, globe_radius

PARTS = ("retina", "superior", "inferior", "macula")
REACH, BEND = 0.75, 0.8     # of the viewpoint toward the tamponade, over the radius of the globe, at no fill
NEARER = (1.0, 0.8, 0.6, 0.4)  # of that way, where a point does not see the whole wall, as far back in a long eye
FROM_FOLLOWING = 0.3        # fills below are seen from their own middle alone: this point may lie in the lens
LEAN = 0.1                  # degrees off the axis
SKIN = 2e-3                 # m above the wall: what lies under the tamponade there is deep in it, also on the lens


@dataclasses.dataclass(frozen=True)
class Shape:
    """One shape at rest.

    Attributes
    ----------
    margin : (latitudes, ``HALF``), m, to the contact line, of the points of the wall around the center of the globe;
        positive where the tamponade touches.
    depth : (*SIZE), m, of the points of the lattice in the tamponade, as ``Interface`` has it.
    shares : of ``PARTS``, (4,). low, high : what they may be less and more, (4,), with another contact angle or shape.
    """

    margin: np.ndarray
    depth: np.ndarray
    shares: np.ndarray
    low: np.ndarray
    high: np.ndarray


class Views:
    """An eye, and the points from which a tamponade in it is seen together with the whole wall."""

    def __init__(self, eye: Eye):
        self.resting = Resting.of(eye)
        self.wall = self.resting.cavity()
        self.lattice = Lattice.of(self.wall)
        self._globe = globe_radius(self.wall.wall)
        self._grids: dict[float, tuple[np.ndarray, np.ndarray]] = {}
        self._skins: dict[float, list[tuple[np.ndarray, np.ndarray, np.ndarray]]] = {}

    def shapes(self, tamponade: Tamponade, toward: np.ndarray, fill: float) -> list[Found]:
        """Return the shapes at rest of a tamponade that goes toward a direction (3,), the one of least energy first."""
        viewpoint = None if fill < FROM_FOLLOWING else self._following(fill, toward)
        # Up where it floats: what turns one into the other turns it back.
        return self.resting.shapes(tamponade.liquids, tamponade.toward(toward), fill, viewpoint=viewpoint)

    def _following(self, fill: float, toward: np.ndarray) -> np.ndarray | None:
        """A point that follows a tamponade as far as it sees the whole wall, (3,), m."""
        for less in NEARER:
            viewpoint = self.wall.viewpoint + less * REACH * self._globe * (1.0 - fill) ** BEND * toward
            with contextlib.suppress(UserError):
                self.resting.cavity(viewpoint=viewpoint)
                return viewpoint
        return None

    def finer(self, found: Found) -> Contact:
        """Return where a shape likely touches the wall with four times as many directions, by (R11)."""
        near, far = self.resting.contact(found), self.resting.contact(found, beyond=True)
        return dataclasses.replace(near, depth=near.margin + (far.depth - near.margin) / (1.0 + BEYOND))

    def field(self, contact: Contact, meridian: float) -> np.ndarray:
        """Margin of a contact line on the wall of this eye, (latitudes, ``HALF``), m: the mean of both sides."""
        if meridian not in self._grids:
            around, down = np.meshgrid(MERIDIANS + meridian, LATITUDES)
            self._grids[meridian] = interpolation(self.wall.wall, self.wall.faces,
                                                  direction(around.ravel(), down.ravel()))
        corners, weights = self._grids[meridian]
        whole = (contact.margin[corners] * weights).sum(axis=1).reshape(len(LATITUDES), len(MERIDIANS))
        return 0.5 * (whole + whole[:, -np.arange(len(MERIDIANS))])[:, :HALF]

    def depth(self, interface: Interface, contact: Contact, meridian: float, contact_angle: float) -> np.ndarray:
        """Depth of the points of the lattice in a tamponade, (*SIZE), m: the mean of both sides."""
        sides = [self.lattice.points * [1.0, side, 1.0] @ across(meridian) for side in (1.0, -1.0)]
        if meridian not in self._skins:
            self._skins[meridian] = [self._skin(points) for points in sides]
        found = np.zeros(SIZE)
        for points, (corners, weights, height) in zip(sides, self._skins[meridian], strict=True):
            beyond = (contact.margin[corners] * weights).sum(axis=-1)
            along = np.sin(contact_angle) * beyond + np.cos(contact_angle) * height
            depth = interface.depth(points)
            found += 0.5 * np.where((beyond > 0.0) & (height < SKIN), np.maximum(depth, along), depth)
        return found

    def _skin(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Where rays to points (..., 3) meet the wall, corners and weights (..., 3), and their height above it, m."""
        arm = points - self.wall.viewpoint
        far = np.linalg.norm(arm, axis=-1)
        corners, weights = (one.reshape(*far.shape, 3) for one in interpolation(
            self.wall.direction, self.wall.faces, (arm / far[..., None]).reshape(-1, 3)))
        radius, slope = ((values[corners] * weights).sum(axis=-1) for values in (self.wall.radius, self.wall.slope))
        return corners, weights, (radius - far) * slope


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
    finer = views.finer(found[0])
    angle = tamponade.liquids.contact_angle
    depth = views.depth(Interface.of(found[0].rest, angle), finer, meridian, angle)
    return Shape(views.field(finer, meridian), depth, parts_of(finer), -changes.min(axis=0), changes.max(axis=0))


def parts_of(contact: Contact) -> np.ndarray:
    """Return the covered shares (4,) of ``PARTS``."""
    found = shares(contact)
    return np.array([found[part] for part in PARTS])
