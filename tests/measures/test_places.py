"""Breaks and regions: where they are, what oil covers of them, how it presses, and when."""
import dataclasses
import json

import numpy as np
import pytest
import pyvista
from helpers import synthetic_frames

from pipeline import metrics
from pipeline.base.errors import UserError
from pipeline.base.frame_files import frame_path, write_frame
from pipeline.base.tables import read_table
from pipeline.base.vtk_files import write_vtk
from pipeline.cavity.initial_state import save_initial
from pipeline.equilibrium.star_cavity import icosphere
from pipeline.exchange.run_index import write_places
from pipeline.measures import place_metrics
from pipeline.measures.frame_view import Measured
from pipeline.measures.place_course import Times, courses_of, covered_spans
from pipeline.measures.places import FARTHEST, Places
from pipeline.pictures.fundus_map import BREAK_COLOR, FundusMap
from pipeline.scenes.model import Break, Eye, Material, Output, Region, Scene
from pipeline.scenes.retina import Patch, direction
from sim.settings import Numerics

RADIUS, SPACING = synthetic_frames.RADIUS, synthetic_frames.SPACING
AQUEOUS = Material("aqueous", density=1005.0, dynamic_viscosity=7e-4)
OIL = Material("silicone_oil_1000", density=970.0, dynamic_viscosity=1.0)
ABOVE = Break("above", hour=12.0, latitude=np.radians(90.0), width=1.0)
BELOW = Break("below", hour=6.0, latitude=np.radians(90.0), width=1.0)
LOWER_HALF = Region("lower", part="inferior", latitudes=(np.radians(60.0), np.radians(110.0)))


@pytest.fixture(scope="module")
def ball():
    points, faces = icosphere(4)
    return synthetic_frames.ball(), RADIUS * points, faces


def measured(ball, *, breaks=(ABOVE, BELOW), regions=(), height=2e-3, pressure=None, side="right"):
    initial, points, faces = ball
    scene = Scene(name="ball", accuracy="draft", liquids=(AQUEOUS, OIL), numerics=Numerics(SPACING), eye=Eye(side=side),
                  output=Output(duration=1.0), breaks=tuple(breaks), regions=tuple(regions))
    position = initial["fluid_position"]
    frame = synthetic_frames.frame_of(position, synthetic_frames.oil_fraction(position, height=height))
    if pressure is not None:
        frame = dataclasses.replace(frame, pressure=pressure(position).astype(np.float32))
    return Measured(scene, initial, frame, Places.of(scene, points, faces))


def test_a_break_is_covered_where_the_oil_is(ball):
    state = measured(ball)
    assert place_metrics.break_covered(state) == {"above": 1.0, "below": 0.0}
    assert place_metrics.break_coverage(state) == {"above": 100.0, "below": 0.0}
    below = measured(ball, height=-12e-3)
    assert place_metrics.break_covered(below) == {"above": 1.0, "below": 1.0}
    assert place_metrics.break_margin(below)["below"] == 1e3 * FARTHEST


@pytest.mark.parametrize("height", [-3e-3, 0.0, 4e-3])
def test_the_margin_is_the_way_to_the_contact_line(ball, height):
    one = Patch(0.0, 90.0, 30.0, 10.0)
    found = place_metrics.break_margin(measured(ball, height=height))["above"]
    line = RADIUS * np.array([0.0, height / RADIUS, np.sqrt(1.0 - (height / RADIUS) ** 2)])
    meridian, latitude, _ = one.grid(1.0)
    around = np.linspace(0.0, 2.0 * np.pi, 721)
    circle = np.stack([np.cos(around) * line[2], np.full(721, height), np.sin(around) * line[2]], axis=1)
    expected = np.linalg.norm(RADIUS * direction(meridian, latitude)[:, None] - circle, axis=2).min()
    assert found == pytest.approx(1e3 * expected, abs=0.8e3 * SPACING)


def test_a_break_at_the_line_is_covered_in_part_and_uncertain(ball):
    state = measured(ball, breaks=[Break("edge", hour=3.0, latitude=np.radians(90.0), width=1.0)], height=0.0)
    assert place_metrics.break_coverage(state)["edge"] == pytest.approx(50.0, abs=20.0)
    assert place_metrics.break_coverage_band(state)["edge"] > 20.0
    small = measured(ball, breaks=[Break("small", hour=3.0, latitude=np.radians(90.0), diameter=0.2e-3)], height=0.0)
    assert place_metrics.break_covered(small)["small"] == 0.5


def test_the_coverage_of_a_region_is_its_area_above_the_level(ball):
    everything = Region("all", latitudes=(0.0, np.radians(115.0)))
    state = measured(ball, regions=[everything, LOWER_HALF], height=0.0)
    found = place_metrics.region_coverage(state)
    assert found["all"] == pytest.approx(50.0, abs=5.0)
    assert found["lower"] == pytest.approx(0.0, abs=4.0)
    whole = 100.0 * state.wall.covered_share(state.wall.retina_masks()["whole"])
    assert found["all"] == pytest.approx(whole, abs=1.5)


