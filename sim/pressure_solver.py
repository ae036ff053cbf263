"""The pressure equation A p = b of a completely full cavity, solved by preconditioned conjugate residuals.

A = E^T D M^-1 D^T E with (D v)_i = V_i sum_j V_j (v_i - v_j).G_ij, the volume rate of particle i, wall rows included,
and E = [1; P] that extrapolates the pressure of the liquid to wall particles, P_bf = V_f W_bf / sum_f V_f W_bf.
The transpose of E folds the volume rate of the wall rows back onto the liquid, so that A is symmetric, momentum is
exact between liquid and wall, and a tangential slip feels no wall pressure (p_b = 0 and mirrored pressures leave
24-44 % hydrostatic error on curved walls).
"""
import taichi as ti

from sim.fields import ParticleStore
from sim.neighbor_search import NeighborSearch
from sim.runtime import real


@ti.data_oriented
class PressureSolver:
    """Operators and solver of the pressure equation; one instance serves velocity and position corrections.

    Fields of liquid particles: `kernel_gradient_sum` S_i = sum of V_j G_ij over all neighbors, `volume`, `mass`.
    The weight of the force is V/m for velocities (weighted=True) and 1 for positions (weighted=False).
    """

    def __init__(self, particles: ParticleStore, search: NeighborSearch, gradient_sum):
        self.particles = particles
        self.count = particles.count
        self.volume = particles.arrays["volume"]
        self.mass = particles.arrays["mass"]
        self.gradient_sum = gradient_sum
        self.pairs, self.wall_pairs, self.wall_rows = search.pairs, search.wall_pairs, search.wall_rows
        self.walls = search.walls
        n, walls, dimension = particles.capacity, max(search.walls.count, 1), particles.dimension
        self.right_side, self.residual, self.direction, self.image, self.preconditioned, self.applied, self.diagonal = (
            ti.field(real(), shape=n) for _ in range(7))
        self.force = ti.Vector.field(dimension, real(), shape=n, layout=ti.Layout.SOA)  # per volume or per mass
        self.wall_weight, self.wall_value = (ti.field(real(), shape=walls) for _ in range(2))
        self.product, self.product_2 = (ti.field(ti.f64, shape=n) for _ in range(2))
        self.rho, self.residual_mean, self.residual_maximum = (ti.field(ti.f64, shape=()) for _ in range(3))
        self.alpha, self.beta, self.mean = (ti.field(real(), shape=()) for _ in range(3))

    @ti.kernel
    def update_wall_weights(self):
        """sum_f V_f W_bf of every wall particle; 0 where no liquid is near."""
        for b in range(self.walls.count):
            total = 0.0
            for k in range(b * self.wall_rows.width, b * self.wall_rows.width + self.wall_rows.count[b]):
                total += self.wall_rows.weight[k]
            self.wall_weight[b] = total

    @ti.func
    def over_wall_weight(self, b, value):
        return ti.select(self.wall_weight[b] > 0.0, value / ti.max(self.wall_weight[b], 1e-20), 0.0)

    @ti.func
    def extrapolated(self, p: ti.template(), b):
        """Pressure of wall particle b: mean of the liquid neighbors."""
        total = 0.0
        for k in range(b * self.wall_rows.width, b * self.wall_rows.width + self.wall_rows.count[b]):
            total += self.wall_rows.weight[k] * p[self.wall_rows.index[k]]
        return self.over_wall_weight(b, total)

    @ti.func
    def pressure_force(self, p: ti.template(), i):
        """-(D^T E p)_i / V_i; `wall_value` must hold the wall pressures."""
        total = p[i] * self.gradient_sum[i]
        for k in range(i * self.pairs.width, i * self.pairs.width + self.pairs.count[i]):
            total += p[self.pairs.index[k]] * self.pairs.gradient[k]
        for k in range(i * self.wall_pairs.width, i * self.wall_pairs.width + self.wall_pairs.count[i]):
            total += self.wall_value[self.wall_pairs.index[k]] * self.wall_pairs.gradient[k]
        return -total

    @ti.func
    def wall_rate(self, v: ti.template(), b):
        """(D v)_b / (V_b sum_f V_f W_bf) of the static wall particle b."""
        total = 0.0
        for k in range(b * self.wall_rows.width, b * self.wall_rows.width + self.wall_rows.count[b]):
            total -= v[self.wall_rows.index[k]].dot(self.wall_rows.gradient[k])
        return self.over_wall_weight(b, total)

    @ti.func
    def fold(self, i):
        """(P^T X)_i / V_i of the wall rows' X_b / (V_b sum_f V_f W_bf) in `wall_value`."""
        total = 0.0
        for k in range(i * self.wall_pairs.width, i * self.wall_pairs.width + self.wall_pairs.count[i]):
            total += self.wall_pairs.weight[k] * self.wall_value[self.wall_pairs.index[k]]
        return total

    @ti.func
    def volume_rate(self, v: ti.template(), i):
        """(E^T D v)_i; `wall_value` must hold the wall rates."""
        total = v[i].dot(self.gradient_sum[i])
        for k in range(i * self.pairs.width, i * self.pairs.width + self.pairs.count[i]):
            total -= v[self.pairs.index[k]].dot(self.pairs.gradient[k])
        return self.volume[i] * (total + self.fold(i))

    @ti.func
    def _weight(self, i, weighted: ti.template()):
        w = 1.0
        if ti.static(weighted):
            w = self.volume[i] / self.mass[i]
        return w

    @ti.kernel
    def accelerate(self, p: ti.template(), v: ti.template(), factor: float, weighted: ti.template()):
        """v_i += factor * F_i(p) / m_i (or / V_i where not weighted)."""
        for b in range(self.walls.count):
            self.wall_value[b] = self.extrapolated(p, b)
        for i in range(self.count[None]):
            v[i] += factor * self._weight(i, weighted) * self.pressure_force(p, i)

    @ti.kernel
    def _update_diagonal(self, weighted: ti.template()):
        for i in range(self.count[None]):
            total = self._weight(i, weighted) * self.gradient_sum[i].norm_sqr() / self.volume[i]
            for k in range(i * self.pairs.width, i * self.pairs.width + self.pairs.count[i]):
                j = self.pairs.index[k]
                total += self._weight(j, weighted) * self.pairs.gradient[k].norm_sqr() / self.volume[j]
            self.diagonal[i] = self.volume[i] ** 2 * total

    @ti.kernel
    def _apply(self, x: ti.template(), weighted: ti.template()):
        """applied = A x."""
        for b in range(self.walls.count):
            self.wall_value[b] = self.extrapolated(x, b)
        for i in range(self.count[None]):
            self.force[i] = self._weight(i, weighted) * self.pressure_force(x, i)
        for b in range(self.walls.count):
            self.wall_value[b] = self.wall_rate(self.force, b)
        for i in range(self.count[None]):
            self.applied[i] = -self.volume_rate(self.force, i)

    @ti.kernel
    def _start(self, p: ti.template()):
        """residual = b - A p with the mean removed."""
        for i in range(self.count[None]):
            self.residual[i] = self.right_side[i] - self.applied[i]
        ti.loop_config(serialize=True)
        for _ in range(1):
            total = ti.cast(0.0, ti.f64)
            for i in range(self.count[None]):
                total += self.residual[i]
            self.mean[None] = total / self.count[None]
            self.rho[None] = 0.0
        for i in range(self.count[None]):
            self.residual[i] -= self.mean[None]
            self.direction[i] = 0.0
            self.image[i] = 0.0

    @ti.kernel
    def _precondition(self):
        """preconditioned = residual / diagonal with the mean removed; mean and largest residual per volume."""
        for i in range(self.count[None]):
            z = self.residual[i] / self.diagonal[i]
            self.preconditioned[i] = z
            self.product[i] = ti.abs(self.residual[i]) / self.volume[i]
            self.product_2[i] = z
        ti.loop_config(serialize=True)
        for _ in range(1):
            mean = ti.cast(0.0, ti.f64)
            total = ti.cast(0.0, ti.f64)
            largest = ti.cast(0.0, ti.f64)
            for i in range(self.count[None]):
                mean += self.product_2[i]
                total += self.product[i]
                largest = ti.max(largest, self.product[i])
            self.mean[None] = mean / self.count[None]
            self.residual_mean[None] = total / self.count[None]
            self.residual_maximum[None] = largest
        for i in range(self.count[None]):
            self.preconditioned[i] -= self.mean[None]

    @ti.kernel
    def _advance(self, p: ti.template()):
        """One step of conjugate residuals; rho becomes z.Az, and alpha is 0 where the search has to stop."""
        for i in range(self.count[None]):
            self.product[i] = ti.cast(self.preconditioned[i], ti.f64) * self.applied[i]
        ti.loop_config(serialize=True)
        for _ in range(1):
            total = ti.cast(0.0, ti.f64)
            mean = ti.cast(0.0, ti.f64)
            for i in range(self.count[None]):
                total += self.product[i]
                mean += self.applied[i]
            self.mean[None] = mean / self.count[None]
            self.beta[None] = ti.select(self.rho[None] > 0.0, total / self.rho[None], 0.0)
            self.rho[None] = total
        for i in range(self.count[None]):
            beta = self.beta[None]
            self.direction[i] = self.preconditioned[i] + beta * self.direction[i]
            # A does not map to zero mean exactly: left in, a uniform rate that no pressure can change would build up.
            self.image[i] = self.applied[i] - self.mean[None] + beta * self.image[i]
            self.product[i] = ti.cast(self.image[i], ti.f64) * self.image[i] / self.diagonal[i]
        ti.loop_config(serialize=True)
        for _ in range(1):
            total = ti.cast(0.0, ti.f64)
            for i in range(self.count[None]):
                total += self.product[i]
            self.alpha[None] = ti.select((self.rho[None] > 0.0) & (total > 0.0), self.rho[None] / total, 0.0)
        for i in range(self.count[None]):
            alpha = self.alpha[None]
            p[i] += alpha * self.direction[i]
            self.residual[i] -= alpha * self.image[i]

    def solve(self, p, *, weighted: bool, step: float, tolerance: float, maximum_iterations: int):
        """Improve `p` until mean |residual| * step / V <= tolerance.

        `right_side` holds b / step already; a tolerance of 0 makes exactly `maximum_iterations`.

        Returns
        -------
        iterations : int
        residual_mean, residual_maximum : mean and largest |residual| * step / V at the end.
        """
        self._update_diagonal(weighted)
        self._apply(p, weighted)
        self._start(p)
        self._precondition()
        iterations = 0
        while iterations < maximum_iterations and (tolerance == 0.0 or self.residual_mean[None] * step > tolerance):
            self._apply(self.preconditioned, weighted)
            self._advance(p)
            if tolerance > 0.0 and self.alpha[None] == 0.0:
                break
            self._precondition()
            iterations += 1
        return iterations, self.residual_mean[None] * step, self.residual_maximum[None] * step
