"""Advice on a scene: numbers worked out by hand, and warnings exactly where they belong."""
import functools
import json
import math
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT
from helpers import forked

from pipeline.advice.dimensionless_numbers import scales_of
from pipeline.advice.report import html_of, json_of, report_of, text_of
from pipeline.advice.rules import NOTE, SEEN_EFFECT, WARNING
from pipeline.advise import main
from pipeline.base import digest
from pipeline.base.digest import code_used, modules_used
from pipeline.base.errors import UserError
from pipeline.cavity.surface import cavity_volume
from pipeline.scenes.folders import scene_paths
from pipeline.scenes.load import PROJECT_CONFIG, load_accuracy_levels, load_scene
from sim.advice import shown
from sim.effects import REGISTRY
from sim.settings import Liquid, Numerics, Settings
from sim.time_step import known_limits

SHIPPED = list(scene_paths(PROJECT_CONFIG / "scenes").values())
LEVELS = tuple(load_accuracy_levels(PROJECT_CONFIG / "accuracy.yaml"))
# The reference eye: a ball of 11 mm radius, 5.58 mL.
RADIUS = 0.011
REFERENCE_VOLUME = 4.0 / 3.0 * math.pi * RADIUS**3

# Two liquids in a full box of 0.1 m, 3D; the tests below vary it.
BOX = """
title: Box
container: {size: [0.1 m, 0.1 m, 0.1 m]}
liquids: {aqueous: {}, silicone_oil_1000: {}}
blocks:
  - {liquid: aqueous, lower: [0, 0, 0], upper: [0.1, 0.05, 0.1]}
  - {liquid: silicone_oil_1000, lower: [0, 0.05, 0], upper: [0.1, 0.1, 0.1]}
numerics: {particle_spacing: 5 mm}
output: {duration: 2 s}
"""


@pytest.fixture(scope="module")
def config(tmp_path_factory) -> Path:
    """A copy of the project's configuration to which tests add scenes, with the box."""
    folder = shutil.copytree(PROJECT_CONFIG, tmp_path_factory.mktemp("advise") / "config")
    (folder / "scenes" / "box.yaml").write_text(BOX)
    return folder


@pytest.fixture
def scene(config):
    """Return a function that writes a scene and reads it."""
    def read(text: str, base: str = "box", level: str = "draft"):
        path = config / "scenes" / "case.yaml"
        path.write_text(f"extends: {base}\n{text}\n")
        return load_scene(path, level)
    return read


@pytest.fixture
def advised(scene):
    """Return a function that gives the advice of a level on a scene as (effect, sentence)."""
    def found(text: str, base: str = "box", level: str = WARNING):
        case = scene(text, base)
        volume = cavity_volume(case) if case.container else REFERENCE_VOLUME
        return [(one.effect, one.sentence) for one in report_of(case, volume).advice if one.level == level]
    return found


def shipped(name: str, level: str = "draft"):
    return load_scene(PROJECT_CONFIG / "scenes" / f"{name}.yaml", level)


def values(quantities) -> dict[str, float]:
    return {quantity.name: quantity.value for quantity in quantities}


# Numbers by hand

def test_numbers_of_silicone_oil_in_the_eye():
    report = report_of(shipped("tamponade"), REFERENCE_VOLUME)
    assert values(report.size)["length L"] == pytest.approx(RADIUS)
    numbers = values(report.numbers)
    # 35 kg/m3 x 9.81 m/s2 x (11 mm)^2 / 40 mN/m, and 1 Pa s / sqrt(970 kg/m3 x 40 mN/m x 11 mm)
    assert numbers["Bo"] == pytest.approx(1.04, abs=0.005)
    assert numbers["Oh silicone_oil_1000"] == pytest.approx(1.53, abs=0.005)
    assert numbers["Oh aqueous"] == pytest.approx(0.7e-3 / math.sqrt(1005 * 0.04 * RADIUS))
    assert numbers["viscosity ratio"] == pytest.approx(1000 / 0.7)
    assert numbers["density ratio"] == pytest.approx(1005 / 970)
    # The buoyant speed 35 x 9.81 x (11 mm)^2 / 1 Pa s exceeds 40 mN/m / 1 Pa s here; the largest is U.
    speed = 35 * 9.81 * RADIUS**2 / 1.0
    assert values(report.speeds)["speed U"] == pytest.approx(speed)
    assert numbers["Re silicone_oil_1000"] == pytest.approx(970 * speed * RADIUS / 1.0)
    assert numbers["Re aqueous"] == pytest.approx(1005 * speed * RADIUS / 0.7e-3)
    assert numbers["Ca"] == pytest.approx(1.0 * speed / 0.04)
    assert numbers["We"] == pytest.approx(1005 * speed**2 * RADIUS / 0.04)
    assert "Pe" not in numbers


