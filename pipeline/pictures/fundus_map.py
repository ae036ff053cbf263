"""Map of the fundus: which part of the retina the oil touches, drawn as vitreoretinal surgeons draw.

As in the charts of Amsler and Dubois [straatsma1969, chapter] the macula is in the middle, circles are the equator, the
ora serrata and the front edge of the pars plana, and the clock hours are those that an examiner sees who faces the
patient. The distance from the middle is the angle from the posterior pole, seen from the center of the globe.
Colors are painted at the final size, each by the share of a pixel that it covers; lines and words are drawn over them
on the large canvas.
Equations: docs/methods/pictures.md.
"""
import dataclasses
import itertools
import math
from collections.abc import Mapping

import numpy as np
from PIL import Image, ImageDraw
from scipy.sparse import csr_matrix
from scipy.spatial import Delaunay

from pipeline.base.numbers import digits_of, plain, with_uncertainty
from pipeline.cavity.regions import MACULA_RADIUS
from pipeline.pictures.marks import (
    FAINT_INK,
    INK,
    OVERSAMPLING,
    diamond,
    enlarged,
    final_pixels,
    font,
    level_lines,
    write,
)
from pipeline.pictures.paint import OF_OIL, Paint, film_distance, wall_fractions
from pipeline.scenes.retina import DISC_RISE, FRONT, ORA, globe_radius

EQUATOR, PARS_PLANA = 90.0, FRONT    # degrees from the posterior pole
# The disc lies 4.76 mm from the fovea [jonas2015, abstract] and is 1.77 mm wide [quigley1990, abstract].
DISC_DISTANCE, DISC_RADIUS = 4.76e-3, 0.89e-3   # m
ALONE = 1.65            # size of the words of a map that stands alone, over that in a picture with others
ASIDE = 0.27            # rad, from the lowest point of a circle, at which its name stands
HATCH = 1.0             # percent of the height: distance of the lines over what is uncertain
STRIPES = (1.6, 0.5)    # percent of the height: distance and width of the stripes on films
DECIMALS = 1            # digits after the point of a share, percent, at most: those of the page
BREAK_COLOR, HALO = (214, 39, 40), (255, 255, 255)
WHITE = np.full(3, 255.0, np.float32)
Uncertain = float | np.ndarray | tuple[np.ndarray, np.ndarray]     # of ``FundusMap.draw``


@dataclasses.dataclass(frozen=True)
class Coverage:
    """Covered share of a part of the retina, its uncertainty, and what of it is over films (None: not known), 1."""

    covered: float
    uncertainty: float
    film: float | None = None

    def __str__(self) -> str:
        return f"{with_uncertainty(100 * self.covered, 100 * self.uncertainty, DECIMALS)} %"

    @property
    def short(self) -> str:
        """The share in the same digits, without its uncertainty."""
        return f"{plain(100 * self.covered, digits_of(100 * self.uncertainty, DECIMALS))} %"

    @property
    def parts(self) -> str:
        """What of it oil touches and what is over films, in words whose numbers add up; empty where not known."""
        if self.film is None:
            return ""
        film = round(100 * self.film, DECIMALS)
        return (f"touches {plain(round(100 * self.covered, DECIMALS) - film, DECIMALS)} %, on a thin film "
                f"{plain(film, DECIMALS)} %")


def disc_direction(globe: float, right_eye: bool) -> np.ndarray:
    """Direction (3,) of the optic disc from the center of a globe with a radius in m: nasal of the macula."""
    angle, rise = DISC_DISTANCE / globe, np.radians(DISC_RISE)
    nasal = 1.0 if right_eye else -1.0
    return np.array([nasal * np.sin(angle) * np.cos(rise), np.sin(angle) * np.sin(rise), -np.cos(angle)])


