"""The page of the study of movements: what saccades, a jolt and standing up do with every oil.

Sources of what is set beside: [rossi2021, abstract], [isakova2014, abstract], [angunawela2011, page 7050].
"""
import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from pipeline.base import page
from pipeline.base.numbers import with_uncertainty
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
from studies.questions.moved_oil._words import (
    EXACT_STRESS,
    HIGH_STRESS,
    JOLT,
    SACCADES,
    SHIFT,
    STANDING_UP,
    STRESS,
    WAY_LEFT,
    time_to_make,
)

PICTURES, TABLES = ("movements",), ("movements", "courses")
HALF, MOST = time_to_make(0.5), time_to_make(0.8)
ADHESION = (3.9, 266.0)  # Pa, of the retina: a day after laser, and the most in animals [angunawela2011, page 7050]
STEP_ERROR = 0.08        # of the time to come to rest, by long time steps: docs/results/step_size.md
WIDER_SUPPORT = 1.06     # way of the oil with a support of 3 spacings over that with 2.5, there too
# Least and most of all cases of turned_sphere in 3D: docs/results/validation.md
RMS_OF_SPHERE, HIGH_OF_SPHERE = (0.9, 2.8), (0.9, 3.8)  # %, of the stress; by how much its largest value is too high
# Of the scene saccades with particles of 1 and 0.4 mm: docs/results/turning_eye.md
MEAN_OF_SACCADE, HIGH_OF_SACCADE = (7.5, 7.9), (54, 66)  # Pa
COLUMNS = ((SACCADES, STRESS, "saccade: mean stress / Pa"),
           (SACCADES, HIGH_STRESS, "saccade: more on 1 % of the retina only / Pa"),
           (SACCADES, SHIFT, "saccade: interface moves / mm"), (JOLT, STRESS, "jolt: mean stress / Pa"),
           (JOLT, HIGH_STRESS, "jolt: more on 1 % of the retina only / Pa"),
           (JOLT, SHIFT, "jolt: interface moves / mm"),
           (STANDING_UP, HALF, "sitting up: half of the way / s"), (STANDING_UP, MOST, "sitting up: 80 % of it / s"))


@dataclasses.dataclass(frozen=True)
class Measured:
    """A number and what it may be off; nan where it is not known.

    Attributes
    ----------
    value, spread : and half of the range that repeated movements have.
    at_rest : what is read where nothing moves.
    """

    value: float
    spread: float
    at_rest: float


@dataclasses.dataclass(frozen=True)
class Movements:
    """All numbers of a study by oil, movement and quantity: those of the study, and those with finer particles."""

    found: dict[tuple[str, str, str], Measured]
    finer: dict[tuple[str, str, str], Measured]
    viscosity: dict[str, float]                 # mPa s, by oil
    density: dict[str, float]                   # kg/m3
    spacing: dict[str, tuple[float, float]]     # mm, of the study and of the finer particles, by movement

    @classmethod
    def of(cls, rows: Sequence[dict[str, str]]) -> "Movements":
        """Read the table ``movements``: of two spacings with one oil and movement the finer one is for comparison."""
        spacings: dict[str, set[float]] = {}
        for row in rows:
            spacings.setdefault(row["movement"], set()).add(float(row["spacing [mm]"]))
        found, finer = {}, {}
        for row in rows:
            main = float(row["spacing [mm]"]) == max(spacings[row["movement"]])
            number = Measured(*(float(row[column] or "nan") for column in ("value", "spread", "at rest")))
            (found if main else finer)[row["oil"], row["movement"], row["quantity"]] = number
        return cls(found, finer, {row["oil"]: float(row["viscosity [mPa s]"]) for row in rows},
                   {row["oil"]: float(row["density [kg/m3]"]) for row in rows},
                   {movement: (max(found), min(found)) for movement, found in spacings.items()})

    @property
    def oils(self) -> list[str]:
        """Names of the oils."""
        return list(dict.fromkeys(oil for oil, *_ in self.found))

    def light(self, movement: str, quantity: str) -> list[str]:
        """Oils lighter than the aqueous of which a quantity is known, as listed: thin ones first."""
        return [oil for oil in self.oils if not oil.startswith("heavy")
                and np.isfinite(self.number(oil, movement, quantity)[0])]

    @property
    def reference(self) -> str:
        """The oil with finer particles, the first if there is none."""
        return next(iter(self.finer), (self.oils[0],))[0]

    def change(self, movement: str, quantity: str) -> float:
        """Relative change of a quantity with finer particles, of the oil that has them; 0 where it is not known."""
        key = (self.reference, movement, quantity)
        if key not in self.found or key not in self.finer:
            return 0.0
        change = abs(self.finer[key].value / self.found[key].value - 1.0)
        return change if np.isfinite(change) else 0.0

    def number(self, oil: str, movement: str, quantity: str) -> tuple[float, float]:
        """A number, and what spread, finer particles and long steps may change it by."""
        if (oil, movement, quantity) not in self.found:
            return np.nan, np.nan
        one = self.found[oil, movement, quantity]
        share = self.change(movement, quantity) + (STEP_ERROR if movement == STANDING_UP else 0.0)
        return one.value, np.nan_to_num(one.spread) + share * one.value

    def cell(self, oil: str, movement: str, quantity: str) -> str:
        """A number as the table shows it; nothing where a movement is not over."""
        value, error = self.number(oil, movement, quantity)
        if np.isnan(value):
            return "–"
        return with_uncertainty(value, error, 3) if error else f"{value:.2g}"


