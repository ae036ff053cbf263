"""What oil at the wall lies on agrees with the theory of films, for fronts whose speed is known."""
import dataclasses

import numpy as np
import pytest
from helpers import synthetic_frames

from pipeline import metrics
from pipeline.base.frame_files import frame_path, write_frame
from pipeline.measures.coverage import WallContact
from pipeline.measures.film_course import FilmCourse, Wetting
from pipeline.scenes.effects import knows_films
from pipeline.scenes.load import load_scene
from pipeline.scenes.model import Material

SPACING, RADIUS = 4e-4, 11e-3
SUPINE = np.array([0.0, 0.0, -9.81])
NO_WEIGHT = np.zeros(3)
VOLUME = 5.05e-6


@pytest.fixture(scope="module")
def scene(request):
    return load_scene(request.config.rootpath / "config" / "scenes" / "tamponade.yaml", accuracy="draft")


@pytest.fixture(scope="module")
def wetting(scene):
    return Wetting.of(scene, VOLUME)


def sphere():
    """Even wall points (m, 3) on a sphere, a particle spacing apart."""
    count = round(4.0 * np.pi * RADIUS**2 / SPACING**2)
    height = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.pi * (1.0 + 5.0**0.5) * np.arange(count)
    across = np.sqrt(1.0 - height**2)
    return RADIUS * np.stack([across * np.cos(turn), height, across * np.sin(turn)], axis=-1)


wall = sphere()
arc = RADIUS * np.arccos(np.clip(wall[:, 1] / RADIUS, -1.0, 1.0))  # m along the wall from its highest point


def contact_of(covered, angle=None):
    """Wall points of which some (m,) are under oil."""
    depth = np.full(len(wall), 0.5 * SPACING)
    return WallContact(wall, np.ones(len(wall)), covered.astype(float), depth, SPACING, angle)


def front(course, speed, times, *, start=4e-3, gravity=NO_WEIGHT, until=np.inf):
    """Let oil come down the wall from a cap at its top that it touches, in a ring of front; return the last frame."""
    for time in times:
        film = course.advance(contact_of(arc < min(start + speed * time, until)), time, gravity)
    return film


def bretherton(speed):
    """Least and greatest thickness, m: 1.34 R Ca^(2/3) of a bubble, 2^(2/3) to 4^(2/3) times that for viscous oil."""
    radius = (3.0 * VOLUME / (4.0 * np.pi)) ** (1.0 / 3.0)
    bubble = 1.34 * (7e-4 * speed / 0.04) ** (2.0 / 3.0)
    return 2.0 ** (2.0 / 3.0) * 0.5 * radius * bubble, 4.0 ** (2.0 / 3.0) * 0.85 * radius * bubble


def test_a_film_is_some_tens_of_micrometers_thick(wetting):
    assert wetting.retreat == pytest.approx(1.6e-3, rel=0.05)  # m/s
    assert 1e6 * wetting.deposit(np.array([0.01]))[:, 0] == pytest.approx([35.4, 95.6], rel=0.005)
    assert not wetting.deposit(np.array([0.9 * wetting.retreat])).any()


@pytest.mark.thorough_cases("0.03-0.004")
@pytest.mark.parametrize("speed", [4e-3, 10e-3, 30e-3])
@pytest.mark.parametrize("interval", [0.03, 0.1])
def test_a_fast_front_leaves_the_film_of_its_speed(wetting, speed, interval):
    times = np.arange(0.0, 8e-3 / speed, interval)
    film = front(FilmCourse(wetting), speed, times)
    # The oil that was there has pushed the film away as far as this.
    far = film.contact.covered & (arc > 4e-3 + wetting.retreat * times[-1] + 2.0 * SPACING)
    assert far.sum() > 500 and film.film[far].all()
    assert np.median(film.thickness[0, far]) == pytest.approx(bretherton(speed)[0], rel=0.12)
    assert np.median(film.thickness[1, far]) == pytest.approx(bretherton(speed)[1], rel=0.12)
    assert not film.film[arc < 4e-3 - SPACING].any()  # where oil was at the start it touches


@pytest.mark.parametrize("interval", [0.1, 0.5])
def test_a_slow_front_leaves_no_film(wetting, interval):
    film = front(FilmCourse(wetting), 0.8 * wetting.retreat, np.arange(0.0, 6.0, interval))
    assert film.contact.covered.mean() > 0.2 and not film.film.any()
    assert film.film_share() == 0.0 and np.isnan(film.thickness_range()).all()


