"""Liquids with a free surface, shared by the tests of the schemes."""
import math

import numpy as np

from helpers import cavities
from helpers.cavities import AQUEOUS, OIL, build, cavity, parameters
from sim.effects.eye_rotation import Oscillation
from sim.effects.viscoelastic import ElasticLiquid
from sim.settings import Liquid

GRAVITY = 9.81
WATER = Liquid("water", 1000.0, 1e-3)
DAM_WIDTH = 0.05715  # m, the broader dam of Martin & Moyce
# Front of the dam (Martin & Moyce 1952, a = 2.25 in): t sqrt(2g/a) and x/a.
DAM_FRONT = np.array([(0.832, 1.217), (1.219, 1.474), (1.997, 2.292), (2.547, 2.995), (3.345, 4.134), (4.034, 4.944)])
EFFECT_PARAMETERS = {"interface_tension": {"coefficient": 0.04}, "cohesion": {"gamma": 0.1},
                     "curvature": {"gamma": 0.1}, "adhesion": {"beta": 0.1}, "diffusion": {"coefficient": 1e-6},
                     "drift": {"droplet_diameter": 1e-5},
                     "viscoelastic": {"liquids": (ElasticLiquid("oil", 10.0, 0.1),)},
                     "eye_rotation": {"oscillation": Oscillation(math.radians(10.0), 5.0, (0.0, 0.0, 1.0))},
                     "contact_line_emulsification": {"oil": "oil", "aqueous": "aqueous", "droplets": "droplets"}}


def still_tank(scheme: str, height: float, particles: int, ratio: float = 1.0, dimension: int = 2, **more):
    """Return a tank filled two thirds high as a lattice, in two layers where `ratio` is not 1."""
    spacing = height / particles
    size = (height, 1.5 * height) if dimension == 2 else (0.5 * height, 1.5 * height, 0.5 * height)
    liquids = (WATER, Liquid("light", ratio * 1000.0, 1e-3))
    return build(cavity("box", size, dimension, spacing), effects=(parameters("gravity", magnitude=GRAVITY),),
                 liquids=liquids if ratio != 1.0 else liquids[:1], scheme=scheme,
                 phase=lambda x: (x[:, 1] > -0.25 * height) & (ratio != 1.0),
                 filled=lambda x: x[:, 1] < 0.25 * height, **more)


def depth_and_weight(solver, height: float, ratio: float = 1.0):
    """Return depth below the surface and the weight of the liquid above per area, by particle of a snapshot."""
    depth = 0.25 * height - solver.snapshot()["position"][:, 1]
    lower = np.maximum(depth - 0.5 * height, 0.0)
    return depth, 1000.0 * GRAVITY * (ratio * (depth - lower) + lower)


def hydrostatic_error(solver, height: float, ratio: float = 1.0) -> float:
    """Return the root mean square error of the pressure over the weight of a water column."""
    _, weight = depth_and_weight(solver, height, ratio)
    error = solver.snapshot()["pressure"] - weight
    return float(np.sqrt((error**2).mean())) / (1000.0 * GRAVITY * height)


def drop(scheme: str, dimension: int, liquids=(WATER,), **more):
    """Return a cube of liquid that is stirred far from any wall."""
    arrays = cavity("box", (0.018,) * dimension, dimension)
    arguments = {"phase": lambda x: np.zeros(len(x)), "velocity": lambda x: 0.05 * np.cos(700.0 * x + 1.0)} | more
    return build(arrays, liquids=liquids, filled=lambda x: (np.abs(x) < 4e-3).all(axis=1), scheme=scheme, **arguments)


def dam(scheme: str, particles: int, length: float = 7.0, **more):
    """Return a dam of width a and height 2a at the left end of a tank, a/particles the spacing."""
    spacing = DAM_WIDTH / particles
    size = (round(length * particles) * spacing, 3.0 * DAM_WIDTH)
    left, bottom = -0.5 * size[0], -0.5 * size[1]
    return build(cavity("box", size, 2, spacing), effects=(parameters("gravity", magnitude=GRAVITY),),
                 liquids=(WATER,), phase=lambda x: np.zeros(len(x)), scheme=scheme,
                 filled=lambda x: (x[:, 0] < left + DAM_WIDTH) & (x[:, 1] < bottom + 2.0 * DAM_WIDTH), **more)


def dam_front(scheme: str, particles: int, **more):
    """Return the front of the dam, x/a, at the times of the experiment, and the measured front."""
    solver = dam(scheme, particles, **more)
    left = solver.search.walls.position.to_numpy()[:, 0].min() + 2.5 * solver.spacing
    front = []
    for time, _ in DAM_FRONT[1:]:
        cavities.run(solver, time * math.sqrt(DAM_WIDTH / (2.0 * GRAVITY)))
        (position,) = cavities.read(solver, "position")
        front.append((position[:, 0].max() + 0.5 * solver.spacing - left) / DAM_WIDTH)
    return np.array(front), DAM_FRONT[1:, 1]


def full_box(scheme: str, dimension: int, names, light: Liquid = OIL):
    """Return a small full box of two liquids (and droplets) that is stirred, with the named effects all at once."""
    effects = tuple(parameters(name, **EFFECT_PARAMETERS.get(name, {})) for name in names)
    return build(cavity("box", (8e-3,) * dimension, dimension), effects=effects, phase=lambda x: x[:, 0] > 0.0,
                 liquids=(AQUEOUS, light, Liquid("droplets", light.density, light.dynamic_viscosity)), scheme=scheme,
                 velocity=lambda x: 1e-2 * np.sin(1e3 * x))


def assert_bounded(solver, largest_speed: float) -> None:
    """Four steps: every field is finite, the compression near 1 and the speeds are bounded, m/s."""
    for _ in range(4):
        solver.step()
    state = solver.snapshot()
    assert all(np.isfinite(values).all() for values in state.values())
    assert state["compression_rate"].min() > 0.9 and state["compression_rate"].max() < 1.2
    assert np.linalg.norm(state["velocity"], axis=1).max() < largest_speed


def assert_runs(solver, largest_speed: float) -> None:
    """Four steps of a full box with all effects: each of them acts, and none makes or loses liquid.

    Every field is finite, the compression near 1 and the speeds are bounded. Layers do not collide, nor leave a film.
    """
    def volumes() -> np.ndarray:
        """Volume of aqueous and of oil, with the droplets that are shed, m^d."""
        volume, fraction = cavities.read(solver, "volume", "volume_fraction")
        return volume @ fraction @ [[1.0, 0.0], [0.0, 1.0], [0.0, 1.0]]

    before = volumes()
    assert_bounded(solver, largest_speed)
    np.testing.assert_allclose(volumes(), before, rtol=1e-12)
    volume, fraction, mass = cavities.read(solver, "volume", "volume_fraction", "mass")
    assert 0.0 < volume @ fraction[:, 2] < 1e-6 * volume.sum() and fraction.min() >= 0.0
    np.testing.assert_allclose(mass, volume * (fraction @ [liquid.density for liquid in solver.liquids]), rtol=1e-12)
    assert (solver.distance.at(solver.particles.to_numpy("position")) < 0.0).all()
    assert not solver.notes  # none was left out
    for effect in solver.effects:
        if effect.name not in ("collision", "wall_film"):
            for field in effect.fields:
                assert cavities.read(solver, field.name)[0].any(), (effect.name, field.name)
