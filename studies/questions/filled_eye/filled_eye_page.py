"""The page of the study of fills: one answer, one picture, one table, what it rests on, and what was published.

Sources of what is set beside: [fawcett1994, abstract], [rossi2021, abstract], [hillier2011, abstract], [isakova2017,
abstract].
"""
import dataclasses
import itertools
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from pipeline.base import page
from pipeline.base.errors import UserError
from pipeline.base.files import write_text
from pipeline.base.palette import COLORS
from pipeline.base.tables import csv_of
from pipeline.equilibrium.checked import SIMULATED
from pipeline.studies.model import Outcome
from pipeline.studies.question_page import (
    QuestionPage,
    StudyPage,
    drawn,
    joined_tables,
    link_to,
    write_picture,
)
from studies.questions.filled_eye._words import MODEL_ARC, SPHERE, TAMPONADES, WHOLE_SPHERE
from studies.questions.kit.words import AQUEOUS, SHOWN, posture_words

PICTURES, TABLES = ("fill_curves", "fundus_maps"), ("shares",)

SHOWN_PARTS = {"retina": "retina", "inferior": "inferior", "macula": "macula",
               "superior_temporal": "ST", "superior_nasal": "SN", "inferior_temporal": "IT", "inferior_nasal": "IN",
               "behind_equator": "behind eq.", "before_equator": "before eq."}
PUBLISHED = (55.0, 78.0)  # % of the retina [rossi2021, abstract]


@dataclasses.dataclass(frozen=True)
class Share:
    """A covered share in percent, and what it may be."""

    value: float
    low: float
    high: float

    def __str__(self) -> str:
        if np.isnan(self.value):
            return "–"
        low, high = f"{self.low:.0f}", f"{self.high:.0f}"
        return f"{self.value:.0f}" if low == high else f"{self.value:.0f} ({low}–{high})"


Key = tuple[str, str, str, float, str]  # tamponade, axial length in mm, posture, fill in percent, part


@dataclasses.dataclass(frozen=True)
class Shares:
    """All shares of a study."""

    found: dict[Key, Share]
    length: str             # mm, of the eye with all postures

    @classmethod
    def of(cls, lines: Iterable[Sequence[str]]) -> "Shares":
        """Read the lines of the table ``shares``."""
        found = {(line[0], line[1], line[2], float(line[3]), line[4]):
                 Share(*(float(cell or "nan") for cell in line[5:])) for line in lines}
        many = {length: len({key[2] for key in found if key[1] == length}) for _, length, *_ in found}
        return cls(found, max(many, key=lambda length: many[length]))

    def at(self, tamponade: str, posture: str, fill: float, part: str, length: str = "") -> Share:
        """Return one share."""
        return self.found[tamponade, length or self.length, posture, fill, part]

    def knows(self, *places: tuple[str, str, float]) -> bool:
        """Tell whether there are shares of tamponades in postures at fills."""
        return all((tamponade, self.length, posture, fill, "retina") in self.found
                   for tamponade, posture, fill in places)

    def _names(self, column: int) -> list:
        return list(dict.fromkeys(key[column] for key in self.found))

    @property
    def tamponades(self) -> list[str]:
        """Names of the tamponades."""
        return self._names(0)

    @property
    def lengths(self) -> list[str]:
        """Axial lengths, mm, the shortest first."""
        return sorted(self._names(1), key=float)

    @property
    def postures(self) -> list[str]:
        """Names of the postures."""
        return [name for name in self._names(2) if name != SPHERE]

    @property
    def fills(self) -> np.ndarray:
        """Fills, %."""
        return np.array(sorted(self._names(3)))

    @property
    def shown(self) -> float:
        """Fill of the table, %."""
        return float(self.fills[np.abs(self.fills - SHOWN).argmin()])


