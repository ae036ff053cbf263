"""The section through the optic axis, and across it a smaller one through the equator of the globe.

The larger is seen from the patient's left: superior is up, anterior is left. The smaller, coronal one is seen from the
front, as the map of the fundus: the patient's left is on the right. It shows what lies beside the plane of the larger.
"""
import textwrap

import numpy as np
from PIL import Image, ImageDraw

from pipeline.pictures.anterior_segment import ANGLE, COATS, AnteriorSegment
from pipeline.pictures.marks import FAINT_INK, INK, OVERSAMPLING, diamond, enlarged, gravity_mark, write
from pipeline.pictures.paint import OF_OIL, Paint
from pipeline.pictures.slice_panel import SCLERA, Fields, SlicePanel
from pipeline.scenes.retina import ORA

LENS, CAPSULE = (178, 187, 200), (104, 112, 126)
CHAMBER, CORNEA, IRIS, CILIARY, ZONULE = (238, 244, 249), (203, 216, 227), (122, 86, 62), (141, 90, 69), (128, 136, 148)
IMPLANT = (206, 214, 224)
SCALE_BAR = 5e-3
CORONAL = 0.28                  # size of the coronal section, of the height of the panel
POSTURES = {"upright": (0, -1, 0), "supine": (0, 0, -1), "prone": (0, 0, 1), "lying on the left side": (1, 0, 0),
            "lying on the right side": (-1, 0, 0), "head down": (0, 1, 0)}


