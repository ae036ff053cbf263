"""A run from Python: the rules of the Snakefile make it, and an object gives its tables, frames, surfaces, pictures."""
import functools
import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, overload

import numpy as np
from markupsafe import Markup
from PIL import Image

from pipeline.base import page
from pipeline.base.errors import UserError
from pipeline.base.frame_files import FrameData, read_frame
from pipeline.base.words import NO_ADVICE
from pipeline.library.changes import changed_scene
from pipeline.library.metrics_table import MetricsTable
from pipeline.library.workflow_call import make
from pipeline.measures.shown import shown_metrics
from pipeline.pages.headlines import headlines_of
from pipeline.pages.run_page import NOT_COMPARED
from pipeline.runs.run_folder import RunFolder
from pipeline.runs.segments import segment_path
from pipeline.scenes.effects import illustration_in_words
from pipeline.scenes.folders import SCENES, scene_path
from pipeline.scenes.load import load_scene
from pipeline.scenes.model import Scene
from pipeline.surfaces.saved_frame import SavedFrame
from pipeline.web.embedded import data_url, webp
from pipeline.workflow.command import project_folder
from sim.cores import available_cores

if TYPE_CHECKING:
    import pyvista

OUTPUTS = Path("outputs")
PAGE = "index.html"                            # all else of a run is made on the way to it
BY_SEGMENT = ("frames", "surfaces", "images")  # what has a folder per segment
WHOLE = {"frames": "frames/frames.pvd", "surfaces": "run.pvd", "images": "movie.mp4"}  # what is made of all of them
PICTURE_WIDTH = 640                            # pixels, of the last picture beside the numbers


def relative(path: Path) -> Path:
    """Return a path as people read it: from the folder of the process."""
    return Path(os.path.relpath(path))


def run(scene: str, accuracy: str = "draft", *, folder: str | os.PathLike[str] | None = None, name: str | None = None,
        want: Sequence[str] = (PAGE,), cores: int = 2, device: str | None = None, progress: bool = True,
        **changes: Any) -> "Run":
    """Run a scene and return its results, as ``snakemake outputs/<scene>/<level>/index.html`` does.

    Files that exist and are up to date are not made again. A run that was interrupted goes on from its last checkpoint.

    Parameters
    ----------
    scene : name of the scene, as ``python -m pipeline.scene --scenes`` lists it.
    accuracy : level of ``config/accuracy.yaml``: "draft", "standard", "fine" or one of your own.
    folder : project folder, with ``config`` and ``outputs``; by default the current folder, or the nearest one above it
        that has scenes. If there are none, ``config`` is copied there.
    name : name of the scene with the changes; by default the name of the scene and a digest of the changes.
    want : files of the run to make, such as "metrics.csv", or "frames", "surfaces", "images"; by default all.
    cores : number of cores that may be used, as after Snakemake's ``-j``.
    device : device of the solver: "cpu", "cuda" or "vulkan"; by default what the scene says.
    progress : show a progress bar on standard error.
    **changes : keys of the scene with their values, nested as in ``output={"duration": "2 s"}`` or dotted as in
        ``**{"effects.injection.fill": "90 %"}``. A number is in SI units, a text carries its unit, and None removes
        what the scene inherits. The changed scene is kept as a file in ``config/scenes``.

    Returns
    -------
    The results, read from the disk when they are asked for.

    Raises
    ------
    UserError : the scene has errors, one sentence for each; or a stage failed, with its sentence.

    Examples
    --------
    >>> run("tamponade", **{"output.duratoin": "2 s"})  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    pipeline.base.errors.UserError: ...: output.duratoin is not known (did you mean duration?); known here are ...
    """
    if not 1 <= cores <= available_cores():
        raise UserError(f"cores is {cores}, but must be at least 1 and at most {available_cores()}, the cores that "
                        "can be used here")
    project = project_folder(folder)
    made = Run(project / OUTPUTS / changed_scene(relative(project / SCENES), scene, changes, accuracy, name) / accuracy)
    made.make(*want, cores=cores, device=device, progress=progress)
    return made


