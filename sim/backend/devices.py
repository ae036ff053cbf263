"""Which devices of this computer the solver can run on."""
import ctypes
import functools
import subprocess
import sys
from pathlib import Path

from sim.backend.choice import library

DEVICES = ("cpu", "cuda", "vulkan", "metal")
AUTO = "auto"
SINGLE_FUNCTIONS = ("vulkan", "metal")  # their powers and exponentials are in single precision only
ABSENT, SHORT = 3, 4  # exit codes of a trial (`sim.backend.device_trial`)
REASONS = {ABSENT: "{library} finds no such device here",
           SHORT: "it ends long loops early, as Vulkan that is computed by the CPU does (Mesa's lavapipe)"}
CRASHED = "it cannot add in double precision, as the solver has to"


def best_device() -> str:
    """Return what "auto" stands for: cuda where the solver can use an NVIDIA GPU, else cpu.

    Never vulkan or metal: the library does not tell what computes them, and not every scene can use them.
    """
    try:
        ctypes.CDLL("libcuda.so.1")  # that of the driver; looked for first, because a trial takes a second
    except OSError:
        return "cpu"
    return "cpu" if lack("cuda") else "cuda"


def usable_devices(precision: str = "f32") -> list[str]:
    """Return the devices here that the solver can run on."""
    return [device for device in DEVICES if not lack(device, precision)]


def lack(device: str, precision: str = "f32") -> str:
    """Return why the solver cannot run on a device here, in words that continue "but", empty where it can.

    Parameters
    ----------
    precision : of the real fields; the sums of the solver are in double precision in any case.
    """
    if device == "cpu":
        return ""
    if code := _trial(device):
        return REASONS.get(code, CRASHED).format(library=library().title)
    if precision == "f64" and device in SINGLE_FUNCTIONS:
        return "it has powers and exponentials in single precision only, and the precision asked for is f64"
    return ""


@functools.cache
def _trial(device: str) -> int:
    """Exit code of a trial, in a process of its own: a driver may crash, and a process has one start of the library."""
    return subprocess.run([sys.executable, "-m", "sim.backend.device_trial", device], cwd=Path(__file__).parents[2],
                          capture_output=True).returncode
