"""The sharp shape of oil at rest (`pipeline.equilibrium`) against Young and Laplace, and against another minimizer.

In a sphere the arc of contact, the covered wall and the height of the interface on the axis are compared with the
equations of Young and Laplace. In the default eye they are compared with numbers that a minimizer of its own has given,
with a contact line that is free on the exact wall; there the covered retina decides. The finest directions come last.
"""
import dataclasses
import time
from typing import Any

import numpy as np

from pipeline.equilibrium.contact import Contact, shares
from pipeline.equilibrium.rest import Liquids, at_rest, refined_start
from pipeline.equilibrium.star_cavity import StarCavity, cavity_of
from pipeline.scenes.model import Eye
from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row
from sim.parameters import parameter
from studies.validation.kit.young_laplace import oil_at_rest

GRAVITY = 9.81
UPRIGHT = np.array([0.0, -1.0, 0.0])
ARC_TOLERANCE, SHARE_TOLERANCE, HEIGHT_TOLERANCE = 3.0, 1.0, 0.1    # deg, points, mm
# Fill and angle of contact, deg -> what another minimizer found in the default eye, upright, 35 kg/m3, 40 mN/m.
EYE = {
    (0.85, 18.2): {"arc": 242.9, "wall": 61.8, "retina": 67.5, "superior": 99.0, "inferior": 36.0, "macula": 100.0},
    (0.85, 10.0): {"retina": 62.1, "inferior": 27.7},
    (0.85, 25.0): {"retina": 70.9, "inferior": 41.9},
    (0.85, 35.0): {"retina": 74.5, "inferior": 49.0},
}
FIGURES = (Figure("oil_at_rest", "Arc of contact with more directions", "directions", "arc less reference, deg"),)


@dataclasses.dataclass(frozen=True)
class Parameters:
    """Oil at rest in the upright posture."""

    cavity: str = parameter("sphere", choices=("sphere", "eye"), meaning="a sphere, or the default eye")
    fill: float = parameter(0.8, minimum=0.5, maximum=0.99, meaning="share of the cavity that is oil")
    contact_angle: float = parameter(18.2, unit="deg", minimum=5.0, maximum=45.0,
                                     meaning="contact angle through the water")
    density_difference: float = parameter(35.0, unit="kg/m**3", meaning="density of the water less that of the oil")
    tension: float = parameter(0.04, unit="N/m", exclusive_minimum=0.0, meaning="interface tension")
    radius: float = parameter(0.011, unit="m", exclusive_minimum=0.0, meaning="radius of the sphere")
    cuts: tuple[int, ...] = parameter((3, 4, 5), minimum=3, maximum=6, meaning="cuts of an icosahedron, coarse to fine")


def run(case: Parameters) -> Outcome:
    """Let the oil come to rest with ever more directions."""
    outcome, arcs = Outcome(), []
    liquids = Liquids(case.density_difference, case.tension, np.radians(case.contact_angle), GRAVITY)
    expected = (_expected_in_sphere(case) if case.cavity == "sphere" else
                EYE.get((case.fill, case.contact_angle), {}))
    before = None
    for cuts in case.cuts:
        began = time.perf_counter()
        cavity = cavity_of(Eye(), cuts) if case.cavity == "eye" else _sphere(case.radius, cuts)
        start = refined_start(before, cavity, cuts) if before is not None else None
        before = at_rest(cavity, liquids, UPRIGHT, case.fill, start)
        contact = Contact.of(before)
        found = {name: 100.0 * share for name, share in shares(contact).items()} | {"arc": contact.arc()}
        lowest = 1e3 * before.surface[cavity.direction[:, 1].argmin(), 1]
        at: dict[str, Any] = {"at": f"{len(cavity.direction)} directions", "wall_s": time.perf_counter() - began}
        finest = cuts == case.cuts[-1]
        for name, value in (*found.items(), ("height on the axis", lowest)):
            unit, tolerance = {"arc": ("deg", ARC_TOLERANCE), "height on the axis": ("mm", HEIGHT_TOLERANCE)}.get(
                name, ("%", SHARE_TOLERANCE))
            if name in expected:
                error, allowed = abs(value - expected[name]), tolerance if finest else None
                outcome.rows.append(Row(_WORDS.get(name, name), value, unit, reference=expected[name], error=error,
                                        tolerance=allowed, **at))
        if not before.settled:
            outcome.remarks.append(f"{case.cavity} {case.fill:g}, {at['at']}: did not come to rest")
        arcs.append(found["arc"] - expected["arc"] if "arc" in expected else np.nan)
    counts = [10 * 4**cuts + 2 for cuts in case.cuts]
    label = f"{case.cavity} {case.fill:g} {case.contact_angle:g} deg"
    outcome.curves.append(Curve("oil_at_rest", label, counts, arcs, "line"))
    return outcome


_WORDS = {"arc": "arc of contact", "wall": "covered wall", "retina": "covered retina",
          "superior": "covered upper half of the retina", "inferior": "covered lower half of the retina",
          "macula": "covered macula"}


def _sphere(radius: float, cuts: int) -> StarCavity:
    return StarCavity.of_level(lambda points: np.linalg.norm(points, axis=-1) - radius, np.zeros(3), cuts)


def _expected_in_sphere(case: Parameters) -> dict[str, float]:
    exact = oil_at_rest(case.fill, np.radians(case.contact_angle),
                        case.density_difference * GRAVITY / case.tension, case.radius, 3)
    return {"arc": exact.arc, "wall": 100.0 * exact.coverage, "height on the axis": 1e3 * exact.apex}


FAMILY = Family(__name__, Parameters, run, figures=FIGURES)
