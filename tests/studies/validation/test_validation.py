"""Short versions of the study `validation`, and what its references and the coupling study's numbers rest on."""
import math
from types import SimpleNamespace

import numpy as np
import pytest
import pyvista
from helpers.cases import thorough
from scipy.spatial import cKDTree

from pipeline.measures.isolation import isolated
from sim.effects.parts.contact_line import fastest_retreat
from studies.papers import coupling, oil_shape
from studies.validation import (
    capillary_rise,
    capillary_wave,
    channel,
    contact_line,
    creeping_drop,
    dam_break,
    drop_on_wall,
    hydrostatics,
    laplace,
    oscillating_drop,
    rising_bubble,
    spin_down,
    still_tank,
    taylor_green,
)
from studies.validation.kit.tank import cavity
from studies.validation.kit.young_laplace import oil_at_rest


def values(outcome, quantity):
    """Return the values of a quantity, coarse to fine."""
    return [row.value for row in outcome.rows if row.quantity == quantity]


def rows_that_fail(outcome, *but):
    """Return the quantities of rows that do not hold, less those named."""
    return {row.quantity for row in outcome.rows if row.holds is False} - set(but)


# References

def test_pressure_of_two_layers_is_continuous_and_zero_at_the_top():
    height = np.array([-0.5, 0.0, 0.5])
    np.testing.assert_allclose(hydrostatics.exact_pressure(0.5, height), [0.75, 0.25, 0.0])


def test_vortex_repeats_itself_and_has_no_divergence():
    step, inside = 1e-5, np.random.default_rng(0).uniform(-0.4, 0.4, (50, 2))
    for axis in (0, 1):
        np.testing.assert_allclose(taylor_green.vortex(inside + taylor_green.PERIOD * np.eye(2)[axis]),
                                   taylor_green.vortex(inside), atol=1e-12)
    along = [(taylor_green.vortex(inside + shift) - taylor_green.vortex(inside - shift)) / (2.0 * step)
             for shift in step * np.eye(2)]
    np.testing.assert_allclose(along[0][:, 0] + along[1][:, 1], 0.0, atol=1e-8)


@pytest.mark.parametrize("ratio", [1.0, 1400.0])
def test_velocity_of_two_layers_sticks_to_the_walls_and_has_one_stress(ratio):
    np.testing.assert_allclose(channel.exact_velocity(ratio, np.array([-1.0, 1.0])), 0.0, atol=1e-15)
    step, height = 1e-3, np.array([-0.9, -0.1, -1e-3, 1e-3, 0.1, 0.9])
    slope = (channel.exact_velocity(ratio, height + 0.99 * step)
             - channel.exact_velocity(ratio, height - 0.99 * step)) / (1.98 * step)
    stress = np.where(height < 0.0, ratio, 1.0) * slope
    np.testing.assert_allclose(np.diff(stress), -np.diff(height), rtol=1e-6)  # of a unit force, across the middle too


def test_spin_of_a_solid_body_decays_as_its_first_mode():
    assert spin_down.exact_spin(np.array(0.0)) == pytest.approx(1.0)
    late = spin_down.exact_spin(np.array([4.0, 5.0]))
    assert np.log(late[0] / late[1]) == pytest.approx(1.0, abs=1e-3)
    assert spin_down.decay_rate(1.0) == pytest.approx(14.68, abs=0.01)


def test_experimental_front_is_inside_its_own_band_at_its_own_speed():
    tau, front = dam_break.WIDE.T
    assert dam_break.outside_band(tau, front) == 0.0
    assert dam_break.outside_band(tau, 1.2 * front) == pytest.approx(0.05)
    row = np.column_stack([np.arange(5.0), np.zeros(5)])
    assert dam_break.water_front(np.append(row, [[9.0, 0.0], [9.5, 0.0]], axis=0), 1.0) == 3.0  # a pair is spray
    # The literature list gives "about 1.7" for tau > 5.
    assert dam_break.front_speed(tau, front, dam_break.STEADY) == pytest.approx(1.7, abs=0.02)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("angle", [30.0, 90.0, 150.0])
