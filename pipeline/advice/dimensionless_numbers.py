"""Lengths, speeds, dimensionless numbers and time scales of a scene, from its own numbers.

They are estimates for an order of magnitude: one length and one speed stand for the whole scene.

- Length L: radius of the ball (in two dimensions the disc) that the cavity's volume would form; where blocks of liquid
  are given, that of the scarcest liquid.
- Speed U: the largest speed that the scene can give its liquids (:attr:`Scales.speeds`).
- Density: that of the heaviest liquid, unless a liquid is named; viscosity: that of the named or the stiffest liquid.
"""
import dataclasses
import functools
import itertools
import math

import numpy as np

from pipeline.scenes.model import Scene
from sim.effects.gravity import POSTURES
from sim.settings import Liquid

EARTH_GRAVITY = 9.81  # m/s2, where a scene has no gravity of its own
# A turn follows the minimum-jerk profile: its peak rate is 15/8 and its peak acceleration 10/sqrt(3) of angle over
# duration and duration squared.
PEAK_RATE, PEAK_ACCELERATION = 15.0 / 8.0, 10.0 / math.sqrt(3.0)


def shown(value: float, unit: str) -> str:
    """Return a number in SI as people read it: three digits, small lengths, speeds and times in thousandths."""
    if math.isinf(value):
        return "none"
    if unit in ("m", "s", "m/s") and 0.0 < abs(value) < 0.1:
        return f"{1e3 * value:.3g} m{unit}"
    return f"{value:.3g} {unit}".rstrip()


@dataclasses.dataclass(frozen=True)
class Quantity:
    """A number of the scene with its unit (SI) and its definition in a phrase."""

    name: str
    value: float
    unit: str
    meaning: str


