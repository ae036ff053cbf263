"""The surfaces of the last frame as the viewer of the page wants them: few triangles, whole numbers, base64."""
import base64
import dataclasses
from collections.abc import Iterable
from typing import Any

import numpy as np
from PIL import ImageColor
from scipy.spatial import cKDTree

from pipeline.pictures.eye_view import TOUCH_DEPTH, break_lines
from pipeline.pictures.fundus_map import BREAK_COLOR
from pipeline.pictures.marks import pretty
from pipeline.pictures.paint import css, film_distance, paint_of, wall_fractions
from pipeline.runs.run_folder import RunFolder
from pipeline.scenes.retina import Patch, globe_radius
from pipeline.scenes.shown_liquids import shown_liquids

MOST_TRIANGLES = 40_000         # of one surface
MOST_VERTICES = 2**16 - 1       # that WebGL can count
MARGIN = 1.05                   # of the whole numbers around the surfaces
EDGE = 50.0                     # deg, between triangles from which an edge is sharp
LINE = 1e-3                     # m from the contact line, at which its distance is cut off
BOX_COLOR = "#e9edf1"
BREAK_WIDTH, BREAK_LIFT = 0.4e-3, 0.993     # m, of the band around a break; so much nearer to the center it is drawn
# Whence to look: words, azimuth from the front toward the patient's left, and elevation, rad.
EYE_VIEWS = (("from the left", (1.5708, 0.0)), ("from the front", (0.0, 0.0)), ("from behind", (3.1416, 0.0)),
             ("from above", (0.0, 1.5)))
EYE_VIEW, EYE_AXES = (0.75, 0.28), {"superior": (0, 1, 0), "anterior": (0, 0, 1), "patient's left": (1, 0, 0)}
BOX_VIEWS = (("from the front", (0.0, 0.0)), ("from the side", (1.5708, 0.0)), ("from above", (0.0, 1.5)))
BOX_VIEW, BOX_AXES = (0.5, 0.3), {"x": (1, 0, 0), "y": (0, 1, 0), "z": (0, 0, 1)}


def turning_view(run: RunFolder) -> dict[str, Any]:
    """Return what the viewer shows of the last frame: liquids, the wall and its breaks, in units of half its size."""
    of_eye = run.scene.container is None
    wall = run.frames[-1].read_wall() if of_eye else run.cavity()
    center, half = np.array(wall.center), 0.5 * MARGIN * max(np.ptp(np.array(wall.bounds).reshape(3, 2), axis=1))

    def packed(surface, covered, bare, distance=None) -> dict[str, str]:
        return _packed(surface, center, half, covered, bare, distance)

    meshes, paint = [], paint_of(run.scene)
    shown = shown_liquids(run.scene) or run.scene.liquids
    for liquid in shown:
        surface = run.frames[-1].surface(liquid.name)
        color = np.array(ImageColor.getrgb(liquid.color))
        name = pretty(liquid.name)
        if of_eye:  # where oil touches the wall, the wall is painted
            if surface.n_cells:
                surface = surface.clip_scalar(scalars="depth", value=TOUCH_DEPTH, invert=False)
            if len(shown) == 1:
                color, name = paint.covered, f"interface of {name}"
        if surface.n_cells:
            meshes.append({"wall": False, "legend": [(css(color), name)], **packed(surface, color, color)})
    if of_eye:
        covered, bare = (paint.of(wall_fractions(wall, side)) for side in (True, False))
        oil, line = pretty(shown[0].name), film_distance(wall)
        legend = [(css(paint.covered), f"wall under {oil}"), (css(paint.bare), f"wall without {oil}")]
        if line is not None:
            covered = np.where(line[:, None] > 0.0, paint.film, covered)
            legend[:1] = [(css(paint.covered), f"wall that {oil} touches"),
                          (css(paint.film), "wall under it, on a thin film")]
        meshes.append({"wall": True, "legend": legend,
                       **packed(wall, covered, bare, np.asarray(wall.point_data["contact_distance"]))})
        patches = run.scene.patches(globe_radius(np.asarray(wall.points)))["breaks"]
        if patches:
            color = np.array(BREAK_COLOR)
            breaks = "break of the retina" if len(patches) == 1 else "breaks of the retina"
            meshes.append({"wall": True, "legend": [(css(color), breaks)],
                           **packed(break_bands(wall, patches.values()), color, color)})
    else:
        color = np.array(ImageColor.getrgb(BOX_COLOR))
        meshes.append({"wall": True, "legend": [(css(color), "wall")], **packed(wall, color, color)})
    views, view, axes = (EYE_VIEWS, EYE_VIEW, EYE_AXES) if of_eye else (BOX_VIEWS, BOX_VIEW, BOX_AXES)
    reach = {name: float(((wall.points - center) @ np.array(direction)).max() / half) + 0.12
             for name, direction in axes.items()}
    return {"meshes": meshes, "views": views, "view": view,
            "axes": [(name, [reach[name] * part for part in direction]) for name, direction in axes.items()]}


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


def _packed(surface, center: np.ndarray, half: float, covered: np.ndarray, bare: np.ndarray,
            distance: np.ndarray | None) -> dict[str, str]:
    """Return a pyvista.PolyData of n points as base64.

    Parameters
    ----------
    covered, bare : (n, 3) or (3,) colors where the oil touches and where not, 0 to 255.
    distance : (n,) m, to the contact line, positive where oil touches; None counts as touching.
    """
    corners = np.asarray(surface.points)
    plain = surface.copy(deep=False)
    plain.clear_data()
    plain = plain.triangulate()
    if plain.n_cells > MOST_TRIANGLES:
        plain = plain.decimate(1.0 - MOST_TRIANGLES / plain.n_cells)
    smooth = plain.compute_normals(cell_normals=False, split_vertices=True, feature_angle=EDGE,
                                   auto_orient_normals=False, consistent_normals=False)
    if smooth.n_points > MOST_VERTICES:  # sharp all over
        smooth = plain.compute_normals(cell_normals=False, split_vertices=False, auto_orient_normals=False,
                                       consistent_normals=False)
    points = np.asarray(smooth.points)
    nearest = cKDTree(corners).query(points)[1]
    colors = [np.broadcast_to(color, (len(corners), 3))[nearest].astype("u1") for color in (covered, bare)]
    distance = np.full(len(corners), LINE) if distance is None else distance
    return {"position": _base64(np.rint(32767.0 * np.clip((points - center) / half, -1.0, 1.0)).astype("<i2")),
            "normal": _base64(np.rint(127.0 * np.asarray(smooth.point_data["Normals"])).astype("i1")),
            "toLine": _base64(np.rint(127.0 * np.clip(distance[nearest] / LINE, -1.0, 1.0)).astype("i1")),
            "covered": _base64(colors[0]), "bare": _base64(colors[1]),
            "index": _base64(smooth.regular_faces.astype("<u2"))}


def _base64(array: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(array).tobytes()).decode()
