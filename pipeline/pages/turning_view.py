"""The surfaces of a run over time as the viewer of the page wants them: few triangles, whole numbers, deflated."""
import base64
import dataclasses
import zlib
from collections.abc import Iterable
from typing import Any

import numpy as np
from PIL import ImageColor
from scipy.spatial import cKDTree

from pipeline.pictures.eye_view import TOUCH_DEPTH, break_lines
from pipeline.pictures.fundus_map import BREAK_COLOR
from pipeline.pictures.marks import clock, pretty
from pipeline.pictures.moments import evenly_chosen
from pipeline.pictures.paint import Paint, css, film_distance, paint_of, wall_fractions
from pipeline.runs.run_folder import RunFolder
from pipeline.scenes.retina import Patch, globe_radius
from pipeline.scenes.shown_liquids import shown_liquids
from pipeline.surfaces.saved_frame import SavedFrame

FRAMES = (41, 21, 11, 6)        # that are shown; fewer where they are large
MOST_BYTES = 3_200_000          # of their data on a page
MOST_TRIANGLES = 8_000          # of the surface of a liquid in a frame
MOST_WALL_TRIANGLES = 20_480    # of the wall: that of the default eye is drawn as it is
EFFORT = 6                      # of zlib, 1 to 9
MARGIN = 1.05                   # of the whole numbers around the surfaces
SMALLEST_REACH = 1.25           # of what is seen, over half the size of the surfaces: room for words
EDGE = 50.0                     # deg, between triangles from which an edge is sharp
MOST_VERTICES = 2**16           # that two bytes count
LINE = 1e-3                     # m from the contact line, at which its distance is cut off
BOX_COLOR = "#e9edf1"
BREAK_WIDTH, BREAK_LIFT = 0.4e-3, 0.993     # m, of the band around a break; so much nearer to the center it is drawn
# Whence to look: words, azimuth from the front toward the patient's left, and elevation, rad.
EYE_VIEWS = (("from the left", (1.5708, 0.0)), ("from the front", (0.0, 0.0)), ("from behind", (3.1416, 0.0)),
             ("from above", (0.0, 1.5)))
EYE_VIEW, EYE_AXES = (0.75, 0.28), {"superior": (0, 1, 0), "anterior": (0, 0, 1), "patient's left": (1, 0, 0)}
BOX_VIEWS = (("from the front", (0.0, 0.0)), ("from the side", (1.5708, 0.0)), ("from above", (0.0, 1.5)))
BOX_VIEW, BOX_AXES = (0.5, 0.3), {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}


def view_within(run: RunFolder) -> dict[str, Any]:
    """Return what the viewer shows, of so many frames that its data has ``MOST_BYTES`` at most."""
    for count in FRAMES:
        view = turning_view(run, count)
        if len(view["data"]) <= MOST_BYTES:
            break
    return view


