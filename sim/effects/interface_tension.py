"""Interface tension in N/m with a contact angle at the wall."""
import dataclasses

from sim.effects.effect import Effect
from sim.parameters import parameter


@dataclasses.dataclass(frozen=True)
class InterfaceTensionParameters:
    """Tension of the interface between the first liquid and every other, from a grid level set."""

    coefficient: float = parameter(unit="N/m", minimum=0.0, maximum=1.0, meaning="interface tension")
    contact_angle: float = parameter(90.0, unit="deg", minimum=0.0, maximum=180.0,
                                     meaning="contact angle at the wall, measured through the first liquid")


class InterfaceTension(Effect):
    name = "interface_tension"
    Parameters = InterfaceTensionParameters
