"""Stage: surfaces, sections and walls -> pictures: the section, the opened eye, and the map of the fundus.

Containers have a picture of their own (``pipeline.pictures.container_picture``).
"""
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from pipeline.base.cli import run, stage_parser
from pipeline.base.errors import UserError
from pipeline.base.files import replacing_folder
from pipeline.base.frame_files import FrameData, find_frames, read_course
from pipeline.base.progress import progress
from pipeline.base.sequences import FRAMES_AGAIN, without_others
from pipeline.base.usage import frame_done
from pipeline.base.vtk_files import read_vtk
from pipeline.cavity.initial_state import load_initial
from pipeline.pictures.anterior_segment import anterior_segment
from pipeline.pictures.container_panel import length_in_words
from pipeline.pictures.container_picture import ContainerRenderer
from pipeline.pictures.eye_layout import HEADER, columns_of, rows_of
from pipeline.pictures.fundus_map import BREAK_COLOR, Coverage, FundusMap
from pipeline.pictures.marks import (
    FAINT_INK,
    INK,
    OVERSAMPLING,
    clock,
    color_bar,
    diamond,
    gravity_mark,
    header,
    pretty,
    reduce,
    write,
)
from pipeline.pictures.paint import css, paint_of
from pipeline.pictures.section_panel import SectionPanel
from pipeline.pictures.slice_panel import DROPLET_COLORS, DROPLET_TICKS, Fields
from pipeline.runs.segments import check_segments
from pipeline.scenes.effects import does, droplets_of, illustration_in_words, knows_films, places_at_work
from pipeline.scenes.retina import globe_radius, side_word
from pipeline.scenes.shown_liquids import liquid_around, shown_liquids
from pipeline.surfaces.surface_files import (
    check_time,
    read_retina,
    read_section,
    read_statistics,
    read_surfaces,
    read_wall,
)
from sim.effects.effect import MIXES

MARK_COLORS = {"cannula": (213, 94, 0), "drain": (90, 0, 60)}
MOST_BESIDE, LEAST_BESIDE = 0.6, 0.01   # shares on one side of the section, and of the cavity, from which on it is said
COMPRESSION = 2         # of PNG: files are an eighth larger than by default, in little more than half of the time
PURE, LEAST_MIXED = 0.95, 0.01          # fraction of one liquid, and share of the cavity that has less of every one


