"""What light oil at rest touches in the eye of a patient (`pipeline.equilibrium`), for fills and postures.

Of two shapes at rest the one with less energy counts, and the range of a share holds both, those of the other contact
angles, and what more directions change. Pictures: a section of the eye, patient upright, and a map of the fundus for
every posture.
"""
import dataclasses

import numpy as np
from PIL import Image

from pipeline.cavity.eye_files import eye_files
from pipeline.cavity.surface import cavity_mesh
from pipeline.equilibrium.least import Resting
from pipeline.equilibrium.rest import Liquids
from pipeline.scenes.model import Eye
from pipeline.studies.family import Family
from pipeline.studies.model import Outcome, Row
from sim.parameters import parameter
from studies.questions.kit.eye_pictures import as_png_file, row_of_pictures, section_of_eye
from studies.questions.kit.fills_at_rest import (
    GRAVITY,
    POSTURES,
    change_with_directions,
    course_of,
    down_of,
    fundus_maps,
    in_front,
    nearest,
    percents,
    range_of,
)
from studies.questions.kit.words import AQUEOUS, PARTS, SHOWN
from studies.questions.patient_eyes._words import GROUPS, ROW, TOUCHED_BY_EYE, VOLUME


@dataclasses.dataclass(frozen=True)
class Parameters:
    """One eye, filled with light oil."""

    patient: str = parameter(meaning="name of the eye, for files")
    words: str = parameter(meaning="name of the eye, for the page")
    group: str = parameter(choices=tuple(GROUPS), meaning="what it is there to show")
    eye: Eye = parameter(Eye(), meaning="the eye, as in a scene")
    density: float = parameter(970.0, unit="kg/m**3", exclusive_minimum=0.0, meaning="density of the oil")
    aqueous_density: float = parameter(1005.0, unit="kg/m**3", exclusive_minimum=0.0, meaning="density of the aqueous")
    tension: float = parameter(0.04, unit="N/m", exclusive_minimum=0.0, meaning="interface tension")
    contact_angle: float = parameter(18.2, unit="deg", minimum=5.0, maximum=45.0,
                                     meaning="contact angle through the aqueous")
    other_angles: tuple[float, ...] = parameter((10.0, 25.0), unit="deg", minimum=5.0, maximum=45.0,
                                                meaning="contact angles that are possible too")
    fills: tuple[float, ...] = parameter((0.75, 0.85, 0.95), minimum=0.5, maximum=0.98,
                                         meaning="shares of the cavity filled")
    postures: tuple[str, ...] = parameter(("upright", "supine", "prone", "left_side"), choices=POSTURES,
                                          meaning="postures of the patient")

    def liquids(self, angle: float) -> Liquids:
        """Return what decides where the oil rests, at a contact angle in degrees."""
        return Liquids(self.aqueous_density - self.density, self.tension, np.radians(angle), GRAVITY)


def files(case: Parameters) -> list[str]:
    """Files that the case reads."""
    return eye_files(case.eye)


def run(case: Parameters) -> Outcome:
    """Let the oil come to rest at all fills, postures and contact angles."""
    outcome, right_eye = Outcome(), case.eye.side == "right"
    mesh, source = cavity_mesh(case.eye)
    outcome.rows.append(Row(VOLUME, 1e6 * mesh.volume, "mL", case.words,
                            1e6 * source["published_volume"] if "published_volume" in source else None))
    outcome.remarks += [f"{case.words}: {sentence}." for sentence in source.get("orientation", ())]
    resting = Resting.of(case.eye)
    shown = nearest(case.fills, [0.01 * SHOWN])
    lines, maps, section = [], [], Image.new("RGB", (1, 1))
    for posture in case.postures:
        down = down_of(posture)
        courses = [course_of(resting, case.liquids(angle), down, case.fills, right_eye=right_eye)
                   for angle in (case.contact_angle, *case.other_angles)]
        error = change_with_directions(resting, case.liquids(case.contact_angle), down, courses[0], shown,
                                       right_eye=right_eye)
        low, high = range_of(courses, error)
        for n, fill in enumerate(case.fills):
            at = [case.words, posture, f"{100 * fill:g}"]
            lines += [[*at, part, *percents(*shares)]
                      for part, *shares in zip(PARTS, courses[0].least[n], low[n], high[n], strict=True)]
            lines.append([*at, AQUEOUS, *percents(*3 * [in_front(courses[0].best(n))])])
        outcome.rows.append(Row("largest change of a covered share with 10,242 directions", 100.0 * error.max(), "%",
                                f"{case.words}, {posture}"))
        maps += fundus_maps(resting, courses, shown, right_eye=right_eye)
        if posture == case.postures[0] and (best := courses[0].best(shown[0])) is not None:
            section = section_of_eye(best)
    outcome.tables["shares"] = [list(TOUCHED_BY_EYE), *lines]
    outcome.tables["eye"] = [[case.words, case.group]]
    outcome.pictures[ROW] = as_png_file(row_of_pictures([section, *maps]))
    return outcome


# Of gravity it reads the postures.
FAMILY = Family(__name__, Parameters, run, effects=("gravity",), files=files, unnamed=("eye", "words", "group"))
