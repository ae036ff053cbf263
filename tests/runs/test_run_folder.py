"""The folder of a run: what a longer run of before has left there is not of it, whoever reads it, and wherever."""
import dataclasses
import json
import shutil

import numpy as np
import pytest
import pyvista
from conftest import ROOT
from helpers.synthetic_frames import RADIUS, SPACING, ball, frame_of, lattice, oil_fraction
from PIL import Image

import pipeline
from pipeline import cost, export
from pipeline.base.checksum import checksum_at_end
from pipeline.base.errors import UserError
from pipeline.base.frame_files import frame_path, save_checkpoint, write_frame
from pipeline.base.tables import write_table
from pipeline.base.vtk_files import write_vtk
from pipeline.cavity.initial_state import save_initial
from pipeline.comparison import levels
from pipeline.runs.run_folder import RunFolder
from pipeline.scenes import memory_check
from pipeline.scenes.load import load_resolved, load_scene
from pipeline.scenes.model import Container
from pipeline.surfaces.contour import TriangleMesh
from pipeline.surfaces.surface_files import surface_path, write_surface
from studies.papers import collision, coupling, effects_off, ink_drop, oil_shape
from studies.questions.eye_accuracy import eye_accuracy
from studies.results.take_over import taken_of

OIL, INTERVAL, PER_SEGMENT = "silicone_oil_1000", 0.5, 2
KEPT, LEFT = 5, 7   # frames of two segments, and of the three of the longer run
ENDS = ["shorter", "at rest"]


@pytest.fixture(scope="module", params=ENDS)
def folder(tmp_path_factory, request):
    """Return the folder of a run of two segments in which a longer one of before has left a third.

    It has two because its scene is shorter now, or because it is at rest after them.
    """
    at_rest = request.param == "at rest"
    folder = tmp_path_factory.mktemp("outputs") / "tiny" / "draft"
    folder.mkdir(parents=True)
    scene = load_scene(ROOT / "config" / "scenes" / "tests" / "tiny.yaml", "draft")
    scene = dataclasses.replace(
        scene, numerics=dataclasses.replace(scene.numerics, particle_spacing=SPACING),
        output=dataclasses.replace(scene.output, frame_interval=INTERVAL, frames_per_segment=PER_SEGMENT,
                                   duration=INTERVAL * ((LEFT if at_rest else KEPT) - 1), until_rest=at_rest))
    (folder / "scene.json").write_text(scene.to_json())
    save_initial(folder / "initial.npz", ball())
    write_vtk(pyvista.Icosphere(radius=RADIUS, nsub=2), folder / "eye.vtp")
    for kind in ("costs", "logs", "rest"):
        (folder / kind).mkdir()
    position = lattice()
    drop = pyvista.Icosphere(radius=5e-3, nsub=2)
    drop = TriangleMesh(drop.points.astype(float), drop.regular_faces)
    for index in range(LEFT):
        segment = max(index - 1, 0) // PER_SEGMENT
        frames, surfaces, images = (folder / kind / f"segment_{segment:03d}"
                                    for kind in ("frames", "surfaces", "images"))
        for one in (surfaces, images):
            one.mkdir(parents=True, exist_ok=True)
        write_frame(frame_path(frames, index), dataclasses.replace(
            frame_of(position, oil_fraction(position, height=2e-3), time=INTERVAL * index), step=10 * index))
        (surfaces / f"frame_{index:05d}.json").write_text(json.dumps({"time": INTERVAL * index}))
        for liquid in ("aqueous", OIL):
            write_surface(surface_path(surfaces, f"frame_{index:05d}", liquid), drop, time=INTERVAL * index,
                          liquid=liquid, depth=np.full(len(drop.vertices), 1e-3))
        Image.new("RGB", (64, 36)).save(images / f"frame_{index:05d}.png")
    for segment in range(3):
        own = scene_frames(segment)
        (folder / "costs" / f"segment_{segment:03d}.json").write_text(json.dumps({
            "steps": 10, "particles": len(position), "device": "cpu", "frames": [
                {"frame": index, "wall_seconds": 1.0, "cpu_seconds": 1.0, "collision_seconds": 0.1} for index in own]}))
        (folder / "logs" / f"simulate_{segment:03d}.log.json").write_text(
            json.dumps({"wall": 10.0, "cpu": 10.0, "memory": 1e8}))
        (folder / "rest" / f"segment_{segment:03d}.json").write_text(json.dumps({"at_rest": segment == 1}))
    index = np.arange(float(KEPT))
    write_table(folder / "metrics.csv", {
        "frame": index, "time [s]": INTERVAL * index, "wall_coverage [%]": index, "fill [%]": index,
        "speed_rms [mm/s]": index, "kinetic_energy [J]": index, "potential_energy [J]": index,
        "time_step [s]": index + 1.0,
        **{f"center_of_mass_{OIL}_{axis} [mm]": index for axis in "yz"}, "isolated_particles_aqueous [1]": index})
    (folder / "effects.csv").write_text("part,cpu_seconds,launches_per_step\nsolver,1,2\n")
    return folder


