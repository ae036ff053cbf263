"""Threads of a stage: what a user asks for, checked, and what libraries are told."""
import os

from pipeline.base.errors import UserError
from sim.cores import available_cores


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


def library_threads() -> int:
    """Return the threads for calls of libraries: ``OMP_NUM_THREADS``, set by Snakemake for a job, else all cores."""
    given = os.environ.get("OMP_NUM_THREADS", "")
    return int(given) if given.isdecimal() and int(given) else available_cores()
