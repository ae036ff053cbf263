"""Scene and study files are data, be they a stranger's: limits, YAML without traps, no path out of the project."""
import contextlib
import json
import os
import shutil
import sys

import pytest
from helpers.cases import thorough

from pipeline.base.errors import UserError
from pipeline.forecast.measurement import KEPT
from pipeline.planning.search import CACHE
from pipeline.scenes.checks import TAKEN
from pipeline.scenes.load import PROJECT_CONFIG, load_accuracy_levels, load_resolved, load_scene
from pipeline.scenes.reader import MOST_MESSAGES
from pipeline.scenes.yaml_files import MOST_BYTES
from pipeline.studies.plan import load_study
from pipeline.study import OUTPUTS as STUDY_OUTPUTS

BOX = ("dimension: 2\nliquids: [aqueous]\ncontainer: {size: [1, 1]}\n"
       "numerics: {particle_spacing: 0.01, scheme: dfsph}\noutput: {duration: 1}\n")


@pytest.fixture
def write(tmp_path):
    """Write a scene into a project of its own and return its path."""
    shutil.copytree(PROJECT_CONFIG, tmp_path / "project" / "config")

    def write_scene(text, name="case"):
        path = tmp_path / "project" / "config" / "scenes" / f"{name}.yaml"
        path.write_text(text, encoding="utf-8")
        return path
    return write_scene


def errors_of(path):
    """Return the sentences about a scene that is refused; each is one line that a terminal shows as it is."""
    with pytest.raises(UserError) as caught:
        load_scene(path, "draft")
    assert all(message.isprintable() and len(message) < 2000 for message in caught.value.messages)
    return caught.value.messages


# What YAML 1.1 makes of words

@pytest.mark.parametrize(("text", "read"), [
    ("numerics: {seed: 010}", lambda scene: scene.numerics.seed == 10),
    ("title: 2024-01-01", lambda scene: scene.title == "2024-01-01"),
    ("title: 1:30", lambda scene: scene.title == "1:30"),
    ("title: yes", lambda scene: scene.title == "yes"),
    ("output: {duration: 2e-1}", lambda scene: scene.output.duration == 0.2),
    ("output: {duration: +.2}", lambda scene: scene.output.duration == 0.2),
])
def test_words_are_read_as_people_read_them(text, read, write):
    assert read(load_scene(write(f"extends: tiny\n{text}\n"), "draft"))


@pytest.mark.parametrize(("text", "sentence"), [
    ("output: {duration: 1:30}", 'output.duration is "1:30"'),
    ("eye: {force: yes}", 'eye.force is "yes", but must be true or false'),
    ("eye: {force: on}", 'eye.force is "on", but must be true or false'),
    ("numerics: {seed: 0x10}", 'numerics.seed is "0x10"'),
    ("numerics: {seed: 1_000}", 'numerics.seed is "1_000"'),
    ("title: !!python/object/apply:os.system [touch hacked]", "line 2, column 8: tags"),
    ("title: !!binary aGVsbG8=", "line 2, column 8: tags"),
    ("title: &a x\nlabel: *a", "line 2, column 8: anchors"),
    ("<<: {title: x}", "<< is not known"),
    ("title: a\ntitle: b", "line 3, column 1: title is given twice"),
    ("title: " + "[" * 10**5, "lists and mappings lie in each other more than 20 deep"),
    ("title: " + "{a: " * 10**4, "lists and mappings lie in each other more than 20 deep"),
    ("title: " + "a" * MOST_BYTES, f"but must have at most {MOST_BYTES}"),
    ("numerics: {seed: " + "9" * 10**4 + "}", "numerics.seed is inf, but must be a finite number"),
    ("output:\n\tduration: 1 s", "line 3, column 1: a tab, but lines are indented by blanks"),
    ("title: Fluid: oil", "line 2, column 13: a colon where none can be: text with a colon must be in quotes"),
    ("title: @home", "text that begins with a sign such as @, % or * must be in quotes"),
    ("title: *bold*", "text that begins with a sign such as @, % or * must be in quotes"),
    ("title: 'never ends", "the quotes of a text are not closed"),
    ("output: {duration: 1 s", "a bracket is not closed before the end of the file"),
    ("effects: {gravity: {posture: upright}", "a bracket is not closed"),
    ("effects: {gravity: upright}}", "does not fit to what stands before"),
    ("effects\uff1a{gravity: {posture: upright}}", "the full-width sign \uff1a is text here (did you mean :?)"),
])
def test_traps_of_yaml_are_sentences(text, sentence, write):
    assert any(sentence in message for message in errors_of(write(f"extends: tiny\n{text}\n")))


