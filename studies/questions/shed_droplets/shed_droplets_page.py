"""The page of the study of emulsification: what sheds droplets, and where they gather.

Sources of what is set beside: [yu2020, abstract], [crisp1987, abstract], [wang2021, abstract], [wang2022, abstract].
"""
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.base import page, palette
from pipeline.planning.settings import postures
from pipeline.studies.model import Outcome
from pipeline.studies.question_page import (
    QuestionPage,
    StudyPage,
    drawn,
    link_to,
    write_picture,
    written_tables,
)
from studies.questions.moved_oil.moved_oil_page import oil_words
from studies.questions.shed_droplets._words import BASE, FILL, LINE_BY_PARTICLES, MOVEMENT, OIL, POSTURE, SHED, TENSION

PICTURES, TABLES = ("droplets",), ("shed", "gathered", "tracers", "sections")
WASHED_OUT = (3.5, 0.3, 38.0)  # ppm of the volume: mean, least and most of wash-outs [yu2020, abstract]
BY_PARTICLES = 3.1             # ppm of the cavity after 26 weeks: docs/results/mixing.md
MONTHS = 26                    # weeks
RATE = SHED[3]
Rows = Sequence[dict[str, str]]


def write_page(description: str, outcomes: Sequence[Outcome], target: Path) -> list[str]:
    """Write tables and picture into a folder, and return the parts of the page."""
    tables = written_tables(outcomes, TABLES, target)
    picture = _picture(tables)
    write_picture(target / "droplets.png", picture)
    return _page(description, tables, picture, outcomes).parts()


def setting_words(row: dict[str, str]) -> str:
    """Return what a line is about."""
    setting = row["setting"]
    if row["factor"] == OIL:
        return oil_words(setting)
    if row["factor"] == POSTURE:
        return setting.replace("_", " ")
    return f"{row['factor']} {setting}"


def times(row: dict[str, str], base: dict[str, str]) -> str:
    """Return how many times as many droplets as by default, with what the contact angle leaves open."""
    value, low, high = (float(row[name]) / float(base[name]) for name in (RATE, "low", "high"))
    low, high = min(low, value, high), max(low, value, high)
    same = f"{low:.2f}" == f"{high:.2f}"
    return f"{value:.2f}" if same else f"{value:.2f} ({low:.2f}–{high:.2f})"


def weeks(row: dict[str, str]) -> str:
    """Return the weeks until as much is shed as wash-outs held, if the assumed efficiency holds."""
    return f"{WASHED_OUT[0] / float(row[RATE]):.0f}"


def by(shed: Rows, factor: str) -> list[dict[str, str]]:
    """Lines of one factor."""
    return [row for row in shed if row["factor"] == factor]


def answers(shed: Rows, gathered: Rows) -> list[str]:
    """Return what sheds droplets, the strongest first, and where they gather, in sentences."""
    base = by(shed, BASE)[0]

    def most(factor: str) -> tuple[float, float]:
        ratios = [float(row[RATE]) / float(base[RATE]) for row in by(shed, factor)]
        return min(ratios), max(ratios)

    light = [row for row in by(shed, OIL) if not row["setting"].startswith("heavy")]
    thick = max(light, key=lambda row: -float(row[RATE]))
    return [f"Viscosity matters most, by the law assumed: {oil_words(thick['setting'])} sheds "
            f"{float(thick[RATE]) / float(base[RATE]):.2f} times the droplets of oil 1000.",
            f"The tension comes next: lowered to 15 mN/m by proteins, {most(TENSION)[1]:.1f} times as many.",
            f"The fill ({most(FILL)[0]:.2f} to {most(FILL)[1]:.2f} times) and the size of saccades ("
            f"{most(MOVEMENT)[0]:.2f} to {most(MOVEMENT)[1]:.2f} times) matter little.",
            *(f"In the {row['posture'].replace('_', ' ')} patient droplets gather "
              f"{place_words(gathered, row['posture'])}." for row in gathered if not row["posture"].endswith("side"))]