def write_page(description: str, outcomes: Sequence[Outcome], target: Path) -> list[str]:
    """Write tables and picture into a folder, and return the parts of the page."""
    tables = written_tables(outcomes, TABLES, target)
    movements = Movements.of(tables["movements"])
    picture = _picture(movements, tables["courses"])
    write_picture(target / "movements.png", picture)
    return _page(description, movements, picture).parts()


def oil_words(oil: str) -> str:
    """Return the name of an oil as surgeons use it.

    >>> oil_words("silicone_oil_5000"), oil_words("heavy_oil_densiron_68")
    ('oil 5000', 'heavy oil')
    """
    return "heavy oil" if oil.startswith("heavy") else f"oil {oil.rpartition('_')[2]}"


def _page(description: str, movements: Movements, picture: bytes) -> QuestionPage:
    rows = [(f"{oil_words(oil)}, {movements.viscosity[oil]:.0f} mPa s, {movements.density[oil]:g} kg/m3",
             *(movements.cell(oil, movement, quantity) for movement, quantity, _ in COLUMNS)) for oil in movements.oils]
    table = page.table(("", *(head for *_, head in COLUMNS)), rows, words=(0,)) + page.paragraph(
        f"± holds the spread of repeated saccades and what particles of {finer(movements)} change with "
        f"{oil_words(movements.reference)}; after sitting up also 8 % for long time steps, see",
        link_to("results/step_size.md") + ".",
        "The stress that is exceeded on 1 % of the retina is found at the contact line and at the edges in front. All "
        "numbers are in", page.link("movements.csv", "movements.csv"), "and",
        page.link("courses.csv", "courses.csv") + ".")
    return QuestionPage(
        f"{description} The rest is aqueous. The oil is at rest before.", answers(movements), picture,
        "Stress on the retina in a saccade, shift of the interface, and way of the aqueous after sitting up, by oil",
        ["Left: mean stress on the retina from the beginning of a saccade, by oil; dashed, what a sphere full of oil "
         "has exactly. Middle: how far the interface moves along its normal. Right: how much of its way the center of "
         "the aqueous has made to where it rests in the patient who sits."],
        {"Oil by oil": table, "Beside what was published": page.bullets(anchors(movements))},
        _assumed(movements), _validated(movements),
        "against patients, or against an experiment in an eye. A film of aqueous between oil and retina would lower "
        "the stress and let the oil slide sooner: it is thinner than a particle and not resolved. How fast the contact "
        "line moves follows from a model with one calibrated parameter, within a third of theory. Stress below the "
        "aqueous itself is too low. What finer particles change was tried with one oil only, not with the thick ones.",
        ("aqueous", "stress", "interface", "contact line", "particles", "at rest"))


def finer(movements: Movements) -> str:
    """Return the finer spacings in words."""
    found = {f"{small:g} for {large:g} mm" for large, small in movements.spacing.values() if small < large}
    return " and ".join(sorted(found)) or "another size"


def answers(movements: Movements) -> list[str]:
    """Return what every movement does, in sentences."""
    turned, stood = movements.light(SACCADES, STRESS), movements.light(STANDING_UP, MOST)
    return (_of_saccades(movements, turned) if turned else []) + (
        [_of_sitting_up(movements, stood)] if stood else [])


