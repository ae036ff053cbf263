"""Wedges of aqueous under oil at rest in a sphere: what slides films down must leave them alone.

At rest the aqueous below the oil ends at the wall in a wedge, and at 18 degrees one three spacings long is thinner than
a particle: as thin as a film, and no film. The less aqueous there is, the more of it is wedge; with 3 % it is a lens
that is hardly thicker anywhere. Particles start labelled by the exact shape at rest
(`studies.validation.kit.young_laplace`), with the viscosities of silicone oil and aqueous, and are run with films that
slide and without. The covered share of the wall, that of the metrics (`pipeline.measures.coverage`), must be the same,
and the exchanges must come to an end.
"""
import dataclasses
from typing import Any

import numpy as np

from pipeline.measures.coverage import WallContact
from pipeline.studies.family import Family
from pipeline.studies.model import Curve, Figure, Outcome, Row, bounded
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.kit.tank import PackedParameters, Run, advance, build, cavity, field, film_exchanges
from studies.validation.kit.young_laplace import Profile, oil_at_rest

GRAVITY, TENSION, RADIUS = 9.81, 0.04, 0.011  # m/s^2, N/m, m
AQUEOUS, OIL = Liquid("aqueous", 1005.0, 7e-4), Liquid("oil", 970.0, 1.0)
CONTACT_ANGLE = np.radians(18.2)
READINGS = 40  # of the covered share
LATE = 0.25  # share of the run whose mean is compared, and in which exchanges must have ended
SAME = 0.005  # of the wall: by so much the covered share may differ with films that slide
MOST = 1.0  # exchanges per second in the end that count as none: a particle at the line that is now film, now wedge
FIGURES = (Figure("wedge_kept", "Wall that oil at rest covers", "time / s", "covered share less the exact one"),)


@dataclasses.dataclass(frozen=True)
class Parameters(PackedParameters):
    """Oil at rest in a circle or sphere; resolutions count particles along the radius."""

    support_ratio: float = parameter(2.5, minimum=2.0, maximum=4.0,
                                     meaning="support radius of the kernel in particle spacings")
    dimension: int = parameter(2, choices=(2, 3), meaning="a circle or a sphere")
    fill: float = parameter(0.95, minimum=0.5, maximum=0.99, meaning="share of it that is oil")
    duration: float = parameter(2.0, unit="s", exclusive_minimum=0.0, meaning="simulated time")
    resolutions: tuple[int, ...] = parameter((11,), minimum=6, meaning="particles along the radius, coarse to fine")
    # Gravity in full never acts: the limit of the tension is what counts.
    largest_step: float = parameter(0.2, exclusive_minimum=0.0, meaning="largest time step in sqrt(spacing / g)")


def run(case: Parameters) -> Outcome:
    """Compare the covered share with films that slide and without at every resolution."""
    outcome = Outcome()
    constant = (AQUEOUS.density - OIL.density) * GRAVITY / TENSION
    exact = oil_at_rest(case.fill, float(CONTACT_ANGLE), constant, RADIUS, case.dimension)
    name = f"{case.dimension}D fill {case.fill:g}"
    for resolution in case.resolutions:
        without, films = (_rest(case, exact, resolution, slide) for slide in (False, True))
        for result, kind in ((without, "without sliding films"), (films, "with sliding films")):
            outcome.remarks += result.remarks(f"{name}, {kind}")
            if not result.failure:
                outcome.curves.append(Curve(
                    "wedge_kept", f"{name}, {kind}, {result.label}", result.history["time"][::_every(result)],
                    result.history["coverage"][::_every(result)] - exact.coverage, "line"))
        outcome.rows += _rows(case, resolution, exact, without, films)
    return outcome


def _rows(case: Parameters, resolution: int, exact: Profile, without: Run, films: Run) -> list[Row]:
    common: dict[str, Any] = {"at": films.label, "wall_s": without.wall_s + films.wall_s}
    late = films.values("time") > (1.0 - LATE) * films.until
    covered, kept = (_late_coverage(result) for result in (films, without))
    exchanges = films.values("exchanges")
    return [Row("covered share of the wall, with sliding films and without", covered, reference=kept,
                error=abs(covered - kept), tolerance=SAME, **common),
            Row("covered share of the wall", covered, reference=exact.coverage, error=abs(covered - exact.coverage),
                **common),
            Row("covered share of the wall at the start", float(films.values("coverage")[0]),
                reference=exact.coverage, error=abs(float(films.values("coverage")[0]) - exact.coverage), **common),
            Row("particles that changed places", float(exchanges.sum()), **common),
            bounded("exchanges in the last quarter", float(exchanges[late].sum()) / (LATE * films.until)
                    if not films.failure else np.nan, MOST, "1/s", **common),
            *films.rows()]


def _late_coverage(result: Run) -> float:
    """Mean covered share in the last part of a run."""
    return float(result.values("coverage")[result.values("time") > (1.0 - LATE) * result.until].mean()
                 if not result.failure else np.nan)


def _every(result: Run) -> int:
    return max(1, result.history["time"].size // READINGS)


def _rest(case: Parameters, exact: Profile, resolution: int, films: bool) -> Run:
    """Run from the exact shape at rest, with films that slide or without."""
    spacing = RADIUS / resolution
    arrays = cavity("circle", RADIUS, spacing, start="packed", support_ratio=case.support_ratio,
                    dimension=case.dimension, seed=case.seed)
    effects: dict[str, Any] = {
        "gravity": {"magnitude": GRAVITY}, "viscosity_implicit": {},
        "interface_tension": {"coefficient": TENSION, "contact_angle": CONTACT_ANGLE}}
    if films:
        effects["wall_film"] = {}
    solver = build(case, arrays, liquids=(AQUEOUS, OIL), effects=effects, phase=exact.is_oil,
                   maximum_time_step=case.largest_step * np.sqrt(spacing / GRAVITY))
    last: dict[str, float] = {}

    def watch(solver) -> dict[str, float]:
        """The covered share, read so many times in the run that its late mean has several."""
        if not last or solver.time >= last["until"]:
            contact = WallContact.of(arrays, field(solver, "position"), field(solver, "phase"),
                                     particle_spacing=spacing, support_radius=solver.support_radius,
                                     contact_angle=float(CONTACT_ANGLE))
            last.update(coverage=contact.covered_share(), until=solver.time + case.duration / READINGS)
        return {"coverage": last["coverage"], "exchanges": film_exchanges(solver)}

    return advance(solver, case.duration, f"R/dx={resolution}", watch)


FAMILY = Family(__name__, Parameters, run,
                effects=("gravity", "viscosity_implicit", "interface_tension", "wall_film"), figures=FIGURES)
