"""Oil at rest: the least energy at exact volume, by Newton's method on the distances that are free.

Where oil touches the wall, its distance stays that of the wall while the pressure holds it there. Every step solves for
the other distances and the pressure together; what the step would push through the wall joins the ones that stay.
Equations: docs/methods/equilibrium.md.
"""
import dataclasses
import functools
import logging

import numpy as np
import scipy.sparse
import scipy.sparse.linalg

from pipeline.equilibrium.energy import Energy, length_of
from pipeline.equilibrium.star_cavity import StarCavity, parents

LOG = logging.getLogger(__name__)
STEPS = 150             # at most; 10 to 40 are needed
SETTLED = 1e-5          # largest change of a distance in the last step, over the radius of the cavity
VOLUME_ERROR = 1e-7     # of the oil
STIFFNESS = 50.0        # of the volume in what decides on a step, over the volume
DAMPING, LEAST_DAMPING, MOST_DAMPING = 1.0, 1e-5, 1e5
LONGEST_STEP = 0.3      # over the radius of the cavity
LARGEST_CHANGE = 0.1    # of the volume in a step, over the volume: a start may be far from it
JOINING = 6             # times that distances join those that stay at the wall, in one step
DRAWN_IN = 0.999        # of the wall: a start in a full cavity
CLOSEST = 0.01          # of the wall: oil that comes nearer to the viewpoint is not seen from it, and no shape
SHELLS = 40             # of the other liquid, along a ray
FIRST_PRESSURE = 2.0    # of the oil over the other liquid: of a ball with the tension


@dataclasses.dataclass(frozen=True)
class Liquids:
    """What decides where the oil rests.

    Attributes
    ----------
    density_difference : density of the other liquid less that of the oil, kg/m3; negative for heavy oil.
    tension : of the interface, N/m.
    contact_angle : through the other liquid, rad.
    gravity : m/s2.
    """

    density_difference: float
    tension: float
    contact_angle: float
    gravity: float = 9.81


@dataclasses.dataclass(frozen=True)
class Rest:
    """Oil at rest.

    Attributes
    ----------
    cavity : its wall.
    distance : (n,), m, of the surface of the oil from the viewpoint; that of the wall where the oil touches it.
    depth : (n,), m, along the wall to the contact line: positive where the oil touches. Known near the line only.
    fill : share of the cavity that is oil.
    energy : over tension times the square of the length; to compare shapes of one fill with.
    pressure : of the oil over the other liquid at the viewpoint, Pa; only that of a settled shape means something.
    pull : (3,) Pa/m, how this pressure falls off from there.
    settled : whether the last step was as small as it should be, and the viewpoint is in the oil.
    """

    cavity: StarCavity
    distance: np.ndarray
    depth: np.ndarray
    fill: float
    energy: float
    pressure: float
    pull: np.ndarray
    settled: bool

    @property
    def surface(self) -> np.ndarray:
        """Points of the surface of the oil, (n, 3), m."""
        return self.cavity.viewpoint + self.distance[:, None] * self.cavity.direction

    def contact_pressure(self, point: np.ndarray) -> np.ndarray:
        """Pressure of the oil over that of the other liquid at points (..., 3) in m, Pa. (R9)"""
        return self.pressure - (point - self.cavity.viewpoint) @ self.pull

    @functools.cached_property
    def other(self) -> "Cloud":
        """The other liquid, between the oil and the wall."""
        cavity = self.cavity
        angle = np.bincount(cavity.faces.ravel(), np.repeat(cavity.solid / 6.0, 3), len(cavity.radius))
        gap = (cavity.radius - self.distance)[:, None]
        distance = self.distance[:, None] + gap * (np.arange(SHELLS) + 0.5) / SHELLS
        position = cavity.viewpoint + distance[..., None] * cavity.direction[:, None]
        return Cloud(position.reshape(-1, 3), (angle[:, None] * distance**2 * gap).ravel())


@dataclasses.dataclass(frozen=True)
class Cloud:
    """Points that make up a body of liquid.

    Attributes
    ----------
    position : (k, 3), m.
    volume : (k,), m3, that each of them stands for.
    """

    position: np.ndarray
    volume: np.ndarray

    @property
    def center(self) -> np.ndarray:
        """Center of mass, (3,), m."""
        return self.volume @ self.position / self.volume.sum()

    def share(self, mask: np.ndarray) -> float:
        """Return the share of the volume in a mask (k,)."""
        return float(self.volume[mask].sum() / self.volume.sum())


