"""What a metric is, and how a function becomes one."""
import dataclasses
from collections.abc import Callable

from pipeline.measures.frame_view import Measured
from pipeline.scenes.model import Scene

Value = float | dict[str, float]
# Effects by which the volume fractions of particles become other than 0 or 1.
MIXING_EFFECTS = frozenset(("diffusion", "drift", "contact_line_emulsification"))


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
    """

    name: str
    unit: str
    meaning: str
    function: Callable[[Measured], Value]
    of_eye: bool = False
    of_mixture: bool = False
    of_rotation: bool = False

    def columns(self, state: Measured) -> dict[str, float]:
        """Return the numbers of one frame by their column, such as ``volume_aqueous [mL]``."""
        value = self.function(state)
        parts = {f"{self.name}_{part}": number for part, number in value.items()} if isinstance(value, dict) else {
            self.name: value}
        return {f"{column} [{self.unit}]": float(number) for column, number in parts.items()}

    def applies_to(self, scene: Scene) -> bool:
        """Whether the metric has a meaning in a scene."""
        mixes = not MIXING_EFFECTS.isdisjoint(scene.effects)
        return ((mixes or not self.of_mixture) and (scene.container is None or not self.of_eye)
                and ("eye_rotation" in scene.effects or not self.of_rotation))


def registrar(metrics: list[Metric]) -> Callable:
    """Return the decorator ``@metric(unit, meaning)`` that appends a function, as the metric of its name."""
    def metric(unit: str, meaning: str, **of: bool) -> Callable:
        def register(function: Callable[[Measured], Value]) -> Callable[[Measured], Value]:
            metrics.append(Metric(function.__name__, unit, meaning, function, **of))
            return function
        return register
    return metric