def test_drop_on_a_wall_has_its_volume_and_its_angle(dimension, angle):
    """Slices of the exact shape add up to the volume, and it meets the wall at the angle."""
    radius, height, base = drop_on_wall.shape(np.radians(angle), 2.0, dimension)
    y = np.linspace(0.0, height, 200001)
    width = np.sqrt(np.maximum(radius**2 - (y - height + radius) ** 2, 0.0))
    assert np.trapezoid({2: 2.0 * width, 3: np.pi * width**2}[dimension], y) == pytest.approx(2.0, rel=1e-5)
    assert width[0] == pytest.approx(base, rel=1e-6)
    assert np.degrees(np.arctan2(base, radius - height)) == pytest.approx(angle)


@pytest.mark.slow
@pytest.mark.usefixtures("anew")
@pytest.mark.parametrize("angle", [60.0, 120.0])
def test_drop_on_a_wall_takes_its_angle(angle):
    """With 6 particles along the radius, where the study has 12: a degree and a half per tenth of a spacing."""
    outcome = drop_on_wall.run(drop_on_wall.Parameters(contact_angle=angle, resolutions=(6,), rest_times=12.0))
    assert values(outcome, "contact angle")[0] == pytest.approx(angle, abs=6.0)


@pytest.mark.slow
@pytest.mark.usefixtures("anew")
def test_square_drop_becomes_round():
    outcome = laplace.run(laplace.Parameters(start="square", radius=0.004, resolutions=(6,)))
    assert values(outcome, "scatter of the radii of the interface / mean")[0] < laplace.ROUND
    assert next(row for row in outcome.rows if row.quantity == "pressure jump").error < 0.05


def lattice(shear, scheme="volume_incompressible"):
    """Return scene and frame of a lattice of two equal layers in a unit box that is sheared as v = (shear y, 0)."""
    axis = (np.arange(40) + 0.5) / 40
    position = np.stack(np.meshgrid(axis, axis, indexing="ij"), axis=-1).reshape(-1, 2)
    velocity = np.zeros((1600, 3))
    velocity[:, 0] = shear * position[:, 1]
    liquids = [SimpleNamespace(density=density, dynamic_viscosity=2.0) for density in (500.0, 1000.0)]
    scene = SimpleNamespace(liquids=liquids, effects={"viscosity": None}, container=SimpleNamespace(size=(1.0, 1.0)),
                            numerics=SimpleNamespace(scheme=scheme, kernel="wendland_c2", support_ratio=4.0))
    frame = SimpleNamespace(position=position, velocity=velocity, volume=np.full(1600, 1.0 / 1600), dimension=2,
                            phase=(position[:, 1] < 0.5).astype(int), particle_spacing=1.0 / 40,
                            gravity=np.array([0.0, -10.0, 0.0]))
    return scene, frame


def test_viscous_power_is_that_of_a_sheared_liquid():
    scene, frame = lattice(shear=3.0)
    # mu (du/dy)^2 = 18 W/m^3, less the rows at the edge of the box without neighbors beyond, and the lattice's
    # direction, by which pair forces along the axes are too soft.
    assert coupling.viscous_power(scene, frame) == pytest.approx(18.0, rel=0.2)
    scene.effects = {}
    assert coupling.viscous_power(scene, frame) == 0.0


def test_energy_at_rest_is_that_of_the_layers():
    scene, frame = lattice(shear=0.0)
    assert coupling.energy_at_rest(scene, frame) == pytest.approx(10.0 * (1000 * 0.5 * 0.25 + 500 * 0.5 * 0.75))


def test_shape_of_balls_half_of_which_lies_on_the_wall():
    """Sphericity of n equal balls is n^(-1/3); meshes of 80 x 80 points are 0.3 % small."""
    balls = [pyvista.Sphere(radius=0.01, center=(0.03 * k, 0.0, 0.0), theta_resolution=80, phi_resolution=80)
             for k in range(2)]
    for count in (1, 2):
        surface = pyvista.merge(balls[:count]).extract_surface(algorithm=None)
        surface.point_data["depth"] = 0.5e-4 + surface.points[:, 1]
        ratio, interface, bodies = oil_shape.measured(surface, 1e-4)
        assert bodies == count and ratio == pytest.approx(count ** (-1.0 / 3.0), rel=3e-3)
        assert interface == pytest.approx(count * 2.0 * np.pi * 0.01**2, rel=0.02)
    assert oil_shape.measured(pyvista.PolyData(), 1e-4)[1:] == (0.0, 0)


