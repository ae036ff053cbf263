"""Cases that a device advances, to be compared with the CPU; run as a script, for one process has one device.

    python -m helpers.on_device DEVICE SHARED.npz TARGET.npz CASE...

The CPU comes first: it writes the particles of the eye and the states to continue from, SHARED, which others read.
"""
import sys

import numpy as np

from helpers import cavities, free_surface
from studies.validation import determinism

HEIGHT = 0.04  # m, of the still tank
STEPS = 10  # before the state that is continued, and after it


def built(case: str, eye: dict[str, np.ndarray]):
    """Return the solver of a case: still, dam, eye, or "<scheme> <cavity>" with all effects.

    Parameters
    ----------
    eye : arrays of a round cavity, in which the eye has the effects of the tamponade. It is small: the interface in
        `tiny` takes more turns of loops than Vulkan on the CPU makes.
    """
    if case == "still":
        return free_surface.still_tank("volume_incompressible", HEIGHT, 8, dimension=3, precision="f32")
    if case == "dam":
        return free_surface.dam("volume_incompressible", 8, precision="f32")
    if case == "eye":
        more = (cavities.parameters("gravity"),
                cavities.parameters("interface_tension", coefficient=0.04, contact_angle=np.radians(18.2)))
        return cavities.injected(eye, "f32", more)
    scheme, cavity = case.split()
    return determinism.everything(determinism.Parameters(scheme=scheme, cavity=cavity))


def stepped(solver) -> dict:
    """Return the state after some steps, with the statistics of the last one."""
    for _ in range(STEPS):
        solver.step()
    return solver.state() | {f"statistics.{name}": value for name, value in solver.statistics.items()}


def main(device: str, shared: str, target: str, *cases: str) -> None:
    """Advance the cases twice, then what the CPU has got half way and the start once more; write the states."""
    from sim.backend.runtime import initialize

    initialize("f32", 1, device)
    if device == "cpu":
        given = {f"eye.{name}": values for name, values in cavities.cavity("circle", cavities.RADIUS).items()}
    else:
        given = dict(np.load(shared))
    found = {}
    for case in cases:
        solver = built(case, cavities.part(given, "eye"))
        start, middle, end = solver.state(), stepped(solver), stepped(solver)
        if device == "cpu":
            given |= {f"{case} middle.{name}": values for name, values in middle.items()}
        solver.restore(cavities.part(given, f"{case} middle"))
        continued = stepped(solver)
        solver.restore(start)
        again = stepped(solver)
        for name, state in (("middle", middle), ("end", end), ("continued", continued), ("again", again)):
            found |= {f"{case} {name}.{key}": values for key, values in state.items()}
    if device == "cpu":
        np.savez(shared, **given)
    np.savez(target, **found)


if __name__ == "__main__":
    main(*sys.argv[1:])
