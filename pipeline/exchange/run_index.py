"""The index of a run: for every saved time one VTK multi-block file that names its parts, and a list of the times.

The parts are the files that the stages have written; only the interface is written here. Parts:
``particles``; the closed surface of every liquid, under the name of the liquid; ``interface``, the surfaces of all
liquids but the one around them, without what lies at the wall; ``wall``, the cavity, of an eye with its regions and
with what touches it; ``section`` and ``coronal``, of an eye; ``places``, its breaks and the regions that the scene
names.
"""
import dataclasses
import os
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from xml.sax.saxutils import quoteattr

import numpy as np

from pipeline.base.errors import UserError
from pipeline.base.frame_files import frames_of
from pipeline.base.sequences import FRAMES_AGAIN, without_others
from pipeline.base.vtk_files import set_text, write_vtk
from pipeline.cavity.rays import interpolation
from pipeline.scenes.model import Scene
from pipeline.scenes.retina import direction, globe_radius
from pipeline.surfaces.surface_files import read_statistics, read_surface, surface_path

AT_WALL = 0.1  # depth in particle spacings up to which a surface lies at the wall
PLACE_STEP, BEFORE_WALL = 2.0, 0.995  # degrees between points of a place, at most; so much nearer to the center


@dataclasses.dataclass(frozen=True)
class SavedFrame:
    """The files of one saved time."""

    name: str
    time: float
    particles: Path
    surfaces: Path

    def parts(self, scene: Scene, wall: Path) -> dict[str, Path]:
        """Return the files by the names of the parts, without the interface and the places."""
        found = {"particles": self.particles}
        found |= {liquid.name: surface_path(self.surfaces, self.name, liquid.name) for liquid in scene.liquids}
        sections = {name: self.surfaces / f"{self.name}_{name}.vti" for name in ("section", "coronal")}
        return found | {"wall": self.wall or wall} | {name: path for name, path in sections.items() if path.is_file()}

    @property
    def wall(self) -> Path | None:
        """The file of the wall with what touches it; None where there is none."""
        path = self.surfaces / f"{self.name}_wall.vtp"
        return path if path.is_file() else None


def saved_frames(frames: Iterable[Path], surfaces: Iterable[Path]) -> list[SavedFrame]:
    """Return what folders of frames and folders of surfaces hold, in the order of time.

    Raises
    ------
    UserError : a frame has no surfaces, or surfaces have no frame.
    """
    numbers = {path.stem: path for folder in surfaces for path in Path(folder).glob("frame_*.json")}
    found = []
    paths = frames_of(frames)
    without_others(paths, numbers.values(), FRAMES_AGAIN)
    for path in paths:
        if path.stem not in numbers:
            raise UserError(f"{path}: has no surfaces; run the reconstruct stage on its folder first")
        time = float(read_statistics(numbers[path.stem])["time"])
        found.append(SavedFrame(path.stem, time, path, numbers[path.stem].parent))
    return found


def background_of(scene: Scene) -> str | None:
    """Return the liquid in which the others are shown: the first clear one, else the first; None where it is alone."""
    names = [liquid.name for liquid in scene.liquids]
    return next((liquid.name for liquid in scene.liquids if liquid.clear), names[0]) if len(names) > 1 else None


def shown_liquids(scene: Scene) -> list[str]:
    """Return the liquids that are shown in the other one."""
    return [liquid.name for liquid in scene.liquids if liquid.name != background_of(scene)]


def write_interface(path: Path, frame: SavedFrame, scene: Scene) -> None:
    """Write the surfaces of the shown liquids of a frame, where they are deeper than at the wall, as poly data."""
    import pyvista

    depth, away, names = AT_WALL * scene.numerics.particle_spacing, [], [liquid.name for liquid in scene.liquids]
    for liquid in shown_liquids(scene):
        surface = read_surface(surface_path(frame.surfaces, frame.name, liquid))
        if surface.n_points:
            surface.clear_field_data()
            part = surface.clip_scalar(scalars="depth", invert=False, value=depth)
            part.cell_data["liquid"] = np.full(part.n_cells, names.index(liquid), np.int32)
            away.append(part)
    merged = away[0].append_polydata(*away[1:]) if away else pyvista.PolyData()
    merged.field_data["time"] = [frame.time]
    set_text(merged, "liquids", names)
    set_text(merged, "units", ("points: m", "depth: m", "time: s"))
    write_vtk(merged, path)


def write_places(path: Path, scene: Scene, wall: Path) -> bool:
    """Write the breaks and regions of a scene as quadrilaterals just before its wall; tell whether it has any."""
    import pyvista

    if not scene.breaks and not scene.regions:
        return False
    eye = read_surface(wall)
    points, faces = np.asarray(eye.points, float), eye.regular_faces
    names: list[str] = []
    corners, quads, number, count = [], [], [], 0
    for kind, patches in scene.patches(globe_radius(points)).items():
        for name, patch in patches.items():
            meridian, latitude, _ = patch.grid(PLACE_STEP)
            corner, weight = interpolation(points, faces, direction(meridian, latitude))
            rows = len(np.unique(latitude))
            index = (count + np.arange(len(meridian))).reshape(rows, -1)
            count += len(meridian)
            cells = np.stack([index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]], axis=-1).reshape(-1, 4)
            corners.append(BEFORE_WALL * np.einsum("kc,kcx->kx", weight, points[corner]))
            quads.append(cells)
            number.append(np.full(len(cells), len(names), np.int32))
            names.append(f"{kind.removesuffix('s')}_{name}")
    mesh = pyvista.PolyData.from_regular_faces(np.concatenate(corners).astype(np.float32), np.concatenate(quads))
    mesh.cell_data["place"] = np.concatenate(number)
    set_text(mesh, "places", names)
    set_text(mesh, "units", ("points: m",))
    write_vtk(mesh, path)
    return True


def write_blocks(path: Path, parts: Mapping[str, Path], final: Path) -> None:
    """Write a VTK multi-block file (``.vtm``) that names its parts.

    Parameters
    ----------
    final : folder in which the file will be; the paths in it start there.
    """
    lines = ['<?xml version="1.0"?>', '<VTKFile type="vtkMultiBlockDataSet" version="1.0" byte_order="LittleEndian">',
             "  <vtkMultiBlockDataSet>"]
    lines += [f"    <DataSet index=\"{number}\" name={quoteattr(name)} file={quoteattr(relative(part, final))}/>"
              for number, (name, part) in enumerate(parts.items())]
    path.write_text("\n".join([*lines, "  </vtkMultiBlockDataSet>", "</VTKFile>", ""]))


def relative(path: Path, folder: Path) -> str:
    """Path from a folder on."""
    return os.path.relpath(path.resolve(), folder.resolve())


def write_parts(folder: Path, final: Path, frames: Sequence[SavedFrame], scene: Scene, wall: Path) -> None:
    """Write the interface and the list of parts of every frame into ``folder``, which will be renamed to ``final``."""
    places = write_places(folder / "places.vtp", scene, wall)
    for frame in frames:
        write_interface(folder / f"{frame.name}_interface.vtp", frame, scene)
        parts = frame.parts(scene, wall) | {"interface": final / f"{frame.name}_interface.vtp"}
        parts |= {"places": final / "places.vtp"} if places else {}
        write_blocks(folder / f"{frame.name}.vtm", parts, final)
