"""The estimate: phases are those of the scene, what was measured adds up to a whole, and the command refuses what it
must."""
import csv
import dataclasses
import itertools
import json
import math
import os
import re
import subprocess
import sys

import numpy as np
import pytest
from conftest import ROOT
from helpers import forked

from pipeline import cost
from pipeline.base.errors import UserError
from pipeline.base.frame_files import find_frames, read_frame
from pipeline.base.usage import KINDS, run_stage
from pipeline.base.words import duration, memory
from pipeline.cavity.container import container_arrays
from pipeline.estimate import Estimate, html_of, json_of, main, notes, text_of
from pipeline.forecast import measurement, prediction, retina_error
from pipeline.forecast.expected_error import COLUMNS, ORDERS, SHIPPED, expected_errors
from pipeline.forecast.measurement import coarser, measured, rehearsal_spacings
from pipeline.forecast.phases import Phase, phases_of, state_in
from pipeline.forecast.prediction import predict, spans
from pipeline.forecast.probe import SHORTEST, as_usage, mix_ahead, probe, rehearse, take_steps
from pipeline.forecast.scene_errors import errors_of
from pipeline.forecast.step_error import step_errors
from pipeline.scenes.fill import fill_at_start
from pipeline.scenes.load import load_accuracy_levels, load_scene
from pipeline.simulation.solver_setup import build_solver
from pipeline.studies.plan import load_study
from studies.validation.tradeoff_page import orders_of, points_of

SCENES = ROOT / "config" / "scenes"
LEVELS = tuple(load_accuracy_levels(ROOT / "config" / "accuracy.yaml"))
CAVITY = 5.05e-6  # m3, of the eye of the scenes
STEP = {"wall": 0.1, "cpu": 0.15, "time_step": 2e-3, "pressure_iterations": 10.0, "viscosity_iterations": 5.0,
        "part pressure": 0.05, "steps": 14}
BOX = """
dimension: 2
container: {size: [0.4 m, 0.4 m]}
liquids: [light_liquid, heavy_liquid]
blocks:
  - {liquid: heavy_liquid, lower: [0 m, 0 m], upper: [0.2 m, 0.2 m]}
  - {liquid: light_liquid, lower: [0 m, 0.2 m], upper: [0.2 m, 0.3 m]}
effects: {gravity: {}}
numerics: {particle_spacing: 10 mm}
output: {duration: 0.1 s, frame_interval: 0.05 s}
"""


FLOW = """
dimension: 2
container: {size: [20 mm, 20 mm]}
liquids: [aqueous, silicone_oil_1000]
initial: {liquid: aqueous}
effects:
  gravity: {}
  injection:
    {liquid: silicone_oil_1000, drained_liquid: aqueous, flow: 1.0e-4, fill: 40 %, cannula: [10 mm, 15 mm, 0 mm],
     drain: [10 mm, 3 mm, 0 mm]}
numerics: {particle_spacing: 1 mm}
output: {duration: 2 s}
"""


LAYERS = """
dimension: 2
container: {size: [20 mm, 20 mm]}
liquids: [aqueous, silicone_oil_1000]
initial: {fill: {aqueous: 50 %, silicone_oil_1000: 50 %}}
effects: {gravity: {}, viscosity_implicit: {}, diffusion: {coefficient: 4.0e-6 m2/s}}
numerics: {particle_spacing: 1 mm}
output: {duration: 2 s}
"""


def load(name: str, level: str = "draft"):
    return load_scene(SCENES / f"{name}.yaml", level)


def rehearsal(spacing: float, frames: list[dict], *failed: str) -> dict:
    return {"spacing": spacing, "frames": frames, "failed": list(failed)}


