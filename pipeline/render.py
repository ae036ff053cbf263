"""Stage: surfaces and sections -> pictures: on the left where the oil is in the section, on the right its body.

Containers have a picture of their own (``pipeline.pictures.container_picture``).
"""
import argparse
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

from pipeline.base.cli import run
from pipeline.base.errors import UserError
from pipeline.base.files import replacing_folder
from pipeline.base.frame_files import FrameData, find_frames, read_frame
from pipeline.base.progress import progress
from pipeline.pictures.container_picture import ContainerRenderer
from pipeline.pictures.marks import FAINT_INK, OVERSAMPLING, color_bar, header, pretty, reduce, write
from pipeline.pictures.section_panel import COLORS, DROPLET_COLORS, DROPLET_TICKS, Eye, SectionPanel
from pipeline.scenes.effects import droplets_of
from pipeline.surfaces.surface_files import read_section, read_surface, surface_path

HEADER, FOOTER = 0.125, 0.115       # of the height


class Renderer:
    """Draws the frames of one scene with an eye; made once, because the background and the window are kept.

    Parameters
    ----------
    scene : resolved scene.
    eye_surface : pyvista.PolyData of the cavity in m, or None for pictures without the right panel (no OpenGL needed).
    """

    def __init__(self, scene, eye_surface=None):
        from pipeline.pictures.eye_view import EyeView

        self.scene = scene
        self.size = tuple(OVERSAMPLING * length for length in scene.output.image_size)
        width, height = self.size
        self.top, self.bottom = round(HEADER * height), round((1.0 - FOOTER) * height)
        self.split = width // 2 if eye_surface is not None else width
        liquids = [liquid.name for liquid in scene.liquids]
        clear = (liquid.name for liquid in scene.liquids if liquid.clear)
        self.water = next(clear, liquids[0] if len(liquids) > 1 else None)
        self.droplets = droplets_of(scene)
        self.shown = [index for index, name in enumerate(liquids) if name != self.water and index != self.droplets]
        self.panel = None
        self.view = None
        if eye_surface is not None:
            self.view = EyeView(eye_surface, (width - self.split, self.bottom - self.top))

    def picture(self, frame: FrameData, section, surfaces) -> Image.Image:
        """Picture of one frame.

        Parameters
        ----------
        section : pyvista.ImageData of the reconstruct stage.
        surfaces : dict liquid -> pyvista.PolyData.
        """
        count_y, count_z = section.dimensions[1:]

        def plane(name):
            return np.asarray(section.point_data[name]).reshape(count_z, count_y, -1).transpose(1, 0, 2)

        if self.panel is None:
            model = self.scene.eye
            eye = Eye(model.axial_length if model.model == "parametric" else None, model.lens)
            self.panel = SectionPanel(plane("signed_distance")[..., 0], section.origin[1:], section.spacing[1], eye,
                                      (self.split, self.bottom - self.top))
        fraction, dominance = plane("fraction"), plane("dominance")
        lines = [dominance[..., k] for k in range(1, dominance.shape[-1])]
        canvas = Image.new("RGB", self.size, (255, 255, 255))
        droplets = None if self.droplets is None else fraction[..., self.droplets]
        canvas.paste(self.panel.draw(fraction[..., self.shown].sum(axis=-1), lines, frame.gravity, droplets),
                     (0, self.top))
        if self.view is not None:
            body = self.view.draw([(surfaces[frame.liquids[index]], self._color(index)) for index in self.shown])
            canvas.paste(Image.fromarray(np.ascontiguousarray(body)), (self.split, self.top))
        self._texts(ImageDraw.Draw(canvas), frame)
        return reduce(canvas)

    def close(self) -> None:
        """Free the window."""
        if self.view is not None:
            self.view.close()

    def _texts(self, draw: ImageDraw.ImageDraw, frame: FrameData) -> None:
        width, height = self.size
        u = height / 100.0
        header(draw, self.size, title=self.scene.title or self.scene.name, time=frame.time,
               subtitle=self._fill(frame), label=self.scene.label)
        bar, center = 0.2 * width, self.split / 2
        if self.droplets is not None:
            bar, center = 0.12 * width, 0.30 * self.split
            middle = 0.78 * self.split
            color_bar(draw, (middle - 0.75 * bar, height - 6.6 * u, middle + 0.75 * bar, height - 4.2 * u),
                      DROPLET_COLORS, "oil in droplets, parts per million", ("", ""), 2.5 * u, DROPLET_TICKS)
        color_bar(draw, (center - bar / 2, height - 6.6 * u, center + bar / 2, height - 4.2 * u), COLORS,
                  f"{self._shown_name()} volume fraction",
                  (pretty(self.water) if self.water else "", self._shown_name()), 2.5 * u)
        write(draw, (2.0 * u, self.top), "section through the optic axis,", 2.3 * u, color=FAINT_INK)
        write(draw, (2.0 * u, self.top + 3.0 * u), "seen from the patient's left", 2.3 * u, color=FAINT_INK)
        if self.view is not None:
            self._legend(draw, u)

    def _legend(self, draw: ImageDraw.ImageDraw, u: float) -> None:
        from pipeline.pictures.eye_view import TOUCH_COLOR

        write(draw, (self.split + 4.0 * u, self.top), "the eye opened,", 2.3 * u, color=FAINT_INK)
        write(draw, (self.split + 4.0 * u, self.top + 3.0 * u), "left half of its wall removed", 2.3 * u,
              color=FAINT_INK)
        free = [(self._color(index), "free surface") for index in self.shown[:1]]
        left, top = self.split + 0.22 * (self.size[0] - self.split), self.size[1] - 6.6 * u
        for color, text in (*free, (TOUCH_COLOR, "touches the wall")):
            draw.rectangle([left, top, left + 2.4 * u, top + 2.4 * u], fill=color, outline=FAINT_INK)
            left += 6.6 * u + write(draw, (left + 3.4 * u, top + 1.2 * u), f"{self._shown_name()} {text}", 2.5 * u,
                                    anchor="lm")

    def _color(self, index: int) -> str:
        """Yellow for the one oil, as in the section; several liquids have the scene's colors."""
        from pipeline.pictures.eye_view import FREE_COLOR

        return FREE_COLOR if len(self.shown) == 1 else self.scene.liquids[index].color

    def _shown_name(self) -> str:
        names = [self.scene.liquids[index].name for index in self.shown]
        return "oil" if any("oil" in name for name in names) or not names else pretty(names[0])

    def _fill(self, frame: FrameData) -> str:
        total = frame.fill.sum()
        parts = [f"{pretty(frame.liquids[k])}: {100.0 * frame.fill[k] / total:.1f} %" for k in self.shown]
        text = ", ".join(parts) + f" of the cavity ({total * 1e6:.2f} mL)"
        if self.droplets is not None:
            text += f"; in droplets: {1e6 * frame.fill[self.droplets] / total:.2g} millionths"
        return text


