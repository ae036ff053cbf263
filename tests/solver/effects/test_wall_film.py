"""Films on the wall: how fast they slide off, what an exchange of places keeps, and where nothing may happen."""
import math

import numpy as np
import pytest
from helpers import cavities

from sim.settings import Liquid

pytestmark = pytest.mark.usefixtures("taichi")
SPACING = cavities.SPACING
AQUEOUS, OIL = Liquid("aqueous", 1005.0, 7e-4), Liquid("oil", 970.0, 1.0)
TENSION, ANGLE = 0.04, math.radians(18.2)
WIDTH, HEIGHT, POOL = 10.0 * SPACING, 32.0 * SPACING, 5.0 * SPACING
LUBRICATION = 35.0 * 9.81 * SPACING**2 / (12.0 * AQUEOUS.dynamic_viscosity)  # m/s: 41 mm/s


def plate(posture="upright", film=True, wedge=False):
    """Return a box of oil over a pool, with aqueous on its left side: one particle thick, or the wedge of a line."""
    def phase(x):
        low = np.array([-0.5 * WIDTH, -0.5 * HEIGHT])
        from_left, from_floor = (x - low).T
        thickness = np.where(from_floor < HEIGHT - 2.0 * SPACING, SPACING, 0.0)
        if wedge:
            thickness = (POOL + 6.0 * SPACING - from_floor) * math.tan(ANGLE)
        return (from_floor > POOL) & (from_left > thickness)
    effects = [cavities.parameters("gravity", posture=posture), cavities.parameters("viscosity_implicit"),
               cavities.parameters("interface_tension", coefficient=TENSION, contact_angle=ANGLE)]
    return cavities.build(cavities.cavity("box", (WIDTH, HEIGHT)), liquids=(AQUEOUS, OIL), phase=phase,
                          effects=[*effects, cavities.parameters("wall_film")] if film else effects)


def rows_left(solver) -> int:
    """Number of film particles above the wedge that ends in the pool."""
    position, phase = cavities.read(solver, "position", "phase")
    on_plate = position[:, 0] < -0.5 * WIDTH + SPACING
    return int((on_plate & (phase == 0) & (position[:, 1] > -0.5 * HEIGHT + POOL + 6.0 * SPACING)).sum())


def effect_of(solver):
    return next(effect for effect in solver.effects if effect.name == "wall_film")


@pytest.fixture(scope="module")
def emptied(circle):
    """Return the rows of film on an upright plate in every step, and their times."""
    solver = plate()
    rows = cavities.run(solver, 0.5, lambda solver: (solver.time, rows_left(solver)))
    return np.array(rows).T


def test_film_on_a_plate_slides_off_as_fast_as_lubrication(emptied):
    """While a quarter of it is left; without the model two thirds of it stay for good."""
    times, rows = emptied
    quarter = times[np.argmax(rows <= 0.25 * rows[0])]
    assert rows[0] >= 14 and (rows <= 0.25 * rows[0]).any()
    assert 0.75 * rows[0] * SPACING / quarter == pytest.approx(LUBRICATION, rel=0.3)


@pytest.mark.thorough
def test_film_stays_without_the_model():
    solver = plate(film=False)
    before = rows_left(solver)
    cavities.run(solver, 0.5)
    assert rows_left(solver) > 0.4 * before


def test_film_with_its_weight_into_the_wall_stays_in_place():
    """Lying on a side: the plate is the floor or the ceiling, and nothing pulls a film along it."""
    solver = plate(posture="left_side")
    assert sum(cavities.run_in_steps(solver, 2e-3, 0.02, lambda solver: solver.statistics["film_exchanges"])) == 0


@pytest.fixture
def loaded():
    """Return a plate whose columns are due, with disordered velocities and unequal volumes."""
    solver = plate()
    solver.step(1e-5)
    rng = np.random.default_rng(3)
    volume, phase, mass = cavities.read(solver, "volume", "phase", "mass")
    factor = rng.uniform(0.7, 1.3, len(volume))
    for name, values in (("volume", factor * volume), ("mass", factor * mass), ("film_way", np.full(len(phase), 1.0)),
                         ("velocity", rng.normal(size=(len(phase), 2)))):
        solver.particles.from_numpy(name, values)
    return solver


