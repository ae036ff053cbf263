"""What oil or gas at rest touches in an eye, for fills and postures (`pipeline.equilibrium`): no particle is simulated.

Every shape is found going up and going down in fill. Of two shapes the one with less energy counts, and the range of a
share holds both, those of the other contact angles, and the error of the shapes: what more directions change in this
posture, and what the sphere is off Young and Laplace, in which the solver runs with the same liquids.
"""
import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np
import pyvista
from PIL import Image

from pipeline.equilibrium.contact import Contact, retina_masks
from pipeline.equilibrium.rest import Liquids, Rest, at_rest, refined_start
from pipeline.equilibrium.star_cavity import DRAFT, StarCavity, cavity_of
from pipeline.pictures.fundus_map import FundusMap
from pipeline.pictures.marks import OVERSAMPLING, reduce
from pipeline.planning.settings import postures
from pipeline.scenes.model import Eye
from pipeline.study_kit.filled_eye_page import (
    AQUEOUS,
    MODEL_ARC,
    PARTS,
    SHARES,
    SHOWN,
    SPHERE,
    TAMPONADES,
    WHOLE_SPHERE,
    as_png_file,
    fundus_picture,
)
from pipeline.study_kit.model import Outcome, Row
from pipeline.study_kit.young_laplace import Profile, oil_at_rest
from sim.parameters import parameter

GRAVITY = 9.81
HEAD_UP = "head_up_45"                      # the patient leans back by half a right angle
POSTURES = ("upright", HEAD_UP, "supine", "prone", "left_side", "right_side")
ARC_TOLERANCE, SHARE_TOLERANCE = 3.0, 1.2   # deg, points: of 2,562 directions, as in test_rest.py
FILLS = (0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 0.98)
CHECKED = (0.8, 0.95)                       # fills at which more directions are tried
MAP_SIZE = 168                              # pixels
MODEL_EYES = (9.5e-3, 12.5e-3)             # m, radii


@dataclasses.dataclass(frozen=True)
class Parameters:
    """One tamponade in one eye."""

    tamponade: str = parameter(choices=tuple(TAMPONADES), meaning="what fills the eye")
    density: float = parameter(unit="kg/m**3", exclusive_minimum=0.0, meaning="its density")
    tension: float = parameter(unit="N/m", exclusive_minimum=0.0, meaning="its interface tension with the aqueous")
    contact_angle: float = parameter(unit="deg", minimum=5.0, maximum=45.0, meaning="contact angle through the aqueous")
    other_angles: tuple[float, ...] = parameter(unit="deg", minimum=5.0, maximum=45.0,
                                                meaning="contact angles that are possible too")
    aqueous_density: float = parameter(1005.0, unit="kg/m**3", exclusive_minimum=0.0, meaning="density of the aqueous")
    axial_length: float = parameter(0.024, unit="m", minimum=0.02, maximum=0.03, meaning="cornea to retina")
    radius: float = parameter(0.011, unit="m", exclusive_minimum=0.0, meaning="radius of the sphere beside the eye")
    fills: tuple[float, ...] = parameter(FILLS, minimum=0.5, maximum=0.98, meaning="shares of the cavity filled")
    postures: tuple[str, ...] = parameter(POSTURES, choices=POSTURES, meaning="postures of the patient")
    maps: bool = parameter(False, meaning="draw the maps of the fundus")
    UNNAMED = ("density", "tension", "contact_angle", "maps")

    def liquids(self, angle: float) -> Liquids:
        """Return what decides where it rests, at a contact angle in degrees."""
        return Liquids(self.aqueous_density - self.density, self.tension, np.radians(angle), GRAVITY)


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


