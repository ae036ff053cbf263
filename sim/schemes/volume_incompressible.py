"""Volume-incompressible SPH: here for a completely full closed cavity, with pressures of either sign.

One divergence-free solve for the velocity, and a correction of the volume error that moves positions only
([song, section III-A] with the corrections that a cavity without free surface needs: the constant-volume solve of the
paper, fed back into the velocity, destroys a still tank). Equations: docs/methods/pressure.md.
"""
import math

import numpy as np

from sim.backend import data_oriented, real, real_numpy, ti
from sim.boundary import WallStop
from sim.errors import RunError
from sim.fields import Field
from sim.liquid import are_unlike
from sim.pressure_operators import PressureOperators
from sim.pressure_solver import ConjugateResiduals
from sim.reductions import blocks, first, largest_of, last, least_of, partial_results, total_of
from sim.schemes.scheme import Scheme
from sim.schemes.volume_incompressible_clamped import VolumeIncompressibleClamped, VolumeIncompressibleParameters
from sim.viscous_coupling import ViscousCoupling

CORRECTION_RATE = 0.2  # share of the volume error removed per step; 0.5 gains nothing
CORRECTION_ITERATIONS = 5  # stopping early filters the noise that a disordered set cannot meet anyway
CORRECTION_LIMIT = 0.1  # largest correction per step, in particle spacings
GAUGE_LIMIT = 0.1  # largest background pressure, in rho dx^2 / dt^2
RESISTED_GAUGE_LIMIT = 1.0  # the same where viscosity resists; with 0.4 aqueous stirred by a jet stays hot for seconds
MOST_PARTS = 8  # in which particles are moved and shifted
IN_PARTS = 0.3  # shift, in dx^2 S_i, above which a particle moves in parts, as near contact lines
SHIFT_RATE = 30.0  # shift along -S_i in dx^2 per particle spacing that the particle travels: none in a liquid at rest
SHIFT_LIMIT = 1.0  # largest shift, in dx^2 S_i; a vortex at Re 100 decays 19 % too fast with a tenth, 7 % with this:
# both are chosen on that vortex, so it judges everything but them
TENSION_RATE = 4.0  # the same per -p dt^2/(rho dx^2) where densities are unlike: without it water that hangs from gas
# for 60 ms in a circle of 20 spacings draws together and leaves voids
RESIDUAL = 2.0  # mean residual of the pressure, over the tolerance times the way of the fastest particle in the step,
# in spacings: liquids that come to rest in an eye are 3 % too fast with it, at half the iterations of a value of 1
UNLIKE_RESIDUAL = 0.3  # of that where densities are unlike: water that drives gas is 6 % too fast with all of it
RESISTED = 1.0  # nu dt/dx^2 from which the pressure counts with viscosity; where it does not matter, a more exact
# pressure only wakes noise (two layers of 1:2 at rest)
ANSWER_TOLERANCE = 0.1  # of the viscous solve of the coupled step: 0.02 changes the way of oil by 1 %, 0.3 by 10 %
SOFTENED = 0.1  # way of a particle in a step, in particle spacings, on which its pressure loses all of its unevenness;
# the share grows with the square of the way, else the pressure that viscous liquid builds up step by step is lost
SEPARATION = 0.8  # particles closer than this, in particle spacings, move apart
SEPARATION_RATE = 0.3  # share of the missing distance gained per step
CROWDED = 1.2  # mean compression at which a run stops; healthy ones stay below 1.05, and nothing draws them back from 2