class Renderer:
    """Draws the frames of one scene with an eye; made once, because backgrounds and the window are kept.

    Parameters
    ----------
    scene : resolved scene.
    cavity_volume : m3.
    eye_surface : pyvista.PolyData of the cavity in m, or None for pictures without the opened eye (no OpenGL needed).
    """

    def __init__(self, scene, cavity_volume: float, eye_surface=None):
        self.scene, self.cavity_volume = scene, cavity_volume
        self.size = tuple(OVERSAMPLING * length for length in scene.output.image_size)
        width, height = scene.output.image_size
        self.top, self.bottom = (OVERSAMPLING * row for row in rows_of(height))     # panels begin with whole pixels
        self.columns = [OVERSAMPLING * column for column in columns_of(width, opened=eye_surface is not None)]
        around = liquid_around(scene)
        self.water, self.droplets = around.name if around else None, droplets_of(scene)
        self.shown = [scene.liquids.index(liquid) for liquid in shown_liquids(scene)]
        self.right_eye, self.paint = scene.eye.side == "right", paint_of(scene)
        self.illustrates = bool(illustration_in_words(scene))
        self.panel: SectionPanel | None = None
        self.fundus: FundusMap | None = None
        self.view = None
        if eye_surface is not None:
            from pipeline.pictures.eye_view import EyeView

            breaks = scene.patches(globe_radius(np.asarray(eye_surface.points, float)))["breaks"].values()
            self.view = EyeView(eye_surface, self._panel_size(1), right_eye=self.right_eye, breaks=tuple(breaks),
                                paint=self.paint)

    def picture(self, frame: FrameData, sections, wall, surfaces, retina: dict[str, Coverage]) -> Image.Image:
        """Picture of one frame.

        Parameters
        ----------
        sections : of the reconstruct stage, the one through the optic axis and the coronal one, pyvista.ImageData.
        wall : of the reconstruct stage, pyvista.PolyData.
        surfaces : dict liquid -> pyvista.PolyData.
        retina : coverage of its parts.
        """
        working = places_at_work(self.scene, frame.time, self.cavity_volume)
        marks = [(MARK_COLORS.get(name, INK), point) for name, point in working]
        canvas = Image.new("RGB", self.size, (255, 255, 255))
        canvas.paste(self._section(frame, sections, marks), (0, self.top))
        if self.view is not None:
            interfaces = [(surfaces[frame.liquids[index]], self._color(index)) for index in self.shown]
            canvas.paste(Image.fromarray(self.view.draw(wall, interfaces)), (self.columns[1], self.top))
        if self.fundus is None:
            points = np.asarray(wall.points, float)
            breaks = self.scene.patches(globe_radius(points))["breaks"].items()
            self.fundus = FundusMap(points, self._panel_size(-1), right_eye=self.right_eye,
                                    outlines={name: one.outline() for name, one in breaks}, paint=self.paint)
        canvas.paste(self.fundus.draw(wall, uncertain=0.5 * frame.particle_spacing, marks=marks,
                                      quadrants=None if self.illustrates else retina), (self.columns[-2], self.top))
        self._texts(canvas, frame, retina, [name for name, _ in working], mixed=self._is_mixed(frame))
        return reduce(canvas)

    def close(self) -> None:
        """Free the window."""
        if self.view is not None:
            self.view.close()

    def _panel_size(self, column: int) -> tuple[int, int]:
        left, right = (self.columns[-2:] if column < 0 else self.columns[column:column + 2])
        return right - left, self.bottom - self.top

    def _section(self, frame: FrameData, sections, marks) -> Image.Image:
        section, coronal = (self._fields(image) for image in sections)
        if self.panel is None:
            self.panel = SectionPanel(section, anterior_segment(self.scene.eye), self._panel_size(0), coronal,
                                      self.paint)
        return self.panel.draw(section, frame.gravity, coronal, marks)

    def _fields(self, image) -> Fields:
        """Return what a section shows, superior up."""
        axes = [axis for axis in (1, 2, 0) if image.dimensions[axis] > 1]       # y first
        order = (2, 1, 0)                                                       # VTK counts along x first

        def plane(name):
            values = np.asarray(image.point_data[name])
            values = values.reshape(*(image.dimensions[axis] for axis in order), -1)
            return np.moveaxis(values, [order.index(axis) for axis in axes], [0, 1]).reshape(
                *(image.dimensions[axis] for axis in axes), -1)

        fraction, dominance = plane("fraction"), plane("dominance")
        return Fields(plane("signed_distance")[..., 0], np.array(image.origin)[axes], image.spacing[axes[0]],
                      fraction[..., self.shown].sum(axis=-1),
                      tuple(dominance[..., k] for k in range(1, dominance.shape[-1])),
                      None if self.droplets is None else fraction[..., self.droplets])

    def _is_mixed(self, frame: FrameData) -> bool:
        """Whether there is a mixture to be shown: of what is told apart by colors, not of what are droplets."""
        if self.droplets is None and does(self.scene, MIXES):
            return True
        fraction = frame.volume_fraction[:, self.shown].sum(axis=1)
        return bool(frame.volume[np.minimum(fraction, 1.0 - fraction) > 1.0 - PURE].sum()
                    > LEAST_MIXED * frame.volume.sum())

    def _texts(self, canvas: Image.Image, frame: FrameData, retina: dict[str, Coverage], working: list[str],
               mixed: bool) -> None:
        draw, u = ImageDraw.Draw(canvas), self.size[1] / 100.0
        header(draw, self.size, title=self.scene.title or self.scene.name,
               time=clock(frame.time, self.scene.output.second_means), subtitle=self._headline(retina),
               label=self.scene.label)
        section = ["section through the optic axis, from the patient's left", self._beside(frame)]
        fundus = [f"fundus of the {self.scene.eye.side} eye, as its examiner sees it", self._fill(frame)]
        halves = ["rings: equator, ora, macula, disc"]
        captions = [section, fundus] if self.view is None else [section, halves, fundus]
        ends = [*self.columns[1:-1], self.columns[-1] - 6.0 * u]     # the arrow of gravity is at the right
        for left, right, lines in zip(self.columns, ends, captions, strict=False):
            for row, line in enumerate(lines):
                write(draw, (left + 2.0 * u, self.size[1] * HEADER + (0.8 + 3.0 * row) * u), line, 2.3 * u,
                      color=FAINT_INK, width=right - left - 3.0 * u)
        if self.view is not None:
            self._halves(draw, frame, u)
        down = frame.gravity / max(float(np.linalg.norm(frame.gravity)), 1e-9)
        if down.any():
            place = np.array([self.columns[-1] - 4.5 * u, self.top - 2.8 * u])
            word = gravity_mark(draw, place, 2.8 * u, *down)
            write(draw, place + np.array([2.5 * u, 4.6 * u]), word, 2.0 * u, anchor="rm")
        self._legend(canvas, draw, u, working, mixed)

    def _halves(self, draw: ImageDraw.ImageDraw, frame: FrameData, u: float) -> None:
        """Name the halves of the opened eye, and show where gravity pulls in them."""
        from pipeline.pictures.eye_view import HALVES, screen_axes

        down = frame.gravity / max(float(np.linalg.norm(frame.gravity)), 1e-9)
        height, right_eye = (self.bottom - self.top) / len(HALVES), self.scene.eye.side == "right"
        for row, half in enumerate(HALVES):
            left, top = self.columns[1] + 1.0 * u, self.top + row * height
            write(draw, (left + 1.0 * u, top - (2.4 if row == 0 else 1.4) * u),
                  f"{side_word(half == 'left', right_eye)} half of the eye", 2.3 * u, color=FAINT_INK)
            if down.any():
                place = np.array([left + 3.0 * u, top + height - 5.0 * u])
                word = gravity_mark(draw, place, 3.2 * u, *(screen_axes(half) @ down))
                write(draw, place + np.array([-2.5 * u, 3.6 * u]), word, 2.0 * u, anchor="lm")

    def _headline(self, retina: dict[str, Coverage]) -> str:
        """The numbers that a surgeon looks for first, where they mean what they say."""
        if self.illustrates:
            return "an illustration after Song et al.; its numbers are no prediction"
        parts = retina["whole"].parts
        return f"{self._shown_name()} {'is over' if parts else 'touches'} {retina['whole']} of the retina" \
            f"{parts and f' ({parts})'}, {retina['inferior']} of its inferior half, {retina['macula']} of the macula"

    def _legend(self, canvas: Image.Image, draw: ImageDraw.ImageDraw, u: float, working: list[str],
                mixed: bool) -> None:
        """Say below the panels what colors and marks mean: a swatch for each liquid, of mixtures the scale between."""
        width, height = self.size
        top, bottom = height - 6.6 * u, height - 4.2 * u
        middle, bar, left, text = 0.5 * (top + bottom), 0.13 * width, 2.0 * u, 2.4 * u

        def words(after: float, what: str) -> float:
            """Write what a mark ``after`` which it stands means; return where the next one begins."""
            return after + 3.0 * u + write(draw, (after + 1.0 * u, middle), what, text, anchor="lm")

        def swatch(color, what: str) -> float:
            draw.rectangle([left, top, left + 3.6 * u, bottom], fill=color, outline=FAINT_INK)
            return words(left + 3.6 * u, what)

        if mixed:
            left += 0.06 * width
            color_bar(draw, (left, top, left + bar, bottom), self.paint.colors, f"{self._shown_name()} volume fraction",
                      (self._plain(self.water), self._shown_name()), text)
            left += bar + 0.05 * width
        else:
            left = swatch(css(self.paint.covered), self._plain(self.scene.liquids[self.shown[0]].name))
            if self.water:
                left = swatch(css(self.paint.bare), self._plain(self.water))
        if self.droplets is not None:
            left += 2.0 * u
            color_bar(draw, (left, top, left + 1.3 * bar, bottom), DROPLET_COLORS, "oil in droplets, ppm", ("", ""),
                      text, DROPLET_TICKS)
            left += 1.3 * bar + 0.03 * width
        if len(self.shown) > 1 and self.view is not None:
            for index in self.shown:
                left = swatch(self.scene.liquids[index].color, pretty(self.scene.liquids[index].name))
        canvas.paste(self.fundus.hatch_sample((round(3.6 * u), round(bottom - top))), (round(left), round(top)))
        left = words(left + 3.6 * u, f"edge, ± {length_in_words(0.5 * self.scene.numerics.particle_spacing)}")
        if knows_films(self.scene):
            canvas.paste(self.fundus.film_sample((round(3.6 * u), round(bottom - top))), (round(left), round(top)))
            draw.rectangle([left, top, left + 3.6 * u, bottom], outline=FAINT_INK)
            left = words(left + 3.6 * u, f"{self._shown_name()} on a thin film of {self._plain(self.water)}")
        if self.scene.breaks:
            draw.line([left, middle, left + 3.2 * u, middle], fill=BREAK_COLOR, width=round(0.8 * u))
            left = words(left + 3.2 * u, "break" if len(self.scene.breaks) == 1 else "breaks")
        for name in working:
            diamond(draw, (left + 1.5 * u, middle), 1.5 * u, MARK_COLORS.get(name, INK))
            left = words(left + 3.0 * u, name)

    def _color(self, index: int) -> str:
        """The interface of the one oil has the color of oil; several liquids have the scene's colors."""
        return css(self.paint.covered) if len(self.shown) == 1 else self.scene.liquids[index].color

    @staticmethod
    def _plain(name: str | None) -> str:
        """Name of a liquid without the number of its grade: silicone_oil_1000 -> silicone oil."""
        return pretty(name or "").rstrip("0123456789 ")

    def _shown_name(self) -> str:
        names = [self.scene.liquids[index].name for index in self.shown]
        return "oil" if any("oil" in name for name in names) or not names else pretty(names[0])

    def _fill(self, frame: FrameData) -> str:
        total = frame.fill.sum()
        parts = [f"{pretty(frame.liquids[k])}: {100.0 * frame.fill[k] / total:.1f} %" for k in self.shown]
        text = ", ".join(parts) + f" of the cavity ({total * 1e6:.2f} mL)"
        if self.droplets is not None:
            text += f"; droplets: {1e6 * frame.fill[self.droplets] / total:.2g} ppm"
        return text

    def _beside(self, frame: FrameData) -> str:
        """What the section does not show: where the liquid lies that the oil floats on; nothing if it lies in it."""
        if self.water is None:
            return ""
        volume = frame.volume.astype(float) * frame.volume_fraction[:, list(frame.liquids).index(self.water)]
        if volume.sum() <= LEAST_BESIDE * frame.volume.sum():
            return ""
        left = float(volume[frame.position[:, 0] > 0.0].sum() / volume.sum())
        if max(left, 1.0 - left) < MOST_BESIDE:
            return ""
        side = "left" if left > 0.5 else "right"
        return f"most of the {self._plain(self.water)} lies on the patient's {side} of this plane"


