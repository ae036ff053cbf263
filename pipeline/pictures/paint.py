"""Colors of what the oil touches, the same in every panel: the scale of volume fractions from blue to yellow."""
import numpy as np
from matplotlib import colormaps

COLORS = (colormaps["cividis"](np.linspace(0.0, 1.0, 256))[:, :3] * 255.0).round().astype(np.uint8)
BARE, COVERED = COLORS[0], COLORS[-1]
LIGHTER = 0.75          # share of white in the color of what oil does not touch, but covers on a film of aqueous


def wall_fractions(wall, covered) -> np.ndarray:
    """Fraction of the oil (n,) in what lies on a wall of the reconstruct stage, pyvista.PolyData with n points.

    ``covered`` (n,), or one for all: whether the oil touches there.
    """
    return np.where(covered, wall.point_data["oil_fraction_covered"], wall.point_data["oil_fraction_bare"])


def colors_of(fraction: np.ndarray) -> np.ndarray:
    """Colors (..., 3) of fractions of oil."""
    return COLORS[np.clip(np.asarray(fraction) * 255.0 + 0.5, 0, 255).astype(np.uint8)]


def over_film(colors: np.ndarray) -> np.ndarray:
    """Colors (..., 3) of what lies on the wall, where a film too thin for the particles is between."""
    return ((1.0 - LIGHTER) * np.asarray(colors) + LIGHTER * 255.0).round().astype(np.uint8)


FILM = over_film(COVERED)


def film_distance(wall) -> np.ndarray | None:
    """Distance (n,), m, on a wall of the reconstruct stage, to the line between what oil touches and films under it.

    Positive over films; None where films are not known.
    """
    return np.asarray(wall.point_data["film_distance"]) if "film_distance" in wall.point_data else None
