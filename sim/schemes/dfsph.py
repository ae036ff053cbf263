"""Divergence-free SPH [bender2017]: two pressure solves per step, for liquids with a free surface.

The density is a sum over the neighbors, rho_i = (sum of m_j W_ij + rho0_i sum of V_b W_ib) / L with the sum L of V W
over a lattice: a lattice is at rest. A particle counts its neighbors by their volumes, as if they were of its own
liquid. By their masses, as in the papers (`density_form: mass`), the density is smeared across an interface of two
liquids, and the pressures there are wrong: that is the method's known error, in [song, fig. 4] too.

With kappa_i = p_i/rho_i^2 and the wall pushed by the pressure of the liquid particle alone [akinci2012],
a_i = -sum of m_j (kappa_i + kappa_j) G_ij / L - kappa_i rho0_i sum of V_b G_ib / L is antisymmetric. Each solve is a
relaxed Jacobi iteration with kappa >= 0, started from the pressure of the step before:
the divergence solve makes D rho/Dt <= 0 for the velocity, the density solve rho <= rho0 at the end of the step.
Equations: docs/methods/dfsph.md.
"""
import dataclasses
from types import MappingProxyType

from sim.backend import data_oriented, real, ti
from sim.boundary import WallStop
from sim.effects.effect import GROWTH
from sim.fields import Field
from sim.parameters import parameter
from sim.reductions import blocks, first, largest_of, last, partial_results, total_of
from sim.schemes.scheme import Scheme
from sim.smoothing_kernels import lattice_sum

FEWEST_NEIGHBORS = {2: 7, 3: 20}  # with fewer, the divergence of a particle is not corrected
POWER_ITERATIONS = 60  # for the largest eigenvalue at the start, which sets the relaxation
RELAXATION = 1.6  # over the largest eigenvalue; 2 is the limit of stability
# Largest density ratios by masses: in a full cavity the smeared density asks for room that is not there (True), under a
# free surface 1:2, the paper's, throws particles where two bodies meet, and more throws them about.
SMEARED = {True: 1.2, False: 2.0}
DIVERGENCE_WARM_START = 0.5  # the divergence of one step says little about that of the next


@dataclasses.dataclass(frozen=True)
class DFSPHParameters:
    """The two solves of divergence-free SPH."""

    density_error: float = parameter(1e-4, minimum=1e-7, maximum=1e-1,
                                     meaning="mean relative compression left by the density solve")
    divergence_error: float = parameter(1e-3, minimum=1e-7, maximum=1e-1,
                                        meaning="mean relative compression per step left by the divergence solve")
    largest_error: float = parameter(30.0, minimum=1.0, maximum=1e9,
                                     meaning="largest error of a particle that a solve leaves, over its mean error")
    minimum_iterations: int = parameter(2, minimum=1, maximum=100, meaning="least iterations of the density solve")
    maximum_iterations: int = parameter(100, minimum=1, maximum=10000, meaning="most iterations of either solve")
    warm_start: float = parameter(0.9, minimum=0.0, maximum=1.0,
                                  meaning="share of the last step's pressure that the density solve starts from")
    density_form: str = parameter("volume", choices=("mass", "volume"),
                                  meaning="sum over the volumes of the neighbors, or over their masses, as in the "
                                          "papers, which smears the densities of two liquids")
    chebyshev_radius: float = parameter(0.9, minimum=0.0, maximum=0.999,
                                        meaning="spectral radius assumed by Chebyshev acceleration; 0 is without")