def render_frames(scene, cavity_volume: float | None, eye_surface, frames: Path, surfaces: Path, output: Path) -> None:
    """Draw every frame of a folder; the folder of pictures appears by rename."""
    paths, label = find_frames(frames), f"{scene.name}: render {frames.name}"
    check_segments(scene, paths, FRAMES_AGAIN)
    without_others(paths, surfaces.glob("frame_*.json"), FRAMES_AGAIN)
    renderer: Any = ContainerRenderer(scene, eye_surface) if scene.container else \
        Renderer(scene, cavity_volume, eye_surface)
    try:
        with replacing_folder(output) as folder, progress(len(paths), label) as bar:
            for path, frame in read_course(paths):
                needed = frame.liquids if eye_surface is not None or scene.container is not None else ()
                numbers = surfaces / f"{path.stem}.json"
                check_time(numbers, read_statistics(numbers)["time"], frame.time)
                meshes = read_surfaces(surfaces, path.stem, needed)
                if scene.container is None:
                    sections = [read_section(surfaces / f"{path.stem}_{name}.vti") for name in ("section", "coronal")]
                    wall = read_wall(surfaces / f"{path.stem}_wall.vtp")
                    retina = {part: Coverage(**numbers)
                              for part, numbers in read_retina(numbers).items()}
                    picture = renderer.picture(frame, sections, wall, meshes, retina)
                else:
                    picture = renderer.picture(frame, meshes)
                picture.save(folder / f"{path.stem}.png", compress_level=COMPRESSION)
                frame_done()
                bar.update()
    finally:
        renderer.close()