class Scales:
    """Scales of one scene.

    Parameters
    ----------
    cavity_volume : m^3 (m^2 in two dimensions).
    """

    def __init__(self, scene: Scene, cavity_volume: float):
        self.scene, self.cavity_volume = scene, cavity_volume
        self.duration, self.spacing = scene.output.duration, scene.numerics.particle_spacing
        self.liquids = _present(scene)
        densities = [liquid.density for liquid in self.liquids]
        self.density = max(densities)
        self.density_difference = max(densities) - min(densities)
        self.stiffest = max(self.liquids, key=lambda liquid: liquid.dynamic_viscosity)
        gravity, tension = scene.effects.get("gravity"), scene.effects.get("interface_tension")
        self.gravity = gravity.magnitude if gravity else 0.0
        self.turns = gravity.turns if gravity else ()
        self.jolts = gravity.jolts if gravity else ()
        self.rotation = scene.effects.get("eye_rotation")
        self.tension = tension.coefficient if tension and len(self.liquids) > 1 else 0.0
        self.viscous = bool(scene.effects.keys() & {"viscosity", "viscosity_implicit"})

    @functools.cached_property
    def filled_volume(self) -> float:
        """Volume of all liquids, m^3 (m^2)."""
        return sum(block.volume for block in self.scene.blocks if not block.replaces) or self.cavity_volume

    @functools.cached_property
    def length(self) -> float:
        """Characteristic length L, m."""
        volumes = {}
        for block in self.scene.blocks:
            volumes[block.liquid] = volumes.get(block.liquid, 0.0) + block.volume
        return self._radius(min(volumes.values(), default=self.cavity_volume))

    @functools.cached_property
    def width(self) -> float:
        """Diameter of the ball (disc) with the volume of the cavity, m."""
        return 2.0 * self._radius(self.cavity_volume)

    def _radius(self, volume: float) -> float:
        return math.sqrt(volume / math.pi) if self.scene.dimension == 2 else (0.75 * volume / math.pi) ** (1.0 / 3.0)

    def buoyancy(self, gravity: float) -> float:
        """Acceleration that sets the liquids in motion, m/s2: in a full cavity only the difference of weights does."""
        return gravity * (self.density_difference / self.density if self.scene.closed else 1.0)

    def buoyant_speed(self, gravity: float) -> float:
        """Speed after the fall through L in a full cavity, at most that at which the stiffest liquid gives way, m/s."""
        falling = math.sqrt(2.0 * self.buoyancy(gravity) * self.length)
        creeping = self.density_difference * gravity * self.length**2
        return min(falling, creeping / self._acting_viscosity) if self._acting_viscosity else falling

    def falling_speed(self, gravity: float) -> float:
        """Speed of the fall from the top of the liquid to the wall below, in any posture of the scene, m/s."""
        return math.sqrt(2.0 * gravity * self._fall_height)

    def capillary_speed(self, tension: float) -> float:
        """Speed at which tension rounds a body of size L, against its inertia or its viscosity, m/s."""
        rounding = math.sqrt(tension / (self.density * self.length))
        return min(rounding, tension / self._acting_viscosity) if self._acting_viscosity else rounding

    @property
    def _acting_viscosity(self) -> float:
        return self.stiffest.dynamic_viscosity if self.viscous else 0.0

    @property
    def _fall_height(self) -> float:
        gravity = self.scene.effects.get("gravity")
        postures = [gravity.posture, *(turn.to for turn in gravity.turns)] if gravity else ["upright"]
        heights = []
        for posture in postures:
            up = -np.array(POSTURES[posture][: self.scene.dimension])
            box = np.outer([0.0, 1.0], self.scene.container.size)
            tops = [np.maximum(up * block.lower, up * block.upper).sum() for block in self.scene.blocks]
            heights.append(max(tops) - np.minimum(up * box[0], up * box[1]).sum())
        return max(heights)

    @functools.cached_property
    def speeds(self) -> list[Quantity]:
        """Speeds that the scene can give its liquids, m/s; each is an estimate from above."""
        found = []
        start = max((math.hypot(*block.velocity) for block in self.scene.blocks), default=0.0)
        if start:
            found.append(Quantity("start", start, "m/s", "largest speed of a block at the start"))
        if self.gravity and not self.scene.closed:
            found.append(Quantity("fall", self.falling_speed(self.gravity), "m/s",
                                  "sqrt(2 g H), fall from the top of the liquid to the wall below"))
        elif self.gravity:
            found.append(Quantity("buoyant", self.buoyant_speed(self.gravity), "m/s",
                                  "the smaller of sqrt(2 g drho/rho L) and, with viscosity, drho g L2/mu of the "
                                  "stiffest liquid"))
        if self.jolts:
            found.append(Quantity("jolt", max(map(self._jolt_speed, self.jolts)), "m/s",
                                  "impulse of the jolt on the difference of weights, at most its buoyant speed"))
        if self.rotation:
            found.append(Quantity("rotation", self.rotation.peak * self.length, "m/s",
                                  "largest speed of the wall in a saccade or oscillation of the eye"))
        if "injection" in self.scene.effects:
            found.append(Quantity("jet", self._jet_speed(), "m/s",
                                  "flow through the surface of the droplet in which the liquid enters"))
        if self.tension:
            found.append(Quantity("capillary", self.capillary_speed(self.tension), "m/s",
                                  "the smaller of sqrt(sigma/(rho L)) and, with viscosity, sigma/mu of the stiffest "
                                  "liquid"))
        return found

    def _jolt_speed(self, jolt) -> float:
        peak = float(np.linalg.norm(jolt.acceleration[: self.scene.dimension]))
        impulse = self.buoyancy(peak) * jolt.duration * 2.0 / math.pi
        return min(impulse, self.buoyant_speed(peak)) if self.scene.closed else impulse

    def _jet_speed(self) -> float:
        injection, dimension = self.scene.effects["injection"], self.scene.dimension
        volume = injection.region_volume(self.spacing**dimension, dimension, self.scene.numerics.maximum_time_step)
        return injection.flow * self._radius(volume) / (dimension * volume)

    @property
    def speed(self) -> float:
        """Characteristic speed U, the largest of :attr:`speeds`, m/s; 0 where nothing can move."""
        return max((quantity.value for quantity in self.speeds), default=0.0)

    @property
    def turn_speed(self) -> float:
        """Largest speed of the wall in a turn, m/s."""
        return max((PEAK_RATE * angle / turn.duration * self.length for turn, angle in self.turn_angles), default=0.0)

    @property
    def turn_acceleration(self) -> float:
        """Largest acceleration of the wall in a turn, m/s2."""
        return max((PEAK_ACCELERATION * angle / turn.duration**2 * self.length for turn, angle in self.turn_angles),
                   default=0.0)

    @property
    def turn_angles(self) -> list:
        """Turns that the scene reaches, with their angles in rad."""
        if not self.turns:
            return []
        postures = [self.scene.effects["gravity"].posture, *(turn.to for turn in self.turns)]
        cosines = [float(np.dot(POSTURES[one], POSTURES[other])) for one, other in itertools.pairwise(postures)]
        return [(turn, math.acos(cosine)) for turn, cosine in zip(self.turns, cosines, strict=True)
                if turn.start < self.duration]

    def layer(self, liquid: Liquid) -> float:
        """Thickness sqrt(nu t) in which viscosity acts while the liquid passes L, or within the scene, m.

        It ends, as :meth:`reach` does, at the other side of the cavity.
        """
        time = min(self.length / self.speed, self.duration) if self.speed else self.duration
        return min(math.sqrt(liquid.dynamic_viscosity / liquid.density * time), self.width)

    def reach(self, acceleration: float, speed: float) -> float:
        """How far an acceleration moves liquid within the scene at no more than ``speed``, m."""
        return min(0.5 * acceleration * self.duration**2, speed * self.duration, self.width)

    @property
    def injected_volume(self) -> float:
        """Volume that the injection brings in, m^3; what a scene starts from is taken as empty of that liquid."""
        injection, initial = self.scene.effects["injection"], self.scene.initial
        present = (initial.fill or {}).get(injection.liquid, 0.0)
        for block in self.scene.blocks:
            if block.liquid == injection.liquid:
                present += block.volume / self.cavity_volume
        return max(injection.fill - present, 0.0) * self.cavity_volume

    def bond_number(self, gravity: float, tension: float) -> float:
        """Weight of the difference of densities over tension, for length L."""
        return self.density_difference * gravity * self.length**2 / tension

    def ohnesorge_number(self, liquid: Liquid) -> float:
        """Viscosity of a liquid over inertia and tension, for length L."""
        return liquid.dynamic_viscosity / math.sqrt(liquid.density * self.tension * self.length)


