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
ABSENT, SHORT = 3, 4  # exit codes of the script
REASONS = {ABSENT: "Taichi finds no such device here",
           SHORT: "it ends long loops early, as Vulkan that is computed by the CPU does (Mesa's lavapipe)"}
CRASHED = "it cannot add in double precision, as the solver has to"
LONG = 100_000  # turns of a loop; lavapipe ends all after 65,535


def best_device() -> str:
    """Return what "auto" stands for: cuda where the solver can use an NVIDIA GPU, else cpu.

    Never vulkan or metal: Taichi does not tell what computes them, and not every scene can use them.
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
        return REASONS.get(code, CRASHED)
    if precision == "f64" and device in SINGLE_FUNCTIONS:
        return "it has powers and exponentials in single precision only, and the precision asked for is f64"
    return ""


@functools.cache
def _trial(device: str) -> int:
    """Exit code of a trial, in a process of its own: a driver may crash, and a process has one Taichi."""
    return subprocess.run([sys.executable, "-m", "sim.devices", device], cwd=Path(__file__).parents[1],
                          capture_output=True).returncode


def main(device: str) -> None:
    """Start Taichi on a device and add in double precision; exit with ABSENT or SHORT where it does not do it."""
    import taichi as ti

    from sim.runtime import NoDevice, initialize

    try:
        initialize("f32", 1, device)
    except NoDevice:
        sys.exit(ABSENT)
    total = ti.field(ti.f64, shape=())
    number = ti.field(ti.f64, shape=LONG)

    @ti.kernel
    def add():
        for i in number:
            number[i] = ti.cast(i, ti.f64)
        ti.loop_config(serialize=True)
        for i in range(LONG):
            total[None] += number[i]

    add()
    if total[None] != LONG * (LONG - 1) // 2:
        sys.exit(SHORT)


if __name__ == "__main__":
    main(sys.argv[1])