@data_oriented
class DFSPH(Scheme):
    """Scheme `dfsph`."""

    name = "dfsph"
    Parameters = DFSPHParameters
    lacks = MappingProxyType({GROWTH: "its density solve has no source for growing volumes"})
    unread = MappingProxyType({"pressure_tolerance": "schemes.dfsph.density_error and divergence_error",
                               "maximum_iterations": "schemes.dfsph.maximum_iterations"})
    largest_density_ratio = 10.0  # at 1:100 gravity that flips at once throws particles about
    largest_density_ratio_full = 5.0  # at 1:10 the same
    fields = (
        Field("pressure", "scalar", "Pa", "pressure of both solves", carried=True),
        Field("compression_rate", "scalar", "1", "Gamma_i = sum of V_j W_ij over liquid and wall"),
        Field("density", "scalar", "kg/m3", "summed density over that of a lattice"),
        Field("density_gradient_sum", "vector", "kg/m4", "gradient of the density by the particle's own place"),
        Field("density_weight", "scalar", "kg/m3", "rest density over the lattice sum"),
        Field("diagonal", "scalar", "kg2/m8", "diagonal of the pressure matrix"),
        Field("diagonal_weight", "scalar", "kg/m6", "what a neighbor adds to it, over its gradient squared"),
        Field("density_kappa", "scalar", "m5/(kg s2)", "p/rho^2 of the density solve", carried=True),
        Field("divergence_kappa", "scalar", "m5/(kg s2)", "p/rho^2 of the divergence solve", carried=True),
        Field("kappa_before", "scalar", "m5/(kg s2)", "iterate before the last one"),
        Field("kappa_weighted", "scalar", "m2/s2", "kappa times density weight"),
        Field("weighted", "vector", "kg/(m2 s)", "velocity or pressure acceleration times density weight"),
        Field("pressure_acceleration", "vector", "m/s2", "acceleration by the present iterate"),
        Field("source", "scalar", "kg/m3", "density or its change over the step, above rest, before the solve"),
        Field("residual", "scalar", "1", "relative compression that is left"),
        Field("contact", "integer", "", "1 where the wall itself stopped the particle in this step"),
    )

    def __init__(self, solver):
        super().__init__(solver)
        self.compression_at_rest = lattice_sum(self.search.kernel, solver.rest_volume ** (1.0 / solver.dimension),
                                               solver.dimension)
        self.by_volume = self.parameters.density_form == "volume"
        self.reference_density = float(solver.liquids[0].density)
        self.fewest_neighbors = FEWEST_NEIGHBORS[solver.dimension]
        self.wall_stop = WallStop(solver.distance, self.spacing, self.count, self.contact)
        self.partial = partial_results(2)
        self.residual_mean, self.residual_maximum = (ti.field(ti.f64, shape=()) for _ in range(2))
        self.relaxation = ti.field(real(), shape=())

    def meet(self, effects) -> None:
        self.masses_change = "volume_fraction" in self.solver.particles.arrays

    @classmethod
    def density_ratio_limit(cls, closed: bool, parameters=None) -> float:
        """Less by masses."""
        by_mass = (parameters or cls.Parameters()).density_form == "mass"
        return SMEARED[closed] if by_mass else super().density_ratio_limit(closed)

    @classmethod
    def iteration_limit(cls, settings) -> tuple[int, str]:
        return (settings.scheme or cls.Parameters()).maximum_iterations, "schemes.dfsph.maximum_iterations"

    # Densities and the diagonal.

    @ti.func
    def _counted_mass(self, i):
        """Mass with which i counts in densities; by volume that of as much of the first liquid (D9)."""
        return self.reference_density * self.volume[i] if ti.static(self.by_volume) else self.mass[i]

    @ti.func
    def _share(self, i):
        """That mass over the one that a force on i moves (D9)."""
        return self._counted_mass(i) / self.mass[i] if ti.static(self.by_volume) else 1.0

    @ti.kernel
    def _measure(self):
        for i in range(self.count[None]):
            weight = self._counted_mass(i) / (self.volume[i] * self.compression_at_rest)
            self.density_weight[i] = weight
            self.diagonal_weight[i] = self._share(i) * weight / self.volume[i]
        for i in range(self.count[None]):
            own = self.density_weight[i]
            compression = self.volume[i] * self.search.kernel.at_zero
            density = own * compression
            gradient = self.velocity[i] * 0.0
            spread = 0.0
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                j = self.pairs.index[k]
                other = self.density_weight[j]
                compression += self.pairs.weight[k]
                density += other * self.pairs.weight[k]
                gradient += other * self.pairs.gradient[k]
                spread += self.diagonal_weight[j] * self.pairs.gradient[k].norm_sqr()
            wall = 0.0
            wall_gradient = self.velocity[i] * 0.0
            for slot in range(self.wall_pairs.count[i]):
                k = self.wall_pairs.entry(i, slot)
                wall += self.wall_pairs.weight[k]
                wall_gradient += self.wall_pairs.gradient[k]
            gradient += own * wall_gradient
            self.compression_rate[i] = compression + wall
            self.density[i] = density + own * wall  # (D1)
            self.density_gradient_sum[i] = gradient
            # m_i sum of m_j |G_ij|^2: the exact diagonal for unequal masses too (V_j^2 |G_ij|^2 is in the row).
            self.diagonal[i] = self._share(i) * gradient.norm_sqr() + self.volume[i] * own * spread  # (D4)

    def measure(self) -> None:
        """Densities, their gradients and the diagonal of the current neighbor rows."""
        self._measure()

    # The pressure operator: two passes over the pairs, without the wall (its share is in density_gradient_sum).

    @ti.func
    def _acceleration(self, kappa: ti.template(), i):
        """Acceleration of i by the pressure (D2); `kappa_weighted` must be up to date."""
        total = kappa[i] * self.density_gradient_sum[i]
        for slot in range(self.pairs.count[i]):
            k = self.pairs.entry(i, slot)
            total += self.kappa_weighted[self.pairs.index[k]] * self.pairs.gradient[k]
        return -self._share(i) * total

    @ti.func
    def _density_rate(self, v: ti.template(), i):
        """D rho/Dt of i for velocities (or accelerations) v (D3); `weighted` must hold their products with weights."""
        total = v[i].dot(self.density_gradient_sum[i])
        for slot in range(self.pairs.count[i]):
            k = self.pairs.entry(i, slot)
            total -= self.weighted[self.pairs.index[k]].dot(self.pairs.gradient[k])
        return total

    @ti.kernel
    def _start(self, kappa: ti.template(), dt: float, share: float, divergence: ti.template()):
        """Source of the solve, kg/m^3, and the start of its iteration."""
        for i in range(self.count[None]):
            self.weighted[i] = self.density_weight[i] * self.velocity[i]
            kappa[i] *= DIVERGENCE_WARM_START if ti.static(divergence) else self.parameters.warm_start
            self.kappa_before[i] = kappa[i]
            self.kappa_weighted[i] = kappa[i] * self.density_weight[i]
        for i in range(self.count[None]):
            change = dt * self._density_rate(self.velocity, i)
            if ti.static(divergence):
                neighbors = self.pairs.count[i] + self.wall_pairs.count[i]
                self.source[i] = ti.select(neighbors < self.fewest_neighbors, -1e30, change)
            else:
                excess = self.density[i] - self._counted_mass(i) / self.volume[i]
                self.source[i] = ti.select(excess > 0.0, share * excess, excess) + change  # (D5)

    @ti.kernel
    def _iterate(self, kappa: ti.template(), dt: float, chebyshev: float):
        """One relaxed Jacobi step with kappa >= 0, accelerated by the Chebyshev weight."""
        for i in range(self.count[None]):
            a = self._acceleration(kappa, i)
            self.pressure_acceleration[i] = a
            self.weighted[i] = self.density_weight[i] * a
        for i in range(self.count[None]):
            compression = self.source[i] + dt * dt * self._density_rate(self.pressure_acceleration, i)
            now = kappa[i]
            step = now + self.relaxation[None] * compression / ti.max(dt * dt * self.diagonal[i], 1e-30)
            step = ti.max(self.kappa_before[i] + chebyshev * (step - self.kappa_before[i]), 0.0)  # (D6)
            kappa[i] = step
            self.kappa_before[i] = now
            self.kappa_weighted[i] = step * self.density_weight[i]
            # Where the pressure acts, an expansion is an error too: a warm start alone would blow the liquid up.
            error = ti.max(compression, ti.select(now > 0.0, -compression, 0.0))
            self.residual[i] = error * self.volume[i] / self._counted_mass(i)
        n = self.count[None]
        for block in range(blocks(n)):
            total = ti.cast(0.0, ti.f64)
            largest = ti.cast(0.0, ti.f64)
            for i in range(first(block, n), last(block, n)):
                total += self.residual[i]
                largest = ti.max(largest, ti.cast(self.residual[i], ti.f64))
            self.partial[0, block] = total
            self.partial[1, block] = largest
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.residual_mean[None] = total_of(self.partial, 0, n) / n
            self.residual_maximum[None] = largest_of(self.partial, 1, n)

    @ti.kernel
    def _accelerate_by_pressure(self, kappa: ti.template(), dt: float):
        for i in range(self.count[None]):
            self.velocity[i] += dt * self._acceleration(kappa, i)

    def _solve(self, kappa, dt: float, divergence: bool, fewest: int, tolerance: float) -> tuple[int, float, float]:
        """Change the velocity by the pressure that removes the compression.

        Returns
        -------
        iterations, mean and largest relative compression left.
        """
        # A step much shorter than the motion asks for (before a frame, or for a stiff effect) must not shed a standing
        # error at a high speed: with a tension that asks for tenths of a millisecond liquid at rest would heat.
        share = 1.0 if divergence else min(1.0, 2.0 * dt / self.solver.time_step_of_motion())
        self._start(kappa, dt, share, divergence)
        iterations, weight = 0, 1.0
        radius = self.parameters.chebyshev_radius
        while iterations < self.parameters.maximum_iterations:
            self._iterate(kappa, dt, weight)
            iterations += 1
            if iterations >= fewest and self.residual_mean[None] <= tolerance and (
                    self.residual_maximum[None] <= self.parameters.largest_error * tolerance):
                break
            # (D7)
            weight = 1.0 / (1.0 - 0.5 * radius**2) if iterations == 1 else 1.0 / (1.0 - 0.25 * radius**2 * weight)
        self._accelerate_by_pressure(kappa, dt)
        return iterations, self.residual_mean[None], self.residual_maximum[None]

    # The relaxation: below 2 over the largest eigenvalue of the matrix over its diagonal, which grows with h/dx.

    @ti.kernel
    def _power_start(self):
        for i in range(self.count[None]):
            self.source[i] = 0.0
            self.density_kappa[i] = ti.sin(12.9898 * i)
            self.kappa_weighted[i] = self.density_kappa[i] * self.density_weight[i]

    @ti.kernel
    def _power_step(self) -> ti.f64:
        """density_kappa = A density_kappa / diagonal, scaled; returns the Rayleigh quotient with the diagonal."""
        for i in range(self.count[None]):
            a = self._acceleration(self.density_kappa, i)
            self.pressure_acceleration[i] = a
            self.weighted[i] = self.density_weight[i] * a
        n = self.count[None]
        for block in range(blocks(n)):
            above = ti.cast(0.0, ti.f64)
            below = ti.cast(0.0, ti.f64)
            for i in range(first(block, n), last(block, n)):
                self.residual[i] = -self._density_rate(self.pressure_acceleration, i) / ti.max(self.diagonal[i], 1e-30)
                weight = ti.cast(self.diagonal[i], ti.f64) * self._counted_mass(i)
                above += weight * self.density_kappa[i] * self.residual[i]
                below += weight * self.density_kappa[i] ** 2
            self.partial[0, block] = above
            self.partial[1, block] = below
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.residual_mean[None] = total_of(self.partial, 0, n) / ti.max(total_of(self.partial, 1, n), 1e-300)
        for i in range(self.count[None]):
            self.density_kappa[i] = self.residual[i] / self.residual_mean[None]
            self.kappa_weighted[i] = self.density_kappa[i] * self.density_weight[i]
        return self.residual_mean[None]

    def set_rest_state(self) -> None:
        """Choose the relaxation from the largest eigenvalue at the start."""
        self._power_start()
        largest = 0.0
        for _ in range(POWER_ITERATIONS):
            largest = max(largest, self._power_step())
        self.density_kappa.fill(0.0)
        self.relaxation[None] = RELAXATION / largest

    # The step.

    def correct_divergence(self, dt: float) -> dict[str, float]:
        """Make the velocity free of compression; return the solve's statistics."""
        chosen = self.parameters
        iterations, mean, largest = self._solve(self.divergence_kappa, dt, True, 1, chosen.divergence_error)
        return {"divergence_iterations": iterations, "divergence_residual_mean": mean,
                "divergence_residual_maximum": largest}

    def correct_density(self, dt: float) -> dict[str, float]:
        """Make the density at the end of the step no larger than at rest; return the solve's statistics."""
        chosen = self.parameters
        iterations, mean, largest = self._solve(self.density_kappa, dt, False, chosen.minimum_iterations,
                                                chosen.density_error)
        return {"density_iterations": iterations, "residual_mean": mean, "residual_maximum": largest}

    def step(self, dt: float) -> dict[str, float]:
        solver = self.solver
        if self.masses_change:  # by an exchange between liquids since `measure`
            self._measure()
        statistics = solver.timed("divergence solve", self.correct_divergence, dt)
        solver.accelerate(dt)
        statistics |= solver.correct_velocity(dt)
        statistics |= solver.timed("density solve", self.correct_density, dt)
        solver.timed("position", self._move, dt)
        iterations = statistics["divergence_iterations"], statistics["density_iterations"]
        return statistics | {
            "pressure_iterations": sum(iterations), "wall_contacts": float(self.wall_stop.total()),
            "pressure_limit_hit": float(max(iterations) >= self.parameters.maximum_iterations)}

    @ti.kernel
    def _move(self, dt: float):
        for i in range(self.count[None]):
            self.pressure[i] = self.density[i] ** 2 * (self.density_kappa[i] + self.divergence_kappa[i])  # (D8)
            x, v = self.wall_stop.stopped(i, self.position[i] + dt * self.velocity[i], self.velocity[i])
            self.position[i] = x
            self.velocity[i] = v

    def state(self) -> dict:
        return {"relaxation": self.relaxation[None]}

    def restore(self, state: dict) -> None:
        self.relaxation[None] = float(state["relaxation"])
