"""What oil at rest may touch with all that is uncertain about it: the zone that maps hatch, and verdicts on breaks.

A break is covered where every shape that may be touches all of it, not covered where some point of it is touched by
none, and borderline between: so a verdict is what a map shows.
"""
import dataclasses
from collections.abc import Sequence

import numpy as np

from pipeline.cavity.rays import interpolation
from pipeline.equilibrium.contact import Contact, shares
from pipeline.equilibrium.least import Found, Resting
from pipeline.equilibrium.rest import Liquids, at_rest
from pipeline.planning.chart import UNCERTAIN
from pipeline.scenes.retina import Patch, direction

COVERED, BORDERLINE, NOT_COVERED = "covered", "borderline", "not covered"
EXPLAINED = ("Hatched is where that is uncertain: with other contact angles, in other shapes at rest, by errors of the "
             "shapes.")
VERDICTS = ("A break is covered when the oil is sure to touch all of it, not covered when some of it is sure to be "
            "blue, and else borderline.")


@dataclasses.dataclass(frozen=True)
class Bracket:
    """Oil at rest in one posture, and what else may be.

    Attributes
    ----------
    found : the shape that is drawn. contact : what it touches.
    low, high : (n,), m, of the points of the wall: their distance to the contact line at least and at most, positive
        where the oil touches.
    others : of other shapes at rest with the same liquids, which parts of the retina they touch.
    """

    found: Found
    contact: Contact
    low: np.ndarray
    high: np.ndarray
    others: tuple[dict[str, float], ...] = ()

    def beyond(self, place: Patch) -> tuple[float, float, float]:
        """Return how far the oil reaches beyond a break, m, and at least and at most; negative where it falls short."""
        cavity = self.contact.cavity
        corners, weights = interpolation(cavity.wall, cavity.faces, direction(*place.points()))
        margin, low, high = (float((one[corners] * weights).sum(axis=1).min())
                             for one in (self.contact.margin, self.low, self.high))
        return margin, low, high

    def pressure(self, place: Patch) -> float:
        """Return the smallest pressure of the oil over the other liquid at the points of a break, Pa."""
        cavity = self.contact.cavity
        corners, weights = interpolation(cavity.wall, cavity.faces, direction(*place.points()))
        points = np.einsum("kc,kcx->kx", weights, cavity.wall[corners])
        return float(self.found.rest.contact_pressure(points).min())

    def other_words(self) -> str:
        """Return one sentence on other shapes at rest; empty where none was found."""
        if not self.others:
            return ""
        wholes = sorted({f"{100 * one['retina']:.0f}" for one in self.others}, key=float)
        return (f"The oil may rest elsewhere too, and touch {' or '.join(wholes)} % of the retina: of "
                f"{1 + len(self.others)} shapes the one with least energy is drawn.")


def verdict(low: float, high: float) -> str:
    """Return whether a break is covered, from how far the oil reaches beyond it at least and at most.

    >>> verdict(0.1, 0.7), verdict(-0.1, 0.7), verdict(-0.7, -0.1)
    ('covered', 'borderline', 'not covered')
    """
    return COVERED if low > 0.0 else BORDERLINE if high > 0.0 else NOT_COVERED


def bracket_of(resting: Resting, liquids: Liquids, down: np.ndarray, fill: float, angles: Sequence[float],
               fill_error: float = 0.0) -> Bracket | None:
    """Let oil come to rest in all ways that are possible; None where no shape is found.

    Parameters
    ----------
    down : (3,), unit vector of gravity in the frame of the eye.
    angles : rad, contact angles that are possible too.
    fill_error : of the fill, by which more or less may be needed for the same.
    """
    found = resting.shapes(liquids, down, fill)
    if not found:
        return None
    wall = resting.cavity()
    contacts = [resting.contact(one, beyond=True) for one in found]
    near, far = [one.margin for one in contacts], []
    ways = [(angle, change) for angle in (liquids.contact_angle, *angles)
            for change in dict.fromkeys((0.0, -fill_error, fill_error))][1:]
    for one, contact in zip(found, contacts, strict=True):
        rest = one.rest
        likely = contact.margin - Contact.of(rest).on(wall).margin  # with ever more directions
        for angle, change in ways:
            other = at_rest(rest.cavity, dataclasses.replace(liquids, contact_angle=angle), down,
                            min(fill + change, 1.0), rest.distance)
            if other.settled:
                (far if change else near).append(Contact.of(other).on(wall).margin + likely)
    # The fill has its own error, that of the shapes.
    low = np.min([np.min(near, axis=0) - UNCERTAIN, *far], axis=0)
    high = np.max([np.max(near, axis=0) + UNCERTAIN, *far], axis=0)
    return Bracket(found[0], contacts[0], low, high, tuple(shares(one) for one in contacts[1:]))
