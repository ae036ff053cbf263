"""Sheets of containers show liquids as filled regions, of the right size, place and color."""
import io
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image, ImageColor

from pipeline.pictures.container_panel import INSIDE
from pipeline.pictures.container_sheet import ContainerMoments, moments
from pipeline.pictures.container_view import ContainerView, cone
from pipeline.pictures.picture_grid import sheet
from pipeline.scenes.model import Funnel
from pipeline.surfaces.contour_lines import ContourLines
from pipeline.surfaces.saved_frame import SavedFrame
from pipeline.surfaces.surface_files import to_polydata, write_surface

WIDTH = 400
COLORS = ("#e6a23c", "#3c78d8")


@pytest.fixture
def scene():
    """Return what a sheet reads of a scene in a plane: water of 2 m x 1 m, with oil in it."""
    liquids = tuple(SimpleNamespace(name=name, color=color)
                    for name, color in zip(("oil", "water"), COLORS, strict=True))
    return SimpleNamespace(dimension=2, liquids=liquids, title="A plane",
                           container=SimpleNamespace(size=(2.0, 1.0), funnels=()))


def circle(radius, center=(0.5, 0.5), turn=1.0):
    """Return a closed line, clockwise with turn -1."""
    angle = turn * np.linspace(0.0, 2.0 * np.pi, 200)
    line = np.array(center) + radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    line[-1] = line[0]
    return line


def surfaces():
    """Return a ring of oil around a drop of water of the same size as its hole."""
    return {"oil": to_polydata(ContourLines([circle(0.4), circle(0.2, turn=-1.0)])),
            "water": to_polydata(ContourLines([circle(0.2)]))}


def frame_with(fraction):
    """Return a frame of particles all over the container, with a fraction of oil by their places."""
    position = np.stack(np.meshgrid(np.arange(0.01, 2.0, 0.02), np.arange(0.01, 1.0, 0.02)), axis=-1).reshape(-1, 2)
    away = np.hypot(*(position - 0.5).T)
    oil = fraction(position)
    return SimpleNamespace(position=np.pad(position, ((0, 0), (0, 1))), volume=np.full(len(position), 4e-4),
                           volume_fraction=np.stack([oil, 1.0 - oil], axis=1), particle_spacing=0.02,
                           phase=np.where((away < 0.4) & (away > 0.2), 0, 1))


def share_of(picture, color):
    """Return the share of the pixels of a color."""
    return (np.asarray(picture) == ImageColor.getrgb(color)).all(axis=-1).mean()


def test_a_plane_is_filled_up_to_the_outlines(scene):
    picture = ContainerMoments(scene, WIDTH).draw(frame_with(lambda x: np.hypot(*(x - 0.5).T) < 0.4), surfaces())
    assert picture.size == (400, 200)
    oil, water = np.pi * (0.4**2 - 0.2**2) / 2.0, np.pi * 0.2**2 / 2.0
    assert share_of(picture, COLORS[0]) == pytest.approx(oil, abs=0.02)     # less the outlines
    assert share_of(picture, COLORS[1]) == pytest.approx(water, abs=0.015)
    assert picture.getpixel((100, 100)) == ImageColor.getrgb(COLORS[1]) and picture.getpixel((300, 100)) == INSIDE
    assert picture.getpixel((100, 40)) == picture.getpixel((100, 160)) == ImageColor.getrgb(COLORS[0])


def test_colors_mix_as_the_fractions_do(scene):
    picture = ContainerMoments(scene, WIDTH).draw(frame_with(lambda x: np.clip(x[:, 0], 0.0, 1.0)), surfaces())
    oil, water = (np.array(ImageColor.getrgb(color), float) for color in COLORS)
    for x in (0.2, 0.5, 0.8):
        found = np.array(picture.getpixel((round(200 * x), 100)), float)
        assert np.abs(found - (x * oil + (1.0 - x) * water)).max() < 4.0


def test_no_line_parts_liquids_that_mix_but_a_void_stays_one(scene):
    """Between the outlines of both liquids is a ring narrower than a particle, and one wider than two."""
    def drawn(width, fraction):
        both = {"oil": to_polydata(ContourLines([circle(0.4), circle(0.2 + width, turn=-1.0)])),
                "water": to_polydata(ContourLines([circle(0.2)]))}
        picture = ContainerMoments(scene, WIDTH).draw(frame_with(fraction), both)
        ring = 0.2 + 0.5 * width
        angle = np.linspace(0.0, 2.0 * np.pi, 100)
        return [picture.getpixel((round(200 * (0.5 + ring * np.cos(one))), round(200 * (0.5 + ring * np.sin(one)))))
                for one in angle]

    def mixed(x):
        return np.clip(x[:, 0], 0.0, 1.0)

    assert INSIDE not in drawn(0.015, mixed)
    assert drawn(0.06, mixed).count(INSIDE) > 90


def test_pictures_of_a_run_are_on_one_sheet(scene, tmp_path, monkeypatch):
    path = tmp_path / "frames" / "segment_000" / "frame_00000.vtu"
    folder = tmp_path / "surfaces" / "segment_000"
    folder.mkdir(parents=True)
    for liquid, lines in (("oil", [circle(0.4)]), ("water", [])):
        mesh = ContourLines(lines)
        write_surface(folder / f"frame_00000_{liquid}.vtp", mesh, time=0.0, liquid=liquid,
                      depth=np.zeros(len(mesh.points)))
    frame = frame_with(lambda x: np.ones(len(x)))
    frame.liquids, frame.time = ("oil", "water"), 0.25
    monkeypatch.setattr("pipeline.surfaces.saved_frame.read_frame", lambda _: frame)
    row = moments(scene, [SavedFrame(path, folder)] * 2, WIDTH, lambda number, frame: f"{number}: {frame.time:g} s")
    assert [caption for _, caption in row] == ["0: 0.25 s", "1: 0.25 s"]
    single, double = (Image.open(io.BytesIO(sheet([("One", row), ("Two", row)], across))) for across in (1, 2))
    assert double.width == 2 * single.width and 2 * double.height == single.height and single.width >= WIDTH
    assert share_of(single, COLORS[0]) * single.width * single.height == pytest.approx(
        4 * np.pi * 0.4**2 / 2.0 * 200 * 100, rel=0.06)


@pytest.mark.thorough
def test_a_funnel_is_seen_in_its_container():
    """Rims of 3 cm and 8 cm, 6 cm apart."""
    funnel = Funnel(center=(0.1, 0.05, 0.1), lower_radius=0.03, upper_radius=0.08, height=0.06, thickness=0.01)
    made = cone(funnel)
    assert made.bounds == pytest.approx((0.02, 0.18, 0.05, 0.11, 0.02, 0.18), abs=1e-4)
    assert made.area == pytest.approx(np.pi * 0.11 * np.hypot(0.05, 0.06), rel=0.01)
    pictures = []
    for funnels in ((), (funnel,)):
        view = ContainerView(np.array([0.2, 0.2, 0.2]), (200, 200), funnels)
        pictures.append(view.draw([]).astype(int))
        view.close()
    changed = (np.abs(pictures[0] - pictures[1]).max(axis=-1) > 20).mean()
    assert 0.03 < changed < 0.5
