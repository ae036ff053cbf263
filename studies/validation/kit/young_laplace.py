"""Shape at rest of a liquid in a sphere (or a circle, in 2D) of water: the equations of Young and Laplace.

The origin of the profile is where the interface crosses the axis; s is its length, phi its inclination and z its
height, towards the wall that the oil rests on. With the capillary constant c = |rho_water - rho_oil| g / sigma

    dr/ds = cos phi,   dz/ds = sin phi,   dphi/ds = 2 b + c z - sin(phi) / r   (2D: b + c z)

from r = z = phi = 0 with the curvature b on the axis. The profile ends at the wall, at the polar angle beta from the
pole of the water, where phi = beta - theta: the first root of r - R sin(phi + theta). One b gives one shape; the fill
follows from the volume of the water, so b is searched for. Oil lighter than water rests on the top, heavier oil on
the bottom: the same shape upside down. Equations: docs/methods/measures.md.
"""
import dataclasses

import numpy as np

STEPS = 1000  # of Runge and Kutta along the longest profile
LONGEST = 3.2  # length at which a profile that has not met the wall is given up, in radii
CURVATURES, REFINEMENT = 240, 40  # profiles that bracket a fill, and those that narrow the bracket down
LARGEST_CURVATURE = 150.0  # of a bracketing profile, over 1/R


@dataclasses.dataclass(frozen=True)
class Profile:
    """An interface at rest that meets the wall.

    Attributes
    ----------
    radius : of the cavity, m. dimension : 2 or 3.
    curvature : b, on the axis, 1/m.
    r, z : (n,), m: distance from the axis, and height over the center of the cavity towards the oil's pole.
    inclination : (n,), rad. The last point of r, z and inclination is on the wall.
    wall_angle : beta, rad, of the contact line from the pole of the water.
    """

    radius: float
    dimension: int
    curvature: float
    r: np.ndarray
    z: np.ndarray
    inclination: np.ndarray
    wall_angle: float

    @property
    def arc(self) -> float:
        """Arc of the wall that the oil touches in a plane through the axis, deg."""
        return 360.0 - 2.0 * np.degrees(self.wall_angle)

    @property
    def apex(self) -> float:
        """Height of the interface on the axis over the center of the cavity, towards the oil's pole, m."""
        return float(self.z[0])

    @property
    def coverage(self) -> float:
        """Share of the wall that the oil touches."""
        return covered_share(self.arc, self.dimension)

    @property
    def fill(self) -> float:
        """Share of the cavity that is oil."""
        beta, radius = self.wall_angle, self.radius
        if self.dimension == 2:
            below, whole = radius**2 * (beta - np.sin(beta) * np.cos(beta)), np.pi * radius**2
            slices = 2.0 * self.r
        else:
            height = radius * (1.0 - np.cos(beta))
            below, whole = np.pi * height**2 * (3.0 * radius - height) / 3.0, 4.0 / 3.0 * np.pi * radius**3
            slices = np.pi * self.r**2
        # The water fills the cap of the wall below the contact line, less what the interface hangs into it.
        return float(1.0 - (below - np.trapezoid(slices, self.z)) / whole)

    def is_oil(self, position: np.ndarray) -> np.ndarray:
        """Whether points lie in the oil, (n, dimension) -> (n,); the oil's pole is towards positive y."""
        from matplotlib.path import Path  # slow to import, and few cases ask

        r = np.linalg.norm(np.delete(position, 1, axis=1), axis=1)
        # Closed curve around the oil: the interface, then the wall up to the oil's pole and beyond.
        beta = np.linspace(self.wall_angle, np.pi, 200)
        far = 2.0 * self.radius
        r_curve = np.concatenate([self.r, far * np.sin(beta), [0.0]])
        z_curve = np.concatenate([self.z, -far * np.cos(beta), [far]])
        return Path(np.column_stack([r_curve, z_curve])).contains_points(np.column_stack([r, position[:, 1]]))


def covered_share(arc: float, dimension: int) -> float:
    """Return the share of the wall on an arc, deg, around the pole.

    >>> covered_share(180.0, 2), round(float(covered_share(180.0, 3)), 9)
    (0.5, 0.5)
    """
    return arc / 360.0 if dimension == 2 else 0.5 * (1.0 - np.cos(np.radians(0.5 * arc)))


def covered_arc(share: float, dimension: int) -> float:
    """Return the arc, deg, around the pole that holds a share of the wall."""
    return 360.0 * share if dimension == 2 else 2.0 * np.degrees(np.arccos(np.clip(1.0 - 2.0 * share, -1.0, 1.0)))