class SectionPanel(SlicePanel):
    """Draws sections of one scene, always at the same scale and place.

    Parameters
    ----------
    fields : of the plane through the optic axis, y along rows and z along columns, for the cavity alone.
    segment : what lies before the cavity; None for a user's mesh.
    size : width and height of the panel in pixels of the large canvas.
    coronal : the plane across it, y along rows and x along columns, for the cavity alone; None leaves it out.
    """

    def __init__(self, fields: Fields, segment: AnteriorSegment | None, size: tuple[int, int],
                 coronal: Fields | None = None, paint: Paint = OF_OIL):
        self.unit, (width, height) = size[1] / 100.0, size
        y, z = (ends + np.array([-COATS, COATS]) for ends in fields.reach())
        if segment is not None:
            z[1] = segment.apex
        scale = min(0.80 * width / np.ptp(z), 0.70 * height / np.ptp(y))
        super().__init__(fields, size, center=(y.mean(), z.mean()), scale=scale, mirrored=True, paint=paint,
                         middle=(2.0 * self.unit + 0.5 * scale * np.ptp(z), 8.0 * self.unit + 0.5 * scale * np.ptp(y)))
        self.ends, self.segment = (y, z), segment
        if segment is None:
            self.paint_wall()
        else:
            self._paint_eye(segment)
        self.coronal = None if coronal is None else CoronalPanel(
            coronal, OVERSAMPLING * round(CORONAL * height / OVERSAMPLING), paint, known=segment is not None)

    def draw(self, fields: Fields, gravity: np.ndarray, coronal: Fields | None = None, marks=()) -> Image.Image:
        """Panel of one frame.

        ``gravity`` (3,) in m/s2; ``marks`` are pairs of a color and a point (3,) in m, shown where it lies in, before
        or behind the section.
        """
        image = self.draw_liquids(fields)
        pen = ImageDraw.Draw(image)
        self._captions(pen)
        self._gravity(pen, gravity)
        for color, (_, y, z) in marks:
            diamond(pen, self.pixel(y, z), 1.5 * self.unit, color)
        if coronal is not None and self.coronal is not None:
            u, (width, height), small = self.unit, self.size, self.coronal.draw_liquids(coronal)
            left, top = (OVERSAMPLING * round(end / OVERSAMPLING)
                         for end in (width - small.width - 2.0 * u, height - small.height - 5.0 * u))
            image.paste(small, (left, top), enlarged(self.coronal.opacity, small.size))
            for x, word, anchor in ((left, "R", "lm"), (left + small.width, "L", "rm")):     # of the patient
                write(pen, (x, top + 0.5 * small.height), word, 2.4 * u, color=FAINT_INK, anchor=anchor)
            write(pen, (width - 2.0 * u, height - 4.0 * u), "coronal section, from the front", 2.4 * u,
                  color=FAINT_INK, anchor="ra")
            for end in self.ends[0]:     # where it cuts this one
                x, y = self.pixel(end, 0.0)
                away = -np.sign(end) * u
                pen.line([x, y + 0.6 * away, x, y + 2.4 * away], fill=FAINT_INK, width=round(0.35 * u))
        return image

    def _paint_eye(self, eye: AnteriorSegment) -> None:
        """Paint what is around the cavity, from behind to the front."""
        y, z = np.meshgrid(self.rows, self.columns, indexing="ij")
        angle, away = np.arctan2(np.abs(y), z), np.hypot(y, z)
        outside, inside = away - eye.outside(angle), away - eye.inside(angle)
        cornea = np.clip((eye.limbus - angle) / np.radians(4.0) + 0.5, 0.0, 1.0)    # it goes over into the sclera
        behind = angle > np.pi - np.radians(ORA)
        before = (z > min(eye.front, eye.iris_plane) - 0.5e-3) & ~behind
        shell = self.cover(np.where(before, np.maximum(outside, -inside), outside))
        self.paint_over(shell, SCLERA)
        self.paint_over(self.cover(np.maximum(outside, -inside)) * cornea, CORNEA)
        # A staphyloma reaches beyond the globe behind; in front the coats end at the sclera, and at the iris.
        there = np.where(z > 0.0, self.cover(outside), 1.0)
        self.paint_coats(behind, CILIARY, there * self.cover(ANGLE - np.where(z > eye.front, np.abs(y), 1.0)))
        self.paint_over(self.cover(inside) * before, CHAMBER)
        room = self.cover(inside)
        if eye.filled:
            self.paint_over(room * (z > 0.0) * ~behind, IRIS)
        self.paint_over(room * ~behind * self.areas(self._both(eye.ciliary_body())), CILIARY)
        if not eye.filled:
            self._paint_front(eye, y, z, inside)
        rim = np.minimum(outside, np.where(z > 0.0, 1.0, self.distance - COATS))
        self.paint_line(rim, max(0.08e-3, 1.2 / self.scale), FAINT_INK)

    def _both(self, outline) -> list:
        """Pixels of an outline on either side of the optic axis."""
        across, height = outline
        return [self.pixel(side * across, height) for side in (1.0, -1.0)]

    def _paint_front(self, eye: AnteriorSegment, y: np.ndarray, z: np.ndarray, inside: np.ndarray) -> None:
        """Paint fibers, lens and iris."""
        both, thin = self._both, max(1.0, 0.09e-3 * self.scale)
        if eye.lens == "phakic":
            for fiber in eye.zonules():
                self.paint_over(0.8 * self.strokes(both(fiber), 0.7 * thin), ZONULE)
            level = eye.lens_level(y, z)
            self.paint_over(self.cover(level), LENS)
            self.paint_line(level + 0.05e-3, 1.3 * thin / self.scale, CAPSULE)
        elif eye.lens == "pseudophakic":
            for capsule in eye.bag():
                self.paint_over(self.strokes(both(capsule), 0.8 * thin), ZONULE)
            self.paint_over(self.strokes(both(eye.haptic()), 1.6 * thin), CAPSULE)
            self.paint_over(self.areas(both(eye.implant())), IMPLANT)
            self.paint_over(self.strokes(both(eye.implant()), 1.3 * thin), CAPSULE)
        # Its root reaches a bit into the wall.
        self.paint_over(self.areas(both(eye.iris())) * self.cover(inside - 0.25e-3), IRIS)

    def _captions(self, draw: ImageDraw.ImageDraw) -> None:
        u, (width, height) = self.unit, self.size
        text, (low, high) = 2.6 * u, self.ends[0]
        write(draw, self.pixel(high, 0.0) + np.array([0.0, -2.8 * u]), "superior", text, color=FAINT_INK, anchor="ms")
        write(draw, self.pixel(low, 0.0) + np.array([0.0, 2.8 * u]), "inferior", text, color=FAINT_INK, anchor="ma")
        write(draw, (1.0 * u, self.pixel(0.88 * low, 0.0)[1]), "anterior", text, color=FAINT_INK, anchor="lm")
        write(draw, (width - 1.0 * u, self.pixel(0.55 * low, 0.0)[1]), "posterior", text, color=FAINT_INK, anchor="rm")
        if self.segment is not None and self.segment.lens != "aphakic":
            write(draw, self.pixel(0.0, self.segment.lens_middle), "lens", 2.2 * u, color=INK, anchor="mm")
        length, left, base = SCALE_BAR * self.scale, 3.0 * u, height - 4.0 * u
        draw.rectangle([left, base, left + length, base + 0.9 * u], fill=INK)
        write(draw, (left + length / 2, base - 0.8 * u), "5 mm", text, anchor="md")

    def _gravity(self, draw: ImageDraw.ImageDraw, gravity: np.ndarray) -> None:
        u, (width, _) = self.unit, self.size
        strength = float(np.linalg.norm(gravity))
        lines = [("no gravity", False)]
        if strength > 1e-6:
            x, y, z = np.asarray(gravity, float) / strength
            word = gravity_mark(draw, np.array([width - 8.0 * u, 6.5 * u]), 5.0 * u, -z, y, x)
            lines = [("gravity", False), *([(word, False)] if word else []),
                     *((words, True) for words in textwrap.wrap(posture(gravity), 14))]
        for row, (line, bold) in enumerate(lines):
            write(draw, (width - 2.0 * u, (12.7 + 3.2 * row) * u), line, 2.6 * u, bold=bold, anchor="ra")


class CoronalPanel(SlicePanel):
    """Draws the plane across the optic axis, in a square of pixels, as who looks at the patient's face sees it.

    ``known`` is whether the wall has the coats of an eye. ``opacity`` (n, n) uint8, at its final size, is 0 outside it.
    """

    def __init__(self, fields: Fields, side: int, paint: Paint, *, known: bool):
        y, x = fields.reach()
        scale = 0.86 * side / (max(np.ptp(y), np.ptp(x)) + 2.0 * COATS)
        super().__init__(fields, (side, side), middle=(0.5 * side, 0.5 * side), center=(y.mean(), x.mean()),
                         scale=scale, mirrored=False, paint=paint)
        rim = self.distance - COATS
        if known:
            self.paint_coats()
            self.paint_line(rim, max(0.08e-3, 1.2 / scale), FAINT_INK)
        else:
            self.paint_wall()
        self.opacity = (255.0 * self.cover(rim - OVERSAMPLING / scale)).astype(np.uint8)


def posture(gravity: np.ndarray) -> str:
    """Posture of the patient from the direction of gravity in the eye: the axis it is within 20 degrees of."""
    strength = np.linalg.norm(gravity)
    if strength < 1e-6:
        return ""
    best = max(POSTURES, key=lambda name: float(np.dot(POSTURES[name], gravity)))
    return best if np.dot(POSTURES[best], gravity) / strength > np.cos(np.deg2rad(20.0)) else "between postures"
