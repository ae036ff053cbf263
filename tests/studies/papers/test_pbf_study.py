"""The study of position-based fluids: its measures of given particles, its references and its command line."""

import numpy as np
import pytest
from helpers import forked
from helpers.synthetic_frames import SPACING, frame_of

from studies.papers import position_based as study


def lattice(*counts):
    """Return the points of a lattice, (n, 3), m."""
    return SPACING * np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(-1, 3)


def frame(position):
    """Return a frame of one liquid."""
    return frame_of(position, np.zeros(len(position)))


def test_sphericity_of_a_cube_and_of_a_ball():
    assert study.sphericity(frame(lattice(6, 6, 6))) == pytest.approx((np.pi / 6.0) ** (1.0 / 3.0), rel=1e-5)
    points = np.random.default_rng(0).normal(size=(4000, 3))
    ball = 20.0 * SPACING * points / np.linalg.norm(points, axis=1, keepdims=True)
    assert study.sphericity(frame(ball)) == pytest.approx(1.0, abs=5e-3)


def test_spread_of_an_even_disk():
    points = lattice(61, 2, 61)
    points -= points.mean(axis=0)
    disk = points[np.linalg.norm(points[:, [0, 2]], axis=1) < 25.0 * SPACING]
    assert study.spread(frame(disk)) == pytest.approx(25.0 * SPACING * np.sqrt(study.SPREAD), rel=0.02)


def test_spacings_tell_clumps():
    points = lattice(4, 4, 4)
    points[0] = points[1] + [0.1 * SPACING, 0.0, 0.0]
    found = study.spacings(frame(points))
    assert found[0] == pytest.approx(0.1, rel=1e-4) and np.median(found) == pytest.approx(1.0, rel=1e-4)


def test_references():
    """R grows with the eighth root of time; a puddle of water is 5.4 mm high."""
    first, later = (study.huppert_radius(1e-3, 7e-3, time) for time in (1.0, 256.0))
    assert later == pytest.approx(2.0 * first)
    assert study.puddle_height(0.072, 1000.0) == pytest.approx(5.42e-3, rel=1e-3)


@pytest.mark.thorough
def test_study_lists_its_cases():
    result = forked.run("pipeline.study", "pbf_study", "--list")
    assert result.returncode == 0, result.stderr
    assert result.stdout.split()[-5:] == ["position_based", "shear_wave-0.1-coefficient", "shear_wave-0.5-coefficient",
                                          "shear_wave-0.1-own", "shear_wave-0.1-none"]


def test_study_refuses_scenes_that_were_not_run(project):
    """A table of failures would pass for the study's result."""
    result = forked.run("pipeline.study", "pbf_study", folder=project.folder)
    assert result.returncode == 2
    assert result.stderr.startswith("error: position_based reads outputs/")
    assert "snakemake -j2 pbf_study" in result.stderr
    assert not list(project.folder.glob("outputs/studies/*"))