def test_many_anchors_of_a_bomb_are_one_sentence(write):
    lines = ["a0: &a0 [x]"] + [f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 9)}]" for n in range(1, 30)]
    assert len(errors_of(write("\n".join(lines)))) == 1


# Texts

def test_line_breaks_in_texts_are_spaces(write):
    text = 'extends: tiny\ntitle: "two\\nlines \\u2028 and"\nlabel: >\n  folded\n\n  text\n'
    scene = load_scene(write(text), "draft")
    assert (scene.title, scene.label) == ("two lines and", "folded text")


@pytest.mark.parametrize("text", ["\\ud800", "\\0", "\\e[2J", "\\u0085\\b", "\\x9b31m"])
@pytest.mark.parametrize("key", ["title", "label", "description"])
def test_texts_that_cannot_be_written_are_refused(key, text, write):
    message, = errors_of(write(f'extends: tiny\n{key}: "a{text}b"\n'))
    assert f"{key} is " in message and "characters that can be written" in message


def test_texts_have_an_end(write):
    message, = errors_of(write(f"extends: tiny\ntitle: {'a ' * 500}\n"))
    assert "at most 200 characters" in message and len(message) < 400


@pytest.mark.parametrize("key", ['"\\e[31m"', '"a\\nb"', '"\\ud800"', "x" * 5000])
def test_keys_cannot_break_a_message(key, write):
    assert "is not known" in errors_of(write(f"extends: tiny\n? {key}\n: 1\n"))[0]


# Numbers

@pytest.mark.parametrize(("key", "value"), [
    ("second_means", "1e308 h"), ("duration", f'"1{" " * 30000}x{" " * 30000}y"'), ("frame_interval", "1e-320"),
    ("duration", ".inf"), ("second_means", "1e31 s"), ("second_means", "1e-31 s")])
def test_numbers_without_end_are_refused(key, value, write):
    assert f"output.{key} " in errors_of(write(f"extends: tiny\noutput: {{{key}: {value}}}"))[0]


@pytest.mark.parametrize("corners", [
    "lower: [], upper: []", "lower: [0, 0], upper: [1e29, 1e29]", "lower: [-1e29, 0], upper: [1e29, 0]",
    "lower: [0, 0], upper: [1e308, 1e308]", "lower: [1e29, 1e29], upper: [-1e29, -1e29]"])
def test_endless_blocks_are_sentences(corners, write):
    assert "blocks[0]." in errors_of(write(f"{BOX}blocks: [{{liquid: aqueous, {corners}}}]\n"))[0]


@pytest.mark.thorough
def test_many_errors_are_counted(write):
    block = "- {liquid: aqueous, lower: [0, 0], upper: [1, 1]}\n"
    messages = errors_of(write(f"{BOX}blocks:\n{block * 300}"))
    assert len(messages) == MOST_MESSAGES + 1 and messages[-1].endswith("case.yaml: and 279 more errors")
    assert errors_of(write(f"{BOX}blocks:\n{block * 1500}"))[0].endswith("has 1500 entries, but must have at most 1000")


@pytest.mark.thorough
def test_liquids_named_again_and_again_are_one_sentence(write):
    messages = errors_of(write(f"extends: tiny\nliquids: [{'aqueous, ' * 20000}]\n"))
    assert messages[0].endswith("liquids names aqueous more than once, but every liquid is one phase")


# Cost

@pytest.mark.parametrize("key", ["time_step", "maximum_time_step"])
def test_endless_runs_are_asked_back(key, write):
    text = f"extends: tiny\nnumerics: {{{key}: 1e-12, minimum_time_step: 1e-13}}\n"
    message, = errors_of(write(text))
    assert f"because of numerics.{key}" in message and "allowed_time is 7 days" in message
    days = message.split("takes ")[1].split(" days")[0]
    assert float(days) > 100
    assert load_scene(write(f"{text}allowed_time: {float(days) + 1} days\n"), "draft").frame_count > 1


def test_too_many_segments_are_refused(write):
    text = ("extends: tiny\noutput: {{duration: 90 s, frame_interval: 10 ms, allowed_frames: 9001, "
            "frames_per_segment: {}}}\n")
    message, = errors_of(write(text.format(8)))
    assert "output.frames_per_segment is 8, but must be at least 9," in message
    assert load_scene(write(text.format(9)), "draft").segment_count == 1000


