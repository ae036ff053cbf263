"""The arc of contact against geometry: a ball of oil that meets the wall of a sphere at the contact angle."""
import numpy as np
import pytest

from pipeline.cavity.shapes import shape_arrays
from pipeline.cavity.signed_distance_grid import SignedDistance
from pipeline.measures.contact_arc import contact_arc

RADIUS, SPACING = 0.011, 8e-4


@pytest.fixture(scope="module")
def sphere():
    return shape_arrays("sphere", RADIUS, SPACING, dimension=3)


@pytest.mark.parametrize("angle", [18.2, 35.0])
@pytest.mark.parametrize("size", [0.8, 0.9, 0.95])
def test_a_ball_at_the_wall_has_the_arc_of_geometry(sphere, size, angle):
    """By the labels along the wall alone the arc is 4 to 12 degrees too long."""
    ball = size * RADIUS
    center = np.sqrt(RADIUS**2 + ball**2 - 2.0 * RADIUS * ball * np.cos(np.radians(angle)))
    exact = 2.0 * np.degrees(np.arccos((RADIUS**2 + center**2 - ball**2) / (2.0 * RADIUS * center)))
    distance = SignedDistance(sphere["sdf_values"], sphere["sdf_origin"], float(sphere["sdf_cell"]))
    for up in ([0.0, 1.0, 0.0], [0.0, -0.6, 0.8]):
        oil = np.linalg.norm(sphere["fluid_position"] - center * np.array(up), axis=1) < ball
        found = contact_arc(distance, sphere["fluid_position"], oil, SPACING, np.radians(angle))
        # A steep wedge is thin over one particle only: then each end is known to half a spacing.
        assert found == pytest.approx(exact, abs=2.0 if angle < 20.0 else np.degrees(SPACING / RADIUS))
        assert contact_arc(distance, sphere["fluid_position"], oil, SPACING, None) > exact + 3.0


def test_all_none_and_nothing(sphere):
    distance = SignedDistance(sphere["sdf_values"], sphere["sdf_origin"], float(sphere["sdf_cell"]))
    position = sphere["fluid_position"]
    for oil, expected in ((np.ones(len(position), bool), 360.0), (np.zeros(len(position), bool), 0.0)):
        assert contact_arc(distance, position, oil, SPACING, 0.3) == expected
    assert contact_arc(distance, position[:0], np.zeros(0, bool), SPACING, 0.3) == 0.0
