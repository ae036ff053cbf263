"""The eye opened along its sagittal plane, both halves side by side in space (pyvista, off-screen).

Every half shows its wall, painted by what touches it, and the interface of the oil inside it, both opaque: nothing that
lies in one half is seen in the other, and no color mixes with another.
"""
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from pipeline.cavity.rays import interpolation
from pipeline.cavity.regions import MACULA_RADIUS
from pipeline.pictures.fundus_map import BREAK_COLOR, DISC_RADIUS, EQUATOR, disc_direction
from pipeline.pictures.opengl import off_screen
from pipeline.pictures.paint import OF_OIL, Paint, film_distance, wall_fractions
from pipeline.scenes.retina import ORA, Patch, globe_radius

SHELL_COLOR, EDGE_COLOR = "#d3d7dd", "#19202b"
NERVE_COLOR = "#e8cfae"
SHELL_START, SHELL_END = 0.15e-3, 0.9e-3        # m outside the wall
NERVE_RADIUS, NERVE_LENGTH = 1.5e-3, 4.0e-3     # m, drawn
TOUCH_DEPTH = 0.1e-3            # m; nearer to the wall a surface is not drawn: the wall is painted there
LINE_LIFT = 0.995               # lines on the wall are drawn so much nearer to the center
# Camera of the right half: from the patient's left, in front and above. That of the left half is its mirror image.
VIEW = np.array([1.0, 0.32, 0.55])
HALVES = {"right": 1.0, "left": -1.0}           # the half that is shown, and the side along x that the camera is on


class EyeView:
    """One plotter for all frames; only what the liquids do changes.

    Parameters
    ----------
    eye : pyvista.PolyData, closed surface of the cavity in m.
    size : width and height in pixels of the large canvas; the halves stand above one another.
    right_eye : whether the optic disc is on the patient's left of the macula.
    breaks : of the retina, whose outlines are drawn.
    paint : colors of what touches the wall.
    """

    def __init__(self, eye, size: tuple[int, int], *, right_eye: bool = True, breaks: Sequence[Patch] = (),
                 paint: Paint = OF_OIL):
        self.size, self.paint = size, paint
        self.plotter = off_screen(window_size=list(size), shape=(len(HALVES), 1), border=False,
                                  lighting="light kit")
        self.plotter.set_background("white", all_renderers=True)
        self.plotter.disable_anti_aliasing()    # the large canvas is averaged; samples would double the time
        self._changing: list = []
        center = np.array(eye.center)
        landmarks: list[tuple[Any, Any, float]] = [(line, EDGE_COLOR, size[1] / 600)
                                                   for line in landmark_lines(eye, right_eye)]
        landmarks += [(line, BREAK_COLOR, size[1] / 180) for line in break_lines(eye, breaks)]
        for row, (half, side) in enumerate(HALVES.items()):
            self.plotter.subplot(row, 0)
            self.plotter.add_mesh(half_shell(eye, side), color=SHELL_COLOR, smooth_shading=True,
                                  split_sharp_edges=True, ambient=0.2, specular=0.0)
            for line, color, width in landmarks:
                self._line(line, color, side, width)
            nerve = optic_nerve(eye, right_eye)
            if nerve.center[0] * side < 0.0:
                self.plotter.add_mesh(nerve, color=NERVE_COLOR, smooth_shading=True, split_sharp_edges=True,
                                      ambient=0.3, specular=0.0)
            self.plotter.enable_parallel_projection()
            self.plotter.camera_position = [center + 4.0 * eye.length * view_of(half), center, (0.0, 1.0, 0.0)]
            self.plotter.camera.parallel_scale = 0.58 * (eye.bounds[3] - eye.bounds[2])
            self.plotter.camera.clipping_range = (0.5 * eye.length, 12.0 * eye.length)

    def draw(self, wall, surfaces: Iterable) -> np.ndarray:
        """Pixels (height, width, 3) of one frame.

        Parameters
        ----------
        wall : pyvista.PolyData of the reconstruct stage.
        surfaces : pairs of a closed surface with ``depth``, pyvista.PolyData, and a color.
        """
        for row, actor in self._changing:
            self.plotter.renderers[row].remove_actor(actor, render=False)
        self._changing = []
        covered, bare = wall.clip_scalar(scalars="contact_distance", invert=False, value=0.0, both=True)
        painted = [(bare, self.paint.of(wall_fractions(bare, False)))]
        film, touched = covered.clip_scalar(scalars="film_distance", invert=False, value=0.0, both=True) \
            if covered.n_cells and film_distance(wall) is not None else (None, covered)
        painted.append((touched, self.paint.of(wall_fractions(touched, True))))
        if film is not None:
            painted.append((film, np.tile(self.paint.film, (film.n_points, 1))))
        edge = wall.contour([0.0], scalars="contact_distance") if covered.n_cells and bare.n_cells else None
        interfaces = [(interface, color) for surface, color in surfaces if surface.n_cells
                      for interface in [free_part(surface)] if interface.n_cells]
        for row, side in enumerate(HALVES.values()):
            self.plotter.subplot(row, 0)
            for part, colors in painted:
                if part.n_cells:
                    part.point_data["color"] = colors
                    self._add(row, side, part, scalars="color", rgb=True, ambient=0.65, diffuse=0.4)
            for interface, color in interfaces:
                self._add(row, side, interface, color=color, smooth_shading=True, ambient=0.45, diffuse=0.55,
                          specular=0.25, specular_power=20.0)
            if edge is not None and edge.n_cells:
                self._changing.append((row, self._line(edge, EDGE_COLOR, side, self.size[1] / 250)))
        self.plotter.render()
        return self.plotter.screenshot(None, return_img=True)[..., :3]

    def close(self) -> None:
        """Free the window."""
        self.plotter.close()

    def _add(self, row: int, side: float, mesh, **options) -> None:
        actor = self.plotter.add_mesh(mesh, reset_camera=False, render=False, **options)
        clip(actor, side)
        self._changing.append((row, actor))

    def _line(self, line, color, side: float, width: float):
        """Draw lines that lie on the wall, in the active half."""
        lifted = line.copy(deep=False)
        lifted.points = np.asarray(line.points) * LINE_LIFT
        actor = self.plotter.add_mesh(lifted, color=color, line_width=max(1.0, width), lighting=False,
                                      reset_camera=False, render=False)
        clip(actor, side)
        return actor