def test_claims_of_the_paper_are_judged_by_the_numbers():
    def method(name, seconds, kept, isolated):
        frame = np.arange(4.0)
        return coupling.Method(name, None, [], frame, np.full(4, seconds), frame, np.array([2.0, 1.0, 1.0, kept]),
                               0.0 * frame, np.full(4, isolated), 0.0 * frame, frame > 0.0)
    good = [method("volume_incompressible", 1.0, 0.9, 0.0), method("dfsph", 1.1, 0.8, 0.1), method("wcsph", 2, 0.7, 0)]
    assert [row.holds for row, _ in coupling._claims(good, 1)] == [True] * 4
    bad = [method("volume_incompressible", 2.0, 0.7, 0.2), method("dfsph", 1.0, 0.8, 0.1), method("wcsph", 2, 0.7, 0)]
    judged = coupling._claims(bad, 1)
    assert [row.holds for row, _ in judged] == [False] * 4
    assert all("NOT held here" in sentence for _, sentence in judged)


def test_a_particle_amid_another_liquid_is_an_artifact_and_one_that_flies_is_none():
    scene, frame = lattice(shear=0.0)
    lone = 20 * 40 + 20
    phase = np.zeros(1600, int)
    phase[lone] = 1
    spray = np.array([[3.0, 0.0], [3.0 + frame.particle_spacing, 0.0]])  # each has one neighbor, of the other liquid
    frame.position, frame.phase, frame.liquids = np.vstack([frame.position, spray]), np.append(phase, [1, 0]), "ab"
    assert isolated(frame.position, frame.phase, 2, 0.1).sum() == 3
    assert np.flatnonzero(coupling.amid_another(scene, frame)).tolist() == [lone]


# Short runs

@pytest.mark.thorough
@pytest.mark.usefixtures("anew")
@pytest.mark.parametrize("more", [{"cavity": "box", "density_ratio": 0.965, "viscosity": 1.0},
                                  {"cavity": "circle", "interface": "level_set"},
                                  {"cavity": "open_box", "density_ratio": 0.5}], ids=["closed", "level_set", "open"])
def test_layers_at_rest_carry_their_weight(more):
    """At 16 spacings: the study asks for 2 % at 24 and finer; the interface is one layer, 1/16 of the height."""
    outcome = hydrostatics.run(hydrostatics.Parameters(resolutions=(16,), rest_times=2.0, **more))
    assert values(outcome, "pressure error / (rho g H)")[0] < 0.03
    assert not rows_that_fail(outcome)


@pytest.mark.usefixtures("anew")
@pytest.mark.parametrize(("more", "largest"), [({}, 3e-3), ({"interface": "level_set"}, 1e-4),
                                               thorough({"tension": 0.04}, 1e-4)],
                         ids=["labels", "level_set", "tension"])
def test_closed_tank_without_viscosity_stays_at_rest(more, largest):
    """In short: 3 of 20 rest times. At labels 12 spacings have 1.9e-3; at the level set what the solve leaves."""
    outcome = still_tank.run(still_tank.Parameters(resolutions=(12,), rest_times=3.0, **more))
    speed = "rms speed / sqrt(g H), second half"
    assert values(outcome, speed)[0] < largest
    assert not rows_that_fail(outcome, speed)


def test_creeping_drop_is_that_of_the_textbooks_at_its_limits():
    """Hadamard and Rybczynski without a wall, Cunningham for a solid sphere in a spherical cavity."""
    for ratio in (1e-6, 1.0, 100.0):
        free = 2.0 / 3.0 * (1.0 + ratio) / (2.0 + 3.0 * ratio)
        assert creeping_drop.exact_speed(ratio, 1e5) == pytest.approx(free, rel=1e-4)
    for size in (0.1, 1.0 / 3.0, 0.5):
        slower = (1.0 - 2.25 * size + 2.5 * size**3 - 2.25 * size**5 + size**6) / (1.0 - size**5)
        assert creeping_drop.exact_speed(1e8, 1.0 / size) == pytest.approx(2.0 / 9.0 * slower, rel=1e-6)


