"""Which library compiles the kernels. A move to another one is the line of `DEFAULT`, and those in pyproject.toml."""
import dataclasses
import difflib
import functools
import importlib.metadata
import importlib.util
import os
import sys

from sim.errors import RunError

DEFAULT = "taichi"
VARIABLE = "EYE_OIL_BACKEND"  # of the environment: another one for a while, as for tests
# Options of the start that the environment may set: they change no result.
PLACES = ("offline_cache_file_path", "offline_cache_max_size_of_files", "visible_device")


@dataclasses.dataclass(frozen=True)
class Library:
    """Taichi, or a fork of it.

    Parameters
    ----------
    name : of the package, and of the choice.
    module : what is imported.
    title : as it calls itself.
    word : at the head of the names of its errors.
    prefix : of its variables of the environment.
    tried : version with which it was last tried (docs/dependencies.md).
    options : arguments of its start that the others have not.
    """

    name: str
    module: str
    title: str
    word: str
    prefix: str
    tried: str
    options: tuple[tuple[str, str], ...] = ()

    def variable(self, option: str) -> str:
        """Return the variable of the environment that sets an option of its start."""
        return f"{self.prefix}_{option.upper()}"

    def silence(self) -> None:
        """Let its import not greet on standard output, which belongs to what the stages write."""
        os.environ.setdefault(f"ENABLE_{self.word.upper()}_HEADER_PRINT", "0")

    def forget_settings(self) -> None:
        """Let what a user has set for other programs of this library, such as `TI_FAST_MATH`, change no result here."""
        kept = {*map(self.variable, PLACES)}
        for name in [one for one in os.environ if one.startswith(f"{self.prefix}_") and one not in kept]:
            del os.environ[name]

    def is_installed(self) -> bool:
        """Return whether it can be imported."""
        return importlib.util.find_spec(self.module) is not None


LIBRARIES = {one.name: one for one in (
    Library("taichi", "taichi", "Taichi", "Taichi", "TI", "1.7.4"),
    Library("quadrants", "quadrants", "Quadrants", "Quadrants", "QD", "1.3.3"),
    Library("taichi-forge", "taichi_forge", "Taichi Forge", "Taichi", "TI", "0.7.0",
            (("compile_tier", "full"),)),  # else steps take 18 times as long
)}


class NoBackend(RunError):
    """The library that is asked for is not there; the message is one sentence for the user."""


@functools.cache
def library() -> Library:
    """Return the library of this process: what the environment names, else the default.

    Raises
    ------
    NoBackend
        There is none of this name, or it is not installed.
    """
    return chosen(os.environ.get(VARIABLE) or DEFAULT)


def chosen(name: str) -> Library:
    """Return the library of a name, as :func:`library` does."""
    if name not in LIBRARIES:
        near = "".join(difflib.get_close_matches(name.lower().replace("_", "-"), LIBRARIES, n=1))
        raise NoBackend(f'{VARIABLE} is "{name}", but must be one of {", ".join(LIBRARIES)}'
                        + f" (did you mean {near}?)" * bool(near))
    if not LIBRARIES[name].is_installed():
        here = [one.name for one in LIBRARIES.values() if one.is_installed()]
        raise NoBackend(f"{VARIABLE} is {name}, which is not installed here; install it by `{sys.executable} -m pip "
                        f"install {name}=={LIBRARIES[name].tried}`, or take {' or '.join(here) or 'another one'}")
    return LIBRARIES[name]


@functools.cache
def backend_version() -> str:
    """Return name and version of the library: with another one, results may be others."""
    return f"{library().name} {importlib.metadata.version(library().name)}"
