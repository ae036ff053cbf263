"""A liquid as the solver knows it."""
import dataclasses
from collections.abc import Iterable

from sim.parameters import parameter

UNLIKE = 2.0  # ratio of densities from which pressures count by density and gravity pulls at the heavier alone
GAS_DENSITY = 20.0  # kg/m^3: no gas in an eye is as heavy


@dataclasses.dataclass(frozen=True)
class Liquid:
    """One liquid; its place in ``Settings.liquids`` is its phase index."""

    name: str = parameter(meaning="name of the liquid")
    density: float = parameter(unit="kg/m**3", exclusive_minimum=0.0, maximum=20000.0, meaning="rest density")
    dynamic_viscosity: float = parameter(unit="Pa*s", minimum=0.0, maximum=100.0, meaning="dynamic viscosity")


def are_unlike(densities: Iterable[float]) -> bool:
    """Whether the lightest of these liquids weighs less than half as much as the heaviest; not if there is none."""
    known = list(densities)
    return bool(known) and max(known) > UNLIKE * min(known)
