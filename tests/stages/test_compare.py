"""Accuracy levels of one scene, side by side: what is compared, the files, and runs that cannot be compared."""
import csv
import dataclasses
import json
import re

import numpy as np
import pytest
from conftest import ROOT
from helpers.synthetic_frames import ball
from PIL import Image

from pipeline import compare, metrics
from pipeline.base.errors import UserError
from pipeline.base.tables import write_table
from pipeline.cavity.initial_state import save_initial
from pipeline.comparison.levels import changes, common_frames, cost, last_pictures
from pipeline.measures.metric import write_meanings
from pipeline.runs.run_folder import RunFolder
from pipeline.scenes.load import load_scene

FRAMES = 5
MEASURED = ("time", "fill", "speed", "particles_outside", "time_step", "contact_arc", "retina_coverage",
            "retina_coverage_band", "kinetic_energy")


@pytest.fixture
def level(tmp_path):
    """Return a function that writes the results of the scene `tiny` at one level and returns their folder."""
    def written(accuracy, *, factor=1.0, drawn=FRAMES, covered=16.0, **changes):
        folder = tmp_path / "tiny" / accuracy
        scene = load_scene(ROOT / "config" / "scenes" / "tiny.yaml", accuracy)
        scene = dataclasses.replace(scene, **changes)
        (folder / "images" / "segment_000").mkdir(parents=True)
        (folder / "costs").mkdir()
        (folder / "scene.json").write_text(scene.to_json())
        for segment, (particles, steps, frames) in enumerate([(630, 100, range(2)), (631, 50, range(2, FRAMES))]):
            (folder / "costs" / f"segment_{segment:03d}.json").write_text(json.dumps({
                "particles": particles, "steps": steps, "frames": [
                    {"frame": frame, "wall_seconds": 0.6 * factor, "cpu_seconds": factor} for frame in frames]}))
        index = np.arange(FRAMES)
        write_table(folder / "metrics.csv", {
            "frame": index, "time [s]": scene.output.frame_interval * index, "fill [%]": 10.0 * index,
            "speed_rms [mm/s]": factor * index, "particles_outside [1]": 0.0 * index,
            "time_step [s]": np.full(FRAMES, 1e-3), "kinetic_energy [J]": 1e-7 * factor * index,
            "contact_arc [deg]": np.full(FRAMES, np.nan), "retina_coverage_whole [%]": covered * index,
            "retina_coverage_band_whole [%]": np.full(FRAMES, 8.0)})
        write_meanings(folder / "metrics.json", [one for one in metrics.METRICS if one.name in MEASURED], at_rest={
            "fill": 0.85, "posture": "upright", "shares": {"whole": 67.7, "inferior": 36.3, "macula": 100.0}})
        save_initial(folder / "initial.npz", ball())
        for frame in range(drawn):
            Image.new("RGB", (64, 36), (50 * frame, 0, 0)).save(folder / f"images/segment_000/frame_{frame:05d}.png")
        return folder
    return written


def test_metrics_are_compared_over_time_and_at_the_end(level):
    runs = [RunFolder(level("draft")), RunFolder(level("standard", factor=1.5))]
    found = changes(runs, common_frames(runs))
    assert [one.name for one in found] == ["retina coverage whole", "fill", "speed rms", "kinetic energy",
                                           "particles outside"]
    covered, fill, speed, energy, outside = found
    assert fill.values == (40.0, 40.0) and fill.largest == 0.0 and fill.drawn
    assert speed.values == (4.0, 6.0) and speed.largest == 2.0 and speed.share == pytest.approx(2.0 / 6.0)
    assert speed.time == pytest.approx(0.2)
    assert outside.share == 0.0 and not outside.drawn
    assert energy.unit == "nJ" and energy.values == pytest.approx((400.0, 600.0))  # one unit for both
    assert covered.at_rest == 67.7 and fill.at_rest is None


def test_three_levels_differ_by_the_two_farthest_apart(level):
    factors = (("draft", 1.0), ("standard", 2.0), ("fine", 1.5))
    runs = [RunFolder(level(name, factor=factor)) for name, factor in factors]
    speed = next(one for one in changes(runs, common_frames(runs)) if one.name == "speed rms")
    assert speed.values == (4.0, 8.0, 6.0) and speed.largest == 4.0


def test_cost_is_added_up_over_the_segments(level):
    numbers = cost(RunFolder(level("draft")))
    assert numbers == pytest.approx({
        "particle spacing [mm]": 2.0, "liquid particles": 631, "time steps": 150,
        "simulation, time by the clock [s]": 3.0, "simulation, time of all cores [s]": 5.0})


def test_the_last_picture_that_both_have_is_shown(level):
    runs = [RunFolder(level("draft")), RunFolder(level("standard", drawn=3))]
    frame, paths = last_pictures(runs, range(FRAMES))
    assert frame == 2 and [path.parts[-4] for path in paths] == ["draft", "standard"]


