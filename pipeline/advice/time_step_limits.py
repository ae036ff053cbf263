"""What limits the time step of a scene, and how many steps it takes; limits by speed and acceleration are estimates."""
import math

from pipeline.scenes.model import Scene
from sim.advice import ESTIMATE, Limit
from sim.scales import Scales
from sim.time_step import known_limits

FIXED = "numerics.time_step"


def time_step_limits(scales: Scales) -> list[Limit]:
    """Return all limits of the time step, the smallest first."""
    numerics = scales.settings.numerics
    limits = [Limit(source, value, "of its own, from the scene") for source, value in
              known_limits(scales.settings).items()]
    if scales.speed > 0.0:
        limits.append(Limit("the speed of the liquids", numerics.courant_number * scales.spacing / scales.speed,
                            f"{ESTIMATE}courant_number dx/U"))
    acceleration = largest_acceleration(scales)
    if acceleration > 0.0:
        limits.append(Limit("the acceleration of the liquids", 0.5 * math.sqrt(scales.spacing / acceleration),
                            f"{ESTIMATE}sqrt(dx/a)/2 by weight and jolts"))
    estimate = scales.settings.scheme_class.expected_time_step_limit(scales)
    if estimate:
        limits = [estimate, *(limit for limit in limits if limit.source != estimate.source)]
    if numerics.time_step is not None:
        limits.append(Limit(FIXED, numerics.time_step, "fixed by the scene"))
    return sorted(limits, key=lambda limit: limit.value)


def largest_acceleration(scales: Scales) -> float:
    """Largest acceleration by weight and jolts; in a full cavity by the difference of weights, m/s2."""
    return scales.buoyancy(sum(effect.largest_weight_of(parameters, scales.settings.dimension)
                               for effect, parameters in scales.effects))


def deciding_limit(limits: list[Limit]) -> Limit:
    """Return the limit that decides the time step: a fixed one, else the smallest."""
    return next((limit for limit in limits if limit.source == FIXED), limits[0])


def step_count(scene: Scene, limit: float) -> int:
    """Return the number of steps of a scene with steps of at most ``limit`` s; every frame ends with a whole step."""
    interval = scene.output.frame_interval
    return (scene.frame_count - 1) * max(1, math.ceil(interval / limit - 1e-9))
