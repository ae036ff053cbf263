"""Packing: even compression between curved walls, nothing outside, input order kept."""
import numpy as np
import pytest
from helpers import cavities
from scipy.spatial import cKDTree

from pipeline.cavity.shapes import shape_arrays
from sim.packing import pack

pytestmark = pytest.mark.usefixtures("taichi")


@pytest.fixture(scope="module", params=[(2, 10e-3), (3, 6e-3)], ids=["circle", "sphere"])
def packing(request):
    dimension, radius = request.param
    arrays = shape_arrays("circle", radius, cavities.SPACING, dimension=dimension)
    arguments = [arrays[name] for name in ("fluid_position", "fluid_volume", "wall_position", "wall_volume")]
    lattice, packed = (pack(*arguments, cavities.SPACING, 2.5, iterations) for iterations in (1, 150))
    return radius, arrays["fluid_position"], lattice[1], *packed


@pytest.mark.thorough
def test_packing_evens_the_compression(packing):
    _, _, before, _, after = packing
    # A trial had 1.005 +- 0.002 at 22 spacings; fewer particles per radius pack less evenly.
    assert after.std() < 0.01 < before.std()
    assert after.min() > 0.98 and after.max() < 1.04


@pytest.mark.thorough
def test_packed_particles_stay_inside_and_apart(packing):
    radius, _, _, position, _ = packing
    assert np.linalg.norm(position, axis=1).max() < radius - 0.1 * cavities.SPACING
    assert cKDTree(position).query(position, 2)[0][:, 1].min() > 0.8 * cavities.SPACING


@pytest.mark.thorough
def test_order_is_that_of_the_input(packing):
    _, start, _, position, _ = packing
    # Packing moves a particle by a fraction of a spacing; another particle's row would be several away.
    moved = np.linalg.norm(position - start, axis=1)
    assert np.median(moved) < 0.5 * cavities.SPACING and moved.max() < 2.0 * cavities.SPACING
    assert moved.max() > 0.01 * cavities.SPACING


@pytest.mark.thorough
def test_box_lattice_is_packed_already():
    arrays = cavities.cavity("box", (12e-3, 12e-3))
    position, compression = pack(arrays["fluid_position"], arrays["fluid_volume"], arrays["wall_position"],
                                 arrays["wall_volume"], cavities.SPACING, 2.5, 20)
    np.testing.assert_allclose(position, arrays["fluid_position"], atol=1e-9 * cavities.SPACING)
    assert np.ptp(compression) < 1e-9