@pytest.mark.thorough
@pytest.mark.usefixtures("anew")
def test_column_of_position_based_fluid_keeps_its_volume():
    """1 %; the published rest density would let it settle to 80 %."""
    outcome = still_tank.run(still_tank.Parameters(scheme="position_based", cavity="open_box", density_ratio=1.0,
                                                   viscosity=1e-3, resolutions=(16,), rest_times=3.0))
    assert values(outcome, "height of the column / start")[0] == pytest.approx(1.0, abs=0.02)


@pytest.mark.slow
@pytest.mark.usefixtures("anew")
def test_two_equal_liquids_flow_as_one():
    """Mixed at random, they must not differ from one liquid at all; 1e-6 is what rounding may do."""
    outcome = taylor_green.run(taylor_green.Parameters(reynolds=10.0, liquids=2, resolutions=(16,), decay=0.5,
                                                       steps=50))
    assert values(outcome, "largest difference from one liquid / U")[0] < 1e-6


@pytest.mark.usefixtures("anew")
@pytest.mark.parametrize(("form", "spacings", "largest"), [
    ("central", 10, 0.04), pytest.param("laplacian", 20, 0.03, marks=pytest.mark.slow),
    pytest.param("strain", 20, 0.03, marks=pytest.mark.slow)])
def test_two_layers_flow_along_a_channel(form, spacings, largest):
    """At 1:1400; the study asks for 3 % at 40 spacings. With 10 laplacian and strain are 4 and 5 % off."""
    outcome = channel.run(channel.Parameters(ratio=1400.0, form=form, resolutions=(spacings,), times=2.0, steps=20))
    assert values(outcome, "L2 error of the velocity, both layers")[0] < largest
    assert values(outcome, "L2 error of the velocity, viscous layer")[0] < largest
    assert not rows_that_fail(outcome, "L2 error of the velocity, both layers")


@pytest.mark.usefixtures("anew")
def test_lattice_of_the_eye_shears_like_liquid_in_three_dimensions():
    """One liquid, particles in rows as eyes start; 5.8 % off where weights of viscosity reach as far as the kernel."""
    outcome = channel.run(channel.Parameters(dimension=3, start="regular", support_ratio=2.5, resolutions=(8,)))
    assert values(outcome, "L2 error of the velocity, both layers")[0] < 0.01


@pytest.mark.slow
@pytest.mark.usefixtures("anew")
@pytest.mark.parametrize("form", ["central", "strain"])
def test_liquid_in_a_circle_that_stopped_spins_down(form):
    """5 %, as the study asks for."""
    outcome = spin_down.run(spin_down.Parameters(form=form, resolutions=(16,), steps=100))
    assert not rows_that_fail(outcome)


@pytest.mark.slow
@pytest.mark.usefixtures("anew")
def test_vortex_decays_by_its_viscosity():
    """At Re 1, where the viscosity rules: 3 %, as the study asks for at any Re at finer resolutions."""
    outcome = taylor_green.run(taylor_green.Parameters(reynolds=1.0, resolutions=(32,), decay=1.0))
    expected = taylor_green.decay_rate(1.0)
    assert values(outcome, "decay rate of the energy")[0] == pytest.approx(expected, rel=0.03)


@pytest.mark.thorough
@pytest.mark.usefixtures("anew")
@pytest.mark.parametrize("scheme", ["volume_incompressible", pytest.param("dfsph", marks=pytest.mark.slow)])
def test_front_of_a_dam_break_runs_as_measured(scheme):
    """With 12 and 8 particles along the column; the study asks for the band itself and 5 %.

    With so few the tip is a particle or two thick and the front of the water leaves the band by 5 and 11 % (with 8 that
    of `volume_incompressible` by 7 to 24 %, as chance has it: steps a few percent shorter or longer are enough); the
    farthest particle runs at 1.89 and 1.74, between the experiment's 1.7 and the 2 without friction.
    """
    resolution, ahead, off = {"dfsph": (8, 0.13, 0.05), "volume_incompressible": (12, 0.1, 0.13)}[scheme]
    outcome = dam_break.run(dam_break.Parameters(scheme=scheme, resolutions=(resolution,), repeats=2))
    assert values(outcome, "largest departure from the band / experiment")[0] < ahead
    speed, = values(outcome, "speed of the farthest particle / sqrt(2 g a), tau > 5")
    assert speed == pytest.approx(dam_break.front_speed(*dam_break.WIDE.T, dam_break.STEADY), rel=off)
    # The two starts differ by a millionth of a spacing, and so do their fronts until the tip breaks up.
    scatter, = values(outcome, "standard deviation of this speed between single runs")
    assert 0.0 < scatter < 0.1


