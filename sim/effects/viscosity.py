"""Explicit viscosity."""
import dataclasses

from sim.effects.effect import Effect
from sim.parameters import parameter


@dataclasses.dataclass(frozen=True)
class ViscosityParameters:
    """Shear stress within and between liquids, advanced explicitly (step limited by dx^2 rho / mu)."""

    wall: str = parameter("no_slip", choices=("no_slip", "free_slip"), meaning="friction at the wall")


class Viscosity(Effect):
    name = "viscosity"
    Parameters = ViscosityParameters
