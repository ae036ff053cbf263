"""The one place that reads and writes frames, their time index and checkpoints.

A frame is a VTK unstructured grid of vertices (``.vtu``), because ParaView, pyvista and meshio all open it; meshio
reads no ``.vtp`` and no LZ4, so the arrays are stored raw, and with Python 3.13.5, whose base64 no longer ends at a
padding, no raw ones either. Every array carries its unit (VTK's ``UNITS_LABEL``) and the parts of ``volume_fraction``
and ``fill`` carry the liquid's name, those of vectors X, Y and Z. Text is stored as UTF-8 bytes, to be read with
``bytes(mesh.field_data["liquids"]).decode()`` (``pipeline.base.vtk_files``).
"""
import dataclasses
import math
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np

from pipeline.base.errors import UserError
from pipeline.base.files import replacing
from pipeline.base.numpy_files import read_arrays, write_arrays
from pipeline.base.sequences import FRAMES_AGAIN, in_sequence

FRAME_SUFFIXES = (".vtu", ".vtp")
POINT_UNITS = {
    "id": "1", "phase": "1", "velocity": "m/s", "pressure": "Pa", "volume": "m**3", "volume_fraction": "1",
    "compression_rate": "1",
}
FIELD_UNITS = {
    "time": "s", "step": "1", "gravity": "m/s**2", "particle_spacing": "m", "fill": "m**3", "dimension": "1",
    "wall_contacts": "1", "pressure_iterations": "1", "viscosity_iterations": "1", "time_step": "s",
    "residual_maximum": "1", "pressure_limit_hit": "1", "viscosity_limit_hit": "1",
    "kinetic_energy": "J", "potential_energy": "J", "compression_maximum": "1",
    "film_particles": "1", "film_columns": "1", "film_exchanges": "1",
}
TEXTS = ("scene", "liquids", "units")


@dataclasses.dataclass
class FrameData:
    """The state of the liquids at one time, sorted by ``id``; SI units.

    Attributes
    ----------
    position : (n, dimension) float, m.
    id, phase : (n,) int; ``phase`` is the liquid with the largest fraction.
    velocity : (n, 3) float, m/s (third component 0 in 2D).
    pressure : (n,) float, Pa, with what gravity and interface tension keep out of the solve: their potentials.
    volume : (n,) float, m**3.
    volume_fraction : (n, liquids) float; 0 or 1 where the liquids do not mix.
    compression_rate : (n,) float, 1 at rest.
    time, step, gravity (3,), particle_spacing : s, 1, m/s**2, m.
    scene, liquids : names.
    statistics : solver statistics since the last frame, name -> number (units: ``FIELD_UNITS``).
    extra : further arrays per particle, name -> (n,) or (n, k) array.
    """

    position: np.ndarray
    id: np.ndarray
    phase: np.ndarray
    velocity: np.ndarray
    pressure: np.ndarray
    volume: np.ndarray
    volume_fraction: np.ndarray
    compression_rate: np.ndarray
    time: float
    step: int
    gravity: np.ndarray
    particle_spacing: float
    scene: str
    liquids: tuple[str, ...]
    statistics: dict[str, float] = dataclasses.field(default_factory=dict)
    extra: dict[str, np.ndarray] = dataclasses.field(default_factory=dict)

    @property
    def dimension(self) -> int:
        return self.position.shape[1]

    @property
    def fill(self) -> np.ndarray:
        """Volume of every liquid, (liquids,), m**3 (m**2 in 2D)."""
        return np.asarray(self.volume, dtype=np.float64) @ np.asarray(self.volume_fraction, dtype=np.float64)


def frame_path(folder: str | os.PathLike, index: int, suffix: str = ".vtu") -> Path:
    """Path of frame ``index`` in ``folder``."""
    return Path(folder) / f"frame_{index:05d}{suffix}"


def frames_of(folders: Iterable[str | os.PathLike]) -> list[Path]:
    """All frame files of several folders, in the order of time; raises as ``find_frames`` does."""
    return in_sequence((path for folder in folders for path in find_frames(folder)), FRAMES_AGAIN)


