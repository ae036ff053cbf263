"""Cases that a device advances, to be compared with the CPU; run as a script, for one process has one device.

    python tests/on_device.py DEVICE SHARED.npz TARGET.npz

SHARED holds the particles of the eye and the states that the CPU continues from: the CPU, which runs first, writes it.
"""
import sys
from pathlib import Path

import cavities
import free_surface
import numpy as np

from pipeline.eye import cavity_mesh
from pipeline.scene import load_scene
from pipeline.simulate import build_solver
from pipeline.studies import determinism
from pipeline.voxelize import voxelize

ROOT = Path(__file__).parents[1]
HEIGHT = 0.04  # m, of the tank
STEPS = {"still": 10, "dam": 10, "eye": 5, "all effects": 2}  # before the state that is continued, and after it


def built(case: str, eye: dict[str, np.ndarray]):
    """Return the solver of a case; `eye` holds the particles of the eye."""
    if case == "still":
        return free_surface.still_tank("volume_incompressible", HEIGHT, 12, precision="f32")
    if case == "dam":
        return free_surface.dam("volume_incompressible", 8, precision="f32")
    if case == "eye":
        return build_solver(load_scene(ROOT / "config/scenes/tiny.yaml", "draft"), eye)
    return determinism.everything(determinism.Parameters(scheme="volume_incompressible", cavity="closed"))


def stepped(solver, number: int) -> dict:
    """Return the state after so many steps."""
    for _ in range(number):
        solver.step()
    return solver.state()


def main(device: str, shared: str, target: str) -> None:
    """Advance the cases, and what the CPU has got half way, and write the states."""
    from sim.runtime import initialize

    initialize("f32", 1, device)
    if device == "cpu":
        scene = load_scene(ROOT / "config/scenes/tiny.yaml", "draft")
        given = {f"eye.{name}": values for name, values in voxelize(scene, cavity_mesh(scene.eye)[0])[0].items()}
    else:
        given = dict(np.load(shared))
    results = {}
    for case, steps in STEPS.items():
        solver = built(case, cavities.part(given, "eye"))
        start = solver.state()
        middle = stepped(solver, steps)
        end = stepped(solver, steps)
        if device == "cpu":
            given |= {f"{case} middle.{name}": values for name, values in middle.items()}
        solver.restore(cavities.part(given, f"{case} middle"))
        continued = stepped(solver, steps)
        solver.restore(start)
        again = stepped(solver, steps)
        for name, state in (("middle", middle), ("end", end), ("continued", continued), ("again", again)):
            results |= {f"{case} {name}.{key}": values for key, values in state.items()}
    if device == "cpu":
        np.savez(shared, **given)
    np.savez(target, **results)


if __name__ == "__main__":
    main(*sys.argv[1:])