def test_particles_that_change_places_take_all_along_that_they_are(loaded):
    names = ("id", "phase", "volume", "mass")
    before = dict(zip(names, cavities.read(loaded, *names), strict=True))
    position, velocity = cavities.read(loaded, "position", "velocity")
    assert effect_of(loaded).finish(1e-5)["film_exchanges"] > 0
    after = dict(zip(names, cavities.read(loaded, *names), strict=True))
    assert not np.array_equal(after["phase"], before["phase"])
    np.testing.assert_array_equal(cavities.read(loaded, "position")[0], position)
    place = np.argsort(before["id"])[after["id"].astype(int)]
    for name in names:
        np.testing.assert_array_equal(after[name], before[name][place], err_msg=name)
    found = cavities.read(loaded, "velocity")[0]
    total = (before["mass"][:, None] * np.abs(velocity)).sum()
    np.testing.assert_allclose(after["mass"] @ found, before["mass"] @ velocity, rtol=0.0, atol=1e-13 * total)


def test_every_exchange_takes_film_down(loaded):
    mass, position, phase = cavities.read(loaded, "mass", "position", "phase")
    assert effect_of(loaded).finish(1e-5)["film_exchanges"] > 0
    assert cavities.read(loaded, "mass")[0] @ position[:, 1] < mass @ position[:, 1]
    became_oil, became_film = (np.sign(cavities.read(loaded, "phase")[0] - phase) == sign for sign in (1, -1))
    assert position[became_oil, 1].min() > position[became_film, 1].max()


def test_what_a_front_leaves_behind_beyond_a_real_film_is_given_back():
    """A particle that becomes film long after it was in the pool moves the end of its column on by dx less the film
    of that front [bretherton1961].
    """
    solver = plate()
    cavities.run_in_steps(solver, 1e-5, 3e-5)
    ways = []
    for seconds in (None, 0.4):
        time = cavities.read(solver, "film_time")[0]
        member = cavities.read(solver, "film_member")[0]
        end, lowest = np.argmax(member), np.flatnonzero(member == 1)[0]
        if seconds is not None:
            time[lowest] = seconds
            solver.particles.from_numpy("film_time", time)
        solver.particles.from_numpy("film_way", np.zeros(len(time)))
        effect_of(solver).finish(1e-9)
        ways.append(cavities.read(solver, "film_way")[0][end])
    speed = (1.0 / math.tan(ANGLE) + 1.0) * SPACING / 0.4
    capillary_number = AQUEOUS.dynamic_viscosity * speed / TENSION
    radius = math.sqrt(WIDTH * HEIGHT / math.pi)
    film = 1.34 * 2.0 ** (2.0 / 3.0) * radius * capillary_number ** (2.0 / 3.0)
    assert OIL.dynamic_viscosity / AQUEOUS.dynamic_viscosity > capillary_number ** (-2.0 / 3.0)
    assert ways[0] == pytest.approx(0.0, abs=1e-9)
    assert ways[1] == pytest.approx(SPACING - film, rel=1e-6) and 0.0 < film < 0.2 * SPACING


def test_wedge_at_a_contact_line_is_no_film():
    """It is as thin as a film at its end, which is near the pool."""
    solver = plate(wedge=True)
    seen = cavities.run_in_steps(solver, 2e-3, 0.02, lambda solver: (
        solver.statistics["film_exchanges"], solver.statistics["film_particles"],
        (cavities.read(solver, "film_kind")[0] == 1).sum()))
    exchanges, film, thin = np.array(seen).T
    assert exchanges.sum() == film.sum() == 0 and thin.min() >= 2


@pytest.mark.thorough
def test_restarts_and_threads_change_no_bit(circle, elsewhere):
    """In another process, by two threads, with a restart by a solver that knows the state alone."""
    solver = cavities.film(circle, "f64")
    exchanges = [sum(cavities.run(solver, until, lambda solver: solver.statistics["film_exchanges"]))
                 for until in (0.5 * cavities.FILM_END, cavities.FILM_END)]
    assert exchanges[0] >= 2 and exchanges[1] >= 6
    found = elsewhere("f64", 2, "film")
    for name, values in solver.state().items():
        np.testing.assert_array_equal(found[f"film.{name}"], values, err_msg=name)
