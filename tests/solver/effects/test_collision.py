"""The convex hull on the device against Qhull, and what colliding liquids keep."""
import dataclasses
from pathlib import Path

import numpy as np
import pytest
from helpers import cavities
from scipy.spatial import ConvexHull as Qhull
from scipy.spatial import QhullError, cKDTree

from pipeline.base.errors import UserError
from pipeline.cavity.blocks import contains
from pipeline.cavity.container import block_lattices, container_arrays
from pipeline.cavity.signed_distance_grid import SignedDistance
from pipeline.scenes.load import load_scene
from sim.backend import data_oriented, ti
from sim.effects.parts.convex_hull import INSIDE, OPEN, ConvexHull
from sim.neighbor_rows import NeighborRows
from sim.settings import Liquid

pytestmark = pytest.mark.usefixtures("taichi")
LIGHT, HEAVY = Liquid("light", 1000.0, 0.0), Liquid("heavy", 10000.0, 0.0)
SETS = 1200
ROUND_OFF = 1e-8  # of the size of a set: a hundred times the tolerance of the device


# The hull.

@ti.func
def separation(x, y):
    return x - y


@data_oriented
class Probe:
    """Points, each with a set of neighbors of its own."""

    def __init__(self, points: np.ndarray, sets: list[np.ndarray]):
        self.number, dimension = points.shape
        sizes = np.array([len(each) for each in sets])
        self.rows = NeighborRows(self.number, int(sizes.sum()), dimension)
        position = np.concatenate([points, *sets])
        self.position = ti.Vector.field(dimension, ti.f64, shape=len(position))
        self.group = ti.field(ti.i32, shape=len(position))
        self.position.from_numpy(position)
        self.group.from_numpy(np.r_[np.zeros(self.number), np.ones(sizes.sum())].astype(np.int32))
        self.rows.index.from_numpy(self.number + np.arange(sizes.sum(), dtype=np.int32))
        self.rows.count.from_numpy(sizes.astype(np.int32))
        self.rows.start.from_numpy((np.cumsum(sizes) - sizes).astype(np.int32))
        self.direction = ti.Vector.field(dimension, ti.f64, shape=self.number)
        self.answer = ti.field(ti.i32, shape=self.number)
        self.distance = ti.field(ti.f64, shape=self.number)
        self.hull = ConvexHull(self.position, self.group, self.rows, separation, 1.0)

    @ti.kernel
    def ask(self):
        for i in range(self.number):
            self.answer[i] = self.hull.verdict(i, 1)
            if self.answer[i] == INSIDE:
                self.distance[i] = self.hull.exit_distance(i, 1, self.direction[i])


