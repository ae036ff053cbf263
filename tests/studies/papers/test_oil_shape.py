"""The study of what interface forces do: its picture shows all scenes at the same times."""
import numpy as np
from conftest import ROOT
from PIL import Image

from pipeline.scenes.load import load_scene
from studies.papers import oil_shape


def test_scenes_that_keep_frames_at_other_intervals_are_drawn_at_the_same_times(tmp_path, monkeypatch):
    """`tamponade` keeps a frame every 0.05 s for 10 s, the scenes of the paper every 0.1 s for 4 s."""
    path = tmp_path / "frame.png"
    Image.new("RGB", (2400, 1200)).save(path)
    scene, drawn = load_scene(ROOT / "config/scenes/tests/tiny.yaml", "draft"), []
    monkeypatch.setattr(oil_shape, "section_and_map", lambda picture, width: (picture, picture))
    monkeypatch.setattr(oil_shape, "sheet", lambda rows, legends: drawn.extend(rows))
    oils = [oil_shape.Oil(scene, [path] * len(time), time, *[np.ones(len(time))] * 3)
            for time in (np.linspace(0.0, 4.0, 41), np.linspace(0.0, 10.0, 201))]
    oil_shape._side_by_side(oils, 2)
    assert [[words for _, words in row[::2]] for _, row in drawn] == [["2.0 s", "4.0 s"]] * 2
