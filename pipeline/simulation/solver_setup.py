"""From a scene and its filled cavity to the solver, and from the solver to frames."""
from collections.abc import Sequence

import numpy as np

from pipeline.base.energies import kinetic_energy, potential_energy
from pipeline.base.errors import UserError
from pipeline.base.frame_files import FrameData
from pipeline.cavity.blocks import contains
from pipeline.scenes.effects import down_at_start
from pipeline.scenes.model import AT_REST, Block, Scene

FOR_DIGESTS = "runs effects"


def initial_phases(scene: Scene, position: np.ndarray, down: np.ndarray) -> np.ndarray:
    """Liquid of every particle at t = 0: that of its block, or one liquid, or several at rest or stacked level.

    Parameters
    ----------
    position : (n, d), m; down : (d,) direction of gravity.

    Returns
    -------
    (n,) phase indices; volumes are met to one particle.

    Raises
    ------
    UserError : no shape at rest was found.
    """
    names = [liquid.name for liquid in scene.liquids]
    if scene.blocks:
        return of_blocks(position, scene.blocks, [names.index(block.liquid) for block in scene.blocks])
    if scene.initial.fill is None:
        return np.full(len(position), names.index(scene.initial.liquid or names[0]))
    if scene.initial.shape == AT_REST:
        from pipeline.equilibrium.of_scene import oil_at_rest, rest_of  # imports VTK

        try:
            rest = rest_of(scene, down, scene.initial.fill[names[1]])
        except UserError as error:
            raise UserError(f"initial.shape: {error}; or write level") from error
        return oil_at_rest(rest, position).astype(int)
    fill = {names.index(name): value for name, value in scene.initial.fill.items()}
    heavy_first = sorted(fill, key=lambda phase: -scene.liquids[phase].density)
    bounds = np.round(np.cumsum([fill[phase] for phase in heavy_first]) * len(position)).astype(int)
    phases = np.empty(len(position), int)
    start = 0
    bottom_first = np.argsort(-(position @ down), kind="stable")
    for phase, end in zip(heavy_first, bounds, strict=True):
        phases[bottom_first[start:end]] = phase
        start = end
    return phases


def of_blocks(position: np.ndarray, blocks: Sequence[Block], values: Sequence) -> np.ndarray:
    """Value (n, ...) of the block in which every particle lies; particles are (n, d), m."""
    chosen = np.full(len(position), -1)
    for index, block in enumerate(blocks):
        chosen[contains(block, position)] = index
    return np.asarray(values)[chosen]


def initial_velocity(scene: Scene, position: np.ndarray) -> np.ndarray:
    """Velocity (n, d) of every particle at t = 0: that of its block, else rest; m/s."""
    if not scene.blocks:
        return np.zeros_like(position)
    return of_blocks(position, scene.blocks, [block.velocity or (0.0,) * scene.dimension for block in scene.blocks])


def build_solver(scene: Scene, initial: dict[str, np.ndarray], head_room: float | None = None):
    """Solver of a scene at t = 0, with every effect in its cheapest form; Taichi must run already.

    Parameters
    ----------
    head_room : room for neighbors and particles (``sim.solver.Solver``); by default what a liquid near rest needs.
    """
    from sim.effect_selection import cheapest
    from sim.solver import Solver

    down, position = down_at_start(scene), initial["fluid_position"]
    if down is None:
        down = np.array([0.0, -1.0, 0.0])
    phases = initial_phases(scene, position, down[: position.shape[1]])
    settings, notes = cheapest(scene.settings())
    solver = Solver(
        settings, fluid_position=position, fluid_volume=initial["fluid_volume"], fluid_phase=phases,
        fluid_velocity=initial_velocity(scene, position),
        wall_position=initial["wall_position"], wall_volume=initial["wall_volume"],
        wall_depth=initial["wall_distance"], sdf_values=initial["sdf_values"], sdf_origin=initial["sdf_origin"],
        sdf_cell=initial["sdf_cell"], cavity_volume=initial["cavity_volume"],
        **({} if head_room is None else {"head_room": head_room}))
    solver.notes = [*notes, *solver.notes]
    return solver


def frame_of(scene: Scene, solver, statistics: dict[str, float]) -> FrameData:
    """The present state as a frame."""
    arrays = solver.snapshot()
    gravity, dimension = solver.weight(), solver.dimension
    mass = arrays["mass"].astype(float)
    velocity = np.zeros((len(mass), 3), dtype=arrays["velocity"].dtype)
    velocity[:, :dimension] = arrays["velocity"]
    energies = {
        "kinetic_energy": kinetic_energy(mass, arrays["velocity"]),
        "potential_energy": potential_energy(mass, arrays["position"], gravity[:dimension]),
        "compression_maximum": float(arrays["compression_rate"].max()),
    }
    return FrameData(
        position=arrays["position"], id=arrays["id"], phase=arrays["volume_fraction"].argmax(1), velocity=velocity,
        pressure=arrays["pressure"], volume=arrays["volume"], volume_fraction=arrays["volume_fraction"],
        compression_rate=arrays["compression_rate"], time=solver.time, step=solver.step_count, gravity=gravity,
        particle_spacing=scene.numerics.particle_spacing, scene=scene.name,
        liquids=tuple(liquid.name for liquid in scene.liquids), statistics=statistics | energies)