def test_time_scales_of_silicone_oil_in_the_eye():
    times = values(report_of(shipped("tamponade"), REFERENCE_VOLUME).times)
    assert times["buoyancy, viscous"] == pytest.approx(0.265, abs=0.001)  # mu/(drho g R)
    assert times["capillary, viscous"] == pytest.approx(0.275, abs=0.001)  # mu R/sigma
    assert times["capillary"] == pytest.approx(math.sqrt(1005 * RADIUS**3 / 0.04))
    assert times["viscous, silicone_oil_1000"] == pytest.approx(970 * RADIUS**2 / 1.0)
    assert times["viscous, aqueous"] == pytest.approx(174, rel=0.01)
    assert times["injection"] == pytest.approx(0.85 * REFERENCE_VOLUME / 2e-6 + 0.025)  # the flow rises in 50 ms
    assert times["scene"] == 10.0
    numbers = values(report_of(shipped("emulsification"), REFERENCE_VOLUME).numbers)
    times = values(report_of(shipped("emulsification"), REFERENCE_VOLUME).times)
    assert times["diffusion"] == pytest.approx(RADIUS**2 / 1e-6)
    assert numbers["Pe"] == pytest.approx(35 * 9.81 * RADIUS**2 * RADIUS / 1e-6)


def test_speed_without_viscosity_is_that_of_a_fall_or_of_rounding(scene):
    still = scales_of(scene("effects: {gravity: {}, interface_tension: {coefficient: 40 mN/m}}"), 1e-3)
    length = (0.75 * 5e-4 / math.pi) ** (1 / 3)  # each liquid has half of the liter
    assert still.length == pytest.approx(length)
    assert still.buoyant_speed(9.81) == pytest.approx(math.sqrt(2 * 9.81 * 35 / 1005 * length))
    assert still.capillary_speed(0.04) == pytest.approx(math.sqrt(0.04 / (1005 * length)))


def test_jet_turn_and_jolt_of_the_eye():
    tamponade = scales_of(shipped("tamponade"), REFERENCE_VOLUME)
    # 12 steps with 2 mL/s bring a droplet of 1.5 times the radius of 1.5 mm that was asked for.
    assert values(tamponade.speeds)["jet"] == pytest.approx(2e-6 / (4 * math.pi * 2.25e-3**2), rel=1e-6)
    assert values(tamponade.wall_speeds)["turn"] == pytest.approx(1.875 * 0.5 * math.pi / 0.5 * RADIUS)
    (gravity, parameters), = (one for one in tamponade.effects if one[0].name == "gravity")
    left_out = gravity.omitted_acceleration(parameters, tamponade)
    assert left_out == pytest.approx(5.7735 * 0.5 * math.pi / 0.5**2 * RADIUS, rel=1e-4)
    jolted = values(scales_of(shipped("jolted_eye"), REFERENCE_VOLUME).speeds)
    assert jolted["jolt"] == pytest.approx(49 * 35 / 1005 * 0.05 * 2 / math.pi)


def test_free_surface_falls_with_full_weight():
    report = report_of(shipped("coupling_2d"), 5.4)
    assert values(report.size)["length L"] == pytest.approx(math.sqrt(0.8 / math.pi))  # a block of 0.8 m2
    assert values(report.speeds)["speed U"] == pytest.approx(math.sqrt(2 * 9.81 * 1.2))
    assert values(report.times)["gravity"] == pytest.approx(math.sqrt(math.sqrt(0.8 / math.pi) / 9.81))


# Time step

def test_limits_of_the_time_step_are_those_of_effects_and_scheme():
    oil, aqueous = Liquid("oil", 970.0, 1.0), Liquid("aqueous", 1005.0, 0.7e-3)
    effects = (REGISTRY["viscosity"].Parameters(), REGISTRY["interface_tension"].Parameters(coefficient=0.04))
    limits = known_limits(Settings(3, (aqueous, oil), Numerics(particle_spacing=0.4e-3), effects))
    assert limits["effects.viscosity"] == pytest.approx(1.94e-5, rel=0.01)
    assert limits["effects.interface_tension"] == pytest.approx(5.0e-4, rel=0.01)
    assert limits["numerics.maximum_time_step"] == 2e-3
    assert limits["the scheme volume_incompressible"] == math.inf