def synthetic(scene, **changes) -> dict:
    """A measurement in which a step takes 0.1 s, a process 2 s and a frame of every stage 0.5 s."""
    stage = {"start": {"wall": 1.0, "cpu": 1.0}, "frame": {"wall": 0.5, "cpu": 0.5}, "memory": 2e8, "disk": 1e5}
    both = {"wall": 2.0, "cpu": 2.0}
    phases = [dataclasses.asdict(phase) | STEP for phase in phases_of(scene, CAVITY, SCENES)]
    frames = [STEP] * (scene.frame_count - 1)
    rehearsals = [] if scene.closed else [rehearsal(scene.numerics.particle_spacing, frames)]
    return {
        "probe": {"particles": 5000, "wall_particles": 3000, "limit": 2e-3, "imports": both, "start": both,
                  "frame": {"wall": 0.1, "cpu": 0.1}, "phases": phases, "failed": [],
                  "disk": {"frame": 3e5, "checkpoint": 1e6}},
        "rehearsals": rehearsals, "cavity_volume": CAVITY, "memory": 3e8,
        "stages": dict.fromkeys(("reconstruct", "render", "metrics"), stage),
        "compilation": {"wall": 7.0, "cpu": 7.0}} | changes


# The phases

def test_phases_are_those_of_the_scene():
    scene = load("tamponade")
    phases = phases_of(scene, CAVITY, SCENES)
    assert [phase.name for phase in phases] == ["injection", "rest", "turn", "rest"]
    rising = 0.5 * scene.effects["injection"].ramp  # by which a flow that rises first ends later
    np.testing.assert_allclose([phase.end for phase in phases], [rising + 0.85 * CAVITY / 2e-6, 2.3, 2.8, 10.0])
    assert phases[0].begin == 0.0 and all(one.end == other.begin for one, other in itertools.pairwise(phases))
    middle = 0.425 - 0.5 * rising * 2e-6 / CAVITY
    np.testing.assert_allclose([phase.fill["silicone_oil_1000"] for phase in phases], [middle, 0.85, 0.85, 0.85])
    assert all(math.isclose(sum(phase.fill.values()), 1.0) for phase in phases)


def test_a_scene_starts_with_what_the_one_before_it_ends_with():
    assert fill_at_start(load("emulsification"), load) == pytest.approx({"aqueous": 0.15, "silicone_oil_1000": 0.85})
    assert fill_at_start(load("coupling_2d"), load) is None


def test_a_scene_is_probed_from_the_end_of_the_one_before_it_where_that_is_known():
    phases = phases_of(load("emulsification"), CAVITY, SCENES, begun=True)
    assert [phase.name for phase in phases] == ["rest", "turn", "rest"] and all(one.fill is None for one in phases)


def test_free_surface_is_probed_at_the_start_alone():
    phase, = phases_of(load("coupling_2d"), 1.0, SCENES)
    assert (phase.begin, phase.end, phase.fill) == (0.0, 3.0, None)


# The steps

@pytest.fixture(scope="module")
def write(tmp_path_factory):
    """Return a function that loads a scene from its text."""
    def written(text: str, name: str):
        path = tmp_path_factory.mktemp("scenes") / f"{name}.yaml"
        path.write_text(text)
        return load_scene(path, "draft")
    return written


@pytest.fixture(scope="module")
def box(write):
    """Return a small dam in two dimensions."""
    return write(BOX, "box")


@pytest.fixture(scope="module")
def probed(taichi, box, tmp_path_factory):
    """Return what the probe of the box has found."""
    folder = tmp_path_factory.mktemp("probe")
    (folder / "frames").mkdir()
    return probe(box, container_arrays(box), phases_of(box, 0.16, SCENES), 60.0, folder / "frames")


@pytest.mark.thorough
def test_probe_takes_steps_of_the_scene(box, probed):
    phase, = probed["phases"]
    assert probed["particles"] == 600 and phase["steps"] >= 90 and not probed["failed"]
    assert 0.0 < phase["time_step"] < 1.001 * box.numerics.maximum_time_step and phase["pressure_iterations"] > 0.0
    assert all(phase["wall"] >= phase[kind] / os.cpu_count() > 0.0 for kind in KINDS)


@pytest.mark.thorough
def test_short_steps_are_taken_for_longer_than_a_moment(probed):
    phase, = probed["phases"]
    assert phase["steps"] * phase["cpu"] > 0.5 * SHORTEST  # 90 steps take 0.9 s


