"""What the surroundings of a stage may not change: settings of a user that are meant for other programs."""
import os
import sys
import sysconfig
import warnings
from collections.abc import Iterable
from pathlib import Path

from sim.backend.choice import NoBackend, library

# Settings of Matplotlib: a backend that this version does not know would end every stage.
FOREIGN = ("MPLBACKEND",)
# Of Python itself: made errors, what libraries warn of would end every stage.
WARNINGS = "PYTHONWARNINGS"
UNTOLD = (DeprecationWarning, PendingDeprecationWarning, ImportWarning, ResourceWarning)  # by Python's own filters


def shut_out_foreign_settings() -> None:
    """Forget settings for other programs, and let packages in PYTHONPATH take the place of no installed ones.

    Where no home is named, it is that of the account: the library of kernels ends the process without one.
    """
    os.environ.setdefault("HOME", str(Path("~").expanduser()))
    for name in FOREIGN:
        os.environ.pop(name, None)
    if os.environ.pop(WARNINGS, ""):
        warnings.resetwarnings()
        for category in UNTOLD:
            warnings.simplefilter("ignore", category)
    named = [Path(entry) for entry in os.environ.get("PYTHONPATH", "").split(os.pathsep) if entry]
    sys.path[:] = behind_installed(sys.path, named, Path(sysconfig.get_path("purelib")))


def refuse_missing_backend() -> None:
    """End the process with one sentence where the library of kernels that the environment names is not there."""
    try:
        library()
    except NoBackend as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)


def behind_installed(path: Iterable[str], named: Iterable[Path], installed: Path) -> list[str]:
    """Return a search path with folders of other packages behind the installed ones.

    Parameters
    ----------
    path : entries of ``sys.path``.
    named : folders that PYTHONPATH names; those that hold this project stay where they are.
    installed : folder of the packages that are installed.
    """
    entries = list(path)
    foreign = {str(folder) for folder in named if not (folder / "pipeline" / "__init__.py").is_file()}
    last = max((index for index, entry in enumerate(entries) if entry == str(installed)), default=-1)
    moved = [entry for entry in entries[:max(last, 0)] if entry in foreign]
    kept = [entry for index, entry in enumerate(entries) if index >= last or entry not in foreign]
    where = kept.index(str(installed)) + 1 if last >= 0 else len(kept)
    return [*kept[:where], *moved, *kept[where:]]