def main(arguments: list[str] | None = None) -> None:
    """Command line: all frames of one folder become pictures in one process."""
    parser = stage_parser("render", "Draw a picture of every frame.")
    parser.add_argument("scene", type=Path, metavar="scene.json", help="resolved scene")
    parser.add_argument("initial", type=Path, metavar="initial.npz", help="arrays of the voxelize stage")
    parser.add_argument("eye", type=Path, metavar="eye.vtp", help="surface of the cavity")
    parser.add_argument("frames", type=Path, metavar="FRAMES_DIR", help="folder of frames")
    parser.add_argument("surfaces", type=Path, metavar="SURFACES_DIR", help="folder of the reconstruct stage")
    parser.add_argument("--output", required=True, type=Path, metavar="IMAGES_DIR", help="folder of pictures to write")
    parser.add_argument("--section-only", action="store_true",
                        help="leave out the views in space; needs no OpenGL")
    options = parser.parse_args(arguments)

    from pipeline.scenes.load import load_resolved

    scene = load_resolved(options.scene)
    eye = None
    if not options.section_only and scene.dimension == 3:
        if not options.eye.is_file():
            raise UserError(f"{options.eye}: no such file; run the eye stage first")
        eye = read_vtk(options.eye)
    cavity_volume = None if scene.container else float(load_initial(options.initial)["cavity_volume"])
    render_frames(scene, cavity_volume, eye, options.frames, options.surfaces, options.output)


if __name__ == "__main__":
    run(main)
