"""The estimate: the fit finds known coefficients, work is counted as it is, and the command refuses what it must."""
import csv
import dataclasses
import itertools
import json
import math

import numpy as np
import pytest
from conftest import ROOT
from scipy.spatial import cKDTree

from pipeline import calibration as calibration_file
from pipeline import cost
from pipeline.calibration import identity, load_calibration
from pipeline.container import container_arrays
from pipeline.cost_model import Sample, StageRun, Work, fit, fit_stage, neighbor_entries, seconds, stage_cost, typical
from pipeline.errors import UserError
from pipeline.estimate import cavity_size, duration, main, memory, notes
from pipeline.expected_error import COLUMNS, ORDERS, SHIPPED, expected_errors
from pipeline.prediction import predict
from pipeline.scene import load_accuracy_levels, load_scene
from pipeline.scene_work import scene_work
from pipeline.study_plan import load_study
from sim.effects import REGISTRY
from sim.neighbor_search import row_widths

SCENES = ROOT / "config" / "scenes"
LEVELS = tuple(load_accuracy_levels(ROOT / "config" / "accuracy.yaml"))
PARTS = ("neighbors", "accelerations", "time step", "rest", "frame", *REGISTRY,
         *(f"{scheme}/{part}" for scheme in ("VolumeIncompressible", "VolumeIncompressibleClamped", "WCSPH", "DFSPH",
                                             "PositionBased") for part in ("pressure", "position")))


def synthetic(**changes) -> dict:
    """A calibration in which every part takes 1 ns per neighbor entry, and every stage 1 s and 0.1 s per frame."""
    both = {"wall": [0.0, 0.0, 1e-9, 0.0, 0.0, 0.0], "cpu": [0.0, 0.0, 2e-9, 0.0, 0.0, 0.0]}
    stage = {"wall": [1.0, 0.1, 0.0], "cpu": [1.0, 0.1, 0.0], "memory": [2e8, 0.0, 0.0], "disk": [0.0, 1e5, 0.0]}
    return identity() | {
        "parts": dict.fromkeys(PARTS, both), "compilation": {part: {"wall": 1.0, "cpu": 1.0} for part in PARTS},
        "compilation_again": 0.5, "imports": {"wall": 2.0, "cpu": 2.0}, "memory": 3e8,
        "disk": {"frame": 70.0, "checkpoint": 200.0},
        "stages": dict.fromkeys(("eye", "voxelize", "reconstruct", "render", "metrics"), stage)} | changes


@pytest.fixture
def timed(tmp_path):
    """The file of a synthetic calibration."""
    path = tmp_path / "calibration.json"
    path.write_text(json.dumps(synthetic()))
    return path


# The model

def test_fit_finds_the_coefficients_of_exact_times():
    known, generator = np.array([1e-3, 2e-7, 3e-9, 4e-4, 5e-8, 6e-9]), np.random.default_rng(0)
    samples = []
    for dimension in (2, 3):
        for particles in (500, 3000, 12000):
            for rounds in (2, 9, 30):
                work = Work(particles, particles * {2: 19.0, 3: 64.0}[dimension], dimension, rounds)
                exact = float(work.features("pressure") @ known)
                samples.append(Sample("pressure", work, exact, 2.0 * exact))
    found = fit(samples)["pressure"]
    np.testing.assert_allclose(found["wall"], known, rtol=1e-6)
    np.testing.assert_allclose(found["cpu"], 2.0 * known, rtol=1e-6)
    noisy = [dataclasses.replace(one, wall=one.wall * generator.uniform(0.9, 1.1)) for one in samples]
    far = Work(80000, 80000 * 64.0, 3, 20.0)  # ten times what was timed
    assert seconds(fit(noisy), "pressure", far, "wall") == pytest.approx(far.features("pressure") @ known, rel=0.15)


def test_what_was_timed_in_one_dimension_is_counted_per_neighbor():
    works = [Work(n, 19.0 * n, 2, 20.0) for n in (500, 3000)]
    found = fit(Sample("a", work, 1e-8 * work.entries * work.rounds, 1.0) for work in works)
    far = Work(5000, 5000 * 64.0, 3, 20.0)
    assert seconds(found, "a", far, "wall") == pytest.approx(1e-8 * far.entries * far.rounds, rel=1e-6)


