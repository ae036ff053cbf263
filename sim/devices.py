"""Which devices of this computer the solver can run on.

Run as a script it tries one: `python -m sim.devices DEVICE`.
"""
import ctypes
import functools
import subprocess
import sys
from pathlib import Path

DEVICES = ("cpu", "cuda", "vulkan", "metal")
AUTO = "auto"
SINGLE_FUNCTIONS = ("vulkan", "metal")  # their powers and exponentials are in single precision only
ABSENT = 3  # exit code of the script


def best_device() -> str:
    """Return what "auto" stands for: cuda where the solver can use an NVIDIA GPU, else cpu.

    Never vulkan: it may be drawn by the CPU (lavapipe), slower than the CPU itself, and Taichi does not tell.
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
    code = _trial(device)
    if code == ABSENT:
        return "Taichi finds no such device here"
    if code:
        return "this device cannot compute in double precision, which the sums of the solver need"
    if precision == "f64" and device in SINGLE_FUNCTIONS:
        return "it has powers and exponentials in single precision only, and the precision asked for is f64"
    return ""


@functools.cache
def _trial(device: str) -> int:
    """Exit code of a trial, in a process of its own: a driver may crash, and a process has one Taichi."""
    return subprocess.run([sys.executable, "-m", "sim.devices", device], cwd=Path(__file__).parents[1],
                          capture_output=True).returncode


def main(device: str) -> None:
    """Start Taichi on a device and add numbers in double precision; exit with ABSENT where it is not there."""
    import taichi as ti

    from sim.runtime import NoDevice, initialize

    try:
        initialize("f32", 1, device)
    except NoDevice:
        sys.exit(ABSENT)
    total = ti.field(ti.f64, shape=())

    @ti.kernel
    def add():
        for i in range(100):
            total[None] += ti.sqrt(ti.cast(i * i, ti.f64)) + 1e-12

    add()
    if abs(total[None] - 4950.0 - 1e-10) > 1e-11:
        sys.exit(f"the sum is {total[None]}")


if __name__ == "__main__":
    main(sys.argv[1])