def test_films_end_as_fast_as_theory_says(wetting):
    """A ring 8 mm wide, deposited within 0.1 s, is closed from both its edges; at one of them the front has stopped."""
    course, wide = FilmCourse(wetting), 8e-3
    front(course, wide / 0.1, [0.0, 0.1], until=4e-3 + wide)
    for time in np.arange(0.2, 0.1 + 0.5 * wide / wetting.retreat + 0.5, 0.05):
        film = course.advance(contact_of(arc < 4e-3 + wide), time, NO_WEIGHT)
        gone = wetting.retreat * (time - 0.1)
        inside = (arc > 4e-3 + gone + 1.5 * SPACING) & (arc < 4e-3 + wide - gone - 1.5 * SPACING)
        outside = (arc < 4e-3 + 0.95 * gone - 1.5 * SPACING) | (arc > 4e-3 + wide - 0.95 * gone + 1.5 * SPACING)
        assert film.film[inside].all() and not film.film[outside].any()
    assert not film.film.any()


@pytest.mark.parametrize("turned", [False, True])
def test_films_become_thinner_by_their_weight(wetting, turned):
    """Under rigid oil h = sqrt(4 mu s^2 / (z drho g t)), where the way s from the top of a film falls by z.

    From the pole of a sphere s^2 is 2 R z. Turned over, the top of the film is at its edge, and comes nearer.
    """
    course, down = FilmCourse(wetting), np.array([0.0, 9.81 if turned else -9.81, 0.0])
    course.advance(contact_of(arc < 0.0), 0.0, NO_WEIGHT)
    kept = course.advance(contact_of(arc < 30e-3), 0.1, NO_WEIGHT).thickness
    for time in np.linspace(0.5, 8.0, 20):
        film = course.advance(contact_of(arc < 30e-3), time, down)
    there = film.film & (arc > 4e-3) & (arc < 10e-3)

    def thickness(top):
        fall = RADIUS * np.abs(np.cos(top / RADIUS) - np.cos(arc[there] / RADIUS))
        way = 2.0 * RADIUS * np.sin(np.abs(top - arc[there]) / (2.0 * RADIUS))
        return np.sqrt(4.0 * 7e-4 * way**2 / (fall * 35.0 * 9.81 * 7.9))

    assert there.sum() > 500
    if turned:
        nearer, farther = thickness(30e-3 - 7.9 * wetting.retreat), thickness(30e-3)
        assert (film.thickness[0, there] > 0.95 * np.minimum(nearer, kept[0, there])).all()
        assert (film.thickness[0, there] < 1.05 * np.minimum(farther, kept[0, there])).all()
    else:
        assert kept[0, there].min() > 1.2 * thickness(0.0).max()
        assert film.thickness[0, there] == pytest.approx(thickness(0.0), rel=0.05)


def test_film_that_is_left_by_the_oil_is_forgotten(wetting):
    """Aqueous comes back for two seconds; then oil creeps over the same wall, and touches it."""
    course = FilmCourse(wetting)
    assert front(course, 20e-3, np.arange(0.0, 0.5, 0.1)).film.any()
    for time in np.arange(0.5, 2.5, 0.1):
        film = course.advance(contact_of(arc < 4e-3), time, NO_WEIGHT)
    assert not film.film.any()
    for time in np.arange(2.5, 8.0, 0.1):
        film = course.advance(contact_of(arc < 4e-3 + 0.8 * wetting.retreat * (time - 2.5)), time, NO_WEIGHT)
    assert film.contact.covered[arc < 9e-3].all() and not film.film.any()


def test_oil_that_outlives_where_it_came_from_goes_on(wetting):
    """The cap that a ring of oil came from is bare for two seconds; then the ring grows slowly over new wall."""
    course = FilmCourse(wetting)
    front(course, 20e-3, np.arange(0.0, 0.45, 0.1))
    for time in np.arange(0.5, 6.0, 0.1):
        edge = 12e-3 + 1.2e-3 * max(time - 2.5, 0.0)
        film = course.advance(contact_of((arc > 11e-3) & (arc < edge)), time, NO_WEIGHT)
        assert np.isfinite(film.thickness).all()
    assert not film.film[arc > 12e-3 + 2.0 * SPACING].any()


def test_a_label_that_flickers_makes_no_hole_in_a_film(wetting):
    course = FilmCourse(wetting)
    steady = front(course, 20e-3, np.arange(0.0, 0.5, 0.1)).film
    hole = np.argmin(np.where(steady, np.abs(arc - 8e-3), 1.0))
    covered = arc < 12e-3
    covered[hole] = False
    course.advance(contact_of(covered), 0.5, NO_WEIGHT)
    assert course.advance(contact_of(arc < 12e-3), 0.6, NO_WEIGHT).film[hole]