@pytest.mark.thorough
@pytest.mark.usefixtures("anew")
def test_run_that_goes_bad_is_reported_and_not_hidden(monkeypatch):
    """A solver that fails gives rows that do not hold, and the reason in words."""
    from sim.solver import Divergence, Solver

    def fail(solver, until):
        raise Divergence("step 0: it failed")
        yield

    monkeypatch.setattr(Solver, "advance", fail)
    outcome = still_tank.run(still_tank.Parameters(resolutions=(8,)))
    assert {"time reached", "rms speed / sqrt(g H), second half"} <= rows_that_fail(outcome)
    assert math.isnan(values(outcome, "rms speed / sqrt(g H), second half")[0])
    assert "it failed" in outcome.remarks[0]


@pytest.mark.thorough
@pytest.mark.usefixtures("anew")
def test_packed_start_is_disordered_but_even():
    """The viscosity of pair forces is wrong on a lattice, and a jittered start would never come to rest."""
    arrays = cavity("box", (1.0, 1.0), 1.0 / 16, start="packed")
    position = arrays["fluid_position"]
    assert len(np.unique(position[:, 0].round(4))) > 200
    nearest = cKDTree(position).query(position, 2)[0][:, 1] * 16
    assert nearest.min() > 0.7 and nearest.max() < 1.2


def test_circularity_of_an_ellipse():
    """Against Ramanujan's perimeter, which is exact to 1e-6 at this ratio; the grid's contour is short by less."""
    x, y = np.meshgrid(np.linspace(-2.0, 2.0, 401), np.linspace(-2.0, 2.0, 401), indexing="ij")
    for long, short in ((1.0, 1.0), (1.5, 0.75)):
        ratio = ((long - short) / (long + short)) ** 2
        perimeter = np.pi * (long + short) * (1.0 + 3.0 * ratio / (10.0 + np.sqrt(4.0 - 3.0 * ratio)))
        found = rising_bubble.circularity(1.0 - np.hypot(x / long, y / short), 0.01)
        assert found == pytest.approx(2.0 * np.pi * np.sqrt(long * short) / perimeter, abs=2e-4)
    assert math.isnan(rising_bubble.circularity(np.ones((4, 4)), 1.0))


@pytest.mark.slow
@pytest.mark.usefixtures("anew")
def test_bubble_rises_as_in_the_benchmark():
    """Coarser than the study, which asks for 1 %, 3 % and 2 % where there are 64 particles along the width."""
    outcome, bubble = rising_bubble.run(rising_bubble.Parameters(resolutions=(24,))), rising_bubble.BUBBLES[1]
    for quantity, expected, tolerance in (
            ("height of the center of mass at 3 s", bubble.height, 0.02), ("largest speed", bubble.speed, 0.1),
            ("smallest circularity", bubble.circularity, 0.03)):
        assert values(outcome, quantity)[0] == pytest.approx(expected, rel=tolerance)


@pytest.mark.parametrize("beta", [0.1, 0.25])
def test_wave_without_viscosity_swings_for_ever(beta):
    time = np.linspace(0.0, 10.0, 50)
    found = capillary_wave.prosperetti(time, 1e-9, 2.0, beta)
    np.testing.assert_allclose(found, np.cos(2.0 * time), atol=2e-3)


def test_wave_in_a_stiff_liquid_creeps():
    """Tension against viscosity alone: at the rate sigma k/(4 mu) = omega_0^2/(2 nu k^2)."""
    time = np.linspace(0.0, 400.0, 50)
    found = capillary_wave.prosperetti(time, 100.0, 1.0, 0.25)
    np.testing.assert_allclose(found, np.exp(-time / 200.0), rtol=1e-3)