def test_interface_is_counted_as_a_surface():
    samples = [Sample("interface_tension", Work(n, 64.0 * n, 3), 1e-3 + 1e-5 * n ** (2 / 3), 1.0) for n in
               (500, 2000, 8000)]
    far = Work(80000, 64.0 * 80000, 3)
    assert seconds(fit(samples), "interface_tension", far, "wall") == pytest.approx(1e-3 + 1e-5 * 80000 ** (2 / 3),
                                                                                   rel=1e-3)


def test_median_ignores_the_steps_in_which_the_computer_did_something_else():
    work = Work(100, 1000, 2, 5)
    samples = [Sample("a", work, 10.0 if k == 3 else 1.0, 1.0) for k in range(12)]
    assert [one.wall for one in typical(samples, 2)] == [1.0, 1.0]


def test_stage_is_a_start_and_a_part_per_frame():
    runs = [StageRun(frames, n, {"wall": 2.0 + frames * (0.1 + 1e-5 * n)}) for frames, n in
            ((1, 600), (5, 600), (5, 2600))]
    assert stage_cost(fit_stage(runs, "wall"), 41, 5000) == pytest.approx(2.0 + 41 * 0.15, rel=1e-6)


# The work

@pytest.mark.parametrize(("dimension", "side", "ratio"), [(2, 40, 3.0), (3, 14, 2.5)])
def test_neighbor_entries_are_those_of_a_full_box(dimension, side, ratio):
    generator = np.random.default_rng(0)  # one point per unit of volume, without the numbers of a lattice
    points = generator.uniform(-3.0, side + 3.0, ((side + 6) ** dimension, dimension))
    inside = ((points > 0.0) & (points < side)).all(axis=1)
    liquid, wall = cKDTree(points[inside]), cKDTree(points[~inside])
    counted = liquid.count_neighbors(liquid, ratio) - liquid.n + 2 * liquid.count_neighbors(wall, ratio)
    area = 2 * dimension * side ** (dimension - 1)
    # In the corners of the box, which the relation does not know, liquid meets more wall.
    assert neighbor_entries(liquid.n, area, dimension, ratio) == pytest.approx(counted, rel=0.1)


@pytest.mark.parametrize("name", ["coupling_2d", "ink_drop", "egg_dropped", "pbf_dam"])
def test_particles_of_a_container_are_counted_exactly(name):
    scene = load_scene(SCENES / f"{name}.yaml", "draft")
    arrays = container_arrays(scene)
    work = scene_work(scene, *cavity_size(scene))
    assert work.particles == len(arrays["fluid_position"])
    reach = arrays["wall_distance"] < scene.numerics.support_ratio * scene.numerics.particle_spacing
    assert work.wall_particles == pytest.approx(np.count_nonzero(reach), rel=0.2)  # corners are left out


def test_memory_of_rows_grows_with_their_widths():
    assert row_widths(2.5, 3, 1.25) == (89, 71, 66) and row_widths(3.0, 2, 1.25) == (43, 25, 32)


# Predictions

@pytest.mark.parametrize("name", ["s1_tamponade_gamma3", "coupling_2d_wcsph", "coupling_2d_dfsph", "pbf_dam"])
def test_a_scene_costs_more_the_finer_it_is(name):
    scenes = [load_scene(SCENES / f"{name}.yaml", level) for level in LEVELS]
    size = cavity_size(scenes[0])
    found = [predict(scene, *size, synthetic()) for scene in scenes]
    for coarse, fine in itertools.pairwise(found):
        assert fine.particles > coarse.particles and fine.steps >= coarse.steps
        assert fine.seconds["simulate"]["cpu"] > coarse.seconds["simulate"]["cpu"]
        assert fine.memory > coarse.memory and fine.disk > coarse.disk
    assert all(one.total >= one.seconds["simulate"]["wall"] for one in found)


def test_prediction_adds_up():
    scene = load_scene(SCENES / "still_eye.yaml", "draft")
    found, work = predict(scene, *cavity_size(scene), synthetic()), scene_work(scene, *cavity_size(scene))
    # neighbors, accelerations, time step, rest, two parts of the scheme, gravity and viscosity_implicit
    compilation = (8 + 1) * (1.0 + 3 * 0.5)  # "build" is not in the calibration, "frame" is
    assert found.steps == 2000 and scene.segment_count == 4
    assert found.compilation["wall"] == pytest.approx(compilation)
    assert found.seconds["simulate"]["wall"] == pytest.approx(
        2000 * 8 * 1e-9 * work.entries + compilation + 4 * 2.0 + 0.0, rel=1e-6)


