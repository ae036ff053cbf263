"""Particles in a container, seen from the front, drawn without OpenGL: all of a plane, or a slice of space."""
import numpy as np
from PIL import Image, ImageDraw

from pipeline.pictures.marks import FAINT_INK, INK, arrow, font, write
from pipeline.surfaces.contour_lines import signed_area

PAPER = (255, 255, 255)
INSIDE = (247, 249, 251)
WALL = (196, 203, 212)
STEPS = (1.0, 2.0, 5.0)
FILL_TINT, LINE_SHADE = 0.55, 0.45      # of the color of a liquid: behind its particles, and for its outline


class ContainerPanel:
    """Draws one container, always at the same scale and place.

    Parameters
    ----------
    sides : width and height of the container, m; its lower left corner is the origin.
    size : width and height of the panel in pixels of the large canvas.
    """

    def __init__(self, sides: tuple[float, float], size: tuple[int, int]):
        self.size, self.unit = size, size[1] / 100.0
        self.sides = np.array(sides, float)
        margin = np.array([17.0, 5.0]) * self.unit
        self.scale = float(((np.array(size) - 2.0 * margin) / self.sides).min())
        self.corner = 0.5 * np.array(size) + 0.5 * self.scale * self.sides * [-1.0, 1.0]    # pixel of the origin

    def pixels(self, points: np.ndarray) -> np.ndarray:
        """Places (n, 2) on the panel of points (n, 2) in m."""
        return self.corner + self.scale * np.asarray(points, float) * [1.0, -1.0]

    def draw(self, position: np.ndarray, color: np.ndarray, diameter: np.ndarray, outlines, gravity) -> Image.Image:
        """Panel of one frame.

        Parameters
        ----------
        position, color, diameter : (n, 2) m, (n, 3) in 0..255, (n,) m, of the particles.
        outlines : pairs of closed lines (k, 2) in m, clockwise around holes, and the color of the liquid.
        gravity : (2,) in the plane of the panel, m/s2.
        """
        image = Image.new("RGB", self.size, PAPER)
        draw = ImageDraw.Draw(image)
        self._walls(draw)
        # The largest first, so that what lies in a hole is drawn over it.
        areas = [signed_area(line - line[0]) for line, _ in outlines]
        for index in sorted(range(len(areas)), key=lambda index: -abs(areas[index])):
            line, paint = outlines[index]
            draw.polygon(self._path(line), fill=tint(paint) if areas[index] > 0.0 else INSIDE)
        radius = np.maximum(0.5 * self.scale * diameter, 0.5)[:, None]
        center = self.pixels(position)
        boxes = np.concatenate([center - radius, center + radius], axis=1).round(2).tolist()
        for box, fill in zip(boxes, map(tuple, np.asarray(color, int).tolist()), strict=True):
            draw.ellipse(box, fill=fill)
        width = max(2, round(0.32 * self.unit))
        for line, paint in outlines:
            draw.line(self._path(line), fill=shade(paint), width=width, joint="curve")
        self._scale_bar(draw)
        self._gravity(draw, np.asarray(gravity, float))
        return image

    def _path(self, line: np.ndarray) -> list[tuple[float, float]]:
        return [tuple(point) for point in self.pixels(line).tolist()]

    def _walls(self, draw: ImageDraw.ImageDraw) -> None:
        (left, bottom), (right, top) = self.pixels(np.zeros(2)), self.pixels(self.sides)
        wall = 1.1 * self.unit
        draw.rectangle([left - wall, top - wall, right + wall, bottom + wall], fill=WALL)
        draw.rectangle([left, top, right, bottom], fill=INSIDE)

    def _scale_bar(self, draw: ImageDraw.ImageDraw) -> None:
        u = self.unit
        length = round_length(11.0 * u / self.scale)
        left, base = 3.0 * u, self.size[1] - 6.0 * u
        draw.rectangle([left, base, left + length * self.scale, base + 0.9 * u], fill=INK)
        write(draw, (left + 0.5 * length * self.scale, base - 0.8 * u), length_in_words(length), 2.9 * u, anchor="md")

    def _gravity(self, draw: ImageDraw.ImageDraw, gravity: np.ndarray) -> None:
        u, strength = self.unit, np.linalg.norm(gravity)
        center = np.array([self.size[0] - 8.0 * u, 11.0 * u])
        write(draw, (center[0], center[1] + 6.6 * u), "gravity" if strength > 1e-6 else "no gravity", 2.9 * u,
              anchor="ma")
        if strength > 1e-6:
            half = 5.0 * u * gravity / strength * [1.0, -1.0]
            arrow(draw, center - half, center + half, 1.1 * u)


def legend(draw: ImageDraw.ImageDraw, entries, left: float, middle: float, u: float) -> None:
    """Write a row of discs and names, pairs of a color and a text, from ``left`` on; ``u`` is 1 % of the height."""
    for color, text in entries:
        draw.ellipse([left, middle - 1.2 * u, left + 2.4 * u, middle + 1.2 * u], fill=color, outline=FAINT_INK)
        left += 7.0 * u + write(draw, (left + 3.4 * u, middle), text, 2.8 * u, anchor="lm")


def legend_width(entries, u: float) -> float:
    """Width that ``legend`` takes."""
    return sum(7.0 * u + font(int(2.8 * u)).getlength(text) for _, text in entries) - 3.6 * u


def round_length(most: float) -> float:
    """Largest of 1, 2, 5 times a power of ten that is at most ``most``."""
    power = 10.0 ** np.floor(np.log10(most))
    return float(max(step for step in STEPS if step * power <= most * (1.0 + 1e-9)) * power)


def length_in_words(length: float) -> str:
    """Length in m as m, cm or mm."""
    if length >= 0.995:
        return f"{length:g} m"
    return f"{100.0 * length:.3g} cm" if length >= 0.00995 else f"{1000.0 * length:.3g} mm"


def shade(color: tuple[int, ...]) -> tuple[int, ...]:
    """A darker color for outlines."""
    return tuple(round(LINE_SHADE * part) for part in color)


def tint(color: tuple[int, ...]) -> tuple[int, ...]:
    """A lighter color to lie behind particles."""
    return tuple(round(255 - FILL_TINT * (255 - part)) for part in color)
