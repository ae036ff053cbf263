"""A scene whose oil starts at rest: where it is, what it covers, and that it stays."""
import dataclasses

import numpy as np
import pytest
from conftest import ROOT

from pipeline.base.errors import UserError
from pipeline.cavity.surface import cavity_mesh
from pipeline.cavity.voxels import voxelize
from pipeline.equilibrium import rest
from pipeline.equilibrium.contact import Contact, shares
from pipeline.equilibrium.of_scene import rest_of
from pipeline.scenes.effects import down_at_start
from pipeline.scenes.load import load_scene
from pipeline.scenes.model import AT_REST
from pipeline.simulation.solver_setup import build_solver, initial_phases
from studies.validation.rest_by_simulation import PARTS, retina_covered

FILL = 0.85


@pytest.fixture(scope="module")
def scene():
    scene = load_scene(ROOT / "config/scenes/eye_at_rest.yaml", "draft")
    assert scene.initial.shape == AT_REST
    return dataclasses.replace(scene, numerics=dataclasses.replace(scene.numerics, precision="f64", threads=0))


@pytest.fixture(scope="module")
def initial(taichi, scene):
    return voxelize(scene, cavity_mesh(scene.eye)[0])[0]


def in_posture(scene, posture):
    gravity = dataclasses.replace(scene.effects["gravity"], posture=posture)
    return dataclasses.replace(scene, effects=scene.effects | {"gravity": gravity})


@pytest.mark.thorough
@pytest.mark.parametrize("posture", ["upright", "prone"])
def test_oil_starts_where_it_rests_in_the_posture_of_the_scene(scene, initial, posture):
    """A shape of least energy, read from particles by the rule of the metrics: 2 points are what particles tell."""
    scene, position = in_posture(scene, posture), initial["fluid_position"]
    down = down_at_start(scene)
    phase = initial_phases(scene, position, down)
    assert (phase == 1).sum() == round(FILL * len(phase))
    exact = shares(Contact.of(rest_of(scene, down, FILL)))
    found = retina_covered(scene, initial, position, (phase == 1).astype(float))
    assert found == pytest.approx([100.0 * exact[name] for name in PARTS], abs=2.0)
    level = dataclasses.replace(scene.initial, shape="level")
    flat = initial_phases(dataclasses.replace(scene, initial=level), position, down)
    assert np.mean(flat != phase) > 0.02


@pytest.mark.thorough
def test_oil_at_rest_hardly_moves(taichi, scene):
    """In 40 ms the level oil of the same scene moves more than twice as fast; particles of 1.6 mm tell that too."""
    scene = dataclasses.replace(scene, numerics=dataclasses.replace(scene.numerics, particle_spacing=1.6e-3))
    initial, speed = voxelize(scene, cavity_mesh(scene.eye)[0])[0], {}
    for shape in (AT_REST, "level"):
        solver = build_solver(dataclasses.replace(
            scene, initial=dataclasses.replace(scene.initial, shape=shape)), initial)
        for _ in solver.advance(0.04):
            pass
        speed[shape] = np.sqrt((solver.particles.to_numpy("velocity") ** 2).sum(axis=1).mean())
    assert speed[AT_REST] < 0.5 * speed["level"]


@pytest.mark.thorough
@pytest.mark.parametrize(("posture", "axis", "way"), [("upright", 1, 1), ("prone", 2, -1), ("left_side", 0, -1)])
def test_a_small_fill_starts_as_a_bubble_at_the_wall(scene, initial, posture, axis, way):
    """2 %, a ball of 6 mm: where it starts, the wall is nearer than its radius."""
    scene, position = in_posture(scene, posture), initial["fluid_position"]
    scene = dataclasses.replace(scene, initial=dataclasses.replace(
        scene.initial, fill={"silicone_oil_1000": 0.02, "aqueous": 0.98}))
    oil = position[initial_phases(scene, position, down_at_start(scene)) == 1]
    assert len(oil) == round(0.02 * len(position)) and way * oil[:, axis].mean() > 7e-3
    assert np.linalg.norm(oil - oil.mean(axis=0), axis=1).max() < 4.5e-3


@pytest.mark.thorough
def test_a_shape_that_is_not_found_is_one_sentence(monkeypatch, scene, initial):
    monkeypatch.setattr(rest, "STEPS", 1)
    with pytest.raises(UserError, match=r"initial\.shape: no shape of 85 % oil at rest was found.*write level"):
        initial_phases(scene, initial["fluid_position"], down_at_start(scene))
