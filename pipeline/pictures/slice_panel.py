"""A plane through the fields of the reconstruct stage on the pixels of a panel, drawn without OpenGL.

All has smooth edges, each pixel being painted by the share of it that is covered: so it is drawn at its final size.
Inside the cavity the colors are those of the liquids and nothing else; what lies around it is a scheme.
"""
import dataclasses

import numpy as np
from matplotlib import colormaps
from PIL import Image, ImageDraw
from scipy.ndimage import distance_transform_edt

from pipeline.pictures.anterior_segment import CHOROID_END, COATS, RETINA_END
from pipeline.pictures.marks import INK, OVERSAMPLING, enlarged, final_pixels, level_lines
from pipeline.pictures.paint import OF_OIL, Paint

# Droplets, by their share of the liquid on a logarithmic scale: below its lower end they are not seen. The scale ends
# before the colors of oil begin.
DROPLET_COLORS = (colormaps["magma"](np.linspace(0.35, 0.85, 256))[:, :3] * 255.0).round().astype(np.uint8)
DROPLET_RANGE = (1e-8, 1e-3)
DROPLET_TICKS = ("0.01", "0.1", "1", "10", "100", "1000")       # parts per million
SCLERA, CHOROID, RETINA, WALL = (226, 222, 216), (92, 44, 42), (217, 130, 107), (182, 156, 148)
KNOWN = 0.95                    # of the largest distance to the wall in a file
WALL_END = 0.7e-3               # m, of a user's mesh, whose wall is not known


@dataclasses.dataclass(frozen=True)
class Fields:
    """What the reconstruct stage found on a plane through the cavity.

    Attributes
    ----------
    signed_distance : (n, m) m, negative inside; rows go up along y, columns along the other axis.
    fraction : (n, m) of what is shown.
    dominance : fields (n, m) whose zeros are drawn as lines.
    origin : (2,) m, the first node; ``cell`` in m.
    droplets : (n, m) share of oil in droplets, which is drawn over the liquid around them, and not over the oil itself.
    """

    signed_distance: np.ndarray
    origin: np.ndarray
    cell: float
    fraction: np.ndarray | None = None
    dominance: tuple[np.ndarray, ...] = ()
    droplets: np.ndarray | None = None

    def reach(self) -> tuple[np.ndarray, np.ndarray]:
        """Ends (2,) of the cavity along rows and columns, m."""
        rows, columns = np.nonzero(self.signed_distance < 0.0)
        return tuple(self.origin[axis] + self.cell * np.array([places.min(), places.max()])
                     for axis, places in enumerate((rows, columns)))


