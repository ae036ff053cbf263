"""What limits the time step of a scene, and how many steps it takes; limits by speed and acceleration are estimates."""
import dataclasses
import math

from pipeline.advice.dimensionless_numbers import Scales
from sim.schemes.wcsph import MACH, WCSPHParameters
from sim.time_step import known_limits

FIXED = "numerics.time_step"
ESTIMATE = "estimate: "


@dataclasses.dataclass(frozen=True)
class Limit:
    """A limit of the time step.

    Attributes
    ----------
    source : key of the scene file or part of the solver that sets it.
    value : s, infinite where this source sets none.
    meaning : where the number comes from.
    """

    source: str
    value: float
    meaning: str


def time_step_limits(scales: Scales) -> list[Limit]:
    """Return all limits of the time step, the smallest first."""
    numerics = scales.scene.numerics
    limits = [Limit(source, value, "of its own, from the scene") for source, value in
              known_limits(scales.scene.settings()).items()]
    if scales.speed > 0.0:
        limits.append(Limit("the speed of the liquids", numerics.courant_number * scales.spacing / scales.speed,
                            f"{ESTIMATE}courant_number dx/U"))
    acceleration = largest_acceleration(scales)
    if acceleration > 0.0:
        limits.append(Limit("the acceleration of the liquids", 0.5 * math.sqrt(scales.spacing / acceleration),
                            f"{ESTIMATE}sqrt(dx/a)/2 by weight and jolts"))
    if numerics.scheme == "wcsph":
        limits = [_acoustic_limit(scales) if limit.source == "the scheme wcsph" and math.isinf(limit.value) else limit
                  for limit in limits]
    if numerics.time_step is not None:
        limits.append(Limit(FIXED, numerics.time_step, "fixed by the scene"))
    return sorted(limits, key=lambda limit: limit.value)


def largest_acceleration(scales: Scales) -> float:
    """Largest acceleration by weight and jolts; in a full cavity by the difference of weights, m/s2."""
    jolt = max((math.hypot(*jolt.acceleration[: scales.scene.dimension]) for jolt in scales.jolts), default=0.0)
    return scales.buoyancy(scales.gravity + jolt)


def deciding_limit(limits: list[Limit]) -> Limit:
    """Return the limit that decides the time step: a fixed one, else the smallest."""
    return next((limit for limit in limits if limit.source == FIXED), limits[0])


def step_count(scales: Scales, limit: float) -> int:
    """Return the number of steps of a scene with steps of at most ``limit`` s; every frame ends with a whole step."""
    interval = scales.scene.output.frame_interval
    return (scales.scene.frame_count - 1) * max(1, math.ceil(interval / limit - 1e-9))


def _acoustic_limit(scales: Scales) -> Limit:
    """Acoustic limit with the speed of sound as WCSPH chooses it: over the largest expected speed, here an estimate."""
    scene = scales.scene
    parameters = scene.schemes.get("wcsph") or WCSPHParameters()
    support = scene.numerics.support_ratio * scales.spacing
    expected = [scales.speed]
    if scene.closed:  # it expects the fall through the cavity, whatever viscosity makes of it, and jolts in full
        expected.append(math.sqrt(2.0 * scales.buoyancy(scales.gravity) * scales.width))
        expected += [2.0 / math.pi * math.hypot(*jolt.acceleration) * jolt.duration for jolt in scales.jolts]
    if scales.tension:
        expected.append(math.sqrt(math.pi * scales.tension / (2.0 * scales.density * scales.spacing)))
    if "cohesion" in scene.effects:
        gamma = max(scene.effects["cohesion"].coefficients(scene.settings()))
        expected.append(math.sqrt(0.06 * gamma * scales.density * support))
    if "curvature" in scene.effects:
        expected.append(math.sqrt(scene.effects["curvature"].gamma * support))
    sound = max(expected) / MACH
    limit = parameters.acoustic_courant_number * 0.5 * support / (sound + scales.speed) if sound else math.inf
    return Limit("the scheme wcsph", limit, f"{ESTIMATE}sound at {sound:.3g} m/s, ten times the largest expected speed")
