"""Short versions of the families of `validation` that look at films on walls, and what their references rest on."""
import numpy as np
import pytest

from studies.validation import deposited_film, film_on_plate, wedge_kept
from studies.validation.kit.tank import field


def value(outcome, quantity):
    """Return the one value of a quantity."""
    (found,) = (row.value for row in outcome.rows if row.quantity == quantity)
    return found


def rows_that_fail(outcome):
    """Return the quantities of rows that do not hold."""
    return {row.quantity for row in outcome.rows if row.holds is False}


# References

@pytest.mark.parametrize(("inclination", "spacing"), [(90.0, 1e-3), (45.0, 1e-3), (45.0, 2.5e-4), (20.0, 5e-4)])
def test_surface_of_the_pool_meets_both_plates_at_the_contact_angle(inclination, spacing):
    case = film_on_plate.Parameters(inclination=inclination, spacing=spacing)
    x, height = film_on_plate.surface_of_pool(case)
    slope = np.gradient(height, x, edge_order=2)
    steep = 1.0 / np.tan(film_on_plate.CONTACT_ANGLE)
    assert slope[0] == pytest.approx(-steep, rel=0.08)
    assert slope[-1] == pytest.approx(steep, rel=0.08)


def test_weight_of_what_the_plates_lift_is_the_pull_of_tension_along_them():
    """Upright: the pull at both plates holds the liquid above the place where the pressures are equal."""
    case = film_on_plate.Parameters(spacing=5e-4)
    x, height = film_on_plate.surface_of_pool(case)
    weight = case.density_difference * film_on_plate.GRAVITY
    curvature = np.gradient(np.gradient(height, x), x)[len(x) // 2]
    above_level = height - height[len(x) // 2] + case.tension * curvature / weight
    assert weight * np.trapezoid(above_level, x) == pytest.approx(
        2.0 * case.tension * np.cos(film_on_plate.CONTACT_ANGLE), rel=0.02)


def test_a_flat_enough_pool_is_level_on_an_inclined_plate():
    """Far from plates that are many capillary lengths apart the surface is level."""
    case = film_on_plate.Parameters(inclination=45.0, spacing=1e-2)
    x, height = film_on_plate.surface_of_pool(case)
    middle = slice(45, 56)
    assert np.gradient(height, x)[middle] == pytest.approx(-1.0, abs=0.02)


def test_film_of_theory_is_thinner_than_half_a_particle_but_where_it_is_fast():
    """An air bubble's film is 1.34 R Ca^(2/3); behind stiff oil up to 2.5 times that [hodges2004]."""
    for number, resolution, below in ((1e-5, 16, True), (1e-4, 16, True), (1e-3, 8, True), (1e-2, 8, False)):
        case = deposited_film.Parameters(capillary_number=number)
        thickness = deposited_film.film_behind(case, deposited_film.THICKEST)
        assert thickness == pytest.approx(1.34 * 16.0 ** (1.0 / 3.0) * 5e-3 * number ** (2.0 / 3.0))
        assert (thickness < 0.5 * case.radius / resolution) == below


@pytest.mark.thorough
@pytest.mark.usefixtures("anew")
def test_tube_holds_its_volume():
    """A cylinder with round ends; no particle is outside."""
    case = deposited_film.Parameters(dimension=3, resolutions=(4,))
    arrays = deposited_film.tube(case, case.radius / 4)
    volume = np.pi * case.radius**3 * (deposited_film.LENGTH - 2.0 + 4.0 / 3.0)
    assert arrays["fluid_volume"].sum() == pytest.approx(volume, rel=1e-9)
    away = np.linalg.norm(np.delete(arrays["fluid_position"], 1, axis=1), axis=1)
    assert away.max() < case.radius


# Runs

@pytest.mark.thorough
@pytest.mark.usefixtures("anew")
def test_film_on_an_upright_plate_slides_down_and_nothing_of_it_stays():
    """Without the effect more than a third stays; the study asks for more rows and for the speed."""
    outcome = film_on_plate.run(film_on_plate.Parameters(resolutions=(20,)))
    assert value(outcome, "particles that changed places") > 5
    assert value(outcome, "rows of the film left above the pool") <= 1
    assert "particles with another volume than at the start, liquid by liquid" not in rows_that_fail(outcome)


@pytest.mark.thorough
@pytest.mark.usefixtures("anew")
def test_film_on_a_level_plate_stays_and_a_hole_grows_no_faster_than_theory():
    outcome = film_on_plate.run(film_on_plate.Parameters(inclination=0.0, hole=6, resolutions=(24,), times=1.2))
    assert value(outcome, "particles that changed places") == 0.0
    assert not rows_that_fail(outcome)


@pytest.mark.thorough
@pytest.mark.usefixtures("anew")
def test_thin_lens_at_rest_is_no_film():
    """In short: with the study's 2 s the shares agree as well."""
    outcome = wedge_kept.run(wedge_kept.Parameters(resolutions=(8,), duration=0.3))
    assert not rows_that_fail(outcome)


@pytest.mark.thorough
@pytest.mark.usefixtures("anew")
def test_oil_that_drives_aqueous_down_a_channel_leaves_hardly_any_of_it_on_the_walls():
    outcome = deposited_film.run(deposited_film.Parameters(capillary_number=1e-3, resolutions=(6,)))
    assert value(outcome, "way of the front / radius") == pytest.approx(deposited_film.TRAVEL, rel=0.02)
    assert not rows_that_fail(outcome)


@pytest.mark.thorough
@pytest.mark.usefixtures("anew")
def test_aqueous_that_oil_drives_to_a_drain_stays_calm_where_nothing_weighs(monkeypatch):
    """Tension puts it below the mean pressure: particles crowded and rushed about, 7 times as fast as the front."""
    monkeypatch.setattr(deposited_film, "TRAVEL", 1.0)
    case = deposited_film.Parameters(front="weightless")
    result = deposited_film.drive(case, 4)
    assert not result.failure
    fastest = np.linalg.norm(field(result.solver, "velocity"), axis=1).max()
    assert fastest < 3.0 * deposited_film.speed_of_front(case)
