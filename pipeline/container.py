"""A rectangular cavity: its wall particles, its signed distance, and the lattices of the blocks of liquid in it."""
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from pipeline.initial import initial_arrays
from pipeline.signed_distance import SignedDistance, distance_of_function

if TYPE_CHECKING:
    from pipeline.scene_model import Scene

Corners = tuple[Sequence[float], Sequence[float]]


def container_arrays(scene: "Scene") -> dict[str, np.ndarray]:
    """Arrays of ``initial.npz`` for a scene with a container: its blocks, or all of it where it has none."""
    whole = (np.zeros(scene.dimension), np.array(scene.container.size))
    blocks = [(block.lower, block.upper) for block in scene.blocks] or [whole]
    balls = [index for index, block in enumerate(scene.blocks) if block.shape == "ball"]
    return box_arrays(whole, blocks, scene.numerics.particle_spacing, scene.numerics.wall_layers, balls)


def box_arrays(box: Corners, blocks: Sequence[Corners], spacing: float, layers: int,
               balls: Sequence[int] = ()) -> dict[str, np.ndarray]:
    """Arrays of ``initial.npz`` for a box with blocks of liquid.

    Parameters
    ----------
    box, blocks : lower and upper corner (D,) each, m.
    spacing, layers : particle spacing in m, layers of wall particles.
    balls : indices of the blocks of which only the ball that touches their sides holds liquid.
    """
    lower, upper = (np.asarray(corner, float) for corner in box)
    lattices = [block_lattice(*block, spacing) for block in blocks]
    for index in balls:
        position, each = lattices[index]
        lattices[index] = position[in_ball(position, *blocks[index])], each
    volume = np.concatenate([np.full(len(position), each) for position, each in lattices])
    distance = distance_of_function(lambda points: distance_to_box(points, lower, upper), lower, upper, 0.5 * spacing,
                                    (layers + 2) * spacing)
    position, walls = np.concatenate([points for points, _ in lattices]), box_walls(lower, upper, spacing, layers)
    return initial_arrays(position, walls, distance, float(np.prod(upper - lower)), spacing, volume)


def block_lattice(lower: Sequence[float], upper: Sequence[float], spacing: float) -> tuple[np.ndarray, float]:
    """Lattice (n, D) in m that fills a block, and the volume of each particle, m3 (m2 in 2D).

    The block keeps its sides exactly: along one that is no whole multiple of the spacing, the lattice is stretched or
    squeezed to the nearest whole number of particles.
    """
    counts = whole_counts(lower, upper, spacing)
    axes = [low + (np.arange(count) + 0.5) * (high - low) / count
            for low, high, count in zip(lower, upper, counts, strict=True)]
    volume = float(np.prod(np.subtract(upper, lower) / counts))
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes)), volume


def in_ball(position: np.ndarray, lower: Sequence[float], upper: Sequence[float]) -> np.ndarray:
    """Mask (n,) of the points (n, D) inside the ball or ellipsoid that touches the sides of a block."""
    away = (2.0 * position - np.add(lower, upper)) / np.subtract(upper, lower)
    return (away**2).sum(axis=1) < 1.0


def whole_counts(lower: Sequence[float], upper: Sequence[float], spacing: float) -> np.ndarray:
    """Number of particles along each side of a block, the nearest to its length over the spacing."""
    return np.maximum(np.rint(np.subtract(upper, lower) / spacing), 1).astype(int)


def box_walls(lower: np.ndarray, upper: np.ndarray, spacing: float, layers: int) -> dict[str, np.ndarray]:
    """Wall particles around a box in whole layers of one spacing, as a lattice that continues that of a full box."""
    axes, widths = [], []
    for low, high, count in zip(lower, upper, whole_counts(lower, upper, spacing), strict=True):
        outside = spacing * (np.arange(layers) + 0.5)
        inside = low + (np.arange(count) + 0.5) * (high - low) / count
        axes.append(np.concatenate([low - outside[::-1], inside, high + outside]))
        widths.append(np.concatenate([np.full(layers, spacing), np.full(count, (high - low) / count),
                                      np.full(layers, spacing)]))
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(lower))
    volume = np.prod(np.meshgrid(*widths, indexing="ij"), axis=0).ravel()
    depth = distance_to_box(points, lower, upper)
    wall = depth > 0.0
    return {"wall_position": points[wall], "wall_volume": volume[wall], "wall_distance": depth[wall]}


def distance_to_box(points: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """Signed distance (...) of points (..., D) to the surface of a box in m, negative inside."""
    outside = np.maximum(lower - points, points - upper)
    return np.linalg.norm(np.maximum(outside, 0.0), axis=-1) + np.minimum(outside.max(axis=-1), 0.0)


def report_of(arrays: dict[str, np.ndarray]) -> dict:
    """Report of the voxelize stage on a container, in SI units; volumes are areas in two dimensions."""
    distance = SignedDistance(arrays["sdf_values"], arrays["sdf_origin"], float(arrays["sdf_cell"]))
    spacing, volume = float(arrays["particle_spacing"]), arrays["fluid_volume"]
    dimension, liquid, cavity = int(arrays["dimension"]), float(volume.sum()), float(arrays["cavity_volume"])
    return {
        "particle_spacing": spacing, "fluid_particles": len(volume), "wall_particles": len(arrays["wall_distance"]),
        "container_volume": cavity, "liquid_volume": liquid, "filled": liquid / cavity,
        "volume_smallest": float(volume.min()) / spacing**dimension,
        "volume_largest": float(volume.max()) / spacing**dimension,
        "shallowest_depth": -float(distance.sample(arrays["fluid_position"]).max()) / spacing,
        "grid_nodes": list(arrays["sdf_values"].shape),
    }