@pytest.mark.thorough
def test_phases_of_liquids_left_as_they_are_go_on_from_one_another(box, taichi, tmp_path, monkeypatch):
    def height(frame) -> float:
        return float(frame.position[:, 1].mean(dtype=float))

    monkeypatch.setattr("pipeline.forecast.probe.SHORTEST", 0.0)  # as many steps of both
    arrays = container_arrays(box)
    probe(box, arrays, [Phase("start", 0.0, 0.05), Phase("rest", 0.05, 0.1)], 60.0, tmp_path)
    start = float(arrays["fluid_position"][:, 1].mean())
    fallen = [start - height(read_frame(path)) for path in find_frames(tmp_path)]
    assert fallen[1] > 1.5 * fallen[0] > 0.0


@pytest.mark.thorough
def test_parts_of_a_step_are_not_more_than_the_step(taichi, box):
    for step in take_steps(build_solver(box, container_arrays(box)), 5):
        assert 0.0 < sum(value for name, value in step.items() if name.startswith("part ")) <= step["wall"]


@pytest.mark.thorough
def test_rehearsal_tells_the_steps_of_a_finer_scene(taichi, box):
    coarse = coarser(box, 2.0 * box.numerics.particle_spacing)
    assert coarse.numerics.maximum_time_step == 2.0 * box.numerics.maximum_time_step
    found = rehearse(coarse, container_arrays(coarse), 60.0)
    assert len(found["frames"]) == 2 and not found["failed"]
    assert all(0.0 < one["time_step"] < 1.001 * coarse.numerics.maximum_time_step for one in found["frames"])


def test_injection_goes_on_from_what_is_in_the_cavity(taichi, write):
    scene = write(FLOW, "flow")
    arrays = container_arrays(scene)
    solver = build_solver(scene, arrays)
    start = solver.state()
    flowing, rest = phases_of(scene, 4e-4, SCENES)
    solver.restore(state_in(scene, solver, start, flowing))

    def oil() -> float:
        phase, volume = solver.particles.to_numpy("phase"), solver.particles.to_numpy("volume").astype(float)
        return volume[phase == 1].sum()

    before = oil()
    time = sum(solver.step() for _ in range(5))
    assert before == pytest.approx(0.2 * 4e-4, rel=0.02) and oil() - before == pytest.approx(1e-4 * time, rel=1e-2)
    solver.restore(state_in(scene, solver, start, rest))
    before = oil()
    for _ in range(3):
        solver.step()
    assert oil() == pytest.approx(before, rel=1e-6) and before == pytest.approx(0.4 * 4e-4, rel=0.02)
    height = solver.particles.to_numpy("position")[:, 1]
    phase = solver.particles.to_numpy("phase")
    assert height[phase == 1].min() > height[phase == 0].max() - 1e-3  # oil floats


# Predictions

@pytest.mark.parametrize("name", ["tamponade", "emulsification", "coupling_2d", "collision_balls"])
def test_prediction_adds_up(name):
    scene = load(name)
    found = predict(scene, synthetic(scene))
    steps = (scene.frame_count - 1) * math.ceil(scene.output.frame_interval / 2e-3 - 1e-9)
    assert found.steps == pytest.approx(steps, abs=2)
    for kind in KINDS:
        assert found.seconds["simulate"][kind] == pytest.approx(
            found.steps * STEP[kind] + 2.0 * scene.segment_count + 0.1 * scene.frame_count)
        assert found.seconds["render"][kind] == scene.segment_count + 0.5 * scene.frame_count
        assert found.seconds["metrics"][kind] == 1.0 + 0.5 * scene.frame_count
    assert found.pressure_iterations == pytest.approx(10.0) and found.viscosity_iterations == pytest.approx(5.0)
    assert found.disk == 3e5 * scene.frame_count + 1e6 * scene.segment_count + 3e5 * scene.frame_count
    assert found.memory == 3e8 and found.notes == ()


