"""Stage: frames of particles -> one closed surface per liquid and frame; of an eye also sections and its wall.

In two dimensions the surfaces are closed lines.
"""
import json
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.base.cli import run, stage_parser
from pipeline.base.errors import UserError
from pipeline.base.files import replacing_folder
from pipeline.base.frame_files import FrameData, find_frames, frames_of, read_course
from pipeline.base.progress import progress
from pipeline.base.sequences import FRAMES_AGAIN
from pipeline.base.threads import checked_threads
from pipeline.base.usage import frame_done
from pipeline.cavity.initial_state import load_initial
from pipeline.measures.film_course import FilmCourse
from pipeline.measures.frame_view import Measured
from pipeline.measures.wall_map import WallMapper
from pipeline.runs.segments import check_segments
from pipeline.scenes.devices import HELP, chosen_device
from pipeline.scenes.model import Scene
from pipeline.surfaces.droplets import DROPLET_PARTICLES
from pipeline.surfaces.liquid_surface import LiquidSurface, Reconstructor
from pipeline.surfaces.surface_files import (
    read_surface,
    surface_path,
    write_copy,
    write_section,
    write_surface,
    write_wall,
)

LARGEST_VOLUME_ERROR = 0.02     # relative, where the stage fails


def check(path: Path, liquids: tuple[str, ...], surfaces: list[LiquidSurface], *, mixed: bool,
          free_surface: bool = False) -> None:
    """Stop on a surface that must not be shown.

    Raises
    ------
    UserError : a surface is open, or the volume of a liquid in bulk is off by more than ``LARGEST_VOLUME_ERROR``.
        Where the liquids mix (``mixed``) the level 1/2 holds no fixed volume, and the error is only reported. Below
        a ``free_surface`` particles may be crowded or spread as spray beyond what offsets can mend: a warning.
    """
    for liquid, surface in zip(liquids, surfaces, strict=True):
        numbers = surface.statistics
        if not numbers["watertight"]:
            raise UserError(f"{path}: the surface of {liquid} is not closed; choose another `output.contour`")
        if not mixed and numbers["bulk_particles"] > DROPLET_PARTICLES and \
                abs(numbers["volume_error"]) > LARGEST_VOLUME_ERROR:
            sentence = (f"{path}: the surface of {liquid} holds {numbers['volume'] * 1e6:.4f} mL, its particles "
                        f"{numbers['expected_volume'] * 1e6:.4f} mL")
            if not free_surface:
                raise UserError(f"{sentence}; choose a smaller `output.cell_ratio`")
            print(f"warning: {sentence}; they are crowded, or spread as spray")


class Wall:
    """The wall of one eye, with what touches it in every frame.

    Parameters
    ----------
    surface : pyvista.PolyData of the cavity in m.
    initial : arrays of ``initial.npz``.

    Frames are shown to it in the order of time: what the oil lies on follows from those before.
    """

    def __init__(self, scene: Scene, initial: dict[str, np.ndarray], surface):
        self.scene, self.initial, self.surface = scene, initial, surface
        self.mapper = WallMapper(surface.points, surface.regular_faces)
        self._films = FilmCourse.of(scene, float(initial["cavity_volume"]))

    def follow(self, frame: FrameData) -> Measured:
        """Return the state of the next frame."""
        return Measured(self.scene, self.initial, frame).after(self._films)

    def write(self, path: Path, frame: FrameData) -> dict[str, dict[str, float]]:
        """Write the wall of the next frame; return shares of every part of the retina.

        Covered, its uncertainty, and where films are known the share of the part that is covered over one.
        """
        state = self.follow(frame)
        contact = state.wall
        wall = self.mapper.map(contact, state.film)
        write_wall(path, self.surface, wall.contact_distance, wall.oil_fraction, wall.film_distance, time=frame.time)
        parts = contact.retina_masks() | contact.quadrant_masks(state.right_eye)
        shares = {name: {"covered": contact.covered_share(mask), "uncertainty": 0.5 * contact.band_share(mask)}
                  for name, mask in parts.items()}
        if state.film is not None:
            for name, mask in parts.items():
                shares[name]["film"] = state.film.film_share(mask)
        return shares


