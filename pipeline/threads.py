"""How many threads a stage runs with: what users ask for, checked, and what libraries are told."""
import os
from pathlib import Path

from pipeline.errors import UserError
from pipeline.scene_model import Scene
from sim.cores import USEFUL_THREADS, available_cores


def checked_threads(threads: int, where: str) -> int:
    """Return a number of threads that a user asks for; 0 stands for as many as are useful.

    Parameters
    ----------
    where : option, or file and key, that errors name.

    Raises
    ------
    UserError : it is negative, or above the cores that this process may use.
    """
    cores = available_cores()
    if not 0 <= threads <= cores:
        raise UserError(f"{where} is {threads}, but must be at least 0 (as many as are useful) and at most {cores}, "
                        "the cores that can be used here")
    return threads


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


def library_threads() -> int:
    """Return the threads for calls of libraries: ``OMP_NUM_THREADS``, set by Snakemake for a job, else all cores."""
    given = os.environ.get("OMP_NUM_THREADS", "")
    return int(given) if given.isdecimal() and int(given) else available_cores()
