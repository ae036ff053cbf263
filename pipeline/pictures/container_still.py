"""A still of a container: its liquids as bodies in a glass box, with a legend."""
import numpy as np
from PIL import Image, ImageColor, ImageDraw

from pipeline.base.frame_files import FrameData
from pipeline.pictures.container_panel import legend, legend_width
from pipeline.pictures.container_view import ContainerView
from pipeline.pictures.marks import OVERSAMPLING, clock, header, pretty, reduce

HEADER, FOOTER = 0.09, 0.08     # of the height


def container_still(scene, frame: FrameData, surfaces: dict, size: tuple[int, int]) -> Image.Image:
    """Picture of one frame of a scene with a container in space; ``surfaces`` is a dict liquid -> pyvista.PolyData."""
    width, height = (OVERSAMPLING * length for length in size)
    canvas = Image.new("RGB", (width, height), (255, 255, 255))
    top, bottom = round(HEADER * height), round((1.0 - FOOTER) * height)
    view = ContainerView(np.array(scene.container.size), (width, bottom - top), scene.container.funnels)
    bodies = view.draw([(surfaces[liquid.name], liquid.color) for liquid in scene.liquids])
    view.close()
    canvas.paste(Image.fromarray(np.ascontiguousarray(bodies)), (0, top))
    draw, u = ImageDraw.Draw(canvas), height / 100.0
    header(draw, (width, height), title=scene.title or scene.name, subtitle="", label=scene.label,
           time=clock(frame.time, scene.output.second_means))
    entries = [(ImageColor.getrgb(one.color), pretty(one.name)) for one in scene.liquids]
    legend(draw, entries, 0.5 * (width - legend_width(entries, u)), height - 0.5 * FOOTER * height, u)
    return reduce(canvas)
