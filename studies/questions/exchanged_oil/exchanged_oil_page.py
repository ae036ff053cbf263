"""The page of the study of filling and removal: how long they take, and what stays behind.

Sources of what is set beside: [iovs2638518, abstract], [wu2018, abstract], [wan41959, abstract], [tvst2802965,
abstract].
"""
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.base import page
from pipeline.base.palette import COLORS
from pipeline.studies.model import Outcome
from pipeline.studies.question_page import (
    QuestionPage,
    StudyPage,
    drawn,
    link_to,
    write_picture,
    written_tables,
)
from studies.questions.exchanged_oil._words import LARGEST, LEFT, LOST_AT, PIECES
from studies.questions.moved_oil.moved_oil_page import oil_words

PICTURES, TABLES = ("exchange",), ("cannulas", "exchanges", "courses")
PUBLISHED = "published"
VOLUME, SECTION, TENSION = 4.29e-6, 3.57e-4, 0.04   # m3 moved, m2 of a sphere of the cavity's volume, N/m
REACH = 2.0     # mm, within which a tip drains
Rows = Sequence[dict[str, str]]


def write_page(description: str, outcomes: Sequence[Outcome], target: Path) -> list[str]:
    """Write tables and picture into a folder, and return the parts of the page."""
    tables = written_tables(outcomes, TABLES, target)
    picture = _picture(tables["cannulas"], tables["courses"])
    write_picture(target / "exchange.png", picture)
    return _page(description, tables["cannulas"], tables["exchanges"], picture).parts()


def minutes(row: dict[str, str]) -> str:
    """Return a time in minutes with what it may be."""
    value, shortest, longest = (float(row[f"{name} [min]"]) for name in ("time", "shortest", "longest"))
    digits = 1 if value < 9.95 else 0
    return f"{value:.{digits}f} ({shortest:.{digits}f}–{longest:.{digits}f})"


def way_words(row: dict[str, str]) -> str:
    """Return what is done, through what."""
    return (f"{row['way'].replace('_', ' ')}, {row['pressure [mmHg]']} mmHg, {row['inner diameter [mm]']} mm wide, "
            f"{row['length [mm]']} mm long")


def ends(exchanges: Rows, exchange: str) -> list[tuple[str, dict[str, str], float]]:
    """Runs of an exchange: its tip and flow, its numbers by quantity, and its capillary number."""
    found: dict[tuple[str, str, str], dict[str, str]] = {}
    for row in exchanges:
        if row["exchange"] == exchange:
            run = found.setdefault((row["tip"], row["flow [mL/s]"], row["capillary number"]), {})
            run[row["quantity"]] = row["value"]
    return [(tip, numbers, float(capillary)) for (tip, _, capillary), numbers in found.items()]


def left_words(runs: Sequence[tuple[str, dict[str, str], float]]) -> str:
    """Return what is left with the slowest flow of one exchange and tip, and what a faster one says beside."""
    slow, *faster = sorted(runs, key=lambda run: run[2])

    def words(numbers: dict[str, str]) -> str:
        return f"{'' if numbers[LOST_AT] else 'less than '}{float(numbers[LEFT]):.1f} %"

    return words(slow[1]) + (f" ({words(faster[0][1])} with twice the flow)" if faster else "")


def _filled(runs: Sequence[tuple[str, dict[str, str], float]]) -> float:
    """Share of the cavity, percent, that the slowest filling has filled when its tip loses the aqueous."""
    return 100.0 - float(min(runs, key=lambda run: run[2])[1][LEFT])


def capillary_numbers(cannulas: Rows) -> tuple[float, float]:
    """Least and largest capillary number in the eye while oil goes through the cannulas: viscosity times flow."""
    found = [1e-3 * float(row["viscosity [mPa s]"]) * VOLUME / (60.0 * float(row["time [min]"])) / SECTION / TENSION
             for row in cannulas if row["oil"] != PUBLISHED]
    return min(found), max(found)