@data_oriented
class VolumeIncompressible(Scheme):
    """Scheme `volume_incompressible`."""

    name = "volume_incompressible"
    largest_density_ratio = 1000.0  # water under air; no more was tried
    Parameters = VolumeIncompressibleParameters
    fields = (
        Field("pressure", "scalar", "Pa", "solved pressure: without the reduced hydrostatic part", carried=True),
        Field("compression_rate", "scalar", "1", "Gamma_i = sum of V_j W_ij over liquid and wall"),
        Field("kernel_gradient_sum", "vector", "1/m", "S_i = sum of V_j grad_i W_ij over liquid and wall"),
        Field("pressure_change", "scalar", "Pa", "what the solve adds to the pressure of the last step"),
        Field("correction", "scalar", "m2", "potential of the position correction"),
        Field("displacement", "vector", "m", "move of the particle in this step"),
        Field("further_correction", "vector", "m", "correction of the place in each further part of the move"),
        Field("moves_on", "integer", "", "1 where a particle moves in several parts"),
        Field("contact", "integer", "", "1 where the wall itself stopped the particle in this step"),
    )

    def __init__(self, solver):
        super().__init__(solver)
        self.operators = PressureOperators(solver.particles, self.search, self.kernel_gradient_sum,
                                           are_unlike(liquid.density for liquid in solver.liquids))
        self.pressure_solver = ConjugateResiduals(self.operators)
        walls = max(self.walls.count, 1)
        self.wall_compression_rest = ti.field(real(), shape=walls)
        self.compression_mean = ti.field(real(), shape=())
        self.partial = partial_results(4)
        self.gauge = ti.field(real(), shape=())
        self.wall_stop = WallStop(solver.distance, self.spacing, self.count, self.contact)
        self.least_density = min(liquid.density for liquid in solver.settings.liquids)
        self.largest_viscosity = max(liquid.dynamic_viscosity / liquid.density for liquid in solver.settings.liquids)

    def meet(self, effects) -> None:
        self.volume_rate = self.solver.particles.arrays.get("volume_rate")  # only where an effect declares it
        self.volumes_change = self.volume_rate is not None
        self.growth = self.solver.particles.arrays.get("growth")
        self.jump = self._capillary_jump(effects) if self.volumes_change else 0.0
        self.viscous = next((effect for effect in effects if effect.overrides("viscous_mass")), None)
        if self.viscous:
            self.viscous.coupling = ViscousCoupling(self.solver, self.operators, self.viscous)
        self.operators.resisting = [effect for effect in effects
                                    if effect.overrides("friction") and "friction" not in effect.unused_hooks]

    @classmethod
    def variant(cls, settings) -> type[Scheme]:
        return VolumeIncompressible if settings.closed else VolumeIncompressibleClamped

    @ti.kernel
    def _measure(self):
        n = self.count[None]
        for i in range(n):
            self.compression_rate[i], self.kernel_gradient_sum[i] = self.kernel_sums(i)
        for block in range(blocks(n)):
            mean = ti.cast(0.0, ti.f64)
            for i in range(first(block, n), last(block, n)):
                mean += self.compression_rate[i]
            self.partial[0, block] = mean
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.compression_mean[None] = total_of(self.partial, 0, n) / n

    def measure(self) -> None:
        """Compression rates, gradient sums and wall weights of the current neighbor rows."""
        self._measure()
        self.operators.update()

    def set_rest_state(self) -> None:
        """Take the present compression of the wall rows as that of rest (packed start)."""
        self.wall_compression_rest.copy_from(self.operators.wall_weight)

    def step(self, dt: float) -> dict[str, float]:
        solver = self.solver
        self._refuse_voids()
        solver.accelerate(dt)
        solver.timed("pressure", self.operators.push_from_walls, self.position, self.acceleration, self.velocity, dt)
        resisted = self.viscous is not None and self.largest_viscosity * dt > RESISTED * self.spacing**2
        solver.timed("pressure", self._press, dt, RESISTED_GAUGE_LIMIT if resisted else GAUGE_LIMIT)
        statistics = solver.correct_velocity(dt)
        solver.timed("pressure", self.operators.update_diagonals, dt if resisted else 0.0)
        way = solver.largest_speed() * dt / self.spacing
        tolerance = RESIDUAL * self.numerics.pressure_tolerance * way
        tolerance *= UNLIKE_RESIDUAL if self.operators.shared_by_density else 1.0
        tolerance = max(1e-9, min(1e-4, tolerance))
        spent = self._couple(dt, tolerance) if resisted else {}
        statistics |= solver.timed("pressure", self._solve, dt, tolerance)
        statistics |= {name: statistics.get(name, 0) + iterations for name, iterations in spent.items()}
        solver.timed("pressure", self._take, dt, resisted)
        parts = min(MOST_PARTS, max(1, math.ceil(SHIFT_RATE * way))) if resisted else 1
        return statistics | solver.timed("position correction", self.advect, dt, parts)

    def _couple(self, dt: float, tolerance: float) -> dict[str, float]:
        """Descend once along what the pressure of viscous liquid lacks, pressure and velocity together; return the
        iterations of both solves.
        """
        solver, coupling, direction = self.solver, self.viscous.coupling, self.pressure_change
        solver.timed("pressure", coupling.measure)
        spent = solver.timed("pressure", self._solve, dt, tolerance)
        rate = self.pressure_solver.right_side
        solver.timed("pressure", coupling.add, direction, rate)
        viscous = solver.timed(self.viscous.name, coupling.press, direction, dt, ANSWER_TOLERANCE)
        solver.timed("pressure", coupling.descend, self.pressure, self.velocity, direction, rate, dt)
        return {"pressure_iterations": spent["pressure_iterations"], **viscous}

    def _refuse_voids(self) -> None:
        """Stop where liquids have left a part of the full cavity void: the volume error (P11) is one from its mean."""
        mean = float(self.compression_mean[None])
        if mean > CROWDED:
            raise RunError(f"step {self.solver.step_count}, at {self.solver.time:.6g} s: the liquids have crowded to "
                           f"{mean:.2f} times their density in the mean and leave a part of the full cavity void; "
                           "weaker forces between particles may hold them, more viscosity, or another numerics.scheme")

    def _press(self, dt: float, gauge_limit: float) -> None:
        """Let the pressure of the last step act, so that implicit viscosity sees forces that nearly balance.

        Without it viscosity answers forces that the solve takes away again only after it, and what is left, in
        proportion to the time step, stirs the oil (incremental pressure correction [vankan1986]).
        """
        self._soften(dt)
        density = 1.0 if self.operators.shared_by_density else self.least_density
        self._set_gauge(max(self._largest_weight(), self.jump), gauge_limit * density * (self.spacing / dt) ** 2)
        self.operators.accelerate_freely(self.pressure, self.velocity, dt)

    @ti.kernel
    def _soften(self, dt: float):
        """Draw the pressure to its mean over the support radius, the more the farther a particle travels in the step.

        It is uneven like the places of the particles, and where they have moved against each other, it pushes them
        about instead of holding them: at a drain, in steps of a fifth of a spacing, by 6 % more in every step.
        """
        for i in range(self.count[None]):
            weight = self.volume[i] * self.search.kernel.at_zero
            total = weight * self.pressure[i]
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                j = self.pairs.index[k]
                alike = self.operators.likeness(i, j) * self.pairs.weight[k]
                total += alike * self.pressure[j]
                weight += alike
            travel = dt * self.solver.velocity_at_start[i].norm() / self.spacing
            share = ti.min(1.0, (travel / SOFTENED) ** 2)
            self.pressure_change[i] = self.pressure[i] + share * (total / weight - self.pressure[i])  # (P8)
        for i in range(self.count[None]):
            self.pressure[i] = self.pressure_change[i]

    def _solve(self, dt: float, tolerance: float) -> dict[str, float]:
        """Find the change of the pressure that frees the velocity of its divergence."""
        self._set_velocity_right_side(dt)
        most = self.numerics.maximum_iterations
        iterations, mean, largest = self.pressure_solver.solve(
            self.pressure_change, weighted=True, step=dt * dt, tolerance=tolerance, maximum_iterations=most)
        return {"pressure_iterations": iterations, "residual_mean": mean, "residual_maximum": largest,
                "pressure_limit_hit": float(iterations >= most)}

    @ti.kernel
    def _add_change(self):
        for i in range(self.count[None]):
            self.pressure[i] += self.pressure_change[i]  # (P7)

    def _take(self, dt: float, resisted: bool) -> None:
        """Let the change of the pressure act.

        To the change that masses ask for comes what viscosity asks for (rotational pressure correction
        [timmermans1996]): else a pressure that has to balance forces on viscous liquid takes many steps to form, and
        oil moves too fast meanwhile.
        """
        self.operators.accelerate(self.pressure_change, self.velocity, dt, True)
        self._add_change()
        if resisted:
            self.viscous.coupling.add(self.pressure, self.pressure_solver.right_side)  # (P7)

    def state(self) -> dict:
        return {"wall_compression_rest": self.wall_compression_rest.to_numpy()}

    def restore(self, state: dict) -> None:
        self.wall_compression_rest.from_numpy(state["wall_compression_rest"].astype(real_numpy()))

    @ti.kernel
    def _set_velocity_right_side(self, dt: float):
        for b in range(self.walls.count):
            rate = self.operators.wall_rate(self.velocity, b, True)
            if ti.static(self.volumes_change):
                total = 0.0
                for slot in range(self.wall_rows.count[b]):
                    k = self.wall_rows.entry(b, slot)
                    j = self.wall_rows.index[k]
                    total += self.volume_rate[j] / self.volume[j] * self.wall_rows.weight[k]
                rate += self.operators.over_wall_weight(b, total, True)
            self.operators.wall_value[b] = rate
        for i in range(self.count[None]):
            rate = self.operators.volume_rate(self.velocity, i)
            if ti.static(self.volumes_change):
                rate += self.volume[i] * self.growth[i]  # (P4)
            self.pressure_solver.right_side[i] = rate / dt

    @ti.kernel
    def _set_gauge(self, weight: float, limit: float):
        """Add the constant, which is in the null space, that makes the smallest pressure zero, up to two limits.

        A pressure p acts on an uneven set as a force -2 p S_i as well: below zero it draws particles together, far
        above zero it heats the liquid. `weight` is what presses on a liquid at rest: lifting the low pressure in an
        eddy too would brake it (a vortex at Re 100 then decays 35 % too fast). `limit` is that of what particles bear,
        per density where densities are unlike: gas bears so little that its mean pressure is about zero, and water that
        hangs from it is under tension.
        """
        n = self.count[None]
        for block in range(blocks(n)):
            total = ti.cast(0.0, ti.f64)
            share = ti.cast(0.0, ti.f64)
            lightest = ti.cast(0.0, ti.f64)
            least = ti.cast(1e30, ti.f64)
            for i in range(first(block, n), last(block, n)):
                lightness = ti.cast(self.operators.lightness(i, True), ti.f64)
                total += lightness * self.pressure[i]
                share += lightness
                lightest = ti.max(lightest, lightness)
                if self.volume[i] > 0.5 * self.solver.rest_volume:  # small particles are outliers
                    least = ti.min(least, ti.cast(self.pressure[i], ti.f64))
            self.partial[0, block] = total
            self.partial[1, block] = least
            self.partial[2, block] = share
            self.partial[3, block] = lightest
        ti.loop_config(serialize=True)
        for _ in range(1):
            mean = total_of(self.partial, 0, n) / total_of(self.partial, 2, n)
            largest = ti.min(weight, limit / largest_of(self.partial, 3, n))
            self.gauge[None] = ti.min(mean - least_of(self.partial, 1, n), largest) - mean  # (P9)
        for i in range(self.count[None]):
            self.pressure[i] += self.gauge[None]

    def _largest_weight(self) -> float:
        """Pressure of the heaviest column of liquid, less the reference density, across the cavity, Pa."""
        solver = self.solver
        excess = max(abs(liquid.density - solver.reference_density) for liquid in solver.liquids)
        return excess * float(np.linalg.norm(solver.gravity())) * self.walls.extent

    def _capillary_jump(self, effects) -> float:
        """Pressure across an interface as curved as the largest ball in the cavity, sigma/r, Pa."""
        tension = max((effect.tension_of(effect.parameters) for effect in effects), default=0.0)
        return tension / -float(self.solver.distance.values_numpy.min())

    @ti.kernel
    def _set_correction_right_side(self):
        for b in range(self.walls.count):
            error = self.operators.wall_weight[b] - self.wall_compression_rest[b]
            self.operators.wall_value[b] = self.operators.over_wall_weight(b, error, False)
        for i in range(self.count[None]):
            error = self.compression_rate[i] - self.compression_mean[None] + self.operators.fold(i, False)
            self.pressure_solver.right_side[i] = CORRECTION_RATE * self.volume[i] * error  # (P11)

    @ti.func
    def _separation(self, i):
        """Move of particle i away from those that are too close; a pair keeps its center of volume.

        A kernel gradient that falls to zero at r = 0 does not part such a pair.
        """
        total = self.position[i] * 0.0
        for slot in range(self.pairs.count[i]):
            k = self.pairs.entry(i, slot)
            j = self.pairs.index[k]
            x_ij = self.search.separation(self.position[i], self.position[j])
            missing = SEPARATION * self.spacing - x_ij.norm()
            if missing > 0.0:
                share = self.volume[j] / (self.volume[i] + self.volume[j])
                total += SEPARATION_RATE * share * missing / ti.max(x_ij.norm(), 1e-6 * self.spacing) * x_ij
        return total

    @ti.func
    def _way(self, i, dt):
        """Way of particle i in a step, in particle spacings times the rate of the shift."""
        return SHIFT_RATE * dt / self.spacing * self.velocity[i].norm()

    @ti.func
    def _limited(self, shift):
        return shift * ti.min(1.0, CORRECTION_LIMIT * self.spacing / ti.max(shift.norm(), 1e-30))

    @ti.kernel
    def _move(self, dt: float, parts: float):
        """Move all particles; those whose shift would be capped, by the first of several parts only."""
        for b in range(self.walls.count):
            self.operators.wall_value[b] = self.operators.extrapolated(self.correction, b, False)
        for i in range(self.count[None]):
            weight = self._way(i, dt)
            part = ti.select(weight > IN_PARTS, 1.0 / parts, 1.0)
            weight *= part
            if ti.static(self.operators.shared_by_density):
                tension = ti.max(-self.pressure[i], 0.0) * self.operators.lightness(i, True)
                weight += TENSION_RATE * tension * (dt / self.spacing) ** 2
            correction = self.operators.pressure_force(self.correction, i, False) + self._separation(i)
            shift = part * correction - ti.min(weight, SHIFT_LIMIT) * self.spacing**2 * self.kernel_gradient_sum[i]
            self.displacement[i] = part * dt * self.velocity[i] + self._limited(shift)  # (P10)
            self.further_correction[i] = ti.select(part < 1.0, part * correction, 0.0 * correction)
            self.moves_on[i] = ti.cast(part < 1.0, ti.i32)
        for i in range(self.count[None]):
            x, v = self.wall_stop.stopped(i, self.position[i] + self.displacement[i], self.velocity[i])
            self.position[i] = x
            self.velocity[i] = v

    @ti.kernel
    def _move_on(self, dt: float, parts: float):
        """Move those that have not arrived by a further part, with S_i at the present places of their neighbors."""
        for i in range(self.count[None]):
            if self.moves_on[i] == 1:
                gradient = self._gradient_sum(i)
                weight = ti.min(self._way(i, dt) / parts, SHIFT_LIMIT)
                shift = self.further_correction[i] - weight * self.spacing**2 * gradient
                self.displacement[i] = dt / parts * self.velocity[i] + self._limited(shift)
        for i in range(self.count[None]):
            if self.moves_on[i] == 1:
                stopped = self.contact[i]
                x, v = self.wall_stop.stopped(i, self.position[i] + self.displacement[i], self.velocity[i])
                self.position[i] = x
                self.velocity[i] = v
                self.contact[i] = ti.max(self.contact[i], stopped)

    @ti.func
    def _gradient_sum(self, i):
        """S_i at the present places, over the neighbors of the step."""
        x = self.position[i]
        total = x * 0.0
        for slot in range(self.pairs.count[i]):
            j = self.pairs.index[self.pairs.entry(i, slot)]
            x_ij = self.search.separation(x, self.position[j])
            total += self.volume[j] * self.search.kernel.gradient_factor(x_ij.norm()) * x_ij
        for slot in range(self.wall_pairs.count[i]):
            b = self.wall_pairs.index[self.wall_pairs.entry(i, slot)]
            x_ib = self.search.separation(x, self.walls.position[b])
            total += self.walls.volume[b] * self.search.kernel.gradient_factor(x_ib.norm()) * x_ib
        return total

    def advect(self, dt: float, parts: int = 1) -> dict[str, float]:
        """Move the particles with the velocity and a correction of the volume error that leaves the velocity alone.

        Returns the number of particles that the wall itself had to stop.
        """
        self._set_correction_right_side()
        self.pressure_solver.solve(self.correction, weighted=False, step=1.0, tolerance=0.0,
                                   maximum_iterations=CORRECTION_ITERATIONS)
        self._move(dt, parts)
        for _ in range(1, parts):
            self._move_on(dt, parts)
        return {"wall_contacts": float(self.wall_stop.total())}