@pytest.mark.parametrize(("name", "decides", "steps"), [
    # Steps that runs at `draft` took (last line but one of logs/simulate_*.log).
    ("coupling_2d", "the speed of the liquids", 3002),
    ("coupling_2d_wcsph", "the scheme wcsph", 21730),
])
def test_estimated_steps_are_near_those_of_runs(name, decides, steps):
    # 20 %: colliding blocks splash at more than twice the speed of their fall for some time.
    case = shipped(name)
    report = report_of(case, cavity_volume(case))
    assert report.time_step_limits[0].source == decides
    assert report.steps == pytest.approx(steps, rel=0.2)


def test_viscosity_lifts_the_capillary_limit_of_the_tamponade():
    report = report_of(shipped("tamponade", "standard"), REFERENCE_VOLUME)
    limits = {limit.source: limit.value for limit in report.time_step_limits}
    assert limits["effects.interface_tension"] == pytest.approx(4.06e-3, rel=0.01)  # 0.5 ms without viscosity
    assert report.time_step == min(limits.values()) == 4e-3
    # Frames every 0.05 s: whole steps to each.
    assert report.steps == 200 * math.ceil(0.05 / report.time_step)


def test_fixed_time_step_decides(scene):
    report = report_of(scene("effects: {gravity: {}}\nnumerics: {time_step: 0.5 ms}"), 1e-3)
    assert report.cost == "0.5 ms decided by numerics.time_step: about 4000 steps"


# Advice: every warning in its scene, and none beside it

GRAVITY = "gravity: {}"
TENSION = "interface_tension: {coefficient: 40 mN/m}"
OIL = "liquids: {aqueous: null}\nblocks: [{liquid: silicone_oil_1000, lower: [0, 0, 0], upper: [0.1, 0.1, 0.1]}]\n"
EQUAL = "liquids: {aqueous: {density: 1000}, silicone_oil_1000: {density: 1000}}\n"
THIN = "liquids: {aqueous: {}, silicone_oil_1000: {dynamic_viscosity: 1 mPa s}}\n"
ASKED_BACK = {"liquids.silicone_oil_1000.dynamic_viscosity": "did you mean 1000 mPa s?"}