def place_words(gathered: Rows, posture: str) -> str:
    """Return where most droplets of a posture are."""
    row = next((one for one in gathered if one["posture"] == posture), None)
    if row is None:
        return "–"
    front = float(row["before the equator"])
    depth = ("in front, where lens and ciliary body meet the oil" if front > 66.0 else
             "behind the equator, at the retina" if front < 34.0 else "around the equator")
    height = float(row["median y [mm]"])
    side = f", {abs(height):.0f} mm {'above' if height > 0.0 else 'below'} the middle" if abs(height) > 2.0 else ""
    return f"{depth}{side}"


def _page(description: str, tables: dict[str, list[dict[str, str]]], picture: bytes,
          outcomes: Sequence[Outcome]) -> QuestionPage:
    shed, gathered = tables["shed"], tables["gathered"]
    base = by(shed, BASE)[0]
    rows = [(setting_words(row), f"{float(row['contact line [mm]']):.0f}", times(row, base), weeks(row))
            for factor in (OIL, TENSION, MOVEMENT, FILL, POSTURE) for row in by(shed, factor)]
    places = [(row["posture"].replace("_", " "), *(f"{float(row[name]):.0f}" for name in (
        "before the equator", "retina behind the equator", "superior half", "inferior half")),
        place_words(gathered, row["posture"])) for row in gathered]
    default = [number for number, row in enumerate(rows) if row[2] == "1.00"]
    changes = page.table(
        ("", "contact line / mm", "times as many droplets", f"weeks to {WASHED_OUT[0]:g} ppm (an assumption)"), rows,
        words=(0,), marked=default) + page.paragraph(
        page.bold("The weeks rest on an assumed constant"),
        f"(efficiency 0.1), set so that some months give what wash-outs held in the mean, {WASHED_OUT[0]:g} ppm; "
        f"they held {WASHED_OUT[1]:g} to {WASHED_OUT[2]:g} ppm (Yu et al. 2020), so that weeks may be ten times more "
        "or fewer. How many times as many droplets does not depend on it. All numbers are in",
        page.link("shed.csv", "shed.csv") + ".", "Shaded: as by default.")
    where = page.table(("patient", "before the equator / %", "behind it / %", "superior / %", "inferior / %", "where"),
                       places, words=[5]) + page.paragraph(
        "A droplet of 1.5 micrometers rises by 5 mm in a day, one of 10 micrometers by 10 mm in an hour: where small "
        "droplets are follows from the postures of days, not of minutes.")
    return QuestionPage(
        description, answers(shed, gathered), picture,
        "How many times as many droplets with every change, and where they gather in four postures",
        ["Left: how many times as many droplets as by default, with every change; bars, what the contact angle (10 "
         "to 25 degrees) leaves open. Right: sections through the middle of the eye from the patient's left, front on "
         "the left, superior above; the arrow is down. Oil is ivory, aqueous blue, dots are droplets of the "
         "whole eye that have risen."],
        {"What is changed": changes, "Where droplets gather": where}, _assumed(), validated(shed, outcomes),
        "the law itself: none was published; it has the factors that are known. Against patients, and against an "
        "experiment in an eye. Droplets that merge, that saccades stir, or that leave into the anterior chamber, where "
        "surgeons see them first, are not seen.",
        ("aqueous", "supine and prone", "contact line", "tension", "ppm", "at rest", "particles"))


def _assumed() -> list[str]:
    return ["A saccade tears a thread of droplets off the oil where oil, aqueous and wall meet. Its cross-section is "
            "in proportion to the shear rate and to one over tension and viscosity. Elsewhere saccades only bend "
            "the interface (Wang et al. 2021, 2022).",
            "Droplets of 1.5 micrometers, two saccades in a second day and night, horizontal ones. Size and speed "
            "follow the main sequence: larger ones are faster but last longer, so the shear rate hardly grows.",
            "Fewer droplets with more viscous oil are known from experiments (Crisp et al. 1987), in proportion to one "
            "over the viscosity is assumed. Proteins act through the tension alone.",
            "The oil is at rest; droplets rise until oil and wall are in the way, and slide along them."]