@pytest.mark.slow
@pytest.mark.usefixtures("anew")
@pytest.mark.parametrize("laplace", [1.0, 3000.0])
def test_wave_decays_as_it_should(laplace):
    """Within the 3 % of the study; on coarser sets the wave is lower than two spacings, and its start decides."""
    outcome = capillary_wave.run(capillary_wave.Parameters(laplace=laplace, resolutions=(32,)))
    assert not rows_that_fail(outcome)


def test_contact_line_begins_at_the_speed_of_theory_and_ends_at_rest():
    """Fastest retreats from two angles differ by the speed between them."""
    case = contact_line.Parameters(duration=60.0)
    times, way = contact_line.theory(case)
    oil, aqueous = case.oil_viscosity, contact_line.AQUEOUS.dynamic_viscosity
    level, angle = contact_line.level_start(case), np.radians(case.contact_angle)
    to_zero = [fastest_retreat(one, contact_line.TENSION, aqueous, oil, contact_line.RADIUS) for one in (level, angle)]
    short = contact_line.theory(contact_line.Parameters(duration=1e-3))[1][-1] / 1e-3
    assert short == pytest.approx(to_zero[0] - to_zero[1], rel=0.01)
    weight = (contact_line.AQUEOUS.density - contact_line.OIL_DENSITY) * contact_line.GRAVITY / contact_line.TENSION
    rest = oil_at_rest(case.fill, angle, weight, contact_line.RADIUS, 2).wall_angle
    assert way[-1] == pytest.approx(contact_line.RADIUS * (rest - level), rel=1e-3)
    assert np.diff(way).min() > -1e-9  # m: at rest the integration wavers by its tolerance
    assert times[-1] == case.duration


@pytest.mark.parametrize(("dimension", "share"), [(2, lambda b: (b - np.sin(b) * np.cos(b)) / np.pi),
                                                  (3, lambda b: (2.0 - 3.0 * np.cos(b) + np.cos(b) ** 3) / 4.0)])
def test_contact_line_starts_where_a_level_parts_the_volumes(dimension, share):
    """Areas of a segment and volume of a cap over those of the whole."""
    case = contact_line.Parameters(dimension=dimension, fill=0.7)
    assert share(contact_line.level_start(case)) == pytest.approx(0.3, rel=1e-6)


def test_contact_line_recedes_from_a_start_beyond_rest():
    case = contact_line.Parameters(duration=60.0, contact_angle=40.0, start_angle=18.2)
    _, way = contact_line.theory(case)
    first, last = (contact_line.shape_at_rest(case.fill, np.radians(angle), 2).wall_angle for angle in (18.2, 40.0))
    assert way[-1] == pytest.approx(contact_line.RADIUS * (last - first), rel=1e-3)
    assert np.diff(way).max() < 1e-9


@pytest.mark.parametrize("angle", [15.0, 40.0])
def test_contact_line_is_read_where_the_shape_of_rest_has_it(angle):
    """Within a hundredth of a spacing, R/dx 16, of points that lie on the shape."""
    spacing = contact_line.RADIUS / 16.0
    shape = contact_line.shape_at_rest(0.85, np.radians(angle), 2)
    points = np.stack([shape.r, shape.z], axis=1)
    effect = SimpleNamespace(name="interface_tension", sorted_point=SimpleNamespace(to_numpy=lambda: points),
                             point_count={None: len(points)})
    shapes = contact_line.shapes_near_wall(0.85, np.radians(8.0), np.radians(64.0), 2, 6.0 * spacing)
    found = contact_line.line_of(SimpleNamespace(effects=[effect], spacing=spacing), shapes)
    assert contact_line.RADIUS * abs(found - shape.wall_angle) < 0.01 * spacing


@pytest.mark.thorough
@pytest.mark.usefixtures("anew")
@pytest.mark.parametrize(("angle", "start"), [(18.2, None), (40.0, 18.2)])
def test_contact_line_moves_at_the_speed_of_theory_at_two_angles(angle, start):
    """Aqueous that climbs, and that leaves the wall, by four and three spacings: within half a one."""
    case = contact_line.Parameters(contact_angle=angle, start_angle=start, support_ratio=2.5, resolutions=(16,),
                                   holds="corner", tolerance=0.15)
    assert not rows_that_fail(contact_line.run(case))


