"""The wall term of the energy: a tension that falls from that of the interface to that of the wetted wall near it.

Where oil comes within a range delta of the wall, its tension falls by the factor w. The first integral of the shape in
such a field turns an interface that leaves the wall by the contact angle in full, whatever the range; only where it
leaves is blurred, by a known length. Equations: docs/methods/equilibrium.md.
"""
import dataclasses
import functools

import numpy as np

TRANSITION = 2.5   # edges of triangles over which the interface leaves the wall: with 1.7 it sticks to the triangles
PIECES = 400       # of the profile, to look its length up


@dataclasses.dataclass(frozen=True)
class Wetting:
    """The tension of oil near a wall, over that of the interface.

    Attributes
    ----------
    contact_angle : through the other liquid, rad.
    transition : length along the wall from where oil leaves it to where the wall is no longer felt.
    """

    contact_angle: float
    transition: float

    @functools.cached_property
    def _profile(self) -> tuple[np.ndarray, np.ndarray]:
        """Gap over range, 1 - cos x, and distance along the wall over range at it."""
        x = np.linspace(0.0, 0.5 * np.pi, PIECES + 1)
        excess = 1.0 / np.cos(self.contact_angle) - 1.0
        slowness = 1.0 / np.sqrt(2.0 * excess + (excess * np.sin(x)) ** 2)  # (R4)
        return 1.0 - np.cos(x), np.append(0.0, np.cumsum(0.5 * np.diff(x) * (slowness[1:] + slowness[:-1])))

    @functools.cached_property
    def range(self) -> float:
        """Gap between oil and wall from which the wall is not felt."""
        return self.transition / self._profile[1][-1]

    def tension(self, gap: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return w and its first two derivatives by the gap, (n,) each."""
        t, fall = gap / self.range, 1.0 - np.cos(self.contact_angle)
        near = t < 1.0
        t = np.minimum(t, 1.0)
        return (1.0 - fall * (1.0 - t) ** 2,  # (R3)
                np.where(near, 2.0 * fall * (1.0 - t) / self.range, 0.0),
                np.where(near, -2.0 * fall / self.range**2, 0.0))

    def depth_in_oil(self, gap: np.ndarray) -> np.ndarray:
        """Distance along the wall to the contact line, (n,), of points above which the oil has a gap.

        Positive where the oil touches; there it is known only as far as the line is blurred.
        """
        t, (gaps, lengths) = gap / self.range, self._profile
        slope = np.tan(self.contact_angle)
        line = lengths[-1] - 1.0 / slope  # where the interface would meet the wall if it went on straight
        return self.range * (line - np.where(t < 1.0, np.interp(t, gaps, lengths), lengths[-1] + (t - 1.0) / slope))