def test_effect_without_a_timing_is_named_and_counts_as_nothing():
    scene = load_scene(SCENES / "emulsification.yaml", "draft")
    parts = {part: value for part, value in synthetic()["parts"].items() if part != "diffusion"}
    size = cavity_size(scene)
    found, whole = (predict(scene, *size, one) for one in (synthetic(parts=parts), synthetic()))
    assert found.unknown == ("diffusion",) and whole.unknown == ()
    assert found.seconds["simulate"]["cpu"] < whole.seconds["simulate"]["cpu"]


def test_expected_error_follows_the_observed_order(tmp_path):
    scene, path = load_scene(SCENES / "still_eye.yaml", "draft"), tmp_path / "orders.csv"
    common = {"quantity": "q", "unit": "1", "per_width": 0.5, "resolution": 10}
    with path.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerow(common | {"case": "a", "effects": "gravity viscosity_implicit", "error": 0.04, "order": 2.0})
        writer.writerow(common | {"case": "b", "effects": "", "error": 0.01, "order": -0.3})
        writer.writerow(common | {"case": "c", "effects": "interface_tension", "error": 0.01, "order": 1.0})
    found = expected_errors(scene, 40.0, path)
    assert [one.quantity for one in found] == ["a: q", "b: q"]  # this scene has no tension
    assert found[0].value == pytest.approx(0.04 / 2**2) and "order 2.0" in found[0].source
    assert found[1].value == 0.01 and "does not fall steadily" in found[1].source
    level = dataclasses.replace(predict(scene, *cavity_size(scene), synthetic()), errors=tuple(found))
    assert notes(level)[0].startswith("expected error, a: q: 0.01 (")
    assert "unknown" in notes(dataclasses.replace(level, errors=()))[0]


def test_errors_that_the_project_comes_with_are_those_of_its_study():
    with SHIPPED.open(newline="", encoding="utf-8") as file:
        rows = {row["case"]: row for row in csv.DictReader(file)}
    study = load_study("accuracy", "draft")
    families = {case.family.__name__.rpartition(".")[2]: case.family for case in study.cases.values()}
    assert rows.keys() == families.keys()
    for name, family in families.items():
        assert rows[name]["quantity"] == family.HEADLINE and float(rows[name]["per_width"]) == family.PER_WIDTH
        assert rows[name]["effects"] == " ".join(getattr(family, "SHOWN_BY", family.EFFECTS))