def test_the_total_counts_the_cores_that_the_run_has(monkeypatch):
    """Work that keeps several cores busy takes longer on fewer; more than this computer has do not help."""
    monkeypatch.setattr(prediction, "available_cores", lambda: 8)
    scene = load("tamponade")
    measured = synthetic(scene)
    measured["probe"]["phases"] = [phase | {"wall": 0.1, "cpu": 0.8} for phase in measured["probe"]["phases"]]
    found = {cores: predict(scene, measured, cores) for cores in (None, 1, 2, 8, 64)}
    work = sum(stage["cpu"] for stage in found[1].seconds.values())
    assert found[1].total == pytest.approx(work) and found[2].total == pytest.approx(0.5 * work)
    assert found[None].total == found[8].total == found[64].total < 0.5 * found[2].total


def test_wall_time_is_never_below_what_all_cores_need():
    assert as_usage(np.array([1.0, 100.0])) == {"wall": 100.0 / os.cpu_count(), "cpu": 100.0}
    scene = load("tamponade")
    measured = synthetic(scene)
    measured["probe"]["phases"] = [phase | as_usage(np.array([0.01, 1.0])) for phase in measured["probe"]["phases"]]
    found = predict(scene, measured)
    for stage in found.seconds.values():
        assert stage["wall"] >= stage["cpu"] / os.cpu_count() * (1.0 - 1e-9)
    assert found.total >= sum(stage["cpu"] for stage in found.seconds.values()) / os.cpu_count()
    assert found.total >= found.seconds["simulate"]["wall"]


def test_rehearsal_decides_steps_and_iterations():
    scene = load("coupling_2d")
    fast = STEP | {"time_step": 4e-3, "pressure_iterations": 20.0}  # at twice the spacing: 2 ms here
    slow = STEP | {"time_step": 1e-3}
    frames = [slow] * 2 + [fast] * 98 + [slow] * 50
    coarse = 2.0 * scene.numerics.particle_spacing
    measured = synthetic(scene, rehearsals=[rehearsal(coarse, frames)])
    found = list(spans(scene, measured))
    assert [span.steps for span in found] == [40] * 2 + [10] * 98 + [40] * 50
    # Half of a step is the pressure solve, which goes round twice as often.
    assert found[2].cpu == pytest.approx(1.5 * STEP["cpu"]) and found[-1].cpu == pytest.approx(STEP["cpu"])
    assert found[2].pressure_iterations == 20.0
    short = synthetic(scene, rehearsals=[rehearsal(scene.numerics.particle_spacing, frames[:75], "it burst")])
    assert predict(scene, short).steps == 2 * (2 * 20 + 73 * 10)
    assert "rehearsed up to 1.5 s (it burst)" in predict(scene, short).notes[0]
    assert not any("allowed_time" in note for note in predict(scene, short).notes)
    assert "longer than allowed_time, 1 s," in predict(dataclasses.replace(scene, allowed_time=1.0), short).notes[-1]
    refused = rehearsal(coarse, [], "the fixed time step is too large")
    told = predict(scene, synthetic(scene, rehearsals=[refused, refused])).notes[0]
    assert "could not be rehearsed" in told and told.endswith("more: the fixed time step is too large")


def test_steps_grow_from_rehearsal_to_scene_as_between_rehearsals():
    scene = load("coupling_2d")
    own, frame = scene.numerics.particle_spacing, scene.output.frame_interval
    fine = rehearsal(2.0 * own, [STEP | {"time_step": frame / 20}] * 150)  # 40 steps in a frame, at this spacing
    coarse = rehearsal(4.0 * own, [STEP | {"time_step": frame / 8}] * 150)  # 32
    assert predict(scene, synthetic(scene, rehearsals=[fine, coarse])).steps == 150 * 50  # 40 * 40 / 32
    assert predict(scene, synthetic(scene, rehearsals=[fine])).steps == 150 * 40
    short = rehearsal(4.0 * own, coarse["frames"][:10], "it burst")
    assert predict(scene, synthetic(scene, rehearsals=[fine, short])).steps == 150 * 50


