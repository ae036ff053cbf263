"""Droplets that eye movements tear off the oil where oil, aqueous and wall meet.

The interface away from the wall does not emulsify under saccades, it only bends [wang2022, abstract]; droplets form at
the three-phase contact line [wang2021, abstract]. No law for their number is published. The one here has the factors
that are: more droplets with more shear, and fewer with a higher interfacial tension (proteins lower it) and a higher
viscosity of the oil [crisp1987, abstract]. One saccade takes off, per length of the contact line, a thread of droplets
of the cross-section

    efficiency d^2 Ca mu_ref/mu_oil,    Ca = mu_aqueous shear_rate d / sigma,

with the droplet's own capillary number Ca, so that oil is lost at `saccade_rate` times that per length and time. The
shear rate at the wall is that of a saccade: a rotation by the amplitude A within the duration D = 21 ms + 2.2 ms/deg A
of the main sequence, with the peak rate 1.875 A/D of a minimum-jerk turn. A wall that oscillates with the frequency
Omega = pi/D and the speed U shears the liquid by U sqrt(Omega/nu) (Stokes' second problem): a layer of 0.1 mm, which no
scene resolves. Where `shear` is "flow", the flow of the scene along the wall gives the shear rate in its place.

The droplets are far smaller than the particles: they are a liquid of their own, of the oil's density, as a volume
fraction. Within two particle spacings of the wall an oil particle i and an aqueous neighbor j exchange volume: droplets
arrive in j, and the aqueous whose place they take goes to i. So the volume of oil and droplets together, that of the
aqueous, each particle's volume, mass and momentum are conserved, and the fractions stay in [0, 1]
(``sim.effects.parts.mixture``). The length of the contact line is the sum over the pairs

    l_ij = C b_i b_j V_i V_j |W'| (alpha_oil,i alpha_aqueous,j + alpha_oil,j alpha_aqueous,i)

with the weight b of the layer at the wall, 1/m, whose integral over the depth is 1. Along a straight line in the wall
the sum of |W'| over the pairs across it is 1/C per length: with the distance s along the wall and the mean over the
depths of both particles, 1/C = 2 int <|W'|> s^2 ds (the 2 is the mean |cos| of 2/pi times pi), and int <|W'|> s ds in
two dimensions, where the line is a point and its length 1. That is for an interface upright on the wall; one that meets
the wall at a small angle runs on in the layer, and its line counts up to 1/sin(angle) times.

What is left out: droplets do not merge, are all of one size, and are not stirred by the saccades (so that they end in
the highest particles of the aqueous: weight over Brownian motion gives a layer of 7 um); nothing but the efficiency
stands for proteins, remnants of other liquids and impurities of the oil. The few millionths of aqueous that an oil
particle has taken up let droplets drift into it: 0.3 % of them after half a year in emulsification_contact_line.
Equations: docs/methods/mixtures.md.
"""
import dataclasses
import math

import numpy as np

from sim.advice import SEEN_EFFECT, WARNING, Advice, shown
from sim.backend import data_oriented, real, ti
from sim.effects.parts.mixture import Mixing
from sim.fields import Field
from sim.parameters import parameter
from sim.reductions import blocks, first, last, total_of

LAYER = 2.0  # depth of the layer at the wall in which the contact line is found, in particle spacings
# Main sequence of saccades: duration at no amplitude, s, and per amplitude, s/rad (2.2 ms per degree).
SACCADE_TIME, TIME_PER_ANGLE = 21e-3, 2.2e-3 / math.radians(1.0)
PEAK = 1.875  # peak over mean rate of a minimum-jerk turn
QUADRATURE = 400  # intervals of the integral over the kernel, along the wall and in depth


