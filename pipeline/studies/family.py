"""What a family of cases is: what its file, in ``studies``, tells those who plan, run and report its cases."""
import dataclasses
import inspect
from collections.abc import Callable, Iterator, Sequence
from typing import Any

from pipeline.base.errors import UserError
from pipeline.base.words import nearest
from pipeline.studies.guests import family_modules, guest
from pipeline.studies.model import Figure, Outcome
from sim.effects import REGISTRY

FOR_DIGESTS = "no influence"


@dataclasses.dataclass(frozen=True)
class Headline:
    """The number of a family whose error stands for it where a study asks what accuracy costs.

    Attributes
    ----------
    quantity : of the rows of its cases.
    per_width : spacings that a case resolves along its length for each along the width of an eye.
    shown_by : effects of a scene in which the error is to be expected; by default those of the family.
    self_convergence : there is no reference: runs are compared with the finest one.
    """

    quantity: str
    per_width: float
    shown_by: tuple[str, ...] = ()
    self_convergence: bool = False


def _nothing(case: Any) -> tuple[str, ...]:
    return ()


@dataclasses.dataclass(frozen=True)
class Family:
    """A family of cases: a file of ``studies``, which ends in ``FAMILY = Family(__name__, Parameters, run)``.

    Attributes
    ----------
    module : name of its module.
    parameters : frozen dataclass of what tells its cases apart. Of those that it may have, ``scheme`` is that of the
        solver, ``precision`` that of Taichi, and ``accuracy`` the level of the scenes in place of that of the study.
    run : called with the parameters of a case; then with the runs of ``scenes``, name -> RunFolder, where there are
        any; then with the scene of ``solves``. Returns an Outcome.
    scenes : names of the scenes whose results a case reads.
    reads : what it reads of these beside their metrics, folders by segment or files.
    solves : name of the scene that a case solves by itself, with numerics of its own.
    effects : of the solvers that a case makes without a scene.
    files, liquids : files, and liquids of ``config/materials.yaml``, that a case reads.
    unnamed : parameters that tell no cases apart.
    figures : of all of its cases. pictures : names of PNG files that it makes itself.
    draw : returns those of them that show all of its cases, name -> PNG.
    threads : that a case can use at least.
    """

    module: str
    parameters: type | None = None
    run: Callable[..., Outcome] | None = None
    _: dataclasses.KW_ONLY
    scenes: Callable[[Any], Sequence[str]] = _nothing
    reads: tuple[str, ...] = ("frames",)
    solves: Callable[[Any], str] | None = None
    effects: tuple[str, ...] = ()
    files: Callable[[Any], Sequence[str]] = _nothing
    liquids: Callable[[Any], Sequence[str]] = _nothing
    unnamed: tuple[str, ...] = ()
    figures: tuple[Figure, ...] = ()
    pictures: tuple[str, ...] = ()
    draw: Callable[[list[Outcome]], dict[str, bytes]] | None = None
    threads: int = 1
    headline: Headline | None = None

    def __post_init__(self):
        wrong = list(self._wrong())
        if wrong:
            raise UserError(*(f"{self.module}: {sentence}" for sentence in wrong))

    @property
    def name(self) -> str:
        """Name of the family, that of its file."""
        return self.module.rpartition(".")[2]

    @property
    def reads_runs(self) -> bool:
        """Whether its cases get the runs of scenes."""
        return self.scenes is not _nothing

    @property
    def shown_by(self) -> tuple[str, ...]:
        """Effects of a scene in which the error of the headline is to be expected."""
        return (self.headline.shown_by if self.headline else ()) or self.effects

    def _wrong(self) -> Iterator[str]:
        """What does not hold of a family, in sentences."""
        kept = getattr(self.parameters, "__dataclass_params__", None)
        if kept is None or not kept.frozen:
            yield "parameters must be a frozen dataclass"
            return
        fields = [field.name for field in dataclasses.fields(self.parameters)]
        for name in self.unnamed:
            if name not in fields:
                yield f"unnamed has {name}, but the parameters are {', '.join(fields)}"
        for kind in ("run", "scenes", "files", "liquids"):
            if not callable(getattr(self, kind)):
                yield f"{kind} must be a function"
        if callable(self.run) and not self._takes(expected := 1 + self.reads_runs + bool(self.solves)):
            yield (f"run must take {expected} arguments: the parameters"
                   f"{', runs of scenes' * self.reads_runs}{', a scene' * bool(self.solves)}")
        for name in (*self.effects, *(self.headline.shown_by if self.headline else ())):
            if name not in REGISTRY:
                yield f"there is no effect {name}{nearest(name, REGISTRY)}"
        if self.headline and not (self.headline.per_width > 0.0 and self.shown_by):
            yield "its headline needs a positive per_width, and effects by which it is shown"
        names = [*(figure.name for figure in self.figures), *self.pictures]
        if len(set(names)) < len(names):
            yield "figures and pictures must have names of their own"
        if self.draw and not self.pictures:
            yield "draws pictures, but names none"
        if self.threads < 1:
            yield f"threads is {self.threads}, but must be at least 1"

    def _takes(self, count: int) -> bool:
        try:
            inspect.signature(self.run).bind(*range(count))
        except TypeError:
            return False
        return True


def family_names() -> list[str]:
    """Return the names of all families of cases."""
    return list(family_modules())


def family_of(name: str) -> Family:
    """Return a family by name.

    Raises
    ------
    UserError : its file does not hold one.
    """
    module = guest(family_modules()[name])
    family = getattr(module, "FAMILY", None)
    if not isinstance(family, Family):
        raise UserError(f"{module.__file__}: has no FAMILY, which must be a Family with parameters and run")
    return family