def write_page(description: str, outcomes: Sequence[Outcome], target: Path) -> list[str]:
    """Write ``shares.csv`` and ``fill_curves.png`` into a folder, and return the parts of the page.

    Raises
    ------
    UserError : the cases have no maps of the fundus.
    """
    heads, lines = joined_tables(outcomes, "shares")
    write_text(target / "shares.csv", csv_of(heads, lines))
    shares = Shares.of(lines)
    curves = _curves(shares)
    write_picture(target / "fill_curves.png", curves)
    maps = next((outcome.pictures["fundus_maps"] for outcome in outcomes if "fundus_maps" in outcome.pictures), None)
    if maps is None:
        raise UserError("the study has no maps of the fundus: one of its cases needs `maps: true`")
    return _page(description, shares, outcomes, curves, maps).parts()


def _page(description: str, shares: Shares, outcomes: Sequence[Outcome], curves: bytes, maps: bytes) -> QuestionPage:
    rows = [(f"{TAMPONADES[tamponade]}, {posture_words(posture)}",
             *(str(shares.at(tamponade, posture, shares.shown, part)) for part in SHOWN_PARTS))
            for tamponade in shares.tamponades for posture in shares.postures]
    upright = [number for number, row in enumerate(rows) if row[0].endswith("upright")]
    table = page.table(("", *SHOWN_PARTS.values()), rows, words=(0,), marked=upright) + page.paragraph(
        "In percent of each part: inferior half, macula, temporal and nasal quadrants (ST, SN, IT, IN), behind and "
        "before the equator. In brackets what it may be: with other contact angles, with the second shape that may be "
        "at rest when lying (the macula of a supine patient is bare in one and may be touched in the other), and by "
        "the error of the computation. Head up 45°: the patient leans back by 45 degrees. Temporal and nasal are "
        "those of a right eye, whose nasal side is below when the patient lies on the left. Other fills are in",
        page.link("shares.csv", "shares.csv") + ".", "Shaded: the patient is upright.")
    by_fill = page.picture(curves, "Covered share of the retina and of its inferior half against the fill") + \
        page.paragraph("Bands: what the contact angle and the computation leave open. Dashed: a sphere of 11 mm "
                       "radius, exact (Young and Laplace).", front_edges(shares))
    return QuestionPage(
        f"{description} The rest is aqueous. What {shares.shown:g} % touch, in percent of the area:", answers(shares),
        maps, "Maps of the fundus: postures below each other, fills side by side",
        ["Light oil, posture by posture. Maps of a right eye as an observer sees it who faces the patient: macula in "
         "the middle, then equator and ora serrata; temporal is on the left. Ivory is touched, blue is not; hatched "
         "where it is uncertain."],
        {f"What a fill of {shares.shown:g} % touches, in every posture": table,
         "Fill by fill, patient upright": by_fill,
         "Beside what was published": page.bullets(anchors(shares, outcomes))},
        _assumed(outcomes), validated(shares, outcomes),
        "against patients, or against an experiment in a real eye. Tension and contact angle in an operated eye, with "
        "protein and blood, are unknown.",
        ("touched", "aqueous", "light and heavy oil", "supine and prone", "fundus", "contact angle", "tension",
         "at rest", "points", "grid"))


def answers(shares: Shares) -> list[str]:
    """Return what every tamponade touches, in the upright patient and where it reaches the inferior half best."""
    found = []
    for name in shares.tamponades:
        retina, inferior, macula = (shares.at(name, "upright", shares.shown, part)
                                    for part in ("retina", "inferior", "macula"))
        words = TAMPONADES[name]
        said = (f"{words[0].upper()}{words[1:]}, patient upright: {retina} % of the retina, {inferior} % of its "
                f"inferior half, {macula} % of the macula")
        below = {posture: shares.at(name, posture, shares.shown, "inferior") for posture in shares.postures}
        best = max(below, key=lambda posture: np.nan_to_num(below[posture].value))
        found.append(said + ("." if best == "upright" else
                             f"; most of the inferior half when {posture_words(best)}, {below[best]} %."))
    return found