@dataclasses.dataclass(frozen=True)
class ContactLineEmulsificationParameters:
    """Droplets from the contact line of oil, aqueous and wall, by eye movements; defaults marked A are assumptions."""

    oil: str = parameter(liquid=True, meaning="liquid that loses droplets")
    aqueous: str = parameter(liquid=True, meaning="liquid that takes them up")
    droplets: str = parameter(liquid=True, meaning="the oil in droplets: a liquid of the oil's density")
    droplet_diameter: float = parameter(1.5e-6, unit="m", exclusive_minimum=0.0, maximum=1e-3,
                                        meaning="diameter d of a droplet; of those washed out of eyes, 81 % are of 1 "
                                                "to 2 um (Yu et al. 2020)")
    interface_tension: float = parameter(0.04, unit="N/m", exclusive_minimum=0.0, maximum=1.0,
                                         meaning="tension that holds a droplet back; 40 mN/m clean, 15 with proteins")
    reference_viscosity: float = parameter(1.0, unit="Pa*s", exclusive_minimum=0.0, maximum=100.0,
                                           meaning="viscosity of the oil for which the efficiency holds")
    efficiency: float = parameter(0.1, minimum=0.0, maximum=1e6,
                                  meaning="cross-section torn off per saccade over d^2 Ca mu_ref/mu_oil (A: gives "
                                          "the droplets of wash-outs in the scene emulsification_contact_line)")
    saccade_rate: float = parameter(2.0, unit="1/s", minimum=0.0, maximum=100.0,
                                    meaning="saccades per time, the night included (A: 3 per second for 16 of 24 h)")
    saccade_amplitude: float = parameter(math.radians(10.0), unit="rad", minimum=0.0, maximum=math.radians(60.0),
                                         meaning="turn in one saccade")
    saccade_axis: tuple[float, float, float] = parameter(
        (0.0, 1.0, 0.0), meaning="axis of the saccades through the origin; (0, 1, 0): they are horizontal")
    shear: str = parameter("saccades", choices=("saccades", "flow"),
                           meaning="what shears the contact line: saccades as above, or the flow of the scene")
    start: float = parameter(0.0, unit="s", minimum=0.0, meaning="time at which the emulsification begins")
    time_lapse: float = parameter(1.0, exclusive_minimum=0.0, maximum=1e9,
                                  meaning="seconds of emulsification that one simulated second shows")


def saccade_duration(amplitude: float) -> float:
    """Duration of a saccade of an amplitude, rad, in s (main sequence)."""
    return SACCADE_TIME + TIME_PER_ANGLE * amplitude


def saccade_speed(amplitude: float) -> float:
    """Peak rate of rotation in a saccade of an amplitude, rad, in rad/s."""
    return PEAK * amplitude / saccade_duration(amplitude)


def shear_per_distance(amplitude: float, aqueous) -> float:
    """Shear rate at the wall in a saccade (amplitude in rad) per distance from its axis, 1/(m s).

    Stokes' second problem: a wall that oscillates with the speed U and the frequency Omega shears by U sqrt(Omega/nu).
    """
    frequency = math.pi / saccade_duration(amplitude)
    return saccade_speed(amplitude) * math.sqrt(frequency * aqueous.density / aqueous.dynamic_viscosity)


def volume_per_shear(parameters, oil, aqueous) -> float:
    """Volume torn off per length of the contact line, simulated time and shear rate at the wall, m2."""
    capillary_number_per_shear = aqueous.dynamic_viscosity * parameters.droplet_diameter / parameters.interface_tension
    cross_section = (parameters.efficiency * parameters.droplet_diameter**2 * capillary_number_per_shear  # (M7)
                     * parameters.reference_viscosity / oil.dynamic_viscosity)
    return parameters.time_lapse * parameters.saccade_rate * cross_section


def _check_droplets(parameters, liquids):
    key = ("effects", "contact_line_emulsification")
    chosen = {name: getattr(parameters, name) for name in ("oil", "aqueous", "droplets")}
    if len(liquids) < 3 or len(set(chosen.values())) < 3:
        given = ", ".join(f"{name} {value}" for name, value in chosen.items())
        yield key, ("needs three liquids: oil, aqueous, and the oil in droplets as a third liquid of the scene, but it "
                    f"has {given}")
        return
    densities = {liquid.name: liquid.density for liquid in liquids}
    if densities[parameters.droplets] != densities[parameters.oil]:
        yield ((*key, "droplets"),
               f"is {parameters.droplets} of {densities[parameters.droplets]:g} kg/m3, but must have the density of "
               f"{parameters.oil}, {densities[parameters.oil]:g} kg/m3, of which it consists")
    for name in ("oil", "aqueous"):
        if not next(liquid.dynamic_viscosity for liquid in liquids if liquid.name == chosen[name]):
            yield ("liquids", chosen[name], "dynamic_viscosity"), "is 0 Pa s, but must be above 0 to tear off droplets"
    if np.linalg.norm(parameters.saccade_axis) == 0.0:
        yield (*key, "saccade_axis"), "is 0, 0, 0, but must have a direction"


