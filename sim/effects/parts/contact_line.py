"""How fast a contact line can move along a wall: creeping flow in the corners of two liquids at it [cox1986].

Equations: docs/methods/interface_tension.md, docs/methods/viscosity.md.
"""
import math

import numpy as np

SLIP = 1e-9  # m: so near to the contact line, by molecules, liquid slips along the wall; only the logarithm counts
# The film that a front leaves behind which is too fast for a line: h over R Ca^(2/3) of a bubble without viscosity
# [bretherton1961], and how many times as thick it is where the bubble is much more viscous than the film, and at most
# [hodges2004, abstract].
DEPOSIT, VISCOUS, THICKEST = 1.34, 2.0 ** (2.0 / 3.0), 4.0 ** (2.0 / 3.0)
NODES = 721  # angles at which the friction of a corner is tabulated


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


def turning_rate(angle, viscosity: float, other: float):
    """Turning of an interface per speed of its line, d angle / d ln r over U/sigma (I10), Pa s; one may be zero."""
    if viscosity >= other:
        return viscosity * turning(angle, other / viscosity)
    return other * turning(math.pi - angle, viscosity / other)


def corner_friction(angle: float, tension: float, viscosity: float, other: float,
                    length: float) -> tuple[np.ndarray, np.ndarray]:
    """Friction of the corner at a contact line within a distance from it (V13), at rising speeds.

    Parameters
    ----------
    angle : contact angle through this liquid, rad.
    tension : N/m. viscosity, other : of this liquid and of the other one, Pa s, one above zero.
    length : distance up to which flow is not resolved, m.

    Returns
    -------
    speed : of the line, m/s, (n,), positive where this liquid advances. friction : against it, N/m, (n,).
    """
    angles = np.union1d(np.linspace(0.0, math.pi, NODES), angle)
    middle = 0.5 * (angles[1:] + angles[:-1])
    driven = np.concatenate([[0.0], np.cumsum(np.diff(angles) / turning_rate(middle, viscosity, other))])
    speed = tension / math.log(length / SLIP) * (driven - driven[np.searchsorted(angles, angle)])
    return speed, tension * (math.cos(angle) - np.cos(angles))