def validated(shed: Rows, outcomes: Sequence[Outcome]) -> list[str]:
    """Return how far shapes and law were checked."""
    base = by(shed, BASE)[0]
    items: list[str] = [
        page.joined("The contact line is that of the shape with least energy. In a sphere its arc is at most 3 degrees "
                    "off the exact one with the grid taken here (1 degree with a finer one):",
                    link_to("methods/equilibrium.md")),
        page.joined(f"The same law on moving particles (scene emulsification_contact_line) gave {BY_PARTICLES:g} "
                    f"ppm after {MONTHS} weeks; here it gives {MONTHS * float(base[RATE]):.1f} ppm, since particles "
                    "count the line longer where oil meets the wall at a small angle:",
                    link_to("results/mixing.md"))]
    lines = [row for outcome in outcomes for row in outcome.rows if row.quantity == LINE_BY_PARTICLES]
    items += [f"The contact line of the same shape measured on particles ({row.at.strip('[]')}) is "
              f"{1e3 * row.value:.0f} mm long, here {1e3 * (row.reference or 0.0):.0f} mm." for row in lines]
    return items


def _picture(tables: dict[str, list[dict[str, str]]]) -> bytes:
    """Bars of all changes, and sections with droplets, as PNG."""
    shed, base = tables["shed"], by(tables["shed"], BASE)[0]
    gathered = [row["posture"] for row in tables["gathered"]]

    def draw(grid) -> None:
        bars, right = grid[0, 0], [grid[row, column] for row in (0, 1) for column in (1, 2)]
        grid[1, 0].remove()
        bars.set_subplotspec(grid[0, 0].get_gridspec()[:, 0])
        place, ticks, words = 0.0, [], []
        for factor, color in zip((OIL, TENSION, MOVEMENT, FILL, POSTURE), palette.COLORS, strict=False):
            for row in by(shed, factor):
                value, low, high = (float(row[name]) / float(base[name]) for name in (RATE, "low", "high"))
                bars.barh(place, value, 0.8, color=color, xerr=[[max(value - min(low, high), 0.0)],
                                                                [max(max(low, high) - value, 0.0)]], capsize=2)
                ticks.append(place)
                words.append(setting_words(row))
                place -= 1.0
            place -= 0.6
        bars.axvline(1.0, color="black", lw=0.8)
        bars.set_yticks(ticks, words, fontsize=9)
        bars.set(xlabel="times as many droplets as by default")
        bars.set_title("What sheds droplets", loc="left", fontsize=12)
        for axes, posture in zip(right, gathered, strict=False):
            for what, style in (("wall", {"facecolor": palette.AQUEOUS}), ("oil", {"facecolor": palette.OIL}),
                                ("wall", {"facecolor": "none", "edgecolor": "black"})):
                outline = _points(tables["sections"], posture, "z [mm]", "y [mm]", what)
                axes.fill(outline[:, 0], outline[:, 1], **style)
            dots = _points(tables["tracers"], posture, "z [mm]", "y [mm]")
            axes.plot(dots[:, 0], dots[:, 1], ".", color="#b3261e", ms=3, alpha=0.5)
            axes.set_title(posture.replace("_", " "), loc="left", fontsize=11)
            axes.set_aspect("equal")
            axes.set_xlim(*reversed(axes.get_xlim()))  # the front on the left, as in the pictures of a run
            axes.axis("off")
            _mark_down(axes, postures()[posture])

    return drawn((12.0, 7.0), draw, 2, 3, gridspec_kw={"width_ratios": [1.5, 1.0, 1.0]})


def _mark_down(axes, down: np.ndarray) -> None:
    """Draw whither gravity points in a section, beside it: down (x to the patient's left, y superior, z anterior)."""
    style = {"xycoords": "axes fraction", "ha": "center", "va": "center", "fontsize": 9}
    middle = (1.0, 0.85)
    if abs(down[0]) > 0.5:
        axes.annotate(f"down is {'toward' if down[0] > 0.0 else 'away from'}\nthe viewer", middle, **style)
        return
    tip = (middle[0] - 0.12 * down[2], middle[1] + 0.12 * down[1])
    axes.annotate("", tip, (2.0 * middle[0] - tip[0], 2.0 * middle[1] - tip[1]), xycoords="axes fraction",
                  textcoords="axes fraction", annotation_clip=False, arrowprops={"arrowstyle": "-|>", "lw": 1.5})


def _points(rows: Rows, posture: str, x: str, y: str, what: str = "") -> np.ndarray:
    """Points (k, 2) of one posture."""
    return np.array([[float(row[x]), float(row[y])] for row in rows
                     if row["posture"] == posture and (not what or row["what"] == what)])


PAGE = StudyPage(__name__, PICTURES, TABLES, write_page)
