"""How many threads the solver of a scene runs with."""
from pathlib import Path

from pipeline.base.threads import checked_threads
from pipeline.scenes.model import Scene
from sim.cores import USEFUL_THREADS, available_cores


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

    The number is the scene's or, where it leaves that open, all cores, of which the third and more leave one for
    drawing: with two, drawing takes less time than the simulation would lose, and waits for it.
    """
    cores = min(cores, available_cores())
    return min(scene.numerics.threads or min(cores if cores <= 2 else cores - 1, USEFUL_THREADS), cores)
