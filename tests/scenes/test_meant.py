"""What people write for something else: asked back with what was probably meant, in check, advice and page."""
import pytest
from helpers import forked

from pipeline.advice.report import html_of, report_of
from pipeline.base.errors import UserError
from pipeline.scenes.checks import doubts
from pipeline.scenes.folders import scene_paths
from pipeline.scenes.load import PROJECT_CONFIG, load_resolved, load_scene
from pipeline.scenes.units import parse_quantity
from sim.advice import WARNING


@pytest.fixture
def write(tmp_path):
    """Return a function that writes a scene that extends another one, and returns its path."""
    def scene(text, base="tiny"):
        path = tmp_path / "case.yaml"
        path.write_text(f"extends: {base}\n{text}\n", encoding="utf-8")
        return path

    for name, path in scene_paths(PROJECT_CONFIG / "scenes").items():
        (tmp_path / f"{name}.yaml").write_text(path.read_text())
    return scene


@pytest.mark.parametrize(("text", "unit", "expected"), [
    ("−5 mm", "m", -5e-3), ("–5 mm", "m", -5e-3), ("40 mN·m⁻¹", "N/m", 0.04), ("0.97 g/cm³", "kg/m**3", 970.0),
    ("18.2º", "deg", 18.2), ("1000 mPas", "Pa*s", 1.0), ("1000 mPa.s", "Pa*s", 1.0), ("1000 mPa⋅s", "Pa*s", 1.0),
    ("500 μm", "m", 5e-4), ("24 mm", "m", 0.024), ("９ mm", "m", 9e-3),
])
def test_typographic_signs_are_read(text, unit, expected):
    assert parse_quantity(text, unit) == pytest.approx(expected, rel=1e-12)