def turning_view(run: RunFolder, count: int = FRAMES[0]) -> dict[str, Any]:
    """Return what the viewer shows of frames over time: liquids, the wall and its breaks, in units of half its size.

    Parameters
    ----------
    count : of frames, at most.
    """
    of_eye = run.scene.container is None
    frames = evenly_chosen(run.ready_frames, count)
    wall = frames[-1].read_wall() if of_eye else run.cavity()
    center, half = np.array(wall.center), 0.5 * MARGIN * max(np.ptp(np.array(wall.bounds).reshape(3, 2), axis=1))
    data, paint = _Data(), paint_of(run.scene)
    shown = shown_liquids(run.scene) or run.scene.liquids
    meshes: list[dict[str, Any]] = []
    for liquid in shown:
        color, name = np.array(ImageColor.getrgb(liquid.color)), pretty(liquid.name)
        if of_eye and len(shown) == 1:  # where oil touches the wall, the wall is painted
            color, name = paint.covered, f"interface of {name}"
        # The first frame may have none: the viewer needs a point all the same.
        meshes.append({"wall": False, "legend": [(css(color), name)], **_nothing(data), "coveredColor": color.tolist()})
    surface = _smooth(_decimated(wall, MOST_WALL_TRIANGLES))
    nearest = cKDTree(np.asarray(wall.points)).query(np.asarray(surface.points))[1]
    packed = _packed(surface, data, center, half)
    if of_eye:
        line = film_distance(wall)
        oil = pretty(shown[0].name)
        legend = [(css(paint.covered), f"wall under {oil}"), (css(paint.bare), f"wall without {oil}")]
        if line is not None:
            legend[:1] = [(css(paint.covered), f"wall that {oil} touches"),
                          (css(paint.film), "wall under it, on a thin film")]
        meshes.append({"wall": True, "fades": True, "legend": legend, **packed, "filmColor": paint.film.tolist(),
                       **_on_wall(wall, nearest, data, paint)})
        patches = run.scene.patches(globe_radius(np.asarray(wall.points)))["breaks"]
        if patches:
            breaks = "break of the retina" if len(patches) == 1 else "breaks of the retina"
            meshes.append({"wall": True, "legend": [(css(BREAK_COLOR), breaks)], "coveredColor": list(BREAK_COLOR),
                           **_packed(_smooth(break_bands(wall, patches.values()).triangulate()), data, center, half)})
    else:
        meshes.append({"wall": True, "fades": True, "legend": [(BOX_COLOR, "wall")], **packed,
                       "coveredColor": ImageColor.getrgb(BOX_COLOR)})
    views, view, axes = (EYE_VIEWS, EYE_VIEW, EYE_AXES) if of_eye else (BOX_VIEWS, BOX_VIEW, BOX_AXES)
    farthest = float(np.linalg.norm(wall.points - center, axis=1).max() / half)
    reach = {name: float(((wall.points - center) @ np.array(direction)).max() / half) + 0.12
             for name, direction in axes.items()}

    def of_frame(frame: SavedFrame) -> dict[str, Any]:
        changes: list[dict[str, Any] | None] = []
        for mesh, liquid in zip(meshes, shown, strict=False):
            surface = frame.surface(liquid.name)
            if of_eye and surface.n_cells:
                surface = surface.clip_scalar(scalars="depth", value=TOUCH_DEPTH, invert=False)
            found = _surface(surface, data, center, half) if surface.n_cells else _nothing(data)
            changes.append({**found, "coveredColor": mesh["coveredColor"]})
        if of_eye:
            changes.append(_on_wall(frame.read_wall(), nearest, data, paint))
        return {"time": clock(frame.number * run.scene.output.frame_interval, run.scene.output.second_means),
                "meshes": changes}

    return {"meshes": meshes, "views": views, "view": view, "reach": max(SMALLEST_REACH, farthest),
            "frames": [of_frame(frame) for frame in frames],
            "ramp": base64.b64encode(paint.colors.tobytes()).decode(),
            "axes": [(name, [reach[name] * part for part in direction]) for name, direction in axes.items()],
            "data": data.packed()}


class _Data:
    """Numbers of all frames, one behind the other."""

    def __init__(self):
        self._parts: list[bytes] = []
        self._length = 0

    def add(self, array: np.ndarray) -> tuple[int, int]:
        """Return where an array stands, at a multiple of four bytes, and how many numbers it has."""
        part = np.ascontiguousarray(array).tobytes()
        place = self._length
        self._parts.append(part + bytes(-len(part) % 4))
        self._length += len(self._parts[-1])
        return place, array.size

    def packed(self) -> str:
        """Return all of it, deflated, as base64."""
        return base64.b64encode(zlib.compress(b"".join(self._parts), EFFORT)).decode()