@pytest.mark.parametrize(("text", "expected"), [
    # Bo = 35 kg/m3 x 9.81 m/s2 x (49 mm)^2 / 40 mN/m = 21: tension may be left out. The limit of explicit viscosity is
    # 0.125 (5 mm)^2 x 970 kg/m3 / 1 Pa s = 3 ms, above the largest step of 2 ms; with 2.5 mm it is 0.76 ms, below it.
    (f"effects: {{{GRAVITY}, viscosity: {{}}}}", {}),
    (f"effects: {{{GRAVITY}, viscosity_implicit: {{}}}}", {}),  # it is advanced explicitly
    (f"effects: {{{GRAVITY}, viscosity_implicit: {{form: strain}}}}",
     {"viscosity_implicit": "explicit viscosity would be cheaper: it needs no solve and 0.66 steps"}),
    (f"effects: {{{GRAVITY}, viscosity: {{}}}}\nnumerics: {{particle_spacing: 2.5 mm}}",
     {"viscosity": "viscosity_implicit would be cheaper: explicit viscosity takes 2.64 steps"}),
    (f"effects: {{{GRAVITY}, viscosity_implicit: {{}}}}\nnumerics: {{particle_spacing: 2.5 mm}}", {}),
    (f"effects: {{{GRAVITY}}}", {"viscosity": "is missing and would be seen: silicone_oil_1000 would feel it"}),
    (f"effects: {{{GRAVITY}}}\nnumerics: {{particle_spacing: 2.5 mm}}",
     {"viscosity_implicit": "1.43e+03 times as stiff as the thinnest liquid"}),
    ("effects: {viscosity: {}}", {"gravity": "is missing and would be seen: the liquids differ by 35 kg/m3",
                                  "interface_tension": "Bo = 0 is below 10", "viscosity": "U is 0 m/s"}),
    ("", {"gravity": "is missing", "interface_tension": "is missing"}),
    # Both liquids like water: layers of sqrt(nu t) stay below the spacing of 5 mm.
    (f"{THIN}effects: {{{GRAVITY}}}", ASKED_BACK),
    (f"{THIN}effects: {{{GRAVITY}, viscosity: {{}}}}",
     {**ASKED_BACK, "viscosity": "cannot be seen: it acts in a layer of"}),
    # Equal weights: gravity only shifts the pressure; tension then rounds whatever its strength.
    (f"{EQUAL}effects: {{{GRAVITY}, {TENSION}, viscosity: {{}}}}",
     {"gravity": "cannot be seen: the liquids differ by 0 kg/m3"}),
    (f"{EQUAL}effects: {{{TENSION}, viscosity: {{}}}}", {}),
    (f"{EQUAL}effects: {{viscosity: {{}}}}",
     {"interface_tension": "is missing and would be seen", "viscosity": "U is 0 m/s"}),
    # Bo = 21: the meniscus is seen. With 2 mN/m it is 416: a rim of 2.4 mm, half a spacing.
    (f"effects: {{{GRAVITY}, {TENSION}, viscosity: {{}}}}", {}),
    (f"effects: {{{GRAVITY}, interface_tension: {{coefficient: 2 mN/m}}, viscosity: {{}}}}\noutput: {{duration: 9 s}}",
     {"interface_tension": "cannot be seen: Bo = 416 is above 100"}),
    # In 0.1 s nothing moves by a spacing.
    (f"effects: {{{GRAVITY}, {TENSION}, viscosity: {{}}}}\noutput: {{duration: 0.1 s}}",
     {"gravity": "cannot be seen: within the scene it moves liquid by 1.71 mm",
      "interface_tension": "cannot be seen: within the scene it moves the interface by"}),
    # Single droplets of 1 mm of oil rise in water at 27 mm/s by Stokes and Hadamard and Rybczynski, with Re 39.
    (f"effects: {{{GRAVITY}, viscosity: {{}}, drift: {{droplet_diameter: 1 mm}}}}",
     {"drift": "is too fast: droplets of silicone_oil_1000 in aqueous have a Reynolds number of 39"}),
    # Of 0.1 mm at 0.27 mm/s: 0.5 mm in 2 s, a tenth of a spacing.
    (f"effects: {{{GRAVITY}, viscosity: {{}}, drift: {{droplet_diameter: 0.1 mm}}}}",
     {"drift": "cannot be seen: single droplets of silicone_oil_1000 move through aqueous"}),
    (f"effects: {{{GRAVITY}, viscosity: {{}}, drift: {{droplet_diameter: 0.1 mm, coefficient: 0}}}}",
     {"drift": "does nothing: its coefficient is 0"}),
    # sqrt(2 D t) is 2 mm after 2 s with 1e-6 m2/s, and 6.3 mm with 1e-5.
    (f"effects: {{{GRAVITY}, viscosity: {{}}, diffusion: {{coefficient: 1e-6}}}}",
     {"diffusion": "cannot be seen: within the 2 s of the scene the liquids mix over 2 mm (0.4 particle spacings"}),
    (f"effects: {{{GRAVITY}, viscosity: {{}}, diffusion: {{coefficient: 1e-5}}}}", {}),
    # What does nothing.
    ("effects: {gravity: {magnitude: 0}, interface_tension: {coefficient: 0}, viscosity: {}}",
     {"gravity": "its magnitude is 0", "interface_tension": "its coefficient is 0", "viscosity": "U is 0 m/s"}),
    ("effects: {gravity: {magnitude: 0, jolts: [{start: 1 s, acceleration: [0, 90, 0]}]}, viscosity: {}}",
     {"interface_tension": "is missing"}),
    (f"effects: {{{GRAVITY}, viscosity: {{}}, cohesion: {{gamma: 0}}, curvature: {{gamma: 1}}}}",
     {"cohesion": "its gamma is 0"}),
    # One liquid in a full box.
    (f"{OIL}effects: {{{GRAVITY}}}", {"gravity": "the liquids differ by 0 kg/m3"}),
    (f"effects: {{{GRAVITY}, {TENSION}, viscosity: {{}}}}\n"
     "blocks: [{liquid: aqueous, lower: [0, 0, 0], upper: [0.1, 0.1, 0.1]}]",
     {"gravity": "the liquids differ by 0 kg/m3", "interface_tension": "it acts between 2 liquids, but 1 is ever",
      "viscosity": "U is 0 m/s"}),
    # A free surface needs its weight.
    ("blocks: [{liquid: silicone_oil_1000, lower: [0, 0, 0], upper: [0.1, 0.05, 0.1]}]",
     {"gravity": "the liquid has a free surface"}),
    # An eye that turns: 0.1 deg of 0.1 m is less than a spacing, and what is cut off is said.
    ("effects: {viscosity: {}, gravity: {}, eye_rotation: {oscillation: {amplitude: 0.1 deg, frequency: 5 Hz}}}",
     {"eye_rotation": "cannot be seen: the wall moves by"}),
    ("effects: {viscosity: {}, gravity: {}, eye_rotation: {saccades: [{start: 1.99 s, amplitude: 30 deg}]}}",
     {"eye_rotation": "the last one ends at 2.08 s, but the scene at 2 s"}),
    # What the scene does not reach.
    ("effects: {gravity: {turns: [{start: 3 s, to: prone}], jolts: [{start: 1 s, acceleration: [0, 9, 0]}]}, "
     "viscosity: {}}", {"gravity": "the turn to prone is not reached: it starts at 3 s, but the scene ends at 2 s"}),
])
def test_warnings_are_exactly_those(advised, text, expected):
    found = advised(text)
    assert sorted(effect for effect, _ in found) == sorted(expected), found
    for effect, sentence in found:
        assert expected[effect] in sentence


