"""Light through a glass ball is that of the equations; a still shows the frame that was asked for."""
import numpy as np
import pytest

from pipeline import still
from pipeline.base.errors import UserError
from pipeline.cavity.regions import CHAMBER_REGIONS, MESH_REGIONS
from pipeline.cavity.signed_distance_grid import distance_of_function
from pipeline.pictures.path_tracer import Camera, Light, Model, PathTracer

RADIUS, FAR_AWAY = 9e-3, 1.0
SKY = {"horizon": 1.0, "zenith": 1.0, "lamps": ()}


@pytest.fixture
def ball(taichi):
    """A ball of oil far inside a wall, 1 m above a white table."""
    grid = distance_of_function(lambda points: np.linalg.norm(points, axis=-1) - RADIUS, [-RADIUS] * 3, [RADIUS] * 3,
                                0.5e-3, 2e-3)
    apart = np.full(grid.values.shape, -FAR_AWAY)
    color = np.ones((*grid.values.shape, 3))
    return Model(apart, grid.values, color, grid.origin, grid.cell, np.array([0.0, 1.0, 0.0]), -FAR_AWAY,
                 np.array([1.0, 0.0, 0.0]))


def test_a_glass_ball_in_an_even_sky_is_not_seen(ball):
    tracer = PathTracer(ball, Light(**SKY, absorption=(0.0, 0.0, 0.0), table=(1.0, 1.0, 1.0)))
    camera = Camera(np.array([0.05, 0.0, 0.0]), np.zeros(3), np.radians(40.0))
    whole = tracer.trace(camera, (24, 16), 8)
    assert np.mean(np.abs(whole / 8 - 1.0) < 1e-5) > 0.97   # else light still runs around in the ball
    parts = tracer.trace(camera, (24, 16), 3) + tracer.trace(camera, (24, 16), 5, first=3)
    assert np.abs(parts - whole).max() < 1e-5 * 8


def test_an_absorbing_ball_has_the_light_of_its_axis_in_the_middle(ball):
    absorption = np.array([20.0, 60.0, 120.0])
    tracer = PathTracer(ball, Light(**SKY, absorption=tuple(absorption), table=(1.0, 1.0, 1.0)))
    camera = Camera(np.array([0.05, 0.0, 0.0]), np.zeros(3), np.radians(0.4))
    found = tracer.trace(camera, (16, 16), 64).mean((0, 1)) / 64
    passed, back = np.exp(-2.0 * RADIUS * absorption), (0.40 / 2.40) ** 2
    assert found == pytest.approx(back + (1.0 - back) ** 2 * passed / (1.0 - back * passed), abs=0.01)  # (Z5)


def test_up_is_against_gravity_and_the_eye_is_opened_across_it():
    for gravity in ([0, -9.81, 0], [0, 0, -9.81], [9.81, 0, 0], [-3.0, -9.0, 1.0], [0, 0, 0]):
        up, opened = still.picture_axes(np.array(gravity, float))
        assert np.linalg.norm(up) == pytest.approx(1.0) and np.linalg.norm(opened) == pytest.approx(1.0)
        assert up @ opened == pytest.approx(0.0, abs=1e-12) and up @ gravity == pytest.approx(-np.linalg.norm(gravity))


def test_light_of_the_white_point_is_white():
    shown = still.developed(np.array([[[0.0] * 3, [still.WHITE / still.EXPOSURE] * 3]]))
    assert shown.tolist() == [[[0, 0, 0], [255, 255, 255]]]


def test_every_part_of_a_wall_has_a_color():
    assert {*CHAMBER_REGIONS, *MESH_REGIONS} == still.INNER_COLORS.keys()


@pytest.mark.parametrize("size", ["10", "1600", "16x9000", "0x900", "wide x high"])
def test_sizes_that_cannot_be_are_told(size, capsys):
    with pytest.raises(SystemExit):
        still.main(["scene.json", "eye.vtp", "frames", "surfaces", "--output", "still.png", "--size", size])
    assert f"--size: is {size}, but must be such as 1600x900" in capsys.readouterr().err


@pytest.mark.parametrize("options, sentence", [
    (["--samples", "0"], "--samples is 0, but must be at least 1"),
    ([], "no such file; run the eye stage first"),
])
def test_wrong_options_are_told_in_one_sentence(tmp_path, options, sentence):
    with pytest.raises(UserError, match=sentence):
        still.main([*(str(tmp_path / name) for name in ("scene.json", "eye.vtp", "frames", "surfaces")),
                    "--output", str(tmp_path / "still.png"), *options])
    assert not (tmp_path / "still.png").exists()