def front_edges(shares: Shares) -> str:
    """Return the sentence on why the eye differs from the sphere."""
    name = shares.tamponades[0]
    front = shares.at(name, "upright", shares.shown, AQUEOUS).value
    eye, sphere = (shares.at(name, posture, shares.shown, "retina") for posture in ("upright", SPHERE))
    return (f"The eye is no sphere: its front edges, where globe, ciliary body and lens meet, hold aqueous "
            f"({front:.0f} % of the aqueous is before the equator at a fill of {shares.shown:g} %, in a sphere half), "
            f"so that {TAMPONADES[name]} touches {eye.value:.0f} % of the retina, in the sphere {sphere.value:.0f} %.")


def anchors(shares: Shares, outcomes: Sequence[Outcome]) -> list[str]:
    """Return what was published, and what is found here."""
    found = []
    if shares.knows(("gas", "upright", 80.0), ("light_oil", "upright", 80.0)):
        gas, oil = ([shares.at(name, "upright", fill, "retina").value for fill in (80.0, shares.fills[-1])]
                    for name in ("gas", "light_oil"))
        arcs = [_arc(shares, name, 80.0) for name in ("gas", "light_oil")]
        found.append(f"Gas has a longer arc of contact than oil of the same volume (Fawcett et al. 1994). Here, at "
                     f"80 %: {arcs[0]:.0f} and {arcs[1]:.0f} degrees in a sphere; {gas[0]:.0f} and {oil[0]:.0f} % of "
                     f"the retina of the eye. At {shares.fills[-1]:g} % gas touches {gas[1]:.0f}, oil "
                     f"{oil[1]:.0f} % of it.")
    places = [posture for posture in ("upright", "head_up_45", "supine") if posture in shares.postures]
    if shares.knows(*(("light_oil", posture, fill) for posture in places for fill in (80.0, 90.0))):
        range_of = {posture: [shares.at("light_oil", posture, fill, "retina").value for fill in (80.0, 90.0)]
                    for posture in places}
        outside = [posture_words(posture) for posture, (low, high) in range_of.items()
                   if low < PUBLISHED[0] or high > PUBLISHED[1]]
        words = ", ".join(f"{posture_words(posture)} {low:.0f}–{high:.0f} %"
                          for posture, (low, high) in range_of.items())
        macula = ", ".join(f"{posture_words(posture)} {shares.at('light_oil', posture, 90.0, 'macula')} %"
                           for posture in places)
        inferior, superior = (shares.at("light_oil", "upright", 90.0, part).value for part in ("inferior", "superior"))
        found += [f"Oil of 80–90 % touched 55–78 % of the retina of a 24 mm phakic eye, standing, 45 degrees up and "
                  f"supine (Rossi et al. 2021, computed by others). Here: {words}; " + (
                      f"not within that: {', '.join(outside)}." if outside else "all within that."),
                  f"The macula was touched whole only when standing (the same). Here at 90 %: {macula}.",
                  f"The superior retina always has better contact, and at 90 % the inferior one remains hard to reach "
                  f"(the same). Here, upright: {superior:.0f} and {inferior:.0f} %."]
    if len(shares.lengths) > 1:
        light = [f"{shares.at('light_oil', 'upright', shares.shown, 'retina', length).value:.1f} % at {length} mm"
                 for length in shares.lengths]
        values = [shares.at("light_oil", "upright", shares.shown, "retina", length).value for length in shares.lengths]
        shrinks = all(after < before for before, after in itertools.pairwise(values))
        arc = {row.at: row.value for outcome in outcomes for row in outcome.rows
               if row.quantity == MODEL_ARC and outcome.tables["shares"][1][0] == "light_oil"}
        spheres = ", ".join(f"{value:.0f} degrees in a {at}" for at, value in sorted(arc.items()))
        found += [f"Model eyes of 19 and 25 mm did not differ with oil (Hillier et al. 2011). Here, exact: {spheres}.",
                  f"In long, myopic eyes the share was smaller (Isakova et al. 2017, computed by others). Here, "
                  f"{shares.shown:g} % of light oil, upright: {', '.join(light)}" + (
                      "." if shrinks else ": not so in these model eyes, whose front is the same at any length.")]
    return found


