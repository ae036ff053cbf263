"""Snakemake in processes that begin with the libraries imported: half of what a plan costs else."""
import multiprocessing
import os
import runpy
import sys
from pathlib import Path

_forks = multiprocessing.get_context("forkserver")
_forks.set_forkserver_preload(["snakemake.cli", "snakemake.report", "taichi", "scipy.optimize", "pyvista", "trimesh"])


def _main(folder: Path, arguments: tuple[str, ...], log: Path) -> None:
    """Be ``python -m snakemake`` with the code that is in the folder."""
    os.setsid()
    os.chdir(folder)
    for source, target in ((os.open(os.devnull, os.O_RDONLY), 0), (os.open(log, os.O_WRONLY), 1), (1, 2)):
        os.dup2(source, target)
    os.environ["PYTHONPATH"] = str(folder)
    sys.path.insert(0, str(folder))
    sys.argv = ["snakemake", "-j2", *arguments]
    runpy.run_module("snakemake", run_name="__main__", alter_sys=True)


def run(folder: Path, arguments: tuple[str, ...], log: Path) -> int:
    """Run Snakemake in a folder to its end; return its exit code. All that it prints goes into ``log``."""
    log.write_text("")
    process = _forks.Process(target=_main, args=(folder, arguments, log))
    process.start()
    process.join()
    return process.exitcode