def make_set(kind: int, size: int, dimension: int, rng) -> np.ndarray:
    """Return a set of points of one of eight kinds, most of them degenerate or nearly so."""
    points = rng.normal(size=(size, dimension))
    if kind == 1:    # on a lattice: many in one plane
        points = np.round(2.0 * points) / 2.0
    elif kind == 2:  # a slab
        points[:, -1] *= 1e-3
    elif kind == 3:  # a plane, in 2D a line
        points[:, -1] = 0.0
    elif kind == 4:  # on a sphere: every point is a vertex
        points /= np.linalg.norm(points, axis=1)[:, None]
    elif kind == 5:  # every point three times
        points = np.repeat(points[: max(1, size // 3)], 3, axis=0)
    elif kind == 6:  # around a corner
        points = np.abs(points)
    elif kind == 7:  # a needle
        points = rng.normal(size=(size, 1)) * rng.normal(size=dimension) + 1e-4 * points
    return points


def make_point(way: int, points: np.ndarray, rng) -> np.ndarray:
    """Return a point within a set, anywhere, at the origin, or a millionth away from a vertex."""
    within = rng.dirichlet(np.ones(len(points))) @ points
    if way == 1:
        return within + 0.3 * rng.normal(size=points.shape[1])
    if way == 2:
        return np.zeros(points.shape[1])
    if way == 3:
        return points[0] + rng.choice([-1e-6, 1e-6]) * (points.mean(axis=0) - points[0])
    return within


def facets(points: np.ndarray) -> np.ndarray:
    """Return normals and offsets of the hull by Qhull; a facet that nothing is behind, for a set without volume."""
    try:
        return Qhull(points).equations
    except QhullError:
        return np.r_[np.zeros(points.shape[1]), 1.0][None]


@pytest.mark.thorough
@pytest.mark.parametrize("dimension", [2, 3])
def test_hull_agrees_with_qhull(dimension):
    rng = np.random.default_rng(dimension)
    sets = [make_set(n % 8, rng.integers(dimension + 1, 66), dimension, rng) for n in range(SETS)]
    points = np.array([make_point(rng.integers(4), each, rng) for each in sets])
    direction = rng.normal(size=points.shape)
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    probe = Probe(points, sets)
    probe.direction.from_numpy(direction)
    probe.ask()
    answer, distance = probe.answer.to_numpy(), probe.distance.to_numpy()
    hulls = [facets(each) for each in sets]
    depth = np.array([-(h[:, :-1] @ x + h[:, -1]).max() for h, x in zip(hulls, points, strict=True)])
    assert 0.3 * SETS < (answer == INSIDE).sum() < 0.8 * SETS
    assert not (answer == OPEN).any()
    wrong = (answer == INSIDE) != (depth > 0.0)
    assert np.abs(depth[wrong]).max(initial=0.0) < ROUND_OFF
    for n in np.flatnonzero((answer == INSIDE) & (depth > ROUND_OFF)):
        normal, offset = hulls[n][:, :-1], hulls[n][:, -1]
        speed, gap = normal @ direction[n], -(normal @ points[n] + offset)
        assert distance[n] == pytest.approx((gap / np.where(speed > 0.0, speed, 1e-300)).min(), abs=ROUND_OFF)


@pytest.mark.thorough
def test_hull_of_too_few_points_is_empty():
    probe = Probe(np.array([[0.0, 0.1], [0.2, 0.2]]), [np.array([[0.0, 0.0], [0.0, 1.0]]), np.zeros((0, 2))])
    probe.ask()
    assert not (probe.answer.to_numpy() == INSIDE).any()


# The response.

@pytest.fixture(scope="module")
def mixed(taichi, circle):
    """Return a solver whose liquids are to collide."""
    return cavities.build(circle, effects=(cavities.parameters("collision"),), liquids=(LIGHT, HEAVY))


def stir(solver, share: float, seed: int = 1):
    """Set particles of unequal mass, heavy ones on the right and, by a share, anywhere; both sides approach."""
    rng, count = np.random.default_rng(seed), solver.count[None]
    (x,) = cavities.read(solver, "position")
    heavy = (x[:, 0] > 0.0) ^ (rng.random(count) < share)
    position = x + 0.1 * cavities.SPACING * rng.normal(size=x.shape)
    mass = np.where(heavy, 1e4, 1e3) * solver.rest_volume * rng.uniform(0.8, 1.2, count)
    velocity = rng.normal(size=x.shape) - np.where(heavy, 1.0, -1.0)[:, None] * [1.0, 0.0]
    for name, values in (("position", position), ("phase", heavy.astype(np.int32)), ("mass", mass),
                         ("velocity", velocity)):
        solver.particles.from_numpy(name, values)
    solver.search.sort()
    solver.search.build()
    solver.scheme.measure()


def collide(solver, **changes):
    """Let the liquids collide once with changed parameters; return mass, position and velocity, before and after."""
    effect = next(effect for effect in solver.effects if effect.name == "collision")
    before = cavities.read(solver, "mass", "position", "velocity")
    effect.parameters = dataclasses.replace(effect.parameters, **changes)
    effect.finish(1e-3)
    return before, cavities.read(solver, "mass", "position", "velocity")


@pytest.mark.parametrize("order", ["alternating", "simultaneous"])
@pytest.mark.parametrize("share", [0.05, 0.5])
def test_collision_keeps_momentum_and_gains_no_energy(mixed, circle, order, share):
    mixed.particles.from_numpy("position", circle["fluid_position"])
    stir(mixed, share)
    (mass, position, before), (_, moved, after) = collide(mixed, order=order)
    scale = mass @ np.linalg.norm(before, axis=1)
    assert np.abs(after - before).max() > 0.1
    assert np.abs(mass @ (after - before)).max() < 1e-12 * scale
    energy = [mass @ (v**2).sum(axis=1) for v in (before, after)]
    assert energy[1] < energy[0]
    move = np.linalg.norm(moved - position, axis=1)
    assert 0.0 < move.max() < 1.01 * cavities.SPACING  # two halves of a spacing at most: out, and giving way
    away = np.linalg.norm(position, axis=1) < 7e-3     # the wall stops others, and takes from the center of mass
    if move[~away].max() == 0.0:
        assert np.abs(mass @ (moved - position)).max() < 1e-12 * mass @ move


def test_single_particle_collides_as_in_the_paper(mixed, circle):
    """Its velocity becomes ((m_i - m_j) v_i + 2 m_j v_j)/(m_i + m_j), m_j and v_j weighted means of its neighbors."""
    mixed.particles.from_numpy("position", circle["fluid_position"])
    stir(mixed, 0.0)
    (x,) = cavities.read(mixed, "position")
    one = int(np.argmin(np.linalg.norm(x - [0.4 * cavities.RADIUS, 0.0], axis=1)))
    heavy, velocity = np.ones(len(x)), np.zeros_like(x)
    heavy[one] = 0.0
    mixed.particles.from_numpy("phase", heavy.astype(np.int32))
    mixed.particles.from_numpy("mass", mixed.rest_volume * np.where(heavy, 1e4, 1e3))
    distance = np.linalg.norm(x - x[one], axis=1)
    for sign in (-1.0, 1.0):  # the surroundings are nearly even: of two opposite velocities one approaches
        velocity[one] = (sign, 0.0)
        mixed.particles.from_numpy("position", x)
        mixed.particles.from_numpy("velocity", velocity)
        _, (_, _, after) = collide(mixed, order="simultaneous")
        if after[one, 0] != sign:
            break
    np.testing.assert_allclose(after[one], velocity[one] * (1e3 - 1e4) / (1e3 + 1e4), atol=1e-12)
    hit = np.abs(after).max(axis=1) > 0.0
    assert hit[distance < 2.0 * cavities.SPACING].all()
    assert not hit[distance > 2.5 * cavities.SPACING].any()


def test_result_depends_on_no_order(mixed, circle):
    """Particles stored in another order get the same, to the round-off of their sums."""
    mixed.particles.from_numpy("position", circle["fluid_position"])
    stir(mixed, 0.3)
    names = ("id", "phase", "mass", "position", "velocity")
    start = {name: mixed.particles.to_numpy(name) for name in names}
    results = []
    for seed in range(2):
        shuffled = np.random.default_rng(seed).permutation(len(start["id"]))
        for name, values in start.items():
            mixed.particles.from_numpy(name, values[shuffled])
        mixed.search.sort()
        mixed.search.build()
        stored = mixed.particles.to_numpy("id")
        _, (_, x, v) = collide(mixed, order="simultaneous")
        results.append(np.c_[x / cavities.SPACING, v][np.argsort(stored)])
    np.testing.assert_allclose(*results, rtol=0.0, atol=1e-9)


# Scenes.

ROOT = Path(__file__).parents[3]
SCENE = """
container:
  size: [0.2 m, 0.1 m, 0.1 m]
liquids: {red_gel: {}, blue_gel: {}}
blocks:
  - {liquid: red_gel, shape: ball, lower: [0.02 m, 0.02 m, 0.02 m], upper: [0.08 m, 0.08 m, 0.08 m]}
  - {liquid: blue_gel, shape: cylinder_x, lower: [0.12 m, 0.02 m, 0.02 m], upper: [0.16 m, 0.08 m, 0.08 m]}
effects: {collision: {}}
numerics: {particle_spacing: 4 mm}
output: {duration: 0.1 s}
"""


@pytest.fixture
def scene(tmp_path):
    """Return a function that reads the scene above with other text in it."""
    def read(old: str = "", new: str = ""):
        path = tmp_path / "case.yaml"
        path.write_text(SCENE.replace(old, new) if old else SCENE)
        return load_scene(path, "draft", ROOT / "config")
    return read


def test_round_blocks_hold_what_their_shapes_do(scene):
    """Lattices of 15 x 15 points cut to a ball or a disc are 3 % off its volume at most."""
    found = scene()
    assert not found.closed
    for block, (points, each) in zip(found.blocks, block_lattices(found.blocks, 4e-3), strict=True):
        assert len(points) * each == pytest.approx(block.volume, rel=0.03)
        assert contains(block, points).all()


def test_block_that_replaces_leaves_no_gap_and_no_overlap(scene):
    yolk = ", shape: ball, lower: [0.036 m, 0.036 m, 0.036 m], upper: [0.064 m, 0.064 m, 0.064 m], replaces: true}"
    found = scene("effects:", f"  - {{liquid: blue_gel{yolk}\neffects:")
    lattices = block_lattices(found.blocks, 4e-3)
    points = np.concatenate([lattices[0][0], lattices[2][0]])
    assert len(points) == len(block_lattices(scene().blocks, 4e-3)[0][0])
    assert cKDTree(points).query(points, k=2)[0][:, 1].min() > 3.9e-3


def test_funnel_is_solid(scene):
    """Its wall particles lie in it, the signed distance knows it, and liquid cannot start in it."""
    funnel = ("size: [0.2 m, 0.1 m, 0.1 m]\n  funnels:\n    - {center: [0.1 m, 0.02 m, 0.05 m], lower_radius: 0.01 m, "
              "upper_radius: UPPER, height: 0.05 m, thickness: 0.01 m}")
    old = "size: [0.2 m, 0.1 m, 0.1 m]"
    arrays = container_arrays(scene(old, funnel.replace("UPPER", "0.012 m")))
    middle = np.array([[0.11, 0.045, 0.05], [0.1, 0.045, 0.05]])
    distance = SignedDistance(arrays["sdf_values"], arrays["sdf_origin"], float(arrays["sdf_cell"])).sample(middle)
    assert distance == pytest.approx([0.005, -0.006], abs=1e-3)
    inside = (np.abs(arrays["wall_position"] - [0.1, 0.05, 0.05]) < [0.09, 0.045, 0.045]).all(axis=1)
    assert inside.sum() * 6.4e-8 == pytest.approx(2.0 * np.pi * 0.011 * 0.05 * 0.01, rel=0.35)  # and its round rims
    with pytest.raises(UserError, match=r"blocks\[0\] reaches into a funnel"):
        container_arrays(scene(old, funnel.replace("UPPER", "0.05 m")))
    with pytest.raises(UserError, match=r"thickness is 0\.004 m, but must be at least 0\.008 m"):
        scene(old, funnel.replace("UPPER", "0.012 m").replace("thickness: 0.01 m", "thickness: 0.004 m"))


@pytest.mark.parametrize(("old", "new", "message"), [
    ("red_gel: {}, ", "", "needs two liquids at least"),
    ("collision: {}", "collision: {}, diffusion: {coefficient: 1e-6}",
     "collision cannot be used together with diffusion: one mixes the liquids, the other keeps them apart"),
    ("collision: {}", "collision: {restitution: 2}", "restitution is 2, but must be at least 0 and at most 1"),
    ("collision: {}", "viscoelastic: {liquids: []}", "viscoelastic.liquids is empty, but must name one liquid"),
    ("collision: {}", "viscoelastic: {liquids: [{liquid: yolk, shear_modulus: 1 Pa}]}", "must be one of red_gel"),
    ("collision: {}", "viscoelastic: {liquids: [{liquid: red_gel, shear_modulus: 1 Pa}, {liquid: red_gel, "
     "shear_modulus: 2 Pa}]}", r"liquids\[1\] describes red_gel again; remove one of the two"),
    ("shape: ball, ", "shape: ball, replaces: true, ", "replaces is true, but no block comes before it"),
])
def test_scene_is_refused_in_one_sentence(scene, old, new, message):
    with pytest.raises(UserError, match=message) as caught:
        scene(old, new)
    if "red_gel: {}, " not in old:  # without the liquid its block is refused as well
        assert len(caught.value.messages) == 1


def test_stiff_liquid_refuses_a_long_fixed_step(scene):
    with pytest.raises(UserError, match=r"must be at most 3.79e-05 s because of effects.viscoelastic"):
        scene("effects: {collision: {}}\nnumerics: {particle_spacing: 4 mm}",
              "effects: {viscoelastic: {liquids: [{liquid: red_gel, shear_modulus: 1 MPa}]}}\n"
              "numerics: {particle_spacing: 4 mm, time_step: 1 ms}")


@pytest.mark.parametrize("order", ["alternating", "simultaneous"])
def test_moves_out_of_the_other_liquid_keep_the_center_of_mass(mixed, circle, order):
    """Away from the wall, which stops particles."""
    mixed.particles.from_numpy("position", circle["fluid_position"])
    stir(mixed, 0.0)
    (position,) = cavities.read(mixed, "position")
    radius, intruder = np.linalg.norm(position, axis=1), np.random.default_rng(4).random(len(position)) < 0.2
    heavy = (radius < 4e-3) ^ ((radius < 5e-3) & intruder)
    mixed.particles.from_numpy("phase", heavy.astype(np.int32))
    mixed.particles.from_numpy("mass", mixed.rest_volume * np.where(heavy, 1e4, 1e3))
    (mass, _, _), (_, moved, _) = collide(mixed, order=order)
    move = np.linalg.norm(moved - position, axis=1)
    assert move.max() > 0.05 * cavities.SPACING and move[radius > 8e-3].max() == 0.0
    assert np.abs(mass @ (moved - position)).max() < 1e-12 * mass @ move