def _each(movements: Movements, oils: Sequence[str], movement: str, quantity: str, unit: str) -> str:
    """A quantity with the thinnest and the thickest of some oils, and with heavy ones."""
    heavy = [oil for oil in movements.oils if oil.startswith("heavy")
             and np.isfinite(movements.number(oil, movement, quantity)[0])]
    return ", ".join(f"{movements.cell(oil, movement, quantity)} {unit} with {oil_words(oil)}"
                     for oil in dict.fromkeys((oils[0], oils[-1], *heavy)))


def _of_sitting_up(movements: Movements, stood: Sequence[str]) -> str:
    """How soon oils come to rest, by those that have made 80 % of their way when the simulation ends."""
    said = f"After sitting up, 80 % of the way to rest takes {_each(movements, stood, STANDING_UP, MOST, 's')}."
    late = [oil for oil in movements.light(STANDING_UP, HALF) if oil not in stood]
    if late:
        more = " and thicker ones" if len(late) > 1 else ""
        said += f" With {oil_words(late[0])}{more} it takes longer than was simulated."
    return said + (" Thick oils take longer with finer particles; a film of aqueous on the wall would let all slide "
                   "sooner.")


def _of_saccades(movements: Movements, light: Sequence[str]) -> list[str]:
    """What saccades and the jolt do, by the oils that were shaken."""
    jolt, turn = (max(movements.number(oil, movement, STRESS)[0] for oil in light) for movement in (JOLT, SACCADES))
    return [f"The mean drag of a saccade on the retina is {_each(movements, light, SACCADES, STRESS, 'Pa')}.",
            f"It moves the interface by {_each(movements, light, SACCADES, SHIFT, 'mm')}.",
            f"A jolt drags with at most {jolt:.1f} Pa, {'less' if jolt < turn else 'more'} than a saccade."]


def anchors(movements: Movements) -> list[str]:
    """Return what was published, and what is found here."""
    turned = movements.light(SACCADES, STRESS)
    if not turned:
        return []
    thin, thick = turned[0], turned[-1]
    stress = {oil: movements.number(oil, SACCADES, STRESS)[0] for oil in (thin, thick)}
    high = {oil: movements.number(oil, SACCADES, HIGH_STRESS)[0] for oil in (thin, thick)}
    return [
        f"The stress on the retina grows with the viscosity up to a limit (Isakova et al. 2014, theory), and is higher "
        f"with 5000 than with 1000 mPa s (Rossi et al. 2021, computed by others). Here {oil_words(thick)} has "
        f"{100.0 * (stress[thick] / stress[thin] - 1.0):.0f} % more than {oil_words(thin)}. "
        "In a sphere full of oil the mass that the wall has to turn sets the limit, and the exact stresses differ by a "
        "few percent; the rest is from lens, front edges and contact line, where thick oil has to flow.",
        "A thin film of aqueous lowers the stress much (Isakova et al. 2014). No such film is here.",
        f"The retina holds with {ADHESION[0]:g} Pa in the first days after laser and with up to {ADHESION[1]:g} Pa in "
        f"animals (in Angunawela et al. 2011, where gas and water drag with at most 2.5 Pa in saccades). Here 1 % of "
        f"the retina feels more than {high[thin]:.0f} Pa with {oil_words(thin)} and {high[thick]:.0f} Pa with "
        f"{oil_words(thick)}, at the contact line. Rossi et al. found more than what holds at first too, at the "
        "interface."]


def _assumed(movements: Movements) -> list[str]:
    return ["Both liquids hold fast to the wall. The tension is 40 mN/m, the contact angle 18.2 degrees through the "
            "aqueous, for all oils. Oils flow with one viscosity at any speed.",
            "A saccade follows the main sequence: 65 ms and 500 degrees per second for 20 degrees. The stress is in "
            "proportion to the angular acceleration.",
            "The jolt moves the head forth without turning it. Sitting up turns gravity only; the head's own "
            "acceleration is small beside it.",
            "Viscosities are those of suppliers at 25 degrees; in the eye, which is warmer, oil is thinner.",
            "An average eye: retina attached and smooth, no buckle. Retina: up to 115 degrees from the posterior pole."]


