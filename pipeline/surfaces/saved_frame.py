"""A saved time of a run: the file of its particles, and those of the surfaces found in them."""
import dataclasses
import functools
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.base.errors import UserError
from pipeline.base.frame_files import FrameData, frames_of, read_frame
from pipeline.base.sequences import FRAMES_AGAIN, number_of, without_others
from pipeline.surfaces.surface_files import read_statistics, read_surface, read_surfaces, read_wall, surface_path

if TYPE_CHECKING:
    import pyvista


@dataclasses.dataclass(frozen=True)
class SavedFrame:
    """The files of one saved time; nothing is read before it is asked for.

    Attributes
    ----------
    particles : file of the particles. surfaces : folder of the surfaces.
    """

    particles: Path
    surfaces: Path

    @property
    def name(self) -> str:
        """Name that all its files begin with, ``frame_00000``."""
        return self.particles.stem

    @property
    def number(self) -> int:
        """Its number; frame 0 is the start."""
        return number_of(self.particles)

    @property
    def statistics(self) -> Path:
        """The file of the numbers of its surfaces, which tells that these are there."""
        return self.surfaces / f"{self.name}.json"

    @functools.cached_property
    def time(self) -> float:
        """Time, s, as its surfaces say."""
        return float(read_statistics(self.statistics)["time"])

    @property
    def wall(self) -> Path | None:
        """The file of the wall with what touches it; None where there is none."""
        path = self.surfaces / f"{self.name}_wall.vtp"
        return path if path.is_file() else None

    def read(self) -> FrameData:
        """Return the particles."""
        return read_frame(self.particles)

    def surface_path(self, liquid: str) -> Path:
        """Return the file of the surface of a liquid."""
        return surface_path(self.surfaces, self.name, liquid)

    def surface(self, liquid: str) -> "pyvista.PolyData":
        """Return the surface of a liquid as pyvista.PolyData in m."""
        return read_surface(self.surface_path(liquid))

    def surfaces_of(self, liquids: Iterable[str]) -> dict[str, "pyvista.PolyData"]:
        """Return the surfaces of liquids, liquid -> pyvista.PolyData in m."""
        return read_surfaces(self.surfaces, self.name, list(liquids))

    def read_wall(self) -> "pyvista.PolyData":
        """Return the wall of an eye, with what touches it, in m."""
        return read_wall(self.surfaces / f"{self.name}_wall.vtp")


def frames_with_surfaces(frames: Iterable[Path], surfaces: Iterable[Path]) -> list[SavedFrame]:
    """Return what folders of frames and folders of surfaces hold, in the order of time.

    Raises
    ------
    UserError : a frame has no surfaces, or surfaces have no frame.
    """
    made = {path.stem: path for folder in surfaces for path in Path(folder).glob("frame_*.json")}
    folder_of = {name: path.parent for name, path in made.items()}
    found, paths = [], frames_of(frames)
    without_others(paths, made.values(), FRAMES_AGAIN)
    for path in paths:
        if path.stem not in folder_of:
            raise UserError(f"{path}: has no surfaces; run the reconstruct stage on its folder first")
        found.append(SavedFrame(path, folder_of[path.stem]))
    return found