def find_frames(folder: str | os.PathLike) -> list[Path]:
    """All frame files in ``folder``, in the order of time.

    Raises
    ------
    UserError : there is no such folder, it holds no frame itself, or a frame is missing between others.
    """
    folder = Path(folder)
    if not folder.is_dir():
        raise UserError(f"{folder}: no such folder of frames; run the simulate stage first")
    paths = in_sequence((path for path in folder.glob("frame_*") if path.suffix in FRAME_SUFFIXES), FRAMES_AGAIN)
    if not paths:
        segments = sorted(path.name for path in folder.glob("segment_*"))
        if segments:
            allowed = " to ".join(dict.fromkeys((segments[0], segments[-1])))
            raise UserError(f"{folder}: frames are in folders of this folder; give one of them, {allowed}")
        raise UserError(f"{folder}: no frames (frame_00000.vtu ...) in this folder; run the simulate stage first")
    return paths


def write_frame(path: str | os.PathLike, frame: FrameData) -> None:
    """Write one frame; the suffix of ``path`` chooses VTK unstructured grid (``.vtu``) or poly data (``.vtp``).

    Arrays keep the precision they have. The file appears by rename.
    """
    from pipeline.base.vtk_files import write_vtk

    path = Path(path)
    if path.suffix not in FRAME_SUFFIXES:
        raise ValueError(f"{path}: a frame is written as {' or '.join(FRAME_SUFFIXES)}")
    with replacing(path) as partial:
        write_vtk(_to_vtk(frame, unstructured=path.suffix == ".vtu"), partial, compress=False)


def _to_vtk(frame: FrameData, *, unstructured: bool):
    """The frame as a vtkUnstructuredGrid or vtkPolyData of vertices."""
    import pyvista

    from pipeline.base.vtk_files import set_text

    count = len(frame.position)
    position = np.zeros((count, 3), dtype=np.asarray(frame.position).dtype)
    position[:, :frame.dimension] = frame.position
    mesh = pyvista.PolyData(position)
    if count:
        mesh.verts = np.column_stack([np.ones(count, np.int64), np.arange(count)]).ravel()
    if unstructured:
        mesh = mesh.cast_to_unstructured_grid()
    points = {
        "id": np.asarray(frame.id, np.int32), "phase": np.asarray(frame.phase, np.int32),
        "velocity": frame.velocity, "pressure": frame.pressure, "volume": frame.volume,
        "volume_fraction": frame.volume_fraction, "compression_rate": frame.compression_rate, **frame.extra,
    }
    fields = {
        "time": frame.time, "step": frame.step, "gravity": frame.gravity, "particle_spacing": frame.particle_spacing,
        "dimension": frame.dimension, "fill": frame.fill, **frame.statistics,
    }
    texts = {
        "scene": frame.scene, "liquids": "\n".join(frame.liquids),
        "units": "\n".join(f"{name}: {unit}" for name, unit in (POINT_UNITS | FIELD_UNITS).items()
                           if name in points or name in fields),
    }
    for name, values in points.items():
        mesh.GetPointData().AddArray(_vtk_array(name, np.asarray(values), POINT_UNITS, frame.liquids))
    for name, value in fields.items():
        numbers = np.atleast_1d(np.asarray(value))
        row = numbers.reshape(1, -1) if name in ("gravity", "fill") else numbers
        mesh.GetFieldData().AddArray(_vtk_array(name, row, FIELD_UNITS, frame.liquids))
    for name, text in texts.items():
        set_text(mesh, name, text)
    return mesh


def _vtk_array(name: str, values: np.ndarray, units: Mapping[str, str], liquids: Iterable[str]):
    from vtkmodules.util.numpy_support import numpy_to_vtk
    from vtkmodules.vtkCommonCore import vtkDataArray

    from pipeline.base.vtk_files import name_components

    array = numpy_to_vtk(np.ascontiguousarray(values), deep=True)
    array.SetName(name)
    if name in ("volume_fraction", "fill"):
        name_components(array, liquids)
    elif array.GetNumberOfComponents() == 3:
        name_components(array, "XYZ")
    if units.get(name, "1") != "1":
        array.GetInformation().Set(vtkDataArray.UNITS_LABEL(), units[name])
    return array


def read_frame(path: str | os.PathLike) -> FrameData:
    """Read a frame written by :func:`write_frame`.

    Raises
    ------
    UserError : the file is missing, or is no frame of this pipeline.
    DamagedFile : its checksum does not fit.
    """
    from pipeline.base.vtk_files import read_raw

    path = Path(path)
    if not path.is_file():
        raise UserError(f"{path}: no such frame; run the simulate stage first")
    if path.suffix not in FRAME_SUFFIXES:
        raise UserError(f"{path}: a frame is a {' or '.join(FRAME_SUFFIXES)} file")
    try:
        points, fields, coordinates = read_raw(path)
        missing = ({*POINT_UNITS} - {*points}) | ({"time", "step", "gravity", "dimension", *TEXTS} - {*fields})
        if missing:
            raise ValueError(f"without {', '.join(sorted(missing))}")
        return _from_arrays(points, fields, coordinates)
    except (ValueError, IndexError, KeyError, TypeError, ElementTree.ParseError) as error:
        reason = " ".join(str(error).split())
        raise UserError(f"{path}: is no frame of this pipeline ({reason}); run its segment again") from error