@pytest.mark.parametrize("spacing", ["0.02 mm", "2 nm"])
def test_too_fine_a_mesh_eye_is_refused_before_it_is_read(spacing, write, monkeypatch):
    from pipeline.scenes import memory_check

    monkeypatch.setattr(memory_check, "memory_of_computer", lambda: 8.0 * 2**30)
    path = write(f"extends: tiny\neye: {{model: mesh, path: eye.stl}}\nnumerics: {{particle_spacing: {spacing}}}\n")
    path.with_name("eye.stl").write_text("not read")
    assert "for the 8 GiB of this computer" in errors_of(path)[0]


@pytest.mark.parametrize(("method", "fits"), [("flying_edges", 0.34), ("sharp", 0.14)])
def test_surfaces_that_do_not_fit_into_memory_are_refused(method, fits, write, monkeypatch):
    from pipeline.scenes import memory_check

    monkeypatch.setattr(memory_check, "memory_of_computer", lambda: 1e9)
    text = "extends: tiny\nnumerics: {particle_spacing: 0.3 mm}\noutput: {contour: METHOD, cell_ratio: RATIO}\n"
    text = text.replace("METHOD", method)
    message, = errors_of(write(text.replace("RATIO", "0.1")))
    assert "output.cell_ratio is 0.1, which makes 3.6e+08 cells that need " in message
    assert f"must be at least {fits} " in message
    load_scene(write(text.replace("RATIO", f"{fits}")), "draft")


def test_scenes_that_start_from_each_other_are_read_once_each(write):
    for number in range(25):
        path = write(f"extends: tiny\n{f'start_from: s{number - 1}' if number else ''}\n", f"s{number}")
    assert load_scene(path, "draft").start_from == "s23"


@pytest.mark.parametrize("key", ["extends", thorough("start_from")])
def test_endless_chains_are_one_sentence(key, write):
    for number in range(400):
        path = write("extends: tiny\n" if not number else f"{key}: c{number - 1}\n" + "extends: tiny\n" * (
            key != "extends"), f"c{number}")
    assert any(f"more than 30 scenes follow each other by `{key}`" in message for message in errors_of(path))


# Names and paths

@pytest.mark.parametrize("name", [*TAKEN, "Studies", "a" * 101, "a.b"])
def test_names_of_other_folders_are_taken(name, write):
    assert any("a scene " in message for message in errors_of(write("extends: tiny\n", name)))


def test_every_folder_beside_the_scenes_is_taken():
    assert {path.parts[1] for path in (KEPT, CACHE, STUDY_OUTPUTS)} < set(TAKEN)


@pytest.mark.parametrize("name", ["logs", "all"])
def test_levels_cannot_be_named_like_other_things(name, tmp_path):
    path = tmp_path / "accuracy.yaml"
    path.write_text(f"{name}: {{particle_spacing: 1 mm}}\n")
    with pytest.raises(UserError, match=rf"{name} is no name for a level"):
        load_accuracy_levels(path)


@pytest.mark.parametrize("place", ["../../../eye.stl", "{absolute}", "../../../project2/eye.stl", "./../../../eye.stl"])
def test_no_mesh_outside_of_the_project(place, write, tmp_path):
    for folder in (tmp_path, tmp_path / "project2"):
        folder.mkdir(exist_ok=True)
        (folder / "eye.stl").write_text("")
    name = place.format(absolute=tmp_path / "eye.stl")
    message, = errors_of(write(f"extends: tiny\neye: {{model: mesh, path: {name}}}\n"))
    assert f"outside of the project ({tmp_path / 'project'})" in message and "ln -s" in message


def test_no_table_outside_of_the_project(write, tmp_path):
    (tmp_path / "head.csv").write_text("time [s],pitch [deg],roll [deg]\n0,0,0\n1,0,0\n")
    text = "extends: tiny\neffects: {gravity: {turns: null, posture: null, orientation: PLACE}}\n"
    assert "outside of the project" in errors_of(write(text.replace("PLACE", "../../../head.csv")))[0]
    path = write(text.replace("PLACE", "head.csv"))
    os.symlink(tmp_path / "head.csv", path.with_name("head.csv"))
    assert len(load_scene(path, "draft").effects["gravity"].orientation) == 2


