"""Snakemake with the rules of this project in any folder: `eye-oil outputs/tamponade/draft/index.html`.

The folder holds `config` and gets `outputs`. Where there is no `config` yet, that of the project is copied there. All
arguments are Snakemake's; without `-j` it takes two cores. `--version` and `--help` copy nothing.
"""
import importlib.metadata
import os
import shutil
import sys
from pathlib import Path

from pipeline.base.cli import run
from pipeline.base.errors import UserError
from pipeline.base.files import replacing_folder
from pipeline.base.origin import release
from pipeline.base.project import PROJECT, SNAKEFILE, is_project, project_around

CONFIG = Path("config")
CORES = ("-j", "-c", "--jobs", "--cores")
HELP = ("-h", "--help")
VERSION = ("-v", "--version")


def main() -> None:
    """Command line: ``eye-oil [SNAKEMAKE ARGUMENTS]``."""
    run(lambda: _start(sys.argv[1:]))


def _start(arguments: list[str]) -> None:
    if {*VERSION} & {*arguments}:
        print(f"eye-oil {release()}, Snakemake {importlib.metadata.version('snakemake')}")
        return
    if {*HELP} & {*arguments}:
        print(__doc__, flush=True)
        os.execv(sys.executable, [sys.executable, "-m", "snakemake", "--help"])
    folder = project_folder(Path.cwd())
    cores = [] if any(one.startswith(CORES) for one in arguments) else ["-j2"]
    os.execv(sys.executable, snakemake_command(folder, *cores, *arguments))


def snakemake_command(folder: Path, *arguments: str) -> list[str]:
    """Return the command that runs Snakemake in the folder of a project, with its own rules or those of this code."""
    rules = folder if (folder / SNAKEFILE).is_file() else PROJECT
    return [sys.executable, "-m", "pipeline.workflow.start", "--snakefile", str(rules / SNAKEFILE), "--directory",
            str(folder), "--workflow-profile", str(rules / "profiles" / "default"), *arguments]


def project_folder(folder: str | os.PathLike | None = None) -> Path:
    """Return the folder that holds ``config`` and ``outputs``; where there is no ``config`` yet, it is copied there.

    Parameters
    ----------
    folder : by default the folder of the process or the nearest one above it that has scenes, else that of the process.

    Raises
    ------
    UserError : the folder has a ``config`` of something else.
    """
    chosen = Path(folder).resolve() if folder is not None else project_around(Path.cwd()) or Path.cwd()
    if not is_project(chosen):
        config = chosen / CONFIG
        if config.exists():
            raise UserError(f"{config}: holds no scenes of this project; choose another folder")
        print(f"{config}: scenes, liquids and accuracy levels are copied here, to be read and changed", file=sys.stderr)
        with replacing_folder(config) as partial:
            shutil.copytree(PROJECT / CONFIG, partial, dirs_exist_ok=True)
    return chosen


if __name__ == "__main__":
    main()