def scene_frames(segment):
    """Numbers of the frames of a segment."""
    return range(PER_SEGMENT * segment + 1 if segment else 0, PER_SEGMENT * (segment + 1) + 1)


def read_by_coupling(run):
    """The frames that the study of methods reads; its scenes have a container."""
    run = RunFolder(run.folder)
    vars(run)["scene"] = dataclasses.replace(run.scene, container=Container(size=(0.03,) * 3))
    method = coupling._load(run)
    assert len(method.cpu) == len(method.warm) == len(method.saved)
    return method.saved[-1].read().time


def exported(run):
    """Time of the last frame that the stage exports."""
    return export.chosen_frame(export.ready_frames(run), None).time


READERS = {
    "export": exported,
    "compare": lambda run: INTERVAL * levels.last_pictures([run, run], range(LEFT))[0],
    "page": lambda run: run.time_of(run.pictures[-1]),
    "library": lambda run: pipeline.open_run(run.folder).frames[-1].time,
    "library, times": lambda run: pipeline.open_run(run.folder).times[-1],
    "effects_off": lambda run: effects_off._load(run, OIL).frame.time,
    "ink_drop": lambda run: ink_drop._load(run, OIL).time[-1],
    "oil_shape": lambda run: oil_shape._load(run, OIL).time[-1],
    "collision": lambda run: collision.played(run).frames[-1].time,
    "coupling": read_by_coupling,
    "eye_accuracy": lambda run: eye_accuracy.read(run).late[-1].frame.time,
}


@pytest.mark.parametrize("reader", READERS)
def test_a_segment_that_a_longer_run_has_left_is_read_by_nobody(folder, reader):
    assert READERS[reader](RunFolder(folder)) == INTERVAL * (KEPT - 1)


def test_costs_and_what_stages_took_are_those_of_its_own_segments(folder):
    run = RunFolder(folder)
    assert len(run.costs) == 2 and run.taken["simulate"]["wall"] == 20.0
    assert levels.cost(run)["time steps"] == 20
    assert collision.played(run).seconds == pytest.approx((1.0, 0.1))
    assert taken_of(folder)["simulate"]["cpu"] == 20.0


def test_the_disk_that_a_run_takes_is_that_of_its_own_segments(folder, capsys):
    (folder / "checkpoints").mkdir(exist_ok=True)
    for segment, size in ((0, 2**30), (1, 2**31), (2, 2**32)):
        with (folder / "checkpoints" / f"segment_{segment:03d}.npz").open("wb") as file:
            file.truncate(size)  # takes no disk
    cost.main([str(folder / name) for name in ("scene.json", "initial.npz", "metrics.csv")]
              + ["--logs", str(folder / "logs"), "--output", str(folder.parent / "cost.html")])
    (said,) = [line for line in capsys.readouterr().out.splitlines() if line.startswith("disk")]
    assert float(said.split()[1]) == pytest.approx(3.0, abs=0.01) and said.split()[2] == "GiB"


