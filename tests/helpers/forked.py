"""Programs in processes that begin with the libraries imported: most of what a short call costs else."""
import multiprocessing
import os
import runpy
import subprocess
import sys
import tempfile
from pathlib import Path

from sim.backend.choice import library

ROOT = Path(__file__).parents[2]
library().silence()
_forks = multiprocessing.get_context("forkserver")
_forks.set_forkserver_preload([
    "snakemake.cli", "snakemake.report", library().module, "scipy.optimize", "scipy.spatial", "pyvista",
    "trimesh.creation", "matplotlib.figure", "pydantic", "pint"])


def _main(module: str, arguments: tuple[str, ...], folder: Path, output: str, errors: str) -> None:
    """Be ``python -m module`` in a folder, with the code that is there or else this project's."""
    os.setsid()
    os.chdir(folder)
    writing = os.O_WRONLY | os.O_APPEND
    for source, target in ((os.open(os.devnull, os.O_RDONLY), 0), (os.open(output, writing), 1),
                           (os.open(errors, writing), 2)):
        os.dup2(source, target)
    own = folder if (folder / "pipeline").is_dir() else ROOT
    os.environ["PYTHONPATH"] = str(own)
    sys.path.insert(0, str(own))
    sys.argv = [module, *arguments]
    runpy.run_module(module, run_name="__main__", alter_sys=True)


def _run(*process: object) -> int:
    started = _forks.Process(target=_main, args=process)
    started.start()
    started.join()
    return started.exitcode


def snakemake(folder: Path, arguments: tuple[str, ...], log: Path) -> int:
    """Run Snakemake in a folder to its end; return its exit code. All that it prints goes into ``log``."""
    log.write_text("")
    return _run("snakemake", ("-j2", *arguments), folder, str(log), str(log))


def run(module: str, *arguments: object, folder: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """Run ``python -m module`` with arguments in a folder to its end."""
    words = tuple(map(str, arguments))
    with tempfile.TemporaryDirectory() as written:
        files = [Path(written, name) for name in ("output", "errors")]
        for file in files:
            file.touch()
        code = _run(module, words, folder, *map(str, files))
        return subprocess.CompletedProcess([module, *words], code, *(file.read_text() for file in files))
