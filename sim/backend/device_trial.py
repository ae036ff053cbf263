"""Try a device, in a process of its own: `python -m sim.backend.device_trial DEVICE`."""
import sys

from sim.backend.devices import ABSENT, SHORT
from sim.backend.language import ti
from sim.backend.runtime import NoDevice, initialize

LONG = 100_000  # turns of a loop; lavapipe ends all after 65,535


def main(device: str) -> None:
    """Start Taichi on a device and add in double precision; exit with ABSENT or SHORT where it does not do it."""
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
