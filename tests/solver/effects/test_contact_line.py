"""How fast a contact line can move, beside the flow in its corners solved as it stands."""
import math
from pathlib import Path

import numpy as np
import pytest
from helpers import cavities

from pipeline.advice.report import report_of
from pipeline.scenes.load import load_scene
from sim.effects.parts.contact_line import SLIP, corner_friction, fastest_retreat, turning, turning_rate

pytestmark = pytest.mark.usefixtures("taichi")
CAVITY = 5.06e-6  # m3
SCENES = Path("config/scenes")


def solutions(angle):
    """F, F', F'' and F''' of the four creeping flows r F(angle) in a corner, (4, 4)."""
    s, c = math.sin(angle), math.cos(angle)
    return np.array([[c, s, angle * c, angle * s], [-s, c, c - angle * s, s + angle * c],
                     [-c, -s, -2.0 * s - angle * c, 2.0 * c - angle * s],
                     [s, -c, -3.0 * c + angle * s, -3.0 * s - angle * c]])


def solved(angle, ratio):
    """Difference of the pressures at the interface over mu U/r: what turns it, over its capillary number.

    The wall moves with speed 1, through the first liquid's corner from 0 to `angle` and out of that of the other one;
    the interface stands, and both liquids have one speed and one shear stress there.
    """
    matrix, right = np.zeros((8, 8)), np.zeros(8)
    first, middle, last = solutions(0.0), solutions(angle), solutions(math.pi)
    matrix[0, :4], matrix[1, :4], right[1] = first[0], first[1], 1.0
    matrix[2, 4:], matrix[3, 4:], right[3] = last[0], last[1], -1.0
    matrix[4, :4] = matrix[5, 4:] = middle[0]
    matrix[6] = np.concatenate([middle[1], -middle[1]])
    matrix[7] = np.concatenate([middle[2], -ratio * middle[2]])
    flow = np.linalg.solve(matrix, right)
    return (middle[3] + middle[1]) @ (flow[:4] - ratio * flow[4:])


@pytest.mark.parametrize("angle", [0.1, math.radians(18.2), 1.0, 2.5])
@pytest.mark.parametrize("ratio", [0.0, 1e-3, 1.0, 970.0])
def test_an_interface_turns_as_creeping_flow_in_both_corners_has_it(angle, ratio):
    assert turning(angle, ratio) == pytest.approx(solved(angle, ratio), rel=1e-8)


def test_a_liquid_under_gas_leaves_a_wall_by_the_law_of_the_cube_of_its_angle():
    """angle^3/9 for small angles; 1 % allows for 30 degrees."""
    speed = fastest_retreat(math.radians(30.0), 0.07, 1e-3, 1e-9, 1e-2)
    assert speed == pytest.approx(0.07 / 1e-3 * math.radians(30.0) ** 3 / 9.0 / math.log(1e7), rel=0.01)


def test_a_thick_liquid_beside_it_holds_a_thin_one_at_the_wall():
    angle = math.radians(18.2)
    under_oil, alone = (fastest_retreat(angle, 0.04, 1e-3, other, 1e-2) for other in (0.97, 1e-3))
    assert under_oil < 0.2 * alone


def test_advice_tells_that_aqueous_under_oil_has_not_left_the_wall_when_the_scene_ends():
    report = report_of(load_scene(SCENES / "resting_eye.yaml", "draft"), CAVITY)
    time = next(one.value for one in report.times if one.name == "contact line, aqueous")
    assert time == pytest.approx(6.5, abs=0.1)  # 10.6 mm at 1.63 mm/s
    said = [one.sentence for one in report.advice if "leaves the wall" in one.sentence]
    assert len(said) == 1 and said[0].startswith("aqueous leaves the wall at 1.63 mm/s at most")


def test_liquids_without_tension_have_no_contact_line_to_tell_of():
    scene = load_scene(SCENES / "still_eye.yaml", "draft")
    assert not [one for one in report_of(scene, CAVITY).times if one.name.startswith("contact line")]


