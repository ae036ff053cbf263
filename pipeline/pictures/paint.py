"""Colors of what is in an eye, the same in every panel: oil, aqueous, films between, and what is mixed of both."""
import dataclasses

import numpy as np

from pipeline.base.palette import AQUEOUS, GAS, OIL, ramp
from pipeline.scenes.model import Scene
from sim.liquid import GAS_DENSITY

PALER = 0.55            # share of white in the color of films


@dataclasses.dataclass(frozen=True)
class Paint:
    """Colors of aqueous and of what takes its place.

    Attributes
    ----------
    colors : (256, 3) uint8, by the volume fraction of the oil, or of the gas; between 0 and 1 it is a mixture.
    """

    colors: np.ndarray

    @property
    def bare(self) -> np.ndarray:
        """Color (3,) of aqueous, and of the wall that it touches."""
        return self.colors[0]

    @property
    def covered(self) -> np.ndarray:
        """Color (3,) of oil, and of the wall that it touches."""
        return self.colors[-1]

    @property
    def film(self) -> np.ndarray:
        """Color (3,) of the wall that oil covers on a film of aqueous too thin for the particles: pale aqueous."""
        return ((1.0 - PALER) * self.bare + PALER * 255.0).round().astype(np.uint8)

    def of(self, fraction: np.ndarray) -> np.ndarray:
        """Colors (..., 3) of fractions of oil."""
        return self.colors[np.clip(np.asarray(fraction) * 255.0 + 0.5, 0, 255).astype(np.uint8)]


OF_OIL, OF_GAS = Paint(ramp(AQUEOUS, OIL, 256)), Paint(ramp(AQUEOUS, GAS, 256))


def paint_of(scene: Scene) -> Paint:
    """Return the colors of an eye with oil, or with gas in its place."""
    return OF_GAS if any(liquid.density < GAS_DENSITY for liquid in scene.liquids) else OF_OIL


def wall_fractions(wall, covered) -> np.ndarray:
    """Fraction of the oil (n,) in what lies on a wall of the reconstruct stage, pyvista.PolyData with n points.

    ``covered`` (n,), or one for all: whether the oil touches there.
    """
    return np.where(covered, wall.point_data["oil_fraction_covered"], wall.point_data["oil_fraction_bare"])


def film_distance(wall) -> np.ndarray | None:
    """Distance (n,), m, on a wall of the reconstruct stage, to the line between what oil touches and films under it.

    Positive over films; None where films are not known.
    """
    return np.asarray(wall.point_data["film_distance"]) if "film_distance" in wall.point_data else None


def css(color) -> str:
    """Return a color (3,), 0 to 255, as ``#rrggbb``."""
    return "#" + "".join(f"{int(part):02x}" for part in color)