@pytest.mark.parametrize(("name", "warned"), [
    ("tamponade", []), ("emulsification", []), ("saccades", []), ("resting_eye", []), ("s1_tamponade_gamma3", []),
    ("coupling_2d", []), ("coupling_2d_dfsph", []), ("coupling_2d_wcsph", []),
    ("pbf_dam", []), ("pbf_stuck_on_wall", []),
    ("still_eye", ["interface_tension"]), ("jolted_eye", ["interface_tension"]),  # both leave it out on purpose
    ("s1_tamponade_gamma0", ["cohesion", "curvature", "interface_tension"]),  # gamma = 0 is the point of the scene
    ("tiny", ["gravity", "injection"]),  # ends before the fill is reached and before the patient turns
])
def test_warnings_of_the_shipped_scenes(name, warned):
    case = shipped(name)
    report = report_of(case, cavity_volume(case))
    assert sorted(one.effect for one in report.advice if one.level == WARNING) == warned


def test_films_that_would_stay_are_warned_of_where_oil_comes_over_a_wetted_wall(advised):
    (effect, sentence), = advised("effects: {wall_film: null}", "tamponade")
    # 35 kg/m3 x 9.81 m/s2 x (1 mm)^2 / (12 x 0.7 mPa s)
    assert effect == "wall_film" and "is missing and would be seen" in sentence and "40.9 mm/s" in sentence
    assert not advised("effects: {wall_film: null}", "resting_eye")
    assert "lets a film as thick as a particle slide at 40.9 mm/s" in dict(
        advised("title: A", "tamponade", SEEN_EFFECT))["wall_film"]
    (effect, sentence), = advised("effects: {wall_film: {coefficient: 0}}", "tamponade")
    assert effect == "wall_film" and sentence.startswith("does nothing: its coefficient is 0")


def test_layers_are_told_what_lets_them_rest(advised):
    layers = f"effects: {{{GRAVITY}, viscosity: {{}}}}"
    assert "with 0 N/m it lets layers" in dict(advised(layers, level=NOTE))["interface_tension"]
    assert "0 N/m" not in dict(advised(EQUAL + layers, level=NOTE)).get("interface_tension", "")
    for coefficient in ("0 N/m", "1e-6 N/m"):
        with_it = f"effects: {{{GRAVITY}, viscosity: {{}}, interface_tension: {{coefficient: {coefficient}}}}}"
        assert not advised(with_it)
        assert "lets layers of unequal weight rest" in dict(advised(with_it, level=NOTE))["interface_tension"]


def test_oil_without_viscosity_is_warned_of_with_its_ohnesorge_number(advised):
    (effect, sentence), = advised("effects: {viscosity_implicit: null}", "resting_eye")
    assert effect == "viscosity_implicit" and "Oh = 1.53 (damped from 0.1)" in sentence


def test_fill_is_unknown_after_another_scene(advised):
    text = "start_from: tamponade\neffects: {injection: {fill: 95 %}}\noutput: {duration: 2 s}"
    assert "injection" not in dict(advised(text, "tamponade"))
    assert "may not reach its fill: it would end at 2.67 s if the scene before had left none" in dict(
        advised(text, "tamponade", NOTE))["injection"]