def _validated(movements: Movements) -> list[str]:
    sphere = [(movements.found[oil, SACCADES, EXACT_STRESS].value, movements.number(oil, SACCADES, STRESS)[0])
              for oil in movements.oils if (oil, SACCADES, EXACT_STRESS) in movements.found]
    items: list[str] = [page.joined(
        "Stress in a sphere full of one liquid that turns, exact solution: {} to {} % off in the root mean square, its "
        "largest value {} to {} % too high:".format(*RMS_OF_SPHERE, *HIGH_OF_SPHERE), link_to("results/validation.md"))]
    if sphere:
        items.append(f"The exact mean stress in a sphere of the eye's volume full of the oil is {sphere[0][0]:.1f} Pa "
                     f"for {oil_words(movements.oils[0])}; the eye with aqueous and lens has {sphere[0][1]:.1f} Pa.")
    items.append(page.joined(
        "A saccade of the same eye, soon after the filling, with particles of 1 and 0.4 mm: mean stress {} and {} Pa, "
        "1 % exceeds {} and {} Pa:"
        .format(*MEAN_OF_SACCADE, *HIGH_OF_SACCADE), link_to("results/turning_eye.md")))
    ends = [movements.found[oil, STANDING_UP, WAY_LEFT].value for oil in movements.oils
            if (oil, STANDING_UP, WAY_LEFT) in movements.found]
    if ends:
        items.append(page.joined(
            f"Where the aqueous rests in both postures is known by least energy, without particles; the runs end "
            f"after {min(ends):.0f} to {max(ends):.0f} % of the way there, and creep on into the front edges:",
            link_to("methods/equilibrium.md")))
    items.append(page.joined(
        f"In another scene oil moves {100.0 * WIDER_SUPPORT - 100.0:.0f} % faster with a support of the kernel of 3 "
        "spacings than with the 2.5 here:",
        link_to("results/step_size.md")))
    still = movements.found.get((movements.oils[0], SACCADES, STRESS))
    if still:
        items.append(f"Error where nothing moves: a mean stress of {still.at_rest:.2f} Pa is read.")
    return items


def _picture(movements: Movements, courses: Sequence[dict[str, str]]) -> bytes:
    """Stress over time, shifts as bars, ways over time, as PNG."""
    colors = dict(zip(movements.oils, COLORS, strict=False))

    def course(oil: str, movement: str) -> np.ndarray:
        size = max(movements.spacing.get(movement, (0.0,)))
        return np.array([[float(row[column] or "nan") for column in ("time [s]", "value", "exact")] for row in courses
                         if row["oil"] == oil and row["movement"] == movement and float(row["spacing [mm]"]) == size])

    def draw(grid) -> None:
        for oil in movements.oils:
            turned, stood = course(oil, SACCADES), course(oil, STANDING_UP)
            if len(turned):
                grid[0].plot(1e3 * turned[:, 0], turned[:, 1], color=colors[oil], lw=2.0, label=oil_words(oil))
                grid[0].plot(1e3 * turned[:, 0], turned[:, 2], "--", color=colors[oil], lw=1.0)
            if len(stood):
                grid[2].plot(stood[1:, 0], stood[1:, 1], color=colors[oil], lw=2.0)
        place = np.arange(len(movements.oils))
        for offset, movement, hatch in ((-0.2, SACCADES, ""), (0.2, JOLT, "//")):
            numbers = np.array([movements.number(oil, movement, SHIFT) for oil in movements.oils])
            grid[1].bar(place + offset, numbers[:, 0], 0.38, yerr=numbers[:, 1], hatch=hatch, edgecolor="white",
                        color=[colors[oil] for oil in movements.oils], capsize=3)
        grid[1].set_xticks(place, [oil_words(oil).replace("oil ", "") for oil in movements.oils])
        grid[0].set(xlabel="time / ms", ylabel="mean stress on the retina / Pa")
        grid[1].set(ylabel="shift of the interface / mm")
        grid[2].set(xlabel="time since the begin / s", ylabel="way made / %", xscale="log", ylim=(0.0, 100.0))
        for axes, title in zip(grid, ("A saccade of 20 degrees", "Saccade (plain), jolt (hatched)", "Sitting up"),
                               strict=True):
            axes.set_title(title, loc="left", fontsize=12)
            axes.grid(alpha=0.3)
        grid[0].legend(frameon=False, fontsize=9)

    return drawn((13.0, 4.2), draw, 1, 3)


PAGE = StudyPage(__name__, PICTURES, TABLES, write_page)
