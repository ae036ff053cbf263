"""Neighbor rows against a k-d tree."""
import numpy as np
import pytest
from helpers.cases import thorough
from scipy.spatial import cKDTree

from sim.errors import OutOfRoom
from sim.fields import Field, ParticleStore
from sim.neighbor_search import NeighborSearch, corners
from sim.smoothing_kernels import WendlandC2

pytestmark = pytest.mark.usefixtures("anew")
SPACING = 1e-3
SUPPORT = 2.5e-3
FIELDS = (Field("id", "integer", "", "input order", carried=True), Field("position", "vector", "m", "", carried=True),
          Field("volume", "scalar", "m3", "", carried=True))


def searched(fluid, walls, volume=None, head_room=1.4, periods=()):
    """Return store and search of liquid at the given positions, rows built, with walls of unequal volumes."""
    dimension = fluid.shape[1]
    particles = ParticleStore(FIELDS, len(fluid) + 10, dimension, 2)
    wall_volume = np.linspace(1.0, 2.0, len(walls)) * SPACING**dimension
    search = NeighborSearch(particles, (walls, wall_volume, np.zeros(len(walls))), WendlandC2(SUPPORT, dimension),
                            *corners(walls, periods), SPACING, head_room, periods)
    particles.count[None] = len(fluid)
    volume = np.linspace(0.5, 1.5, len(fluid)) * SPACING**dimension if volume is None else volume
    for name, values in (("id", np.arange(len(fluid))), ("position", fluid), ("volume", volume)):
        particles.from_numpy(name, values)
    search.sort()
    search.build()
    return particles, search


def listed(rows, row_names, names) -> dict:
    """Return {(row, neighbor): (weight, gradient)} with names for rows and neighbors; none may appear twice."""
    count, start, index = rows.count.to_numpy(), rows.start.to_numpy(), rows.index.to_numpy()
    weight, gradient = rows.weight.to_numpy(), rows.gradient.to_numpy()
    entries = [((row_names[i], names[index[k]]), (weight[k], gradient[k]))
               for i in range(len(row_names)) for k in range(start[i], start[i] + count[i])]
    assert len(dict(entries)) == len(entries)
    return dict(entries)


def cloud(dimension, extent, seed=3):
    """Return disordered liquid in a box and a shell of walls around it."""
    rng = np.random.default_rng(seed)
    count = int((extent / SPACING) ** dimension)
    fluid = rng.uniform(-0.5 * extent, 0.5 * extent, (count, dimension))
    # Thin the cloud: no two closer than half a spacing, as in liquid.
    tree = cKDTree(fluid)
    later = {j for i, j in tree.query_pairs(0.5 * SPACING)}
    fluid = fluid[[i for i in range(count) if i not in later]]
    walls = rng.uniform(-0.5 * extent - 2.0 * SPACING, 0.5 * extent + 2.0 * SPACING, (3 * count, dimension))
    walls = walls[np.abs(walls).max(axis=1) > 0.5 * extent][:count]
    return fluid, walls


@pytest.mark.parametrize("periods", [(8e-3, 7e-3), thorough((8e-3, 0.0)), thorough((5e-3, 6e-3, 7e-3)),
                                     thorough((0.0, 6e-3, 0.0))])