def run(case: Parameters) -> Outcome:
    """Let the tamponade come to rest at all fills, postures and contact angles."""
    outcome, cavity = Outcome(), cavity_of(Eye(axial_length=case.axial_length))
    front = cavity_of(Eye(axial_length=case.axial_length), from_front=True)
    finer = cavity_of(Eye(axial_length=case.axial_length), DRAFT + 1)
    exact = [oil_at_rest(fill, np.radians(case.contact_angle), abs(case.aqueous_density - case.density) * GRAVITY
                         / case.tension, case.radius, 3) for fill in case.fills]
    sphere, sphere_error = _sphere(case, exact, outcome)
    at = [case.tamponade, f"{1e3 * case.axial_length:g}"]
    lines = [[*at, SPHERE, f"{100 * fill:g}", part, *_cells(share, share, share)]
             for fill, profile in zip(case.fills, exact, strict=True)
             for part, share in (_in_sphere(case, sphere, profile) | {WHOLE_SPHERE: profile.coverage}).items()]
    outcome.rows += _model_eyes(case)
    pictures = []
    for posture in case.postures:
        down = down_of(posture)
        courses = [_course((cavity, front), case.liquids(angle), down, case.fills)
                   for angle in (case.contact_angle, *case.other_angles)]
        error = np.maximum(_error(case, finer, down, courses[0]), sphere_error)
        found = np.concatenate([course.shares for course in courses])
        low, high = np.fmin.reduce(found) - error, np.fmax.reduce(found) + error
        unknown = [f"{100 * fill:g} %" for fill, values in zip(case.fills, courses[0].least, strict=True)
                   if np.isnan(values).any()]
        if unknown:
            outcome.remarks.append(f"{TAMPONADES[case.tamponade]}, {posture.replace('_', ' ')}: no shape was found at "
                                   f"{', '.join(unknown)}, since one point must see all of its surface.")
        lines += [[*at, posture, f"{100 * fill:g}", part, *_cells(*cells)]
                  for n, fill in enumerate(case.fills) for part, *cells in zip(
                      PARTS, courses[0].least[n], np.maximum(low[n], 0.0), np.minimum(high[n], 1.0), strict=True)]
        lines += [[*at, posture, f"{100 * fill:g}", AQUEOUS, *_cells(*3 * [_in_front(rest)])]
                  for fill, rest in zip(case.fills, courses[0].best, strict=True)]
        outcome.rows.append(Row("largest change of a covered share with 10,242 directions", 100.0 * error.max(), "%",
                                at=posture))
        if case.maps:
            pictures.append(_maps(cavity, courses))
    outcome.remarks.append(
        f"{TAMPONADES[case.tamponade]}: density {case.density:g} kg/m3 (aqueous {case.aqueous_density:g}), tension "
        f"{1e3 * case.tension:g} mN/m, contact angle {case.contact_angle:g} degrees through the aqueous, and "
        f"{' and '.join(f'{angle:g}' for angle in case.other_angles)} for the range.")
    outcome.tables["shares"] = [list(SHARES), *lines]
    if case.maps:
        outcome.pictures["fundus_maps"] = as_png_file(fundus_picture(pictures, case.postures, case.fills))
    return outcome


def down_of(posture: str) -> np.ndarray:
    """Return the direction (3,) of gravity in the eye."""
    if posture == HEAD_UP:
        middle = postures()["upright"] + postures()["supine"]
        return middle / np.linalg.norm(middle)
    return postures()[posture]


def parts_of(cavity: StarCavity) -> dict[str, np.ndarray]:
    """Triangles of the parts of the retina of a right eye, name -> (m,) bool, in the order of ``PARTS``."""
    masks, center = retina_masks(cavity), cavity.wall[cavity.faces].mean(axis=1)
    temporal, before = center[:, 0] < 0.0, center[:, 2] > 0.0
    for half in ("superior", "inferior"):
        masks[f"{half}_temporal"], masks[f"{half}_nasal"] = masks[half] & temporal, masks[half] & ~temporal
    masks["before_equator"], masks["behind_equator"] = masks["retina"] & before, masks["retina"] & ~before
    return {name: masks[name] for name in PARTS}


def _shares(contact: Contact, masks: dict[str, np.ndarray]) -> np.ndarray:
    return np.array([contact.share(mask) for mask in masks.values()])


def _cells(*shares: float) -> list[str]:
    return [f"{100 * share:.1f}" if np.isfinite(share) else "" for share in shares]


def _course(cavities: Sequence[StarCavity], liquids: Liquids, down: np.ndarray, fills: Sequence[float]) -> Course:
    """Shapes going up, as when the eye is filled, and down.

    Parameters
    ----------
    cavities : of the eye; another one is tried where the oil is not seen from the point within the one before.
    """
    course = _course_in(cavities[0], liquids, down, fills)
    missing = [n for n, rest in enumerate(course.best) if not rest.settled]
    if missing and cavities[1:]:
        other = _course(cavities[1:], liquids, down, [fills[n] for n in missing])
        course.shares[:, missing], course.least[missing] = other.shares, other.least
        for n, rest in zip(missing, other.best, strict=True):
            course.best[n] = rest
    return course


def _course_in(cavity: StarCavity, liquids: Liquids, down: np.ndarray, fills: Sequence[float]) -> Course:
    masks = parts_of(cavity)
    rests: list[list[Rest]] = []
    for order in (fills, fills[::-1]):
        one: list[Rest] = []
        for fill in order:
            one.append(at_rest(cavity, liquids, down, fill, one[-1].distance if one and one[-1].settled else None))
        rests.append(one if order is fills else one[::-1])
    shares = np.array([[_shares(Contact.of(rest), masks) for rest in one] for one in rests])
    settled = np.array([[rest.settled for rest in one] for one in rests])
    energy = np.where(settled, [[rest.energy for rest in one] for one in rests], np.inf)
    chosen = energy.argmin(axis=0)
    shares[~settled] = np.nan
    return Course([rests[which][n] for n, which in enumerate(chosen)], shares, shares[chosen, np.arange(len(fills))])


