"""Weakly compressible SPH: the pressure follows from the density by the Tait equation [becker2007].

p_i = rho0_i c^2/n (J_i^n - 1) with the density ratio J_i = rho_i/rho0_i. Everything is written with rest volumes, so
that the jump of the density between two liquids is not smeared: F_ij = -V_i V_j (p_i + p_j) G_ij is antisymmetric and
dJ_i/dt = sum of V_j (v_i - v_j).G_ij is its adjoint, so pressure work and compression balance.
J_i is advanced by that continuity equation with the diffusion of [molteni2009], here of the pressure less its
hydrostatic part [fourtakas2019], so that it acts across liquids; or it is summed, J_i = Gamma_i over that of a lattice.
Wall particles take the pressure of the liquid around them and its weight [adami2012]. Equations: docs/methods/wcsph.md.
"""
import dataclasses
import math
from types import MappingProxyType

import numpy as np

from sim.advice import ESTIMATE, Limit
from sim.backend import data_oriented, real, ti
from sim.boundary import WallStop
from sim.effects.effect import GROWTH
from sim.fields import Field
from sim.parameters import parameter
from sim.schemes.scheme import Scheme
from sim.smoothing_kernels import lattice_sum

MACH = 0.1  # largest speed over the speed of sound: densities then vary by about 1 %
SHIFT_WEIGHT = 1.0  # shift along -S_i, in dx |u|max dt [lind2012], only in a cavity without free surface


@dataclasses.dataclass(frozen=True)
class WCSPHParameters:
    """Tait equation of state and its numerical dissipation."""

    sound_speed: float | None = parameter(None, unit="m/s", exclusive_minimum=0.0, maximum=1e4,
                                          meaning="speed of sound; ten times the largest expected speed without it")
    exponent: float = parameter(7.0, minimum=1.0, maximum=10.0, meaning="exponent n of the Tait equation")
    density: str = parameter("continuity", choices=("continuity", "summation"),
                             meaning="density from its rate of change, or from the sum over neighbors")
    density_diffusion: float = parameter(0.1, minimum=0.0, maximum=0.5,
                                         meaning="diffusion of the density, delta (only with continuity)")
    acoustic_damping: float = parameter(1.0, minimum=0.0, maximum=2.0,
                                        meaning="bulk viscosity over c and the smoothing length: it damps sound only")
    artificial_viscosity: float = parameter(0.02, minimum=0.0, maximum=1.0,
                                            meaning="Monaghan's alpha, between approaching particles")
    acoustic_courant_number: float = parameter(0.3, exclusive_minimum=0.0, maximum=0.5,
                                               meaning="time step over smoothing length / (c + |u|)")


