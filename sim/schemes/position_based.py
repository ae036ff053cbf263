"""Position-based fluids [macklin2013; pbf, eqs. 1-4], for one liquid and for several (docs/methods/position_based.md).

A step moves every particle with its velocity, x* = x + dt v, and then corrects x* until no particle is denser than at
rest. With the compression rate Gamma_i = sum of V_j W_ij over liquid and wall, S_i its gradient and Gamma_0 its value
at rest, one iteration finds the multipliers of C_i = Gamma_i/Gamma_0 - 1 <= 0 and moves along their gradients,

    pi_i = omega (Gamma_i - Gamma_0) / (V_i [|S_i|^2/m_i + sum_j |V_j G_ij|^2/m_j + epsilon]),  0 where C_i <= 0,
    dx_i = -(V_i/m_i) [pi_i S_i + sum_j pi_j V_j G_ij + sum_b pi_b V_b G_ib].

The lambda_i of the papers is -V_i pi_i. What differs from [pbf], and why: the number density form and the masses in the
sum serve two densities, and sum m_i dx_i = 0 holds away from walls for any volumes and masses; the constraint is an
inequality, or by `constraint` an equality that pulls, only where there is a free surface, and an equality about the
mean compression in a full cavity; the rest value is that of the lattice; neighbors are found once per step, at x (a
second search at x* changes a dam's front by less than 1 %, as another time step does); W and its gradient are the
project's, one the gradient of the other, where [pbf, eqs. 5, 6] takes poly6 for one and spiky for the other; wall
particles take the mean multiplier of the liquid around them: where pi_i alone pushed, the pressure of a column 20 dx
high was off by 25 %, so by 4 %.

The sum of the multipliers is a pressure: m_i (x_i(t + dt) - x*_i)/dt^2 is the force -V_i sum_j V_j (p_i + p_j) G_ij of
p_i = (sum over iterations of pi_i)/dt^2.
"""
import dataclasses
import itertools
from types import MappingProxyType

import numpy as np

from sim.backend import data_oriented, real, real_numpy, ti
from sim.boundary import WALL_CLEARANCE
from sim.effects.effect import GROWTH
from sim.fields import Field
from sim.parameters import parameter
from sim.reductions import blocks, first, largest_of, last, partial_results, total_of
from sim.schemes.scheme import Scheme
from sim.smoothing_kernels import lattice_sum

PAPER_DENSITY = 1.25  # particles per dx^d at rest [pbf, section Initialization]: the liquid shrinks to 80 %
PLAIN_ITERATIONS = 3  # iterations before the Chebyshev weights set in (contacts have to settle first [wang2015])
START_PROJECTIONS = 8  # of a full cavity before its first step


@dataclasses.dataclass(frozen=True)
class PositionBasedParameters:
    """Iterations of the density constraint and the paper's optional terms."""

    iterations: int = parameter(20, minimum=1, maximum=1000, meaning="corrections per step, always all of them")
    relaxation: float = parameter(0.7, exclusive_minimum=0.0, maximum=1.0,
                                  meaning="share of the largest step omega at which a lattice converges")
    constraint: str = parameter("inequality", choices=("inequality", "equality"),
                                meaning="at a free surface: only what is too dense is corrected, or what is too thin "
                                        "too; a full cavity always has the equality about the mean")
    softness: float = parameter(0.01, exclusive_minimum=0.0, maximum=100.0,
                                meaning="epsilon of the multipliers, over the gradients' sum in a lattice")
    acceleration: float = parameter(0.97, minimum=0.0, maximum=0.999,
                                    meaning="spectral radius of the Chebyshev weights; 0 for plain iterations")
    artificial_pressure: float = parameter(
        0.0, minimum=0.0, maximum=1.0, meaning="strength k of s_corr = -k dx^2 (W(r)/W(dq h))^n; it adds volume")
    artificial_pressure_radius: float = parameter(0.2, minimum=0.0, maximum=0.5,
                                                  meaning="dq of s_corr, in support radii")
    artificial_pressure_exponent: float = parameter(4.0, minimum=1.0, maximum=10.0, meaning="exponent n of s_corr")
    vorticity_confinement: float = parameter(
        0.0, unit="1/s", minimum=0.0, maximum=1e3,
        meaning="acceleration over dx and vorticity; not momentum conserving: for looks, off for measurements")
    walls: str = parameter("particles", choices=("particles", "clamp"),
                           meaning="wall particles, or a plain clamping of positions, at which particles stick")
    rest_density: str = parameter("lattice", choices=("lattice", "paper"),
                                  meaning="that of the lattice, or the paper's 1.25 particles per dx^d")