@pytest.mark.thorough
def test_liquids_mix_between_the_phases_as_long_as_in_the_scene(taichi, write):
    scene = write(LAYERS, "layers")
    solver = build_solver(scene, container_arrays(scene))
    diffusion, = (effect for effect in solver.effects if effect.name == "diffusion")
    start = solver.state()

    def mixed(function) -> np.ndarray:
        solver.restore(start)
        function()
        # in the order of the numbers: the particles are sorted before they mix
        return solver.particles.to_numpy("volume_fraction")[np.argsort(solver.particles.to_numpy("id"))].astype(float)

    def in_small_steps() -> None:
        solver.search.sort()
        solver.search.build()
        for _ in range(50):
            diffusion.prepare(0.02)

    before, at_once = mixed(lambda: None), mixed(lambda: mix_ahead(solver, 1.0))
    assert solver.time == start["time"] and np.array_equal(
        np.sort(solver.particles.to_numpy("position"), axis=0), np.sort(start["particles.position"], axis=0))
    assert at_once == pytest.approx(mixed(in_small_steps), abs=1e-2)  # sub-steps of another length
    assert at_once.sum(axis=0) == pytest.approx(before.sum(axis=0), rel=1e-5)
    assert np.var(at_once[:, 0]) < 0.8 * np.var(before[:, 0])


def test_phase_that_cannot_be_probed_counts_as_the_others():
    scene = load("tamponade")
    measured = synthetic(scene)
    del measured["probe"]["phases"][0]
    measured["probe"]["failed"] = ["injection from 0 to 2 s: it piles up"]
    found = predict(scene, measured)
    assert found.steps == pytest.approx(5000, rel=0.01) and "it piles up" in found.notes[0]


def test_rehearsal_is_coarse_but_keeps_every_block():
    scene = load("coupling_2d", "fine")
    assert rehearsal_spacings(scene, 116_640) == pytest.approx([3.7e-3 * (116_640 / n)**0.5 for n in (4000, 1000)])
    assert rehearsal_spacings(scene, 8000) == pytest.approx([3.7e-3 * 4.0**0.5, 3.7e-3 * 8.0**0.5])
    assert rehearsal_spacings(scene, 4000) == pytest.approx([3.7e-3 * 2.0])
    assert rehearsal_spacings(scene, 500) == [3.7e-3]
    assert max(rehearsal_spacings(load("egg_funnel"), 10**9)) <= 0.5 * load("egg_funnel").container.funnels[0].thickness


def test_expected_error_is_measured_interpolated_or_carried_over_by_the_order(tmp_path):
    scene, path = load_scene(SCENES / "still_eye.yaml", "draft"), tmp_path / "orders.csv"
    common = {"quantity": "q", "unit": "1", "per_width": 0.5}
    sizes = [{"resolution": 10, "error": 0.04, "least": 0.03, "most": 0.06, "starts": 3},
             {"resolution": 20, "error": 0.02, "least": 0.01, "most": 0.03, "starts": 3}]
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        for case, effects, order in (("a", "gravity viscosity_implicit", 2.0), ("b", "", -0.3),
                                     ("c", "interface_tension", 1.0)):
            writer.writerows(common | {"case": case, "effects": effects, "order": order} | size for size in sizes)
    found = expected_errors(scene, 80.0, path)  # 40 spacings along the case
    assert [one.quantity for one in found] == ["a: q", "b: q"]  # this scene has no tension
    assert found[0].value == pytest.approx(0.02 / 2**2) and "order 2.0 from 20 to 40" in found[0].source
    assert found[0].words == "0.5 %" and "0.25 to 0.75 from 3 starts" in found[0].source
    assert found[1].value == 0.02 and "does not fall steadily" in found[1].source
    measured, = {(one.value, one.source) for one in expected_errors(scene, 21.0, path)}  # 10.5, near 10
    assert measured == (0.04, "orders.csv, at 10 spacings, 3 to 6 from 3 starts")
    between, _ = expected_errors(scene, 2.0 * math.sqrt(200.0), path)
    assert between.value == pytest.approx(0.03) and "between 10 and 20 spacings" in between.source
    level = dataclasses.replace(predict(scene, synthetic(scene)), errors=tuple(found))
    assert notes(level)[0].startswith("expected error, a: q: 0.5 % (")
    assert "unknown" in notes(dataclasses.replace(level, errors=()))[0]


