"""Diffusion of volume fractions by conservative pair fluxes."""
import dataclasses

from sim.effects.effect import Effect
from sim.parameters import parameter


@dataclasses.dataclass(frozen=True)
class DiffusionParameters:
    """Mixing of the liquids by diffusion of their volume fractions (methods S1 Eq. 13, corrected)."""

    coefficient: float = parameter(unit="m**2/s", minimum=0.0, maximum=1e-2, meaning="diffusion coefficient D_m")


class Diffusion(Effect):
    name = "diffusion"
    Parameters = DiffusionParameters