@pytest.mark.parametrize("place", ["eye.stl", "../meshes/eye.stl", "../../eye.stl", "linked/eye.stl"])
def test_meshes_of_the_project_and_links_that_a_user_made_are_read(place, write, tmp_path):
    path = write(f"extends: tiny\neye: {{model: mesh, path: {place}}}\n")
    (tmp_path / "elsewhere").mkdir()
    os.symlink(tmp_path / "elsewhere", path.parent / "linked")
    (path.parent / place).parent.mkdir(exist_ok=True)
    (path.parent / place).write_text("")
    assert os.path.samefile(load_scene(path, "draft").eye.path, path.parent / place)


def test_no_mesh_outside_of_the_folder_of_a_scene_without_a_project(tmp_path):
    (tmp_path / "eye.stl").write_text("")
    (tmp_path / "scenes").mkdir()
    path = tmp_path / "scenes" / "case.yaml"
    path.write_text("liquids: [aqueous]\noutput: {duration: 1}\neye: {model: mesh, path: ../eye.stl}\n")
    assert "outside of the project" in errors_of(path)[0]


# Resolved scenes and studies

@pytest.mark.parametrize(("change", "sentence"), [
    ({"name": "../../x"}, 'a scene named "../../x" cannot name a folder'),
    ({"accuracy": "../x"}, 'accuracy names "../x", but'), ({"start_from": "../x"}, 'start_from names "../x", but'),
    ({"title": "\ud800"}, r'title is "\ud800", but'),
    ({"liquids": [{"name": "../x", "density": 1.0, "dynamic_viscosity": 1.0}]}, 'liquids names "../x", but'),
])
def test_resolved_scenes_are_checked_too(change, sentence, tmp_path):
    scene = json.loads(load_scene(PROJECT_CONFIG / "scenes" / "still_eye.yaml", "draft").to_json())
    scene |= {"effects": {}, "initial": {}}
    path = tmp_path / "scene.json"
    path.write_text(json.dumps(scene | change))
    with pytest.raises(UserError) as caught:
        load_resolved(path)
    assert any(sentence in message for message in caught.value.messages)


@pytest.mark.parametrize("text", ["[" * 10**5, '{"name": ' + "9" * 5000 + "}", "NaN", '"\\ud800"', "\ufeff{}", "[]"])
def test_spoiled_resolved_scenes_are_sentences(text, tmp_path):
    path = tmp_path / "scene.json"
    path.write_text(text)
    with pytest.raises(UserError):
        load_resolved(path)


def test_cases_of_a_study_name_no_folders_elsewhere(tmp_path):
    text = "cases: {ink_drop: {scenes: [ink_drop], ink: [ink, ../../../x]}}\n"
    (tmp_path / "bad.yaml").write_text(text)
    with pytest.raises(UserError, match=r'cases.ink_drop would name a case "ink_drop-../../../x"'):
        load_study("bad", "draft", tmp_path)


def test_endless_combinations_of_a_study_are_refused(tmp_path):
    many = list(range(2, 300))
    (tmp_path / "bad.yaml").write_text(f"cases: {{laplace: {{seed: {many}, tension: {many}, radius: {many}}}}}\n")
    with pytest.raises(UserError, match=r"cases.laplace has 26463592 combinations, but must have at most 10000"):
        load_study("bad", "draft", tmp_path)


@pytest.mark.thorough
def test_reading_a_scene_runs_nothing(write, tmp_path, monkeypatch):
    """Payloads of known attacks stay text; an audit hook would see a command, a pickle or a file that is written."""
    monkeypatch.chdir(tmp_path)
    seen = []
    active = [True]
    sys.addaudithook(lambda event, args: seen.append(event) if active[0] and event in (
        "os.system", "subprocess.Popen", "os.exec", "os.posix_spawn", "pickle.find_class") else None)
    for payload in ("__import__('os').system('touch hacked')", "${IFS}$(touch hacked)", "{{ 7 * 7 }}", "{0.__class__}",
                    "1 m**9**9**9", "9**9**9", "=cmd|' /C calc'!A0"):
        for key in ("title: {}", "output: {{duration: {}}}", "eye: {{model: mesh, path: {}}}", "extends: {}"):
            path = write(f"{'' if key.startswith('extends') else 'extends: tiny'}\n" + key.format(json.dumps(payload)))
            with contextlib.suppress(UserError):
                assert load_scene(path, "draft").title == payload
    active[0] = False
    assert not seen and sorted(os.listdir(tmp_path)) == ["project"]
