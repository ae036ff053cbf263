"""Right panel: the oil as a body in the open half shell of the eye (pyvista, off-screen).

Translucent surfaces are right only with depth peeling and without VTK's own antialiasing, which silently switches
peeling off; so the panel is drawn larger and averaged with the rest of the picture.
"""
import numpy as np

PEELS = 4
SHELL_COLOR, FREE_COLOR, TOUCH_COLOR = "#dfe5ec", "#ffe14d", "#d98200"
SHELL_START, SHELL_END = 0.15e-3, 0.6e-3        # m outside the wall: flat triangles of the liquid do not poke through
TOUCH_DEPTH = 0.1e-3            # m; nearer to the wall the surface counts as touching
# Camera: from the patient's left, in front and above; in units of the eye's size.
VIEW = np.array([1.0, 0.32, 0.55])


class EyeView:
    """One plotter for all frames; only the surfaces change.

    Parameters
    ----------
    eye : pyvista.PolyData, closed surface of the cavity in m.
    size : width and height in pixels of the large canvas.
    """

    def __init__(self, eye, size: tuple[int, int]):
        import pyvista

        self.plotter = pyvista.Plotter(off_screen=True, window_size=list(size), lighting="light kit")
        self.plotter.set_background("white")
        shell = half_shell(eye)
        self.plotter.add_mesh(shell, color=SHELL_COLOR, smooth_shading=True, split_sharp_edges=True, ambient=0.2,
                              specular=0.0)
        self._liquids = []
        self.plotter.enable_parallel_projection()
        center = np.array(eye.center)
        self.plotter.camera_position = [center + 4.0 * eye.length * VIEW, center, (0.0, 1.0, 0.0)]
        self.plotter.camera.parallel_scale = 0.60 * (eye.bounds[3] - eye.bounds[2])
        self.plotter.camera.clipping_range = (0.5 * eye.length, 12.0 * eye.length)
        peel(self.plotter)

    def draw(self, surfaces) -> np.ndarray:
        """Pixels (height, width, 3) with closed surfaces: pairs of pyvista.PolyData with ``depth``, and a color."""
        for actor in self._liquids:
            self.plotter.remove_actor(actor, render=False)
        self._liquids = []
        for surface, color in surfaces:
            if surface.n_cells:
                self._liquids += self._add(surface, color)
        self.plotter.render()
        return self.plotter.screenshot(None, return_img=True)[..., :3]

    def close(self) -> None:
        """Free the window."""
        self.plotter.close()

    def _add(self, surface, color: str) -> list:
        """Actors of one liquid: what touches the far wall is opaque, what hides the view into the eye is faint."""
        surface = surface.copy(deep=False)
        depth = surface.point_data["depth"].copy()
        surface.clear_data()
        surface.point_data["depth"] = depth
        surface = surface.compute_normals(cell_normals=False, split_vertices=True, feature_angle=50.0,
                                          auto_orient_normals=False, consistent_normals=False)
        touch, free = surface.clip_scalar(scalars="depth", value=TOUCH_DEPTH, both=True)
        near, far = touch.clip(normal="x", invert=False), touch.clip(normal="x")
        parts = ((far, TOUCH_COLOR, 1.0), (near, TOUCH_COLOR, 0.25), (free, color, 0.6))
        return [self.plotter.add_mesh(part, color=paint, opacity=opacity, smooth_shading=True, specular=0.0,
                                      ambient=0.2, reset_camera=False, render=False)
                for part, paint, opacity in parts if part.n_cells]


def peel(plotter) -> None:
    """Draw translucent surfaces in the order of depth."""
    plotter.enable_depth_peeling(PEELS, occlusion_ratio=0.0)
    plotter.disable_anti_aliasing()


def half_shell(eye):
    """The half of the wall on the patient's right (x < 0), with thickness and a flat cut rim; pyvista.PolyData."""
    closed = eye.compute_normals(cell_normals=False, auto_orient_normals=True, split_vertices=False)
    inner, outer = closed.copy(), closed.copy()
    inner.points = closed.points + SHELL_START * closed.point_data["Normals"]
    outer.points = closed.points + SHELL_END * closed.point_data["Normals"]
    wall = outer.append_polydata(inner.flip_faces())
    wall.clear_data()
    return wall.clip_closed_surface(normal=(-1.0, 0.0, 0.0), origin=(0.0, 0.0, 0.0))