class FundusMap:
    """Draws the maps of one eye, always at the same scale and place.

    Parameters
    ----------
    vertices : (n, 3) m, the surface of the cavity; the origin is the center of the globe.
    size : width and height in pixels of the large canvas.
    right_eye : whether temporal is the patient's right, the left of the map.
    outlines : name -> directions (k, 3) from the center of the globe, around a break of the retina.
    paint : colors of what touches the wall.
    alone : the map is no part of a larger picture, nor of a movie: its words are larger, and keep off breaks and the
        edge of the oil.
    """

    def __init__(self, vertices: np.ndarray, size: tuple[int, int], *, right_eye: bool = True, captions: bool = True,
                 outlines: Mapping[str, np.ndarray] | None = None, paint: Paint = OF_OIL, alone: bool = False):
        self._alone, self._letters = alone, ALONE if alone else 1.0
        self._outlines, self.paint = outlines or {}, paint
        self.size, self.unit, self.right_eye, self.captions = size, size[1] / 100.0, right_eye, captions
        margin = (5.5 if captions else 2.0) * self.unit
        self.center = np.array([0.5 * size[0], 0.5 * size[1]])
        self.scale = (0.5 * min(size) - margin) / PARS_PLANA          # pixels per degree
        angle = np.degrees(np.arccos(np.clip(-vertices[:, 2] / np.linalg.norm(vertices, axis=1), -1.0, 1.0)))
        meridian = np.arctan2(vertices[:, 1], vertices[:, 0])
        behind = angle < 165.0
        self._vertices, self._chosen = len(vertices), np.flatnonzero(behind)
        places = (angle * np.stack([np.cos(meridian), np.sin(meridian)]))[:, behind].T
        self.globe = globe_radius(vertices)
        columns, rows = np.meshgrid(*final_pixels(size))
        x, y = (columns - self.center[0]) / self.scale, (self.center[1] - rows) / self.scale
        angle, pixel = np.hypot(x, y), OVERSAMPLING / self.scale
        self.inside = angle < PARS_PLANA + pixel
        self._angle = angle[self.inside]
        self._whole, self._retina = (_share((end - self._angle) / pixel)[:, None] for end in (PARS_PLANA, ORA))
        mesh = Delaunay(places)
        points = np.stack([x[self.inside], y[self.inside]], axis=-1)
        triangle = mesh.find_simplex(points)
        transform = mesh.transform[triangle]
        two = np.einsum("nij,nj->ni", transform[:, :2], points - transform[:, 2])
        weights = np.column_stack([two, 1.0 - two.sum(axis=1)]).astype(np.float32)
        self._weights = csr_matrix((weights.ravel(), mesh.simplices[triangle].ravel(),
                                    np.arange(0, weights.size + 1, 3)), (len(points), len(places)))
        hatch, diagonal = HATCH * self.unit, math.sqrt(2.0) * OVERSAMPLING
        self._hatch = _striped(rows + columns, hatch, 2.0 * hatch, diagonal)[self.inside, None]
        self._stripes = self._film_stripes(rows, OVERSAMPLING)[self.inside, None]

    def draw(self, wall, *, uncertain: Uncertain, quadrants: dict[str, Coverage] | None = None,
             marks=()) -> Image.Image:
        """Map of one frame.

        Parameters
        ----------
        wall : pyvista.PolyData of the reconstruct stage, with the vertices of this map.
        uncertain : m, on either side of the edge, which is hatched; one for all vertices, or (n,); or two arrays (n,),
            the distance of the vertices from the edge at least and at most, positive where the oil touches.
        quadrants : of the retina, "superior_temporal" and so on.
        marks : pairs of a color and a point (3,) in m, whose place on the wall is marked.
        """
        line, contact = film_distance(wall), np.asarray(wall.point_data["contact_distance"])
        least, most = uncertain if isinstance(uncertain, tuple) else (contact - uncertain, contact + uncertain)
        distance, covered, bare, low, high, film = self._at_pixels(
            contact, wall_fractions(wall, True), wall_fractions(wall, False), least, most,
            -1.0 if line is None else line)
        over, pixel = distance > 0.0, OVERSAMPLING / self.scale * math.radians(self.globe)      # m
        colors = self.paint.of(np.where(over, covered, bare)).astype(np.float32)    # the edge is under a line
        colors = _mixed(colors, self.paint.film, (over * _share(film / pixel))[:, None] * (1.0 - self._stripes))
        other = np.where(over[:, None], self.paint.bare, self.paint.covered)
        colors = _mixed(colors, other, _share(np.minimum(high, -low) / pixel)[:, None] * self._hatch)
        colors = _mixed(WHITE, _mixed(colors, WHITE, 0.25 * (1.0 - self._retina)), self._whole)
        pixels = np.full((*self.inside.shape, 3), 255, np.uint8)
        pixels[self.inside] = colors.round()
        image = enlarged(pixels, self.size)
        pen = ImageDraw.Draw(image)
        level = np.full(self.inside.shape, np.nan, np.float32)
        level[self.inside] = distance
        drawn = []
        for edge in level_lines(level):
            away = OVERSAMPLING * (edge[:, ::-1] + 0.5) - self.center
            away *= np.minimum(1.0, self.scale * PARS_PLANA / np.hypot(*away.T))[:, None]      # to the rim, not over it
            drawn.append(self.center + away)
            pen.line([tuple(point) for point in (self.center + away).tolist()], fill=INK,
                     width=max(2, round(0.75 * self.unit)), joint="curve")
        self._chart(pen)
        for outline in self._outlines.values():
            places = [tuple(map(float, self.place(point))) for point in outline]
            for color, width in ((HALO, 1.3), (BREAK_COLOR, 0.8)):
                pen.line([*places, places[1]], fill=color, width=max(2, round(width * self.unit)), joint="curve")
            drawn.append(np.array(places))
        for color, point in marks:
            diamond(pen, self.place(np.asarray(point, float)), 1.5 * self.unit, color)
        if self.captions:
            self._captions(pen, quadrants or {}, drawn)
        return image

    def hatch_sample(self, size: tuple[int, int]) -> Image.Image:
        """How an uncertain edge looks, for a legend of a width and a height in pixels."""
        rows, columns = np.mgrid[:size[1], :size[0]]
        stripe, middle = ((rows + columns) / (HATCH * self.unit)) % 2 < 1, 0.5 * size[0]
        colors = np.where((stripe ^ (columns < middle))[..., None], self.paint.covered, self.paint.bare)
        colors[np.abs(columns - middle) < 0.25 * self.unit] = INK
        return Image.fromarray(colors.astype(np.uint8))

    def film_sample(self, size: tuple[int, int]) -> Image.Image:
        """How a film looks, for a legend of a width and a height in pixels."""
        rows = np.mgrid[:size[1], :size[0]][0]
        colors = _mixed(self.paint.film, self.paint.covered, self._film_stripes(rows + 0.5, 1.0)[..., None])
        return Image.fromarray(colors.round().astype(np.uint8))

    def _film_stripes(self, rows: np.ndarray, pixel: float) -> np.ndarray:
        """Share of some pixels that has the color of what oil touches, also where it lies on a film: level stripes."""
        period, width = (length * self.unit for length in STRIPES)
        return _striped(rows, width, period, pixel)

    def share(self, contact_distance: np.ndarray) -> float:
        """Covered share of the retina as drawn, every pixel weighted with the solid angle that it stands for."""
        weight = self._retina[:, 0] * np.sin(np.radians(self._angle)) / np.maximum(self._angle, 1e-6)
        return float((weight * (self._at_pixels(contact_distance)[0] > 0.0)).sum() / weight.sum())

    def place(self, point: np.ndarray) -> np.ndarray:
        """Place (2,) on the map of a point (3,) in m, or of its direction from the center of the globe."""
        angle = np.degrees(np.arccos(np.clip(-point[2] / max(np.linalg.norm(point), 1e-12), -1.0, 1.0)))
        across = max(float(np.hypot(point[0], point[1])), 1e-12)
        return self.center + self.scale * angle * np.array([point[0], -point[1]]) / across  # (Z3)

    def _at_pixels(self, *values: np.ndarray | float) -> np.ndarray:
        """Values, of all vertices or one for all, at the pixels of the map, (len(values), n)."""
        chosen = [np.broadcast_to(one, self._vertices)[self._chosen] for one in values]
        return np.stack([self._weights @ one.astype(np.float32) for one in chosen])

    def _circle(self, pen: ImageDraw.ImageDraw, angle: float, color, width: float, center=(0.0, 0.0)) -> None:
        x, y = self.center + self.scale * np.array(center) * [1.0, -1.0]
        radius = self.scale * angle
        pen.ellipse([x - radius, y - radius, x + radius, y + radius], outline=color, width=max(1, round(width)))

    def _chart(self, pen: ImageDraw.ImageDraw) -> None:
        thin, u = 0.25 * self.unit, self.unit
        for hour in range(12):
            direction = np.array([np.sin(np.radians(30.0 * hour)), -np.cos(np.radians(30.0 * hour))])
            start, end = (self.center + self.scale * angle * direction for angle in (ORA - 8.0, PARS_PLANA))
            pen.line([tuple(start), tuple(end)], fill=FAINT_INK, width=max(1, round(thin)))
            if self.captions:
                write(pen, self.center + (self.scale * PARS_PLANA + 2.4 * u) * direction, str(hour or 12),
                      2.6 * self._letters**0.5 * u, color=FAINT_INK, anchor="mm")
        self._circle(pen, PARS_PLANA, FAINT_INK, thin)
        # Landmarks are thin lines, the edge of the oil is a thick one.
        for angle, center in ((ORA, (0.0, 0.0)), (EQUATOR, (0.0, 0.0)),
                              (np.degrees(MACULA_RADIUS / self.globe), (0.0, 0.0)),
                              (np.degrees(DISC_RADIUS / self.globe), self._disc)):
            self._circle(pen, angle, INK, 0.32 * u, center)

    @property
    def _disc(self) -> np.ndarray:
        """Place of the optic disc in degrees right and up."""
        x, y = (self.place(disc_direction(self.globe, self.right_eye)) - self.center) / self.scale
        return np.array([x, -y])

    def _captions(self, pen: ImageDraw.ImageDraw, quadrants: dict[str, Coverage], drawn: list[np.ndarray]) -> None:
        u, (width, _), reach = self.unit, self.size, self.scale * PARS_PLANA
        text = 2.4 * u * self._letters
        left, right = ("temporal", "nasal") if self.right_eye else ("nasal", "temporal")
        for side, x, anchor in ((left, 1.0 * u, "l"), (right, width - 1.0 * u, "r")):
            for up, y in (("superior", self.center[1] - reach), ("inferior", self.center[1] + reach - 2.6 * text)):
                share = quadrants.get(f"{up}_{side}")
                lines = (up, side) if share is None else (share.short, up, side)
                for row, line in enumerate(lines if up == "superior" else (up, side, *lines[:-2])):
                    bold = line.endswith("%")
                    write(pen, (x, y + 1.2 * text * row), line, (1.2 if bold else 0.9) * text, bold=bold,
                          color=INK if bold else FAINT_INK, anchor=f"{anchor}m")
        busy = [_dense(line, u) for line in drawn]
        for name, outline in self._outlines.items():
            if name:
                places = np.array([self.place(point) for point in outline])
                (left, top), (right, foot) = places.min(axis=0), places.max(axis=0)
                middle, gap = places.mean(axis=0), 0.75 * text
                words = name.replace("_", " ")
                aside = 0.5 * font(int(text), True).getlength(words) + 0.4 * text
                self._name(pen, words, text, busy, [(middle[0], top - gap), (middle[0], foot + gap), (
                    right + aside, middle[1]), (left - aside, middle[1])], bold=True, color=BREAK_COLOR)
        angles = [ASIDE, -ASIDE, np.pi - ASIDE, np.pi + ASIDE]
        within = 8.0 * self._letters**0.5       # degrees
        for name, degrees in (
                ("macula", [(0.0, -20.0), (0.0, 20.0), (-35.0, 0.0)]),
                ("disc", [self._disc + one for one in ((0.0, -9.0), (0.0, 12.0), (16.0, 0.0))]),
                *((name, [(circle - within) * np.array([np.sin(one), -np.cos(one)]) for one in angles])
                  for name, circle in (("equator", EQUATOR), ("ora serrata", ORA)))):
            self._name(pen, name, 0.92 * text, busy, self.center + self.scale * np.array(degrees) * [1.0, -1.0])

    def _name(self, pen: ImageDraw.ImageDraw, name: str, size: float, busy: list[np.ndarray], places, *,
              bold: bool = False, color=INK) -> None:
        """Write a name at the first of some places (k, 2); on a map that stands alone, at that which hides least."""
        half = 0.5 * np.array([font(int(size), bold).getlength(name), size]) + 0.2 * size
        points = np.concatenate(busy) if busy else np.zeros((0, 2))
        hidden = [int((np.abs(points - place) < half).all(axis=1).sum()) for place in np.asarray(places)]
        place = np.asarray(places)[int(np.argmin(hidden)) if self._alone else 0]
        write(pen, place, name, size, anchor="mm", outline=True, bold=bold, color=color)
        busy.append(place + half * np.stack(np.meshgrid(*2 * [np.linspace(-1.0, 1.0, 5)]), -1).reshape(-1, 2))


def _dense(line: np.ndarray, step: float) -> np.ndarray:
    """Points along a line (k, 2), that are no farther apart than a step."""
    parts = [np.linspace(start, end, 2 + int(np.hypot(*(end - start)) / step))
             for start, end in itertools.pairwise(line)]
    return np.concatenate(parts) if parts else line


def _share(level: np.ndarray) -> np.ndarray:
    """Share of pixels that lies where a level, a distance in pixels, is positive."""
    return np.clip(level + 0.5, 0.0, 1.0).astype(np.float32)


def _striped(place: np.ndarray, width: float, period: float, pixel: float) -> np.ndarray:
    """Share of pixels, each ``pixel`` long around its place, that lies on stripes of a width at equal distances."""
    def before(end: np.ndarray) -> np.ndarray:
        return np.floor(end / period) * width + np.minimum(end % period, width)

    return ((before(place + 0.5 * pixel) - before(place - 0.5 * pixel)) / pixel).astype(np.float32)


def _mixed(colors: np.ndarray, other: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Colors with a share (n, 1) of another color."""
    return colors + share * (np.asarray(other, np.float32) - colors)
