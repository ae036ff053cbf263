"""The dam: a cube of n^3 particles that collapses in a box, the same for both programs (NumPy only).

A lattice of spacing dx = 1/n fills [-1, 0] x [0, 1] x [-0.5, 0.5] m; the box is [-1, 1] x [0, 2] x [-0.5, 0.5] m. Of
two liquids the first is the lower half, and both have a tension (Akinci et al. 2013, eqs. 1 and 3).
"""
import json
import time
from pathlib import Path

import numpy as np

GRAVITY = 9.81  # m/s^2
DENSITIES = {1: (1000.0,), 2: (1000.0, 800.0)}  # kg/m^3, by the number of liquids
TENSION = {1: 0.0, 2: 1.0}  # coefficient of cohesion and of curvature
KINEMATIC_VISCOSITY = 0.01  # m^2/s
TIME_STEP = 1e-3  # s
DENSITY_ERROR = 1e-4  # mean relative compression that the density solve may leave
DIVERGENCE_ERROR = 1e-3
LEAST_ITERATIONS = 2
FIRST_STEP = 150  # timed from here: the liquid has then hit the floor


class Stopwatch:
    """Wall and CPU seconds of every step, all threads together."""

    def __init__(self):
        self.wall, self.cpu = [], []
        self.start()

    def start(self) -> None:
        """Begin a step."""
        self._wall, self._cpu = time.perf_counter(), time.process_time()

    def stop(self) -> None:
        """End a step."""
        self.wall.append(time.perf_counter() - self._wall)
        self.cpu.append(time.process_time() - self._cpu)


def lower_layers(n: int) -> int:
    """Layers of particles of the lower of two liquids."""
    return n // 2


def result(program: str, n: int, watch: Stopwatch, iterations: list, position: np.ndarray, velocity: np.ndarray,
           liquid: np.ndarray, liquids: int, walls: int, simulated: float) -> dict:
    """Return what one run has to say; medians over the steps from ``FIRST_STEP`` on. `liquid` is that of a particle."""
    timed = slice(FIRST_STEP, None) if len(watch.wall) > FIRST_STEP else slice(None)
    density, divergence = np.array(iterations, float).T
    speed = np.sqrt((velocity**2).sum(axis=1))
    return {
        "program": program, "n": n, "liquids": liquids, "particles": len(position), "wall_particles": walls,
        "steps": len(watch.wall),
        "simulated_s": simulated, "wall_s_per_step": float(np.median(watch.wall[timed])),
        "least_wall_s_per_step": float(np.min(watch.wall[timed])),
        "cpu_s_per_step": float(np.mean(watch.cpu[timed])), "density_iterations": float(density[timed].mean()),
        "divergence_iterations": float(divergence[timed].mean()), "top_speed": float(speed.max()),
        "kinetic_energy": float(0.5 / n**3 * (np.array(DENSITIES[liquids])[liquid] * speed**2).sum()),
        "front": float(np.sort(position[:, 0])[-len(position) // 1000]),
    } | compression(position, 1.0 / n)


def write(path: Path, data: dict) -> None:
    """Write a result for the program that compares."""
    path.write_text(json.dumps(data, indent=1) + "\n")


def compression(position: np.ndarray, spacing: float) -> dict[str, float]:
    """Relative compression of the particles with a full neighborhood, by one measure for both programs.

    The cubic spline with support 2 dx, summed over the particles and divided by the sum over a lattice; only
    particles farther than a support from the walls and with a sum above 0.9 count, as those below are at the surface.
    """
    support = 2.0 * spacing
    low, high = np.array([-1.0, 0.0, -0.5]) + support, np.array([1.0, 2.0, 0.5]) - support
    cells = np.floor((position - position.min(axis=0)) / support).astype(int)
    key = (cells[:, 0] * 100003 + cells[:, 1]) * 100003 + cells[:, 2]
    order = np.argsort(key, kind="stable")
    sorted_key, total = key[order], np.zeros(len(position))
    for step in np.ndindex(3, 3, 3):
        shift = np.array(step) - 1
        wanted = ((cells[:, 0] + shift[0]) * 100003 + cells[:, 1] + shift[1]) * 100003 + cells[:, 2] + shift[2]
        begin = np.searchsorted(sorted_key, wanted)
        count = np.searchsorted(sorted_key, wanted, side="right") - begin
        for k in range(count.max(initial=0)):
            has = np.flatnonzero(count > k)
            other = position[order[begin[has] + k]]
            total[has] += cubic_spline(np.sqrt(((position[has] - other) ** 2).sum(axis=1)), support)
    lattice = np.stack(np.meshgrid(*[np.arange(-2, 3) * spacing] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    relative = total / cubic_spline(np.sqrt((lattice**2).sum(axis=1)), support).sum()
    inside = ((position > low) & (position < high)).all(axis=1) & (relative > 0.9)
    excess = np.maximum(relative[inside] - 1.0, 0.0)
    return {"mean_compression": float(excess.mean()), "largest_compression": float(excess.max(initial=0.0)),
            "counted_particles": int(inside.sum())}


def cubic_spline(distance: np.ndarray, support: float) -> np.ndarray:
    """Cubic spline in 3D with compact support, 1/m^3."""
    q = distance / support
    inner = 6.0 * (q**3 - q**2) + 1.0
    return 8.0 / (np.pi * support**3) * np.where(q <= 0.5, inner, 2.0 * np.maximum(1.0 - q, 0.0) ** 3)
