"""Metrics of mixtures: how far the liquids are mixed, how large their interface is, and where the emulsion collects.

The *emulsion* of a scene is, with the effect ``contact_line_emulsification``, the oil in droplets: the volume of the
liquid that this effect names. In other scenes, where the fractions themselves spread, it is all liquid whose volume
fraction of oil is between 0.05 and 0.95. Equations: docs/methods/measures.md.
Axes as in :mod:`pipeline.measures.coverage`: origin in the center of the globe, x to the patient's left, y superior,
z anterior.
"""
import numpy as np
from scipy.spatial import cKDTree

from pipeline.measures.frame_view import MIXED, Measured
from pipeline.measures.metric import Metric, registrar

METRICS: list[Metric] = []
metric = registrar(METRICS)

BANDS = (0.05, 0.25, 0.5, 0.75, 0.95)           # of the volume fraction of the oil
DROPLET_BANDS = (1e-6, 1e-5, 1e-4, 1e-3)        # of the volume fraction of the droplets
ANGLE_DEPTH = 1.0 / 3.0     # the angle at the lens is the anterior third of the cavity's length along the optic axis
FEWEST_NEIGHBORS = 4        # fewer directions than that may lie in one plane, where no gradient can be found


@metric("1", "how far the liquids are mixed: 0 where every particle is one pure liquid, 1 where all are alike; "
             "variance: 1 - sum of the variances of the fractions / sum of m (1 - m), m the mean fraction of a liquid; "
             "entropy: mean of -sum a ln a / -sum m ln m", of_mixture=True, place=7,
        limits=(0.0, 1.0))
def mixing_index(state: Measured) -> dict[str, float]:
    fraction = state.frame.volume_fraction.astype(float)
    share = state.frame.volume.astype(float) / max(state.frame.volume.sum(dtype=float), np.finfo(float).tiny)
    mean = share @ fraction
    variance = share @ (fraction - mean) ** 2
    unmixed, largest = np.sum(mean * (1.0 - mean)), entropy(mean)
    with np.errstate(invalid="ignore", divide="ignore"):
        return {"variance": 1.0 - variance.sum() / unmixed if unmixed > 0.0 else np.nan,
                "entropy": share @ entropy(fraction) / largest if largest > 0.0 else np.nan}


def entropy(fraction: np.ndarray) -> np.ndarray:
    """Entropy of mixing -sum a ln a (...) of fractions (..., liquids) (Q6); what round-off made negative counts 0."""
    positive = np.where(fraction > 0.0, fraction, 1.0)
    return -(positive * np.log(positive)).sum(axis=-1)


@metric("mL", "volume of liquid by its volume fraction of oil, in percent; the bands add up to all liquid",
        of_mixture=True, place=15)
def fraction_band(state: Measured) -> dict[str, float]:
    names = ["below_5", "5_to_25", "25_to_50", "50_to_75", "75_to_95", "above_95"]
    return _bands(state.oil_fraction, state.frame.volume, BANDS, names)


@metric("mL", "volume of liquid by its content of droplets, in parts per million by volume; the bands add up to all "
              "liquid (only with contact_line_emulsification)", of_mixture=True, place=16)
def droplet_band(state: Measured) -> dict[str, float]:
    names = ["below_1", "1_to_10", "10_to_100", "100_to_1000", "above_1000"]
    if state.droplets is None:
        return dict.fromkeys(names, np.nan)
    return _bands(state.frame.volume_fraction[:, state.droplets], state.frame.volume, DROPLET_BANDS, names)


def _bands(fraction: np.ndarray, volume: np.ndarray, edges: tuple[float, ...], names: list[str]) -> dict[str, float]:
    """Volume (mL) of particles by fraction; a fraction on an edge belongs above it, the last edge below it."""
    band = np.searchsorted(edges, np.asarray(fraction, float), side="right")
    band[np.asarray(fraction, float) == edges[-1]] -= 1
    return dict(zip(names, 1e6 * np.bincount(band, volume.astype(float), minlength=len(names)), strict=True))


@metric("cm2", "area of the interface of the oil: the integral of the size of the gradient of its smoothed volume "
               "fraction, which is the mean area of all levels of the fraction (in two dimensions its length times "
               "1 m)", of_mixture=True, place=8)
def interface_area(state: Measured) -> float:
    position, volume = state.frame.position, state.frame.volume
    # Smoothed first: from one particle to the next a step is rough, and all roughness adds to the area.
    smooth = smoothed(position, volume, state.oil_fraction, state.support_radius)
    slope = np.linalg.norm(fraction_gradient(position, volume, smooth, state.support_radius), axis=1)
    return 1e4 * float(np.sum(slope * volume, dtype=float))


def neighbors(position: np.ndarray, support_radius: float) -> tuple[np.ndarray, np.ndarray]:
    """Particles i (m,) and their neighbors j (m,), every pair both ways."""
    if not len(position):
        return np.zeros(0, int), np.zeros(0, int)
    pairs = cKDTree(position).query_pairs(support_radius, output_type="ndarray")
    i, j = np.concatenate([pairs, pairs[:, ::-1]]).T
    return i, j