def interface(curvature, capillary_constant: float, dimension: int, length, steps: int = STEPS):
    """Integrate profiles from the axis.

    Parameters
    ----------
    curvature : b, scalar or (k,), 1/m. capillary_constant : c, 1/m^2. length : of the profiles, scalar or (k,), m.

    Returns
    -------
    r, z, phi : (steps + 1, k), m, m and rad; z is zero on the axis.
    """
    b = np.atleast_1d(np.asarray(curvature, float))
    axial = 0.0 if dimension == 2 else 1.0

    def slope(state):
        r, z, phi = state
        # sin(phi)/r tends to b on the axis.
        off_axis = np.abs(r) > 1e-9 * length
        hoop = np.where(off_axis, np.sin(phi) / np.where(off_axis, r, 1.0), b)
        return np.stack([np.cos(phi), np.sin(phi), (1.0 + axial) * b + capillary_constant * z - axial * hoop])  # (Q4)

    ds, states = length / steps, np.zeros((steps + 1, 3, len(b)))
    for n in range(steps):
        y = states[n]
        k_1 = slope(y)
        k_2 = slope(y + 0.5 * ds * k_1)
        k_3 = slope(y + 0.5 * ds * k_2)
        states[n + 1] = y + ds / 6.0 * (k_1 + 2.0 * k_2 + 2.0 * k_3 + slope(y + ds * k_3))
    return states[:, 0], states[:, 1], states[:, 2]


def profiles(curvature, contact_angle: float, capillary_constant: float, radius: float, dimension: int) -> list:
    """Return the profile of every curvature b, (k,), 1/m; None where it does not meet the wall at this angle.

    Parameters
    ----------
    contact_angle : theta, rad, through the water. capillary_constant : c, 1/m^2. radius : of the cavity, m.
    """
    curvature = np.atleast_1d(np.asarray(curvature, float))
    # A strongly curved profile closes early: half a turn of a circle, with room for gravity.
    turn = np.pi * (dimension - 1.0) / np.maximum(np.abs(curvature) * radius, 1e-9)
    lengths = radius * np.minimum(LONGEST, 2.0 * turn + 0.05)
    r, z, phi = interface(curvature, capillary_constant, dimension, lengths)
    return [_cut(b, r[:, k], z[:, k], phi[:, k], contact_angle, radius, dimension) for k, b in enumerate(curvature)]


def _cut(curvature, r, z, phi, contact_angle, radius, dimension) -> Profile | None:
    """Cut a profile where it first meets the wall at the contact angle."""
    with np.errstate(invalid="ignore"):
        beta = phi + contact_angle
        miss = r - radius * np.sin(beta)  # (Q5)
        ends = np.flatnonzero((miss[:-1] < 0.0) & (miss[1:] >= 0.0))
    if not len(ends) or not 0.0 < beta[ends[0] + 1] <= np.pi:
        return None
    n = ends[0]
    t = miss[n] / (miss[n] - miss[n + 1])
    r, z, phi = (np.append(values[: n + 1], (1.0 - t) * values[n] + t * values[n + 1]) for values in (r, z, phi))
    beta = phi[-1] + contact_angle
    return Profile(radius, dimension, float(curvature), r, z - z[-1] - radius * np.cos(beta), phi, float(beta))


def oil_at_rest(fill: float, contact_angle: float, capillary_constant: float, radius: float,
                dimension: int) -> Profile:
    """Return the interface of a fill at rest.

    Below 5 degrees and a fill of 0.65 the oil nearly leaves the wall and several shapes have one fill: the one with
    the least curvature on the axis is returned.

    Parameters
    ----------
    fill : share of the cavity that is oil. contact_angle : theta, rad, through the water.
    capillary_constant : c = |rho_water - rho_oil| g / sigma, 1/m^2. radius : of the cavity, m.

    Raises
    ------
    ValueError
        No shape that touches the wall has this fill.
    """
    largest = np.arcsinh(LARGEST_CURVATURE)
    # Even in b near zero, even in log b far from it.
    tried = np.sinh(np.linspace(-largest, largest, CURVATURES)) / radius
    for _ in range(3):
        shapes = profiles(tried, contact_angle, capillary_constant, radius, dimension)
        miss = np.array([np.nan if shape is None else shape.fill - fill for shape in shapes])
        brackets = np.flatnonzero(miss[:-1] * miss[1:] <= 0.0)
        if not len(brackets):
            raise ValueError(f"no interface at rest that touches the wall holds a fill of {fill}")
        best = brackets[np.argmin(np.abs(tried[brackets]))]
        (low, high), (below, above) = tried[best: best + 2], miss[best: best + 2]
        tried = np.linspace(low, high, REFINEMENT)
    b = low if below == above else low - below * (high - low) / (above - below)
    return profiles(b, contact_angle, capillary_constant, radius, dimension)[0]


def distance_to(r: np.ndarray, z: np.ndarray, r_curve: np.ndarray, z_curve: np.ndarray) -> np.ndarray:
    """Return the signed distance of points to an open curve, positive to its left."""
    start = np.stack([r_curve[:-1], z_curve[:-1]], axis=1)
    edge = np.stack([np.diff(r_curve), np.diff(z_curve)], axis=1)
    from_start = np.stack([r, z], axis=1)[:, None] - start
    along = np.clip((from_start * edge).sum(-1) / np.maximum((edge**2).sum(-1), 1e-30), 0.0, 1.0)
    away = from_start - along[..., None] * edge
    square = (away**2).sum(-1)
    nearest = square.argmin(axis=1)
    row = np.arange(len(r))
    side = edge[nearest, 0] * from_start[row, nearest, 1] - edge[nearest, 1] * from_start[row, nearest, 0]
    return np.sign(side) * np.sqrt(square[row, nearest])
