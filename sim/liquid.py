"""A liquid as the solver knows it."""
import dataclasses

from sim.parameters import parameter


@dataclasses.dataclass(frozen=True)
class Liquid:
    """One liquid; its place in ``Settings.liquids`` is its phase index."""

    name: str = parameter(meaning="name of the liquid")
    density: float = parameter(unit="kg/m**3", exclusive_minimum=0.0, maximum=20000.0, meaning="rest density")
    dynamic_viscosity: float = parameter(unit="Pa*s", minimum=0.0, maximum=100.0, meaning="dynamic viscosity")
