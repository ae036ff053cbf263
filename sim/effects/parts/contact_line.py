"""How fast a contact line can move along a wall: creeping flow in the corners of two liquids at it [cox1986].

Equations: docs/methods/interface_tension.md.
"""
import math

import numpy as np

SLIP = 1e-9  # m: so near to the contact line, by molecules, liquid slips along the wall; only the logarithm counts


def turning(angle, ratio: float):
    """Turning f of an interface along the way from its contact line, d angle / d ln r = Ca f (I10), 1.

    Parameters
    ----------
    angle : between wall and interface through one liquid, rad, a number or an array.
    ratio : viscosity of the other liquid over that of this one, of which Ca is the capillary number.
    """
    s, c, rest = np.sin(angle), np.cos(angle), math.pi - angle
    own, other = angle**2 - s**2, rest**2 - s**2
    return 2.0 * s * (ratio**2 * own + 2.0 * ratio * (angle * rest + s**2) + other) / (
        ratio * own * (rest + s * c) + other * (angle - s * c))


def fastest_retreat(angle: float, tension: float, viscosity: float, other: float, length: float) -> float:
    """Speed at which a liquid leaves a wall at most, m/s (I11): its angle, seen from so far, is zero then.

    Parameters
    ----------
    angle : contact angle through this liquid, rad.
    tension : N/m. viscosity, other : of this liquid and of the other one, Pa s, above zero.
    length : size of the liquid, m, at which the angle is seen.
    """
    parts = 2000
    angles = angle * (np.arange(parts) + 0.5) / parts
    driven = float((1.0 / turning(angles, other / viscosity)).mean()) * angle
    return tension / viscosity * driven / math.log(length / SLIP)