def test_an_estimate_tells_how_near_the_retina_comes_to_rest_at_its_level(tmp_path, monkeypatch):
    path = tmp_path / "eye_errors.csv"
    path.write_text(",".join(retina_error.COLUMNS) + "\ntamponade,0.001,3,1.5,2.2,1.1,3.0\n")
    monkeypatch.setattr(retina_error, "SHIPPED", path)
    scene = load_scene(SCENES / "tamponade.yaml", "draft")
    level = predict(scene, synthetic(scene))
    said = ("expected error, covered retina at rest: within 3 points of the retina (measured on tamponade with "
            "particles of 1 mm, 3 starts; docs/results/accuracy.md)")
    assert notes(level)[0] == said
    found = Estimate("tamponade", "Tamponade", (level,))
    assert f"draft: {said}." in text_of(found) and said in html_of(found)
    assert json.loads(json_of(found))["levels"][0]["errors"][0]["unit"] == "points of the retina"


def shipped_errors():
    with SHIPPED.open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_errors_that_the_project_comes_with_are_those_of_its_study():
    rows, study = shipped_errors(), load_study("accuracy", "draft")
    families = {case.family.name: case.family for case in study.cases.values()}
    assert {row["case"] for row in rows} == families.keys() - {"eye_rest"}  # whose runs do not converge yet
    for row in rows:
        family = families[row["case"]]
        assert row["quantity"] == family.headline.quantity and float(row["per_width"]) == family.headline.per_width
        assert row["effects"] == " ".join(family.shown_by)
        assert float(row["least"]) <= float(row["error"]) <= float(row["most"])


@pytest.mark.parametrize(("level", "particles"), [("draft", 5057), ("standard", 78_979)])
def test_errors_at_the_sizes_of_the_levels_are_measured(level, particles):
    """In the default eye, which is as wide as the ball of its particles."""
    found = expected_errors(load_scene(SCENES / "tamponade.yaml", level), math.cbrt(6.0 * particles / math.pi),
                            SHIPPED)
    assert len(found) == 5
    for one in found:
        assert re.search(r", at [0-9]+ spacings, .* from 3 starts$", one.source), one


@pytest.mark.thorough
@pytest.mark.parametrize("name", ["diffusion", pytest.param("channel", marks=pytest.mark.slow)])
def test_errors_that_the_project_comes_with_are_found_again(taichi, name):
    base = [case for case in load_study("accuracy", "draft").cases.values()
            if case.family.name == name][:3]  # three starts
    found = orders_of(base[0].family, points_of(base, [case.run() for case in base]))
    shipped = [row for row in shipped_errors() if row["case"] == name]
    for mine, row in zip(found, shipped, strict=True):
        assert mine["resolution"] == int(row["resolution"]) and mine["starts"] == int(row["starts"])
        assert [mine[column] for column in ("error", "least", "most")] == pytest.approx(
            [float(row[column]) for column in ("error", "least", "most")], rel=0.01)
        assert mine["order"] == pytest.approx(float(row["order"]), abs=0.05)


