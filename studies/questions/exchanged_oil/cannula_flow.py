"""How long oil takes through a cannula: from pressure, inner diameter and length to flow and time.

A liquid of viscosity mu that creeps through a tube of radius r and length L, out of one wide space into another, loses

    dp = mu Q/r^3 (8 L/(pi r) + 3)    (J6)

on the way: in the tube by Hagen and Poiseuille [lamb1932, section 331], and at its ends as much as in an orifice
[dagan1982]. Oil of 1 Pa s creeps: the Reynolds number that is told stays far below 1. Equations:
docs/methods/injection.md.
"""
import dataclasses
import math

from pipeline.scenes.load import project_materials
from pipeline.studies.family import Family
from pipeline.studies.model import Outcome, Row
from sim.parameters import parameter
from studies.questions.exchanged_oil._words import CANNULAS
from studies.questions.kit.words import OILS

MILLIMETER_OF_MERCURY = 133.322  # Pa
DIAMETER_ERROR = 0.05   # of the inner diameter: makers differ, and a fifth of the flow goes with it


@dataclasses.dataclass(frozen=True)
class Parameters:
    """One way of moving oil through one cannula, for all oils."""

    name: str = parameter(meaning="what is done, in a few words")
    direction: str = parameter(choices=("in", "out"), meaning="whether the oil goes into the eye or out of it")
    inner_diameter: float = parameter(unit="m", exclusive_minimum=0.0, maximum=3e-3, meaning="of the cannula")
    length: float = parameter(unit="m", minimum=0.0, maximum=0.1, meaning="of the cannula")
    pressure: float = parameter(unit="Pa", exclusive_minimum=0.0, maximum=1e6, meaning="along the cannula")
    volume: float = parameter(4.29e-6, unit="m**3", exclusive_minimum=0.0,
                              meaning="volume of oil; 85 % of the cavity of an eye of 24 mm by default")
    published: float | None = parameter(None, unit="s", exclusive_minimum=0.0, meaning="time that was published")
    published_spread: float | None = parameter(None, unit="s", minimum=0.0, meaning="its standard deviation")
    published_viscosity: float | None = parameter(None, unit="Pa s", exclusive_minimum=0.0,
                                                  meaning="of the oil in that publication")
    source: str = parameter("", meaning="where it was published")

    def seconds(self, viscosity: float, wider: float = 1.0) -> float:
        """Time for the volume, s, of an oil of a viscosity in Pa s, in a cannula that is wider by a factor."""
        return self.volume / flow(self.pressure, viscosity, 0.5 * wider * self.inner_diameter, self.length)


def flow(pressure: float, viscosity: float, radius: float, length: float) -> float:
    """Volume per time, m3/s, of a creeping liquid through a tube. (J6)

    Parameters
    ----------
    pressure : from one end to the other, Pa.
    viscosity : Pa s.
    radius, length : of the tube, m.
    """
    return pressure * radius**3 / (viscosity * (8.0 * length / (math.pi * radius) + 3.0))


def liquids(case: Parameters) -> tuple[str, ...]:
    """Liquids of ``config/materials.yaml`` that the case reads."""
    return OILS


def run(case: Parameters) -> Outcome:
    """Compute flows and times of all oils."""
    materials = project_materials()
    lines, outcome = [], Outcome()
    for name in OILS:
        oil = materials[name]
        seconds, fast, slow = (case.seconds(oil.dynamic_viscosity, wider)
                               for wider in (1.0, 1.0 + DIAMETER_ERROR, 1.0 - DIAMETER_ERROR))
        rate = case.volume / seconds
        reynolds = 4.0 * oil.density * rate / (math.pi * oil.dynamic_viscosity * case.inner_diameter)
        lines.append(_line(case, name, oil.dynamic_viscosity, seconds, fast, slow))
        outcome.rows += [Row("flow", 6e7 * rate, "mL/min", at=name), Row("time", seconds / 60.0, "min", at=name),
                         Row("Reynolds number in the cannula", reynolds, at=name)]
    if case.published:
        viscosity = case.published_viscosity or materials[OILS[0]].dynamic_viscosity
        seconds, fast, slow = (case.seconds(viscosity, wider)
                               for wider in (1.0, 1.0 + DIAMETER_ERROR, 1.0 - DIAMETER_ERROR))
        lines.append(_line(case, "published", viscosity, seconds, fast, slow))
        outcome.rows.append(Row("time of the oil of the publication", seconds / 60.0, "min",
                                reference=case.published / 60.0,
                                error=abs(seconds - case.published) / 60.0,
                                tolerance=(case.published_spread or 0.0) / 60.0))
    outcome.tables["cannulas"] = [list(CANNULAS), *lines]
    return outcome


def _line(case: Parameters, oil: str, viscosity: float, *seconds: float) -> list[str]:
    """A line of the table: times in minutes, the shortest and longest ones last."""
    published = ["" if value is None else f"{value / 60.0:.3g}" for value in (case.published, case.published_spread)]
    return [case.name, case.direction, f"{1e3 * case.inner_diameter:g}", f"{1e3 * case.length:g}",
            f"{case.pressure / MILLIMETER_OF_MERCURY:.4g}", oil, f"{1e3 * viscosity:g}",
            *(f"{value / 60.0:.4g}" for value in seconds), *(published if oil == "published" else ["", ""]),
            case.source if oil == "published" else ""]


FAMILY = Family(__name__, Parameters, run, liquids=liquids,
                unnamed=("direction", "inner_diameter", "length", "pressure", "volume", "published", "published_spread",
                         "published_viscosity", "source"))