@pytest.mark.thorough
def test_stage_writes_page_picture_and_table_beside_the_levels(level, tmp_path, capsys):
    compare.main([str(level("draft")), str(level("standard", factor=1.5))])
    assert sorted(path.name for path in (tmp_path / "tiny").iterdir()) == [
        "compare_draft_standard.csv", "compare_draft_standard.html", "compare_draft_standard.png", "draft", "standard"]
    with (tmp_path / "tiny" / "compare_draft_standard.csv").open() as file:
        rows = {row["what"]: row for row in csv.DictReader(file)}
    assert (rows["speed rms"]["draft"], rows["speed rms"]["standard"]) == ("4", "6")
    assert rows["time steps"]["standard"] == "150"
    page = (tmp_path / "tiny" / "compare_draft_standard.html").read_text()
    assert "draft and standard" in page and page.count("data:image/webp;base64") == 2
    assert page.count('class="marked"') == 2  # speed and its energy
    assert Image.open(tmp_path / "tiny" / "compare_draft_standard.png").width > 1000
    assert "standard took 1.5 times the computing time of draft (all cores)" in capsys.readouterr().out


def test_page_tells_first_what_accuracy_costs_beside_the_resting_shape(level, tmp_path, capsys):
    levels = (("draft", 1.0, 16.0), ("standard", 4.0, 16.5), ("fine", 20.0, 16.9))
    compare.main([str(level(name, factor=factor, covered=covered)) for name, factor, covered in levels])
    page = (tmp_path / "tiny" / "compare_draft_standard_fine.html").read_text()
    cells = [re.findall(r"<td[^>]*>([^<]*)</td>", row) for row in re.findall(r"<tr>.*?</tr>", page, re.DOTALL)]
    rows = {row[0]: row[1:] for row in cells if row}
    assert rows["draft"] == ["2 mm", "631", "150", "5 s", "3 s", "64 ± 4", "40", "4", "-3.7"]
    assert rows["standard"][3:6] == ["20 s", "12 s", "66 ± 4"] and rows["fine"][-1] == "-0.1"
    assert rows["calculated resting shape"] == [*[""] * 5, "68", "", "", ""]  # in the digits of the column
    assert page.index("calculated resting shape") < page.index("data:image/webp") < page.index("All metrics")
    assert page.count("<figcaption>draft: 2 mm") == page.count("<figcaption>fine: 2 mm") == 1
    said = capsys.readouterr().out
    assert "standard took 4 times and fine took 20 times the computing time of draft (all cores)" in said


@pytest.mark.parametrize(("other", "sentence"), [
    (lambda level: level("fine").parent / "standard", "standard: holds no run; run the scene at this level first"),
    (lambda level: level("standard", name="other"), "must be levels of one scene, but are of tiny and other"),
    (lambda level: level("standard", drawn=0), "have no picture of a common frame; run the render stage"),
    (lambda level: _slower(level), "have no frame after the start in common"),
    (lambda level: _without(level, "metrics.csv"), "metrics.csv: no such table of metrics; run the metrics stage"),
])
def test_what_cannot_be_compared_ends_with_a_sentence(level, other, sentence):
    with pytest.raises(UserError) as caught:
        compare.main([str(level("draft")), str(other(level))])
    assert sentence in str(caught.value)


def _slower(level):
    output = load_scene(ROOT / "config" / "scenes" / "tiny.yaml", "draft").output
    return level("standard", output=dataclasses.replace(output, frame_interval=0.04))


def _without(level, name):
    folder = level("standard")
    (folder / name).unlink()
    return folder


def test_one_level_is_not_compared_with_itself(level):
    folder = level("draft")
    with pytest.raises(UserError, match="the level draft is named twice"):
        compare.main([str(folder), str(level("standard")), str(folder)])
    with pytest.raises(UserError, match="needs two levels of the scene or more"):
        compare.main([str(folder)])


# Snakemake

@pytest.mark.thorough
def test_comparison_is_a_target_that_runs_both_levels(project):
    code, output = project.snakemake("-n", "outputs/tiny/compare_draft_standard.png")
    assert code == 0, output
    assert "tiny: compare the levels draft_standard" in output
    for accuracy in ("draft", "standard"):
        assert f"tiny at {accuracy}: simulate segment 001" in output
        assert f"tiny at {accuracy}: draw segment 000" in output


@pytest.mark.thorough
def test_three_levels_are_a_target(project):
    code, output = project.snakemake("-n", "outputs/tiny/compare_draft_standard_fine.html")
    assert code == 0, output
    assert all(f"tiny at {accuracy}: simulate segment 001" in output for accuracy in ("draft", "standard", "fine"))


@pytest.mark.thorough
@pytest.mark.parametrize(("target", "sentence"), [
    ("compare_draft_fine_draft.html", "compares draft with itself; name two or more of draft, standard, fine"),
    ("compare_draft_draft.html", "compares draft with itself; name two or more of draft, standard, fine"),
    ("compare_draft_finest.html", "must be compare_<level>_<level>.html, .png or .csv, with two or more of draft, "),
])
def test_wrong_comparison_ends_with_a_sentence(project, target, sentence):
    code, output = project.snakemake("-n", f"outputs/tiny/{target}")
    assert code == 2
    assert f"error: outputs/tiny/{target.removesuffix('.html')}" in output and sentence in output
    assert "Traceback" not in output
