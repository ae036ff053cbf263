"""Scene files: what they become, and what their errors say."""
import dataclasses
import json
import math
import shutil
from pathlib import Path

import pytest
from helpers import forked

from pipeline.base.errors import UserError
from pipeline.scene import main
from pipeline.scenes.folders import scene_paths
from pipeline.scenes.load import PROJECT_CONFIG, load_accuracy_levels, load_resolved, load_scene
from pipeline.scenes.materials import load_materials
from pipeline.scenes.schema import schema_text
from pipeline.scenes.units import parse_quantity
from pipeline.scenes.yaml_files import read_yaml
from sim.effects import REGISTRY

SHIPPED = list(scene_paths(PROJECT_CONFIG / "scenes").values())
LEVELS = tuple(load_accuracy_levels(PROJECT_CONFIG / "accuracy.yaml"))


@pytest.fixture
def config(tmp_path: Path) -> Path:
    """A copy of the project's configuration that a test may change."""
    return shutil.copytree(PROJECT_CONFIG, tmp_path / "config")


@pytest.fixture
def write(config: Path):
    """Write a scene file into the copied configuration and return its path."""
    def write_scene(text: str, name: str = "case") -> Path:
        path = config / "scenes" / f"{name}.yaml"
        path.write_text(text, encoding="utf-8")
        return path
    return write_scene


def errors_of(path: Path) -> tuple[str, ...]:
    with pytest.raises(UserError) as caught:
        load_scene(path, "draft")
    return caught.value.messages


# Shipped scenes

@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_scene_loads_and_survives_json(path, level, tmp_path):
    scene = load_scene(path, level)
    resolved = tmp_path / "scene.json"
    resolved.write_text(scene.to_json(), encoding="utf-8")
    assert load_resolved(resolved) == scene
    assert load_resolved(resolved).to_json() == scene.to_json()
    assert scene.name == path.stem and scene.accuracy == level


def test_tamponade_is_in_si_and_complete():
    scene = load_scene(PROJECT_CONFIG / "scenes" / "tamponade.yaml", "standard")
    assert scene.numerics.particle_spacing == 0.4e-3
    assert [liquid.name for liquid in scene.liquids] == ["aqueous", "silicone_oil_1000"]
    assert scene.liquids[1].dynamic_viscosity == 1.0
    assert scene.initial.liquid == "aqueous"
    assert scene.effects["injection"].flow == 2e-6
    assert scene.effects["injection"].cannula == (-5e-3, 5e-3, 3e-3)
    assert scene.effects["interface_tension"].contact_angle == math.radians(18.2)
    assert scene.effects["gravity"].turns[0].start == 2.3
    settings = scene.settings()
    assert settings.dimension == 3 and settings.numerics is scene.numerics
    assert settings.effects == tuple(scene.effects.values())
    assert not hasattr(settings.liquids[0], "color")


def test_emulsification_starts_where_tamponade_ends():
    scene = load_scene(PROJECT_CONFIG / "scenes" / "emulsification.yaml", "draft")
    assert scene.start_from == "tamponade"
    assert "injection" not in scene.effects and "diffusion" in scene.effects
    assert "time-lapse" in scene.label


def test_frames_and_segments(write):
    scene = load_scene(write("extends: tiny\noutput: {duration: 0.25 s}"), "draft")  # frames 0-5, two per segment
    assert scene.frame_count == 6 and scene.segment_count == 3
    assert [list(scene.frames_of_segment(segment)) for segment in range(3)] == [[0, 1, 2], [3, 4], [5]]
    with pytest.raises(ValueError, match="segment 3"):
        scene.frames_of_segment(3)


def test_schema_is_in_sync():
    written = (PROJECT_CONFIG / "schema.json").read_text(encoding="utf-8")
    expected = schema_text(load_materials(PROJECT_CONFIG / "materials.yaml"))
    assert written == expected, "run `python -m pipeline.scene --schema --output config/schema.json`"


