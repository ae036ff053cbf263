"""Left panel: the section through the optic axis, drawn from the fields of the reconstruct stage without OpenGL.

Seen from the patient's left: superior is up, anterior is left. Inside the cavity the colors are the volume fraction and
nothing else; what lies around it (wall, lens, cornea, iris) is a scheme for orientation.
"""
import dataclasses

import numpy as np
from matplotlib import colormaps
from PIL import Image, ImageDraw
from skimage.measure import find_contours

from pipeline.pictures.marks import FAINT_INK, INK, diamond, gravity_mark, write
from pipeline.pictures.paint import colors_of
from pipeline.scenes.eye_shape import CORNEA_TO_GLOBE, shape_of
from pipeline.scenes.model import Eye as SceneEye

# Droplets, by their share of the liquid on a logarithmic scale: below its lower end they are not seen.
DROPLET_COLORS = (colormaps["magma"](np.linspace(0.35, 1.0, 256))[:, :3] * 255.0).round().astype(np.uint8)
DROPLET_RANGE = (1e-8, 1e-3)
DROPLET_TICKS = ("0.01", "0.1", "1", "10", "100", "1000")       # parts per million
PAPER = (255, 255, 255)
WALL = (214, 190, 184)
LENS = (233, 238, 243)
CHAMBER = (243, 248, 252)
IRIS = (140, 104, 80)
CILIARY = (191, 152, 130)
CORNEA = (198, 211, 222)
WALL_THICKNESS = 0.7e-3         # drawn, m
SCALE_BAR = 5e-3
# Anterior segment, Gullstrand's eye (scheme only, in front of the cavity): m.
CORNEA_RADIUS, CORNEA_THICKNESS = 7.8e-3, 0.55e-3
LENS_FRONT_RADIUS, LENS_BACK_RADIUS, LENS_THICKNESS = 10e-3, 6e-3, 3.6e-3
LENS_EDGE, CILIARY_GAP, MEMBRANE = 4.5e-3, 0.8e-3, 0.25e-3     # zonular fibers span the gap
ANGLE_RADIUS, ANGLE_SLOPE = 6.0e-3, 0.35        # where the iris meets the wall, and how the wall narrows from there
PUPIL_RADIUS, IRIS_THICKNESS = 2.0e-3, 0.4e-3


@dataclasses.dataclass(frozen=True)
class Eye:
    """What the scheme around the cavity needs.

    Attributes
    ----------
    axial_length : m, None for a user's mesh.
    globe : half axes along y and z, m, of a globe with a buckle or a staphyloma, which its outline does not tell.
    iris : z of the iris, m, where the liquids fill the anterior chamber too.
    """

    axial_length: float | None
    lens: str
    globe: tuple[float, float] | None = None
    iris: float | None = None


def scheme_of(eye: SceneEye) -> Eye:
    """Return what the scheme around the cavity of a scene's eye needs."""
    if eye.model != "parametric":
        return Eye(None, eye.lens)
    shape = shape_of(eye)
    globe = (float(shape.half_axes[1]), float(shape.half_axes[2])) if shape.altered else None
    return Eye(eye.axial_length, eye.lens, globe, shape.front if eye.anterior_chamber else None)


