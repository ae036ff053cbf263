"""The file ``initial.npz``: liquid and wall particles at the start, and the signed distance to the wall."""
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.base.errors import UserError
from pipeline.base.numpy_files import read_arrays, write_arrays
from pipeline.cavity.signed_distance_grid import SignedDistance


def initial_arrays(fluid_position: np.ndarray, walls: dict[str, np.ndarray], distance: SignedDistance,
                   cavity_volume: float, particle_spacing: float,
                   fluid_volume: np.ndarray | None = None) -> dict[str, np.ndarray]:
    """Arrays of ``initial.npz``; without volumes (n,) of their own the particles share that of the cavity exactly."""
    count, dimension = fluid_position.shape
    if fluid_volume is None:
        fluid_volume = np.full(count, cavity_volume / count)
    arrays: dict[str, Any] = {
        "fluid_position": fluid_position, "fluid_volume": fluid_volume, **walls,
        "sdf_values": distance.values, "sdf_origin": distance.origin, "sdf_cell": np.float64(distance.cell),
        "cavity_volume": np.float64(cavity_volume), "particle_spacing": np.float64(particle_spacing),
        "dimension": np.int64(dimension),
    }
    return arrays


NAMES = ("fluid_position", "fluid_volume", "wall_position", "wall_volume", "wall_distance", "sdf_values", "sdf_origin",
         "sdf_cell", "cavity_volume", "particle_spacing", "dimension")


def save_initial(path: str | Path, arrays: dict[str, Any]) -> None:
    """Write ``initial.npz``."""
    write_arrays(path, arrays)


def load_initial(path: str | Path) -> dict[str, np.ndarray]:
    """Read ``initial.npz``.

    Raises
    ------
    UserError : the file is missing, or of another kind.
    DamagedFile : its checksum does not fit.
    """
    if not Path(path).is_file():
        raise UserError(f"{path}: no such file; run the voxelize stage first")
    arrays = read_arrays(path)
    if missing := [name for name in NAMES if name not in arrays]:
        raise UserError(f"{path}: is not written by the voxelize stage (without {', '.join(missing)}); run it again")
    return {name: arrays[name] for name in NAMES}