def _arc(shares: Shares, tamponade: str, fill: float) -> float:
    """Arc of contact in the sphere, deg."""
    share = shares.at(tamponade, SPHERE, fill, WHOLE_SPHERE).value
    return float(2.0 * np.degrees(np.arccos(1.0 - 0.02 * share)))


def _assumed(outcomes: Sequence[Outcome]) -> list[str]:
    return [*dict.fromkeys(remark for outcome in outcomes for remark in outcome.remarks),
            "Density, tension, contact angle and the shape of the eye decide; viscosity does not. The head rests, and "
            "the tamponade is one body.",
            "An average eye: retina attached and smooth, no buckle, no staphyloma, nothing in the anterior chamber.",
            "Fill is a share of the volume behind the lens, not of its height. Retina: up to 115 degrees from the "
            "posterior pole. Macula: a disc of 5.5 mm."]


def validated(shares: Shares, outcomes: Sequence[Outcome]) -> list[str]:
    """Return how far the shapes were checked."""
    items: list[str] = []
    for tamponade in shares.tamponades:
        rows = [row for outcome in outcomes for row in outcome.rows
                if outcome.tables["shares"][1][:2] == [tamponade, shares.length]]
        arcs, walls = ([row for row in rows if row.quantity == name] for name in ("arc of contact", "covered wall"))
        examples = [f"{arc.at}: {arc.value:.0f} for {arc.reference:.0f} degrees, {wall.value:.0f} for "
                    f"{wall.reference:.0f} %"
                    for arc, wall in zip(arcs, walls, strict=True) if arc.at.split()[-2] in ("80", "90")]
        items.append(f"{TAMPONADES[tamponade]} in a sphere, exact solution of Young and Laplace: the arc is at most "
                     f"{max(row.error or 0.0 for row in arcs):.1f} degrees off, the covered wall "
                     f"{max(row.error or 0.0 for row in walls):.1f} points"
                     + (f" ({'; '.join(examples)})." if examples else "."))
    changes = [row.value for outcome in outcomes for row in outcome.rows if row.quantity.startswith("largest change")]
    return [*items,
            page.joined(f"In the eye, a grid with four times as many directions changes a covered share by at most "
                           f"{max(changes):.1f} points; the range holds that, for each posture and part. At 85 % of "
                           f"light oil the method was at most 0.4 points off another program:",
                           link_to("methods/equilibrium.md") + "."), SIMULATED]


def _curves(shares: Shares) -> bytes:
    """Covered share against fill, the patient upright, as PNG."""
    def draw(grid) -> None:
        for axes, part in zip(grid, ("retina", "inferior"), strict=True):
            for tamponade, color in zip(shares.tamponades, COLORS, strict=False):
                own = [shares.at(tamponade, "upright", fill, part) for fill in shares.fills]
                exact = [shares.at(tamponade, SPHERE, fill, part).value for fill in shares.fills]
                axes.fill_between(shares.fills, [one.low for one in own], [one.high for one in own], color=color,
                                  alpha=0.2, lw=0)
                axes.plot(shares.fills, [one.value for one in own], color=color, lw=2.0, marker="o", ms=4,
                          label=TAMPONADES[tamponade])
                axes.plot(shares.fills, exact, "--", color=color, lw=1.2, label=f"{TAMPONADES[tamponade]}, sphere")
            axes.set(xlabel="fill / % of the volume", xlim=(shares.fills[0], shares.fills[-1]), ylim=(0.0, 100.0))
            axes.set_title({"retina": "Whole retina", "inferior": "Inferior half"}[part], loc="left", fontsize=12)
            axes.grid(alpha=0.3)
        grid[0].set_ylabel("covered / %")
        grid[0].legend(frameon=False, fontsize=9)

    return drawn((11.5, 4.6), draw, 1, 2, sharey=True)


PAGE = StudyPage(__name__, PICTURES, TABLES, write_page)