def open_run(folder: str | os.PathLike[str]) -> "Run":
    """Open the results of a run in ``outputs/<scene>/<level>``, without running anything.

    Parameters
    ----------
    folder : folder of the results. It may have been moved or copied from another computer.

    Returns
    -------
    The results, read from the disk when they are asked for.

    Raises
    ------
    UserError : the folder holds no run.
    """
    opened = Run(Path(folder).resolve())
    opened.scene  # noqa: B018 - whether it can be read
    return opened


class Run:
    """The results of a run in ``outputs/<scene>/<level>``; a notebook shows its numbers and its last picture.

    Nothing is read before it is asked for. Lengths are in m, times in s. What has not been made yet is a
    :class:`UserError` that names the call of :meth:`make` that makes it.

    Attributes
    ----------
    folder : folder of the results.
    """

    def __init__(self, folder: Path):
        self.folder = folder

    def make(self, *want: str, cores: int = 2, device: str | None = None, progress: bool = True) -> None:
        """Make more files of this run, as :func:`run` does.

        Parameters
        ----------
        *want : files, such as "bodies.csv", "film.mp4" or "estimate.html", or "frames", "surfaces", "images".
        cores : number of cores that may be used.
        device : device of the solver; by default what the scene says.
        progress : show a progress bar on standard error.

        Raises
        ------
        UserError : something could not be made.
        """
        project = self.folder.parents[2]
        scene = load_scene(scene_path(self.folder.parent.name, relative(project / SCENES)), self.folder.name)
        segments = [] if scene.output.until_rest else scene.segment_names  # how many there will be is not known then
        folder = self.folder.relative_to(project)
        files = [file for one in want for file in (
            [segment_path(folder, one, name) for name in segments] or [folder / WHOLE[one]] if one in BY_SEGMENT else
            [folder / one])]
        make(project, [str(file) for file in files], cores=cores, device=device, progress=progress)
        for known in ("_files", "metrics"):
            vars(self).pop(known, None)

    @functools.cached_property
    def _files(self) -> RunFolder:
        return RunFolder(self.folder)

    @property
    def scene(self) -> Scene:
        """The scene in SI units, with every default."""
        return self._files.scene

    @functools.cached_property
    def metrics(self) -> MetricsTable:
        """What was measured: name -> (frames,) float64; ``run.metrics.unit(name)`` is the unit of a column."""
        for file in ("metrics.csv", "metrics.json"):
            self._made(self.folder / file)
        return MetricsTable(self._files.table, self._files.metrics)

    @property
    def frames(self) -> "Frames":
        """The particles at all times, a sequence of :class:`FrameData`; slices are sequences too."""
        return Frames([frame.particles for frame in self._files.frames])

    @property
    def times(self) -> np.ndarray:
        """Times of the frames, (frames,), s."""
        return self._files.times

    @property
    def files(self) -> dict[str, Path]:
        """Files for readers that have been made: name -> path."""
        return {path.name: path for path in sorted(self.folder.iterdir()) if path.is_file()}

    def frame_at(self, time: float) -> int:
        """Return the number of the frame nearest to a time, counted from 0.

        Parameters
        ----------
        time : simulated time, s.

        Raises
        ------
        UserError : the run does not last so long.
        """
        times = self.times
        if not times[0] <= time <= times[-1]:
            raise UserError(f"time is {time:g} s, but must be at least 0 and at most {times[-1]:g} s, the end of "
                            f"{self.scene.name}")
        return int(np.abs(times - time).argmin())

    def surfaces(self, frame: int = -1) -> dict[str, "pyvista.PolyData"]:
        """Return the closed surface of every liquid in a frame: name of the liquid -> mesh in m.

        Parameters
        ----------
        frame : number of the frame, counted from 0, or from the end if negative.

        Raises
        ------
        UserError : there is no such frame, or its surfaces have not been made.
        """
        saved = self._frame(frame)
        self._made(saved.surfaces)
        return saved.surfaces_of(liquid.name for liquid in self.scene.liquids)

    def wall(self, frame: int = -1) -> "pyvista.PolyData":
        """Return the wall of the eye in a frame, a mesh in m.

        Its points have ``contact_distance``, m: the distance to the contact line, positive where oil touches. Its
        triangles have ``region``, the part of the retina as a whole number.

        Parameters
        ----------
        frame : number of the frame, counted from 0, or from the end if negative.

        Raises
        ------
        UserError : there is no such frame, or its surfaces have not been made.
        """
        saved = self._frame(frame)
        self._made(saved.surfaces)
        return saved.read_wall()

    def picture(self, time: float | None = None) -> Image.Image:
        """Return the cross-section at the frame nearest to a time.

        Parameters
        ----------
        time : simulated time, s; by default the end.

        Raises
        ------
        UserError : the run does not last so long, or its pictures have not been made.
        """
        saved = self._frame(-1 if time is None else self.frame_at(time))
        with Image.open(self._made(self._files.picture_of(saved))) as file:
            return file.convert("RGB")

    def plot(self, name: str = "overview") -> Image.Image:
        """Return the plot of a metric over time.

        Parameters
        ----------
        name : name of the metric; by default those that matter most, on one sheet.

        Raises
        ------
        UserError : there is no such plot.
        """
        with Image.open(self._made(self.folder / "plots" / f"{name}.png")) as file:
            return file.convert("RGB")

    def _repr_html_(self) -> str:
        scene, parts = self.scene, []
        if (self.folder / "metrics.csv").is_file():
            shown = shown_metrics(dict(self.metrics), self.metrics.metrics)
            numbers = headlines_of(scene, shown)
            parts += [page.bullets([page.joined(page.bold(one.number), one.meaning) for one in numbers]),
                      page.paragraph(illustration_in_words(scene))]
        if (self.folder / "images").is_dir():
            image = self.picture()
            image.thumbnail((PICTURE_WIDTH, PICTURE_WIDTH))
            parts += [Markup('<img alt="{}, at the end" src="{}">').format(
                self._files.title, data_url(webp(image), "image/webp"))]
        links = [page.link(name, str(relative(path))) for name, path in self.files.items()
                 if path.suffix in (".html", ".mp4", ".csv")]
        return str(Markup("\n").join([
            Markup("<h3>{}: {}</h3>").format(self._files.title, scene.accuracy), *parts,
            page.paragraph(*links), page.paragraph(*[NO_ADVICE, NOT_COMPARED] * (scene.container is None))]))

    def __repr__(self) -> str:
        return f"<run of {self.folder.parent.name} at {self.folder.name}: {relative(self.folder)}>"

    def _frame(self, frame: int) -> SavedFrame:
        count = self._files.frame_count
        if not -count <= frame < count:
            raise UserError(f"frame is {frame}, but must be at least {-count} and at most {count - 1}: "
                            f"{self.scene.name} has {count} frames")
        return self._files.frames[frame]

    def _made(self, path: Path) -> Path:
        """A path in the folder of the run, which must be there."""
        if not path.exists():
            wanted = path.relative_to(self.folder).parts[0]
            wanted = "metrics.csv" if wanted in ("plots", "metrics.json") else wanted
            raise UserError(f"{relative(path)}: has not been made; make it with `.make(\"{wanted}\")`")
        return path


class Frames(Sequence[FrameData]):
    """The particles of a run at all times; a frame is read when it is asked for."""

    def __init__(self, paths: Sequence[Path]):
        self.paths = list(paths)

    @overload
    def __getitem__(self, index: int) -> FrameData: ...

    @overload
    def __getitem__(self, index: slice) -> "Frames": ...

    def __getitem__(self, index: int | slice) -> "FrameData | Frames":
        return Frames(self.paths[index]) if isinstance(index, slice) else read_frame(self.paths[index])

    def __iter__(self) -> Iterator[FrameData]:
        return map(read_frame, self.paths)

    def __len__(self) -> int:
        return len(self.paths)

    def __repr__(self) -> str:
        return f"<{len(self)} frames>"
