"""The eye opened along its sagittal plane, both halves side by side in space (pyvista, off-screen).

Every half shows its wall, painted by what touches it, and the interface of the oil inside it, both opaque: nothing that
lies in one half is seen in the other, and no color mixes with another. What is around the cavity is drawn once: it
hides the same pixels in every frame.
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
NOTHING = (255, 0, 255)         # where nothing is around the cavity: a color that is nowhere in it
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
        self.plotter.disable_anti_aliasing()    # the large canvas is averaged; samples would double the time
        self._changing: dict[tuple[int, str], Any] = {}
        center = np.array(eye.center)
        landmarks: list[tuple[Any, Any, float]] = [(line, EDGE_COLOR, size[1] / 600)
                                                   for line in landmark_lines(eye, right_eye)]
        landmarks += [(line, BREAK_COLOR, size[1] / 180) for line in break_lines(eye, breaks)]
        for row, half in enumerate(HALVES):
            self.plotter.subplot(row, 0)
            self.plotter.enable_parallel_projection()
            self.plotter.camera_position = [center + 4.0 * eye.length * view_of(half), center, (0.0, 1.0, 0.0)]
            self.plotter.camera.parallel_scale = 0.58 * (eye.bounds[3] - eye.bounds[2])
            self.plotter.camera.clipping_range = (0.5 * eye.length, 12.0 * eye.length)
        surroundings = self._draw_surroundings(eye, optic_nerve(eye, right_eye)).reshape(-1, 3)
        self._around = np.flatnonzero((surroundings != NOTHING).any(axis=-1))
        self._surroundings = surroundings[self._around]
        for row, side in enumerate(HALVES.values()):
            self.plotter.subplot(row, 0)
            for line, color, width in landmarks:
                shown = lifted(line).clip((side, 0.0, 0.0), origin=(0.0, 0.0, 0.0))
                if shown.n_cells:
                    self._add(shown, **line_look(color, width))

    def draw(self, wall, surfaces: Iterable) -> np.ndarray:
        """Pixels (height, width, 3) of one frame.

        Parameters
        ----------
        wall : pyvista.PolyData of the reconstruct stage.
        surfaces : pairs of a closed surface with ``depth``, pyvista.PolyData, and a color.
        """
        interfaces = [(free_part(surface), color) for surface, color in surfaces]
        for row, side in enumerate(HALVES.values()):
            half = half_of(wall, side)
            self._show(row, "wall", painted(half, self.paint), scalars="color", rgb=True, ambient=0.65, diffuse=0.4)
            for number, (interface, color) in enumerate(interfaces):
                self._show(row, f"interface {number}", half_of(interface, side), color=color, smooth_shading=True,
                           ambient=0.45, diffuse=0.55, specular=0.25, specular_power=20.0)
            self._show(row, "edge", lifted(half.contour([0.0], scalars="contact_distance")),
                       **line_look(EDGE_COLOR, self.size[1] / 250))
        pixels = np.ascontiguousarray(self._pixels())
        pixels.reshape(-1, 3)[self._around] = self._surroundings
        return pixels

    def close(self) -> None:
        """Free the window."""
        self.plotter.close()

    def _draw_surroundings(self, eye, nerve) -> np.ndarray:
        """Pixels (height, width, 3) of what is around the cavity, where it is in front of the wall or beside it."""
        self.plotter.set_background(NOTHING, all_renderers=True)
        for row, side in enumerate(HALVES.values()):
            self.plotter.subplot(row, 0)
            self._add(half_shell(eye, side), color=SHELL_COLOR, smooth_shading=True, split_sharp_edges=True,
                      ambient=0.2, specular=0.0)
            if nerve.center[0] * side < 0.0:
                self._add(nerve, color=NERVE_COLOR, smooth_shading=True, split_sharp_edges=True, ambient=0.3,
                          specular=0.0)
            self._add(half_of(eye, side), color=NOTHING, lighting=False)
        pixels = self._pixels()
        for renderer in self.plotter.renderers:
            for actor in list(renderer.actors.values()):
                renderer.remove_actor(actor, render=False)
        self.plotter.set_background("white", all_renderers=True)
        return pixels

    def _pixels(self) -> np.ndarray:
        self.plotter.render()
        return self.plotter.screenshot(None, return_img=True)[..., :3]

    def _add(self, mesh, **look):
        return self.plotter.add_mesh(mesh, reset_camera=False, render=False, **look)

    def _show(self, row: int, name: str, mesh, **look) -> None:
        """Show a mesh in a half, in place of what had this name in the frame before."""
        actor = self._changing.get((row, name))
        if actor is not None:
            actor.mapper.dataset = mesh
            actor.visibility = mesh.n_cells > 0
        elif mesh.n_cells:
            self.plotter.subplot(row, 0)
            self._changing[row, name] = self._add(mesh, **look)


def painted(wall, paint: Paint):
    """A part of the wall of the reconstruct stage with the ``color`` of what touches it; pyvista.PolyData."""
    covered, bare = split(wall, "contact_distance")
    parts = [(bare, paint.of(wall_fractions(bare, False)))]
    if covered.n_cells and film_distance(wall) is not None:
        film, covered = split(covered, "film_distance")
        parts.append((film, np.tile(paint.film, (film.n_points, 1))))
    parts.append((covered, paint.of(wall_fractions(covered, True))))
    parts = [(part, colors) for part, colors in parts if part.n_cells]
    for part, colors in parts:
        part.clear_data()
        part.point_data["color"] = colors
    first, *others = (part for part, _ in parts)
    return first.append_polydata(*others) if others else first


def lifted(line):
    """Lines on the wall, so much nearer to the center that the wall does not hide them; pyvista.PolyData."""
    line = line.copy(deep=False)
    line.points = np.asarray(line.points) * LINE_LIFT
    return line


def line_look(color, width: float) -> dict[str, Any]:
    """How a line of a width in pixels is drawn."""
    return {"color": color, "line_width": max(1.0, width), "lighting": False}


def view_of(half: str) -> np.ndarray:
    """Direction (3,) to the camera of a half."""
    return VIEW * [HALVES[half], 1.0, 1.0]


def screen_axes(half: str) -> np.ndarray:
    """Unit vectors (3, 3) to the right, up and toward the reader in the picture of a half."""
    toward = view_of(half) / np.linalg.norm(VIEW)
    right = np.cross([0.0, 1.0, 0.0], toward)
    right /= np.linalg.norm(right)
    return np.stack([right, np.cross(toward, right), toward])


def split(mesh, name: str) -> tuple[Any, Any]:
    """Parts of a surface where a field at its points is positive, and where it is not, pyvista.PolyData."""
    import pyvista
    from vtkmodules.vtkFiltersCore import vtkClipPolyData

    mesh = mesh.copy(deep=False)
    mesh.set_active_scalars(name)   # which the filter takes, whatever array it is told to process
    clipper = vtkClipPolyData()     # PyVista's takes twice as long
    clipper.SetInputData(mesh)
    clipper.GenerateClippedOutputOn()
    clipper.Update()
    return pyvista.wrap(clipper.GetOutput()), pyvista.wrap(clipper.GetClippedOutput())


def half_of(mesh, side: float):
    """The half of a surface away from ``side`` along x, pyvista.PolyData."""
    import pyvista
    from vtkmodules.vtkCommonDataModel import vtkPlane
    from vtkmodules.vtkFiltersCore import vtkPolyDataPlaneClipper

    plane, clipper = vtkPlane(), vtkPolyDataPlaneClipper()
    plane.SetNormal(-side, 0.0, 0.0)
    clipper.SetInputData(mesh)
    clipper.SetPlane(plane)
    clipper.CappingOff()
    clipper.Update()
    return pyvista.wrap(clipper.GetOutput())


def free_part(surface):
    """The part of a closed surface with ``depth`` that is away from the wall, with normals."""
    if not surface.n_cells:
        return surface
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