@pytest.mark.slow
@pytest.mark.usefixtures("anew")
@pytest.mark.parametrize(("dimension", "resolution"), [(2, 32), (3, 11)])
def test_contact_line_climbs_at_the_speed_of_theory(dimension, resolution):
    """As the study allows."""
    case = contact_line.Parameters(dimension=dimension, support_ratio=2.5, resolutions=(resolution,))
    outcome = contact_line.run(case)
    (curve,) = (curve for curve in outcome.curves if curve.style == "line")
    assert curve.y[0] == 0.0
    assert not rows_that_fail(outcome)


def test_damped_cosine_is_found_again():
    time = np.linspace(0.0, 3.0, 400)
    swing = 0.1 * np.exp(-0.4 * time) * np.cos(2.0 * np.pi * time / 0.9 + 0.05) + 1e-3
    assert oscillating_drop.fitted(time, swing, 1.0) == pytest.approx((0.9, 0.4), rel=1e-6)


@pytest.mark.parametrize(("density_ratio", "sum_of_densities"), [(1.0, 2000.0), (0.01, 1010.0), (100.0, 1010.0)])
def test_period_of_a_drop_far_from_the_wall_is_that_of_lamb(monkeypatch, density_ratio, sum_of_densities):
    """omega^2 = 6 sigma / ((rho_1 + rho_2) R^3) without wall (two dimensions); thin layers lengthen it a little."""
    monkeypatch.setattr(oscillating_drop, "CAVITY", 30.0)
    omega = math.sqrt(6.0 * oscillating_drop.TENSION / (sum_of_densities * oscillating_drop.RADIUS**3))
    period, _ = oscillating_drop.normal_mode(oscillating_drop.Parameters(ohnesorge=1e-4, density_ratio=density_ratio))
    assert 2.0 * math.pi / omega * (1.0 - 1e-5) < period < 2.0 * math.pi / omega * 1.01


@pytest.mark.parametrize("density_ratio", [1.0, 0.01])
def test_a_drop_decays_by_the_layers_at_its_interface_and_by_the_flow_in_it(monkeypatch, density_ratio):
    """Far from the wall, to first order in both: sqrt(omega nu/2)/R 4 m/(rho + rho_o), m = rho rho_o/(rho + rho_o), and
    4 nu/R^2 (Lamb).
    """
    monkeypatch.setattr(oscillating_drop, "CAVITY", 30.0)
    period, decay = oscillating_drop.normal_mode(
        oscillating_drop.Parameters(ohnesorge=1e-4, density_ratio=density_ratio))
    radius, drop = oscillating_drop.RADIUS, oscillating_drop.DENSITY
    viscosity = 1e-4 * math.sqrt(oscillating_drop.TENSION * radius / drop)
    shared = 4.0 * density_ratio / (1.0 + density_ratio) ** 2
    layers = math.sqrt(math.pi / period * viscosity) / radius * shared
    assert decay == pytest.approx(layers + 4.0 * viscosity / radius**2, rel=0.03)


@pytest.mark.parametrize("angle", [30.0, 60.0, 120.0])
def test_rise_between_plates_carries_the_pull_at_the_walls(angle):
    """The weight of what is lifted in each gap is that of a level box of the same difference of heights."""
    case = capillary_rise.Parameters(contact_angle=angle)
    weight = (capillary_rise.HEAVY - capillary_rise.LIGHT) * capillary_rise.GRAVITY
    pressures = [2.0 * case.tension * np.cos(np.radians(angle)) / gap
                 for gap in (capillary_rise.INSIDE, capillary_rise.OUTSIDE)]
    assert capillary_rise.exact_rise(case) * weight == pytest.approx(pressures[0] - pressures[1])


@pytest.mark.thorough
@pytest.mark.usefixtures("anew")
def test_tension_lifts_a_liquid_between_plates_by_its_weight():
    """The study asks for 5 % at 10 spacings and more between the plates."""
    outcome = capillary_rise.run(capillary_rise.Parameters(resolutions=(8,), duration=2.5))
    assert values(outcome, "rise between the plates")[0] == pytest.approx(
        1e3 * capillary_rise.exact_rise(capillary_rise.Parameters()), rel=0.1)
