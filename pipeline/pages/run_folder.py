"""What a run has left in its folder, `outputs/<scene>/<level>`."""
import dataclasses
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.base.errors import UserError
from pipeline.base.sequences import PICTURES_AGAIN, in_sequence
from pipeline.base.tables import read_table
from pipeline.base.usage import taken_by, usage_files
from pipeline.cavity.initial_state import load_initial
from pipeline.forecast.estimate_files import read_level
from pipeline.measures.metric import Metric, read_meanings
from pipeline.scenes.ending import check_segments, segments_made
from pipeline.scenes.load import scene_of_run
from pipeline.scenes.model import Scene
from pipeline.simulation.cost_files import read_costs
from pipeline.surfaces.surface_files import read_surface, read_wall, surface_path


@dataclasses.dataclass(frozen=True)
class Run:
    """A run that is over.

    Attributes
    ----------
    table : metrics of every frame, column -> (frames,).
    metrics : what they mean.
    pictures : files of the frames, in the order of time.
    cavity_volume : m^3 (in two dimensions m^2).
    costs : what the solver says of each segment.
    taken : stage -> wall, cpu (s) and memory (bytes).
    predicted : the estimate of this level.
    """

    folder: Path
    scene: Scene
    table: dict[str, np.ndarray]
    metrics: list[Metric]
    pictures: list[Path]
    cavity_volume: float
    costs: list[dict[str, Any]]
    taken: dict[str, dict[str, float]]
    predicted: dict[str, Any]

    @property
    def title(self) -> str:
        """Heading of the scene."""
        return self.scene.title or self.scene.name

    def time_of(self, picture: Path) -> float:
        """Return the simulated time of a picture, s."""
        return int(picture.stem.rpartition("_")[2]) * self.scene.output.frame_interval

    def cavity(self):
        """Return the surface of the cavity as pyvista.PolyData in m."""
        return read_surface(self.folder / "eye.vtp")

    def wall_of(self, picture: Path):
        """Return the wall of an eye at the time of a picture, with what touches it, as pyvista.PolyData in m."""
        return read_wall(self.folder / "surfaces" / picture.parent.name / f"{picture.stem}_wall.vtp")

    def last_wall(self):
        """Return the same in the last frame."""
        return self.wall_of(self.pictures[-1])

    def last_surface(self, liquid: str):
        """Return the surface of a liquid in the last frame as pyvista.PolyData in m."""
        last = self.pictures[-1]
        return read_surface(surface_path(self.folder / "surfaces" / last.parent.name, last.stem, liquid))


def read_run(folder: Path) -> Run:
    """Read the folder of a run.

    Raises
    ------
    UserError : something is missing or damaged.
    """
    scene = scene_of_run(folder)
    segments = segments_made(scene, folder)
    pictures = in_sequence((path for name in segments for path in folder.glob(f"images/segment_{name}/frame_*.png")),
                           PICTURES_AGAIN)
    check_segments(scene, pictures, PICTURES_AGAIN)
    if not pictures:
        raise UserError(f"{folder / 'images'}: no pictures (segment_*/frame_*.png); run the render stage first")
    for name in ("movie.mp4", "poster.png"):
        if not (folder / name).is_file():
            raise UserError(f"{folder / name}: no such file; run the movie stage first")
    if scene.dimension == 3 and not (folder / "still.png").is_file():
        raise UserError(f"{folder / 'still.png'}: no such file; run the still stage first")
    return Run(
        folder=folder, scene=scene, table=read_table(folder / "metrics.csv"),
        metrics=read_meanings(folder / "metrics.json"), pictures=pictures,
        cavity_volume=float(load_initial(folder / "initial.npz")["cavity_volume"]),
        costs=[read_costs(folder / "costs" / f"segment_{name}.json") for name in segments],
        taken=taken_by(usage_files(folder / "logs", segments)),
        predicted=read_level(folder / "estimate.json", scene))
