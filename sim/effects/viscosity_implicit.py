"""Implicit viscosity."""
import dataclasses

from sim.effects.effect import Effect
from sim.parameters import parameter


@dataclasses.dataclass(frozen=True)
class ViscosityImplicitParameters:
    """Shear stress within and between liquids by a backward Euler step: no limit on the time step."""

    wall: str = parameter("no_slip", choices=("no_slip", "free_slip"), meaning="friction at the wall")


class ViscosityImplicit(Effect):
    name = "viscosity_implicit"
    Parameters = ViscosityImplicitParameters
