"""Curvature force."""
import dataclasses

from sim.effects.effect import Effect
from sim.parameters import parameter


@dataclasses.dataclass(frozen=True)
class CurvatureParameters:
    """Area minimisation by differences of normals (Akinci et al. 2013; S1 Eq. 7)."""

    gamma: float = parameter(unit="m/s**2", minimum=0.0, maximum=1e6, meaning="curvature coefficient")


class Curvature(Effect):
    name = "curvature"
    Parameters = CurvatureParameters
