"""The liquids of a container as bodies in a glass box (pyvista, off-screen).

Translucent surfaces are right only with depth peeling and without VTK's own antialiasing, which silently switches
peeling off; so the panel is drawn larger and averaged with the rest of the picture.
"""
import numpy as np

from pipeline.pictures.opengl import off_screen

PEELS = 4
GLASS_COLOR, EDGE_COLOR = "#dfe5ec", "#5f6673"
OPACITY = 0.82
FUNNEL_OPACITY = 0.35
MARGIN = 1.08           # of the view, over the box
# Camera: in front, to the right and above; in units of the size of the container.
VIEW = np.array([0.55, 0.42, 1.0])


class ContainerView:
    """One plotter for all frames; only the surfaces change.

    Parameters
    ----------
    sides : (3,) sides of the container, m; its lower corner is the origin.
    size : width and height in pixels of the large canvas.
    funnels : solid funnels in the container.
    """

    def __init__(self, sides: np.ndarray, size: tuple[int, int], funnels=()):
        import pyvista

        self.plotter = off_screen(window_size=list(size), lighting="light kit")
        self.plotter.set_background("white")
        box = pyvista.Box(bounds=[value for side in sides for value in (0.0, side)])
        # The faces that the camera looks at from inside: floor, back and left.
        faces = [box.extract_cells([index]) for index in range(box.n_cells)]
        for face in faces:
            outward = np.array(face.center) - np.array(box.center)
            if outward @ VIEW < 0.0:
                self.plotter.add_mesh(face, color=GLASS_COLOR, ambient=0.6, specular=0.0)
        self.plotter.add_mesh(box.extract_feature_edges(30.0), color=EDGE_COLOR, line_width=max(2, size[1] // 300))
        for funnel in funnels:
            self.plotter.add_mesh(cone(funnel), color=EDGE_COLOR, opacity=FUNNEL_OPACITY, smooth_shading=True)
        self._liquids: list = []
        self.plotter.enable_parallel_projection()
        center, length = np.array(box.center), box.length
        self.plotter.camera_position = [center + 4.0 * length * VIEW, center, (0.0, 1.0, 0.0)]
        self.plotter.camera.parallel_scale = self._scale(np.array(sides), size)
        self.plotter.camera.clipping_range = (0.5 * length, 12.0 * length)
        peel(self.plotter)

    @staticmethod
    def extent(sides: np.ndarray) -> tuple[float, float]:
        """Width and height of the box as it is seen, m."""
        forward = -VIEW / np.linalg.norm(VIEW)
        right = np.cross(forward, [0.0, 1.0, 0.0])
        right /= np.linalg.norm(right)
        return float(np.abs(right) @ sides), float(np.abs(np.cross(right, forward)) @ sides)

    def _scale(self, sides: np.ndarray, size: tuple[int, int]) -> float:
        """Half the height of the view in m, such that the box fits with a margin."""
        width, height = self.extent(sides)
        return 0.5 * MARGIN * max(height, width * size[1] / size[0])

    def draw(self, surfaces) -> np.ndarray:
        """Pixels (height, width, 3) with closed surfaces: pairs of pyvista.PolyData and a color."""
        for actor in self._liquids:
            self.plotter.remove_actor(actor, render=False)
        self._liquids = []
        for surface, color in surfaces:
            if surface.n_cells:
                smooth = surface.compute_normals(cell_normals=False, split_vertices=True, feature_angle=50.0,
                                                 auto_orient_normals=False, consistent_normals=False)
                self._liquids.append(self.plotter.add_mesh(
                    smooth, color=color, opacity=OPACITY, smooth_shading=True, specular=0.15, ambient=0.2,
                    scalars=None, reset_camera=False, render=False))
        self.plotter.render()
        return self.plotter.screenshot(None, return_img=True)[..., :3]

    def close(self) -> None:
        """Free the window."""
        self.plotter.close()


def cone(funnel):
    """The middle of the wall of a funnel as pyvista.PolyData, m."""
    import pyvista

    angle = np.linspace(0.0, 2.0 * np.pi, 73)
    around = np.stack([np.cos(angle), np.zeros(73), np.sin(angle)], axis=1)
    rims = [funnel.center + radius * around + [0.0, height, 0.0]
            for radius, height in ((funnel.lower_radius, 0.0), (funnel.upper_radius, funnel.height))]
    first = np.arange(72)
    corners = np.stack([first, first + 1, first + 74, first + 73], axis=1)
    return pyvista.PolyData.from_regular_faces(np.concatenate(rims), corners)


def peel(plotter) -> None:
    """Draw translucent surfaces in the order of depth."""
    plotter.enable_depth_peeling(PEELS, occlusion_ratio=0.0)
    plotter.disable_anti_aliasing()