def test_oil_that_lands_on_the_wall_lies_on_a_film(wetting):
    course = FilmCourse(wetting)
    course.advance(contact_of(arc < 0.0), 0.0, NO_WEIGHT)
    film = course.advance(contact_of(arc < 2e-3), 0.1, NO_WEIGHT)
    assert film.film.sum() == film.contact.covered.sum() > 0
    assert film.thickness[0, film.film] == pytest.approx(bretherton(20e-3)[0], rel=0.15)


@pytest.mark.parametrize("angle", [None, np.radians(18.2)])
def test_shares_add_up(wetting, angle):
    course = FilmCourse(wetting)
    for time in np.arange(0.0, 2.0, 0.1):
        film = course.advance(contact_of(arc < 4e-3 + 6e-3 * time, angle), time, NO_WEIGHT)
    for mask in (None, wall[:, 1] > 0.0, arc < 8e-3, arc > 30e-3):
        over, all_of_it = film.film_share(mask), film.contact.covered_share(mask)
        assert 0.0 <= over <= all_of_it <= 1.0
    drawn = film.film.mean()
    assert 0.0 < film.film_share() < film.contact.covered_share()
    assert film.film_share() == pytest.approx(drawn, abs=0.05)  # but for the strip along the contact line
    assert film.film_share() <= drawn + 1e-12 if angle else film.film_share() == pytest.approx(drawn)


@pytest.mark.thorough
def test_two_runs_are_the_same(wetting):
    def course():
        random = np.random.default_rng(5)
        followed = FilmCourse(wetting)
        edges = [4e-3 + 6e-3 * time + SPACING * random.normal(size=len(arc)) for time in times]
        return [followed.advance(contact_of(arc < edge), time, SUPINE) for edge, time in zip(edges, times, strict=True)]

    times = np.arange(0.0, 2.0, 0.1)
    for one, other in zip(course(), course(), strict=True):
        assert (one.film == other.film).all() and (one.thickness == other.thickness).all()


def test_films_are_known_where_theory_knows_them(scene):
    assert knows_films(scene)
    tension = next(name for name in scene.effects if "tension" in name)
    obtuse = dataclasses.replace(scene.effects[tension], contact_angle=np.radians(100.0))
    gas = dataclasses.replace(scene.liquids[1], density=1.2, dynamic_viscosity=1.8e-5)
    assert not knows_films(dataclasses.replace(scene, effects=scene.effects | {tension: obtuse}))
    assert not knows_films(dataclasses.replace(scene, effects={}))
    assert not knows_films(dataclasses.replace(scene, liquids=scene.liquids[:1]))
    third = Material("third", density=1000.0, dynamic_viscosity=1e-3)
    assert not knows_films(dataclasses.replace(scene, liquids=(*scene.liquids, third)))
    # Under gas a film is thinner: 1.34 R Ca^(2/3) itself is the least.
    under_gas = Wetting.of(dataclasses.replace(scene, liquids=(scene.liquids[0], gas)), VOLUME)
    fast = np.array([1.0])
    assert under_gas.deposit(fast)[0, 0] == pytest.approx(bretherton(1.0)[0] / 2.0 ** (2.0 / 3.0))


def test_the_table_holds_three_shares_that_add_up(scene, tmp_path):
    initial = synthetic_frames.ball()
    position = initial["fluid_position"]
    for index in range(8):
        fraction = synthetic_frames.oil_fraction(position, height=8e-3 - 1.5e-3 * index)
        write_frame(frame_path(tmp_path, index), synthetic_frames.frame_of(position, fraction, time=0.1 * index))
    table = metrics.measure(scene, initial, sorted(tmp_path.glob("*.vtu")))
    for part in ("whole", "superior", "inferior", "macula"):
        contact, film, bare, coverage = (table[f"retina_{name}_{part} [%]"]
                                         for name in ("contact", "film", "bare", "coverage"))
        assert contact + film == pytest.approx(coverage, abs=1e-9)
        assert contact + film + bare == pytest.approx(100.0, abs=1e-9)
        assert min(contact.min(), film.min(), bare.min()) >= 0.0
    assert table["retina_film_whole [%]"][0] == 0.0 and table["retina_film_whole [%]"][-1] > 20.0
    least, greatest = (table[f"retina_film_thickness_{end} [um]"] for end in ("smallest", "largest"))
    assert np.isnan(least[0]) and 20.0 < least[-1] < greatest[-1] < 300.0
    without = dataclasses.replace(scene, effects={})
    assert not any("film" in column for column in metrics.measure(without, initial, sorted(tmp_path.glob("*.vtu"))))
