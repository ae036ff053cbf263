"""The signed distance of a cavity, as kernels see it."""
import numpy as np
import pytest

from pipeline.cavity.shapes import shape_arrays
from sim.backend import real, real_numpy, ti
from sim.signed_distance import SignedDistance

pytestmark = pytest.mark.usefixtures("anew")
SPACING = 1e-3
CLEARANCE = 0.1 * SPACING  # of the wall's stop


@ti.kernel
def look(distance: ti.template(), limit: float, x: ti.template(), value: ti.template(), near: ti.template()):
    for i in x:
        value[i] = distance.value(x[i])
        near[i] = ti.cast(distance.may_exceed(x[i], limit), ti.i32)


@pytest.mark.parametrize("kind, size, dimension", [
    ("circle", 11e-3, 2), ("sphere", 11e-3, 3), ("box", (20e-3, 10e-3), 2), ("box", (26e-3, 26e-3, 30e-3), 3)])
def test_only_points_deep_inside_are_passed_over(kind, size, dimension):
    """None that the wall would stop is, and most of the others are."""
    arrays = shape_arrays(kind, size, SPACING, dimension=dimension)
    distance = SignedDistance(arrays["sdf_values"], arrays["sdf_origin"], float(arrays["sdf_cell"]))
    n = 20000
    reach = np.abs(arrays["wall_position"]).max(axis=0)
    points = np.random.default_rng(5).uniform(-reach, reach, (n, dimension))
    x, value, near = ti.Vector.field(dimension, real(), n), ti.field(real(), n), ti.field(ti.i32, n)
    x.from_numpy(points.astype(real_numpy()))
    look(distance, -CLEARANCE, x, value, near)
    seen, found = near.to_numpy() == 1, value.to_numpy()
    assert np.all(seen[found > -CLEARANCE])
    assert np.all(found[~seen] < -SPACING)
    deep = found < -5.0 * distance.cell * dimension**0.5
    assert not np.any(seen[deep]) and np.count_nonzero(deep) > 0.02 * n