def test_contact_angle_of_90_degrees_is_neutral(advised):
    def bend(angle: str) -> str:
        effects = f"effects: {{interface_tension: {{contact_angle: {angle}}}}}"
        return [*advised(effects, "tamponade", SEEN_EFFECT), *advised(effects, "tamponade", NOTE)]

    assert any("90 deg bends the interface at the wall by 0 m" in sentence for _, sentence in bend("90 deg"))
    # Bo = 1.04: L/sqrt(Bo) sqrt(2 (1 - sin 18.2 deg)) = 10.8 mm x 1.173
    assert any("18.2 deg bends the interface at the wall by 12.7 mm" in sentence for _, sentence in bend("18.2 deg"))


def test_layer_thinner_than_a_spacing_is_noted():
    # sqrt(nu L/U) = sqrt(0.7e-6 m2/s x 0.265 s) = 0.429 mm for the aqueous.
    for level, expected in (("draft", 1), ("fine", 0)):
        notes = [one.sentence for one in report_of(shipped("tamponade", level), REFERENCE_VOLUME).advice
                 if one.level == NOTE]
        assert sum("layer of aqueous in which it acts is not resolved: 0.429 mm" in one for one in notes) == expected


def test_an_effect_without_a_rule_is_named(monkeypatch):
    monkeypatch.setattr("pipeline.advice.rules.ADVISED", {"injection"})
    found = [one for one in report_of(shipped("still_eye"), REFERENCE_VOLUME).advice if "no advice" in one.sentence]
    assert {one.effect for one in found} == {"gravity", "viscosity_implicit"} and found[0].level == NOTE


# What is written

@pytest.mark.parametrize("level", LEVELS)
@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.stem)
def test_every_shipped_scene_is_advised(path, level):
    case = load_scene(path, level)
    report = report_of(case, cavity_volume(case) if case.container else REFERENCE_VOLUME)
    for quantity in (*report.size, *report.speeds, *report.numbers, *report.times):
        assert np.isfinite(quantity.value) and quantity.value >= 0.0 and quantity.meaning
    assert 0.0 < report.time_step <= case.numerics.maximum_time_step and report.steps >= case.frame_count - 1
    text, page, data = text_of(report), html_of(report), json.loads(json_of(report))
    for one in report.advice:
        assert f"  {one.effect}: {one.sentence}.\n" in text
        assert any(character.isdigit() for character in one.sentence), one.sentence
    for told in (text, page):
        assert "To switch an effect off, even an inherited one, set it to null" in told
    assert "<table" not in re.sub(r"<details.*?</details>", "", page, flags=re.DOTALL), "tables open on a click"
    tables = [report.size, report.speeds, report.numbers, report.times, report.time_step_limits]
    assert page.startswith("<!doctype html>") and page.count("<tr>") == sum(1 + len(rows) for rows in tables if rows)
    assert data["steps"] == report.steps and len(data["advice"]) == len(report.advice)
    assert [limit["value"] for limit in data["time_step_limits"]] == [
        limit.value if np.isfinite(limit.value) else None for limit in report.time_step_limits]


@pytest.mark.parametrize(("value", "unit", "text"), [
    (0.0106, "m", "10.6 mm"), (0.505, "m", "0.505 m"), (1.94e-5, "s", "0.0194 ms"), (4.85, "m/s", "4.85 m/s"),
    (0.973, "", "0.973"), (math.inf, "s", "none"), (0.0, "m", "0 m"), (0.01, "m/s2", "0.01 m/s2"),
])
def test_numbers_are_written_for_people(value, unit, text):
    assert shown(value, unit) == text


advise = functools.partial(forked.run, "pipeline.advise")


@pytest.mark.thorough
def test_command_line_warns_and_succeeds(config, tmp_path):
    case = config / "scenes" / "unseen.yaml"
    case.write_text(f"extends: box\neffects: {{{GRAVITY}}}\n")
    result = advise(case, "--accuracy", "standard")
    assert result.returncode == 0 and not result.stderr
    assert result.stdout.startswith("unseen (standard)")
    assert "Warnings\n  viscosity: is missing and would be seen: silicone_oil_1000" in result.stdout
    main([str(case), "--format", "json", "--output", str(tmp_path / "advice.json")])
    assert json.loads((tmp_path / "advice.json").read_text())["scene"] == "unseen"