def test_temporal_is_on_the_side_of_the_eye(ball):
    temporal = Region("temporal", part="temporal")
    for side, x in (("right", -1.0), ("left", 1.0)):
        places = measured(ball, regions=[temporal], side=side).places.regions["temporal"]
        assert (x * places.position[:, 0] > -1e-9).all()


def test_the_contact_pressure_is_the_jump_and_the_buoyancy(ball):
    gravity, jump, height = np.array([0.0, -9.81, 0.0]), 7.0, 2e-3
    noise = np.random.default_rng(0)

    def pressure(position):
        oil = position[:, 1] > height
        level = np.where(oil, 970.0, 1005.0) * (position @ gravity)
        return level + jump * oil + 0.5 * noise.standard_normal(len(position))

    state = measured(ball, pressure=pressure, height=height)
    middle = np.average(state.places.breaks["above"].position[:, 1], weights=state.places.breaks["above"].share)
    assert place_metrics.break_pressure(state)["above"] == pytest.approx(jump + 35.0 * 9.81 * middle, abs=0.2)
    assert 0.0 < place_metrics.break_pressure_band(state)["above"] < 1.0
    assert np.isnan(place_metrics.break_pressure(state)["below"])


def test_pressure_that_is_not_hydrostatic_is_uncertain(ball):
    def pressure(position):
        return 970.0 * (position @ np.array([0.0, -9.81, 0.0])) + 20.0 * (position[:, 1] > 8e-3)

    assert place_metrics.break_pressure_band(measured(ball, pressure=pressure))["above"] > 20.0


# Over time

def test_spans_begin_and_end_between_frames():
    time = np.linspace(0.0, 4.0, 5)
    assert covered_spans(time, np.array([-1.0, 1.0, 1.0, -3.0, -1.0])) == [(0.5, 2.25)]
    assert covered_spans(time, np.ones(5)) == [(0.0, 4.0)] and covered_spans(time, -np.ones(5)) == []
    found = Times.of(time, np.array([1.0, -1.0, -1.0, 1.0, 1.0]))
    assert found == Times(first_covered=0.0, longest_bare=2.0, covered_share=0.5)


def test_a_course_tells_when_and_how_sure(ball):
    scene = measured(ball).scene
    time = np.linspace(0.0, 1.0, 11)
    table = {"time [s]": time, "break_margin_above [mm]": np.linspace(-1.0, 1.0, 11),
             "break_margin_below [mm]": np.full(11, -5.0)}
    above, below = courses_of(table, scene)
    assert above.times.first_covered == pytest.approx(0.5) and above.times.covered_share == pytest.approx(0.5)
    assert above.most.first_covered == pytest.approx(0.2) and above.least.first_covered == pytest.approx(0.8)
    assert "first covered after 0.5 s (0.2 s to 0.8 s)" in above.sentence()
    assert "never covered" in below.sentence() and below.record()["times [s]"]["first_covered"] is None
    assert below.record()["times [s]"]["longest_bare"] == 1.0
    lapse = dataclasses.replace(scene, output=dataclasses.replace(scene.output, second_means=14400.0))
    assert "longest time not covered 2 h" in courses_of(table, lapse)[0].sentence()


# Where they are

def chart(point):
    """Meridians, from 0 to 360, and latitudes (n,) of points (n, 3), degrees: the inverse of `direction`."""
    x, y, z = np.asarray(point, float).T
    return np.degrees(np.arctan2(x, y)) % 360.0, np.degrees(np.arctan2(np.hypot(x, y), -z))


def on(patch, points):
    """Which points (n, 3) are on a patch, seen from the center of the globe, (n,) bool."""
    meridian, latitude = chart(points)
    apart = (meridian - patch.meridian + 180.0) % 360.0 - 180.0
    return (np.abs(apart) <= 0.5 * patch.width) & (latitude >= patch.low) & (latitude <= patch.high)


def test_a_patch_holds_its_own_points_and_its_outline_goes_around_it():
    for one in (Patch(350.0, 60.0, 40.0, 10.0), Patch(0.0, 0.0, 360.0, 12.0), Patch(180.0, 100.0, 120.0, 30.0)):
        meridian, latitude, share = one.grid(1.0)
        assert share.sum() == pytest.approx(1.0)
        inner = dataclasses.replace(one, width=one.width + 1e-6, height=one.height + 1e-6)
        assert on(inner, direction(meridian, latitude)).all()
        _, edge = chart(one.outline())
        assert edge.max() == pytest.approx(one.high) and np.allclose(one.outline()[0], one.outline()[-1])


