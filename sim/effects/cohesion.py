"""Cohesion."""
import dataclasses

from sim.effects.effect import Effect
from sim.parameters import parameter


@dataclasses.dataclass(frozen=True)
class CohesionParameters:
    """Pairwise attraction within a liquid (Akinci et al. 2013; S1 Eq. 9)."""

    gamma: float = parameter(unit="N*m**3/kg**2", minimum=0.0, maximum=1e6, meaning="cohesion coefficient")


class Cohesion(Effect):
    name = "cohesion"
    Parameters = CohesionParameters