def _present(scene: Scene) -> tuple[Liquid, ...]:
    """Return the liquids that are ever in the cavity; an earlier scene may have left any."""
    names = {block.liquid for block in scene.blocks} | set(scene.initial.fill or ())
    names |= {scene.initial.liquid} if scene.initial.liquid else set()
    if "injection" in scene.effects:
        names |= {scene.effects["injection"].liquid}
    return tuple(one for one in scene.liquids if one.name in names or scene.start_from is not None or not names)


def dimensionless_numbers(scales: Scales) -> list[Quantity]:
    """Return the dimensionless numbers that the scene has."""
    numbers = []
    length, speed, tension = scales.length, scales.speed, scales.tension
    viscous = [liquid for liquid in scales.liquids if liquid.dynamic_viscosity > 0.0]
    for liquid in viscous:
        numbers.append(Quantity(f"Re {liquid.name}", liquid.density * speed * length / liquid.dynamic_viscosity, "",
                                "Reynolds, rho U L/mu of this liquid: inertia over viscosity"))
    if tension:
        numbers += [
            Quantity("Bo", scales.bond_number(scales.gravity, tension), "",
                     "Bond, drho g L2/sigma: difference of weights over tension"),
            Quantity("We", scales.density * speed**2 * length / tension, "",
                     "Weber, rho U2 L/sigma of the heaviest liquid: inertia over tension"),
            Quantity("Ca", scales.stiffest.dynamic_viscosity * speed / tension, "",
                     "capillary, mu U/sigma of the stiffest liquid: viscosity over tension"),
            *(Quantity(f"Oh {liquid.name}", scales.ohnesorge_number(liquid), "",
                       "Ohnesorge, mu/sqrt(rho sigma L) of this liquid: above 0.77 a drop of it does not ring")
              for liquid in viscous)]
    diffusion = scales.scene.effects.get("diffusion")
    if diffusion and diffusion.coefficient:
        numbers.append(Quantity("Pe", speed * length / diffusion.coefficient, "",
                                "Peclet, U L/D: transport by flow over diffusion"))
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
    length, viscosity = scales.length, scales.stiffest.dynamic_viscosity
    creeps = scales.viscous and viscosity > 0.0
    times = []
    if scales.tension:
        times.append(("capillary", math.sqrt(scales.density * length**3 / scales.tension),
                      "sqrt(rho L3/sigma): tension against inertia"))
        if creeps:
            times.append(("capillary, viscous", viscosity * length / scales.tension,
                          "mu L/sigma of the stiffest liquid: tension against viscosity"))
    times += [(f"viscous, {liquid.name}", length**2 * liquid.density / liquid.dynamic_viscosity,
               "rho L2/mu: viscosity stops or starts the flow of this liquid")
              for liquid in scales.liquids if scales.viscous and liquid.dynamic_viscosity > 0.0]
    if scales.buoyancy(scales.gravity) > 0.0:
        closed = scales.scene.closed
        times.append(("buoyancy" if closed else "gravity", math.sqrt(length / scales.buoyancy(scales.gravity)),
                      "sqrt(L rho/(drho g)): difference of weights against inertia" if closed else
                      "sqrt(L/g): free fall through L"))
        if creeps and closed:
            times.append(("buoyancy, viscous", viscosity / (scales.density_difference * scales.gravity * length),
                          "mu/(drho g L) of the stiffest liquid: difference of weights against viscosity"))
    if scales.speed > 0.0:
        times.append(("inertial", length / scales.speed, "L/U: the liquid passes L"))
    diffusion, injection = (scales.scene.effects.get(name) for name in ("diffusion", "injection"))
    if diffusion and diffusion.coefficient:
        times.append(("diffusion", length**2 / diffusion.coefficient, "L2/D: the liquids are mixed all over"))
    if injection:
        times.append(("injection", injection.time_of(scales.injected_volume) - injection.start,
                      "volume to inject over flow, which rises first"))
    if scales.turns:
        times.append(("turn", min(turn.duration for turn in scales.turns), "shortest turn of the posture"))
    if scales.rotation:
        times.append(("rotation", scales.rotation.shortest, "shortest saccade, or half a period of the oscillation"))
    times.append(("scene", scales.duration, "simulated time"))
    return [Quantity(name, value, "s", meaning) for name, value, meaning in times]
