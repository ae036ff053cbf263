"""The convex hull on the device against Qhull, and what colliding liquids keep."""
import dataclasses

import cavities
import numpy as np
import pytest
import taichi as ti
from scipy.spatial import ConvexHull as Qhull
from scipy.spatial import QhullError

from sim.convex_hull import INSIDE, OPEN, ConvexHull
from sim.neighbor_search import Rows
from sim.settings import Liquid

pytestmark = pytest.mark.usefixtures("taichi")
LIGHT, HEAVY = Liquid("light", 1000.0, 0.0), Liquid("heavy", 10000.0, 0.0)
SETS = 1200
ROUND_OFF = 1e-8  # of the size of a set: a hundred times the tolerance of the device


# The hull.

@ti.func
def separation(x, y):
    return x - y


@ti.data_oriented
class Probe:
    """Points, each with a set of neighbors of its own."""

    def __init__(self, points: np.ndarray, sets: list[np.ndarray]):
        self.number, dimension = points.shape
        sizes = np.array([len(each) for each in sets])
        self.rows = Rows(self.number, int(sizes.max()), dimension)
        index = np.zeros((self.number, self.rows.width), dtype=np.int32)
        for row, size, start in zip(index, sizes, self.number + np.cumsum(sizes) - sizes, strict=True):
            row[:size] = start + np.arange(size)
        position = np.concatenate([points, *sets])
        self.position = ti.Vector.field(dimension, ti.f64, shape=len(position))
        self.group = ti.field(ti.i32, shape=len(position))
        self.position.from_numpy(position)
        self.group.from_numpy(np.r_[np.zeros(self.number), np.ones(sizes.sum())].astype(np.int32))
        self.rows.index.from_numpy(index.ravel())
        self.rows.count.from_numpy(sizes.astype(np.int32))
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
