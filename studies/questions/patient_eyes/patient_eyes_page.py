"""The page of the study of eyes: one answer, one picture, one table, and what it rests on."""
import dataclasses
import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from pipeline.base import page
from pipeline.base.errors import UserError
from pipeline.base.files import write_text
from pipeline.base.tables import csv_of
from pipeline.equilibrium.checked import SIMULATED
from pipeline.studies.model import Outcome, Row
from pipeline.studies.question_page import QuestionPage, StudyPage, joined_tables, link_to, write_picture
from studies.questions.filled_eye.filled_eye_page import SHOWN_PARTS, Share
from studies.questions.kit.eye_pictures import all_eyes, as_png_file
from studies.questions.kit.words import AQUEOUS, SHOWN, posture_words
from studies.questions.patient_eyes._words import GROUPS, ROW, VOLUME

PICTURES, TABLES = ("eye_maps",), ("shares",)
OTHER_PARTS = ("retina", "inferior", "macula")      # of other postures
MOVED = 10.0                                # percent of the aqueous that goes to the front, worth a sentence
Key = tuple[str, str, float, str]           # eye, posture, fill in percent, part


@dataclasses.dataclass(frozen=True)
class Eyes:
    """All shares of the study, and the group of every eye."""

    found: dict[Key, Share]
    groups: dict[str, str]
    volumes: dict[str, Row]

    @classmethod
    def of(cls, outcomes: Sequence[Outcome]) -> "Eyes":
        """Read the tables of the cases."""
        lines = [line for outcome in outcomes for line in outcome.tables["shares"][1:]]
        found = {(line[0], line[1], float(line[2]), line[3]): Share(*(float(cell or "nan") for cell in line[4:]))
                 for line in lines}
        groups = {name: group for outcome in outcomes for name, group in outcome.tables["eye"]}
        volumes = {row.at: row for outcome in outcomes for row in outcome.rows if row.quantity == VOLUME}
        return cls(found, groups, volumes)

    def at(self, eye: str, posture: str, part: str, fill: float | None = None) -> Share:
        """Return one share, at the fill that is shown if no other is asked for."""
        return self.found[eye, posture, self.shown if fill is None else fill, part]

    @property
    def postures(self) -> list[str]:
        """Postures of all eyes."""
        return list(dict.fromkeys(key[1] for key in self.found))

    @property
    def fills(self) -> list[float]:
        """Fills, %, rising."""
        return sorted({key[2] for key in self.found})

    @property
    def shown(self) -> float:
        """Fill of picture and table, %."""
        return min(self.fills, key=lambda fill: abs(fill - SHOWN))

    def of_group(self, group: str) -> list[str]:
        """Names of the eyes of a group."""
        return [name for name, one in self.groups.items() if one == group]


def write_page(description: str, outcomes: Sequence[Outcome], target: Path) -> list[str]:
    """Write ``shares.csv`` and ``eye_maps.png`` into a folder, and return the parts of the page."""
    write_text(target / "shares.csv", csv_of(*joined_tables(outcomes, "shares")))
    eyes = Eyes.of(outcomes)
    if any(ROW not in outcome.pictures for outcome in outcomes):
        raise UserError("a case of the study has no picture; run it again")
    rows = [Image.open(io.BytesIO(outcome.pictures[ROW])).convert("RGB") for outcome in outcomes]
    picture = as_png_file(all_eyes(list(eyes.groups), rows, eyes.postures))
    write_picture(target / f"{PICTURES[0]}.png", picture)
    first = eyes.postures[0]
    others = [(name, *(str(eyes.at(name, posture, part)) for posture in eyes.postures[1:] for part in OTHER_PARTS))
              for name in eyes.groups]
    heads = ("", *(f"{posture_words(posture)}: {part}" for posture in eyes.postures[1:] for part in OTHER_PARTS))
    table = page.table(
        ("", "mL", *SHOWN_PARTS.values()),
        [(name, f"{eyes.volumes[name].value:.1f}", *(str(eyes.at(name, first, part)) for part in SHOWN_PARTS))
         for name in eyes.groups], words=(0,),
        marked=[number for number, name in enumerate(eyes.groups) if eyes.groups[name] in ("wall", "mesh")],
    ) + page.paragraph(
        "Open in front: the anterior chamber holds oil too. Volume of the cavity, then percent of each part: inferior "
        "half, macula, temporal and nasal quadrants (ST, SN, IT, IN), behind and before the equator. In brackets what "
        "it may be: with other contact angles, with the second shape that may be at rest, and by the error of the "
        "computation. Other fills are in", page.link("shares.csv", "shares.csv") + ".",
        "Shaded: eyes with a changed wall, and the mesh.")
    why = [sentence for name in eyes.of_group("wall") if (sentence := _why_in_front(eyes, name))]
    return QuestionPage(
        description=f"{description} {eyes.shown:g} % of the cavity is oil, the rest is aqueous. What it touches "
                    f"in the {first} patient, in percent of the area:",
        answers=findings(eyes),
        picture=picture,
        picture_words="Sections of the eyes and maps of the fundus, posture by posture",
        caption=(f"First a section of the eye from the side, patient {first}, front on the left; then maps of the "
                 "fundus as an observer sees it who faces the patient: macula in the middle, then equator and ora "
                 "serrata. Ivory is oil, blue is aqueous; hatched where it is uncertain.",),
        folded={f"Eye by eye, patient {first}": table, "The same eyes in other postures": page.table(heads, others)}
        | ({"Why a band helps in some places": page.bullets(why)} if why else {}),
        assumed=_assumed(eyes, outcomes),
        validated=validated(outcomes),
        not_validated="against patients, or against an experiment in a real eye. A buckle, a staphyloma and a filled "
                      "anterior chamber were compared with nothing but the simulations named there.",
        words=("touched", "aqueous", "supine and prone", "fundus", "contact angle", "tension", "at rest", "points",
               "grid"),
    ).parts()


