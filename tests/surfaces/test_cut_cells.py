"""Cells cut along the wall: closed whatever the fields, and exact where these are flat."""
import numpy as np
import pytest
from helpers.closed_meshes import assert_closed
from helpers.synthetic_frames import RADIUS, ball

from pipeline.surfaces.bricks import Bricks, spline_range
from pipeline.surfaces.cavity_cut import CavityCut
from pipeline.surfaces.cavity_grid import CavityGrid
from pipeline.surfaces.contour import away_from_zero

NORMAL = np.array([0.6, 0.48, 0.64])


@pytest.fixture(scope="module", params=[0.25, 0.5, 1.0])
def grid(request):
    return CavityGrid(ball(), request.param, 1.0)


def cut(grid, level):
    """Cut the cavity where a function of indices (n, 3) and places (n, 3) in m is zero."""
    inner = np.zeros(grid.shape, bool)
    inner[1:-1, 1:-1, 1:-1] = True
    bricks = Bricks(inner, grid.split)
    fine = bricks.fine_indices(np.arange(len(bricks.corner) * grid.split**3))
    values = away_from_zero(level(fine, grid.origin + grid.cell * fine)).astype(np.float32)
    crossed = np.arange(bricks.count)
    return CavityCut(grid, bricks, crossed, bricks.nodes(crossed), values, np.zeros(grid.shape, bool))


@pytest.mark.thorough_cases("0.25", "0.5")
def test_noise_is_cut_into_two_closed_parts(grid):
    """Cells with every pattern of signs of the level, bodies and hollows at the wall."""
    random = np.random.default_rng(0)
    values = random.normal(size=[n + grid.split for n in grid.fine_shape])
    parts = cut(grid, lambda fine, _: values[tuple(fine.T)])
    meshes = [parts.mesh(), parts.mesh(other=True)]
    for other, mesh in enumerate(meshes):
        assert mesh.is_closed() and len(mesh.component_volumes()) > 3
        assert mesh.volume == pytest.approx(parts.volume(other=bool(other)), rel=1e-9)
        assert grid.depth_at(mesh.vertices).min() > -0.05
    assert sum(mesh.volume for mesh in meshes) == pytest.approx(grid.cavity_volume, rel=2e-3)


@pytest.mark.thorough_cases("0.25--0.006")
@pytest.mark.parametrize("height", [-6e-3, 0.3e-3, 8e-3])
def test_a_plane_cuts_off_a_cap(grid, height):
    parts = cut(grid, lambda _, places: places @ NORMAL / 1e-3 - height / 1e-3)
    cap = RADIUS - height
    exact = np.pi * cap**2 * (3.0 * RADIUS - cap) / 3.0
    whole = 4.0 / 3.0 * np.pi * RADIUS**3
    for mesh, volume in ((parts.mesh(), exact), (parts.mesh(other=True), whole - exact)):
        assert_closed(mesh)
        assert mesh.volume == pytest.approx(volume, abs=2e-3 * whole)
    # The contact line lies on the plane and on the wall, to the curvature of a cell.
    rim = mesh.vertices[(np.abs(mesh.vertices @ NORMAL - height) < 1e-6 * RADIUS)
                        & (np.abs(grid.depth_at(mesh.vertices)) < 0.02)]
    along = np.linalg.norm(rim - np.outer(rim @ NORMAL, NORMAL), axis=1)
    outer = along[along > 0.5 * np.sqrt(RADIUS**2 - height**2)]
    assert len(outer) > 20
    np.testing.assert_allclose(outer, np.sqrt(RADIUS**2 - height**2), atol=0.25 * grid.cell)


def test_a_ball_within_the_cavity_is_round(grid):
    radius = 5e-3
    mesh = cut(grid, lambda _, places: (radius - np.linalg.norm(places - 1e-3, axis=1)) / 1e-3).mesh()
    assert_closed(mesh)
    np.testing.assert_allclose(np.linalg.norm(mesh.vertices - 1e-3, axis=1), radius, atol=0.2 * grid.cell**2 / radius)
    assert mesh.volume == pytest.approx(4.0 / 3.0 * np.pi * radius**3, rel=2.0 * (grid.cell / radius) ** 2)


def test_both_sides_have_their_interface_in_common_to_the_last_bit(grid):
    parts = cut(grid, lambda _, places: (5e-3 - np.linalg.norm(places - [0.0, 0.0, 8e-3], axis=1)) / 1e-3)
    corners = []
    for mesh in (parts.mesh(), parts.mesh(other=True)):
        deep = (grid.depth_at(mesh.vertices) > 0.1)[mesh.triangles].any(axis=1)
        assert deep.sum() > 50
        places = mesh.vertices[mesh.triangles[deep]].reshape(-1, 9)
        corners.append({tuple(np.sort(one.reshape(3, 3), axis=0).ravel()) for one in places})
    assert corners[0] == corners[1]


def test_a_spline_is_between_its_coefficients():
    coefficients = np.random.default_rng(0).normal(size=(9, 10, 11)).astype(np.float32)
    low, high = spline_range(coefficients)
    inner = np.zeros(coefficients.shape, bool)
    inner[2:-3, 2:-3, 2:-3] = True
    bricks = Bricks(inner, 3)
    values = bricks.sample(coefficients)[bricks.nodes(np.arange(bricks.count))]
    corner = tuple(bricks.corner[:bricks.count].T)
    assert (values >= low[corner] - 1e-6).all() and (values <= high[corner] + 1e-6).all()