@data_oriented
class ContactLineEmulsification(Mixing):
    """Exchange of oil for droplets between the particles at the contact line."""

    name = "contact_line_emulsification"
    Parameters = ContactLineEmulsificationParameters
    traces = 1  # the oil in droplets is a part of the aqueous, a few millionths of it
    checks = (_check_droplets,)
    fields = (
        *Mixing.fields,
        Field("wall_layer_weight", "scalar", "1/m", "weight of the layer at the wall, its integral over depth is 1"),
        Field("wall_shear_rate", "scalar", "1/s", "shear rate at the wall"),
    )

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        names = [liquid.name for liquid in solver.liquids]
        chosen = (parameters.oil, parameters.aqueous, parameters.droplets)
        if len(set(chosen)) < 3:
            raise ValueError("contact_line_emulsification needs three liquids: oil, aqueous, and the oil in droplets")
        self.oil, self.aqueous, self.droplets = (names.index(name) for name in chosen)
        oil, aqueous, droplets = (solver.liquids[index] for index in (self.oil, self.aqueous, self.droplets))
        if oil.density != droplets.density:
            raise ValueError(f"{droplets.name} must have the density of {oil.name}, of which it consists, to conserve "
                             "mass")
        self.distance, self.dimension = solver.distance, solver.dimension
        self.layer = LAYER * solver.spacing
        self.kernel_weight = ti.field(real(), shape=())  # C
        self._set_kernel_weight(self._kernel_integral())
        self.acts = parameters.efficiency > 0.0 and parameters.saccade_rate > 0.0
        if self.acts and not (oil.dynamic_viscosity > 0.0 and aqueous.dynamic_viscosity > 0.0):
            raise ValueError(f"contact_line_emulsification needs a dynamic_viscosity above 0 of {oil.name} and "
                             f"{aqueous.name}")
        self.shear_per_distance = shear_per_distance(parameters.saccade_amplitude, aqueous) if self.acts else 0.0
        axis = np.array(parameters.saccade_axis) / np.linalg.norm(parameters.saccade_axis)
        self.axis = ti.Vector([float(v) for v in axis[: self.dimension]])
        self.measures_flow = parameters.shear == "flow"
        self.line_length = ti.field(ti.f64, shape=())
        self.volume_per_shear = volume_per_shear(parameters, oil, aqueous) if self.acts else 0.0

    @classmethod
    def idle(cls, parameters, settings) -> str:
        if parameters.efficiency and parameters.saccade_rate:
            return ""
        return cls.nothing_mixes(settings, "its efficiency or its saccade_rate is 0")

    @classmethod
    def interface_oil(cls, parameters) -> str:
        return parameters.oil

    @classmethod
    def droplet_liquid(cls, parameters) -> str:
        return parameters.droplets

    @classmethod
    def advice(cls, parameters, scales, limits):
        if parameters is None:
            return
        effect, duration = parameters, scales.duration
        if effect.start >= duration or effect.efficiency == 0.0 or effect.saccade_rate == 0.0:
            yield Advice(WARNING, cls.name, f"makes no droplets: it starts at {shown(effect.start, 's')} of "
                                            f"{shown(duration, 's')}, with an efficiency of {effect.efficiency:g} and "
                                            f"{effect.saccade_rate:g} saccades per second")
            return
        liquids = {liquid.name: liquid for liquid in scales.settings.liquids}
        oil, aqueous = liquids[effect.oil], liquids[effect.aqueous]
        shear = shear_per_distance(effect.saccade_amplitude, aqueous) * scales.length
        loss = volume_per_shear(effect, oil, aqueous) * shear * 2.0 * math.pi * scales.length
        lapse = (duration - effect.start) * effect.time_lapse
        share = loss * (duration - effect.start) / scales.cavity_volume
        source = "the flow of the scene shears the wall" if effect.shear == "flow" else (
            f"saccades shear the wall by {shear:.3g} 1/s; along an equator the oil would lose {share:.2g} of the "
            "cavity")
        yield Advice(SEEN_EFFECT, cls.name, f"{source}; the scene shows {lapse / 86400.0:.3g} days of it")
        yield from cls._advice_on_transport(effect, scales)

    @classmethod
    def _advice_on_transport(cls, parameters, scales):
        if not scales.transport_of_droplets:
            yield Advice(WARNING, cls.name, "its droplets stay where the flow takes them: without the effect drift "
                                            "none rises")
        for name, factor in scales.transport_of_droplets.items():
            if not math.isclose(factor, parameters.time_lapse, rel_tol=0.01):
                yield Advice(WARNING, cls.name, f"one second shows {parameters.time_lapse:.3g} s of its droplets, but "
                                                f"{factor:.3g} s of their rise (effects.{name}.coefficient)")
        if scales.settings.numerics.precision != "f64":
            yield Advice(WARNING, cls.name, "a share of droplets of some 1e-6 is lost in numbers of seven digits: use "
                                            "numerics.precision f64")

    @ti.kernel
    def _kernel_integral(self) -> float:
        """Integral of <|W'|> s^(d-1) over the distance s along the wall, by the midpoint rule.

        Two particles of the layer differ in depth by u layers with the density 4/3 - 2 u + 2/3 u^3.
        """
        total = 0.0
        step = self.kernel.support_radius / QUADRATURE
        ti.loop_config(serialize=True)
        for n in range(QUADRATURE * QUADRATURE):
            s, u = (n % QUADRATURE + 0.5) * step, (n // QUADRATURE + 0.5) / QUADRATURE
            r = ti.sqrt(s * s + (u * self.layer) ** 2)
            density = 2.0 * (4.0 / 3.0 - 2.0 * u + 2.0 / 3.0 * u**3)
            total -= density / QUADRATURE * self.kernel.gradient_factor(r) * r * s ** (self.dimension - 1) * step
        return total

    def _set_kernel_weight(self, integral: float) -> None:
        self.kernel_weight[None] = 1.0 / ((2.0 if self.dimension == 3 else 1.0) * integral)

    @ti.kernel
    def _measure_wall(self):
        for i in range(self.count[None]):
            x = self.particles.position[i]
            depth = ti.max(-self.distance.value(x), 0.0)
            self.particles.wall_layer_weight[i] = 2.0 / self.layer * ti.max(1.0 - depth / self.layer, 0.0)
            rate = 0.0
            if depth < self.layer:
                if ti.static(self.measures_flow):
                    normal = self.distance.normal(x)
                    v = self.particles.velocity[i]
                    rate = (v - v.dot(normal) * normal).norm() / ti.max(depth, 0.05 * self.layer)
                else:
                    rate = self.shear_per_distance * (x - x.dot(self.axis) * self.axis).norm()
            self.particles.wall_shear_rate[i] = rate

    @ti.func
    def _line(self, i, j, x_ij):
        """l_ij without the fractions (M8), over 2 V_i V_j |W'|/r: 1/m in three dimensions."""
        return 0.5 * self.kernel_weight[None] * x_ij.norm() * (
            self.particles.wall_layer_weight[i] * self.particles.wall_layer_weight[j])

    @ti.func
    def pair_rate(self, i, j, x_ij):
        shear = 0.5 * (self.particles.wall_shear_rate[i] + self.particles.wall_shear_rate[j])
        return self.volume_per_shear * shear * self._line(i, j, x_ij)

    @ti.func
    def pair_flux(self, i, j, x_ij):
        own, other = self.particles.volume_fraction[i], self.particles.volume_fraction[j]
        rate = self.pair_rate(i, j, x_ij)
        arriving = rate * other[self.oil] * own[self.aqueous]  # oil of j, as droplets
        leaving = rate * own[self.oil] * other[self.aqueous]
        flux = own * 0.0
        flux[self.droplets] = arriving
        flux[self.oil] = -leaving
        flux[self.aqueous] = leaving - arriving
        return flux

    def prepare(self, dt: float) -> None:
        if dt == 0.0 or not self.acts or self.solver.time < self.parameters.start:
            return
        self._measure_wall()
        self.mix(dt)

    @ti.kernel
    def _measure_line(self):
        n = self.count[None]
        for block in range(blocks(n)):
            length = ti.cast(0.0, ti.f64)
            for i in range(first(block, n), last(block, n)):
                own = self.particles.volume_fraction[i]
                total = 0.0
                for slot in range(self.pairs.count[i]):
                    k = self.pairs.entry(i, slot)
                    j = self.pairs.index[k]
                    x_ij = self._separation(i, j)
                    other = self.particles.volume_fraction[j]
                    total += self._weight(j, x_ij) * self._line(i, j, x_ij) * (
                        own[self.oil] * other[self.aqueous] + other[self.oil] * own[self.aqueous])
                length += 0.5 * self.particles.volume[i] * total
            self.partial[0, block] = length
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.line_length[None] = total_of(self.partial, 0, n)

    def contact_line_length(self) -> float:
        """Length of the contact line, m; in two dimensions the number of contact points."""
        self._measure_wall()
        self._measure_line()
        return self.line_length[None]