def smoothed(position: np.ndarray, volume: np.ndarray, fraction: np.ndarray, support_radius: float) -> np.ndarray:
    """Mean (n,) of a fraction (n,) over the neighbors and the particle itself, weighted by volume and Wendland C2."""
    position, volume, fraction = (np.asarray(values, float) for values in (position, volume, fraction))
    i, j = neighbors(position, support_radius)
    q = np.minimum(np.linalg.norm(position[i] - position[j], axis=1) / support_radius, 1.0)
    weight = volume[j] * (1.0 - q) ** 4 * (4.0 * q + 1.0)
    count = len(position)
    total = np.bincount(i, weight * fraction[j], count) + volume * fraction
    return total / (np.bincount(i, weight, count) + volume)


def fraction_gradient(position: np.ndarray, volume: np.ndarray, fraction: np.ndarray,
                      support_radius: float) -> np.ndarray:
    """Gradient (n, D) of a fraction (n,) at the particles, 1/m, exact up to the wall where the fraction is linear.

    Differences to the neighbors, weighted by a Wendland C2 kernel and corrected by the moment matrix
    B_i = sum_j V_j (x_j - x_i) grad W [bonet1999] (Q7). 0 where too few neighbors are left.
    """
    position, volume, fraction = (np.asarray(values, float) for values in (position, volume, fraction))
    count, dimension = position.shape
    gradient = np.zeros((count, dimension))
    i, j = neighbors(position, support_radius)
    away = (position[j] - position[i]) / support_radius
    weight = (volume[j] * (1.0 - np.minimum(np.linalg.norm(away, axis=1), 1.0)) ** 3)[:, None] * away
    moment = np.empty((count, dimension, dimension))
    for row in range(dimension):
        gradient[:, row] = np.bincount(i, weight[:, row] * (fraction[j] - fraction[i]), minlength=count)
        for column in range(dimension):
            moment[:, row, column] = np.bincount(i, weight[:, row] * away[:, column], minlength=count)
    known = np.bincount(i, minlength=count) >= FEWEST_NEIGHBORS
    if known.any():
        known[known] = np.linalg.cond(moment[known]) < 1e3
    gradient[known] = np.linalg.solve(moment[known], gradient[known][..., None])[..., 0] / support_radius
    gradient[~known] = 0.0
    return gradient


@metric("mL", "volume of the emulsion (with contact_line_emulsification: the oil in droplets; else the liquid with a "
              "fraction of oil between 0.05 and 0.95) in the whole cavity, its quadrants (temporal is the patient's "
              "right in a right eye) and the superior angle (the anterior third, within 45 degrees of superior)",
        of_eye=True, of_mixture=True, place=3)
def emulsion(state: Measured) -> dict[str, float]:
    volume = emulsion_volume(state)
    return {place: 1e6 * volume[mask].sum() for place, mask in places(state).items()}


@metric("%", "share of the emulsion that is in each quadrant of the cavity and in the superior angle", of_eye=True,
        of_mixture=True, place=13)
def emulsion_share(state: Measured) -> dict[str, float]:
    volume, masks = emulsion_volume(state), places(state)
    total = volume.sum()
    return {place: 100.0 * volume[mask].sum() / total if total > 0.0 else np.nan for place, mask in masks.items()
            if place != "whole"}


@metric("%", "share of the liquid of each part of the cavity that is emulsion: how thick the emulsion is there",
        of_eye=True, of_mixture=True, place=12)
def emulsion_content(state: Measured) -> dict[str, float]:
    volume = emulsion_volume(state)
    return {place: 100.0 * volume[mask].sum() / state.frame.volume[mask].sum(dtype=float) if mask.any() else np.nan
            for place, mask in places(state).items()}


def emulsion_volume(state: Measured) -> np.ndarray:
    """Volume of emulsion in every particle (n,), m3."""
    volume = state.frame.volume.astype(float)
    if state.droplets is not None:
        return volume * state.frame.volume_fraction[:, state.droplets]
    return np.where((state.oil_fraction > MIXED[0]) & (state.oil_fraction < MIXED[1]), volume, 0.0)


def places(state: Measured) -> dict[str, np.ndarray]:
    """Particles (n,) of the whole cavity, of its quadrants and of the superior angle.

    On a plane between two quadrants a particle belongs to the superior and to the nasal one.
    """
    x, y, z = state.frame.position.T
    superior = y >= 0.0
    temporal = x < 0.0 if state.right_eye else x > 0.0
    back, front = state.optic_axis_extent
    angle = (z > front - ANGLE_DEPTH * (front - back)) & (y > np.abs(x))
    return {"whole": np.ones(len(x), bool),
            "superior_temporal": superior & temporal, "superior_nasal": superior & ~temporal,
            "inferior_temporal": ~superior & temporal, "inferior_nasal": ~superior & ~temporal, "superior_angle": angle}
