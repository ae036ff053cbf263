"""Shapes at rest for many fills in one eye, as the studies of fills and of eyes need them.

Every shape is found going up and going down in fill. Of two shapes the one with less energy counts.
"""
import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np
from PIL import Image

from pipeline.equilibrium.contact import Contact, retina_masks
from pipeline.equilibrium.rest import Liquids, Rest, at_rest, refined_start
from pipeline.equilibrium.star_cavity import DRAFT, StarCavity
from pipeline.pictures.fundus_map import FundusMap
from pipeline.pictures.marks import OVERSAMPLING, reduce
from pipeline.planning.settings import postures
from studies.questions.kit.words import PARTS

GRAVITY = 9.81
HEAD_UP = "head_up_45"                      # the patient leans back by half a right angle
POSTURES = ("upright", HEAD_UP, "supine", "prone", "left_side", "right_side")
MAP_SIZE = 168                              # pixels


@dataclasses.dataclass(frozen=True)
class Course:
    """Shapes of least energy at one contact angle in one posture, fill by fill, and shares with any shape at rest.

    Attributes
    ----------
    best : shapes with the least energy.
    shares : (2, fills, parts), shares that were found going up and down; nan where a shape has not settled.
    least : (fills, parts), those of ``best``.
    """

    best: list[Rest]
    shares: np.ndarray
    least: np.ndarray


def down_of(posture: str) -> np.ndarray:
    """Return the direction (3,) of gravity in the eye."""
    if posture == HEAD_UP:
        middle = postures()["upright"] + postures()["supine"]
        return middle / np.linalg.norm(middle)
    return postures()[posture]


def parts_of(cavity: StarCavity, *, right_eye: bool = True) -> dict[str, np.ndarray]:
    """Triangles of the parts of the retina, name -> (m,) bool, in the order of ``PARTS``."""
    masks, center = retina_masks(cavity), cavity.wall[cavity.faces].mean(axis=1)
    temporal, before = (center[:, 0] < 0.0) == right_eye, center[:, 2] > 0.0
    for half in ("superior", "inferior"):
        masks[f"{half}_temporal"], masks[f"{half}_nasal"] = masks[half] & temporal, masks[half] & ~temporal
    masks["before_equator"], masks["behind_equator"] = masks["retina"] & before, masks["retina"] & ~before
    return {name: masks[name] for name in PARTS}


def shares_of(contact: Contact, masks: dict[str, np.ndarray]) -> np.ndarray:
    """Return the covered shares of parts of the retina, (parts,)."""
    return np.array([contact.share(mask) for mask in masks.values()])


def course_of(cavities: Sequence[StarCavity], liquids: Liquids, down: np.ndarray, fills: Sequence[float], *,
              right_eye: bool = True) -> Course:
    """Return the shapes going up, as when the eye is filled, and down.

    Parameters
    ----------
    down : (3,) direction of gravity. fills : rising.
    cavities : of the eye; another one is tried where the oil is not seen from the point within the one before.
    """
    course = _course_in(cavities[0], liquids, down, fills, right_eye)
    missing = [n for n, rest in enumerate(course.best) if not rest.settled]
    if missing and cavities[1:]:
        other = course_of(cavities[1:], liquids, down, [fills[n] for n in missing], right_eye=right_eye)
        course.shares[:, missing], course.least[missing] = other.shares, other.least
        for n, rest in zip(missing, other.best, strict=True):
            course.best[n] = rest
    return course


def _course_in(cavity: StarCavity, liquids: Liquids, down: np.ndarray, fills: Sequence[float],
               right_eye: bool) -> Course:
    masks = parts_of(cavity, right_eye=right_eye)
    rests: list[list[Rest]] = []
    for order in (fills, fills[::-1]):
        one: list[Rest] = []
        for fill in order:
            one.append(at_rest(cavity, liquids, down, fill, one[-1].distance if one and one[-1].settled else None))
        rests.append(one if order is fills else one[::-1])
    shares = np.array([[shares_of(Contact.of(rest), masks) for rest in one] for one in rests])
    settled = np.array([[rest.settled for rest in one] for one in rests])
    energy = np.where(settled, [[rest.energy for rest in one] for one in rests], np.inf)
    chosen = energy.argmin(axis=0)
    shares[~settled] = np.nan
    return Course([rests[which][n] for n, which in enumerate(chosen)], shares, shares[chosen, np.arange(len(fills))])


def change_with_directions(finer: StarCavity, liquids: Liquids, down: np.ndarray, course: Course,
                           chosen: Iterable[int], *, right_eye: bool = True) -> np.ndarray:
    """Return the largest change of the shares with four times as many directions, (parts,).

    Parameters
    ----------
    finer : the same eye with ``DRAFT + 1`` cuts.
    chosen : fills of the course that are tried.
    """
    masks, changes = parts_of(finer, right_eye=right_eye), [np.zeros(len(PARTS))]
    for n in chosen:
        if (course.best[n].cavity.viewpoint != finer.viewpoint).any():
            continue
        fine = at_rest(finer, liquids, down, course.best[n].fill, refined_start(course.best[n], finer, DRAFT + 1))
        if fine.settled:
            changes.append(np.abs(shares_of(Contact.of(fine), masks) - course.least[n]))
    return np.nanmax(changes, axis=0)


def nearest(fills: Iterable[float], wanted: Iterable[float]) -> list[int]:
    """Return which fills are nearest to those that are wanted, each once."""
    all_fills = np.array(list(fills))
    return sorted({int(np.abs(all_fills - one).argmin()) for one in wanted})


def range_of(courses: Sequence[Course], error: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the least and the largest of the shares of courses, (fills, parts), an error (parts,) beyond."""
    found = np.concatenate([course.shares for course in courses])
    return np.maximum(np.fmin.reduce(found) - error, 0.0), np.minimum(np.fmax.reduce(found) + error, 1.0)


def percents(*shares: float) -> list[str]:
    """Return shares as cells of a table, in percent; what is not known is empty."""
    return [f"{100 * share:.1f}" if np.isfinite(share) else "" for share in shares]


def in_front(rest: Rest) -> float:
    """Return the share of the aqueous that is before the equator."""
    return rest.other.share(rest.other.position[:, 2] > 0.0) if rest.settled else np.nan


def fundus_maps(cavity: StarCavity, courses: Sequence[Course], chosen: Iterable[int], *,
                right_eye: bool = True) -> list[Image.Image]:
    """Return maps of the fundus at some fills: hatched is where the courses do not agree."""
    import pyvista

    side = OVERSAMPLING * MAP_SIZE
    chart, images = FundusMap(cavity.wall, (side, side), captions=False, right_eye=right_eye), []
    for n in chosen:
        margins = np.array([Contact.of(course.best[n]).margin for course in courses if course.best[n].cavity is cavity])
        wall = pyvista.PolyData(cavity.wall)
        wall.point_data["contact_distance"] = margins[0]
        wall.point_data["oil_fraction_covered"] = np.ones(len(cavity.wall))
        wall.point_data["oil_fraction_bare"] = np.zeros(len(cavity.wall))
        doubtful = (margins > 0.0).any(axis=0) & (margins <= 0.0).any(axis=0)
        images.append(reduce(chart.draw(wall, uncertain=np.where(doubtful, 2.0 * np.abs(margins[0]), 0.0))))
    return images
