"""A bubble rises through a liquid (Hysing et al. 2009, both test cases).

Box of 1 m by 2 m, bubble of radius 0.25 m at (0.5 m, 0.5 m), gravity 0.98 m/s^2, liquid of 1000 kg/m^3 and 10 Pa s: Re
35. First case: tension 24.5 N/m (Eo 10), bubble of a tenth of density and viscosity. Second case: 1.96 N/m (Eo 125), a
bubble of gas, 1:1000 in density and 1:100 in viscosity. Measured as in the benchmark: height of the bubble's center of
mass, its mean upward velocity, and its circularity (perimeter of the circle of the same area over the perimeter, of the
contour of the level set). The references are the means of the three codes of the benchmark. In the first case they
agree within 0.2 %; in the second within 1.2 %, and about the circularity not at all (0.46 to 0.59), since the bubble
draws out threads that break in one code and not in another. The side walls slip as in the benchmark; floor and lid slip
here too (no slip there), which the bubble hardly feels.

The Laplacian form of the viscosity knows only mu lap(u), not the gradient of mu times the transposed gradient of u: at
the interface it misses part of the normal viscous stress, and the bubble becomes flatter and faster than it should.
"""
import dataclasses

import numpy as np
from skimage.measure import find_contours

from pipeline.studies.family import Family, Headline
from pipeline.studies.model import Curve, Figure, Outcome, Row, compared, observed_order
from sim.parameters import parameter
from sim.settings import Liquid
from studies.validation.kit.tank import PackedParameters, Run, advance, build, cavity, field

WIDTH, HEIGHT, RADIUS = 1.0, 2.0, 0.25  # m
START = -0.5  # m, height of the bubble's center above the middle of the box
GRAVITY = 0.98
LIQUID = Liquid("liquid", 1000.0, 10.0)
END = 3.0  # s
PRESSURE_TOLERANCE = 1e-5  # with 1e-4, in the small steps of a fine bubble, it bounces as if it were compressible
FIGURES = (
    Figure("bubble_height", "Height of a rising bubble", "time / s", "center of mass / m"),
    Figure("bubble_speed", "Speed of a rising bubble", "time / s", "mean upward velocity / (m/s)"),
    Figure("bubble_circularity", "Circularity of a rising bubble", "time / s",
           "perimeter of the circle of this area / perimeter"),
)


@dataclasses.dataclass(frozen=True)
class Bubble:
    """A test case and what TP2D, FreeLIFE and MooNMD found in the mean, with the time of the largest speed."""

    liquid: Liquid
    tension: float
    height: float       # m, of the center of mass at the end
    speed: float        # m/s, the largest
    speed_at: float     # s
    circularity: float  # the smallest; nan where the codes do not agree
    tolerances: tuple[float, float, float]


BUBBLES = {1: Bubble(Liquid("bubble", 100.0, 1.0), 24.5, 1.0810, 0.2419, 0.9239, 0.9012, (0.01, 0.03, 0.02)),
           2: Bubble(Liquid("bubble", 1.0, 0.1), 1.96, 1.1335, 0.2513, 0.7310, np.nan, (0.02, 0.03, np.nan))}


@dataclasses.dataclass(frozen=True)
class Parameters(PackedParameters):
    """The bubble of the benchmark; resolutions count particles along the width of the box."""

    test_case: int = parameter(1, choices=tuple(BUBBLES), meaning="test case of the benchmark")
    viscosity: str = parameter("laplacian", choices=("laplacian", "central", "implicit"),
                               meaning="form of the explicit viscosity, or the implicit one")