BARE = {
    "angle in radians": ("effects: {interface_tension: {contact_angle: 3}}",
                         "is 3 without a unit, which would be 171.9 deg, but must be in deg or rad (did you mean 3 "),
    "angle in text": ("effects: {interface_tension: {contact_angle: '2.5'}}", "(did you mean 2.5 deg?)"),
    "angle out of range": ("effects: {interface_tension: {contact_angle: 18.2}}", "(did you mean 18.2 deg?)"),
    "latitude": ("breaks: [{name: a, hour: 6, latitude: 60, width: 1}]", "(did you mean 60 deg?)"),
    "length": ("eye: {axial_length: 24}", "(did you mean 24 mm?)"),
    "spacing": ("numerics: {particle_spacing: 0.5}", "an eighth of the axial length (did you mean 0.5 mm?)"),
    "place": ("effects: {injection: {cannula: [-5, 5, 3]}}", "(did you mean -5 mm?)"),
    "share": ("effects: {injection: {fill: 85}}", "(did you mean 85 %?)"),
    "shares of the start": ("effects: {injection: null}\ninitial: {fill: {aqueous: 0.15 %, silicone_oil_1000: 0.85 %}}",
                            "(did you mean 85 % where 0.85 % is written?)"),
    "flow": ("effects: {injection: {flow: 2}}", "(did you mean 2 mL/s?)"),
    "tension": ("effects: {interface_tension: {coefficient: 40}}", "(did you mean 40 mN/m?)"),
    "density": ("liquids: {silicone_oil_1000: {density: 0.97}}",
                "is 0.97 without a unit, but silicone_oil_1000 has 970 kg/m3 (did you mean 0.97 g/mL?)"),
    "viscosity": ("liquids: {aqueous: {dynamic_viscosity: 0.7}}", "aqueous has 0.0007 Pa s (did you mean 0.7 mPa s?)"),
    "viscosity out of range": ("liquids: {silicone_oil_1000: {dynamic_viscosity: 1000}}", "(did you mean 1000 mPa s?)"),
    "decimal comma": ("numerics: {particle_spacing: '0,5 mm'}", "with a comma, but must be in m, with a point "
                                                               "(did you mean 0.5 mm?)"),
    "thousands": ("liquids: {silicone_oil_1000: {dynamic_viscosity: '1,000 mPa s'}}", "(did you mean 1000 mPa s?)"),
    "unit of another case": ("liquids: {silicone_oil_1000: {dynamic_viscosity: 1000 mpa s}}", "(did you mean mPa s?)"),
    "unit of another language": ("effects: {interface_tension: {contact_angle: 18.2 grad}}", "(did you mean deg?)"),
    "comma that ends an entry": ("effects: {interface_tension: {contact_angle: 18,2 deg}}", "mean a decimal point?)"),
    "share of volume": ("effects: {injection: {fill: 85 Vol.-%}}", "(did you mean %?)"),
    "misspelled unit": ("eye: {axial_length: 24 milimeter}", "(did you mean mm?)"),
    "unit without its time": ("effects: {injection: {flow: 2 ml}}", "must be in m3/s (did you mean mL/s?)"),
    "power in small digits": ("output: {duration: 10² s}", '"10² s" with a power, but must be in s, with powers of ten '
                                                          "as in 1e-3 (did you mean 1e2 s?)"),
    "power of viscosity": ("liquids: {silicone_oil_1000: {dynamic_viscosity: 10³ mPa s}}", "(did you mean 1e3 mPa s?)"),
    "times a power of ten": ("numerics: {particle_spacing: 2×10⁻³ m}", "(did you mean 2e-3 m?)"),
    "power by a hat": ("numerics: {particle_spacing: 2*10^-3 m}", "(did you mean 2e-3 m?)"),
    "small digit": ("effects: {injection: {fill: 8₅ %}}", '"8₅ %" with a power, but must be a pure number'),
    "points between thousands": ("output: {duration: '1.500,5 ms'}", "(did you mean 1500.5 ms?)"),
    "micrometers": ("eye: {model: mesh, path: a.stl, unit: µm}", "(did you mean um?)"),
    "posture of the clinic": ("effects: {gravity: {posture: sitting}}", "(did you mean upright?)"),
    "posture with a blank": ("effects: {gravity: {posture: Face down}}", "(did you mean prone?)"),
    "posture of another language": ("effects: {gravity: {posture: Rückenlage}}", "(did you mean supine?)"),
    "side of a chart": ("eye: {side: OS}", "(did you mean left?)"),
    "lens of a chart": ("eye: {lens: IOL}", "(did you mean pseudophakic?)"),
    "graphics card": ("numerics: {device: GPU}", "(did you mean cuda?)"),
    "switch": ("output: {until_rest: yes}", "must be true or false (did you mean true?)"),
    "effect at the top": ("gravity: {posture: upright}", "gravity is not known (did you mean effects.gravity?)"),
    "key at the top": ("duration: 1 s", "duration is not known (did you mean output.duration?)"),
    "key of two places": ("fill: 90 %", "(did you mean initial.fill or effects.injection.fill?)"),
    "key of another part": ("output: {particle_spacing: 1 mm}", "(did you mean numerics.particle_spacing?)"),
    "key of an effect beside it": ("effects: {posture: upright}", "(did you mean effects.gravity.posture?)"),
    "level in a scene": ("accuracy: standard", "(did you mean --config accuracy=standard at the command line?)"),
    "new liquid": ("liquids: {aqueous: {}, my_oil: {density: 970 kg/m3, dynamic_viscosity: 2 Pa s}}",
                   "add a new one to config/materials.yaml, with density and dynamic_viscosity"),
}


@pytest.mark.parametrize("case", BARE)
def test_bare_numbers_are_asked_back_with_what_was_meant(case, write):
    text, expected = BARE[case]
    with pytest.raises(UserError) as caught:
        load_scene(write(text), "draft", PROJECT_CONFIG)
    assert any(expected in sentence for sentence in caught.value.messages), caught.value.messages


def test_what_is_meant_can_be_said(write, tmp_path):
    scene = load_scene(write("effects: {interface_tension: {contact_angle: 1.5707963}}\n"
                             "liquids: {silicone_oil_1000: {dynamic_viscosity: 60 Pa s}}"), "draft", PROJECT_CONFIG)
    assert scene.liquids[1].dynamic_viscosity == 60.0
    scene = load_scene(write("effects: {interface_tension: {contact_angle: 3 rad}}"), "draft", PROJECT_CONFIG)
    (tmp_path / "scene.json").write_text(scene.to_json())
    assert load_resolved(tmp_path / "scene.json").effects["interface_tension"].contact_angle == 3.0