def findings(eyes: Eyes) -> list[str]:
    """Return what the groups of eyes tell, in sentences, the length first."""
    first, found = eyes.postures[0], []
    lengths = eyes.of_group("length")
    if len(lengths) > 1:
        values = [eyes.at(name, first, "retina").value for name in lengths]
        words = ", ".join(f"{value:.0f} % at {name}" for name, value in zip(lengths, values, strict=True))
        short, long = (eyes.volumes[lengths[end]].value for end in (0, -1))
        found.append(f"Length: of the retina the oil touches {words}, {_way(values)}. A longer eye needs more oil for "
                     f"the same share: the cavity holds {short:.1f} mL in the shortest and {long:.1f} mL in the "
                     "longest.")
    for group in [group for group in GROUPS if group != "length" and eyes.of_group(group)]:
        told = [f"{name}: {eyes.at(name, first, 'retina').value:.0f} % of the retina, "
                f"{eyes.at(name, first, 'inferior').value:.0f} % of its inferior half" for name in eyes.of_group(group)]
        found.append(f"{GROUPS[group].capitalize()}: {'; '.join(told)}.")
    return found


def _why_in_front(eyes: Eyes, name: str) -> str:
    """Return why an eye with a changed wall is touched in other places than the plain one; empty where it is not."""
    plain = name.partition(",")[0]
    if plain not in eyes.groups:
        return ""
    (front, before), (behind, behind_before), (ahead, ahead_before) = (
        [eyes.at(eye, eyes.postures[0], part).value for eye in (name, plain)]
        for part in (AQUEOUS, "behind_equator", "before_equator"))
    if front < before + MOVED or behind <= behind_before or ahead >= ahead_before:
        return ""
    return (f"Why that helps in some places ({name}): tension keeps the oil in one round body, behind the ridge, and "
            f"{front:.0f} % of the aqueous is before the equator, {before:.0f} % in the plain eye. More of the retina "
            f"behind the equator is touched then ({behind:.0f} in place of {behind_before:.0f} %), and less of it "
            f"before the equator ({ahead:.0f} in place of {ahead_before:.0f} %).")


def _way(values: Sequence[float]) -> str:
    steps = np.diff(values)
    return "rising with length" if (steps > 0.0).all() else "falling with length" if (steps < 0.0).all() else \
        "neither rising nor falling steadily"


def _assumed(eyes: Eyes, outcomes: Sequence[Outcome]) -> list[str]:
    volumes = [f"{name} {row.value:.2f} ({row.reference:.2f})" for name, row in eyes.volumes.items()
               if row.reference is not None]
    return [
        "Light oil: density 970 kg/m3 (aqueous 1005), tension 40 mN/m, contact angle 18.2 degrees through the "
        "aqueous, 10 and 25 for the range. Viscosity does not matter. The head rests, and the oil is one body.",
        "Eyes are shapes from a few lengths that clinics measure, not images: an ellipsoid behind the lens. A buckle "
        "is a smooth groove, a staphyloma a smooth bulge. The retina is attached.",
        f"Volume in mL, in brackets that of operated eyes of the same axial length (144 eyes, de Santana et al.): "
        f"{', '.join(volumes)}.",
        "Fill is a share of the volume of the whole cavity, with the anterior chamber where oil gets into it. Retina: "
        "up to 115 degrees from the posterior pole. Macula: a disc of 5.5 mm. All are right eyes.",
        *dict.fromkeys(remark for outcome in outcomes for remark in outcome.remarks)]


def validated(outcomes: Sequence[Outcome]) -> list[str]:
    """Return how far the shapes were checked."""
    changes = [row.value for outcome in outcomes for row in outcome.rows if row.quantity.startswith("largest change")]
    return [
        f"A grid with four times as many directions changes a covered share by at most {max(changes):.1f} points; the "
        "range holds that, for each eye, posture and part.",
        page.joined("The method was compared with exact shapes in spheres, with Surface Evolver in the average eye, "
                    "and with simulations:", link_to("methods/equilibrium.md") + "."), SIMULATED]


PAGE = StudyPage(__name__, PICTURES, TABLES, write_page)