@pytest.mark.thorough
def test_wrong_input_is_a_sentence(config, tmp_path):
    case = config / "scenes" / "wrong.yaml"
    case.write_text("extends: box\neffects: {gravitty: {}}\n")
    result = advise(case)
    assert result.returncode == 2 and not result.stdout
    assert result.stderr.startswith("error: ") and "did you mean gravity?" in result.stderr
    assert "Traceback" not in result.stderr
    resolved = tmp_path / "scene.json"
    resolved.write_text(shipped("coupling_2d").to_json())
    main([str(resolved), "--format", "html", "--output", str(tmp_path / "advice.html")])
    with pytest.raises(UserError, match="resolved already"):
        main([str(resolved), "--accuracy", "fine"])


# In the workflow

def test_advice_does_not_make_a_simulation_run_again():
    simulated = {str(path.relative_to(digest.ROOT)) for path in modules_used("pipeline.simulate", {"gravity"})}
    assert "pipeline/simulate.py" in simulated
    assert not any(path.startswith(("pipeline/advise.py", "pipeline/advice/")) for path in simulated)
    advised = {str(path.relative_to(digest.ROOT)) for path in modules_used("pipeline.advise", {"viscosity"})}
    assert {"pipeline/advise.py", "pipeline/advice/rules.py", "sim/effects/viscosity.py"} <= advised


@pytest.mark.thorough
@pytest.mark.parametrize(("old", "new", "again"), [
    ("is missing and would be seen: {cause}", "is missed: {cause}", {"pipeline.advise"}),  # a sentence
    ("and turns must not overlap", "and turns follow each other", {"pipeline.advise"}),  # of a check
    ("(1.0 - self.reference_density *", "(2.0 - self.reference_density *",  # a force
     {"pipeline.advise", "pipeline.simulate", "pipeline.metrics", "pipeline.reconstruct"}),
])
def test_a_new_sentence_of_an_effect_simulates_nothing_again(tmp_path, monkeypatch, old, new, again):
    for package in ("pipeline", "sim"):
        shutil.copytree(ROOT / package, tmp_path / package)
    monkeypatch.setattr("pipeline.base.digest.ROOT", tmp_path)
    stages = ("pipeline.advise", "pipeline.simulate", "pipeline.metrics", "pipeline.voxelize", "pipeline.reconstruct")
    before = {stage: code_used(stage, {"gravity"}) for stage in stages}
    path = tmp_path / "sim" / "effects" / "gravity.py"
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))
    assert {stage for stage in stages if code_used(stage, {"gravity"}) != before[stage]} == again
    # Those of other scenes do not depend on it, but for what can be said of its absence.
    path.write_text(text)
    before = {stage: code_used(stage, {"viscosity"}) for stage in stages}
    path.write_text(text.replace(old, new))
    assert {stage for stage in stages if code_used(stage, {"viscosity"}) != before[stage]} == {"pipeline.advise"}


@pytest.mark.thorough
def test_simulation_prints_the_advice_first(scene, tmp_path):
    """The log of a run begins with the lines of the advice on its scene."""
    case = scene("numerics: {particle_spacing: 10 mm, scheme: position_based}\n"
                 "effects: {gravity: {}}\noutput: {duration: 0.01 s, frame_interval: 0.01 s}\n"
                 "blocks: [{liquid: aqueous, lower: [0, 0, 0], upper: [0.1, 0.05, 0.1]}]")
    (tmp_path / "scene.json").write_text(case.to_json())
    for stage in (["eye", "scene.json", "--output", "eye.vtp", "--report", "eye.json"],
                  ["voxelize", "scene.json", "eye.vtp", "--output", "initial.npz", "--report", "voxelize.json"],
                  ["simulate", "scene.json", "initial.npz", "--frames", "frames", "--checkpoint", "end.npz"]):
        result = forked.run(f"pipeline.{stage[0]}", *stage[1:], folder=tmp_path)
        assert result.returncode == 0, result.stderr
    assert text_of(report_of(case, 1e-3)) in result.stdout
    assert result.stdout.index("case (draft). Estimates") < result.stdout.index("steps so far")


@pytest.mark.thorough
def test_advice_is_a_target_of_the_workflow(project):
    code, output = project.snakemake("-n", "outputs/tiny/draft/advice.html")
    assert code == 0, output
    assert "advise" in output and "simulate" not in output
