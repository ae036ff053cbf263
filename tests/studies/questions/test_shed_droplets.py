"""The study of emulsification: the law on shapes at rest, the way of droplets, and the page that a surgeon reads."""
import numpy as np
import pytest
from conftest import ROOT

from pipeline.equilibrium.rest import Liquids, at_rest
from pipeline.equilibrium.star_cavity import COARSE, StarCavity
from pipeline.scenes.load import load_scene
from pipeline.studies.plan import load_study
from pipeline.studies.report import write_study
from studies.questions.shed_droplets import shed_droplets

RADIUS = 11e-3
UP = np.array([0.0, 1.0, 0.0])


@pytest.fixture(scope="module")
def rest():
    """Light oil in a sphere, the patient upright."""
    sphere = StarCavity.of_level(lambda points: np.linalg.norm(points, axis=-1) - RADIUS, np.zeros(3), COARSE)
    return at_rest(sphere, Liquids(35.0, 0.04, np.radians(18.2)), -UP, 0.7)


@pytest.fixture
def parts(monkeypatch):
    monkeypatch.chdir(ROOT)
    case = load_study("emulsion_study").case("shed_droplets-False").parameters
    return case, load_scene(ROOT / "config" / "scenes" / f"{shed_droplets.SCENE}.yaml", "draft")


@pytest.mark.thorough
def test_droplets_that_rise_end_at_the_contact_line_and_those_that_sink_at_the_bottom(rest):
    """The line of oil in a sphere is level, and the highest place of the aqueous."""
    middle, length = shed_droplets.line_of(rest)
    height = middle[:, 1].mean()
    assert length.sum() == pytest.approx(2.0 * np.pi * np.sqrt(RADIUS**2 - height**2), rel=0.02)
    start = np.random.default_rng(0).uniform(-1.0, 1.0, (60, 3)) * [5e-3, 5e-4, 5e-3] - [0.0, 9.5e-3, 0.0]
    risen, sunk = (shed_droplets.risen(rest, start, way) for way in (UP, -UP))
    assert np.median(risen[:, 1]) == pytest.approx(height, abs=1e-3)
    assert np.percentile(risen[:, 1], 10) > start[:, 1].max()
    assert sunk[:, 1].max() < -10.8e-3
    assert (np.linalg.norm(risen, axis=1) < RADIUS + 1e-5).all()


@pytest.mark.thorough
def test_droplets_follow_the_law_and_the_shape(parts):
    """In proportion to one over the viscosity; to one over the tension but for the shape, whose line grows shorter."""
    case, scene = parts
    study = shed_droplets.Study(case, scene)
    shed, line = study.shed()
    assert study.shed(oil="silicone_oil_5000")[0] == pytest.approx(shed / 5.0)
    low, short = study.shed(tension=0.02)
    assert 1.5 * shed < low < 2.0 * shed and short < line
    assert 26.0 * shed_droplets.WEEK * shed == pytest.approx(3.1e-6, rel=0.5)  # on moving particles


@pytest.mark.thorough
def test_the_page_tells_what_sheds_droplets_and_that_time_is_assumed(parts, tmp_path, monkeypatch):
    scene = parts[1]
    monkeypatch.setattr(shed_droplets, "TRACED", 20)
    outcome = shed_droplets.run(shed_droplets.Parameters(
        oils=("silicone_oil_1000", "silicone_oil_5000"), tensions=(0.04,), fills=(0.85,), postures=("upright",),
        contact_angles=(18.2, 25.0)), scene)
    study = load_study("emulsion_study")
    write_study(study, [outcome], tmp_path)
    text = (tmp_path / "table.html").read_text(encoding="utf-8")
    assert "illustration of physics, not for decisions on a patient" in text and "&lt;" not in text
    assert "oil 5000 sheds 0.20 times the droplets of oil 1000" in text.partition("<figure>")[0]
    assert "(an assumption)" in text
    for name in study.pictures():
        assert (tmp_path / f"{name}.png").stat().st_size > 1000
    assert all((tmp_path / f"{name}.csv").is_file() for name in study.tables())
