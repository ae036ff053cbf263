"""Which liquids are shown is one answer, whoever draws them."""
import dataclasses

import pytest
from conftest import ROOT

from pipeline.exchange.mesh_formats import colors_of
from pipeline.illustration.illustrator import oils_of
from pipeline.render import Renderer
from pipeline.scenes.load import load_scene
from pipeline.scenes.shown_liquids import liquid_around, shown_liquids


def scene_of(name):
    return load_scene(ROOT / "config" / "scenes" / f"{name}.yaml", "draft")


@pytest.mark.parametrize(("name", "around", "shown"), [
    ("tamponade", "aqueous", ["silicone_oil_1000"]),
    ("emulsification_contact_line", "aqueous", ["silicone_oil_1000"]),  # droplets are too fine to be seen
    ("s1_tamponade_gamma0", "s1_water", ["s1_silicone_oil"]),           # of two with colors
    ("collision_balls", None, ["red_gel", "blue_gel"]),                 # in air
])
def test_what_is_shown_and_in_what(name, around, shown):
    scene = scene_of(name)
    found = liquid_around(scene)
    assert (found.name if found else None) == around
    assert [liquid.name for liquid in shown_liquids(scene)] == shown
    assert {name for name, (_, opacity) in colors_of(scene).items() if opacity < 1.0} == {around, "wall"} - {None}
    if scene.container is None:
        renderer = Renderer(scene, 1.0)
        assert oils_of(scene) == shown == [scene.liquids[index].name for index in renderer.shown]
        assert renderer.water == around


def test_an_eye_full_of_aqueous_shows_no_oil():
    scene = scene_of("tamponade")
    scene = dataclasses.replace(scene, liquids=scene.liquids[:1])
    assert scene.liquids[0].clear and not shown_liquids(scene) and not oils_of(scene)
