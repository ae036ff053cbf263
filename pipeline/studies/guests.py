"""Guests of the pipeline: families of cases, and pages that answer questions. They are found by name, never imported.

Those of this project are in the package `studies`. Whoever works in a folder puts his own beside his studies, as
`config/studies/<name>.py`, which is the module `config.studies.<name>`. A file is called by its bare name wherever it
lies; one whose name ends in `_page` writes a page, every other one holds a family. What they share is in folders named
`kit` and in files whose names begin with `_`; `studies/results` makes the published tables of their numbers.
"""
import importlib
import sys
import traceback
from pathlib import Path
from types import ModuleType

from pipeline.base.errors import UserError
from pipeline.base.project import PACKAGE

STUDIES = Path("config/studies")  # of the folder that somebody works in
GUESTS = PACKAGE.parent / "studies"  # of this project
NO_GUESTS = {"kit", "results"}  # folders with what guests share, and with what is made of their numbers
PAGE = "_page"


def family_modules() -> dict[str, str]:
    """Return the modules with families: name -> dotted module, in the order of names.

    Raises
    ------
    UserError : two have the same name.
    """
    return {name: module for name, module in _modules().items() if not name.endswith(PAGE)}


def page_modules() -> dict[str, str]:
    """Return the modules that write pages: what `report` of a study says -> dotted module.

    Raises
    ------
    UserError : two have the same name.
    """
    return {name.removesuffix(PAGE): module for name, module in _modules().items() if name.endswith(PAGE)}


def guest(module: str) -> ModuleType:
    """Import a module of :func:`family_modules` or :func:`page_modules`.

    Raises
    ------
    UserError : it cannot be imported, of somebody's own; says where.
    """
    if not module.startswith(_dotted(STUDIES)):
        return importlib.import_module(module)
    _let_import_own()
    try:
        return importlib.import_module(module)
    except UserError:
        raise
    except Exception as error:
        why = error.msg if isinstance(error, SyntaxError) else error
        raise UserError(f"{_place(error)}: cannot be imported: {type(error).__name__}: {why}") from error


def _modules() -> dict[str, str]:
    """All guests, name -> dotted module."""
    found: dict[str, Path] = {}
    for folder, paths in ((GUESTS.parent, GUESTS.rglob("*.py")), (Path(), STUDIES.glob("*.py"))):
        for path in sorted(path.relative_to(folder) for path in paths):
            if path.stem.startswith("_") or NO_GUESTS & {*path.parts}:
                continue
            if path.stem in found:
                raise UserError(f"{path}: has the name of {found[path.stem]}, but families and pages are called by "
                                "their names alone; rename it")
            found[path.stem] = path
    return {name: _dotted(found[name].with_suffix("")) for name in sorted(found)}


def _dotted(path: Path) -> str:
    return ".".join(path.parts)


def _let_import_own() -> None:
    """Let modules of `config/studies` be imported, here and by each other; those of another folder are forgotten."""
    name, folder = _dotted(STUDIES), [str(STUDIES.resolve())]
    if getattr(sys.modules.get(name), "__path__", None) == folder:
        return
    for known in [one for one in sys.modules if one.startswith(f"{name}.")]:
        del sys.modules[known]
    importlib.invalidate_caches()
    for part, path in ((_dotted(STUDIES.parent), [str(STUDIES.parent.resolve())]), (name, folder)):
        sys.modules[part] = ModuleType(part)
        sys.modules[part].__path__ = path


def _place(error: Exception) -> str:
    """File and line of somebody's own that an error came up in."""
    places = [(frame.filename, frame.lineno) for frame in traceback.extract_tb(error.__traceback__)]
    if isinstance(error, SyntaxError):
        places.append((error.filename, error.lineno))
    own = [(STUDIES / Path(name).name, line) for name, line in places if Path(name).parent == STUDIES.resolve()]
    return "{}, line {}".format(*own[-1]) if own else str(STUDIES)
