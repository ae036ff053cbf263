"""Memory of a solver, before any of it is allocated."""
import math

import numpy as np

from sim import effects as effect_registry
from sim import schemes
from sim.effect_selection import without_idle
from sim.neighbor_rows import HEAD_ROOM, entries_at_rest
from sim.neighbor_search import REACH
from sim.settings import Settings
from sim.solver import BASE_FIELDS, capacity_for

SOLVES = 12  # reals per particle that the pressure solve and the neighbor search work with
ROW = 12  # bytes that a row of neighbors takes beside its entries
NODES = {2: 4.0, 3: 15.0}  # nodes of the grid per particle: half a spacing apart, around an eye in a box


def needed_bytes(settings: Settings, particles: float, walls: float | None = None, nodes: float | None = None,
                 head_room: float = HEAD_ROOM) -> float:
    """Return the memory, bytes, that a solver needs.

    Parameters
    ----------
    particles : of liquid at the start.
    walls : wall particles near the liquid; nodes : of the grid of the signed distance; by default as many as a compact
        cavity has.
    head_room : of the solver.
    """
    dimension, layers, real = settings.dimension, settings.numerics.wall_layers, _real(settings)
    if walls is None:
        walls = 2 * dimension * layers * particles ** (1.0 - 1.0 / dimension)
    # A pair of a wall particle and a liquid particle is in a row of either.
    pairs = head_room / layers * entries_at_rest(0, np.arange(layers) + 0.5, settings.numerics.support_ratio, 1.0,
                                                 dimension)[1]
    node = real * (1 + sum(effect.reals_per_node(dimension) for effect in _effects(settings)))
    return (capacity_for(int(particles), head_room) * bytes_per_particle(settings, head_room)
            + walls * (pairs * (_bytes_per_pair(settings) + _more_bytes_per_pair(settings))
                       + pairs * _bytes_per_pair(settings) + ROW + real * (dimension + 8))
            + (NODES[dimension] * particles if nodes is None else nodes) * node)


def bytes_per_particle(settings: Settings, head_room: float = HEAD_ROOM) -> float:
    """Return the memory, bytes, of one liquid particle: its fields, its neighbor rows, what the solves work with."""
    settings = without_idle(settings)[0]
    dimension, real, liquids, classes = settings.dimension, _real(settings), len(settings.liquids), _effects(settings)
    scheme = schemes.REGISTRY[settings.numerics.scheme].variant(settings)
    fields = {field.name: field for field in (
        *BASE_FIELDS, *scheme.fields, *(field for effect in classes for field in effect.fields))}.values()
    width = {"scalar": real, "integer": 4, "vector": real * dimension, "liquids": real * liquids,
             "liquid_vectors": real * liquids * dimension, "tensor": real * dimension**2}
    pairs = head_room * entries_at_rest(1, np.zeros(0), settings.numerics.support_ratio, 1.0, dimension)[0]
    images = 3 ** sum(period > 0.0 for period in settings.periods)
    marks = 8 * math.prod(2 * cells + 1 for cells in REACH[1:dimension]) * images
    # What is carried has a buffer in which it is sorted.
    return (sum((1 + field.carried) * width[field.kind] for field in fields) + SOLVES * real + 2 * ROW + marks
            + pairs * (_bytes_per_pair(settings) + _more_bytes_per_pair(settings)))


def _bytes_per_pair(settings: Settings) -> int:
    """Index, gradient and weight of a neighbor."""
    return 4 + _real(settings) * (settings.dimension + 1)


def _more_bytes_per_pair(settings: Settings) -> int:
    """What effects keep for every pair."""
    return _real(settings) * sum(effect.reals_per_pair(settings.dimension) for effect in _effects(settings))


def _real(settings: Settings) -> int:
    return 4 if settings.numerics.precision == "f32" else 8


def _effects(settings: Settings) -> list:
    present = {type(parameters) for parameters in settings.effects}
    return [effect for effect in effect_registry.REGISTRY.values() if effect.Parameters in present]
