"""Pictures of scenes with a container: the particles and outlines of the liquids, and in space their bodies beside."""
import numpy as np
from PIL import Image, ImageColor, ImageDraw

from pipeline.base.frame_files import FrameData
from pipeline.pictures.container_panel import ContainerPanel, legend, legend_width, length_in_words
from pipeline.pictures.marks import FAINT_INK, OVERSAMPLING, clock, header, pretty, reduce, write
from pipeline.surfaces.surface_files import lines_of

HEADER, FOOTER = 0.125, 0.08        # of the height
SLICE = 0.75                        # half thickness of a slice through space, in particle spacings


class ContainerRenderer:
    """Draws the frames of one scene with a container; made once, because the window is kept.

    Parameters
    ----------
    scene : resolved scene.
    view : anything but None asks for the bodies on the right, which needs OpenGL; never in two dimensions.
    """

    def __init__(self, scene, view=None):
        self.scene = scene
        self.size = tuple(OVERSAMPLING * length for length in scene.output.image_size)
        width, height = self.size
        self.top, self.bottom = round(HEADER * height), round((1.0 - FOOTER) * height)
        with_bodies = view is not None and scene.dimension == 3
        self.split = width // 2 if with_bodies else width
        self.colors = [ImageColor.getrgb(liquid.color) for liquid in scene.liquids]
        self.sides = np.array(scene.container.size)
        self.panel = ContainerPanel(tuple(self.sides[:2]), (self.split, self.bottom - self.top))
        self.view = None
        if with_bodies:
            from pipeline.pictures.container_view import ContainerView

            self.view = ContainerView(self.sides, (width - self.split, self.bottom - self.top),
                                      scene.container.funnels)

    def picture(self, frame: FrameData, surfaces) -> Image.Image:
        """Picture of one frame; ``surfaces`` is a dict liquid -> pyvista.PolyData."""
        canvas = Image.new("RGB", self.size, (255, 255, 255))
        canvas.paste(self._front(frame, surfaces), (0, self.top))
        if self.view is not None:
            bodies = self.view.draw([(surfaces[liquid.name], liquid.color) for liquid in self.scene.liquids])
            canvas.paste(Image.fromarray(np.ascontiguousarray(bodies)), (self.split, self.top))
        self._texts(ImageDraw.Draw(canvas), frame)
        return reduce(canvas)

    def close(self) -> None:
        """Free the window."""
        if self.view is not None:
            self.view.close()

    def _front(self, frame: FrameData, surfaces) -> Image.Image:
        shown = np.ones(len(frame.position), bool)
        if frame.dimension == 3:
            shown = np.abs(frame.position[:, 2] - 0.5 * self.sides[2]) < SLICE * frame.particle_spacing
        color = np.asarray(frame.volume_fraction)[shown] @ np.array(self.colors, float)
        diameter = np.asarray(frame.volume)[shown] ** (1.0 / frame.dimension)
        outlines = [(line, color) for liquid, color in zip(frame.liquids, self.colors, strict=True)
                    for line in self._outlines(surfaces[liquid])]
        return self.panel.draw(frame.position[shown, :2], color.round(), diameter, outlines, frame.gravity[:2])

    def _outlines(self, surface) -> list[np.ndarray]:
        """Lines (k, 2) in m of a liquid in the plane of the panel."""
        if not surface.n_points:
            return []
        if self.scene.dimension == 3:
            surface = surface.slice(normal="z", origin=(0.0, 0.0, 0.5 * self.sides[2])).strip()
        return [line[:, :2] for line in lines_of(surface)]

    def _texts(self, draw: ImageDraw.ImageDraw, frame: FrameData) -> None:
        width, height = self.size
        u = height / 100.0
        name = self.scene.numerics.scheme
        scheme = name.upper() if name.endswith("sph") else pretty(name)
        header(draw, self.size, title=self.scene.title or self.scene.name, label=self.scene.label,
               time=clock(frame.time, self.scene.output.second_means),
               subtitle=f"{scheme}, {len(frame.position):,} particles, {length_in_words(frame.particle_spacing)} apart")
        if frame.dimension == 3:
            write(draw, (2.0 * u, self.top), "slice through the middle", 2.3 * u, color=FAINT_INK)
        entries = [(color, f"{pretty(liquid.name)}, {liquid.density:g} kg/m³")
                   for color, liquid in zip(self.colors, self.scene.liquids, strict=True)]
        legend(draw, entries, 0.5 * (width - legend_width(entries, u)), height - 0.5 * FOOTER * height, u)