@pytest.mark.parametrize(("hour", "clock"), [
    (12.0, "12 o'clock"), (0.5, "12:30 o'clock"), (3.0, "3 o'clock"), (5.999, "6 o'clock"), (10.25, "10:15 o'clock"),
    (11.999, "12 o'clock")])
def test_places_are_told_as_a_clock_tells_hours(hour, clock):
    one = Break("tear", hour=hour, latitude=np.radians(60.0), width=1.0)
    assert one.patch(11e-3).words("right").startswith(f"{clock} (")


def test_a_diameter_is_a_length_on_the_retina():
    patch = Break("hole", hour=3.0, latitude=np.radians(30.0), diameter=2e-3).patch(11e-3)
    assert np.radians(patch.height) * 11e-3 == pytest.approx(2e-3)
    assert np.radians(patch.width) * np.sin(np.radians(30.0)) * 11e-3 == pytest.approx(2e-3)


# Stages and pictures

def surface(ball):
    _, points, faces = ball
    return pyvista.PolyData.from_regular_faces(points, faces)


@pytest.mark.thorough
def test_the_stage_writes_columns_bars_and_when_breaks_were_covered(ball, tmp_path, capsys):
    scene = measured(ball, regions=[LOWER_HALF]).scene
    (tmp_path / "scene.json").write_text(scene.to_json())
    save_initial(tmp_path / "initial.npz", ball[0])
    write_vtk(surface(ball), tmp_path / "eye.vtp")
    position = ball[0]["fluid_position"]
    for number, height in enumerate((12e-3, 9e-3, 5e-3, 0.0)):
        fraction = synthetic_frames.oil_fraction(position, height=height)
        write_frame(frame_path(tmp_path / "frames", number), synthetic_frames.frame_of(position, fraction,
                                                                                      time=0.1 * number))
    arguments = [str(tmp_path / name) for name in ("scene.json", "initial.npz", "frames")]
    arguments += ["--output", str(tmp_path / "metrics.csv"), "--summary", str(tmp_path / "metrics.html"), "--plots",
                  str(tmp_path / "plots"), "--meanings", str(tmp_path / "metrics.json")]
    with pytest.raises(UserError, match="add --eye"):
        metrics.main(arguments)
    metrics.main([*arguments, "--eye", str(tmp_path / "eye.vtp")])
    table = read_table(tmp_path / "metrics.csv")
    assert table["break_covered_above [1]"][[0, -1]].tolist() == [0.0, 1.0]
    assert (table["break_covered_below [1]"] == 0.0).all() and "region_coverage_lower [%]" in table
    above, below = json.loads((tmp_path / "metrics.json").read_text())["breaks"]
    assert 0.0 < above["times [s]"]["first_covered"] < 0.3 and below["times [s]"]["first_covered"] is None
    assert (tmp_path / "plots" / "break_covered.png").is_file()
    page = (tmp_path / "metrics.html").read_text()
    assert "longest time not covered" in page and "12 o&#39;clock (superior)" in page
    assert "Break below: at the end not covered in part" in capsys.readouterr().out


def test_a_map_shows_the_break_in_its_place(ball):
    wall = surface(ball)
    for name in ("contact_distance", "oil_fraction_covered", "oil_fraction_bare"):
        wall.point_data[name] = np.zeros(wall.n_points)
    one = Patch(90.0, 60.0, 30.0, 15.0)  # three o'clock
    chart = FundusMap(ball[1], (400, 400), captions=False, outlines={"tear": one.outline()})
    pixels = np.asarray(chart.draw(wall, uncertain=0.0), int)
    rows, columns = np.nonzero((np.abs(pixels - BREAK_COLOR) < 30).all(axis=-1))
    expected = chart.place(direction(np.array([90.0]), np.array([60.0]))[0])
    np.testing.assert_allclose([columns.mean(), rows.mean()], expected, atol=5.0)
    assert columns.min() > 210


def test_places_are_a_part_of_the_index_of_a_run(ball, tmp_path):
    write_vtk(surface(ball), tmp_path / "eye.vtp")
    scene = measured(ball, regions=[LOWER_HALF]).scene
    assert write_places(tmp_path / "places.vtp", scene, tmp_path / "eye.vtp")
    found = pyvista.read(tmp_path / "places.vtp")
    names = bytes(found.field_data["places"]).decode().split()
    assert names == ["break_above", "break_below", "region_lower"]
    centers = found.cell_centers().points
    patches = [*scene.patches(RADIUS)["breaks"].values(), scene.patches(RADIUS)["regions"]["lower"]]
    for index, patch in enumerate(patches):
        assert on(patch, centers[found.cell_data["place"] == index]).all()
    assert not write_places(tmp_path / "none.vtp", dataclasses.replace(scene, breaks=(), regions=()),
                            tmp_path / "eye.vtp")
