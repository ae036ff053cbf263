"""Drift of the liquids through each other: droplets of each rise or sink in the others [song, eqs. 10-13].

Droplets of liquid k, of diameter d, would move with u_k relative to what surrounds them,

    du_k/dt = (1 - rho/rho_k) (g - Dv/Dt) - u_k/tau_k,
    tau_k = rho_k d^2/(18 mu_c) 3 (1 + lambda)/(2 + 3 lambda),  lambda = mu_k/mu_c,

rho the density of the mixture and mu_c the viscosity of the liquids around the droplet (drag of Stokes, with the flow
inside the droplet after [hadamard1911; rybczynski1911]). [song, eq. 12] has no drag, so that its drift grows without
limit, and its drift velocities do not add up to zero. Here only the slip u_k - u_l of two liquids counts, so that
v_k^d = u_k - sum alpha_l u_l adds up to zero by itself. The local equilibrium that is assumed in [song, eq. 11;
manninen1996] is u_k = tau_k (1 - rho/rho_k) (g - Dv/Dt); the dynamic form takes the time tau_k to reach it, is advanced
by its exact solution for a constant force, and has the same limit for any time step.

Since alpha_k v_k^d = sum_l alpha_k alpha_l (u_k - u_l), the transport C_m div(alpha_k v_k^d) is a sum of exchanges of
pairs of liquids. With w = ((u_k - u_l)_i + (u_k - u_l)_j)/2 . x_ij/r above zero, i gains from j
2 dt C_m V_i V_j |W'| alpha_k,j alpha_l,i w of k for as much of l: the donor must have k and the receiver l, which keeps
the fractions in [0, 1]. Equations: docs/methods/mixtures.md.
"""
import dataclasses
import math

from sim.advice import SEEN_EFFECT, WARNING, Advice, if_alone, if_zero, is_seen, shown, times
from sim.backend import data_oriented, real, ti
from sim.effects.parts.mixture import Mixing
from sim.fields import Field
from sim.liquid import Liquid
from sim.parameters import parameter

TRACE = 1e-9  # share of every liquid in the surroundings of a droplet, so that pure liquid has surroundings too
STOKES_REYNOLDS = 1.0  # at Re 1 the drag is 19 % above that of Stokes (Oseen: 3/16 Re), and beyond droplets are far
# slower


@dataclasses.dataclass(frozen=True)
class DriftParameters:
    """Rise and sinking of droplets of each liquid in the others (Song et al., eqs. 10-13, corrected: with drag)."""

    droplet_diameter: float = parameter(unit="m", exclusive_minimum=0.0, maximum=1e-2, meaning="diameter of droplets")
    coefficient: float = parameter(1.0, minimum=0.0, maximum=1e9,
                                   meaning="factor C_m of the transport by drift: also that of a time-lapse")
    form: str = parameter("algebraic", choices=("algebraic", "dynamic"),
                          meaning="slip in local equilibrium of weight and drag, or with the inertia of the droplets")
    hindrance: float = parameter(0.0, minimum=0.0, maximum=10.0,
                                 meaning="exponent n of (1 - alpha)^n, by which droplets slow each other; 2.65 gives "
                                         "the 4.65 of Richardson and Zaki")
    dispersed: str | None = parameter(None, liquid=True, meaning="the one liquid that forms droplets; all by default")
    continuous: str | None = parameter(None, liquid=True,
                                       meaning="the one liquid that droplets move through; all others by default")


def response_time(droplet: Liquid, around: Liquid, diameter: float) -> float:
    """tau_k of a single droplet of one liquid in another, s."""
    ratio = droplet.dynamic_viscosity / around.dynamic_viscosity
    return droplet.density * diameter**2 / (18.0 * around.dynamic_viscosity) * 3.0 * (1.0 + ratio) / (2.0 + 3.0 * ratio)


def rise_speed(droplet: Liquid, around: Liquid, diameter: float, gravity: float) -> float:
    """Speed at which a single droplet rises through a liquid at rest, m/s; below zero it sinks."""
    return response_time(droplet, around, diameter) * (around.density / droplet.density - 1.0) * gravity


def _check_drag(parameters, liquids):
    for liquid in liquids if parameters.coefficient > 0.0 else ():
        if liquid.dynamic_viscosity == 0.0:
            yield (("liquids", liquid.name, "dynamic_viscosity"),
                   "is 0 Pa s, but must be above 0, for the drag on its droplets (effect drift)")
    if parameters.dispersed is not None and parameters.dispersed == parameters.continuous:
        yield (("effects", "drift", "continuous"),
               f"is {parameters.continuous}, the liquid of the droplets, but must be another one")


