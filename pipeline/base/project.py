"""Where the files of the project are that are no Python: configuration, rules, texts of reports.

In a checkout they are beside the packages; a wheel carries a copy of them inside of this package.
"""
from pathlib import Path

PACKAGE = Path(__file__).parents[1]
SNAKEFILE = "Snakefile"
PROJECT = PACKAGE.parent if (PACKAGE.parent / SNAKEFILE).is_file() else PACKAGE / "project"


def is_project(folder: Path) -> bool:
    """Tell whether a folder holds a configuration with scenes."""
    return (folder / "config" / "scenes").is_dir() and (folder / "config" / "materials.yaml").is_file()


def project_around(folder: Path) -> Path | None:
    """Return the folder, or the nearest one above it, that holds a configuration with scenes."""
    return next((one for one in (folder, *folder.parents) if is_project(one)), None)
