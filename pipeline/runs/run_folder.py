"""The folder of a run, `outputs/<scene>/<level>`: where its files are, and which of them belong to it.

What a longer run of the scene has left there before is not of it: the scene says how many segments and frames there
are, and where it ends at rest, the files of the rest stage do.
"""
import csv
import dataclasses
import functools
import itertools
from collections.abc import Iterable
from pathlib import Path, PurePosixPath
from typing import Any

import numpy as np

from pipeline.base.checksum import checksum_at_end
from pipeline.base.errors import UserError
from pipeline.base.frame_files import frame_path
from pipeline.base.sequences import PICTURES_AGAIN, in_sequence, number_of
from pipeline.base.tables import read_table
from pipeline.base.usage import taken_by, usage_files
from pipeline.cavity.initial_state import load_initial
from pipeline.measures.events import Event, events_of
from pipeline.measures.least_energy import LeastEnergy, read_least_energy
from pipeline.measures.metric import Metric, read_meanings
from pipeline.runs.contents import segment_of
from pipeline.runs.segments import segment_path, segments_made
from pipeline.scenes.load import scene_of_run
from pipeline.scenes.model import Scene
from pipeline.simulation.cost_files import STARTED_FROM, read_costs
from pipeline.surfaces.saved_frame import SavedFrame
from pipeline.surfaces.surface_files import read_surface


@dataclasses.dataclass(frozen=True)
class RunFolder:
    """What a run has left in its folder. Nothing is read before it is asked for, and then once.

    Whatever is missing or damaged is a UserError, which says what to run.

    Attributes
    ----------
    folder : ``outputs/<scene>/<level>``.
    """

    folder: Path

    @functools.cached_property
    def scene(self) -> Scene:
        """The scene that was run, in SI units."""
        return scene_of_run(self.folder)

    @property
    def title(self) -> str:
        """Heading of the scene."""
        return self.scene.title or self.scene.name

    @property
    def level(self) -> str:
        """Name of the accuracy level."""
        return self.scene.accuracy

    @functools.cached_property
    def segments(self) -> list[str]:
        """Names of the segments that the run has."""
        return segments_made(self.scene, self.folder)

    @property
    def frame_count(self) -> int:
        """Number of frames, with that at the start."""
        return self.scene.frames_of_segment(len(self.segments) - 1).stop

    @functools.cached_property
    def frames(self) -> list[SavedFrame]:
        """All frames of the run, in the order of time.

        Raises
        ------
        UserError
            A segment did not start where the one before has ended: the scene has changed, and was not run to its end.
        """
        for before, name in itertools.pairwise(self.segments):
            end, costs = (segment_path(self.folder, kind, segment, suffix)
                          for kind, segment, suffix in (("checkpoints", before, ".npz"), ("costs", name, ".json")))
            started = read_costs(costs).get(STARTED_FROM) if costs.is_file() and end.is_file() else ""
            if started and started != checksum_at_end(end):
                raise UserError(f"{self.folder}: segment {name} does not go on from segment {before}, so that an "
                                "earlier version of the scene has left it; run the scene to its end: snakemake -j2 "
                                f"outputs/{self.scene.name}/{self.level}/metrics.csv")
        return [SavedFrame(frame_path(segment_path(self.folder, "frames", name), number),
                           segment_path(self.folder, "surfaces", name))
                for segment, name in enumerate(self.segments) for number in self.scene.frames_of_segment(segment)]

    @property
    def ready_frames(self) -> list[SavedFrame]:
        """Those that have surfaces: all, or the first ones of a run that goes on."""
        return [frame for frame in self.frames if frame.statistics.is_file()]

    @property
    def times(self) -> np.ndarray:
        """Times of the frames, (frames,), s."""
        return self.scene.output.frame_interval * np.arange(self.frame_count)

    def picture_of(self, frame: SavedFrame) -> Path:
        """Return the picture of a frame."""
        return self.folder / "images" / frame.particles.parent.name / f"{frame.name}.png"

    @property
    def pictures(self) -> list[Path]:
        """The pictures of the frames that have one, in the order of time; none is missing between two others."""
        return in_sequence((picture for picture in map(self.picture_of, self.frames) if picture.is_file()),
                           PICTURES_AGAIN)

    def time_of(self, picture: Path) -> float:
        """Return the time of a picture, s."""
        return number_of(picture) * self.scene.output.frame_interval

    def frame_of(self, picture: Path) -> SavedFrame:
        """Return the frame of a picture."""
        return self.frames[number_of(picture)]

    @property
    def wall(self) -> Path:
        """The file of the surface of the cavity."""
        return self.folder / "eye.vtp"

    def cavity(self):
        """Return the surface of the cavity as pyvista.PolyData in m."""
        return read_surface(self.wall)

    @functools.cached_property
    def initial(self) -> dict[str, np.ndarray]:
        """Particles and signed distance at the start."""
        return load_initial(self.folder / "initial.npz")

    @property
    def cavity_volume(self) -> float:
        """Volume of the cavity, m^3 (in two dimensions m^2)."""
        return float(self.initial["cavity_volume"])

    @functools.cached_property
    def table(self) -> dict[str, np.ndarray]:
        """Metrics of every frame, column -> (frames,)."""
        path = self.folder / "metrics.csv"
        table = read_table(path)
        if (count := len(table["frame"])) > self.frame_count:
            raise UserError(f"{path}: has {count} frames, but the run has {self.frame_count}, so that a longer run has "
                            f"left it; make it anew: snakemake -j2 outputs/{self.scene.name}/{self.level}/{path.name}")
        return table

    @functools.cached_property
    def metrics(self) -> list[Metric]:
        """What the columns of the table mean."""
        return read_meanings(self.folder / "metrics.json")

    @functools.cached_property
    def least_energy(self) -> LeastEnergy | None:
        """What its oil would touch at rest in the fill and posture at its end; None where that is not known."""
        return read_least_energy(self.folder / "metrics.json")

    @property
    def events(self) -> list[Event]:
        """What happens in the run."""
        return events_of(self.scene, self.table, self.cavity_volume)

    @functools.cached_property
    def costs(self) -> list[dict[str, Any]]:
        """What the solver says of every segment."""
        return [read_costs(path) for path in self.cost_files]

    @property
    def cost_files(self) -> list[Path]:
        """The files in which it says so."""
        return [segment_path(self.folder, "costs", name, ".json") for name in self.segments]

    @functools.cached_property
    def effect_costs(self) -> dict[str, dict[str, str]]:
        """The table of effects: part -> its row."""
        with (self.folder / "effects.csv").open(encoding="utf-8") as file:
            return {row["part"]: row for row in csv.DictReader(file)}

    def size_of(self, names: Iterable[str]) -> int:
        """Return the bytes of files and folders of the run."""
        paths = [path for name in names for path in (self.folder / name, *(self.folder / name).rglob("*"))]
        own = {None, *self.segments}
        return sum(path.stat().st_size for path in paths
                   if path.is_file() and segment_of(PurePosixPath(path.relative_to(self.folder).as_posix())) in own)

    @functools.cached_property
    def taken(self) -> dict[str, dict[str, float]]:
        """What the stages took: stage -> wall, cpu (s) and memory (bytes)."""
        return taken_by(usage_files(self.folder / "logs", self.segments))
