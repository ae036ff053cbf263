"""Where the oil of a scene is at rest."""
import numpy as np

from pipeline.base.errors import UserError
from pipeline.cavity.rays import interpolation
from pipeline.equilibrium.least import Resting
from pipeline.equilibrium.rest import Liquids, Rest
from pipeline.equilibrium.star_cavity import FINE
from pipeline.scenes.effects import known_by_an_effect, sum_of_effects
from pipeline.scenes.model import Scene


def liquids_at_rest(scene: Scene) -> Liquids:
    """Return what decides where the oil of a scene of two liquids, aqueous first, rests."""
    aqueous, oil = scene.liquids[:2]
    return Liquids(aqueous.density - oil.density, sum_of_effects(scene, "tension_of"),
                   known_by_an_effect(scene, "contact_angle_of"), sum_of_effects(scene, "weight_of"))


def rest_of(scene: Scene, down: np.ndarray, fill: float) -> Rest:
    """Return the shape of the oil of a scene at rest: of those that are found, the one with least energy.

    Parameters
    ----------
    down : (3,) direction of gravity. fill : share of the cavity that is oil.

    Raises
    ------
    UserError : no shape was found.
    """
    best = Resting.of(scene.eye).least(liquids_at_rest(scene), down, fill, FINE)
    if best is None:
        raise UserError(f"no shape of {100.0 * fill:g} % oil at rest was found in this posture, since one point must "
                        "see all of its surface; try another fill")
    return best.rest


def depth_in_oil(rest: Rest, position: np.ndarray) -> np.ndarray:
    """How far points (n, 3) lie in the oil, along the ray from the viewpoint, (n,), m; negative outside."""
    arm = position - rest.cavity.viewpoint
    distance = np.linalg.norm(arm, axis=1)
    wall = rest.cavity.wall - rest.cavity.viewpoint
    corners, weights = interpolation(wall, rest.cavity.faces, arm / np.maximum(distance, 1e-9)[:, None])
    return (rest.distance[corners] * weights).sum(axis=1) - distance


def oil_at_rest(rest: Rest, position: np.ndarray) -> np.ndarray:
    """Return which of the particles at (n, 3) are oil, (n,) bool: those deepest in it, as many as the fill asks for."""
    oil = np.zeros(len(position), bool)
    oil[np.argsort(-depth_in_oil(rest, position), kind="stable")[:round(rest.fill * len(position))]] = True
    return oil