@pytest.fixture(scope="module")
def schema():
    """Return what checks scenes against the schema, which is a sound one."""
    jsonschema = pytest.importorskip("jsonschema")
    text = json.loads((PROJECT_CONFIG / "schema.json").read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator.check_schema(text)
    return jsonschema.Draft202012Validator(text)


@pytest.mark.thorough_cases("collision_balls")
@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_shipped_scene_fits_the_schema(schema, path):
    schema.validate(read_yaml(path))


def test_schema_refuses_what_no_scene_may_say(schema):
    assert not schema.is_valid({"effects": {"gravity": {"posture": "upsidedown"}}})


# Units

@pytest.mark.parametrize(("text", "unit", "expected"), [
    ("1000 mPa s", "Pa*s", 1.0), ("1000 mPa·s", "Pa*s", 1.0), ("40 mN/m", "N/m", 0.04), ("85 %", "", 0.85),
    ("24 mm", "m", 0.024), ("1.5 mL/s", "m**3/s", 1.5e-6), ("18.2 deg", "deg", 18.2), ("180 deg", "rad", math.pi),
    ("970 kg/m3", "kg/m**3", 970.0),
    ("1 g cm-3", "kg/m**3", 1000.0), ("2e-3", "m", 2e-3), (5, "s", 5.0), (" -3 µm ", "m", -3e-6),
    ("1 1/min", "1/s", 1 / 60),
])
def test_quantity(text, unit, expected):
    assert parse_quantity(text, unit) == pytest.approx(expected, rel=1e-14)


@pytest.mark.parametrize(("value", "unit", "message"), [
    ("5 foo", "m", 'unknown unit "foo"'), ("40 mN", "N/m", "must be in N/m"), ("18 deg", "", "pure number"),
    ("85 %", "deg", "must be in deg"), (True, "m", "is true"), (None, "m", "is empty"), ([1], "m", "is a list"),
    (float("nan"), "m", "finite"), ("1e999", "m", "finite"), (10**400, "m", "finite"), ("x", "m", '"x"'),
    ("1 m/0", "m", "unknown unit"),
    ("3 m**99999999", "m", "unknown unit"), ("2 __import__", "m", "unknown unit"), ("1 2 m", "m", "unknown unit"),
])
def test_wrong_quantity(value, unit, message):
    with pytest.raises(ValueError) as caught:
        parse_quantity(value, unit)
    assert message in f"is {caught.value}"


def test_kinematic_viscosity_times_the_density_of_the_liquid(write):
    change = "{dynamic_viscosity: 5000 cSt, density: 0.98 g/cm3}"
    scene = load_scene(write(f"extends: tamponade\nliquids: {{silicone_oil_1000: {change}}}"), "draft")
    assert [liquid.name for liquid in scene.liquids] == ["aqueous", "silicone_oil_1000"]
    assert scene.liquids[1].density == 980.0
    assert scene.liquids[1].dynamic_viscosity == pytest.approx(4.9)


# Extending

def test_extends_merges_replaces_and_removes(write):
    write("extends: tamponade\ntitle: A\neffects: {gravity: {magnitude: 1}, injection: null}", "parent")
    scene = load_scene(write(
        "extends: parent\nliquids: [aqueous, silicone_oil_5000]\neffects: {gravity: {turns: null}}"), "draft")
    assert scene.title == "A"
    assert "injection" not in scene.effects
    assert scene.effects["gravity"].magnitude == 1.0
    assert scene.effects["gravity"].posture == "supine" and scene.effects["gravity"].turns == ()
    assert [liquid.name for liquid in scene.liquids] == ["aqueous", "silicone_oil_5000"]


def test_liquid_exchanged_by_a_mapping(write):
    scene = load_scene(write("extends: still_eye\nliquids: {silicone_oil_1000: null, heavy_oil_densiron_68: {}}\n"
                             "initial: {fill: {silicone_oil_1000: null, heavy_oil_densiron_68: 85 %}}"), "draft")
    assert scene.initial.fill == {"aqueous": 0.15, "heavy_oil_densiron_68": 0.85}


def test_numerics_of_the_scene_win_over_the_level(write):
    scene = load_scene(write("extends: tamponade\nnumerics: {particle_spacing: 1 mm, courant_number: 0.4}"), "fine")
    assert scene.numerics == dataclasses.replace(
        load_accuracy_levels(PROJECT_CONFIG / "accuracy.yaml")["fine"], particle_spacing=1e-3, courant_number=0.4,
        maximum_time_step=4e-3)


def test_config_chooses_the_accuracy(write, config):
    (config / "config.yaml").write_text("accuracy: fine\nscenes: [case]\n")
    assert load_scene(write("extends: tamponade")).accuracy == "fine"


def test_mesh_is_found_beside_the_scene(write, config):
    (config / "scenes" / "eye.stl").write_text("solid")
    scene = load_scene(write("extends: tamponade\neye: {model: mesh, path: eye.stl, unit: cm}"), "draft")
    assert Path(scene.eye.path) == config / "scenes" / "eye.stl"


# Errors: the text of a scene that extends tamponade, and what the message must contain

BAD = {
    "unknown key": ("titel: x", "titel is not known (did you mean title?)"),
    "name in file": ("name: x", "name is not known"),
    "unknown effect": ("effects: {gravty: {}}", "effects.gravty is not known (did you mean gravity?)"),
    "unknown parameter": ("effects: {gravity: {posure: prone}}",
                          "effects.gravity.posure is not known (did you mean posture?)"),
    "unknown liquid": ("liquids: {silicone_oil_100: {}}",
                       "liquids.silicone_oil_100 is no liquid of materials.yaml (did you mean silicone_oil_1000?)"),
    "liquid not in scene": ("effects: {injection: {liquid: aqeous}}", "did you mean aqueous?"),
    "liquids as a word": ("liquids: aqueous", "must be a list of liquids"),
    "no liquids": ("liquids: []", "must name one liquid at least"),
    "liquid twice": ("liquids: [aqueous, aqueous]", "liquids names aqueous more than once"),
    "liquid as a number": ("liquids: {aqueous: 3}", "liquids.aqueous is 3, but must be a mapping"),
    "liquid renamed": ("liquids: {aqueous: {name: water}}", "liquids.aqueous.name is not known"),
    "bad color": ("liquids: {aqueous: {color: blue}}", 'liquids.aqueous.color is "blue"'),
    "negative density": ("liquids: {aqueous: {density: -1}}", "above 0 kg/m3"),
    "wrong unit": ("effects: {injection: {flow: 1.5 mL}}", 'flow is "1.5 mL", but must be in m3/s'),
    "unknown unit": ("effects: {injection: {flow: 1.5 pints per jiffy}}", 'unknown unit "pints per jiffy"'),
    "negative volume": ("effects: {injection: {flow: -1.5 mL/s}}", "must be above 0 m3/s"),
    "fill of 101 %": ("effects: {injection: {fill: 101 %}}", 'fill is "101 %", but must be above 0 and at most 1'),
    "fill as 85": ("effects: {injection: {fill: 85}}", "fill is 85, but must be above 0 and at most 1"),
    "nan": ("effects: {injection: {flow: .nan}}", "finite"),
    "not a number": ("numerics: {particle_spacing: small}", 'particle_spacing is "small", but must be in m'),
    "half an iteration": ("numerics: {maximum_iterations: 1.5}", "must be a whole number"),
    "yes for a number": ("numerics: {particle_spacing: yes}", 'particle_spacing is "yes"'),
    "word for a switch": ("eye: {force: maybe}", 'force is "maybe", but must be true or false'),
    "number for a title": ("title: 2024", "title is 2024, but must be text"),
    "film beside gas": ("liquids: {silicone_oil_1000: null, air: {}}\neffects: {injection: null}",
                        "effects.wall_film cannot be used where one liquid is more than 2 times as dense as the other"),
    "film in a mixture": ("effects: {injection: null, diffusion: {coefficient: 1e-9 m2/s}}",
                          "cannot be used together with wall_film: a film is told by liquids that do not mix"),
    "film at a sharp angle": ("effects: {interface_tension: {contact_angle: 3 deg}}",
                              "wall_film cannot be used with a contact angle of 3 deg, but from 5 to 175 deg"),
    "point of two": ("effects: {injection: {drain: [0, 0]}}", "drain has 2 entries, but must have 3"),
    "point unit": ("effects: {injection: {drain: [0, 0, 3 s]}}", 'drain[2] is "3 s", but must be in m'),
    "point as number": ("effects: {injection: {drain: 3 mm}}", "drain is \"3 mm\", but must be a list"),
    "effect as list": ("effects: [gravity]", "effects is a list, but must be a mapping"),
    "parameter for effect": ("effects: {gravity: upright}", "effects.gravity is \"upright\", but must be a mapping"),
    "turn": ("effects: {gravity: {turns: [{start: 1 s, to: uprigth}]}}", "turns[0].to is \"uprigth\""),
    "turn without start": ("effects: {gravity: {turns: [{to: upright}]}}", "turns[0].start is missing"),
    "turns overlap": ("effects: {gravity: {turns: [{start: 1 s, to: upright}, {start: 1.5 s, to: prone}]}}",
                      "turns[1].start is 1.5 s, but the turn before ends at 2 s"),
    "saccades overlap": ("effects: {eye_rotation: {saccades: [{start: 1 s, amplitude: 10 deg}, "
                         "{start: 1.04 s, amplitude: 10 deg}]}}",
                         "saccades[1].start is 1.04 s, but the saccade before ends at 1.043 s"),
    "saccades too often": ("effects: {eye_rotation: {saccades: [{start: 1 s, amplitude: 50 deg, count: 2, "
                           "interval: 0.1 s}]}}", "saccades[0].interval is 0.1 s, but each of the saccades takes 0.13"),
    "impossible saccade": ("effects: {eye_rotation: {saccades: [{start: 1 s, amplitude: 10 deg, peak_rate: 2 deg/s}]}}",
                           "saccades[0].peak_rate is 0.0086 times the mean rate, but must be 1.1"),
    "saccades and oscillation": ("effects: {eye_rotation: {saccades: [{start: 1 s, amplitude: 9 deg}], "
                                 "oscillation: {amplitude: 9 deg, frequency: 1 Hz}}}",
                                 "oscillation is given beside saccades"),
    "bare degrees": ("effects: {interface_tension: {contact_angle: 18.2}}",
                     "contact_angle is 18.2, but must be at least 0 rad (0 deg) and at most 3.14159 rad (180 deg)"),
    "no axis": ("effects: {eye_rotation: {oscillation: {amplitude: 9 deg, frequency: 1 Hz, axis: [0, 0, 0]}}}",
                "oscillation.axis is (0, 0, 0), but must have a direction"),
    "no drain": ("effects: {injection: {drain: null}}",
                 "drain is missing (mouth of the drain): the closed cavity is full and liquids are incompressible"),
    "no drained liquid": ("effects: {injection: {drained_liquid: null}}", "as much must leave as enters"),
    "same liquid in and out": ("effects: {injection: {drained_liquid: silicone_oil_1000}}", "the liquid that enters"),
    "cannula outside": ("effects: {injection: {cannula: [-15 mm, 5 mm, 3 mm]}}",
                        "effects.injection.cannula is (-15, 5, 3) mm, outside the eye"),
    "drain in the lens": ("effects: {injection: {drain: [0, 0, 6 mm]}}", "drain is (0, 0, 6) mm, outside the eye"),
    "injection into a mixture": ("effects: {diffusion: {coefficient: 1e-6}}", "diffusion cannot be used together with"),
    "drain at cannula": ("effects: {injection: {drain: [-5 mm, 5 mm, 3 mm]}}", "away from it"),
    "late injection": ("effects: {injection: {start: 19 s}}", "start is 19 s, but the scene ends at 10 s"),
    "nothing to inject": ("initial: {liquid: silicone_oil_1000}", "fill is 85 %, but silicone_oil_1000 holds 100 %"),
    "two viscosities": ("effects: {viscosity: {}}", "viscosity_implicit cannot be used together with viscosity"),
    "tension and cohesion": ("effects: {cohesion: {gamma: 1}}", "cohesion cannot be used together with interface_"),
    "tension and curvature": ("effects: {curvature: {gamma: 1}}", "curvature cannot be used together with"),
    "tension of one liquid": ("liquids: [aqueous]\neffects: {injection: null}",
                              "effects.interface_tension needs two liquids at least"),
    "adhesion and contact angle": ("effects: {adhesion: {beta: 1}}", "adhesion cannot be used together with interface"),
    "cohesion without strength": ("effects: {interface_tension: null, cohesion: {}}",
                                  "effects.cohesion gives neither gamma nor tension"),
    "empty effect": ("effects: {cohesion: }", "effects.cohesion is empty"),
    "duration": ("output: {duration: 0.37 s}", "is 0.37 s, but must be a whole multiple of frame_interval, 0.05 s"),
    "short duration": ("output: {duration: 0.01 s}", "whole multiple"),
    "rest of a single liquid": ("liquids: [aqueous]\neffects: {injection: null, interface_tension: null}\n"
                                "output: {until_rest: true}",
                                "output.until_rest needs an eye with two liquids or more"),
    "rest between two frames": ("output: {until_rest: true, frame_interval: 2 s}",
                                "frame_interval is 2 s, but must be at most 1 s with until_rest"),
    "too many frames": ("output: {frame_interval: 1 ms}",
                        "which gives 10000 pictures, but at most 2000 are made; take a longer one, or allow more by "
                        "output.allowed_frames"),
    "odd picture": ("output: {image_size: [333, 200]}", "even"),
    "fill below 100 %": ("initial: {fill: {aqueous: 50 %}}", "adds up to 50 %"),
    "fill of a stranger": ("initial: {fill: {oil: 100 %}}", "initial.fill.oil is not known"),
    "fill and liquid": ("initial: {liquid: aqueous, fill: {aqueous: 1}}", "only one of them"),
    "level without gravity": ("initial: {fill: {aqueous: 1}}\neffects: {gravity: null}", "no effect gravity"),
    "rest of one liquid": ("effects: {injection: null}\ninitial: {shape: at_rest, fill: {aqueous: 1}}",
                           "initial.fill must give a share to both aqueous and silicone_oil_1000"),
    "rest without tension": ("effects: {injection: null, interface_tension: null}\n"
                             "initial: {shape: at_rest, fill: {aqueous: 0.5, silicone_oil_1000: 0.5}}",
                             "initial.shape is at_rest, which takes a tension and a contact angle"),
    "rest with another angle": ("effects: {injection: null, interface_tension: {contact_angle: 90 deg}}\n"
                                "initial: {shape: at_rest, fill: {aqueous: 0.5, silicone_oil_1000: 0.5}}",
                                "is known for contact angles from 5 to 45 deg, not 90 deg; write level"),
    "mesh without file": ("eye: {model: mesh}", "eye.path is missing"),
    "mesh that is a folder": ("eye: {model: mesh, path: .}", 'eye.path is ".", but that is a folder beside the scene'),
    "mesh that is missing": ("eye: {model: mesh, path: no.stl}", 'eye.path is "no.stl", but there is no such file'),
    "mesh for parametric": ("eye: {path: tiny.yaml}", "model is parametric"),
    "eye of a whale": ("eye: {axial_length: 24}", "is 24, but must be at least 0.015 m and at most 0.04 m"),
    "coarse": ("numerics: {particle_spacing: 5 mm}", "must be at most 3 mm"),
    "too fine": ("numerics: {particle_spacing: 1 um}", "which makes 5.1e+12 particles that need"),
    "time steps": ("numerics: {maximum_time_step: 1e-8}", "must be below maximum_time_step"),
    "unknown start": ("start_from: tamponad", 'start_from is "tamponad", but must be the name of a scene'),
    "start from itself": ("start_from: case", "start_from leads back to the same scene (case -> case)"),
    "start with other spacing": ("start_from: tiny", "particle_spacing is 1 mm, but must be 2 mm as in tiny"),
    "start with other liquids": ("start_from: s1_tamponade_gamma0", "but must be s1_water, s1_silicone_oil as in"),
    "start with a broken spacing": ("start_from: tamponade\nnumerics: {particle_spacing: x}\neye: {lens: x, path: 3}",
                                    "numerics.particle_spacing is"),
    "start that leaves too little": ("start_from: tamponade\neffects: {injection: {fill: 99.9 %}}",
                                     "drains all aqueous (15 % of the cavity at the start), but must be at"),
    "start with another eye": ("start_from: tamponade\neye: {lens: aphakic}",
                               "eye.lens is aphakic, but must be phakic as in tamponade"),
}


@pytest.mark.parametrize("case", BAD)
def test_error_names_file_key_and_what_is_allowed(case, write):
    text, expected = BAD[case]
    path = write(f"extends: tamponade\n{text}\n")
    messages = errors_of(path)
    assert any(expected in message for message in messages), messages
    assert all(message.startswith(str(path)) and "\n" not in message for message in messages)


BROKEN = {
    "bad indentation": ("extends: tamponade\n  title: x\n", "line 2, column 8"),
    "unclosed": ("effects: {gravity: [", "line 1"),
    "tab": ("effects:\n\tgravity: {}", "line 2, column 1"),
    "key twice": ("extends: tamponade\neffects:\n  gravity: {}\n  gravity: {}\n",
                  "line 4, column 3: gravity is given twice"),
    "alias": ("title: &a x\nlabel: *a", "line 1, column 8: anchors (&name) and aliases (*name) are not supported"),
    "tag": ("title: !!python/object/apply:os.getcwd []", "line 1, column 8"),
    "list as a key": ("? [a, b]\n: 3", "line 1, column 3: a key must be a word"),
    "empty": ("", "is empty, but must hold `name: value` lines"),
    "list": ("- tamponade", "is a list, but must hold `name: value` lines"),
    "control character": ("title: \x07", "UTF-8"),
    "deep": ("[" * 5000, "more than 20 deep"),
    "unknown parent": ("extends: tamponnade", 'extends is "tamponnade", but must be the name of a scene '
                                              "(did you mean tamponade?)"),
    "extends itself": ("extends: case", "extends leads back to the same scene (case -> case)"),
    "extends a path": ("extends: ../scenes/tamponade.yaml", "must be the name of a scene"),
    "nothing said": ("title: x", "liquids is missing"),
}


@pytest.mark.parametrize("case", BROKEN)
def test_broken_file(case, write):
    text, expected = BROKEN[case]
    messages = errors_of(write(text))
    assert any(expected in message for message in messages), messages


def test_file_that_is_not_utf8(write):
    path = write("")
    path.write_bytes(b"title: \xff\xfe\n")
    assert "UTF-8" in errors_of(path)[0]


def test_one_unknown_liquid_gives_one_error(write):
    messages = errors_of(write("extends: tamponade\nliquids: [aqueos, silicone_oil_1000]"))
    assert len(messages) == 1 and "did you mean aqueous?" in messages[0]


def test_missing_file_names_the_nearest(config):
    assert "no such file (did you mean tamponade?)" in errors_of(config / "scenes" / "tamponad.yaml")[0]


def test_cycle_over_several_scenes(write):
    write("extends: case", "other")
    assert "(case -> other -> case)" in errors_of(write("extends: other"))[0]
    write("extends: tamponade\nstart_from: case", "other")
    assert "(case -> other -> case)" in errors_of(write("extends: tamponade\nstart_from: other"))[0]


def test_effect_without_the_one_it_requires(write, monkeypatch):
    monkeypatch.setattr(REGISTRY["diffusion"], "requires", ("cohesion",))
    messages = errors_of(write("extends: tamponade\neffects: {injection: null, wall_film: null, "
                               "diffusion: {coefficient: 1e-6}}"))
    assert messages[0].endswith("effects.diffusion needs the effect cohesion too; add cohesion or remove diffusion")


def test_name_that_cannot_be_a_folder(write):
    assert 'a scene named "two words"' in errors_of(write("extends: tamponade", "two words"))[0]


def test_all_errors_at_once_with_their_files(write):
    parent = write("extends: tamponade\neffects: {gravity: {magnitude: 9.81 m}}", "parent")
    path = write("extends: parent\ntitel: x\n"
                 "effects: {viscosity: {wall: slippy}, injection: {fill: 101 %, start: 9 s}}\n"
                 "output: {duration: 0.37 s, image_size: [1, 2, 3]}\nstart_from: nowhere\n")
    text = "\n".join(errors_of(path))
    for key in ("titel", "effects.viscosity.wall", "effects.viscosity_implicit", "effects.injection.fill",
                "effects.injection.start", "output.duration", "output.image_size", "start_from"):
        assert f": {key} is" in text or f": {key} has" in text or f": {key} cannot" in text, key
    assert f"{path} (inherited from {parent}): effects.gravity.magnitude" in text


def test_errors_of_the_configuration(write, config):
    path = write("extends: tamponade")
    (config / "config.yaml").write_text("accuracy: [draft]")
    with pytest.raises(UserError, match=r"config\.yaml: accuracy is a list"):
        load_scene(path)
    with pytest.raises(UserError, match=r"--accuracy is \"drft\", .*did you mean draft"):
        load_scene(path, "drft")
    (config / "accuracy.yaml").write_text("draft: {scheme: isph}")
    assert [message.split(": ", 1)[1].split(" is ")[0] for message in errors_of(path)] == [
        "draft.particle_spacing", "draft.scheme"]
    (config / "accuracy.yaml").write_text("draft: {particle_spacing: 1 mm}\nvery/fine: {particle_spacing: 0.1 mm}")
    message, = errors_of(path)
    assert "very/fine is no name for a level" in message
    (config / "materials.yaml").write_text("aqueous: {density: 5 cSt, dynamic_viscosity: 1 cSt}")
    assert [message.split(": ", 1)[1] for message in errors_of(path)] == [
        'aqueous.density is "5 cSt", but must be in kg/m3 (rest density)']


@pytest.mark.parametrize(("text", "expected"), [
    ("{", "not a resolved scene (Expecting"), ("[]", "must be a mapping"), ("{}", "name is missing"),
    ('{"liquids": 3}', "liquids is 3, but must be a list"),
])
def test_broken_resolved_scene(text, expected, tmp_path):
    path = tmp_path / "scene.json"
    with pytest.raises(UserError, match="no such file, write it with"):
        load_resolved(path)
    path.write_text(text)
    with pytest.raises(UserError) as caught:
        load_resolved(path)
    assert any(expected in message for message in caught.value.messages), caught.value.messages


# Command line

def test_output_keeps_its_date_while_the_scene_is_the_same(write, tmp_path):
    path, output = write("extends: tiny"), tmp_path / "new" / "scene.json"
    main([str(path), "--accuracy", "draft", "--output", str(output)])
    before = output.stat()
    main([str(path), "--accuracy", "draft", "--output", str(output)])
    assert output.stat().st_mtime_ns == before.st_mtime_ns and output.stat().st_ino == before.st_ino
    main([str(path), "--accuracy", "fine", "--output", str(output)])
    assert load_resolved(output).accuracy == "fine"
    assert [file.name for file in output.parent.iterdir()] == ["scene.json"]


def test_check_tells_what_is_done_when_and_writes_no_scene(write, capsys):
    main([str(write("extends: tiny")), "--check"])
    assert capsys.readouterr() == ("case: silicone oil 1000 flows in throughout; supine throughout\n", "")


def test_list_and_schema_and_standard_output(write, capsys):
    main(["--list"])
    text = capsys.readouterr().out
    for word in ("interface_tension", "silicone_oil_5000", "fine", "m3/s", "contact_angle"):
        assert word in text
    main(["--schema"])
    properties = json.loads(capsys.readouterr().out)["properties"]
    assert "interface_tension" in properties["effects"]["properties"]
    main([str(write("extends: tiny"))])
    assert json.loads(capsys.readouterr().out)["name"] == "case"


def test_wrong_input_exits_with_2_and_no_traceback(write):
    path = write("extends: tamponade\neffects: {injection: {fill: 101 %, flow: 1 mL}}\n")
    done = forked.run("pipeline.scene", path)
    assert done.returncode == 2 and done.stdout == ""
    assert len(done.stderr.splitlines()) == 2
    assert all(line.startswith(f"error: {path}: effects.injection.") for line in done.stderr.splitlines())


@pytest.mark.thorough
def test_folder_that_cannot_be_written_exits_with_1(write, tmp_path):
    (tmp_path / "file").write_text("")
    done = forked.run("pipeline.scene", write("extends: tiny"), "--output", tmp_path / "file" / "scene.json")
    assert done.returncode == 1
    assert len(done.stderr.splitlines()) == 1 and done.stderr.startswith("error: ")