def answers(cannulas: Rows, exchanges: Rows) -> list[str]:
    """Return what takes how long, and what stays behind, in sentences."""
    own = [row for row in cannulas if row["oil"] != PUBLISHED]
    words = [_times(what, [row for row in own if row["direction"] == direction])
             for what, direction in (("Removal", "out"), ("Filling", "in"))
             if any(row["direction"] == direction for row in own)]
    words.append("Times are proportional to the viscosity, and inversely to the fourth power of the inner diameter.")
    longer = [float(row["published [min]"]) / float(row["time [min]"]) for row in cannulas if row["oil"] == PUBLISHED]
    if longer:
        words.append(f"Surgeons took {min(longer):.1f} to {max(longer):.1f} times as long as is computed for their "
                     "oil; their suction is not known.")
    removal = ends(exchanges, "removal")
    if removal:
        first = [run for run in removal if run[0] == removal[0][0]]
        words.append(f"A tip that stands still ({first[0][0].replace('_', ' ')}) leaves oil behind: "
                     f"{left_words(first)} of the cavity; surgery's flow is slower still.")
    filling = ends(exchanges, "filling")
    if filling:
        words.append(f"In a filling a tip {filling[0][0].replace('_', ' ')} loses the aqueous while "
                     f"{left_words(filling)} of the cavity are left to fill: oil fills "
                     f"{_filled(filling):.0f} % of it then.")
    return words


def _times(what: str, own: Rows) -> str:
    """The fastest and the slowest of some ways through a cannula."""
    fastest, slowest = (choose(own, key=lambda row: float(row["time [min]"])) for choose in (min, max))
    ways = [row["way"].replace("_removal", "").replace("_filling", "").replace("_", " ") for row in (fastest, slowest)]
    said = [f"{minutes(row)} min with {oil_words(row['oil'])} ({way})"
            for row, way in zip((fastest, slowest), ways, strict=True)]
    return f"{what} of 85 % of the cavity: {' to '.join(dict.fromkeys(said))}."


def _page(description: str, cannulas: Rows, exchanges: Rows, picture: bytes) -> QuestionPage:
    own = [row for row in cannulas if row["oil"] != PUBLISHED]
    oils = list(dict.fromkeys(row["oil"] for row in own))
    ways = list(dict.fromkeys(row["way"] for row in own))
    rows = [(way_words(next(row for row in own if row["way"] == way)),
             *(minutes(next(row for row in own if row["way"] == way and row["oil"] == oil)) for oil in oils))
            for way in ways]
    behind = [(exchange, tip.replace("_", " "), f"{capillary:.3f}",
               f"{'' if numbers[LOST_AT] else '< '}{float(numbers[LEFT]):.1f}", f"{float(numbers[LARGEST]):.1f}",
               numbers[PIECES])
              for exchange in ("removal", "filling") for tip, numbers, capillary in ends(exchanges, exchange)]
    times = page.table(("", *map(oil_words, oils)), rows, words=(0,)) + page.paragraph(
        "In brackets: with an inner diameter 5 % larger and smaller, as makers differ. Infusion that refills the eye "
        "is not the limit: an infusion line of 23 gauge loses 9 to 16 mmHg at 10 mL/min (Rossi et al.). All numbers "
        "are in", page.link("cannulas.csv", "cannulas.csv"), "and", page.link("exchanges.csv", "exchanges.csv") + ".")
    left = page.table(("", "tip", "capillary number", "left / % of the cavity", "largest piece / %", "pieces"), behind,
                      words=[1]) + page.paragraph(
        "A removal leaves oil behind, a filling aqueous. Removals of one tip differ in their flow alone; their "
        "difference is what the flow leaves open.")
    return QuestionPage(
        description, answers(cannulas, exchanges), picture,
        "Time against viscosity for every cannula, and distance of what is left from the tip",
        ["Left: minutes for 85 % of the cavity by viscosity; squares with bars are published times of removal. Right: "
         "how far the liquid that is drained is from the tip; above the dashed line the tip has lost it."],
        {"Minutes by oil and cannula, for 4.3 mL": times, "What stays behind": left},
        _assumed(cannulas, exchanges), validated(cannulas, exchanges),
        "against patients, or against an experiment in an eye. What stays behind depends on where the tip is: surgeons "
        "move it and turn the eye. Films and droplets smaller than a particle, oil that sticks to a lens or to "
        "membranes, and oil before the lens are not seen.",
        ("aqueous", "capillary number", "tension", "contact angle", "particles"))


