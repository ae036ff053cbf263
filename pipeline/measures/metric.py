"""What a metric is, and how a function becomes one."""
import dataclasses
import functools
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from pipeline.base.errors import UserError
from pipeline.base.files import write_text
from pipeline.measures.frame_view import Measured
from pipeline.scenes.effects import does, effects_that, knows_films
from pipeline.scenes.model import Scene
from sim.effects.effect import MIXES, Effect

FOR_DIGESTS = "runs effects"
Value = float | dict[str, float]
LAST = 1000  # place of a metric that tells of the computation rather than of the eye


@dataclasses.dataclass(frozen=True)
class Metric:
    """A number, or a few named ones, that every frame has.

    Attributes
    ----------
    name, unit, meaning : for the column, the axis and the report.
    function : called with the :class:`Measured` state of one frame; several numbers come as name -> number.
    of_eye : whether it says something about an eye only, and a container goes without it.
    of_mixture : whether it says something only where liquids mix, and other scenes go without it.
    of_rotation : the same for eyes that turn.
    of_film : the same for scenes whose films on the wall are known.
    of_places : places in a scene that it is about, "breaks" or "regions"; scenes without any go without it.
    effect : the effect whose own measure it is; other scenes go without it.
    place : order of interest, the smallest first on the page and among the plots.
    uncertainty : name of the metric whose half, part by part, is the uncertainty of this one, drawn as a band.
    limits : ends of the axis; without them it follows the numbers.
    yes_or_no : whether it is 1, 0 or, where that is uncertain, 1/2; drawn as a bar over time.
    """

    name: str
    unit: str
    meaning: str
    function: Callable[[Measured], Value]
    of_eye: bool = False
    of_mixture: bool = False
    of_rotation: bool = False
    of_film: bool = False
    effect: str | None = None
    of_places: str = ""
    place: int = LAST
    uncertainty: str | None = None
    limits: tuple[float, float] | None = None
    yes_or_no: bool = False

    def columns(self, state: Measured) -> dict[str, float]:
        """Return the numbers of one frame by their column, such as ``volume_aqueous [mL]``."""
        value = self.function(state)
        parts = {f"{self.name}_{part}": number for part, number in value.items()} if isinstance(value, dict) else {
            self.name: value}
        return {f"{column} [{self.unit}]": float(number) for column, number in parts.items()}

    def applies_to(self, scene: Scene) -> bool:
        """Whether the metric has a meaning in a scene."""
        return ((not self.of_mixture or does(scene, MIXES)) and (not self.of_eye or scene.container is None)
                and (not self.of_rotation or bool(effects_that(scene, "turns_eye")))
                and (not self.of_film or knows_films(scene))
                and (self.effect is None or self.effect in scene.effects)
                and (not self.of_places or bool(getattr(scene, self.of_places))))


def write_meanings(path: Path, metrics: Iterable[Metric], breaks: Sequence[Mapping] = (),
                   at_rest: Mapping[str, Any] | None = None) -> None:
    """Write what metrics mean, all but their functions, for whoever reads their table.

    Parameters
    ----------
    breaks : when breaks were covered.
    at_rest : what the oil would touch at rest; None where it is not known.
    """
    records = [{field.name: getattr(one, field.name) for field in dataclasses.fields(Metric)
                if field.name != "function"} for one in metrics]
    text = json.dumps({"metrics": records, "breaks": list(breaks), "at_rest": at_rest}, indent=1, ensure_ascii=False)
    write_text(path, f"{text}\n")


def read_meanings(path: Path) -> list[Metric]:
    """Read metrics that were written so; they cannot measure.

    Raises
    ------
    UserError : the file is missing or damaged.
    """
    def none(state: Measured) -> Value:
        raise TypeError(f"{path} says what was measured, not how")

    try:
        return [Metric(function=none, **record) for record in json.loads(path.read_text(encoding="utf-8"))["metrics"]]
    except (OSError, ValueError, TypeError, KeyError) as error:
        raise UserError(f"{path}: cannot be read ({error}); run the metrics stage again, with --meanings") from error


def metrics_of_effect(effect: type[Effect]) -> list[Metric]:
    """Return the measures of an effect as metrics."""
    def measured(function: Callable, state: Measured) -> float:
        return function(state.scene.effects[effect.name], float(state.frame.time))
    return [Metric(one.name, one.unit, one.meaning, functools.partial(measured, one.function), of_eye=one.of_eye,
                   of_rotation=effect.turns_eye, effect=effect.name) for one in effect.measures]


def registrar(metrics: list[Metric]) -> Callable:
    """Return the decorator ``@metric(unit, meaning)`` that appends a function, as the metric of its name."""
    def metric(unit: str, meaning: str, **of: Any) -> Callable:
        def register(function: Callable[[Measured], Value]) -> Callable[[Measured], Value]:
            metrics.append(Metric(function.__name__, unit, meaning, function, **of))
            return function
        return register
    return metric