def test_own_study_counts_more_than_what_the_project_comes_with(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene = load_scene(SCENES / "still_eye.yaml", "draft")
    assert [one.source.split(",")[0] for one in expected_errors(scene, 22.0)] == ["expected_errors.csv"] * 2
    ORDERS.parent.mkdir(parents=True)
    ORDERS.write_text(",".join(COLUMNS) + "\nhydrostatics,q,1,gravity,1.0,36,0.005,0.004,0.006,3,1.2\n")
    assert [one.source.split(",")[0] for one in expected_errors(scene, 22.0)] == ["orders.csv"]
    ORDERS.write_text("case,quantity,unit,effects,per_width,resolution,error,order\n")  # of an older version
    assert {one.source.split(",")[0] for one in expected_errors(scene, 22.0)} == {"expected_errors.csv"}


def test_errors_of_an_older_version_are_refused_in_a_sentence(tmp_path):
    path = tmp_path / "orders.csv"
    path.write_text("case,quantity,unit,effects,per_width,resolution,error,order\n")
    with pytest.raises(UserError, match=r"orders\.csv: its columns are case, .*but must be .*least"):
        expected_errors(load_scene(SCENES / "still_eye.yaml", "draft"), 22.0, path)
    path.write_text("")
    with pytest.raises(UserError, match=r"its columns are none, but must be"):
        expected_errors(load_scene(SCENES / "still_eye.yaml", "draft"), 22.0, path)


# The command

@pytest.fixture
def kept(monkeypatch, tmp_path):
    """Let scenes be measured without being run; return those that were."""
    scenes = []

    def measure(scene, folder, work, made, start):
        scenes.append((scene.name, scene.accuracy))
        return synthetic(scene)
    monkeypatch.setattr(measurement, "measure", measure)
    monkeypatch.setattr(measurement, "KEPT", tmp_path / "measurements")
    return scenes


@pytest.mark.thorough
def test_formats_of_the_command(kept, tmp_path, capsys):
    arguments = [str(SCENES / "tamponade.yaml"), "--accuracy", "all"]
    main([*arguments, "--output", str(tmp_path / "a.json"), "--output", str(tmp_path / "a.html")])
    levels = json.loads((tmp_path / "a.json").read_text())["levels"]
    assert [one["accuracy"] for one in levels] == list(LEVELS)
    assert all({"wall", "cpu"} == set(one["seconds"]["simulate"]) for one in levels)
    assert "<table>" in (tmp_path / "a.html").read_text()
    main(arguments[:1])
    text = capsys.readouterr().out
    assert "time steps" in text and "5000" in text and "standard" not in text.splitlines()[1]


@pytest.mark.thorough
def test_measurement_is_kept_until_something_changes(kept, tmp_path, monkeypatch):
    scene = load("tamponade")
    for one in (scene, scene, dataclasses.replace(scene, title="another title")):
        assert measured(one, SCENES) == synthetic(scene)
    assert len(kept) == 1
    measured(dataclasses.replace(scene, output=dataclasses.replace(scene.output, frame_interval=0.1)), SCENES)
    monkeypatch.setattr(measurement, "computer", lambda: "abacus")
    measured(scene, SCENES)
    path, = (tmp_path / "measurements").iterdir()
    path.write_text("{")
    measured(scene, SCENES)
    assert len(kept) == 4


@pytest.mark.parametrize(("arguments", "sentence"), [
    (["{scenes}/tamponade.yaml", "--accuracy", "finest"], 'must be one of draft, standard, fine'),
    (["{scenes}/tamponad.yaml"], "did you mean tamponade?"),
    (["none.json", "--accuracy", "draft"], "is resolved already"),
    (["{scenes}/tamponade.yaml", "--accuracy", "all", "--made", "a", "b"], "the particles of one level"),
])
def test_wrong_request_is_a_sentence(arguments, sentence, kept):
    with pytest.raises(UserError, match=r"^[^\n]*$") as caught:
        main([one.format(scenes=SCENES) for one in arguments])
    assert sentence in str(caught.value) and not kept


@pytest.mark.slow
def test_estimate_of_a_small_scene(tmp_path):
    """Nothing is faked: a scene is filled, probed, rehearsed, drawn and measured."""
    (tmp_path / "box.yaml").write_text(BOX)
    done = forked.run("pipeline.estimate", tmp_path / "box.yaml", "--format", "json", folder=tmp_path)
    assert done.returncode == 0, done.stderr
    level, = json.loads(done.stdout)["levels"]
    assert set(level["seconds"]) == {"simulate", "eye", "voxelize", "reconstruct", "render", "metrics", "other"}
    assert all(one["wall"] > 0.0 and one["cpu"] > 0.0 for one in level["seconds"].values())
    assert level["notes"] == [] and "rehearse" in done.stderr


def test_numbers_are_shown_as_people_read_them():
    assert [duration(one) for one in (12.34, 150.0, 9000.0, 1e6)] == ["12.3 s", "2.5 min", "2.5 h", "11.6 days"]
    assert memory(2.0**20) == "1 MiB" and memory(3.0 * 2**30) == "3 GiB"


# After the run

def test_a_stage_says_what_it_took_with_its_children(tmp_path):
    """The sampling of Snakemake misses what a process takes in its last half minute; the kernel does not."""
    code = ("import subprocess, sys\nfrom pipeline.base.cli import run\n"
            "busy = 'import time\\nwhile time.process_time() < 0.5: pass'\n"
            "run(lambda: subprocess.run([sys.executable, '-c', busy], check=True).returncode)")
    path = tmp_path / "simulate_000.log.json"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, env=os.environ | {"STAGE_USAGE": str(path)})
    taken = cost.taken_by([path])["simulate"]
    assert taken["cpu"] > 0.45 and taken["wall"] >= taken["cpu"] / os.cpu_count() and taken["memory"] > 1e6