def at_rest(cavity: StarCavity, liquids: Liquids, down: np.ndarray, fill: float,
            start: np.ndarray | None = None) -> Rest:
    """Return a shape of least energy.

    Parameters
    ----------
    down : (3,), unit vector of gravity in the frame of the cavity.
    fill : share of the cavity that is oil, between 0 and 1.
    start : (n,), m, distances to begin with; by default the wall, drawn in alike in all directions.
    """
    length = length_of(cavity)
    bond = liquids.density_difference * liquids.gravity * length**2 / liquids.tension * np.asarray(down, float)
    energy = Energy(cavity, liquids.contact_angle, bond)
    first = fill ** (1.0 / 3.0) * energy.radius if start is None else np.minimum(start / length, energy.radius)
    if (first >= energy.radius).all():  # a full cavity leaves nothing free to move
        first = DRAWN_IN * energy.radius
    whole = energy.volume(energy.radius) if cavity.whole is None else cavity.whole / length**3
    distance, pressure, settled = _minimize(energy, fill * whole, first)
    depth = length * energy.wetting.depth_in_oil(energy.gap(distance))
    if not settled:
        LOG.info("the shape of %.4g %% oil did not come to rest in %d steps", 100.0 * fill, STEPS)
    return Rest(cavity, length * distance, depth, fill, energy.value(distance), liquids.tension / length * pressure,
                liquids.density_difference * liquids.gravity * np.asarray(down, float), settled)


def refined_start(coarse: Rest, fine: StarCavity, cuts: int) -> np.ndarray:
    """Distances, m, for a cavity of one cut more, (n,): the gap of the coarse one halfway between its directions."""
    share = coarse.distance / coarse.cavity.radius
    return np.append(share, share[parents(cuts)].mean(axis=1)) * fine.radius


def _minimize(energy: Energy, volume: float, distance: np.ndarray) -> tuple[np.ndarray, float, bool]:
    """Distances of least energy at a volume, the pressure that goes with them, and whether they have settled."""
    pressure, damping, stiffness = FIRST_PRESSURE, DAMPING, STIFFNESS / volume
    now, missing = energy.value(distance), volume - energy.volume(distance)
    for _ in range(STEPS):
        slope = energy.derivatives(distance)
        bend = energy.matrix(slope.energy_bend - pressure * slope.volume_bend)
        force = slope.energy - pressure * slope.volume
        inertia = scipy.sparse.diags(energy.share * energy.radius**2)
        while True:
            aimed = float(np.clip(missing, -LARGEST_CHANGE * volume, LARGEST_CHANGE * volume))
            step, rise = _step(energy, distance, bend + damping * inertia, force, slope.volume, aimed)
            tried = np.clip(distance + step, CLOSEST * energy.radius, energy.radius)
            value, left = energy.value(tried), volume - energy.volume(tried)
            # What decides is the energy at this pressure, with the missing volume punished. (R6)
            gain = now - value + (pressure + rise) * (missing - left) + 0.5 * stiffness * (missing**2 - left**2)
            if (gain >= -1e-10 * now and np.abs(step).max() < LONGEST_STEP) or damping > MOST_DAMPING:
                break
            damping *= 4.0
        change = np.abs(tried - distance).max()
        distance, pressure, now, missing = tried, pressure + rise, value, left
        damping = max(damping / 3.0, LEAST_DAMPING)
        if change < SETTLED and abs(missing) < VOLUME_ERROR * volume:
            return distance, pressure, bool((distance > CLOSEST * energy.radius).all())
    return distance, pressure, False


def _step(energy: Energy, distance: np.ndarray, bend, force: np.ndarray, swell: np.ndarray,
          missing: float) -> tuple[np.ndarray, float]:
    """Newton's step of the distances, (n,), and of the pressure: no force is left and no volume is missing. (R5)"""
    at_wall = distance >= energy.radius - 1e-9
    staying = at_wall & (force < 0.0)
    for _ in range(JOINING):
        free = np.flatnonzero(~staying)
        solve = scipy.sparse.linalg.splu(bend[free][:, free].tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0,
                                         options={"SymmetricMode": True}).solve
        by_force, by_swell = solve(np.stack([force[free], swell[free]], axis=1)).T
        rise = (missing + swell[free] @ by_force) / (swell[free] @ by_swell)
        step = np.zeros(len(distance))
        step[free] = rise * by_swell - by_force
        pushed = at_wall & (step > 1e-9)
        if not pushed.any():
            break
        staying |= pushed
    return step, float(rise)