def _error(case: Parameters, finer: StarCavity, down: np.ndarray, course: Course) -> np.ndarray:
    """Largest change of the shares with more directions, (parts,)."""
    masks, changes = parts_of(finer), [np.zeros(len(PARTS))]
    for n in _nearest(case.fills, CHECKED):
        if (course.best[n].cavity.viewpoint != finer.viewpoint).any():
            continue
        fine = at_rest(finer, case.liquids(case.contact_angle), down, case.fills[n],
                       refined_start(course.best[n], finer, DRAFT + 1))
        if not fine.settled:
            continue
        changes.append(np.abs(_shares(Contact.of(fine), masks) - course.least[n]))
    return np.nanmax(changes, axis=0)


def _nearest(fills: Iterable[float], wanted: Iterable[float]) -> list[int]:
    all_fills = np.array(list(fills))
    return sorted({int(np.abs(all_fills - one).argmin()) for one in wanted})


def _sphere(case: Parameters, exact: list[Profile], outcome: Outcome) -> tuple[StarCavity, float]:
    """Compare the solver in a sphere with Young and Laplace; return the sphere and its largest error of the wall."""
    sphere = StarCavity.of_level(lambda points: np.linalg.norm(points, axis=-1) - case.radius, np.zeros(3))
    errors = []
    for fill, profile in zip(case.fills, exact, strict=True):
        contact = Contact.of(at_rest(sphere, case.liquids(case.contact_angle), down_of("upright"), fill))
        at = f"sphere, fill {100 * fill:g} %"
        errors.append(abs(contact.share() - profile.coverage))
        outcome.rows += [
            Row("arc of contact", contact.arc(), "deg", at, profile.arc, abs(contact.arc() - profile.arc),
                ARC_TOLERANCE),
            Row("covered wall", 100 * contact.share(), "%", at, 100 * profile.coverage, 100 * errors[-1],
                SHARE_TOLERANCE)]
    return sphere, max(errors)


def _model_eyes(case: Parameters) -> list[Row]:
    """Arcs in spheres as small and as large as the model eyes of [hillier2011, abstract]."""
    fill = case.fills[_nearest(case.fills, [0.01 * SHOWN])[0]]
    constant = abs(case.aqueous_density - case.density) * GRAVITY / case.tension
    return [Row(MODEL_ARC, oil_at_rest(fill, np.radians(case.contact_angle), constant, radius, 3).arc, "deg",
                at=f"sphere of {2e3 * radius:g} mm, fill {100 * fill:g} %") for radius in MODEL_EYES]


def _in_sphere(case: Parameters, sphere: StarCavity, profile: Profile) -> dict[str, float]:
    """Covered shares of the parts of a sphere, the patient upright, by Young and Laplace."""
    up = np.copysign(1.0, case.aqueous_density - case.density) * -down_of("upright")
    depth = case.radius * (np.radians(0.5 * profile.arc) - np.arccos(np.clip(sphere.direction @ up, -1.0, 1.0)))
    return dict(zip(PARTS, _shares(Contact(sphere, depth), parts_of(sphere)), strict=True))


def _in_front(rest: Rest) -> float:
    """Share of the aqueous that is before the equator."""
    return rest.other.share(rest.other.position[:, 2] > 0.0) if rest.settled else np.nan


def _maps(cavity: StarCavity, courses: list[Course]) -> list[Image.Image]:
    """Maps of the fundus of all fills: hatched is where the contact angles do not agree."""
    side = OVERSAMPLING * MAP_SIZE
    chart, images = FundusMap(cavity.wall, (side, side), captions=False), []
    for n in range(len(courses[0].best)):
        margins = np.array([Contact.of(course.best[n]).margin for course in courses if course.best[n].cavity is cavity])
        wall = pyvista.PolyData(cavity.wall)
        wall.point_data["contact_distance"] = margins[0]
        wall.point_data["oil_fraction_covered"] = np.ones(len(cavity.wall))
        wall.point_data["oil_fraction_bare"] = np.zeros(len(cavity.wall))
        doubtful = (margins > 0.0).any(axis=0) & (margins <= 0.0).any(axis=0)
        images.append(reduce(chart.draw(wall, uncertain=np.where(doubtful, 2.0 * np.abs(margins[0]), 0.0))))
    return images