def _assumed(cannulas: Rows, exchanges: Rows) -> list[str]:
    spacing, (least, most) = exchanges[0]["spacing [mm]"], capillary_numbers(cannulas)
    return ["Oil creeps through the cannula (Hagen and Poiseuille, with the loss at both ends); tubing and valve lose "
            "nothing. Oils flow with one viscosity at any speed: those with long chains flow more easily.",
            "Pressures are along the cannula, not in the eye: the infusion's 40 mmHg alone, with a suction of 600 "
            "mmHg, or a pump of 5 bar. Lengths and inner diameters are in config/studies/injection_study.yaml.",
            f"The simulation has particles of {spacing} mm, a flow ten to hundreds of times that of surgery, and oil "
            "of 100 mPa s, so that tension outweighs viscosity as it does in surgery: the capillary number is in the "
            f"table, in the cannulas above it is {least:.4f} to {most:.3f} whatever the oil. Tension 40 mN/m, contact "
            "angle 18.2 degrees. So fast a flow of aqueous into a tip draws oil along, which a slower one does not.",
            "The tip drains the oil or the aqueous next to it, never both. It has lost it when none is within 2 mm."]


def validated(cannulas: Rows, exchanges: Rows) -> list[str]:
    """Return how far times and simulation were checked."""
    items = [f"{row['way'].replace('_', ' ')}: {minutes(row)} min for {float(row['viscosity [mPa s]']):.0f} mPa s; "
             f"published {row['published [min]']} ± {row['spread [min]']} min, {row['source']}; the suction is not "
             "stated there." for row in cannulas if row["oil"] == PUBLISHED]
    items.append("Other series with 23 gauge took 4.2 ± 1.4 to 6.1 ± 1.5 min, at 0.9 to 1.4 mL/min (Wu et al. 2018), "
                 "and 5.9 ± 1.3 and 8.9 ± 1.7 min (Wan et al.); their oils are not stated in what was seen.")
    items.append(page.joined("The volume that has entered follows the flow to 0.1 % of the cavity at any spacing, and "
                             "no liquid is lost:", link_to("results/injection.md")))
    for exchange in ("removal", "filling"):
        runs = ends(exchanges, exchange)
        same = [float(numbers[LEFT]) for tip, numbers, _ in runs if tip == runs[0][0]]
        if len(same) == 2:
            items.append(f"Half the flow: a {exchange} leaves {same[1]:.1f} in place of {same[0]:.1f} % of the cavity.")
    return items


def _picture(cannulas: Rows, courses: Rows) -> bytes:
    """Times against viscosity, and what is left against what was moved, as PNG."""
    ways = list(dict.fromkeys(row["way"] for row in cannulas))

    def draw(grid) -> None:
        for way, color in zip(ways, COLORS, strict=False):
            own = sorted((float(row["viscosity [mPa s]"]), *(float(row[f"{name} [min]"]) for name in (
                "time", "shortest", "longest"))) for row in cannulas if row["way"] == way and row["oil"] != PUBLISHED)
            viscosity, time, shortest, longest = np.array(own).T
            grid[0].fill_between(viscosity, shortest, longest, color=color, alpha=0.2, lw=0)
            grid[0].plot(viscosity, time, color=color, marker="o", ms=4, lw=1.6, label=way.replace("_", " "))
            for row in (one for one in cannulas if one["way"] == way and one["oil"] == PUBLISHED):
                grid[0].errorbar(float(row["viscosity [mPa s]"]), float(row["published [min]"]),
                                 float(row["spread [min]"]), marker="s", color=color, capsize=3)
        runs: dict[tuple[str, str, str], list[list[float]]] = {}
        for row in courses:
            runs.setdefault((row["exchange"], row["tip"], row["flow [mL/s]"]), []).append(
                [float(row[name]) for name in ("moved [mL]", "left [% of the cavity]", "distance [mm]")])
        for (exchange, tip, flow), color in zip(runs, COLORS, strict=False):
            _, left, distance = np.array(runs[exchange, tip, flow]).T
            grid[1].plot(left, distance, color=color, lw=1.8, label=f"{exchange}, {tip.replace('_', ' ')}, {flow} mL/s")
        grid[1].axhline(REACH, ls="--", color="black", lw=1.0)
        grid[0].set(xscale="log", yscale="log", xlabel="viscosity of the oil / mPa s", ylabel="time / min")
        grid[1].set(xlabel="left in the eye / % of the cavity", ylabel="distance from the tip / mm", xlim=(100.0, 0.0),
                    ylim=(0.0, None))
        for axes, title in zip(grid, ("Time through the cannula", "When the tip loses what it drains"), strict=True):
            axes.set_title(title, loc="left", fontsize=12)
            axes.grid(alpha=0.3, which="both")
            axes.legend(frameon=False, fontsize=8)

    return drawn((12.0, 4.6), draw, 1, 2)


PAGE = StudyPage(__name__, PICTURES, TABLES, write_page)