@data_oriented
class PositionBased(Scheme):
    """Scheme `position_based`."""

    name = "position_based"
    Parameters = PositionBasedParameters
    lacks = MappingProxyType({
        GROWTH: "the overlap of a particle that splits becomes velocity within one step"})
    unread = MappingProxyType(dict.fromkeys(("pressure_tolerance", "maximum_iterations"),
                                            "schemes.position_based.iterations"))
    largest_density_ratio = 10.0  # two layers keep their volume within 1 %; at 1:1000 they grow by 2.8 %
    fields = (
        Field("pressure", "scalar", "Pa", "sum of the multipliers of a step over dt^2", carried=True),
        Field("compression_rate", "scalar", "1", "Gamma_i = sum of V_j W_ij over liquid and wall"),
        Field("predicted_position", "vector", "m", "x*: position at the end of the step"),
        Field("displacement", "vector", "m", "x* less the position at the start of the step"),
        Field("displacement_before", "vector", "m", "displacement one iteration earlier"),
        Field("correction", "vector", "m", "dx_i of one iteration; change of velocity afterwards"),
        Field("multiplier", "scalar", "Pa s2", "pi_i of one iteration"),
        Field("multiplier_sum", "scalar", "Pa s2", "sum of the multipliers so far"),
        Field("multiplier_sum_before", "scalar", "Pa s2", "the sum one iteration earlier"),
        Field("violation", "scalar", "1", "C_i before the last correction; of an inequality only what exceeds 0"),
        Field("contact", "integer", "", "1 where the wall itself stopped the particle in this step"),
    )

    def __init__(self, solver):
        super().__init__(solver)
        chosen = self.parameters
        self.closed = solver.settings.closed
        self.clamps = chosen.walls == "clamp"
        self.pushes_only = chosen.constraint == "inequality" and not self.closed
        if self.closed and (self.clamps or chosen.rest_density == "paper"):
            raise ValueError("schemes.position_based.walls must be particles and rest_density lattice where the "
                             "liquids fill the cavity completely")
        self.kernel, self.dimension = solver.kernel, solver.dimension
        self.clearance = 0.0 if self.clamps else WALL_CLEARANCE * self.spacing
        squares, eigenvalue = self._lattice_gradients()
        self.softening = chosen.softness * squares  # 1/m^2
        self.omega = chosen.relaxation * 2.0 / eigenvalue  # (B6)
        self.rest = ti.field(real(), shape=())  # Gamma_0
        self.partial = partial_results(3)
        self.rest[None] = PAPER_DENSITY
        if chosen.rest_density == "lattice":
            self.rest[None] = lattice_sum(self.kernel, solver.rest_volume ** (1.0 / self.dimension), self.dimension)
        self.wall_multiplier = ti.field(real(), shape=max(self.walls.count, 1))
        self.residual_mean, self.residual_maximum = (ti.field(ti.f64, shape=()) for _ in range(2))
        self.contacts = ti.field(ti.i32, shape=())
        confined = solver.particles.capacity if chosen.vorticity_confinement > 0.0 else 1
        self.vorticity = ti.Vector.field(3, real(), shape=confined, layout=ti.Layout.SOA)  # 1/s

    @ti.kernel
    def _sample(self, r: ti.types.ndarray(), factor: ti.types.ndarray()):
        for k in range(r.shape[0]):
            factor[k] = self.kernel.gradient_factor(r[k])

    def _lattice_gradients(self) -> tuple[float, float]:
        """Sum of |V G|^2 over a lattice, 1/m^2, and the largest eigenvalue of the matrix of the multipliers there.

        The matrix is diagonal in Fourier space: |sum_j V G_j sin(k.x_j)|^2 over that sum; plain iterations converge for
        omega below 2 over the largest of them. A disordered set and a density ratio of 1:1000 lower this to 0.8.
        """
        reach = int(np.ceil(self.solver.support_radius / self.spacing))
        offsets = np.array(list(itertools.product(range(-reach, reach + 1), repeat=self.dimension)), float)
        r = (self.spacing * np.linalg.norm(offsets, axis=1)).astype(real_numpy())
        factor = np.zeros_like(r)
        self._sample(r, factor)
        gradient = self.spacing ** (self.dimension + 1) * factor[:, None].astype(float) * offsets
        squares = (gradient**2).sum()
        waves = np.array(list(itertools.product(np.linspace(0.0, np.pi, 17), repeat=self.dimension)))
        return squares, ((np.sin(waves @ offsets.T) @ gradient) ** 2).sum(axis=1).max() / squares

    @ti.kernel
    def _measure(self):
        for i in range(self.count[None]):
            total = self.volume[i] * self.kernel.at_zero
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                total += self.pairs.weight[k]
            for slot in range(self.wall_pairs.count[i]):
                k = self.wall_pairs.entry(i, slot)
                total += self.wall_pairs.weight[k]
            self.compression_rate[i] = total

    @ti.kernel
    def _set_rest_to_mean(self):
        n = self.count[None]
        for block in range(blocks(n)):
            total = ti.cast(0.0, ti.f64)
            for i in range(first(block, n), last(block, n)):
                total += self.compression_rate[i]
            self.partial[0, block] = total
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.rest[None] = total_of(self.partial, 0, n) / n

    def measure(self) -> None:
        """Compression rates; a full cavity cannot be less dense than it is on average."""
        self._measure()
        if self.closed:
            self._set_rest_to_mean()

    def set_rest_state(self) -> None:
        """Move the particles of a full cavity onto their constraints [macklin2014, section 4.4].

        What the packing has left would become velocity in the first step.
        """
        if not self.closed:
            return
        velocity = self.velocity.to_numpy()
        for _ in range(START_PROJECTIONS):
            self.velocity.fill(0.0)
            self.project(1.0)
            self._arrive()
        self.velocity.from_numpy(velocity)
        self.pressure.fill(0.0)
        self.search.sort()
        self.search.build()
        self.measure()

    def step(self, dt: float) -> dict[str, float]:
        solver = self.solver
        solver.accelerate(dt)
        statistics = solver.correct_velocity(dt)
        statistics |= solver.timed("pressure", self.project, dt)
        if self.parameters.vorticity_confinement > 0.0:
            solver.timed("vorticity", self._confine_vorticity, dt)
        self._arrive()
        return statistics

    def project(self, dt: float) -> dict[str, float]:
        """Correct the predicted positions, and take the velocity from them; return statistics.

        The Chebyshev weights [wang2015] are linear in earlier displacements: they keep the momentum too.
        """
        self._predict(dt)
        weight, radius = 1.0, self.parameters.acceleration
        iterations = self.parameters.iterations
        for iteration in range(iterations):
            self._find_multipliers()
            if radius > 0.0 and iteration == PLAIN_ITERATIONS:
                weight = 2.0 / (2.0 - radius**2)
            elif radius > 0.0 and iteration > PLAIN_ITERATIONS:
                weight = 4.0 / (4.0 - radius**2 * weight)
            self._find_corrections()
            self._correct(weight, int(self.clamps or iteration == iterations - 1))
        self._finish(dt)
        return {"pressure_iterations": iterations, "residual_mean": self.residual_mean[None],
                "residual_maximum": self.residual_maximum[None], "wall_contacts": float(self.contacts[None])}

    @ti.kernel
    def _predict(self, dt: float):
        for i in range(self.count[None]):
            self.displacement[i] = dt * self.velocity[i]
            self.predicted_position[i] = self.position[i] + self.displacement[i]
            self.multiplier_sum[i] = 0.0

    @ti.kernel
    def _find_multipliers(self):
        for i in range(self.count[None]):
            x = self.predicted_position[i]
            total = self.volume[i] * self.kernel.at_zero
            slope = x * 0.0
            squares = 0.0
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                j = self.pairs.index[k]
                x_ij = self.search.separation(x, self.predicted_position[j])
                r = x_ij.norm()
                gradient = (self.volume[j] * self.kernel.gradient_factor(r)) * x_ij
                total += self.volume[j] * self.kernel.value(r)
                slope += gradient
                squares += gradient.norm_sqr() / self.mass[j]
            if ti.static(not self.clamps):
                for slot in range(self.wall_pairs.count[i]):
                    k = self.wall_pairs.entry(i, slot)
                    b = self.wall_pairs.index[k]
                    x_ib = self.search.separation(x, self.walls.position[b])
                    r = x_ib.norm()
                    total += self.walls.volume[b] * self.kernel.value(r)
                    slope += (self.walls.volume[b] * self.kernel.gradient_factor(r)) * x_ib
            excess = total - self.rest[None]
            if ti.static(self.pushes_only):
                excess = ti.max(excess, 0.0)  # a free surface does not pull
            self.violation[i] = excess / self.rest[None]  # (B1)
            squares += (slope.norm_sqr() + self.softening) / self.mass[i]
            self.multiplier[i] = self.omega * excess / (self.volume[i] * squares)  # (B2)

    @ti.func
    def _artificial_pressure(self, i, j, r):
        """s_corr [macklin2013, eq. 13] as a multiplier, the same for i and j (B4): k dx^2 (W(r)/W(dq h))^n times the
        mean density.
        """
        near = self.parameters.artificial_pressure_radius * self.kernel.support_radius
        ratio = self.kernel.value(r) / self.kernel.value(near)
        density_i, density_j = self.mass[i] / self.volume[i], self.mass[j] / self.volume[j]
        mean = 2.0 * density_i * density_j / (density_i + density_j)
        return (self.omega * self.parameters.artificial_pressure * self.spacing**2 * mean
                * ti.pow(ratio, self.parameters.artificial_pressure_exponent))

    @ti.kernel
    def _find_corrections(self):
        if ti.static(not self.clamps):
            for b in range(self.walls.count):
                total = 0.0
                weight = 0.0
                for slot in range(self.wall_rows.count[b]):
                    k = self.wall_rows.entry(b, slot)
                    total += self.wall_rows.weight[k] * self.multiplier[self.wall_rows.index[k]]
                    weight += self.wall_rows.weight[k]
                self.wall_multiplier[b] = ti.select(weight > 0.0, total / ti.max(weight, 1e-20), 0.0)
        for i in range(self.count[None]):
            x, own = self.predicted_position[i], self.multiplier[i]
            total = x * 0.0
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                j = self.pairs.index[k]
                x_ij = self.search.separation(x, self.predicted_position[j])
                r = x_ij.norm()
                both = own + self.multiplier[j]
                if ti.static(self.parameters.artificial_pressure > 0.0):
                    both += self._artificial_pressure(i, j, r)
                total += (both * self.volume[j] * self.kernel.gradient_factor(r)) * x_ij
            if ti.static(not self.clamps):
                for slot in range(self.wall_pairs.count[i]):
                    k = self.wall_pairs.entry(i, slot)
                    b = self.wall_pairs.index[k]
                    x_ib = self.search.separation(x, self.walls.position[b])
                    both = own + self.wall_multiplier[b]
                    total += (both * self.walls.volume[b] * self.kernel.gradient_factor(x_ib.norm())) * x_ib
            self.correction[i] = -self.volume[i] / self.mass[i] * total  # (B3)

    @ti.kernel
    def _correct(self, weight: float, stop: int):
        """Add the corrections with the weight of this iteration; where `stop`, the wall holds what is beyond it."""
        for i in range(self.count[None]):
            before, total = self.displacement[i], self.multiplier_sum[i]
            after, total_after = before + self.correction[i], total + self.multiplier[i]
            if weight != 1.0:
                after = self.displacement_before[i] + weight * (after - self.displacement_before[i])
                earlier = self.multiplier_sum_before[i]
                total_after = earlier + weight * (total_after - earlier)
            self.contact[i] = 0
            if stop == 1:
                x = self.position[i] + after
                overlap = self.solver.distance.value(x) + self.clearance
                if overlap > 0.0:
                    self.contact[i] = 1
                    after -= overlap * self.solver.distance.normal(x)
            self.displacement_before[i], self.multiplier_sum_before[i] = before, total
            self.displacement[i], self.multiplier_sum[i] = after, total_after
            self.predicted_position[i] = self.position[i] + after

    @ti.kernel
    def _finish(self, dt: float):
        """Velocity and pressure of the step, and its statistics."""
        n = self.count[None]
        for block in range(blocks(n)):
            total = ti.cast(0.0, ti.f64)
            largest = ti.cast(0.0, ti.f64)
            contacts = 0
            for i in range(first(block, n), last(block, n)):
                self.velocity[i] = self.displacement[i] / dt
                self.pressure[i] = self.multiplier_sum[i] / (dt * dt)  # (B5)
                violation = ti.cast(ti.abs(self.violation[i]), ti.f64)
                total += violation
                largest = ti.max(largest, violation)
                contacts += self.contact[i]
            self.partial[0, block] = total
            self.partial[1, block] = largest
            self.partial[2, block] = contacts
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.residual_mean[None] = total_of(self.partial, 0, n) / n
            self.residual_maximum[None] = largest_of(self.partial, 1, n)
            self.contacts[None] = ti.cast(total_of(self.partial, 2, n), ti.i32)

    @ti.func
    def _in_space(self, v):
        """A vector of the plane as one of space."""
        result = ti.Vector([0.0, 0.0, 0.0])
        for d in ti.static(range(self.dimension)):
            result[d] = v[d]
        return result

    @ti.kernel
    def _confine_vorticity(self, dt: float):
        """a_i = strength dx N x omega with N = grad|omega| over its length [fedkiw2001] (B7)."""
        for i in range(self.count[None]):
            x, total = self.predicted_position[i], ti.Vector([0.0, 0.0, 0.0])
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                j = self.pairs.index[k]
                x_ij = self.search.separation(x, self.predicted_position[j])
                gradient = (self.volume[j] * self.kernel.gradient_factor(x_ij.norm())) * x_ij
                total += self._in_space(gradient).cross(self._in_space(self.velocity[j] - self.velocity[i]))
            self.vorticity[i] = total
        for i in range(self.count[None]):
            x, own = self.predicted_position[i], self.vorticity[i].norm()
            slope = x * 0.0
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                j = self.pairs.index[k]
                x_ij = self.search.separation(x, self.predicted_position[j])
                factor = self.volume[j] * self.kernel.gradient_factor(x_ij.norm())
                slope += (factor * (self.vorticity[j].norm() - own)) * x_ij
            towards = self._in_space(slope / ti.max(slope.norm(), 1e-12 * own / self.spacing + 1e-30))
            push = towards.cross(self.vorticity[i])
            for d in ti.static(range(self.dimension)):
                self.correction[i][d] = dt * self.parameters.vorticity_confinement * self.spacing * push[d]
        for i in range(self.count[None]):
            self.velocity[i] += self.correction[i]

    @ti.kernel
    def _arrive(self):
        for i in range(self.count[None]):
            self.position[i] = self.predicted_position[i]
