"""Metrics of breaks and regions: covered or not, and how the oil presses on a break.

Equations: docs/methods/measures.md.
"""
import numpy as np

from pipeline.measures.frame_view import MIXED, Measured
from pipeline.measures.metric import Metric, registrar

METRICS: list[Metric] = []
metric = registrar(METRICS)

DOUBTFUL = 0.5      # particle spacings on either side of the edge, within which a point may be covered or not
NEAR = 4.0          # particle spacings around a break, within which the pressure of the oil is compared with its mean
MEDIAN_ERROR = 1.2533  # standard error of a median over that of a mean


@metric("1", "1 where all of a break is under oil, 0 where part of it is bare, 1/2 where less than half a particle "
             "spacing decides; films too thin for the particles count as oil",
        of_eye=True, of_places="breaks", place=0, limits=(0.0, 1.0), yes_or_no=True)
def break_covered(state: Measured) -> dict[str, float]:
    reach = DOUBTFUL * state.frame.particle_spacing
    return {name: 0.5 if abs(margin) < reach else float(margin > 0.0) for name, margin in _margins(state).items()}


@metric("%", "share of a break that is under oil", of_eye=True, of_places="breaks", place=2,
        uncertainty="break_coverage_band", limits=(0.0, 100.0))
def break_coverage(state: Measured) -> dict[str, float]:
    return _covered(state, state.places.breaks)


@metric("%", "share of a break within one particle spacing of the contact line: half of it is the uncertainty of its "
             "coverage", of_eye=True, of_places="breaks")
def break_coverage_band(state: Measured) -> dict[str, float]:
    return _band(state, state.places.breaks)


@metric("mm", "how far the oil reaches beyond a break: the smallest distance of its points to the contact line, "
              "negative where part of it is bare", of_eye=True, of_places="breaks", place=3,
        uncertainty="break_margin_band")
def break_margin(state: Measured) -> dict[str, float]:
    return {name: 1e3 * margin for name, margin in _margins(state).items()}


@metric("mm", "one particle spacing: half of it is the uncertainty of the margin", of_eye=True, of_places="breaks")
def break_margin_band(state: Measured) -> dict[str, float]:
    return dict.fromkeys(state.places.breaks, 1e3 * state.frame.particle_spacing)


@metric("Pa", "contact pressure on the covered part of a break: that of the oil at the wall less that of the aqueous "
              "at the same place, each continued hydrostatically from all of its liquid; at rest it presses the retina "
              "to the wall", of_eye=True, of_places="breaks", place=3, uncertainty="break_pressure_band")
def break_pressure(state: Measured) -> dict[str, float]:
    return {name: pressure for name, (pressure, _) in _pressures(state).items()}


@metric("Pa", "twice the uncertainty of that pressure: what the pressure of the oil near the break differs from the "
              "hydrostatic one, and the error of the medians", of_eye=True, of_places="breaks")
def break_pressure_band(state: Measured) -> dict[str, float]:
    return {name: 2.0 * uncertainty for name, (_, uncertainty) in _pressures(state).items()}


@metric("%", "share of a region of the scene that is under oil", of_eye=True, of_places="regions", place=3,
        uncertainty="region_coverage_band", limits=(0.0, 100.0))
def region_coverage(state: Measured) -> dict[str, float]:
    return _covered(state, state.places.regions)


@metric("%", "share of a region within one particle spacing of the contact line: half of it is the uncertainty of its "
             "coverage", of_eye=True, of_places="regions")
def region_coverage_band(state: Measured) -> dict[str, float]:
    return _band(state, state.places.regions)


def _margins(state: Measured) -> dict[str, float]:
    return {name: one.margin(state.contact_distance) for name, one in state.places.breaks.items()}


def _covered(state: Measured, places) -> dict[str, float]:
    return {name: 100.0 * one.covered_share(state.contact_distance) for name, one in places.items()}


def _band(state: Measured, places) -> dict[str, float]:
    return {name: 100.0 * one.band_share(state.contact_distance, state.frame.particle_spacing)
            for name, one in places.items()}


def _pressures(state: Measured) -> dict[str, tuple[float, float]]:
    """Contact pressure on every break and its uncertainty, Pa; NaN where it is bare, or a liquid is missing. (Q8)"""
    densities = [liquid.density for liquid in state.scene.liquids]
    gravity, position = state.frame.gravity, state.frame.position.astype(float)
    oil, aqueous = state.oil_fraction > MIXED[1], state.oil_fraction < MIXED[0]
    if len(densities) < 2 or not oil.any() or not aqueous.any():
        return dict.fromkeys(state.places.breaks, (np.nan, np.nan))
    heavy = state.mass[aqueous].sum() / state.frame.volume[aqueous].sum()
    light = densities[state.oil]
    level = {kind: state.frame.pressure[mask] - density * (position[mask] @ gravity)
             for kind, mask, density in (("oil", oil, light), ("aqueous", aqueous, heavy))}
    error = np.hypot(_error_of_median(level["oil"]), _error_of_median(level["aqueous"]))
    jump = np.median(level["oil"]) - np.median(level["aqueous"])
    found = {}
    for name, one in state.places.breaks.items():
        covered = one.at_points(state.contact_distance) > 0.0
        if not covered.any():
            found[name] = (np.nan, np.nan)
            continue
        middle = np.average(one.position[covered], axis=0, weights=one.share[covered])
        reach = NEAR * state.frame.particle_spacing
        near = level["oil"][np.linalg.norm(position[oil] - middle, axis=1) < reach]
        local = abs(np.median(near) - np.median(level["oil"])) if len(near) else 0.0
        found[name] = (jump + (light - heavy) * float(middle @ gravity), float(np.hypot(error, local)))
    return found


def _error_of_median(values: np.ndarray) -> float:
    low, high = np.percentile(values, [16.0, 84.0])
    return MEDIAN_ERROR * 0.5 * (high - low) / np.sqrt(len(values))
