"""Movies can be followed and tell their speed; slides and papers get pictures of their own."""
import base64
import dataclasses
import itertools
import subprocess

import imageio_ffmpeg
import numpy as np
import pytest
from conftest import ROOT
from helpers import headless_browser
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


def movie_scene(folder, second_means=None, interval=0.1):
    """Write a resolved scene with frames so far apart, s; return the option that names it."""
    scene = load_scene(ROOT / "config" / "scenes" / "tamponade.yaml", accuracy="draft")
    output = dataclasses.replace(scene.output, second_means=second_means, frame_interval=interval)
    (folder / "scene.json").write_text(dataclasses.replace(scene, output=output).to_json())
    return ["--scene", str(folder / "scene.json")]


def test_movie_can_be_followed_and_says_how_fast_it_plays(tmp_path, capsys):
    movie.main([*pictures_of(tmp_path, 21), *movie_scene(tmp_path)])
    frames = imageio_ffmpeg.read_frames(tmp_path / "movie.mp4")
    about = next(frames)
    assert 4.0 + 1.3 < about["duration"] < 6.0 and 20 < about["fps"] < 40
    pixels = [np.frombuffer(frame, np.uint8).reshape(180, 320, 3) for frame in frames]
    reds = np.array([frame[:100, :, 0].mean() for frame in pixels])
    assert (reds > 0.98 * reds.max()).sum() / about["fps"] > 1.4              # the last picture stays
    half = np.flatnonzero(reds > 0.5 * reds.max())[0] / about["fps"]
    assert half == pytest.approx(2.0, abs=0.25)                               # evenly
    assert (pixels[-1][160:, 200:] > 200).all(axis=-1).sum() > 300            # the speed, on white
    assert "0.5 × real time, 5 pictures per second, 21 in all, 5.5 s; the scene saves a frame every 0.1 s" in \
        capsys.readouterr().out


def test_movie_shows_24_pictures_per_second_where_a_scene_saves_enough(tmp_path, capsys):
    movie.main([*pictures_of(tmp_path, 73, size=(64, 36)), *movie_scene(tmp_path, interval=0.05)])
    about = next(imageio_ffmpeg.read_frames(tmp_path / "movie.mp4"))
    assert about["fps"] == pytest.approx(24.0) and about["duration"] == pytest.approx(72 / 24 + 1.5, abs=0.05)
    assert "1.2 × real time, 24 pictures per second, 73 in all, 4.5 s\n" in capsys.readouterr().out


def test_movie_of_a_time_lapse_tells_weeks(tmp_path, capsys):
    movie.main([*pictures_of(tmp_path, 21), *movie_scene(tmp_path, second_means=28 * 86400.0)])
    assert "2 weeks per second, 5 pictures per second, 21 in all, 5.5 s;" in capsys.readouterr().out


@pytest.mark.thorough
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
def test_movies_of_any_scene_can_be_followed_and_play_on_any_player(pictures, interval):
    pace = pace_of(pictures, interval)
    assert pace.duration(pictures) >= 3.0 and pace.rate <= 24.0
    assert 20.0 <= pace.repeats * pace.rate <= 30.0 or pace.rate < 2.0
    assert pace.speed == pytest.approx(pace.rate * interval)
    assert pace.speed >= 0.5 * min((pictures - 1) * interval / 3.0, 24.0 * interval)  # not slower than it must be


COLORS = ((253, 231, 37), (33, 145, 140), (68, 1, 84), (213, 94, 0), (120, 94, 240), (158, 202, 225), (0, 0, 0),
          (255, 255, 255), (200, 30, 40), (30, 160, 60))


def bands(folder):
    """Make a movie of one picture, a band of every color, 1080 lines high; return its path."""
    picture = Image.new("RGB", (1920, 1080))
    for index, color in enumerate(COLORS):
        picture.paste(color, (192 * index, 0, 192 * (index + 1), 1080))
    picture.save(folder / "frame_00000.png")
    movie.main([str(folder), "--output", str(folder / "movie.mp4"), "--fps", "0.2"])
    return folder / "movie.mp4"


def test_colors_of_a_movie_are_those_that_were_drawn(tmp_path):
    from skimage.color import deltaE_ciede2000, rgb2lab

    frames = imageio_ffmpeg.read_frames(bands(tmp_path))
    next(frames)
    shown = np.frombuffer(next(frames), np.uint8).reshape(1080, 1920, 3)[540, 96::192]
    assert deltaE_ciede2000(*(rgb2lab(np.array(one, float) / 255.0) for one in (shown, COLORS))).max() < 3.0


def test_movie_tells_players_its_colors_and_asks_nothing_unusual_of_them(tmp_path):
    path = bands(tmp_path)
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-hide_banner", "-i", str(path)]
    told = subprocess.run(command, capture_output=True, text=True).stderr
    assert "yuv420p(tv, bt709, progressive), 1920x1080" in told     # one word: matrix, primaries and transfer
    content = path.read_bytes()
    assert content.index(b"moov") < content.index(b"mdat")          # plays before all of it is there
    settings = content.index(b"avcC") + 4                           # version, profile, constraints, level
    assert content[settings + 1] == 100 and content[settings + 3] <= 42


def test_browser_plays_the_movie_in_its_colors(tmp_path):
    path = headless_browser.find_browser()
    if path is None:
        pytest.skip("no Chromium on this machine")
    address = base64.b64encode(bands(tmp_path).read_bytes()).decode()   # a canvas gives no pixels of another file
    (tmp_path / "page.html").write_text(f'<video muted src="data:video/mp4;base64,{address}"></video>')
    browser = headless_browser.Browser(path, tmp_path / "profile")
    try:
        browser.open(tmp_path / "page.html", 800)
        shown = browser.run("""(async () => {
            const video = document.querySelector("video"), canvas = new OffscreenCanvas(1920, 1080).getContext("2d");
            const seen = new Promise(done => video.requestVideoFrameCallback(done));
            await video.play();
            await seen;
            canvas.drawImage(video, 0, 0);
            return [...Array(10).keys()].map(k => [...canvas.getImageData(96 + 192 * k, 540, 1, 1).data].slice(0, 3));
        })()""")
    finally:
        browser.close()
    assert np.abs(np.array(shown) - COLORS).max() <= 4