def test_the_friction_of_a_corner_is_what_its_bending_takes_of_the_pull():
    """At the speed at which the angle seen from afar is zero, and as slow as it may be."""
    angle, tension, aqueous, oil, length = math.radians(40.0), 0.04, 7e-4, 1.0, 1e-3
    speed, friction = corner_friction(angle, tension, aqueous, oil, length)
    assert np.all(np.diff(speed) > 0.0) and np.all(np.diff(friction) > 0.0)
    assert -speed[0] == pytest.approx(fastest_retreat(angle, tension, aqueous, oil, length), rel=1e-3)
    assert -friction[0] == pytest.approx(tension * (1.0 - math.cos(angle)), rel=1e-9)
    slow = 1e-4 * tension / oil
    expected = turning_rate(angle, aqueous, oil) * math.sin(angle) * math.log(length / SLIP) * slow
    assert np.interp(slow, speed, friction) == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("other", [0.0, 7e-4, 1.0])
def test_the_friction_of_a_corner_is_the_same_seen_from_either_liquid(other):
    speed, friction = corner_friction(1.0, 0.04, 1.0, other, 1e-3)
    seen, felt = corner_friction(math.pi - 1.0, 0.04, other, 1.0, 1e-3)
    np.testing.assert_allclose(speed, -seen[::-1], rtol=1e-6, atol=1e-12)
    np.testing.assert_allclose(friction, -felt[::-1], rtol=1e-6, atol=1e-12)


def friction_of_the_wall(form, *more, holds="share"):
    """Positions, m, of which liquid, and the friction of the wall on every particle, kg/s: level oil in a circle."""
    viscosity = cavities.parameters("viscosity_implicit", form=form, contact_line=holds)
    solver = cavities.build(cavities.cavity("circle", 11.0 * cavities.SPACING), effects=(viscosity, *more))
    cavities.run_in_steps(solver, 1e-7, 1e-7)
    return cavities.read(solver, "position", "phase", "wall_friction")


@pytest.mark.parametrize("form", ["central", "laplacian", "strain"])
def test_the_wall_holds_liquids_by_a_quarter_where_an_interface_with_tension_meets_it(form):
    position, phase, in_full = friction_of_the_wall(form)
    _, _, friction = friction_of_the_wall(form, cavities.parameters("interface_tension", coefficient=0.04))
    apart = np.array([np.linalg.norm(position[phase != own] - x, axis=1).min()
                      for x, own in zip(position, phase, strict=True)])
    at_wall = in_full > 0.0
    far = at_wall & (apart > 2.5 * cavities.SPACING)
    near = at_wall & (np.abs(position[:, 1]) < 0.7 * cavities.SPACING)
    assert far.sum() > 20 and near.sum() > 2
    np.testing.assert_allclose(friction[far], in_full[far], rtol=1e-9)
    if form == "strain":  # less turns along with a wall that holds less
        assert np.all(friction[near] < 0.5 * in_full[near])
    else:
        np.testing.assert_allclose(friction[near], 0.25 * in_full[near], rtol=1e-9)
    assert np.all(friction[at_wall] > 0.2499 * in_full[at_wall])


@pytest.mark.thorough
@pytest.mark.parametrize("form", ["central", "laplacian", "strain"])
def test_the_corner_holds_the_line_in_place_of_the_wall_where_it_is_asked_to(form):
    """Two lines at rest, 90 degrees; the wall lets go of the oil, and the aqueous feels the corner, within 15 %."""
    position, phase, in_full = friction_of_the_wall(form)
    _, _, friction = friction_of_the_wall(form, cavities.parameters("interface_tension", coefficient=0.04),
                                          holds="corner")
    apart = np.array([np.linalg.norm(position[phase != own] - x, axis=1).min()
                      for x, own in zip(position, phase, strict=True)])
    at_wall = in_full > 0.0
    far = at_wall & (apart > 2.5 * cavities.SPACING)
    near = at_wall & (np.abs(position[:, 1]) < 0.7 * cavities.SPACING) & (phase == 1)
    assert far.sum() > 20 and near.sum() > 1
    np.testing.assert_allclose(friction[far], in_full[far], rtol=1e-9)
    assert np.all(friction[near] < 1e-9 * in_full[near])
    aqueous, oil = cavities.AQUEOUS.dynamic_viscosity, cavities.OIL.dynamic_viscosity
    corner = turning_rate(0.5 * math.pi, aqueous, oil) * math.log(cavities.SPACING / SLIP)
    assert friction[(phase == 0) & ~far].sum() == pytest.approx(2.0 * corner, rel=0.15)
