"""Frames without a simulation: a ball of jittered lattice particles, cut by a plane into oil above and water below."""
import numpy as np

from pipeline.base.frame_files import FrameData

RADIUS = 11e-3
SPACING = 1.2e-3


def ball(spacing=SPACING):
    """Arrays of ``initial.npz`` for a ball of 11 mm."""
    cell = 0.5 * spacing
    half = int(np.ceil((RADIUS + 5 * spacing) / cell))
    axis = cell * np.arange(-half, half + 1)
    walls = 4000
    height = 1.0 - (2.0 * np.arange(walls) + 1.0) / walls          # even points on a sphere, on a spiral
    turn = np.pi * (1.0 + 5.0**0.5) * np.arange(walls)
    across = np.sqrt(1.0 - height**2)
    wall = (RADIUS + 0.5 * spacing) * np.stack([across * np.cos(turn), height, across * np.sin(turn)], axis=-1)
    squared = axis[:, None, None] ** 2 + axis[:, None] ** 2 + axis**2
    fluid = lattice(spacing)
    return {"fluid_position": fluid, "fluid_volume": np.full(len(fluid), 4.0 / 3.0 * np.pi * RADIUS**3 / len(fluid)),
            "sdf_values": np.sqrt(squared) - RADIUS, "sdf_origin": np.full(3, axis[0]), "sdf_cell": np.array(cell),
            "particle_spacing": np.array(spacing), "dimension": np.array(3),
            "wall_position": wall, "wall_volume": np.full(walls, 4.0 * np.pi * RADIUS**2 * spacing / walls),
            "wall_distance": np.full(walls, 0.5 * spacing),
            "cavity_volume": np.array(4.0 / 3.0 * np.pi * RADIUS**3)}


def oil_fraction(position, *, height=2e-3, tilt=0.0, layer=0.0):
    """Fraction of oil above a plane at ``height`` (m), tilted by ``tilt`` (rad), mixed over a ``layer`` (m)."""
    distance = position @ np.array([0.0, np.cos(tilt), np.sin(tilt)]) - height
    return np.clip(distance / layer + 0.5, 0.0, 1.0) if layer else (distance > 0.0).astype(float)


def lattice(spacing=SPACING, seed=0):
    """Jittered lattice (n, 3) in the ball."""
    axis = spacing * (np.arange(-12, 12) + 0.5)
    points = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    points = points + np.random.default_rng(seed).uniform(-0.2, 0.2, points.shape) * spacing
    return points[np.linalg.norm(points, axis=1) < RADIUS - 0.4 * spacing]


def frame_of(position, fraction, *, volume=None, time=0.0, gravity=(0.0, -9.81, 0.0),
             liquids=("aqueous", "silicone_oil_1000")):
    """Frame with the given fractions (n, liquids), or (n,) of the second of two liquids."""
    if fraction.ndim == 1:
        fraction = np.column_stack([1.0 - fraction, fraction])
    count = len(position)
    if volume is None:
        volume = np.full(count, 4.0 / 3.0 * np.pi * RADIUS**3 / count)
    return FrameData(
        position=position.astype(np.float32), id=np.arange(count), phase=fraction.argmax(axis=1),
        velocity=np.zeros((count, 3), np.float32), pressure=np.zeros(count, np.float32), volume=volume,
        volume_fraction=fraction.astype(np.float32), compression_rate=np.zeros(count, np.float32), time=time, step=0,
        gravity=np.array(gravity), particle_spacing=SPACING, scene="ball", liquids=tuple(liquids))


def make_frame(*, count=20, dimension=3, liquids=("aqueous", "silicone_oil_1000"), time=0.125):
    """A frame of random numbers."""
    random = np.random.default_rng(1)
    fraction = random.dirichlet(np.ones(len(liquids)), count).astype(np.float32)
    return FrameData(
        position=random.normal(size=(count, dimension)).astype(np.float32), id=np.arange(count, dtype=np.int32),
        phase=fraction.argmax(axis=1).astype(np.int32), velocity=random.normal(size=(count, 3)),
        pressure=random.normal(size=count), volume=random.uniform(1e-10, 2e-10, count), volume_fraction=fraction,
        compression_rate=random.normal(size=count), time=time, step=7, gravity=np.array([0, -9.81, 0]),
        particle_spacing=8e-4, scene="demo", liquids=liquids,
        statistics={"pressure_iterations": 12.0, "time_step": 1.25e-3}, extra={"drift": random.normal(size=(count, 3))},
    )
