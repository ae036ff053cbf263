"""How many threads the solver of a scene runs with."""
from pathlib import Path

from pipeline.base.threads import checked_threads
from pipeline.scenes.model import Scene
from pipeline.scenes.volume import expected_particles
from sim.cores import USEFUL_THREADS, available_cores

# Fewer are done by one thread in the time in which a second one wakes up: at 5,000 a step takes 98 to 105 ms with one
# thread that keeps to its core, 93 to 116 ms with two.
PARTICLES_PER_THREAD = 4000


def chosen_threads(option: int | None, scene: Scene, path: Path) -> int:
    """Return what ``--threads`` asks for or, without it, ``numerics.threads`` of the scene in a file.

    Raises
    ------
    UserError : it is negative, or above the cores that this process may use.
    """
    if option is None:
        return checked_threads(scene.numerics.threads, f"{path}: numerics.threads")
    return checked_threads(option, "--threads")


def solver_threads(scene: Scene, cores: int) -> int:
    """Return how many threads the solver of a scene gets where Snakemake has a number of cores.

    The number is the scene's or, where it leaves that open, as many as pay, of at most all cores, of which the third
    and more leave one for drawing: with two, drawing takes less time than the simulation would lose, and waits for it.
    """
    cores = min(cores, available_cores())
    return min(scene.numerics.threads or min(cores if cores <= 2 else cores - 1, paying_threads(scene)), cores)


def paying_threads(scene: Scene) -> int:
    """Return the number of threads beyond which a solver gains nothing: one for every ``PARTICLES_PER_THREAD``."""
    return min(max(1, round(expected_particles(scene) / PARTICLES_PER_THREAD)), USEFUL_THREADS)