def test_rows_reach_across_the_ends_of_periodic_axes(periods):
    """Against the same cloud surrounded by copies of itself; liquid beyond an end is taken back to the other."""
    dimension, lengths = len(periods), np.array(periods)
    rng = np.random.default_rng(5)
    sides = np.where(lengths > 0.0, lengths, 6e-3)
    fluid = rng.uniform(-0.5, 0.5, (int(np.prod(sides) / SPACING**dimension), dimension)) * sides
    walls = rng.uniform(-0.5, 0.5, (40, dimension)) * sides
    walls[:, lengths == 0.0] += 6e-3
    particles, search = searched(fluid + lengths * rng.integers(-1, 2, fluid.shape), walls, head_room=4.0,
                                 periods=periods)
    images = np.stack(np.meshgrid(*[(-1, 0, 1) if length else (0,) for length in periods], indexing="ij"),
                      axis=-1).reshape(-1, dimension) * lengths
    ids = particles.to_numpy("id")
    assert np.abs(particles.to_numpy("position") - fluid[ids]).max() < 1e-15
    for rows, own, others, row_names, names in ((search.pairs, fluid, fluid, ids, ids),
                                                (search.wall_pairs, fluid, walls, ids, search.wall_order),
                                                (search.wall_rows, walls, fluid, search.wall_order, ids)):
        copies = (others[None] + images[:, None]).reshape(-1, dimension)
        near = [(i, j) for i, found in enumerate(cKDTree(copies).query_ball_point(own, SUPPORT)) for j in found
                if own is not others or np.any(copies[j] != own[i])]
        away = {(i, j % len(others)): own[i] - copies[j] for i, j in near}
        assert len(away) == len(near)
        found = listed(rows, row_names, names)
        assert set(found) == set(away)
        for pair, (weight, gradient) in found.items():
            # gradient / weight = W'/(r W) x_ij = -20/(h^2 (1 - q) (4 q + 1)) x_ij of Wendland's C2 kernel
            q = np.linalg.norm(away[pair]) / SUPPORT
            np.testing.assert_allclose(gradient * (SUPPORT**2 * (1 - q) * (4 * q + 1)), -20.0 * weight * away[pair],
                                       rtol=1e-9, atol=1e-15)


def test_short_period_is_refused():
    fluid, walls = cloud(2, 8e-3)
    with pytest.raises(ValueError, match="at least two support radii"):
        searched(fluid, walls, head_room=3.0, periods=(4e-3, 0.0))


@pytest.mark.parametrize("dimension, extent", [(2, 16e-3), thorough(3, 7e-3)])
def test_rows_equal_those_of_a_tree(dimension, extent):
    fluid, walls = cloud(dimension, extent)
    particles, search = searched(fluid, walls, head_room=3.0)
    ids = particles.to_numpy("id")
    kernel = WendlandC2(SUPPORT, dimension)
    wall_ids = search.wall_order
    for rows, own, others, row_names, names, volume in (
            (search.pairs, fluid, fluid, ids, ids, np.linspace(0.5, 1.5, len(fluid))),
            (search.wall_pairs, fluid, walls, ids, wall_ids, np.linspace(1.0, 2.0, len(walls))),
            (search.wall_rows, walls, fluid, wall_ids, ids, np.linspace(0.5, 1.5, len(fluid)))):
        found = listed(rows, row_names, names)
        same = own is others
        expected = {(i, j) for i, near in enumerate(cKDTree(others).query_ball_point(own, SUPPORT)) for j in near
                    if not (same and i == j)}
        assert len(expected) > len(own) and set(found) == expected
        pairs = np.array(sorted(expected))
        away = own[pairs[:, 0]] - others[pairs[:, 1]]
        q = np.linalg.norm(away, axis=1) / SUPPORT
        weight = volume[pairs[:, 1]] * SPACING**dimension * kernel.at_zero
        np.testing.assert_allclose([found[tuple(p)][0] for p in pairs], weight * (1 - q) ** 4 * (4 * q + 1),
                                   rtol=1e-10, atol=1e-14)
        np.testing.assert_allclose(np.array([found[tuple(p)][1] for p in pairs]),
                                   (-20.0 * weight / SUPPORT**2 * (1 - q) ** 3)[:, None] * away, rtol=1e-10, atol=1e-12)


@pytest.mark.thorough
def test_order_of_the_particles_does_not_matter():
    fluid, walls = cloud(2, 12e-3)
    volume = np.linspace(0.5, 1.5, len(fluid)) * SPACING**2
    shuffle = np.random.default_rng(0).permutation(len(fluid))
    particles, search = searched(fluid, walls, volume, head_room=3.0)
    shuffled, other = searched(fluid[shuffle], walls, volume[shuffle], head_room=3.0)
    ids, other_ids = particles.to_numpy("id"), shuffle[shuffled.to_numpy("id")]
    for a, b in ((listed(search.pairs, ids, ids), listed(other.pairs, other_ids, other_ids)),
                 (listed(search.wall_pairs, ids, search.wall_order), listed(other.wall_pairs, other_ids,
                                                                            other.wall_order))):
        assert a.keys() == b.keys()
        for pair in a:
            # What is left over of a row behind whole vectors is done one by one: AMD EPYC rounds that otherwise, by two
            # units in the last place at most; all other entries have the same bits.
            for one, other in zip(a[pair], b[pair], strict=True):
                np.testing.assert_array_max_ulp(one, other, maxulp=2)