def break_bands(wall, breaks: Iterable[Patch]):
    """Bands along the edges of breaks just inside a wall, pyvista.PolyData that faces outward as the wall does."""
    import pyvista

    wider = np.degrees(BREAK_WIDTH / globe_radius(np.asarray(wall.points)))
    corners, faces, count = [], [], 0
    for one in breaks:
        around = wider / max(np.sin(np.radians(one.latitude)), 1e-3)
        rims = [dataclasses.replace(
            one, height=max(one.height + sign * wider, 0.0),
            width=one.width if one.width >= 360.0 else min(max(one.width + sign * around, 0.0), 359.9))
            for sign in (-1.0, 1.0)]
        inner, outer = (BREAK_LIFT * np.asarray(line.points[:-1]) for line in break_lines(wall, rims))
        here, size = np.arange(len(inner)), len(inner)
        after = np.roll(here, -1)
        quads = np.stack([here, after, size + after, size + here], axis=1)
        first, second, third, fourth = np.concatenate([inner, outer])[quads.T]
        outward = (np.cross(third - first, fourth - second) * first).sum()
        corners += [inner, outer]
        faces.append(count + (quads if outward > 0.0 else quads[:, ::-1]))
        count += 2 * size
    return pyvista.PolyData.from_regular_faces(np.concatenate(corners).astype(np.float32), np.concatenate(faces))


def _on_wall(wall, nearest: np.ndarray, data: _Data, paint: Paint) -> dict[str, Any]:
    """Return what touches the wall of a frame: its color, and how far the contact line and films are.

    Parameters
    ----------
    wall : pyvista.PolyData of the reconstruct stage.
    nearest : (n,), its points that stand for those that are drawn.
    """
    points = wall.point_data

    def distance(values: np.ndarray) -> tuple[int, int]:
        return data.add(np.rint(127.0 * np.clip(np.asarray(values)[nearest] / LINE, -1.0, 1.0)).astype("i1"))

    changes: dict[str, Any] = {"toLine": distance(points["contact_distance"])}
    if (film := film_distance(wall)) is not None:
        changes["toFilm"] = distance(film)
    for name, covered in (("covered", True), ("bare", False)):
        places = np.rint(255.0 * np.clip(wall_fractions(wall, covered)[nearest], 0.0, 1.0)).astype("u1")
        if np.ptp(places) == 0:
            changes[f"{name}Color"] = paint.colors[places[0]].tolist()
        else:
            changes[f"{name}Places"] = data.add(places)
    return changes


def _decimated(surface, most: int):
    """Return a surface, pyvista.PolyData, of triangles without data, of so many at most."""
    plain = surface.copy(deep=False)
    plain.clear_data()
    plain = plain.triangulate()
    return plain if plain.n_cells <= most else plain.decimate(1.0 - most / plain.n_cells)


def _smooth(surface):
    """Return a surface, pyvista.PolyData, with normals, sharp where its edges are."""
    smooth = surface.compute_normals(cell_normals=False, split_vertices=True, feature_angle=EDGE,
                                     auto_orient_normals=False, consistent_normals=False)
    if smooth.n_points < MOST_VERTICES:
        return smooth
    return surface.compute_normals(cell_normals=False, split_vertices=False, auto_orient_normals=False,
                                   consistent_normals=False)  # sharp all over


def _packed(surface, data: _Data, center: np.ndarray, half: float) -> dict[str, Any]:
    """Return a surface that has normals."""
    return {**_points(surface, data, center, half),
            "normal": data.add(np.rint(127.0 * np.asarray(surface.point_data["Normals"])).astype("i1"))}


def _surface(surface, data: _Data, center: np.ndarray, half: float) -> dict[str, Any]:
    """Return the surface of a liquid; the viewer computes the normals of its points."""
    return _points(_decimated(surface, MOST_TRIANGLES), data, center, half)


def _points(surface, data: _Data, center: np.ndarray, half: float) -> dict[str, Any]:
    points = np.rint(32767.0 * np.clip((np.asarray(surface.points) - center) / half, -1.0, 1.0)).astype("<i2")
    return {"position": data.add(points), "index": data.add(surface.regular_faces.astype("<u2"))}


def _nothing(data: _Data) -> dict[str, Any]:
    """Return a surface without triangles."""
    return {"position": data.add(np.zeros((1, 3), "<i2")), "index": data.add(np.zeros(0, "<u2"))}