@pytest.mark.parametrize("reader", [name for name in READERS if name != "library, times"])  # those of frames
def test_a_segment_that_an_earlier_version_of_the_scene_has_left_is_told(folder, tmp_path, reader):
    """The first segment was made anew, and the second was not yet."""
    for path in folder.iterdir():
        if path.name not in ("checkpoints", "costs"):
            (tmp_path / path.name).symlink_to(path)
    shutil.copytree(folder / "costs", tmp_path / "costs")
    (tmp_path / "checkpoints").mkdir()
    end = tmp_path / "checkpoints" / "segment_000.npz"
    save_checkpoint(end, {"time": 1.0})
    costs = tmp_path / "costs" / "segment_001.json"
    costs.write_text(json.dumps(json.loads(costs.read_text()) | {"started_from": checksum_at_end(end)}))
    assert READERS[reader](RunFolder(tmp_path)) == INTERVAL * (KEPT - 1)
    save_checkpoint(end, {"time": 1.0, "step_count": 7})
    with pytest.raises(UserError, match=r"001 does not go on from segment 000.*snakemake -j2 outputs/tiny/draft"):
        READERS[reader](RunFolder(tmp_path))


@pytest.mark.parametrize("reader", ["library", "effects_off", "compare"])
def test_metrics_that_a_longer_run_has_left_are_told(folder, tmp_path, reader):
    """Shortened, the scene has other ends: those of its table are not those of its frames."""
    for path in folder.iterdir():
        (tmp_path / path.name).symlink_to(path)
    (tmp_path / "metrics.csv").unlink()
    index = np.arange(float(LEFT))
    write_table(tmp_path / "metrics.csv", {"frame": index, "time [s]": INTERVAL * index})
    (tmp_path / "metrics.json").write_text('{"metrics": []}')
    run = RunFolder(tmp_path)
    with pytest.raises(UserError, match=r"metrics\.csv: has 7 frames, but the run has 5, so that a longer run has left "
                                        r"it; make it anew: snakemake -j2 outputs/tiny/draft/metrics\.csv"):
        {"library": lambda: pipeline.open_run(tmp_path).metrics, "effects_off": lambda: effects_off._load(run, OIL),
         "compare": lambda: levels.common_frames([run, run])}[reader]()


def test_every_frame_has_its_files(folder):
    run = RunFolder(folder)
    assert [frame.number for frame in run.frames] == list(range(KEPT)) and len(run.times) == KEPT
    for frame, picture in zip(run.frames, run.pictures, strict=True):
        assert frame.read().time == frame.time == run.time_of(picture) and run.frame_of(picture) == frame
        assert frame.surface(OIL).volume == pytest.approx(frame.surfaces_of([OIL])[OIL].volume)


def test_a_run_that_goes_on_is_exported_as_far_as_it_is(folder, tmp_path):
    run = RunFolder(folder)
    vars(run)["scene"] = dataclasses.replace(run.scene, output=dataclasses.replace(
        run.scene.output, duration=20 * INTERVAL, until_rest=False))
    ready = export.ready_frames(run)
    assert len(ready) == LEFT and "3 of 10 segments have surfaces; exported up to 3 s" in export.what_is_missing(
        run, ready)


def test_a_run_of_a_larger_computer_can_be_read(folder, monkeypatch):
    """Whether the scene could be run here is not asked of one that has been run."""
    monkeypatch.setattr(memory_check, "memory_of_computer", lambda: 1e6)
    with pytest.raises(UserError, match="of this computer"):
        load_resolved(folder / "scene.json")
    for reader in READERS:
        assert READERS[reader](RunFolder(folder)) == INTERVAL * (KEPT - 1)
    cost.main([str(folder / name) for name in ("scene.json", "initial.npz", "metrics.csv")]
              + ["--logs", str(folder / "logs"), "--output", str(folder.parent / "cost.html")])


def test_what_is_no_run_is_said(tmp_path):
    with pytest.raises(UserError, match="holds no run; run the scene at this level first"):
        RunFolder(tmp_path).frames  # noqa: B018
