"""Numbers of every frame that an effect knows by itself."""
import dataclasses
from collections.abc import Callable


@dataclasses.dataclass(frozen=True)
class Measure:
    """A number of an effect at a time, which becomes a metric.

    Attributes
    ----------
    name, unit, meaning : for the column, the axis and the report.
    function : of the parameters of the effect and of the time, s.
    of_eye : whether it says something about an eye only.
    """

    name: str
    unit: str
    meaning: str
    function: Callable[..., float]
    of_eye: bool = False