def write_surfaces(folder: Path, path: Path, frame: FrameData, reconstructor: Reconstructor, formats=(),
                   wall: Wall | None = None) -> None:
    """Reconstruct the frame read from ``path`` and write its files into ``folder``."""
    surfaces = reconstructor.surfaces(frame)
    mixed = bool(((frame.volume_fraction > 1e-3) & (frame.volume_fraction < 1.0 - 1e-3)).any())
    check(path, frame.liquids, surfaces, mixed=mixed, free_surface=reconstructor.free_surface)
    for liquid, surface in zip(frame.liquids, surfaces, strict=True):
        mesh: Any = surface.mesh  # of formats, lines have none
        write_surface(surface_path(folder, path.stem, liquid), mesh, time=frame.time, liquid=liquid,
                      depth=reconstructor.depth_at(mesh.points))
        for suffix in formats:
            write_copy(surface_path(folder, path.stem, liquid, f".{suffix}"), mesh)
    for name, section in reconstructor.sections().items():
        write_section(folder / f"{path.stem}_{name}.vti", section, time=frame.time, liquids=frame.liquids)
    statistics = {"time": frame.time, "mixed": mixed, "liquids": dict(zip(
        frame.liquids, (surface.statistics for surface in surfaces), strict=True))}
    if wall is not None:
        statistics["retina"] = wall.write(folder / f"{path.stem}_wall.vtp", frame)
    (folder / f"{path.stem}.json").write_text(json.dumps(statistics, indent=2) + "\n")


def main(arguments: list[str] | None = None) -> None:
    """Command line: all frames of one folder become surfaces in one process (the kernel is compiled once)."""
    parser = stage_parser("reconstruct", "Turn the particles of saved frames into one closed surface mesh per liquid.")
    parser.add_argument("scene", type=Path, metavar="scene.json", help="resolved scene")
    parser.add_argument("initial", type=Path, metavar="initial.npz", help="signed distance to the wall")
    parser.add_argument("frames", type=Path, metavar="FRAMES_DIR", help="folder of frames")
    parser.add_argument("--before", type=Path, nargs="*", default=[], metavar="FRAMES_DIR",
                        help="folders of all frames before, from the start on: they tell where oil lies on films that "
                        "are too thin for the particles (default: none, so that oil at the wall touches it)")
    parser.add_argument("--output", required=True, type=Path, metavar="SURFACES_DIR",
                        help="folder to write: a .vtp per liquid, two sections and a .json with volumes per frame")
    parser.add_argument("--format", action="append", default=[], choices=("ply", "stl"),
                        help="write each surface in this format too (default: `output.formats` of the scene)")
    parser.add_argument("--threads", type=int, default=0, metavar="N",
                        help="threads of the field (default 0: as many as are useful)")
    parser.add_argument("--device", help=f"{HELP} (default: numerics.device of the scene)")
    parser.add_argument("--eye", type=Path, metavar="eye.vtp",
                        help="surface of the cavity: write it too, with what touches it, for the pictures of an eye")
    options = parser.parse_args(arguments)

    from pipeline.scenes.load import load_resolved
    from sim.backend.runtime import initialize

    scene, threads = load_resolved(options.scene), checked_threads(options.threads, "--threads")
    device = chosen_device(options.device, scene, options.scene)
    if options.format and scene.dimension == 2:
        raise UserError("--format: the surfaces of a scene in two dimensions are lines, which are written as .vtp only")
    paths = find_frames(options.frames)
    check_segments(scene, paths, FRAMES_AGAIN)
    initialize("f32", threads, device, keep_to_core=True)
    initial = load_initial(options.initial)
    reconstructor = Reconstructor(
        initial, len(scene.liquids), cell_ratio=scene.output.cell_ratio,
        method=scene.output.contour, smoothing_length=scene.output.smoothing_length,
        kernel=scene.output.kernel, free_surface=not scene.closed)
    wall = None
    if options.eye and scene.eye is not None:
        wall = Wall(scene, initial, read_surface(options.eye))
        for _, frame in read_course(frames_of(options.before)):
            wall.follow(frame)
    label = f"{scene.name}: reconstruct {options.frames.name}"
    with replacing_folder(options.output) as folder, progress(len(paths), label) as bar:
        for path, frame in read_course(paths):
            write_surfaces(folder, path, frame, reconstructor, options.format or scene.output.formats, wall)
            frame_done()
            bar.update()


if __name__ == "__main__":
    run(main)
