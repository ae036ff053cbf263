"""The surface of a family that parts the particles of two liquids best: an interface read without any smoothing."""
from collections.abc import Callable

import numpy as np
from scipy.optimize import minimize

REACH, WIDTH = 3.0, 0.1  # particles considered, and width of the smooth step, in particle spacings
CLOSE = 2.0  # particles whose share on the wrong side is told, in particle spacings
EVALUATIONS = 80


def part(distance: Callable[[np.ndarray, np.ndarray], np.ndarray], side: np.ndarray, start: np.ndarray,
         change: np.ndarray) -> tuple[np.ndarray, float]:
    """Find the unknown of the surface that parts two liquids best.

    What is smallest is the mean of a smooth step over the distance to the wrong side, so that single particles far off
    count as one each, however far.

    Parameters
    ----------
    distance : (unknown, chosen particles) -> signed distances to the surface, in particle spacings.
    side : (n,), 1 for particles that belong where the distance is positive, else -1.
    start, change : (k,), the unknown to start from, and how far its components are tried at first.

    Returns
    -------
    The unknown, and the share of the particles within two spacings that are on the wrong side.
    """
    near = np.abs(distance(start, np.ones(len(side), bool))) < REACH
    side = side[near]

    def cost(unknown) -> float:
        return float((0.5 - 0.5 * np.tanh(side * distance(unknown, near) / WIDTH)).sum())

    simplex = start + np.vstack([np.zeros(len(start)), np.diag(change)])
    best = minimize(cost, start, method="Nelder-Mead",
                    options={"initial_simplex": simplex, "xatol": 1e-3, "fatol": 1e-3, "maxfev": EVALUATIONS}).x
    found = distance(best, near)
    return best, float((side * found < 0.0)[np.abs(found) < CLOSE].mean())
