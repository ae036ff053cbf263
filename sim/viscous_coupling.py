"""Pressure and implicit viscosity as one step: what their splitting leaves undone in liquid with nu dt > dx^2.

The pressure that frees a velocity of its divergence has to overcome viscosity: with it the matrix is the Schur
complement S = E^T D (M + dt K)^-1 D^T E in place of A. A^-1 + B, with a diagonal B that stands for viscosity, is near
its inverse [cahouet1988], and one direction of descent with a line search takes most of what is left. Equations:
docs/methods/pressure.md.
"""

from sim.backend import data_oriented, real, ti
from sim.pressure_operators import PressureOperators
from sim.reductions import blocks, first, last, partial_results, total_of
from sim.smoothing_kernels import LatticeGradients


@data_oriented
class ViscousCoupling:
    """B and the search along one direction. It belongs to the effect that needs it.

    Parameters
    ----------
    operators : A and its factors.
    viscous : the effect that solves (M + dt K) v = M v*.
    """

    def __init__(self, solver, operators: PressureOperators, viscous):
        self.operators, self.viscous = operators, viscous
        self.count, self.volume, self.mass = solver.count, operators.volume, operators.mass
        self.pairs, self.wall_pairs = operators.pairs, operators.wall_pairs
        n, dimension = solver.particles.capacity, solver.dimension
        self.slack = ti.field(real(), shape=n)  # B_i, Pa s2
        self.push, self.answer = (ti.Vector.field(dimension, real(), shape=n, layout=ti.Layout.SOA) for _ in range(2))
        self.partial = partial_results(2)
        self.slope, self.curvature = (ti.field(ti.f64, shape=()) for _ in range(2))
        compression, diagonal = viscous.stiffness()
        self.lattice = LatticeGradients(solver.kernel, solver.spacing, dimension)
        self.scale = compression * self.lattice.square() / diagonal

    @ti.kernel
    def measure(self):
        """B of the present step: compression times mu dt inside a liquid, next to nothing where a thin one is near."""
        for i in range(self.count[None]):
            own = self.operators.own_gradient(i, True).norm_sqr() / self.volume[i]
            stiff = own * self.volume[i] / self.viscous.viscous_mass(i)  # both over V_i^2, like (P5)
            free = own * self.operators.mobility[i]
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                j = self.pairs.index[k]
                square = self.operators.share(i, j, True) ** 2 * self.pairs.gradient[k].norm_sqr() / self.volume[j]
                stiff += square * self.volume[j] / self.viscous.viscous_mass(j)
                free += square * self.operators.mobility[j]
            self.slack[i] = ti.max(self.scale * (1.0 / stiff - 1.0 / free) / self.volume[i], 0.0)  # (P14)

    @ti.kernel
    def add(self, p: ti.template(), rate: ti.template()):
        """p += B rate/V: the pressure that viscosity asks for where volumes change at a rate."""
        for i in range(self.count[None]):
            p[i] += self.slack[i] * rate[i] / self.volume[i]

    @ti.kernel
    def _push(self, z: ti.template(), dt: float):
        for b in range(self.operators.walls.count):
            self.operators.wall_value[b] = self.operators.extrapolated(z, b, True)
        for i in range(self.count[None]):
            self.push[i] = dt * self.volume[i] / self.mass[i] * self.operators.pressure_force(z, i, True)

    @ti.kernel
    def _find_step(self, z: ti.template(), rate: ti.template(), dt: float):
        """alpha = z.r / z.S z."""
        n = self.count[None]
        for b in range(self.operators.walls.count):
            self.operators.wall_value[b] = self.operators.wall_rate(self.answer, b, True)
        for i in range(n):
            self.operators.applied[i] = -self.operators.volume_rate(self.answer, i) / dt
        for block in range(blocks(n)):
            slope = ti.cast(0.0, ti.f64)
            curvature = ti.cast(0.0, ti.f64)
            for i in range(first(block, n), last(block, n)):
                slope += ti.cast(z[i], ti.f64) * rate[i]
                curvature += ti.cast(z[i], ti.f64) * self.operators.applied[i]
            self.partial[0, block] = slope
            self.partial[1, block] = curvature
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.slope[None] = total_of(self.partial, 0, n)
            self.curvature[None] = total_of(self.partial, 1, n)

    @ti.kernel
    def _take(self, p: ti.template(), v: ti.template(), z: ti.template(), alpha: float):
        for i in range(self.count[None]):
            p[i] += alpha * z[i]
            v[i] += alpha * self.answer[i]

    def press(self, z, dt: float, tolerance: float) -> dict[str, float]:
        """Find what viscosity leaves of the push of a pressure z; return the iterations."""
        self._push(z, dt)
        return {"viscosity_iterations": self.viscous.answer(self.push, self.answer, dt, tolerance)}

    def descend(self, p, v, z, rate, dt: float) -> None:
        """Add alpha z to the pressure and what it does to the velocity, alpha the best.

        `rate` is E^T D v/dt of the velocity, with what volumes grow by.
        """
        self._find_step(z, rate, dt)
        alpha = self.slope[None] / self.curvature[None] if self.curvature[None] > 0.0 else 0.0
        self._take(p, v, z, alpha)  # (P15)
        self.viscous.take_answer(self.push, self.answer, alpha, dt)
