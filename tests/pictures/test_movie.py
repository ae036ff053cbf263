"""Movies can be followed and tell their speed; slides and papers get pictures of their own."""
import dataclasses
import itertools

import imageio_ffmpeg
import numpy as np
import pytest
from conftest import ROOT
from PIL import Image

from pipeline import movie
from pipeline.pictures import moments
from pipeline.pictures.pace import pace_of
from pipeline.scenes.load import load_scene


def pictures_of(folder, count, size=(320, 180)):
    """Draw pictures whose red grows with their number; return the paths as the stage takes them."""
    for index in range(count):
        Image.new("RGB", size, (5 * index, 0, 0)).save(folder / f"frame_{index:05d}.png")
    return [str(folder), "--output", str(folder / "movie.mp4")]


def movie_scene(folder, second_means=None):
    """Write a resolved scene with frames 0.1 s apart; return the option that names it."""
    scene = load_scene(ROOT / "config" / "scenes" / "tamponade.yaml", accuracy="draft")
    output = dataclasses.replace(scene.output, second_means=second_means)
    (folder / "scene.json").write_text(dataclasses.replace(scene, output=output).to_json())
    return ["--scene", str(folder / "scene.json")]


def test_movie_can_be_followed_and_says_how_fast_it_plays(tmp_path, capsys):
    movie.main([*pictures_of(tmp_path, 21), *movie_scene(tmp_path)])
    frames = imageio_ffmpeg.read_frames(tmp_path / "movie.mp4")
    about = next(frames)
    assert 8.0 + 1.3 < about["duration"] < 10.0 and 20 < about["fps"] < 40
    pixels = [np.frombuffer(frame, np.uint8).reshape(180, 320, 3) for frame in frames]
    reds = np.array([frame[:100, :, 0].mean() for frame in pixels])
    assert (reds > 0.98 * reds.max()).sum() / about["fps"] > 1.4              # the last picture stays
    half = np.flatnonzero(reds > 0.5 * reds.max())[0] / about["fps"]
    assert half == pytest.approx(4.0, abs=0.5)                                # evenly
    assert (pixels[-1][160:, 200:] > 200).all(axis=-1).sum() > 300            # the speed, on white
    assert "21 pictures, 9.5 s, 0.25 × real time" in capsys.readouterr().out


def test_movie_of_a_time_lapse_tells_weeks(tmp_path, capsys):
    movie.main([*pictures_of(tmp_path, 21), *movie_scene(tmp_path, second_means=28 * 86400.0)])
    assert "21 pictures, 9.5 s, 1 week per second" in capsys.readouterr().out


@pytest.mark.parametrize("suffix", ["gif", "webp"])
def test_slides_and_papers_get_pictures_of_a_bounded_size(tmp_path, monkeypatch, suffix):
    monkeypatch.setattr(moments, "ANIMATION_BYTES", 30_000)
    random = np.random.default_rng(0)
    for index in range(100):
        noise = random.integers(0, 255, (18, 32, 3), np.uint8)
        Image.fromarray(noise).resize((320, 180), Image.Resampling.NEAREST).save(tmp_path / f"frame_{index:05d}.png")
    outputs = [tmp_path / name for name in (f"movie.{suffix}", "poster.png", "moments.png")]
    options = zip(("--animation", "--poster", "--moments"), map(str, outputs), strict=True)
    movie.main([str(tmp_path), "--output", str(tmp_path / "movie.mp4"), *itertools.chain(*options)])
    animation, poster, sheet = map(Image.open, outputs)
    assert 20 < animation.n_frames <= 80
    assert outputs[0].stat().st_size <= 30_000 or animation.width == moments.ANIMATION_WIDTHS[-1]
    last = np.asarray(Image.open(tmp_path / "frame_00099.png"))
    np.testing.assert_array_equal(np.asarray(poster), last)
    assert sheet.size == (4 * 320 + 3 * 8, 2 * 180 + 8)
    np.testing.assert_array_equal(np.asarray(sheet)[-180:, -320:], last)


def test_animation_keeps_the_colors_of_small_marks_among_shades(tmp_path):
    """A median cut over the same shades makes the marks brown and gray."""
    marks = {(5, 5): (213, 94, 0), (5, 20): (120, 94, 240)}                       # cannula and drain
    shade = np.linspace(0.0, 1.0, 320)[None, :, None] * [255.0, 230.0, 60.0] + np.zeros((180, 1, 1))
    for index in range(12):
        pixels = (0.9 * shade + index).astype(np.uint8)
        for (row, column), color in marks.items():
            pixels[row:row + 6, column:column + 6] = color
        Image.fromarray(pixels).save(tmp_path / f"frame_{index:05d}.png")
    movie.main([str(tmp_path), "--output", str(tmp_path / "movie.mp4"), "--animation", str(tmp_path / "movie.gif")])
    animation = Image.open(tmp_path / "movie.gif")
    for frame in (0, animation.n_frames - 1):
        animation.seek(frame)
        shown = np.asarray(animation.convert("RGB")).astype(int)
        for (row, column), color in marks.items():
            assert np.abs(shown[row + 3, column + 3] - color).max() <= 8
        assert np.abs(shown[60:] - (0.9 * shade[60:] + frame)).mean() < 8.0


@pytest.mark.parametrize(("pictures", "interval"), [(5, 0.05), (41, 0.1), (1000, 0.01), (361, 10.0), (1, 1.0)])
def test_movies_of_any_scene_last_eight_seconds_and_play_on_any_player(pictures, interval):
    pace = pace_of(pictures, interval)
    assert pace.duration(pictures) >= 8.0 and pace.rate <= 30.0
    assert pace.speed == pytest.approx(pace.rate * interval)
    assert pace.speed >= 0.5 * min((pictures - 1) * interval / 8.0, 30.0 * interval)  # not slower than it must be
