"""Scenes with a container at several times on one sheet, for the pages of studies: the liquids as their surfaces.

In space they are bodies in a glass box. In a plane every liquid fills its outline; where liquids mix, their colors mix
as the fractions of the particles of that outline do.
"""
from collections.abc import Callable, Sequence

import numpy as np
from PIL import Image, ImageColor, ImageDraw
from scipy.ndimage import binary_closing
from scipy.spatial import cKDTree

from pipeline.base.frame_files import FrameData
from pipeline.pictures.container_panel import INSIDE, WALL, shade
from pipeline.pictures.marks import OVERSAMPLING
from pipeline.surfaces.contour_lines import signed_area
from pipeline.surfaces.fraction_field import SUPPORT, wendland
from pipeline.surfaces.saved_frame import SavedFrame
from pipeline.surfaces.surface_files import lines_of

NEIGHBORS = 12          # particles of which a mixed color is the mean
PURE = 1.0 - 1e-3       # fraction from which on a particle is of one liquid
CRACK = 1.5             # spacings, width up to which what parts mixing liquids is no void


class ContainerMoments:
    """Draws frames of one scene, without words.

    Parameters
    ----------
    scene : resolved scene with a container.
    width : of a picture in pixels of the large canvas.
    """

    def __init__(self, scene, width: int):
        self.scene, self.view = scene, None
        self.sides = np.array(scene.container.size, float)
        if scene.dimension == 2:
            self.size = width, round(width * self.sides[1] / self.sides[0])
            return
        from pipeline.pictures.container_view import ContainerView

        right, up = ContainerView.extent(self.sides)
        self.size = width, round(width * up / right)
        self.view = ContainerView(self.sides, self.size, scene.container.funnels)

    def draw(self, frame: FrameData, surfaces) -> Image.Image:
        """Picture of one frame; ``surfaces`` is a dict liquid -> pyvista.PolyData."""
        if self.view is None:
            return self._plane(frame, surfaces)
        return Image.fromarray(np.ascontiguousarray(
            self.view.draw([(surfaces[liquid.name], liquid.color) for liquid in self.scene.liquids])))

    def close(self) -> None:
        """Free the window."""
        if self.view is not None:
            self.view.close()

    def _plane(self, frame: FrameData, surfaces) -> Image.Image:
        colors = np.array([ImageColor.getrgb(liquid.color) for liquid in self.scene.liquids])
        pure = bool((np.max(frame.volume_fraction, axis=1) > PURE).all())
        picture, paths = np.full((self.size[1], self.size[0], 3), INSIDE, np.uint8), []
        anywhere = np.zeros(picture.shape[:2], bool)
        for phase, liquid in enumerate(self.scene.liquids):
            lines = [line[:, :2] for line in lines_of(surfaces[liquid.name])]
            paths += [(self._pixels(line), shade(tuple(colors[phase]))) for line in lines]
            inside = self._filled(lines)
            anywhere |= inside
            picture[inside] = colors[phase] if pure else self._mixed(frame, frame.phase == phase, colors)[inside]
        if not pure:    # where liquids mix, neither of them may reach its level in a line between both
            reach = 0.5 * CRACK * frame.particle_spacing * self.size[0] / self.sides[0]
            place = np.arange(-int(reach), int(reach) + 1)
            crack = binary_closing(anywhere, place[:, None] ** 2 + place**2 <= reach**2) & ~anywhere
            picture[crack] = self._mixed(frame, np.ones(len(frame.phase), bool), colors)[crack]
        image = Image.fromarray(picture)
        draw = ImageDraw.Draw(image)
        for path, color in paths if pure else []:
            draw.line(path, fill=color, width=OVERSAMPLING, joint="curve")
        draw.rectangle([0, 0, self.size[0] - 1, self.size[1] - 1], outline=WALL, width=2 * OVERSAMPLING)
        return image

    def _pixels(self, line: np.ndarray) -> list[tuple[float, float]]:
        scale = self.size[0] / self.sides[0]
        return [tuple(point) for point in ([0.0, self.size[1]] + scale * line * [1.0, -1.0]).tolist()]

    def _filled(self, lines: list[np.ndarray]) -> np.ndarray:
        """Pixels (height, width) inside lines, which run clockwise around holes."""
        mask = Image.new("1", self.size)
        draw = ImageDraw.Draw(mask)
        areas = [signed_area(line - line[0]) for line in lines]
        for index in sorted(range(len(lines)), key=lambda index: -abs(areas[index])):
            draw.polygon(self._pixels(lines[index]), fill=int(areas[index] > 0.0))
        return np.asarray(mask)

    def _mixed(self, frame: FrameData, own: np.ndarray, colors: np.ndarray) -> np.ndarray:
        """Colors (height, width, 3) by the mean fractions of the particles in ``own`` (n,) around every pixel."""
        if not own.any():
            return np.zeros((self.size[1], self.size[0], 3), np.uint8)
        cell = OVERSAMPLING * self.sides[0] / self.size[0]
        x, y = (cell * (np.arange(-(-count // OVERSAMPLING)) + 0.5) for count in self.size)
        points = np.stack(np.meshgrid(x, self.sides[1] - y), axis=-1).reshape(-1, 2)
        far, near = cKDTree(frame.position[own, :2]).query(points, min(NEIGHBORS, int(own.sum())))
        far, near = far.reshape(len(points), -1), near.reshape(len(points), -1)
        weight = wendland(far / (SUPPORT * frame.particle_spacing)) * np.asarray(frame.volume)[own][near]
        weight[:, 0] += 1e-30       # the nearest alone where none is within the support
        fraction = np.einsum("mk,mkl->ml", weight, frame.volume_fraction[own][near]) / weight.sum(axis=1)[:, None]
        picture = np.clip(fraction @ colors, 0.0, 255.0).round().astype(np.uint8).reshape(len(y), len(x), 3)
        picture = picture.repeat(OVERSAMPLING, axis=0).repeat(OVERSAMPLING, axis=1)
        return picture[:self.size[1], :self.size[0]]


def moments(scene, frames: Sequence[SavedFrame], width: int,
            caption: Callable[[int, FrameData], str]) -> list[tuple[Image.Image, str]]:
    """Pictures of frames of one run with captions, made of their number and the frame; as ``ContainerMoments``."""
    drawn, result = ContainerMoments(scene, width), []
    try:
        for number, saved in enumerate(frames):
            frame = saved.read()
            result.append((drawn.draw(frame, saved.surfaces_of(frame.liquids)), caption(number, frame)))
    finally:
        drawn.close()
    return result
