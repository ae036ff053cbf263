"""Dimensionless numbers and time scales of a scene, from its scales: estimates for an order of magnitude."""
from pipeline.scenes.model import Scene
from sim.advice import Quantity
from sim.scales import Scales, Start


def scales_of(scene: Scene, cavity_volume: float) -> Scales:
    """Return the scales of a scene whose cavity has a volume, m^3 (m^2 in two dimensions)."""
    fill = scene.initial.fill or ({scene.initial.liquid: 1.0} if scene.initial.liquid else {})
    start = Start(fill, scene.blocks, scene.container.size if scene.container else ())
    return Scales(scene.settings(), start, cavity_volume, scene.output.duration)


def dimensionless_numbers(scales: Scales) -> list[Quantity]:
    """Return the dimensionless numbers that the scene has."""
    numbers = [Quantity(f"Re {liquid.name}", liquid.density * scales.speed * scales.length / liquid.dynamic_viscosity,
                        "", "Reynolds, rho U L/mu of this liquid: inertia over viscosity")
               for liquid in scales.liquids if liquid.dynamic_viscosity > 0.0]
    numbers += [one for effect, parameters in scales.effects for one in effect.numbers(parameters, scales)]
    if len(scales.liquids) > 1:
        densities, viscosities = ([getattr(liquid, name) for liquid in scales.liquids]
                                  for name in ("density", "dynamic_viscosity"))
        numbers.append(Quantity("density ratio", max(densities) / min(densities), "", "heaviest over lightest liquid"))
        if min(viscosities) > 0.0:
            numbers.append(Quantity("viscosity ratio", max(viscosities) / min(viscosities), "",
                                    "mu of the stiffest over that of the thinnest liquid"))
    return numbers


def time_scales(scales: Scales) -> list[Quantity]:
    """Return the times in which the effects of the scene act, in s."""
    times = [one for effect, parameters in scales.effects for one in effect.time_scales(parameters, scales)]
    if scales.speed > 0.0:
        times.append(Quantity("inertial", scales.length / scales.speed, "s", "L/U: the liquid passes L"))
    return [*times, Quantity("scene", scales.duration, "s", "simulated time")]