def run(case: Parameters) -> Outcome:
    """Measure height, largest speed and smallest circularity at every resolution."""
    outcome, bubble = Outcome(), BUBBLES[case.test_case]
    errors: dict[str, list[float]] = {}
    for resolution in case.resolutions:
        result = _rise(case, resolution)
        outcome.remarks += result.remarks(f"rising bubble {case.test_case}, {case.viscosity}")
        gated = resolution == max(case.resolutions)
        for (quantity, value, reference, unit), tolerance in zip((
                ("height of the center of mass at 3 s", result.values("height")[-1], bubble.height, "m"),
                ("largest speed", result.values("speed").max(), bubble.speed, "m/s"),
                ("smallest circularity", result.values("circularity")[1:].min(), bubble.circularity, "1")),
                bubble.tolerances, strict=True):
            if np.isnan(reference):
                outcome.rows.append(Row(quantity, float(value), unit, at=result.label, wall_s=result.wall_s))
                continue
            row = compared(quantity, float(value), reference, tolerance if gated else None, unit, at=result.label,
                           wall_s=result.wall_s)
            outcome.rows.append(row)
            errors.setdefault(quantity, []).append(row.error)
        outcome.rows += result.rows()
        if not result.failure:
            time = result.history["time"]
            label = f"{case.test_case} {case.viscosity} {result.label}"
            outcome.curves += [Curve(f"bubble_{name}", label, time[1:], result.history[name][1:], "line")
                               for name in ("height", "speed", "circularity")]
    spacings = [WIDTH / resolution for resolution in case.resolutions]
    outcome.rows += [Row(f"observed order of the {quantity}", observed_order(spacings, values))
                     for quantity, values in errors.items()]
    name = f"benchmark {case.test_case}"
    outcome.curves += [Curve("bubble_height", name, [END], [bubble.height], "reference"),
                       Curve("bubble_speed", name, [bubble.speed_at], [bubble.speed], "reference")]
    if not np.isnan(bubble.circularity):
        outcome.curves.append(Curve("bubble_circularity", name, [1.9], [bubble.circularity], "reference"))
    return outcome


def circularity(values: np.ndarray, cell: float) -> float:
    """Perimeter of the circle of the same area over the perimeter of the longest zero contour of node values.

    Parameters
    ----------
    values : (nx, ny) level set, positive in the bubble; cell : node distance, m.

    Returns
    -------
    1 for a circle, less for anything else; nan where there is no closed contour.
    """
    contours = [cell * contour for contour in find_contours(values, 0.0) if np.allclose(contour[0], contour[-1])]
    if not contours:
        return np.nan
    longest = max(contours, key=len)
    steps = np.diff(longest, axis=0)
    area = 0.5 * abs(np.sum(longest[:-1, 0] * steps[:, 1] - longest[:-1, 1] * steps[:, 0]))
    return float(2.0 * np.sqrt(np.pi * area) / np.linalg.norm(steps, axis=1).sum())


def _rise(case: Parameters, resolution: int) -> Run:
    spacing = WIDTH / resolution
    arrays = cavity("box", (WIDTH, HEIGHT), spacing, start="packed", support_ratio=case.support_ratio,
                    seed=case.seed)
    slip = {"wall": "free_slip"}
    viscosity = ({"viscosity_implicit": slip} if case.viscosity == "implicit"
                 else {"viscosity": slip | {"form": case.viscosity}})
    bubble = BUBBLES[case.test_case]
    solver = build(
        case, arrays, liquids=(LIQUID, bubble.liquid),
        phase=lambda x: np.linalg.norm(x - [0.0, START], axis=1) < RADIUS,
        effects={"gravity": {"magnitude": GRAVITY}, "interface_tension": {"coefficient": bubble.tension}} | viscosity,
        maximum_time_step=case.largest_step * np.sqrt(spacing / GRAVITY), pressure_tolerance=PRESSURE_TOLERANCE)
    tension = next(effect for effect in solver.effects if effect.name == "interface_tension")
    grid = tension.grid

    def watch(solver) -> dict[str, float]:
        inside = solver.particles.to_numpy("phase") == 1
        volume = field(solver, "volume")[inside]
        mean = {name: float(volume @ field(solver, name)[inside, 1] / volume.sum())
                for name in ("position", "velocity")}
        return {"height": mean["position"] + 0.5 * HEIGHT, "speed": mean["velocity"],
                "circularity": circularity(tension.level_set.phi.to_numpy().reshape(grid.shape), grid.cell)}

    return advance(solver, END, f"n={resolution}", watch)


FAMILY = Family(__name__, Parameters, run,
                effects=("gravity", "viscosity", "viscosity_implicit", "interface_tension"), figures=FIGURES,
                headline=Headline("largest speed", 1.0, shown_by=("gravity", "interface_tension")))
