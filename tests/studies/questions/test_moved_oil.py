"""The study of movements: what is read of them, the exact sphere beside, and the page that a surgeon reads."""
import re

import numpy as np
import pytest
from conftest import ROOT

from pipeline.base.errors import UserError
from pipeline.cavity.signed_distance_grid import SignedDistance
from pipeline.equilibrium.of_scene import depth_in_oil
from pipeline.equilibrium.rest import Liquids, at_rest
from pipeline.equilibrium.star_cavity import COARSE, StarCavity
from pipeline.measures.interface_shift import InterfaceShift
from pipeline.scenes.load import load_scene
from pipeline.studies.model import Outcome
from pipeline.studies.plan import load_study
from pipeline.studies.report import write_study
from sim.effects.eye_rotation import Saccade
from studies.questions.moved_oil import moved_oil
from studies.questions.moved_oil._words import (
    COURSES,
    EXACT_STRESS,
    HIGH_STRESS,
    JOLT,
    MOVEMENTS,
    SACCADES,
    SHIFT,
    STANDING_UP,
    STRESS,
    WAY_LEFT,
    time_to_make,
)
from studies.validation.turned_sphere import Turned

SPACING = 1e-3


@pytest.fixture
def study(monkeypatch):
    monkeypatch.chdir(ROOT)
    return load_study("oil_study")


@pytest.mark.parametrize("moved", [0.3, -0.8])
def test_shift_of_a_flat_interface_is_how_far_it_moved(moved):
    """Particles in disorder, oil above a plane: all moved by a part of a spacing, the shift is that, within a tenth."""
    rng = np.random.default_rng(1)
    lattice = np.stack(np.meshgrid(*3 * [np.arange(-8, 9)], indexing="ij"), axis=-1).reshape(-1, 3)
    volume = np.full(len(lattice), SPACING**3)

    def particles(height):
        position = SPACING * (lattice + rng.uniform(-0.2, 0.2, lattice.shape) + [0.0, height, 0.0])
        return position, volume, (lattice[:, 1] > 0).astype(float)

    nodes = np.arange(-10, 11)
    box = SPACING * np.max(np.abs(np.stack(np.meshgrid(*3 * [nodes], indexing="ij"))) - 8.0, axis=0)
    distance = SignedDistance(box, np.full(3, -10 * SPACING), SPACING)
    shift = InterfaceShift(distance, SPACING, 2.5 * SPACING, *particles(0.0)).of(*particles(moved))
    assert len(shift) > 100
    assert np.median(shift) == pytest.approx(moved * SPACING, abs=0.1 * SPACING)
    assert np.percentile(np.abs(shift - np.median(shift)), 90) < 0.25 * SPACING


def test_particles_deep_in_the_oil_are_told_from_those_outside():
    sphere = StarCavity.of_level(lambda points: np.linalg.norm(points, axis=-1) - 11e-3, np.zeros(3), COARSE)
    rest = at_rest(sphere, Liquids(35.0, 0.04, np.radians(18.2)), np.array([0.0, -1.0, 0.0]), 0.8)
    depth = depth_in_oil(rest, np.array([[0.0, 5e-3, 0.0], [0.0, -10.5e-3, 0.0], [0.0, 10.5e-3, 0.0]]))
    assert depth[0] == pytest.approx(6e-3, abs=2e-4) and depth[1] < -1e-3 and depth[2] == pytest.approx(5e-4, abs=1e-4)
    assert rest.other.center[1] < -6e-3 and abs(rest.other.center[0]) < 1e-4


def test_stiff_oil_drags_at_a_sphere_as_its_moment_of_inertia_asks():
    """Liquid that turns as a whole with the wall asks for rho R^2 dw/dt / 5 at the equator."""
    saccade = Saccade(0.0, np.radians(20.0), (0.0, 1.0, 0.0))
    time = 0.25 * saccade.lasts
    change = (saccade.rate(time + 1e-5) - saccade.rate(time - 1e-5)) / 2e-5
    for modes in (20, 200):
        exact = Turned(saccade, 0.05, 970.0, 11e-3, modes=modes)
        assert abs(exact.stress(time)) == pytest.approx(970.0 * 11e-3**2 * change / 5.0, rel=5e-3)


