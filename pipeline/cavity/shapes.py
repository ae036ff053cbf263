"""Particles of circles, spheres and boxes with exact signed distances: the cavities of tests and studies."""
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from pipeline.cavity.container import box_arrays, distance_to_box
from pipeline.cavity.initial_state import initial_arrays
from pipeline.cavity.lattice import deepest_points
from pipeline.cavity.signed_distance_grid import distance_of_function
from pipeline.cavity.wall_layers import wall_layers as layers_on_surface


def shape_arrays(kind: str, size: ArrayLike, particle_spacing: float, *, dimension: int = 2,
                 wall_layers: int = 3, periodic: Sequence[int] = ()) -> dict[str, np.ndarray]:
    """Arrays of ``initial.npz`` for a simple cavity centered on the origin.

    The liquid of a round cavity is a lattice that still has to be packed (``sim.packing.pack``); that of a box fills
    it as a perfect lattice, and so do its walls.

    Parameters
    ----------
    kind : "circle" (the same as "sphere"; ``dimension`` decides) or "box".
    size : radius, or the sides of the box, in m; sides are whole numbers of spacings.
    particle_spacing : dx, m.
    dimension : 2 or 3.
    wall_layers : layers of wall particles.
    periodic : axes along which a box has no walls but repeats itself.

    Returns
    -------
    dict of fluid_position (n, D), fluid_volume (n,), wall_position (m, D), wall_volume (m,), wall_distance (m,),
    sdf_values, sdf_origin (D,), sdf_cell (), cavity_volume (), particle_spacing (), dimension (), SI units; and, with
    periodic axes, periods (D,), m, 0 along the others.

    Raises
    ------
    ValueError : unknown kind, wrong number of sides, or a side that is no whole number of spacings.
    """
    if kind in ("circle", "sphere"):
        return _round_arrays(float(np.asarray(size)), particle_spacing, dimension, wall_layers)
    if kind == "box":
        arrays = _box_arrays(np.asarray(size, float), particle_spacing, dimension, wall_layers)
        return _without_ends(arrays, np.asarray(size, float), periodic) if len(periodic) else arrays
    raise ValueError(f'kind is "{kind}", but must be "circle", "sphere" or "box"')


def _round_arrays(radius: float, spacing: float, dimension: int, layers: int) -> dict[str, np.ndarray]:
    corner = np.full(dimension, radius)
    distance = distance_of_function(lambda x: np.linalg.norm(x, axis=-1) - radius, -corner, corner, 0.5 * spacing,
                                    margin=(layers + 2) * spacing)
    volume = _ball_volume(radius, dimension)
    fluid = deepest_points(distance, -corner, corner, round(volume / spacing**dimension), spacing)
    walls = _rings(radius, spacing, layers) if dimension == 2 else layers_on_surface(distance, spacing, layers)
    return initial_arrays(fluid, walls, distance, volume, spacing)


def _without_ends(arrays: dict[str, np.ndarray], sides: np.ndarray, periodic: Sequence[int]) -> dict[str, np.ndarray]:
    """The same box without the walls at the ends of its periodic axes."""
    repeats = np.isin(np.arange(len(sides)), periodic)
    between = (np.abs(arrays["wall_position"]) < 0.5 * sides)[:, repeats].all(axis=1)
    walls = {name: arrays[name][between] for name in ("wall_position", "wall_volume")}
    far = np.where(repeats, 1e3 * sides.max(), 0.5 * sides)
    spacing = float(arrays["particle_spacing"])
    distance = distance_of_function(lambda points: distance_to_box(points, -far, far), -0.5 * sides, 0.5 * sides,
                                    0.5 * spacing, margin=5.0 * spacing)
    return arrays | walls | {"wall_distance": distance_to_box(walls["wall_position"], -far, far),
                             "sdf_values": distance.values, "periods": np.where(repeats, sides, 0.0)}


def _ball_volume(radius: float, dimension: int) -> float:
    return np.pi * radius**2 if dimension == 2 else 4.0 / 3.0 * np.pi * radius**3


def _rings(radius: float, spacing: float, layers: int) -> dict[str, np.ndarray]:
    positions, volumes, depths = [], [], []
    for layer in range(layers):
        ring = radius + (layer + 0.5) * spacing
        count = round(2.0 * np.pi * ring / spacing)
        # Rings start half a particle apart, so that no radial rows form near angle 0.
        angle = 2.0 * np.pi * (np.arange(count) + 0.5 * (layer % 2)) / count
        positions.append(ring * np.stack([np.cos(angle), np.sin(angle)], axis=-1))
        volumes.append(np.full(count, 2.0 * np.pi * ring * spacing / count))
        depths.append(np.full(count, ring - radius))
    return {"wall_position": np.concatenate(positions), "wall_volume": np.concatenate(volumes),
            "wall_distance": np.concatenate(depths)}


def _box_arrays(sides: np.ndarray, spacing: float, dimension: int, layers: int) -> dict[str, np.ndarray]:
    if sides.shape != (dimension,):
        raise ValueError(f"size has {sides.size} sides, but a box in {dimension}D has {dimension}")
    counts = np.rint(sides / spacing).astype(int)
    if counts.min() < 1 or not np.allclose(counts * spacing, sides, rtol=1e-6):
        raise ValueError(f"sides {sides.tolist()} must be whole numbers of the spacing {spacing}")

    return box_arrays((-0.5 * sides, 0.5 * sides), [(-0.5 * sides, 0.5 * sides)], spacing, layers)