class SlicePanel:
    """Draws a plane always at the same scale and place.

    Parameters
    ----------
    fields : of any frame, for the cavity alone.
    size : width and height of the panel in pixels of the large canvas.
    middle : (2,) pixels from left and top, where ``center`` (2,), m along rows and columns, is.
    scale : pixels per m.
    mirrored : whether the second axis points left.
    """

    def __init__(self, fields: Fields, size: tuple[int, int], *, middle, center, scale: float, mirrored: bool,
                 paint: Paint = OF_OIL):
        self.size, self.middle, self.center, self.scale, self.paint = size, middle, np.asarray(center), scale, paint
        self.sign = -1.0 if mirrored else 1.0
        columns, rows = final_pixels(size)
        self.rows = self.center[0] - (rows - middle[1]) / scale             # m
        self.columns = self.center[1] + self.sign * (columns - middle[0]) / scale
        self._rows = (self.rows - fields.origin[0]) / fields.cell           # nodes of the grid
        self._columns = (self.columns - fields.origin[1]) / fields.cell
        near = self.sample(fields.signed_distance)
        # Away from the wall files hold a constant, and the grid ends.
        known = near < KNOWN * fields.signed_distance.max()
        self.distance = np.where(known, near, (distance_transform_edt(near > 0.0) - 0.5) * OVERSAMPLING / scale)
        self.inside = self.cover(self.distance)
        self.background = np.full((len(rows), len(columns), 3), 255.0, np.float32)

    def pixel(self, first, second):
        """Place (x, y) on the panel of a point in m along rows and columns."""
        return (self.middle[0] + self.sign * (np.asarray(second) - self.center[1]) * self.scale,
                self.middle[1] - (np.asarray(first) - self.center[0]) * self.scale)

    def sample(self, values: np.ndarray) -> np.ndarray:
        """Bilinear values at the pixels; the nearest node beyond the border."""
        return _between(_between(np.asarray(values, np.float32), self._rows).T, self._columns).T

    def cover(self, level: np.ndarray) -> np.ndarray:
        """Share of every pixel where a level, about a distance in m, is negative: edges are smooth."""
        return np.clip(0.5 - level * (self.scale / OVERSAMPLING), 0.0, 1.0)

    def paint_over(self, share: np.ndarray, color) -> None:
        """Paint a share (height, width) of the background."""
        self.background += share[..., None] * (np.asarray(color, np.float32) - self.background)

    def paint_line(self, level: np.ndarray, width: float, color) -> None:
        """Paint the line where a level, about a distance in m, is 0; ``width`` in m."""
        self.paint_over(self.cover(np.abs(level) - 0.5 * width), color)

    def paint_coats(self, retina: np.ndarray | bool = True, front=RETINA, there: np.ndarray | float = 1.0) -> None:
        """Paint retina, choroid and sclera around the cavity, where they are ``there``.

        Where there is no ``retina``, the color ``front`` stands for what goes on before it.
        """
        for end, color in ((COATS, SCLERA), (CHOROID_END, CHOROID), (RETINA_END, RETINA)):
            self.paint_over(there * self.cover(self.distance - end), color)
        self.paint_over(np.where(retina, 0.0, there * self.cover(self.distance - CHOROID_END)), front)

    def paint_wall(self) -> None:
        """Paint a wall of which no more is known."""
        self.paint_over(self.cover(self.distance - WALL_END), WALL)

    def draw_liquids(self, fields: Fields) -> Image.Image:
        """Return the panel with the liquids of one frame, and lines between them."""
        colors = self.paint.of(self.sample(fields.fraction)).astype(np.float32)
        if fields.droplets is not None:
            colors = self._with_droplets(colors, fields)
        lines = self.strokes([self.pixel(*(line * fields.cell + fields.origin[:, None].T).T)
                              for level in fields.dominance for line in level_lines(level)],
                             max(3.0, 0.0042 * self.size[1]))
        colors += lines[..., None] * (np.array(INK, np.float32) - colors)
        pixels = self.background + self.inside[..., None] * (colors - self.background)
        return enlarged(pixels.round().astype(np.uint8), self.size)

    def strokes(self, lines, width: float) -> np.ndarray:
        """Share of every pixel under lines, pairs of x and y in pixels, of a width in pixels."""
        return self._drawn(lambda pen, points: pen.line(points, fill=255, width=max(1, round(OVERSAMPLING * width)),
                                                        joint="curve"), lines)

    def areas(self, outlines) -> np.ndarray:
        """Share of every pixel inside outlines, pairs of x and y in pixels."""
        return self._drawn(lambda pen, points: pen.polygon(points, fill=255), outlines)

    def _drawn(self, draw, lines) -> np.ndarray:
        height, width = self.inside.shape
        image = Image.new("L", (OVERSAMPLING**2 * width, OVERSAMPLING**2 * height), 0)
        pen = ImageDraw.Draw(image)
        for x, y in lines:
            draw(pen, list(zip((OVERSAMPLING * np.asarray(x)).tolist(), (OVERSAMPLING * np.asarray(y)).tolist(),
                               strict=True)))
        return np.asarray(image.reduce(OVERSAMPLING**2), np.float32) / 255.0

    def _with_droplets(self, colors: np.ndarray, fields: Fields) -> np.ndarray:
        low, high = np.log10(DROPLET_RANGE)
        level = (np.log10(np.maximum(self.sample(fields.droplets), 10.0**low)) - low) / (high - low)
        paint = DROPLET_COLORS[np.clip(level * 255.0 + 0.5, 0, 255).astype(np.uint8)]
        around = np.clip(2.0 - 2.0 * self.sample(fields.fraction), 0.0, 1.0)   # 0 in oil
        opacity = (around * np.clip(5.0 * level, 0.0, 1.0))[..., None]         # fades in over the first decade
        return (colors * (1.0 - opacity) + paint * opacity).round()


def _between(values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Rows (k, m) of ``values`` (n, m) at places (k,) between them, linearly; the first and the last go on."""
    places = np.clip(places, 0.0, len(values) - 1.0)
    lower = np.minimum(places.astype(int), len(values) - 2)
    part = (places - lower).astype(np.float32)[:, None]
    return (1.0 - part) * values[lower] + part * values[lower + 1]
