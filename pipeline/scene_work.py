"""What there is to do in a scene, before it is run: particles, neighbor entries, parts of the solver, memory."""
import dataclasses
import math

import numpy as np

from pipeline.container import block_lattices, whole_counts
from pipeline.cost_model import neighbor_entries
from pipeline.scene_model import Scene
from sim.effects import REGISTRY
from sim.effects.effect import Effect
from sim.lazy import cheapest, without_idle
from sim.neighbor_search import row_widths
from sim.schemes import REGISTRY as SCHEMES
from sim.solver import capacity_for

HOST_HOOKS = ("exchange", "prepare", "correct_velocity", "finish")  # every effect that has one has a row of timings
PAIR_HOOKS = ("pair_acceleration", "wall_acceleration")
SHARED_PARTS = ("neighbors", "accelerations", "time step", "rest")  # of every solver
SOLVES = ("pressure", "divergence solve", "density solve")  # parts of a scheme that iterate
LATTICE_LIMIT = 3e6  # particles, up to which blocks are counted one by one


@dataclasses.dataclass(frozen=True)
class SceneWork:
    """Numbers of one scene.

    Attributes
    ----------
    particles, wall_particles : counts at the start; walls as far as they can meet liquid.
    wall_area : of the cavity, in particle spacings^(dimension - 1), as far as liquid wets it.
    width : of the cavity, in particle spacings.
    entries : neighbor entries. row_bytes : memory of particle fields' largest companions, the neighbor rows.
    """

    particles: int
    wall_particles: int
    wall_area: float
    width: float
    dimension: int
    entries: float
    row_bytes: float


def scene_work(scene: Scene, cavity_volume: float, cavity_area: float) -> SceneWork:
    """Return the numbers of a scene.

    Parameters
    ----------
    cavity_volume, cavity_area : of the cavity's surface, m^3 and m^2 (in two dimensions m^2 and m).
    """
    numerics, spacing, dimension = scene.numerics, scene.numerics.particle_spacing, scene.dimension
    particles = _particles(scene, cavity_volume)
    # A container that is not full wets less of its wall: about as the liquid would, were it of the cavity's shape.
    wet = 1.0 if scene.closed else min(1.0, particles * spacing**dimension / cavity_volume)
    area = wet * cavity_area / spacing ** (dimension - 1)
    layers = [depth for depth in np.arange(numerics.wall_layers) + 0.5 if depth < numerics.support_ratio]
    radius = dimension * cavity_volume / cavity_area / spacing  # of the ball with this ratio of volume to surface
    walls = sum(cavity_area / spacing ** (dimension - 1) * (1.0 + depth / radius) ** (dimension - 1)
                for depth in layers)
    crowding = max([1.25, *(REGISTRY[name].crowding for name in active_effects(scene))])
    widths = row_widths(numerics.support_ratio, dimension, crowding)
    real = 4 if numerics.precision == "f32" else 8
    rows = capacity_for(particles) * (widths[0] + widths[1]) + walls * widths[2]
    width = (cavity_volume / {2: math.pi / 4.0, 3: math.pi / 6.0}[dimension]) ** (1.0 / dimension) / spacing
    return SceneWork(particles, round(walls), area, width, dimension,
                     neighbor_entries(particles, area, dimension, numerics.support_ratio),
                     rows * (4 + real * (dimension + 1)))


def _particles(scene: Scene, cavity_volume: float) -> int:
    spacing, dimension = scene.numerics.particle_spacing, scene.dimension
    if scene.container is None:
        return round(cavity_volume / spacing**dimension)
    if not scene.blocks:
        return math.prod(int(n) for n in whole_counts(np.zeros(dimension), scene.container.size, spacing))
    volume = sum(block.volume for block in scene.blocks if not block.replaces)
    if volume / spacing**dimension > LATTICE_LIMIT:
        return round(volume / spacing**dimension)
    return sum(len(points) for points, _ in block_lattices(scene.blocks, spacing))


def active_effects(scene: Scene) -> list[str]:
    """Return the names of the effects that the solver runs: idle ones are left out, others take their cheapest form."""
    present = {type(parameters) for parameters in without_idle(cheapest(scene.settings())[0])[0].effects}
    return [name for name, effect in REGISTRY.items() if effect.Parameters in present]


def effect_parts(scene: Scene) -> list[str]:
    """Return the names of the effects that have a row of timings of their own."""
    return [name for name in active_effects(scene) if any(
        getattr(REGISTRY[name], hook) is not getattr(Effect, hook) for hook in HOST_HOOKS)]


def pair_effects(scene: Scene) -> int:
    """Return how many effects add to the accelerations between particles."""
    return sum(any(getattr(REGISTRY[name], hook) is not getattr(Effect, hook) for hook in PAIR_HOOKS)
               for name in active_effects(scene))


def variant(scene: Scene) -> str:
    """Return the name of the class that solves a scene: a scheme may have one for full cavities and one for others."""
    return SCHEMES[scene.numerics.scheme].variant(scene.settings()).__name__


def part_of(name: str, scene: Scene) -> str:
    """Return what the cost model calls a row of the solver's timings: parts of a scheme carry its class."""
    common = name in (*SHARED_PARTS, "frame", "build") or name in REGISTRY
    return name if common else f"{variant(scene)}/{name}"


def rounds_of(part: str, scene: Scene, pressure: float, viscosity: float) -> float:
    """Return how often a part goes round in a step, with that many iterations of the two solves."""
    name = part.rpartition("/")[2]
    if name in SOLVES:
        return pressure
    return {"viscosity_implicit": viscosity, "accelerations": float(pair_effects(scene))}.get(name, 0.0)
