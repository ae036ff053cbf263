"""What the explorer knows: its tamponades, its eyes, and the fills and directions at which shapes were computed."""
import dataclasses

import numpy as np

from pipeline.base.palette import GAS, OIL
from pipeline.equilibrium.rest import Liquids
from pipeline.planning.settings import load_settings
from pipeline.scenes.model import Eye

FILLS = (0.05, 0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.78, 0.85, 0.9, 0.94, 0.965, 0.985)
# Degrees from the posterior pole to where the tamponade floats or sinks. Toward the front a few degrees decide on where
# a large fill leaves the aqueous.
TILTS = np.array([*np.arange(0.0, 120.0, 15.0), *np.arange(120.0, 181.0, 7.5)])
COARSE_TILT, LARGE = 15.0, 0.7              # smaller fills are computed at multiples of these degrees only
AZIMUTHS = (0.0, 90.0)                      # degrees of the meridian of that place: a mirror plane of the eye each
LATITUDES, MERIDIANS = np.arange(0.0, 181.0, 5.0), np.arange(0.0, 360.0, 5.0)   # degrees, of the points of a field
HALF = len(MERIDIANS) // 2 + 1              # meridians of a table: the others are mirror images
#: Tables: length of the eye in mm, and tamponade. The first is shown first.
TABLES = tuple((length, name) for length in ("24", "29", "21") for name in ("light", "heavy", "gas"))


@dataclasses.dataclass(frozen=True)
class Tamponade:
    """What fills the eye, from oils that rest alike one.

    Attributes
    ----------
    words : for readers. color : in pictures.
    liquids : what decides where it rests. other_angles : contact angles that are possible too, rad.
    """

    words: str
    color: str
    liquids: Liquids
    other_angles: tuple[float, ...]

    def toward(self, down: np.ndarray) -> np.ndarray:
        """Return where the tamponade goes, (3,): up, or down if it is heavier than aqueous."""
        return -np.sign(self.liquids.density_difference) * np.asarray(down, float)


def tamponades() -> dict[str, Tamponade]:
    """Return the tamponades by name: oils as ``config/plan.yaml`` has them, gas as the study of fills has it."""
    settings, materials = load_settings()
    aqueous = materials[settings.other_liquid].density

    def oil(words: str, name: str) -> Tamponade:
        liquids = Liquids(aqueous - materials[name].density, settings.tension, settings.contact_angle)
        return Tamponade(words, OIL, liquids, settings.other_angles)

    gas = Liquids(aqueous - materials["air"].density, 0.072, float(np.radians(38.8)))
    return {"light": oil("light oil", "silicone_oil_1000"), "heavy": oil("heavy oil", "heavy_oil_densiron_68"),
            "gas": Tamponade("gas", GAS, gas, (float(np.radians(30.0)), float(np.radians(43.0))))}


def fills_at(tilt: int) -> tuple[float, ...]:
    """Return the fills that are computed at a tilt of ``TILTS``."""
    return FILLS if TILTS[tilt] % COARSE_TILT == 0.0 else tuple(fill for fill in FILLS if fill >= LARGE)


def spread(fill):
    """What fills are interpolated over: about the width of a small tamponade, and of what a large one leaves."""
    return np.arcsin(np.sqrt(fill))


def eyes() -> dict[str, Eye]:
    """Return the eyes by their length in mm."""
    lengths = sorted({length for length, _ in TABLES}, key=float)
    return {length: Eye(axial_length=1e-3 * float(length)) for length in lengths}