@pytest.mark.thorough
def test_failed_stage_is_its_own_sentence(tmp_path):
    with pytest.raises(UserError, match=r"^none.json: no such file"):
        run_stage("voxelize", "none.json", "none.vtp", "--output", tmp_path / "a", "--report", tmp_path / "b")


def test_what_segments_took_adds_up(tmp_path):
    for segment, wall in enumerate([10.0, 20.0]):
        (tmp_path / f"simulate_{segment:03d}.log.json").write_text(
            json.dumps({"wall": wall, "cpu": 2.0 * wall, "memory": 1e8 * wall}))
    assert cost.taken_by(sorted(tmp_path.iterdir())) == {"simulate": {"wall": 30.0, "cpu": 60.0, "memory": 2e9}}
    (tmp_path / "render_000.log.json").write_text("[]")
    with pytest.raises(UserError, match="does not hold what a stage took"):
        cost.taken_by(sorted(tmp_path.iterdir()))


def test_predicted_and_real_stand_side_by_side():
    scene = load_scene(SCENES / "still_eye.yaml", "draft")
    level = dataclasses.asdict(predict(scene, synthetic(scene)))
    table = {"time_step [s]": np.array([math.nan, 2e-3, 2e-3]), "pressure_iterations [1]": np.array([math.nan, 1, 3])}
    taken = {"simulate": {"wall": 2.0 * level["seconds"]["simulate"]["wall"], "cpu": math.nan, "memory": 3e8}}
    lines = {line[0]: line[1:] for line in cost.compared(level, taken, table, 1e6, 0.1)}
    assert lines["time steps"][1] == "100" and lines["pressure iterations per step"][1] == "2"
    assert lines["simulate, wall time"][2] == "0.50" and lines["simulate, time of all cores"][1:] == ("unknown", "")
    rows = [(name, *cells) for name, cells in lines.items()]
    errors = errors_of(scene, CAVITY)
    page = cost.page_of(scene, errors, rows)
    assert "predicted / measured" in page and "<h2>Error to expect" in page and errors[0].words in page
    real = cost.compared(None, taken, table, 1e6, 0.1)
    assert [line[0] for line in real] == [*lines] and all(line[1] == line[3] == "" for line in real)
    page = cost.page_of(scene, errors, real, predicted=False)
    assert "predicted" not in page.partition("<table>")[2].partition("</table>")[0]
    assert "outputs/still_eye/draft/estimate.html</code> makes one" in page
    assert page.count("<td>") == 2 * len(real)


def test_error_by_the_time_step_is_what_the_scene_asks_for():
    def words(scene):
        return [one.words for one in step_errors(scene)]

    scene = load_scene(SCENES / "tamponade.yaml", "draft")
    assert words(scene) == ["about 5 %"]
    assert words(dataclasses.replace(scene, numerics=dataclasses.replace(scene.numerics, time_error=0.02))) == [
        "about 2 %"]
    for missing in ("viscosity_implicit", "interface_tension"):
        effects = {name: one for name, one in scene.effects.items() if name != missing}
        assert words(dataclasses.replace(scene, effects=effects)) == []
