"""What oil or gas at rest touches in an eye, for fills and postures (`pipeline.equilibrium`): no particle is simulated.

Of two shapes at rest the one with less energy counts, and the range of a share holds both, those of the other contact
angles, and the error of the shapes: what more directions change in this posture, and what the sphere is off Young and
Laplace, in which the solver runs with the same liquids.
"""
import dataclasses

import numpy as np

from pipeline.equilibrium.contact import Contact
from pipeline.equilibrium.least import Resting
from pipeline.equilibrium.rest import Liquids, at_rest
from pipeline.equilibrium.star_cavity import StarCavity
from pipeline.scenes.model import Eye
from pipeline.studies.family import Family
from pipeline.studies.model import Outcome, Row
from sim.parameters import parameter
from studies.questions.filled_eye._words import MODEL_ARC, SPHERE, TAMPONADES, TOUCHED_BY_FILL, WHOLE_SPHERE
from studies.questions.kit.eye_pictures import as_png_file, fundus_picture
from studies.questions.kit.fills_at_rest import (
    GRAVITY,
    POSTURES,
    change_with_directions,
    course_of,
    down_of,
    fundus_maps,
    in_front,
    nearest,
    parts_of,
    percents,
    range_of,
    shares_of,
)
from studies.questions.kit.words import AQUEOUS, PARTS, SHOWN
from studies.validation.kit.young_laplace import Profile, oil_at_rest

ARC_TOLERANCE, SHARE_TOLERANCE = 3.0, 1.2   # deg, points: of 2,562 directions, as in test_rest.py
FILLS = (0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 0.98)
CHECKED = (0.8, 0.95)                       # fills at which more directions are tried
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

    def liquids(self, angle: float) -> Liquids:
        """Return what decides where it rests, at a contact angle in degrees."""
        return Liquids(self.aqueous_density - self.density, self.tension, np.radians(angle), GRAVITY)


def run(case: Parameters) -> Outcome:
    """Let the tamponade come to rest at all fills, postures and contact angles."""
    outcome, resting = Outcome(), Resting.of(Eye(axial_length=case.axial_length))
    exact = [oil_at_rest(fill, np.radians(case.contact_angle), abs(case.aqueous_density - case.density) * GRAVITY
                         / case.tension, case.radius, 3) for fill in case.fills]
    sphere, sphere_error = _sphere(case, exact, outcome)
    at = [case.tamponade, f"{1e3 * case.axial_length:g}"]
    lines = [[*at, SPHERE, f"{100 * fill:g}", part, *percents(share, share, share)]
             for fill, profile in zip(case.fills, exact, strict=True)
             for part, share in (_in_sphere(case, sphere, profile) | {WHOLE_SPHERE: profile.coverage}).items()]
    outcome.rows += _model_eyes(case)
    pictures = []
    for posture in case.postures:
        down = down_of(posture)
        courses = [course_of(resting, case.liquids(angle), down, case.fills)
                   for angle in (case.contact_angle, *case.other_angles)]
        changes = change_with_directions(resting, case.liquids(case.contact_angle), down, courses[0],
                                         nearest(case.fills, CHECKED))
        error = np.maximum(changes, sphere_error)
        low, high = range_of(courses, error)
        unknown = [f"{100 * fill:g} %" for fill, values in zip(case.fills, courses[0].least, strict=True)
                   if np.isnan(values).any()]
        if unknown:
            outcome.remarks.append(f"{TAMPONADES[case.tamponade]}, {posture.replace('_', ' ')}: no shape was found at "
                                   f"{', '.join(unknown)}, since one point must see all of its surface.")
        lines += [[*at, posture, f"{100 * fill:g}", part, *percents(*shares)] for n, fill in enumerate(case.fills)
                  for part, *shares in zip(PARTS, courses[0].least[n], low[n], high[n], strict=True)]
        lines += [[*at, posture, f"{100 * fill:g}", AQUEOUS, *percents(*3 * [in_front(courses[0].best(n))])]
                  for n, fill in enumerate(case.fills)]
        outcome.rows.append(Row("largest change of a covered share with 10,242 directions", 100.0 * error.max(), "%",
                                at=posture))
        if case.maps:
            pictures.append(fundus_maps(resting, courses, range(len(case.fills))))
    outcome.remarks.append(
        f"{TAMPONADES[case.tamponade]}: density {case.density:g} kg/m3 (aqueous {case.aqueous_density:g}), tension "
        f"{1e3 * case.tension:g} mN/m, contact angle {case.contact_angle:g} degrees through the aqueous, and "
        f"{' and '.join(f'{angle:g}' for angle in case.other_angles)} for the range.")
    outcome.tables["shares"] = [list(TOUCHED_BY_FILL), *lines]
    if case.maps:
        outcome.pictures["fundus_maps"] = as_png_file(fundus_picture(pictures, case.postures, case.fills,
                                                                          TAMPONADES[case.tamponade]))
    return outcome


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
    fill = case.fills[nearest(case.fills, [0.01 * SHOWN])[0]]
    constant = abs(case.aqueous_density - case.density) * GRAVITY / case.tension
    return [Row(MODEL_ARC, oil_at_rest(fill, np.radians(case.contact_angle), constant, radius, 3).arc, "deg",
                at=f"sphere of {2e3 * radius:g} mm, fill {100 * fill:g} %") for radius in MODEL_EYES]


def _in_sphere(case: Parameters, sphere: StarCavity, profile: Profile) -> dict[str, float]:
    """Covered shares of the parts of a sphere, the patient upright, by Young and Laplace."""
    up = np.copysign(1.0, case.aqueous_density - case.density) * -down_of("upright")
    depth = case.radius * (np.radians(0.5 * profile.arc) - np.arccos(np.clip(sphere.direction @ up, -1.0, 1.0)))
    return dict(zip(PARTS, shares_of(Contact(sphere, depth), parts_of(sphere)), strict=True))


# Of gravity it reads the postures.
FAMILY = Family(__name__, Parameters, run, effects=("gravity",),
                unnamed=("density", "tension", "contact_angle", "maps"))
