"""Lengths and speeds of a scene, from its own numbers, which the hooks of effects and schemes read that say something.

They are estimates for an order of magnitude: one length and one speed stand for the whole scene.

- Length L: radius of the ball (in two dimensions the disc) that the cavity's volume would form; where blocks of liquid
  are given, that of the scarcest liquid.
- Speed U: the largest speed that the scene can give its liquids (:attr:`Scales.speeds`).
- Density: that of the heaviest liquid, unless a liquid is named; viscosity: that of the named or the stiffest liquid.
"""
import dataclasses
import functools
import math
from collections.abc import Mapping, Sequence

from sim.advice import Quantity
from sim.effect_selection import cheapest
from sim.effects import REGISTRY
from sim.effects.effect import RESISTS
from sim.settings import Liquid, Settings


@dataclasses.dataclass(frozen=True)
class Start:
    """What fills the cavity at the start.

    Attributes
    ----------
    fill : share of the cavity that each liquid holds, by name; empty where blocks or another scene tell it.
    blocks : bodies of liquid in a container, each with ``liquid``, ``volume``, corners ``lower`` and ``upper``,
        ``velocity``, and ``replaces``: whether it takes the place of what the blocks before it have where it is.
    box : sides of a container, m; empty for an eye.
    """

    fill: Mapping[str, float]
    blocks: Sequence = ()
    box: tuple[float, ...] = ()