class SectionPanel:
    """Draws sections of one scene, always at the same scale and place.

    Parameters
    ----------
    signed_distance : (ny, nz) m, negative inside; ``origin`` (y, z) and ``cell`` in m.
    size : width and height of the panel in pixels of the large canvas.
    """

    def __init__(self, signed_distance: np.ndarray, origin: np.ndarray, cell: float, eye: Eye, size: tuple[int, int]):
        self.size, self.unit = size, size[1] / 100.0
        self.origin, self.cell = np.asarray(origin, float), cell
        y, z = self._extent(signed_distance, eye)
        side, above = 5.0 * self.unit, 16.0 * self.unit
        self.scale = min((size[0] - 2 * side) / np.ptp(z), (size[1] - 2 * above) / np.ptp(y))
        self.center = np.array([y.mean(), z.mean()])
        # Places of the rows and columns of pixels, in nodes of the grid.
        columns, rows = (np.arange(length) + 0.5 for length in size)
        self._rows = ((self.center[0] - (rows - size[1] / 2) / self.scale) - self.origin[0]) / cell
        self._columns = ((self.center[1] - (columns - size[0] / 2) / self.scale) - self.origin[1]) / cell
        distance = self._sample(signed_distance)
        self.inside = distance < 0.0
        self.background = self._scheme(distance, signed_distance, eye)

    def pixel(self, y, z):
        """Place (x, y) on the panel of a point in m."""
        return (self.size[0] / 2 - (np.asarray(z) - self.center[1]) * self.scale,
                self.size[1] / 2 - (np.asarray(y) - self.center[0]) * self.scale)

    def draw(self, fraction: np.ndarray, dominance: list[np.ndarray], gravity: np.ndarray,
             droplets: np.ndarray | None = None, marks=()) -> Image.Image:
        """Panel of one frame: ``fraction`` (ny, nz) of what is shown, black lines where a ``dominance`` is zero.

        ``droplets`` (ny, nz) is the share of oil in droplets, which is drawn over the liquid around them; ``marks`` are
        pairs of a color and a point (3,) in m, shown where it lies in, before or behind the section.
        """
        colors = colors_of(self._sample(fraction))
        if droplets is not None:
            colors = self._with_droplets(colors, droplets)
        pixels = np.where(self.inside[..., None], colors, self.background)
        image = Image.fromarray(pixels)
        lines = Image.new("L", self.size, 0)
        pen = ImageDraw.Draw(lines)
        for level in dominance:
            for line in find_contours(level, 0.0):
                x, y = self.pixel(*(line * self.cell + self.origin).T)
                pen.line(list(zip(x.tolist(), y.tolist(), strict=True)), fill=255,
                         width=max(2, round(0.55 * self.unit)), joint="curve")
        image.paste((0, 0, 0), mask=Image.fromarray(np.where(self.inside, np.asarray(lines), 0).astype(np.uint8)))
        pen = ImageDraw.Draw(image)
        self._marks(pen, gravity)
        for color, (_, y, z) in marks:
            diamond(pen, self.pixel(y, z), 1.5 * self.unit, color)
        return image

    def _with_droplets(self, colors: np.ndarray, droplets: np.ndarray) -> np.ndarray:
        low, high = np.log10(DROPLET_RANGE)
        level = (np.log10(np.maximum(self._sample(droplets), 10.0**low)) - low) / (high - low)
        paint = DROPLET_COLORS[np.clip(level * 255.0 + 0.5, 0, 255).astype(np.uint8)]
        opacity = np.clip(5.0 * level, 0.0, 1.0)[..., None]     # fades in over the first decade
        return (colors * (1.0 - opacity) + paint * opacity).round().astype(np.uint8)

    def _sample(self, values: np.ndarray) -> np.ndarray:
        """Bilinear values at the pixels; the nearest node beyond the border."""
        return _between(_between(np.asarray(values, np.float32), self._rows).T, self._columns).T

    def _extent(self, distance: np.ndarray, eye: Eye) -> tuple[np.ndarray, np.ndarray]:
        rows, columns = np.nonzero(distance < 0.0)
        y = self.origin[0] + self.cell * np.array([rows.min(), rows.max()])
        z = self.origin[1] + self.cell * np.array([columns.min(), columns.max()])
        if eye.axial_length:
            z[1] = z[0] + eye.axial_length if eye.globe is None else eye.globe[1] + CORNEA_TO_GLOBE
        return y, z

    def _scheme(self, distance: np.ndarray, field: np.ndarray, eye: Eye) -> np.ndarray:
        """Colors of everything outside the cavity, (height, width, 3)."""
        pixels = np.full((*distance.shape, 3), PAPER, np.uint8)
        if eye.axial_length is None:
            pixels[distance < WALL_THICKNESS] = WALL
            self.lens_center = None
            return pixels
        y, z = np.meshgrid(self.origin[0] + self._rows * self.cell, self.origin[1] + self._columns * self.cell,
                           indexing="ij")
        (_, top), (back, apex) = self._extent(field, eye)
        if eye.globe is not None:
            top, back = eye.globe[0], -eye.globe[1]
        on_axis = np.nonzero(field[round(-self.origin[0] / self.cell)] < 0.0)[0]
        lens_back = self.origin[1] + self.cell * on_axis.max() if eye.iris is None else eye.iris
        if eye.lens == "phakic":
            lens_front = lens_back + LENS_THICKNESS
            lens = (np.hypot(y, z - (lens_back + LENS_BACK_RADIUS)) < LENS_BACK_RADIUS) & \
                (np.hypot(y, z - (lens_front - LENS_FRONT_RADIUS)) < LENS_FRONT_RADIUS)
            iris_back = lens_front - 0.3e-3
        else:
            lens = np.zeros_like(self.inside)
            if eye.lens == "pseudophakic":
                lens = (np.abs(z - lens_back - 0.5e-3) < 0.35e-3) & (np.abs(y) < 3e-3)
            lens_front, iris_back = lens_back + 0.5e-3, lens_back + 0.5e-3

        def within(margin):
            return (y / (top + margin)) ** 2 + (z / (-back + margin)) ** 2 < 1.0

        # Sclera and cornea meet at the limbus, where the globe leaves the sphere of the cornea.
        outer = np.hypot(y, z - (apex - CORNEA_RADIUS))
        limbus = z[within(WALL_THICKNESS) & (outer > CORNEA_RADIUS) & (z > 0.0)].max(initial=iris_back)
        cornea = (z > limbus - CORNEA_THICKNESS) & (outer < CORNEA_RADIUS) & \
            (outer > CORNEA_RADIUS - CORNEA_THICKNESS)
        sclera = within(WALL_THICKNESS) & ~within(0.0) & (outer > CORNEA_RADIUS - CORNEA_THICKNESS) & (distance > 0.0)
        sclera |= within(0.0) & (z > iris_back) & (np.abs(y) > ANGLE_RADIUS - ANGLE_SLOPE * (z - iris_back)) & \
            (outer > CORNEA_RADIUS - CORNEA_THICKNESS)
        front = within(0.0) & (distance > 0.0)
        chamber = (front | (outer < CORNEA_RADIUS - CORNEA_THICKNESS)) & (z > lens_back - 1e-3) & (distance > 0.0)
        ciliary = front & (z < iris_back) & (np.abs(y) > LENS_EDGE + CILIARY_GAP) & (distance > 0.0)
        ciliary |= front & (distance < MEMBRANE) & (np.abs(y) > LENS_EDGE)
        iris = (np.abs(z - iris_back) < IRIS_THICKNESS / 2) & (np.abs(y) > PUPIL_RADIUS) & front
        ring = (distance < WALL_THICKNESS) & ~within(0.0) & (z < iris_back)
        if eye.globe is not None:   # what a buckle presses in, and what is left beside a bulge
            ring |= (distance > 0.0) & within(WALL_THICKNESS) & (z < min(lens_back, iris_back))
        if eye.iris is not None:
            iris = (distance > 0.0) & within(0.0) & (outer < CORNEA_RADIUS - CORNEA_THICKNESS)
        for region, color in ((chamber, CHAMBER), (sclera | ring, WALL), (cornea, CORNEA), (ciliary, CILIARY),
                              (lens, LENS), (iris, IRIS)):
            pixels[region] = color
        edge = lens & ~_eroded(lens, max(1, round(0.2 * self.unit)))
        pixels[edge] = FAINT_INK
        # The name of the thin artificial lens stands in front of it.
        self.lens_center = {"phakic": (0.0, 0.5 * (lens_back + lens_front)), "pseudophakic": (0.0, lens_back + 2.6e-3)
                            }.get(eye.lens)
        return pixels

    def _marks(self, draw: ImageDraw.ImageDraw, gravity: np.ndarray) -> None:
        u, (width, height) = self.unit, self.size
        text = 2.6 * u
        rows, columns = np.nonzero(self.inside)
        middle, top, bottom = columns.mean(), rows.min() - 4.5 * u, rows.max() + 4.5 * u
        write(draw, (middle, top), "superior", text, color=FAINT_INK, anchor="ms")
        write(draw, (middle, bottom), "inferior", text, color=FAINT_INK, anchor="ma")
        write(draw, (2.0 * u, bottom), "anterior", text, color=FAINT_INK, anchor="la")
        write(draw, (width - 2.0 * u, bottom), "posterior", text, color=FAINT_INK, anchor="ra")
        if self.lens_center:
            x, y = self.pixel(*self.lens_center)
            write(draw, (x, y), "lens", 0.85 * text, color=FAINT_INK, anchor="mm")
        length = SCALE_BAR * self.scale
        left, base = 3.0 * u, height - 4.0 * u
        draw.rectangle([left, base, left + length, base + 0.9 * u], fill=INK)
        write(draw, (left + length / 2, base - 0.8 * u), "5 mm", text, anchor="md")
        self._gravity(draw, gravity)

    def _gravity(self, draw: ImageDraw.ImageDraw, gravity: np.ndarray) -> None:
        u, (width, _) = self.unit, self.size
        center = np.array([width - 8.0 * u, 6.5 * u])
        strength = np.linalg.norm(gravity)
        caption = "gravity" if strength > 1e-6 else "no gravity"
        edge = width - 2.0 * u
        write(draw, (edge, center[1] + 6.2 * u), caption, 2.6 * u, anchor="ra")
        write(draw, (edge, center[1] + 9.4 * u), posture(gravity), 2.6 * u, bold=True, anchor="ra")
        if strength < 1e-6:
            return
        x, y, z = np.asarray(gravity, float) / strength
        gravity_mark(draw, center, 5.0 * u, -z, y, x)


def posture(gravity: np.ndarray) -> str:
    """Posture of the patient from the direction of gravity in the eye: the axis it is within 20 degrees of."""
    strength = np.linalg.norm(gravity)
    if strength < 1e-6:
        return ""
    names = {"upright": (0, -1, 0), "supine": (0, 0, -1), "prone": (0, 0, 1), "lying on the left side": (1, 0, 0),
             "lying on the right side": (-1, 0, 0), "head down": (0, 1, 0)}
    best = max(names, key=lambda name: float(np.dot(names[name], gravity)))
    return best if np.dot(names[best], gravity) / strength > np.cos(np.deg2rad(20.0)) else "between postures"


def _between(values: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Rows (k, m) of ``values`` (n, m) at places (k,) between them, linearly; the first and the last go on."""
    places = np.clip(places, 0.0, len(values) - 1.0)
    lower = np.minimum(places.astype(int), len(values) - 2)
    part = (places - lower).astype(np.float32)[:, None]
    return (1.0 - part) * values[lower] + part * values[lower + 1]


def _eroded(mask: np.ndarray, steps: int) -> np.ndarray:
    from scipy.ndimage import binary_erosion

    return binary_erosion(mask, iterations=steps)