@data_oriented
class Drift(Mixing):
    """Liquids that move through each other by the weight of their droplets."""

    name = "drift"
    Parameters = DriftParameters
    fewest_liquids = 2
    checks = (_check_drag,)
    fields = (
        *Mixing.fields,
        Field("droplet_velocity", "liquid_vectors", "m/s", "velocity u_k of droplets of every liquid", carried=True),
        Field("velocity_before", "vector", "m/s", "velocity at the step before, for the acceleration", carried=True),
    )

    def __init__(self, parameters, solver):
        self.last_step = 0.0  # length of the step that began with velocity_before, s; 0 where there was none
        super().__init__(parameters, solver)
        self.coefficient = self.lattice_factor * parameters.coefficient
        self.dynamic = parameters.form == "dynamic"
        if self.coefficient > 0.0 and any(liquid.dynamic_viscosity <= 0.0 for liquid in solver.liquids):
            raise ValueError("drift balances the weight of droplets with viscous drag, so every liquid needs a "
                             "dynamic_viscosity above 0")
        names = [liquid.name for liquid in solver.liquids]
        self.dispersed = names.index(parameters.dispersed) if parameters.dispersed else -1
        self.continuous = names.index(parameters.continuous) if parameters.continuous else -1
        self.exchanged = [(k, m) for k in range(len(names)) for m in range(k + 1, len(names))
                          if self.dispersed in (-1, k, m) and self.continuous in (-1, k, m)]
        self.diameter, self.hindrance = parameters.droplet_diameter, parameters.hindrance
        self.dimension = solver.dimension
        self.log_viscosity = ti.field(real(), shape=len(names))
        for k, liquid in enumerate(solver.liquids):
            self.log_viscosity[k] = math.log(liquid.dynamic_viscosity) if liquid.dynamic_viscosity > 0.0 else -math.inf
        self.weight = ti.Vector.field(solver.dimension, real(), shape=())  # g, m/s^2

    @classmethod
    def idle(cls, parameters, settings) -> str:
        if parameters.coefficient == 0.0:
            return cls.nothing_mixes(settings, "its coefficient is 0")
        if len({liquid.density for liquid in settings.liquids}) == 1:
            return cls.nothing_mixes(settings, "the densities of the liquids do not differ")
        return ""

    @classmethod
    def transport_of_droplets(cls, parameters) -> float:
        return parameters.coefficient

    @classmethod
    def advice(cls, parameters, scales, limits):
        if parameters is None:
            return
        yield from if_zero(cls.name, parameters, "coefficient", "(a pure number)")
        yield from if_alone(cls.name, scales)
        if not parameters.coefficient or len(scales.liquids) == 1:
            return
        diameter, dispersed, continuous = parameters.droplet_diameter, parameters.dispersed, parameters.continuous
        ways = [(abs(rise_speed(droplet, around, diameter, scales.gravity)), droplet, around)
                for droplet in (*scales.liquids, *scales.droplet_liquids) for around in scales.liquids
                if droplet is not around and dispersed in (None, droplet.name)
                and continuous in (None, around.name) and droplet.name != continuous]
        speed, droplet, around = max(ways, key=lambda way: way[0], default=(0.0, None, None))
        if speed == 0.0:
            yield Advice(WARNING, cls.name, "cannot be seen: droplets move at 0 m/s, for they need gravity and liquids "
                                            "of different densities")
            return
        reach = min(parameters.coefficient * speed * scales.duration, scales.width)
        seen = is_seen(reach, scales)
        yield Advice(SEEN_EFFECT if seen else WARNING, cls.name,
                     f"{'' if seen else 'cannot be seen: '}single droplets of {droplet.name} move through "
                     f"{around.name} at {shown(speed, 'm/s')}, within the {shown(scales.duration, 's')} of the scene "
                     f"by {times(reach, scales)}")
        reynolds = around.density * speed * diameter / around.dynamic_viscosity
        if reynolds > STOKES_REYNOLDS:
            yield Advice(WARNING, cls.name, f"is too fast: droplets of {droplet.name} in {around.name} have a Reynolds "
                                            f"number of {reynolds:.3g}, but the drag of Stokes holds below "
                                            f"{STOKES_REYNOLDS:g}")

    def start(self, missing: set[str]) -> None:
        super().start(missing)
        for name in missing - {"volume_fraction"}:
            self.solver.particles.arrays[name].fill(0.0)
        if "velocity_before" in missing:
            self.last_step = 0.0

    def _drifts(self, k: int) -> bool:
        """Whether liquid k forms droplets."""
        return self.dispersed in (-1, k) and k != self.continuous

    @ti.func
    def _surrounding_viscosity(self, fraction, k: ti.template()):
        """Viscosity of what droplets of liquid k move through: the product of mu_l^alpha_l of the others, Pa s."""
        mean = 0.0
        if ti.static(self.continuous >= 0):
            mean = self.log_viscosity[ti.static(max(self.continuous, 0))]
        else:
            total, weight = 0.0, 0.0
            for other in ti.static(range(self.liquid_count)):
                if ti.static(other != k):
                    share = ti.max(fraction[other], 0.0) + TRACE
                    total += share * self.log_viscosity[other]
                    weight += share
            mean = total / weight
        return ti.exp(mean)

    @ti.func
    def response_time(self, fraction, k: ti.template()):
        """tau_k, hindered by other droplets, s."""
        mu = self._surrounding_viscosity(fraction, k)
        ratio = ti.exp(self.log_viscosity[k]) / mu
        tau = self.density[k] * self.diameter**2 / (18.0 * mu) * 3.0 * (1.0 + ratio) / (2.0 + 3.0 * ratio)  # (M5)
        if ti.static(self.hindrance > 0.0):
            tau *= ti.pow(ti.max(1.0 - fraction[k], 0.0), self.hindrance)
        return tau

    @ti.kernel
    def _set_droplet_velocity(self, dt: float, last_step: float):
        for i in range(self.count[None]):
            force = self.weight[None]
            if last_step > 0.0:
                force -= (self.particles.velocity[i] - self.particles.velocity_before[i]) / last_step
            fraction = self.particles.volume_fraction[i]
            density = self.mixture_density(i)
            for k in ti.static(range(self.liquid_count)):
                if ti.static(self._drifts(k)):
                    tau = self.response_time(fraction, k)
                    approach = 1.0  # share of the way to equilibrium
                    if ti.static(self.dynamic):
                        approach = 1.0 - ti.exp(-dt / ti.max(tau, 1e-30))
                    for d in ti.static(range(self.dimension)):
                        limit = tau * (1.0 - density / self.density[k]) * force[d]  # (M4)
                        n = ti.static(k * self.dimension + d)
                        u = self.particles.droplet_velocity[i][n]
                        self.particles.droplet_velocity[i][n] = u + approach * (limit - u)

    @ti.func
    def _slip(self, i, j, x_ij, k: ti.template(), m: ti.template()):
        """w r: mean slip of liquid k relative to m along x_ij, times the distance, m^2/s."""
        total = 0.0
        u_i, u_j = self.particles.droplet_velocity[i], self.particles.droplet_velocity[j]
        for d in ti.static(range(self.dimension)):
            first, second = ti.static(k * self.dimension + d, m * self.dimension + d)
            total += 0.5 * ((u_i[first] - u_i[second]) + (u_j[first] - u_j[second])) * x_ij[d]
        return total

    @ti.func
    def pair_flux(self, i, j, x_ij):
        own, other = self.particles.volume_fraction[i], self.particles.volume_fraction[j]
        flux = own * 0.0
        for k, m in ti.static(self.exchanged):
            slip = self.coefficient * self._slip(i, j, x_ij, k, m)
            moved = ti.select(slip > 0.0, other[k] * own[m], own[k] * other[m]) * slip  # (M6)
            flux[k] += moved
            flux[m] -= moved
        return flux

    @ti.func
    def pair_rate(self, i, j, x_ij):
        largest = 0.0
        for k, m in ti.static(self.exchanged):
            largest = ti.max(largest, ti.abs(self._slip(i, j, x_ij, k, m)))
        return self.coefficient * largest

    @ti.kernel
    def _remember_velocity(self):
        for i in range(self.count[None]):
            self.particles.velocity_before[i] = self.particles.velocity[i]

    def prepare(self, dt: float) -> None:
        if self.coefficient == 0.0 or dt == 0.0 or not self.exchanged:
            return
        self.weight[None] = ti.Vector([float(v) for v in self.solver.gravity()])
        self._set_droplet_velocity(dt, self.last_step)
        self.mix(dt)
        self._remember_velocity()
        self.last_step = dt

    def state(self) -> dict:
        return {"last_step": self.last_step}

    def restore(self, state: dict) -> None:
        if state:
            self.last_step = float(state["last_step"])