def view_of(half: str) -> np.ndarray:
    """Direction (3,) to the camera of a half."""
    return VIEW * [HALVES[half], 1.0, 1.0]


def screen_axes(half: str) -> np.ndarray:
    """Unit vectors (3, 3) to the right, up and toward the reader in the picture of a half."""
    toward = view_of(half) / np.linalg.norm(VIEW)
    right = np.cross([0.0, 1.0, 0.0], toward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(toward, right), toward])


def clip(actor, side: float) -> None:
    """Let an actor show only the half of the eye away from ``side``."""
    from vtkmodules.vtkCommonDataModel import vtkPlane

    plane = vtkPlane()
    plane.SetOrigin(0.0, 0.0, 0.0)
    plane.SetNormal(-side, 0.0, 0.0)
    actor.mapper.AddClippingPlane(plane)


def free_part(surface):
    """The part of a closed surface with ``depth`` that is away from the wall, with normals."""
    surface = surface.copy(deep=False)
    depth = surface.point_data["depth"].copy()
    surface.clear_data()
    surface.point_data["depth"] = depth
    free = surface.clip_scalar(scalars="depth", value=TOUCH_DEPTH, invert=False)
    return free.compute_normals(cell_normals=False, split_vertices=False, auto_orient_normals=False,
                                consistent_normals=False) if free.n_cells else free


def half_shell(eye, side: float):
    """The half of the wall away from ``side`` along x, with thickness and a flat cut rim; pyvista.PolyData."""
    closed = eye.compute_normals(cell_normals=False, auto_orient_normals=True, split_vertices=False)
    inner, outer = closed.copy(), closed.copy()
    inner.points = closed.points + SHELL_START * closed.point_data["Normals"]
    outer.points = closed.points + SHELL_END * closed.point_data["Normals"]
    wall = outer.append_polydata(inner.flip_faces())
    wall.clear_data()
    return wall.clip_closed_surface(normal=(-side, 0.0, 0.0), origin=(0.0, 0.0, 0.0))


def landmark_lines(eye, right_eye: bool) -> list:
    """Equator, ora serrata, macula and optic disc as lines on the wall, pyvista.PolyData each."""
    points = np.asarray(eye.points, float)
    direction = points / np.linalg.norm(points, axis=1, keepdims=True)
    pole, globe = np.array([0.0, 0.0, -1.0]), globe_radius(points)
    circles = [(pole, np.radians(EQUATOR)), (pole, np.radians(ORA)), (pole, MACULA_RADIUS / globe),
               (disc_direction(globe, right_eye), DISC_RADIUS / globe)]
    found = []
    for middle, radius in circles:
        surface = eye.copy(deep=False)
        surface.clear_data()
        surface.point_data["angle"] = np.arccos(np.clip(direction @ middle, -1.0, 1.0))
        found.append(surface.contour([radius], scalars="angle"))
    return found


def break_lines(eye, breaks: Iterable[Patch]) -> list:
    """Outlines of breaks as lines on the wall, pyvista.PolyData each."""
    import pyvista

    points, faces, found = np.asarray(eye.points, float), eye.regular_faces, []
    for one in breaks:
        corners, weights = interpolation(points, faces, one.outline())
        found.append(pyvista.lines_from_points(np.einsum("kc,kcx->kx", weights, points[corners])))
    return found


def optic_nerve(eye, right_eye: bool):
    """A piece of the optic nerve behind the disc; pyvista.PolyData."""
    import pyvista

    points = np.asarray(eye.points, float)
    out = disc_direction(globe_radius(points), right_eye)
    disc = points[(points @ out).argmax()]
    start, end = disc + 0.5 * SHELL_END * out, disc + (SHELL_END + NERVE_LENGTH) * out
    return pyvista.Cylinder(center=0.5 * (start + end), direction=out, radius=NERVE_RADIUS,
                            height=float(np.linalg.norm(end - start)), resolution=60).triangulate()