def test_own_study_counts_more_than_what_the_project_comes_with(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene = load_scene(SCENES / "still_eye.yaml", "draft")
    assert [one.source.split(",")[0] for one in expected_errors(scene, 22.0)] == ["expected_errors.csv"] * 2
    ORDERS.parent.mkdir(parents=True)
    ORDERS.write_text(",".join(COLUMNS) + "\nhydrostatics,q,1,gravity,1.0,36,0.005,1.2\n")
    assert [one.source.split(",")[0] for one in expected_errors(scene, 22.0)] == ["orders.csv"]


# The command

def test_formats_of_the_command(timed, tmp_path, capsys):
    arguments = [str(SCENES / "tamponade.yaml"), "--calibration", str(timed)]
    main([*arguments, "--output", str(tmp_path / "a.json"), "--output", str(tmp_path / "a.html")])
    levels = json.loads((tmp_path / "a.json").read_text())["levels"]
    assert [one["accuracy"] for one in levels] == list(LEVELS)
    assert all({"wall", "cpu"} == set(one["seconds"]["simulate"]) for one in levels)
    assert "<table>" in (tmp_path / "a.html").read_text()
    main([*arguments, "--accuracy", "draft"])
    text = capsys.readouterr().out
    assert "time steps" in text and "2040" in text and "standard" not in text.splitlines()[1]


@pytest.mark.parametrize(("arguments", "sentence"), [
    ([], "scene is missing"),
    (["{scenes}/tamponade.yaml", "--accuracy", "finest"], 'must be one of draft, standard, fine'),
    (["{scenes}/tamponad.yaml"], "did you mean tamponade.yaml?"),
    (["none.json", "--accuracy", "draft"], "is resolved already"),
])
def test_wrong_request_is_a_sentence(arguments, sentence, timed):
    with pytest.raises(UserError, match=r"^[^\n]*$") as caught:
        main([*(one.format(scenes=SCENES) for one in arguments), "--calibration", str(timed)])
    assert sentence in str(caught.value)


@pytest.mark.parametrize(("text", "sentence"), [
    ("{", "is no calibration"), ("[]", "is no calibration"),
    (json.dumps(synthetic(code="old")), "was made with other code"),
    (json.dumps(synthetic(computer="abacus")), r"another computer \(abacus; here"),
])
def test_calibration_out_of_date_is_refused(text, sentence, timed):
    timed.write_text(text)
    with pytest.raises(UserError, match=sentence):
        main([str(SCENES / "tamponade.yaml"), "--calibration", str(timed)])


def test_missing_calibration_is_made_and_an_old_one_renewed(timed, tmp_path, monkeypatch):
    made = []

    def calibrate(path):
        made.append(path)
        path.write_text(json.dumps(synthetic()))
    monkeypatch.setattr("pipeline.estimate.calibrate", calibrate)
    scene = str(SCENES / "tiny.yaml")
    main([scene, "--calibration", str(tmp_path / "new.json"), "--output", str(tmp_path / "a.html")])
    main([scene, "--calibration", str(timed), "--output", str(tmp_path / "b.html")])
    timed.write_text(json.dumps(synthetic(code="old")))
    main([scene, "--calibration", str(timed), "--renew", "--output", str(tmp_path / "c.html")])
    assert made == [tmp_path / "new.json", timed]


def test_calibration_depends_on_code_and_computer(monkeypatch, timed):
    monkeypatch.setattr(calibration_file, "_computer", lambda: "another one")
    with pytest.raises(UserError, match="another computer"):
        load_calibration(timed)


def test_numbers_are_shown_as_people_read_them():
    assert [duration(one) for one in (12.34, 150.0, 9000.0, 1e6)] == ["12.3 s", "2.5 min", "2.5 h", "11.6 days"]
    assert memory(2.0**20) == "1 MiB" and memory(3.0 * 2**30) == "3 GiB"


# After the run

BENCHMARK = "s\th:m:s\tmax_rss\tmax_vms\tmax_uss\tmax_pss\tio_in\tio_out\tmean_load\tcpu_time\n"


def test_benchmarks_of_segments_add_up(tmp_path):
    for segment, (wall, memory_mib) in enumerate([(10.0, "100"), (20.0, "NA")]):
        (tmp_path / f"simulate_{segment:03d}.tsv").write_text(
            f"{BENCHMARK}{wall}\t0:00:10\t{memory_mib}\t1\t1\t1\t0\t0\t100\t{wall}\n")
    found = cost.measured(sorted(tmp_path.glob("*.tsv")))
    assert found == {"simulate": {"wall": 30.0, "cpu": 30.0, "memory": 100.0 * 2**20}}
    (tmp_path / "render_000.tsv").write_text("s\n")
    with pytest.raises(UserError, match="no benchmark of Snakemake"):
        cost.measured(sorted(tmp_path.glob("*.tsv")))


def test_predicted_and_real_stand_side_by_side():
    scene = load_scene(SCENES / "still_eye.yaml", "draft")
    level = dataclasses.asdict(predict(scene, *cavity_size(scene), synthetic()))
    table = {"time_step [s]": np.array([math.nan, 2e-3, 2e-3]), "pressure_iterations [1]": np.array([math.nan, 1, 3]),
             "computing_time_cpu [s]": np.array([0.0, 20.0, 30.0])}
    taken = {"simulate": {"wall": 2.0 * level["seconds"]["simulate"]["wall"], "cpu": math.nan, "memory": 3e8}}
    lines = {line[0]: line[1:] for line in cost.compared(level, taken, table, 1e6, 0.1)}
    assert lines["time steps"][1] == "100" and lines["pressure iterations per step"][1] == "2"
    assert lines["simulate from its first step on, time of all cores"][1] == "50 s"
    assert lines["simulate, wall time"][2] == "0.50" and lines["simulate, time of all cores"][1:] == ("unknown", "")
    page = cost.page_of("Still eye", level, [(name, *cells) for name, cells in lines.items()])
    assert "predicted / real" in page and "expected error" in page