DOUBTS = {  # scene, what it extends, and key and words of what is asked back
    "angle through the oil": ("effects: {interface_tension: {contact_angle: 161.8 deg}}", "tiny",
                              "interface_tension.contact_angle", "did you mean 18.2 deg?"),
    "order of liquids": ("liquids: [silicone_oil_1000, aqueous]", "resting_eye",
                         "interface_tension.contact_angle", "did you mean 161.8 deg?"),
    "gas wets the wall": ("effects: {interface_tension: {contact_angle: 141.2 deg}}\ninitial: {shape: level}",
                          "gas_eye",
                          "interface_tension.contact_angle", "did you mean 38.8 deg?"),
    "cannula and drain": ("effects: {injection: {drain: [-5 mm, 5 mm, 3 mm], cannula: [0 mm, 0 mm, -9.5 mm]}}", "tiny",
                          "injection.drain", "12.5 mm above the cannula at the start, but aqueous, which leaves, is"),
    "tiny fill": ("effects: {injection: {fill: 0.85 %}}", "tiny", "injection.fill", "did you mean 85 %?"),
    "oil that sinks": ("effects: {injection: null}\nliquids: {silicone_oil_1000: {density: 1060 kg/m3}}", "tiny",
                       "liquids.silicone_oil_1000.density", "silicone oils have 960 to 980 kg/m3 and float"),
    "tension of another unit": ("effects: {interface_tension: {coefficient: 0.4}}", "tiny",
                                "interface_tension.coefficient", "is 400 mN/m, but in an eye oil has some 5 to 50"),
    "tension of another prefix": ("effects: {interface_tension: {coefficient: 40 nN/m}}", "tiny",
                                  "interface_tension.coefficient", "did you mean 40 mN/m?"),
    "stokes for centistokes": ("liquids: {silicone_oil_1000: {dynamic_viscosity: 1000 St}}", "tiny",
                               "liquids.silicone_oil_1000.dynamic_viscosity", "did you mean 1000 mPa s?"),
    "thick aqueous": ("liquids: {aqueous: {dynamic_viscosity: 0.7 Pa s}}", "tiny", "liquids.aqueous.dynamic_viscosity",
                      "did you mean 0.7 mPa s?"),
    "gravity in g": ("effects: {gravity: {magnitude: 1}}", "tiny", "gravity.magnitude", "9.81 m/s2, which is 1 g"),
    "region of everything": ("regions: [{name: macula}]", "tiny", "regions[0]", "so that it is the whole retina"),
    "heavy oil that floats": ("effects: {injection: null}\n"
                              "liquids: {silicone_oil_1000: null, heavy_oil_densiron_68: {density: 970 kg/m3}}", "tiny",
                              "liquids.heavy_oil_densiron_68.density", "heavy oils have 1020 to 1060 kg/m3 and sink"),
}


@pytest.mark.parametrize("case", DOUBTS)
def test_physics_the_wrong_way_round_is_asked_back_in_advice_and_page(case, write):
    text, base, key, words = DOUBTS[case]
    report = report_of(load_scene(write(text, base), "draft", PROJECT_CONFIG), 5.5e-6)
    found = [one for one in report.advice if one.level == WARNING and one.effect == key]
    assert len(found) == 1 and words in found[0].sentence
    assert words in html_of(report).replace("&#x27;", "'")


def test_the_check_warns_and_succeeds(write):
    result = forked.run("pipeline.scene", write(DOUBTS["angle through the oil"][0]), "--check",
                        "--config-dir", PROJECT_CONFIG)
    assert result.returncode == 0 and "{" not in result.stdout  # no scene is written
    assert result.stderr.startswith("warning: ") and "did you mean 18.2 deg?" in result.stderr


def test_shipped_scenes_are_meant():
    for path in scene_paths(PROJECT_CONFIG / "scenes").values():
        assert not doubts(load_scene(path, "draft")), path
