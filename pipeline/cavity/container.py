"""A rectangular cavity: its wall particles, its signed distance, and the lattices of the blocks of liquid in it.

Funnels are solid parts of its inside: wall particles on the same lattice, and part of the signed distance.
"""
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from pipeline.base.errors import UserError
from pipeline.cavity.blocks import contains
from pipeline.cavity.initial_state import initial_arrays
from pipeline.cavity.signed_distance_grid import SignedDistance, distance_of_function

if TYPE_CHECKING:
    from pipeline.scenes.model import Block, Funnel, Scene

Corners = tuple[ArrayLike, ArrayLike]


def container_arrays(scene: "Scene") -> dict[str, np.ndarray]:
    """Arrays of ``initial.npz`` for a scene with a container: its blocks, or all of it where it has none.

    Raises
    ------
    UserError : a block reaches into a funnel.
    """
    whole = (np.zeros(scene.dimension), np.array(scene.container.size))
    spacing, layers = scene.numerics.particle_spacing, scene.numerics.wall_layers
    lattices = block_lattices(scene.blocks, spacing) if scene.blocks else [block_lattice(*whole, spacing)]
    funnels = scene.container.funnels
    for index, (points, _) in enumerate(lattices):
        if funnels and (distance_to_funnels(points, funnels) < 0.0).any():
            raise UserError(f"{scene.name}: blocks[{index}] reaches into a funnel, but only one of them can be there")
    return lattice_arrays(whole, lattices, spacing, layers, funnels)


def block_lattices(blocks: Sequence["Block"], spacing: float) -> list[tuple[np.ndarray, float]]:
    """Lattices of blocks, and the volumes of their particles; what a later block replaces is left out."""
    lattices = []
    for index, block in enumerate(blocks):
        points, volume = block_lattice(block.lower, block.upper, spacing)
        keep = contains(block, points)
        for later in blocks[index + 1:]:
            keep &= ~contains(later, points)
        lattices.append((points[keep], volume))
    return lattices


def box_arrays(box: Corners, blocks: Sequence[Corners], spacing: float, layers: int) -> dict[str, np.ndarray]:
    """Arrays of ``initial.npz`` for a box with rectangular blocks of liquid.

    Parameters
    ----------
    box, blocks : lower and upper corner (D,) each, m.
    spacing, layers : particle spacing in m, layers of wall particles.
    """
    return lattice_arrays(box, [block_lattice(*block, spacing) for block in blocks], spacing, layers)


def lattice_arrays(box: Corners, lattices: Sequence[tuple[np.ndarray, float]], spacing: float, layers: int,
                   funnels: Sequence["Funnel"] = ()) -> dict[str, np.ndarray]:
    """Arrays of ``initial.npz`` for a box, funnels in it, and lattices of liquid with the volume of their particles."""
    lower, upper = (np.asarray(corner, float) for corner in box)
    volume = np.concatenate([np.full(len(position), each) for position, each in lattices])
    distance = distance_of_function(lambda points: distance_to_cavity(points, lower, upper, funnels), lower, upper,
                                    0.5 * spacing, (layers + 2) * spacing)
    position, walls = np.concatenate([points for points, _ in lattices]), box_walls(lower, upper, spacing, layers)
    cavity = float(np.prod(upper - lower))
    if funnels:
        points, each = block_lattice(lower, upper, spacing)
        depth = -distance_to_funnels(points, funnels)
        solid = depth > 0.0
        added = {"wall_position": points[solid], "wall_volume": np.full(solid.sum(), each),
                 "wall_distance": depth[solid]}
        walls = {name: np.concatenate([values, added[name]]) for name, values in walls.items()}
        cavity -= each * solid.sum()
    return initial_arrays(position, walls, distance, cavity, spacing, volume)


def distance_to_cavity(points: np.ndarray, lower: np.ndarray, upper: np.ndarray,
                       funnels: Sequence["Funnel"]) -> np.ndarray:
    """Signed distance (...) of points (..., D) to the walls of a box and of funnels in it in m, negative in the liquid.
    """
    distance = distance_to_box(points, lower, upper)
    return np.maximum(distance, -distance_to_funnels(points, funnels)) if funnels else distance


def distance_to_funnels(points: np.ndarray, funnels: Sequence["Funnel"]) -> np.ndarray:
    """Signed distance (...) of points (..., D) to the walls of funnels in m, negative in the wall."""
    return np.min([_distance_to_funnel(points, funnel) for funnel in funnels], axis=0)


def _distance_to_funnel(points: np.ndarray, funnel: "Funnel") -> np.ndarray:
    """Distance to the line of its middle in the half plane of radius and height, less half the thickness."""
    apart = points - np.asarray(funnel.center)
    place = np.stack([np.linalg.norm(np.delete(apart, 1, axis=-1), axis=-1), apart[..., 1]], axis=-1)
    start = np.array([funnel.lower_radius, 0.0])
    along = np.array([funnel.upper_radius, funnel.height]) - start
    share = np.clip((place - start) @ along / (along @ along), 0.0, 1.0)
    return np.linalg.norm(place - start - share[..., None] * along, axis=-1) - 0.5 * funnel.thickness


def block_lattice(lower: ArrayLike, upper: ArrayLike, spacing: float) -> tuple[np.ndarray, float]:
    """Lattice (n, D) in m that fills a block, and the volume of each particle, m3 (m2 in 2D).

    The block keeps its sides exactly: along one that is no whole multiple of the spacing, the lattice is stretched or
    squeezed to the nearest whole number of particles.
    """
    counts = whole_counts(lower, upper, spacing)
    axes = [low + (np.arange(count) + 0.5) * (high - low) / count
            for low, high, count in zip(np.asarray(lower), np.asarray(upper), counts, strict=True)]
    volume = float(np.prod(np.subtract(upper, lower) / counts))
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, len(axes)), volume


def whole_counts(lower: ArrayLike, upper: ArrayLike, spacing: float) -> np.ndarray:
    """Number of particles along each side of a block, the nearest to its length over the spacing.

    >>> whole_counts((0.0, 0.0), (0.1, 0.042), 0.01)
    array([10,  4])
    """
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
