"""The file of the calibration: what this computer takes for what; it is refused once code or computer have changed."""
import functools
import hashlib
import json
import os
import platform
from pathlib import Path

import taichi

from pipeline.digest import ROOT, call_digest
from pipeline.errors import UserError
from sim.effects import REGISTRY
from sim.schemes import REGISTRY as SCHEMES

CALIBRATION = Path("outputs/calibration.json")
MODULES = ("pipeline.calibrate", "pipeline.reconstruct", "pipeline.render", "pipeline.metrics", "pipeline.voxelize")


def identity() -> dict[str, str]:
    """Return what a calibration holds for: the code that was timed, and the computer."""
    return {"code": _code(), "computer": _computer()}


@functools.cache
def _code() -> str:
    digest = hashlib.sha256()
    for module in MODULES:
        digest.update(call_digest(module, {*REGISTRY, *SCHEMES}, "").encode())
    for path in sorted((ROOT / "config" / "calibration").glob("*.yaml")):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _computer() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        lines = []
    model = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), "")
    versions = f"Python {platform.python_version()}, Taichi {'.'.join(map(str, taichi.__version__))}"
    return f"{model or platform.processor() or platform.machine()}, {os.cpu_count()} cores, {versions}"


def load_calibration(path: Path = CALIBRATION) -> dict:
    """Read a calibration.

    Raises
    ------
    UserError : there is none, it is damaged, or it was made with other code or on another computer.
    """
    again = "run `python -m pipeline.estimate --calibrate`"
    if not path.is_file():
        raise UserError(f"{path}: no such file; {again}")
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
        made = {key: data[key] for key in ("code", "computer")}
        data["parts"], data["stages"], data["compilation"]
    except (json.JSONDecodeError, UnicodeDecodeError, KeyError, TypeError) as error:
        raise UserError(f"{path}: is no calibration ({error}); {again}") from error
    for key, value in identity().items():
        if made[key] != value:
            what = "other code" if key == "code" else f"another computer ({made[key]}; here {value})"
            raise UserError(f"{path}: was made with {what}; {again}")
    return data