def read_course(paths: Iterable[Path]) -> Iterator[tuple[Path, FrameData]]:
    """Read the frames of a run one by one, in the order of time, each with its file.

    Raises
    ------
    UserError : as :func:`read_frame`, and where a frame is not later than the one before it.
    """
    before = -math.inf
    for path in paths:
        frame = read_frame(path)
        if frame.time <= before:
            raise UserError(
                f"{path}: is the frame of {frame.time:.6g} s, but the one before it is that of {before:.6g} s, "
                f"as after a copy under another name; remove its folder and {FRAMES_AGAIN}")
        before = frame.time
        yield path, frame


def frame_at(folder: Path, time: float | None) -> tuple[str, FrameData]:
    """Name and data of the frame of a folder that is nearest to a time in s; of the last one without."""
    frames = [(path.stem, read_frame(path)) for path in find_frames(folder)[slice(-1 if time is None else None, None)]]
    return min(frames, key=lambda found: 0.0 if time is None else abs(found[1].time - time))


def _from_arrays(points: dict[str, np.ndarray], fields: dict[str, np.ndarray], coordinates: np.ndarray) -> FrameData:
    """The frame that the arrays of a file make."""
    dimension = int(fields.pop("dimension")[0])
    if dimension not in (2, 3):
        raise ValueError(f"its dimension is {dimension}, but must be 2 or 3")
    fields.pop("fill")
    texts = {name: fields.pop(name).tobytes().decode() for name in TEXTS}
    liquids = tuple(texts["liquids"].split("\n"))
    shapes = {"velocity": (3,), "volume_fraction": (len(liquids),)}
    for name in POINT_UNITS:  # VTK knows no second axis of length 1
        points[name] = points[name].reshape(len(coordinates), *shapes.get(name, ()))
    return FrameData(
        position=coordinates[:, :dimension].copy(), **{name: points.pop(name) for name in POINT_UNITS},
        time=float(fields.pop("time")[0]), step=int(fields.pop("step")[0]), gravity=fields.pop("gravity").reshape(3),
        particle_spacing=float(fields.pop("particle_spacing")[0]), scene=texts["scene"],
        liquids=liquids,
        statistics={name: values[0].item() for name, values in fields.items()}, extra=points,
    )


def write_pvd(path: str | os.PathLike, entries: Iterable[tuple[float, str]]) -> None:
    """Write the time index of a series: ``entries`` holds (time in s, path relative to the ``.pvd`` file)."""
    lines = ['<?xml version="1.0"?>', '<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">',
             "  <Collection>"]
    lines += [f'    <DataSet timestep="{time!r}" part="0" file={quoteattr(str(file))}/>' for time, file in entries]
    lines += ["  </Collection>", "</VTKFile>", ""]
    with replacing(path) as partial:
        partial.write_text("\n".join(lines))


def save_checkpoint(path: str | os.PathLike, state: Mapping[str, object]) -> None:
    """Save named arrays, numbers and strings bit by bit (``.npz``, uncompressed); the file appears by rename.

    Raises
    ------
    TypeError : a value is no array, number or string.
    """
    arrays: dict[str, Any] = {}
    for name, value in state.items():
        arrays[name] = np.asarray(value)
        if arrays[name].dtype == object:
            raise TypeError(f"checkpoint entry {name!r} is a {type(value).__name__}; only arrays, numbers and strings")
    with replacing(path) as partial:
        write_arrays(partial, arrays)


def load_checkpoint(path: str | os.PathLike) -> dict[str, object]:
    """Read a checkpoint; what was saved as a number or string comes back as a NumPy scalar of the same bits.

    Raises
    ------
    UserError : the file is missing.
    DamagedFile : its checksum does not fit.
    """
    path = Path(path)
    if not path.is_file():
        raise UserError(f"{path}: no such checkpoint; run the segment before this one first")
    return {name: array[()] for name, array in read_arrays(path).items()}