def test_time_to_make_a_way_is_read_between_readings_and_unknown_where_it_is_not_made():
    times, made = [0.0, 1.0, 2.0, 3.0], [0.0, 0.6, 0.4, 1.0]
    assert moved_oil.time_of(times, made, 0.5) == pytest.approx(2.0 + 1.0 / 6.0)  # not when it is lost again
    assert np.isnan(moved_oil.time_of(times[:3], made[:3], 0.5))


def test_an_oil_changes_the_liquids_and_standing_up_turns_gravity(study):
    scene = load_scene(ROOT / "config" / "scenes" / "resting_eye.yaml", "draft")
    for name, turns in (("moved_oil-shaken-heavy_oil_densiron_68-1", 0),
                        ("moved_oil-standing_up-silicone_oil_5700-1.5", 1)):
        case = study.case(name).parameters
        changed = moved_oil.changed(case, scene)
        assert changed.liquids[1].name == case.oil and set(changed.initial.fill) == {"aqueous", case.oil}
        assert len(changed.effects["gravity"].turns) == turns
        assert ("eye_rotation" in changed.effects) == (turns == 0)
        assert changed.numerics.particle_spacing == pytest.approx(case.coarser * 1e-3)
    assert changed.liquids[1].dynamic_viscosity == pytest.approx(5.53, abs=0.01)  # 5700 cSt


def test_an_unknown_oil_is_refused_with_those_that_there_are(study, tmp_path):
    (tmp_path / "one.yaml").write_text("cases: {moved_oil: {movement: shaken, oil: olive_oil}}")
    with pytest.raises(UserError, match='oil is "olive_oil", but must be one of silicone_oil_1000'):
        load_study("one", folder=tmp_path)


def outcomes() -> list[Outcome]:
    """Two oils and, of the first, finer particles that read a tenth more."""
    found = []
    for oil, viscosity, spacing, factor in (("silicone_oil_1000", 1000, 1.0, 1.0),
                                            ("silicone_oil_5000", 5000, 1.0, 1.1),
                                            ("silicone_oil_1000", 1000, 0.5, 1.1)):
        heads = [oil, str(viscosity), "970", str(spacing)]
        lines = [[*heads, movement, quantity, str(value * factor), spread, "0.1", unit]
                 for movement, size in ((SACCADES, 5.0), (JOLT, 0.5))
                 for quantity, value, spread, unit in ((STRESS, size, "0.2", "Pa"), (HIGH_STRESS, 8 * size, "1", "Pa"),
                                                       (SHIFT, 0.4, "0.01", "mm"))]
        lines.append([*heads, SACCADES, EXACT_STRESS, "6.5", "", "", "Pa"])
        lines += [[*heads, STANDING_UP, time_to_make(0.5), str(4 * viscosity / 1000), "", "", "s"],
                  [*heads, STANDING_UP, time_to_make(0.8), "" if viscosity > 1000 else "7", "", "", "s"],
                  [*heads, STANDING_UP, WAY_LEFT, "85", "", "", "%"]]
        courses = [[*heads, movement, str(0.01 * n), str(n), "1"] for movement in (SACCADES, STANDING_UP)
                   for n in range(1, 5)]
        found.append(Outcome(case=f"{oil}-{spacing}", tables={"movements": [list(MOVEMENTS), *lines],
                                                              "courses": [list(COURSES), *courses]}))
    return found


def test_the_page_says_what_finer_particles_change_and_what_is_not_known(study, tmp_path):
    write_study(study, outcomes(), tmp_path)
    text = (tmp_path / "table.html").read_text(encoding="utf-8")
    assert "illustration of physics, not for decisions on a patient" in text and "&lt;" not in text
    answers = text[text.index('class="answers"'):text.index("<figure>")]
    assert "on the retina is 5.0 ± 0.7 Pa with oil 1000, 5.5 ± " in answers  # the finer particles left out
    assert "5.0 ± 0.7" in text                          # a spread of 0.2, and 10 % by finer particles
    assert "4.0 ± 1.4</td>" in text                     # a spread of 1, and 10 % by finer particles
    assert "–</td>" in text                             # the thick oil has not made its way
    assert re.search(r"80 % of the way to rest takes 7\.0 ± 0\.6 s with oil 1000\.", answers)
    assert "With oil 5000 it takes longer than was simulated." in answers
    assert "a film of aqueous on the wall would let all slide sooner" in text
    assert 'href="../../../../docs/results/turning_eye.md"' in text
    for name in study.pictures():
        assert (tmp_path / f"{name}.png").stat().st_size > 1000
    assert all((tmp_path / f"{name}.csv").is_file() for name in study.tables())