def render_frames(scene, eye_surface, frames: Path, surfaces: Path, output: Path) -> None:
    """Draw every frame of a folder; the folder of pictures appears by rename."""
    renderer: Any = Renderer(scene, eye_surface) if scene.container is None else ContainerRenderer(scene, eye_surface)
    paths = find_frames(frames)
    try:
        with replacing_folder(output) as folder, progress(len(paths), "render") as bar:
            for path in paths:
                frame = read_frame(path)
                needed = frame.liquids if eye_surface is not None or scene.container is not None else ()
                meshes = {liquid: read_surface(surface_path(surfaces, path.stem, liquid)) for liquid in needed}
                if scene.container is None:
                    section = read_section(surfaces / f"{path.stem}_section.vti")
                    picture = renderer.picture(frame, section, meshes)
                else:
                    picture = renderer.picture(frame, meshes)
                picture.save(folder / f"{path.stem}.png")
                bar.update()
    finally:
        renderer.close()


def main(arguments: list[str] | None = None) -> None:
    """Command line: all frames of one folder become pictures in one process."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.render", description="Draw a picture of every frame.")
    parser.add_argument("scene", type=Path, metavar="scene.json", help="resolved scene")
    parser.add_argument("initial", type=Path, metavar="initial.npz", help="arrays of the voxelize stage")
    parser.add_argument("eye", type=Path, metavar="eye.vtp", help="surface of the cavity")
    parser.add_argument("frames", type=Path, metavar="FRAMES_DIR", help="folder of frames")
    parser.add_argument("surfaces", type=Path, metavar="SURFACES_DIR", help="folder of the reconstruct stage")
    parser.add_argument("--output", required=True, type=Path, metavar="IMAGES_DIR", help="folder of pictures to write")
    parser.add_argument("--section-only", action="store_true",
                        help="leave out the view of the body on the right; needs no OpenGL")
    options = parser.parse_args(arguments)

    from pipeline.pictures.opengl import use_working_opengl
    from pipeline.scenes.load import load_resolved

    scene = load_resolved(options.scene)
    eye = None
    if not options.section_only and scene.dimension == 3:
        if not options.eye.is_file():
            raise UserError(f"{options.eye}: no such file; run the eye stage first")
        use_working_opengl()
        import pyvista

        eye = pyvista.read(options.eye)
    render_frames(scene, eye, options.frames, options.surfaces, options.output)


if __name__ == "__main__":
    run(main)