class Scales:
    """Scales of one scene.

    Parameters
    ----------
    cavity_volume : m^3 (m^2 in two dimensions).
    duration : simulated time, s.
    """

    def __init__(self, settings: Settings, start: Start, cavity_volume: float, duration: float):
        self.settings, self.start = settings, start
        self.cavity_volume, self.duration, self.spacing = cavity_volume, duration, settings.numerics.particle_spacing
        chosen = {type(parameters): parameters for parameters in settings.effects}
        self.effects = [(effect, chosen[effect.Parameters]) for effect in REGISTRY.values()
                        if effect.Parameters in chosen]
        self.liquids = self._present()
        densities = [liquid.density for liquid in self.liquids]
        self.density = max(densities)
        self.density_difference = max(densities) - min(densities)
        self.stiffest = max(self.liquids, key=lambda liquid: liquid.dynamic_viscosity)
        self.gravity = sum(effect.weight_of(parameters) for effect, parameters in self.effects)
        tension = sum(effect.tension_of(parameters) for effect, parameters in self.effects)
        self.tension = tension if len(self.liquids) > 1 else 0.0
        self.viscous = self.does(RESISTS)

    def _present(self) -> tuple[Liquid, ...]:
        """The liquids that are ever in the cavity; an earlier scene may have left any."""
        names = {*(block.liquid for block in self.start.blocks), *self.start.fill}
        names |= {name for effect, parameters in self.effects for name in effect.brings(parameters)}
        any_of_them = self.settings.continued or not names
        return tuple(one for one in self.settings.liquids if any_of_them or one.name in names)

    def has(self, effect: str) -> bool:
        """Whether the scene has an effect of that name."""
        return any(effect == one.name for one, _ in self.effects)

    def does(self, what: str) -> bool:
        """Whether an effect of the scene does something (``sim.effects.effect``)."""
        return any(what in effect.does for effect, _ in self.effects)

    def _yielded_by(self, hook: str) -> list:
        """All that the effects of the scene yield in a hook."""
        return [one for effect, parameters in self.effects for one in getattr(effect, hook)(parameters, self)]

    @property
    def pulled(self) -> bool:
        """Whether an effect pulls the interface together."""
        return any(effect.pulls(parameters) for effect, parameters in self.effects)

    @property
    def droplet_liquids(self) -> list[Liquid]:
        """Liquids that are droplets of another one."""
        names = {effect.droplet_liquid(parameters) for effect, parameters in self.effects}
        return [liquid for liquid in self.settings.liquids if liquid.name in names]

    @property
    def transport_of_droplets(self) -> dict[str, float]:
        """Factor of every effect that moves droplets, by its name."""
        found = {effect.name: effect.transport_of_droplets(parameters) for effect, parameters in self.effects}
        return {name: factor for name, factor in found.items() if factor is not None}

    @property
    def replacements(self) -> list[str]:
        """Which effects are done in a cheaper form, and why."""
        return cheapest(self.settings)[1]

    @property
    def wave_speeds(self) -> list[float]:
        """Speeds beside :attr:`speeds` that a compressible liquid has to be fast against, m/s."""
        return self._yielded_by("wave_speeds")

    @functools.cached_property
    def filled_volume(self) -> float:
        """Volume of all liquids, m^3 (m^2)."""
        return sum(block.volume for block in self.start.blocks if not block.replaces) or self.cavity_volume

    @functools.cached_property
    def length(self) -> float:
        """Characteristic length L, m."""
        volumes = {}
        for block in self.start.blocks:
            volumes[block.liquid] = volumes.get(block.liquid, 0.0) + block.volume
        return self.radius(min(volumes.values(), default=self.cavity_volume))

    @functools.cached_property
    def width(self) -> float:
        """Diameter of the ball (disc) with the volume of the cavity, m."""
        return 2.0 * self.radius(self.cavity_volume)

    def radius(self, volume: float) -> float:
        """Radius of the ball (disc) of a volume, m."""
        return math.sqrt(volume / math.pi) if self.settings.dimension == 2 else (0.75 * volume / math.pi) ** (1.0 / 3.0)

    def buoyancy(self, gravity: float) -> float:
        """Acceleration that sets the liquids in motion, m/s2: in a full cavity only the difference of weights does."""
        return gravity * (self.density_difference / self.density if self.settings.closed else 1.0)

    def buoyant_speed(self, gravity: float) -> float:
        """Speed after the fall through L in a full cavity, at most that at which the stiffest liquid gives way, m/s."""
        falling = math.sqrt(2.0 * self.buoyancy(gravity) * self.length)
        creeping = self.density_difference * gravity * self.length**2
        return min(falling, creeping / self._acting_viscosity) if self._acting_viscosity else falling

    def capillary_speed(self, tension: float) -> float:
        """Speed at which tension rounds a body of size L, against its inertia or its viscosity, m/s."""
        rounding = math.sqrt(tension / (self.density * self.length))
        return min(rounding, tension / self._acting_viscosity) if self._acting_viscosity else rounding

    @property
    def _acting_viscosity(self) -> float:
        return self.stiffest.dynamic_viscosity if self.viscous else 0.0

    @functools.cached_property
    def speeds(self) -> list[Quantity]:
        """Speeds that the scene can give its liquids, m/s; each is an estimate from above."""
        start = max((math.hypot(*block.velocity) for block in self.start.blocks), default=0.0)
        found = [Quantity("start", start, "m/s", "largest speed of a block at the start")] if start else []
        return found + self._yielded_by("speeds")

    @functools.cached_property
    def wall_speeds(self) -> list[Quantity]:
        """Speeds of the wall that do not count as speeds of the liquids, m/s."""
        return self._yielded_by("wall_speeds")

    @property
    def speed(self) -> float:
        """Characteristic speed U, the largest of :attr:`speeds`, m/s; 0 where nothing can move."""
        return max((quantity.value for quantity in self.speeds), default=0.0)

    def layer(self, liquid: Liquid) -> float:
        """Thickness sqrt(nu t) in which viscosity acts while the liquid passes L, or within the scene, m.

        It ends, as :meth:`reach` does, at the other side of the cavity.
        """
        time = min(self.length / self.speed, self.duration) if self.speed else self.duration
        return min(math.sqrt(liquid.dynamic_viscosity / liquid.density * time), self.width)

    def reach(self, acceleration: float, speed: float) -> float:
        """How far an acceleration moves liquid within the scene at no more than ``speed``, m."""
        return min(0.5 * acceleration * self.duration**2, speed * self.duration, self.width)

    def bond_number(self, gravity: float, tension: float) -> float:
        """Weight of the difference of densities over tension, for length L."""
        return self.density_difference * gravity * self.length**2 / tension

    def ohnesorge_number(self, liquid: Liquid) -> float:
        """Viscosity of a liquid over inertia and tension, for length L."""
        return liquid.dynamic_viscosity / math.sqrt(liquid.density * self.tension * self.length)
