"""Injection of a liquid through a cannula while another leaves through a drain at the same rate."""
import dataclasses

from sim.effects.effect import Effect
from sim.parameters import parameter


@dataclasses.dataclass(frozen=True)
class InjectionParameters:
    """Exchange of liquids in the closed cavity at a given flow, up to a given fill."""

    liquid: str = parameter(liquid=True, meaning="liquid that enters")
    drained_liquid: str = parameter(liquid=True, meaning="liquid that leaves")
    flow: float = parameter(unit="m**3/s", exclusive_minimum=0.0, maximum=1e-4, meaning="volume per time")
    fill: float = parameter(exclusive_minimum=0.0, maximum=1.0,
                            meaning="fraction of the cavity that the entering liquid holds at the end")
    cannula: tuple[float, float, float] = parameter(unit="m", meaning="tip of the cannula")
    drain: tuple[float, float, float] = parameter(unit="m", meaning="mouth of the drain")
    start: float = parameter(0.0, unit="s", minimum=0.0, meaning="time at which the injection begins")


class Injection(Effect):
    name = "injection"
    Parameters = InjectionParameters