@pytest.mark.thorough
def test_sort_keeps_every_particle_whole_and_neighbors_close_in_memory():
    fluid, walls = cloud(2, 12e-3)
    particles, search = searched(fluid, walls, head_room=3.0)
    ids = particles.to_numpy("id")
    np.testing.assert_array_equal(np.sort(ids), np.arange(len(fluid)))
    np.testing.assert_array_equal(particles.to_numpy("position"), fluid[ids])
    np.testing.assert_array_equal(particles.to_numpy("volume"),
                                  (np.linspace(0.5, 1.5, len(fluid)) * SPACING**2)[ids])
    cell = np.floor((fluid[ids] - search.origin_numpy) / search.cell).astype(int) @ np.array(search.strides)
    assert (np.diff(cell) >= 0).all()


@pytest.mark.thorough
def test_particles_that_left_the_grid_still_find_each_other():
    fluid, walls = cloud(2, 8e-3)
    lost = np.array([[0.5, 0.5], [0.5005, 0.5], [0.5, -0.5]])
    particles, search = searched(np.vstack([fluid, lost]), walls, head_room=3.0)
    ids = particles.to_numpy("id")
    found = {pair for pair in listed(search.pairs, ids, ids) if max(pair) >= len(fluid)}
    first = len(fluid)
    assert found == {(first, first + 1), (first + 1, first)}


@pytest.mark.thorough
def test_rows_have_no_gaps_and_know_who_has_neighbors():
    fluid, walls = cloud(2, 12e-3)
    _, search = searched(fluid, walls, head_room=3.0)
    for rows, n in ((search.pairs, len(fluid)), (search.wall_pairs, len(fluid)), (search.wall_rows, len(walls))):
        count, start = rows.count.to_numpy()[:n], rows.start.to_numpy()[:n]
        # Pairs at the very rim of the support radius are counted with some slack.
        gaps = np.diff([*start, rows.needed[None]]) - count
        assert (gaps >= 0).all() and gaps.sum() <= 1e-3 * count.sum()
        members = rows.member.to_numpy()[:rows.member_count[None]]
        assert (np.diff(members) > 0).all() and set(np.flatnonzero(count)) <= set(members)


@pytest.mark.thorough
@pytest.mark.parametrize("which", ["pairs", "wall_pairs", "wall_rows"])
def test_more_neighbors_than_fit_are_refused_before_any_is_written(which):
    fluid, walls = cloud(2, 8e-3)
    crowd = np.random.default_rng(1).normal(scale=0.1 * SPACING, size=(120, 2))
    edge = np.array([4.5e-3, 0.0])
    if which == "pairs":
        fluid = np.vstack([fluid, crowd])
    else:
        fluid, walls = np.vstack([fluid, crowd + edge - [0.6e-3, 0.0]]), np.vstack([walls, crowd + edge])
    with pytest.raises(OutOfRoom, match=r"there are \d+ pairs .* where \d+ fit: particles pile up"):
        searched(fluid, walls, head_room=1.0 if which == "pairs" else 5.0)


def test_sort_does_not_depend_on_what_was_before():
    fluid, walls = cloud(2, 12e-3)
    particles, search = searched(fluid, walls, head_room=3.0)
    sorted_ids = particles.to_numpy("id")
    shuffle = np.random.default_rng(1).permutation(len(fluid))
    for name in ("id", "position", "volume"):
        particles.from_numpy(name, particles.to_numpy(name)[shuffle])
    search.sort()
    np.testing.assert_array_equal(particles.to_numpy("id"), sorted_ids)