@data_oriented
class WCSPH(Scheme):
    """Scheme `wcsph`."""

    name = "wcsph"
    Parameters = WCSPHParameters
    lacks = MappingProxyType({GROWTH: "it has no pressure solve that could take up the growing volumes"})
    unread = MappingProxyType(dict.fromkeys(("pressure_tolerance", "maximum_iterations"),
                                            "the equation of state, which needs no solve"))
    largest_density_ratio = 100.0  # two layers at rest keep 1.1 % of rho g H; at 1:1000 particles pile up
    largest_density_ratio_full = 10.0  # liquids that change places in a full cavity gain energy at 1:30
    fields = (
        Field("pressure", "scalar", "Pa", "pressure of the equation of state", carried=True),
        Field("compression_rate", "scalar", "1", "Gamma_i = sum of V_j W_ij over liquid and wall"),
        Field("kernel_gradient_sum", "vector", "1/m", "S_i = sum of V_j grad_i W_ij over liquid and wall"),
        Field("density_ratio", "scalar", "1", "J_i = density over rest density", carried=True),
        Field("divergence", "scalar", "1/s", "sum of V_j (v_i - v_j).grad W_ij at the start of the step"),
        Field("density_ratio_rate", "scalar", "1/s", "dJ_i/dt"),
        Field("pressure_acceleration", "vector", "m/s2", "acceleration by the pressure"),
        Field("contact", "integer", "", "1 where the wall itself stopped the particle in this step"),
    )

    def __init__(self, solver):
        super().__init__(solver)
        self.closed = solver.settings.closed
        self.smoothing_length = 0.5 * solver.support_radius
        self.continuity = self.parameters.density == "continuity"
        self.compression_at_rest = lattice_sum(self.search.kernel, solver.rest_volume ** (1.0 / solver.dimension),
                                               solver.dimension)
        self.wall_stop = WallStop(solver.distance, self.spacing, self.count, self.contact)
        walls = max(self.walls.count, 1)
        self.wall_pressure = ti.field(real(), shape=walls)
        if self.continuity:
            self.density_ratio.fill(1.0)

    def meet(self, effects) -> None:
        self.sound_speed = self.parameters.sound_speed or self.expected_speed() / MACH  # (W6)

    def expected_speed(self) -> float:
        """Largest speed to be expected, m/s: of the start with what the effects add in energy, or of an effect.

        Without any of them it is the speed that the largest time step can follow.
        """
        effects = self.solver.effects
        velocity = self.solver.particles.to_numpy("velocity").astype(float)
        start = np.sqrt((velocity**2).sum(axis=1).max())
        fallen = math.sqrt(start**2 + 2.0 * sum(effect.expected_energy() for effect in effects))
        largest = max((fallen, *(speed for effect in effects for speed in effect.expected_speeds())))
        return largest or self.numerics.courant_number * self.spacing / self.numerics.maximum_time_step

    @classmethod
    def time_step_limit(cls, settings) -> float:
        """Acoustic limit C h_s / c of a liquid at rest, where the speed of sound is given, s."""
        chosen = settings.scheme or cls.Parameters()
        if chosen.sound_speed is None:
            return float("inf")
        numerics = settings.numerics
        return (chosen.acoustic_courant_number * 0.5 * numerics.support_ratio * numerics.particle_spacing
                / chosen.sound_speed)

    @classmethod
    def with_longer_steps(cls, parameters, factor: float) -> WCSPHParameters:
        parameters = parameters or cls.Parameters()
        return dataclasses.replace(parameters,
                                   acoustic_courant_number=factor * parameters.acoustic_courant_number)

    @classmethod
    def expected_time_step_limit(cls, scales) -> Limit | None:
        """Acoustic limit with the speed of sound as it is chosen: over the largest expected speed, an estimate."""
        parameters = scales.settings.scheme or cls.Parameters()
        if parameters.sound_speed is not None:
            return None
        sound = max((scales.speed, *scales.wave_speeds)) / MACH
        length = 0.5 * (scales.settings.numerics.support_ratio * scales.spacing)
        limit = parameters.acoustic_courant_number * length / (sound + scales.speed) if sound else math.inf
        return Limit(f"the scheme {cls.name}", limit,
                     f"{ESTIMATE}sound at {sound:.3g} m/s, ten times the largest expected speed")

    @ti.kernel
    def _measure(self):
        for i in range(self.count[None]):
            total = self.volume[i] * self.search.kernel.at_zero
            gradient = self.velocity[i] * 0.0
            divergence = 0.0
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                total += self.pairs.weight[k]
                gradient += self.pairs.gradient[k]
                divergence -= self.velocity[self.pairs.index[k]].dot(self.pairs.gradient[k])
            for slot in range(self.wall_pairs.count[i]):
                k = self.wall_pairs.entry(i, slot)
                total += self.wall_pairs.weight[k]
                gradient += self.wall_pairs.gradient[k]
            self.compression_rate[i] = total
            self.kernel_gradient_sum[i] = gradient
            self.divergence[i] = divergence + self.velocity[i].dot(gradient)
            if ti.static(not self.continuity):
                self.density_ratio[i] = total / self.compression_at_rest  # (W5)

    def measure(self) -> None:
        """Compression rates and gradient sums of the current neighbor rows; with `summation` the densities too."""
        self._measure()

    def stable_time_step(self) -> float:
        """Acoustic limit C h_s / (c + |u|) with the smoothing length h_s, half the support radius, s."""
        return (self.parameters.acoustic_courant_number * self.smoothing_length
                / (self.sound_speed + self.solver.largest[0]))

    def step(self, dt: float) -> dict[str, float]:
        solver = self.solver
        solver.accelerate(dt)
        statistics = solver.correct_velocity(dt)
        solver.timed("pressure", self._accelerate_by_pressure, dt)
        if self.continuity:
            solver.timed("density", self._compress, dt)
        shift = 0.0
        if self.closed:
            shift = SHIFT_WEIGHT * self.spacing * dt * solver.largest_speed()
        solver.timed("position", self._move, dt, shift)
        return statistics | {"pressure_iterations": 0, "wall_contacts": float(self.wall_stop.total())}

    @ti.func
    def _rest_density(self, i):
        return self.mass[i] / self.volume[i]

    @ti.kernel
    def _accelerate_by_pressure(self, dt: float):
        c2, n = self.sound_speed**2, self.parameters.exponent
        bulk = self.parameters.acoustic_damping * self.sound_speed * self.smoothing_length
        for i in range(self.count[None]):
            p = self._rest_density(i) * (  # (W1)
                c2 / n * (ti.pow(self.density_ratio[i], n) - 1.0) + bulk * self.divergence[i])
            if ti.static(not self.closed):
                p = ti.max(p, 0.0)  # a free surface does not pull
            self.pressure[i] = p
        for b in range(self.walls.count):
            total = 0.0
            weight = 0.0
            for slot in range(self.wall_rows.count[b]):
                k = self.wall_rows.entry(b, slot)
                j = self.wall_rows.index[k]
                away = self.search.separation(self.walls.position[b], self.position[j])
                total += self.wall_rows.weight[k] * (
                    self.pressure[j] + self._rest_density(j) * self.acceleration[j].dot(away))
                weight += self.wall_rows.weight[k]
            p = ti.select(weight > 0.0, total / ti.max(weight, 1e-20), 0.0)  # (W3)
            if ti.static(not self.closed):
                p = ti.max(p, 0.0)
            self.wall_pressure[b] = p
        damping = self.parameters.artificial_viscosity * self.sound_speed * self.smoothing_length
        for i in range(self.count[None]):
            p = self.pressure[i]
            x, v, density = self.position[i], self.velocity[i], self._rest_density(i)
            force = self.velocity[i] * 0.0
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                j = self.pairs.index[k]
                x_ij = self.search.separation(x, self.position[j])
                approach = ti.min((v - self.velocity[j]).dot(x_ij), 0.0) / ti.max(
                    x_ij.norm_sqr(), 1e-12 * self.spacing**2)
                viscous = 0.5 * damping * (density + self._rest_density(j)) * approach
                force -= (p + self.pressure[j] - viscous) * self.pairs.gradient[k]  # (W2)
            for slot in range(self.wall_pairs.count[i]):
                k = self.wall_pairs.entry(i, slot)
                force -= (p + self.wall_pressure[self.wall_pairs.index[k]]) * self.wall_pairs.gradient[k]
            self.pressure_acceleration[i] = force / density
        for i in range(self.count[None]):
            self.velocity[i] += dt * self.pressure_acceleration[i]

    @ti.kernel
    def _compress(self, dt: float):
        """Advance the density ratios with the new velocities."""
        c2 = self.sound_speed**2
        diffusion = 2.0 * self.parameters.density_diffusion * self.smoothing_length * self.sound_speed
        for i in range(self.count[None]):
            x, v, density = self.position[i], self.velocity[i], self._rest_density(i)
            rate = 0.0
            flux = 0.0
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                j = self.pairs.index[k]
                x_ij = self.search.separation(x, self.position[j])
                gradient = self.pairs.gradient[k]
                density_j = self._rest_density(j)
                rate += (v - self.velocity[j]).dot(gradient)
                # Linear in J and without the clamp: the difference of pressures less the weight between i and j.
                weight = 0.25 * (density + density_j) * (self.acceleration[i] + self.acceleration[j]).dot(x_ij)
                difference = c2 * (density_j * (self.density_ratio[j] - 1.0)
                                   - density * (self.density_ratio[i] - 1.0)) + weight
                flux -= difference * x_ij.dot(gradient) / ti.max(x_ij.norm_sqr(), 1e-12 * self.spacing**2)
            for slot in range(self.wall_pairs.count[i]):
                k = self.wall_pairs.entry(i, slot)
                rate += v.dot(self.wall_pairs.gradient[k])
            self.density_ratio_rate[i] = rate + diffusion * flux / (density * c2)  # (W4)
        for i in range(self.count[None]):
            self.density_ratio[i] += dt * self.density_ratio_rate[i]

    @ti.kernel
    def _move(self, dt: float, shift: float):
        for i in range(self.count[None]):
            x = self.position[i] + dt * self.velocity[i] - shift * self.kernel_gradient_sum[i]  # (W7)
            x, v = self.wall_stop.stopped(i, x, self.velocity[i])
            self.position[i] = x
            self.velocity[i] = v
