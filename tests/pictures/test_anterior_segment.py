"""The front of the eye that is drawn around a cavity fits it, whatever the eye."""
import numpy as np
import pytest

from pipeline.pictures.anterior_segment import ANGLE, anterior_segment
from pipeline.scenes.eye_shape import shape_of
from pipeline.scenes.model import LENSES, Eye


@pytest.fixture(params=[(length, lens) for length in (0.020, 0.024, 0.032) for lens in LENSES],
                ids=lambda one: f"{1e3 * one[0]:.0f} mm, {one[1]}")
def eye(request):
    length, lens = request.param
    return Eye(axial_length=length, lens=lens)


def in_section(outline):
    """Points (n, 3) of an outline."""
    across, height = outline
    return np.stack([np.zeros_like(across), across, height], axis=-1)


def test_cornea_goes_over_into_the_sclera_without_a_step(eye):
    segment, angle = anterior_segment(eye), np.linspace(0.0, np.pi, 20_000)
    outside, inside = segment.outside(angle), segment.inside(angle)
    assert np.abs(np.diff(outside)).max() < 5e-6 and np.abs(np.diff(inside)).max() < 5e-6
    assert (outside - inside).min() > 0.2e-3 and (outside - inside).max() < 2.5e-3
    assert outside[0] == pytest.approx(segment.apex)


def test_iris_and_ciliary_body_are_before_the_cavity_and_behind_the_cornea(eye):
    segment, shape = anterior_segment(eye), shape_of(eye)
    for across, height in (segment.iris(), segment.processes()):
        assert (np.hypot(across, height) < segment.outside(np.arctan2(across, height))).all()
    iris = in_section(segment.iris())
    assert (shape.level(iris) > -0.05e-3).all()
    assert iris[:, 1].max() > ANGLE and iris[:, 2].min() > segment.front - 0.1e-3


def test_lens_is_what_the_cavity_leaves_room_for(eye):
    segment, shape = anterior_segment(eye), shape_of(eye)
    if eye.lens == "phakic":
        height = np.linspace(segment.lens_pole - 2e-3, segment.apex, 4001)
        within = height[segment.lens_level(np.zeros_like(height), height) < 0.0]
        assert within.min() == pytest.approx(segment.lens_pole, abs=5e-6) and np.ptp(within) == pytest.approx(
            3.6e-3, abs=1e-5)
        points = in_section((np.zeros_like(within), within))
        assert (shape.level(points) > -5e-6).all()
    elif eye.lens == "pseudophakic":
        assert (shape.level(in_section(segment.implant())) > 0.0).all()
        assert segment.implant()[1].max() < segment.iris_plane + 0.1e-3


def test_nothing_is_made_up_before_a_users_mesh():
    assert anterior_segment(Eye(model="mesh", path="eye.stl")) is None
