"""Viscous forces as matrices K, symmetric and positive semidefinite, for `viscosity_implicit`: F = -K v.

central    pair forces along the line of two particles (Weiler et al. 2018, volume form):
           F_ij = 2(d+2) mu_ij V_i V_j (v_ij.x_ij)/r^2 grad W_ij.
laplacian  pair forces along the difference of velocities (Morris et al. 1997): 2 mu_ij V_i V_j W'/r v_ij.
strain     K = B^T diag(2 mu V) B, with B the symmetric gradient of the velocity over alike neighbors and the wall,
           corrected to be exact for linear fields (Bonet & Lok 1999); the central form joins liquids that are not
           alike, and with a small share everywhere it stops the motions that B does not see (hourglass modes).

mu_ij is the harmonic mean 2 mu_i mu_j/(mu_i + mu_j), which keeps the shear stress continuous at a jump of viscosity.
All conserve momentum; central and strain, which rigid rotations do not strain, conserve spin as well.
"""
import abc

import taichi as ti

from sim.runtime import real

STRAIN_SHARE = 0.9  # of the strain form; 0.8 takes over more of the central form's bias, 0.95 is noisier at interfaces
ALIKE = 0.5  # smallest ratio of viscosities that the gradient of the velocity may reach across
FEW, ENOUGH = 0.1, 0.3  # of 1/|L|, L the correction of the gradient: 0.7 inside, 0.43 at a flat rim, 0.13 for four


@ti.func
def harmonic_mean(mu_i, mu_j):
    """Harmonic mean of two viscosities, Pa s."""
    return 2.0 * mu_i * mu_j / ti.max(mu_i + mu_j, 1e-20)


@ti.func
def alike(mu_i, mu_j):
    """True for particles between which the gradient of the velocity does not jump."""
    return ti.min(mu_i, mu_j) >= ALIKE * ti.max(mu_i, mu_j)


@ti.data_oriented
class ViscousForm(abc.ABC):
    """Base of the forms.

    Parameters
    ----------
    particles : view of the particle fields, `dynamic_viscosity`, `viscous_diagonal` and `wall_friction` among them.
    liquids : friction at the wall; no_slip : whether there is any.
    """

    def __init__(self, solver, particles, liquids, no_slip: bool):
        self.solver, self.particles, self.liquids, self.no_slip = solver, particles, liquids, no_slip
        self.count, self.dimension = solver.count, solver.dimension
        self.pairs, self.wall_pairs, self.walls = solver.pairs, solver.wall_pairs, solver.walls
        self.kernel, self.search = solver.kernel, solver.search

    @abc.abstractmethod
    def assemble(self, dt: float) -> None:
        """Cache what depends on positions and viscosities; set the diagonal of M + dt K and the friction of the wall.

        The friction of a particle is a number: the mean over all directions of its motion.
        """

    def differentiate(self, v) -> None:
        """Compute what `added` needs of the field v."""

    @ti.func
    def added(self, total, v: ti.template(), i, dt):
        """total + dt (K v) of particle i, N s."""
        return ti.static(None)


@ti.data_oriented
class CentralForm(ViscousForm):
    """Central pair forces; `share` leaves the given share of alike pairs to another form."""

    def __init__(self, solver, particles, liquids, no_slip: bool, share=None):
        super().__init__(solver, particles, liquids, no_slip)
        self.factor = 2.0 * (self.dimension + 2.0)
        self.share, self.shared = share, share is not None
        # sqrt(2(d+2) mu_ij V_i V_j |W'|/r) e_ij: the pair force is -s (s.v_ij).
        self.pair_vector = self.pairs.per_entry(self.dimension)
        self.wall_vector = self.wall_pairs.per_entry(self.dimension)

    @ti.func
    def _pair(self, mu, volumes, x):
        r = ti.max(x.norm(), 1e-6 * self.kernel.support_radius)
        return ti.sqrt(-self.factor * mu * volumes * self.kernel.gradient_factor(r)) / r * x

    @ti.func
    def _viscosity(self, i, j):
        mu_i, mu_j = self.particles.dynamic_viscosity[i], self.particles.dynamic_viscosity[j]
        mean = harmonic_mean(mu_i, mu_j)
        if ti.static(self.shared):
            joined = ti.select(alike(mu_i, mu_j), 1.0, 0.0)
            mean *= 1.0 - 0.5 * joined * (self.share[i] + self.share[j])
        return mean

    @ti.kernel
    def assemble(self, dt: float):
        for i in range(self.count[None]):
            x, mu, volume = self.particles.position[i], self.particles.dynamic_viscosity[i], self.particles.volume[i]
            trace = 0.0
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                j = self.pairs.index[k]
                x_ij = self.search.separation(x, self.particles.position[j])
                s = self._pair(self._viscosity(i, j), volume * self.particles.volume[j], x_ij)
                self.pair_vector[k] = s
                trace += s.norm_sqr()
            wall_trace = 0.0
            if ti.static(self.no_slip):
                depth = self.liquids.depth(i)
                if ti.static(self.shared):
                    mu *= 1.0 - self.share[i]
                for slot in range(self.wall_pairs.count[i]):
                    k = self.wall_pairs.entry(i, slot)
                    b = self.wall_pairs.index[k]
                    beta = self.liquids.wall_factor(depth, b)
                    x_ib = self.search.separation(x, self.walls.position[b])
                    s = self._pair(beta * mu, volume * self.walls.volume[b], x_ib)
                    self.wall_vector[k] = s
                    wall_trace += s.norm_sqr()
            self.particles.wall_friction[i] = wall_trace / self.dimension
            self.particles.viscous_diagonal[i] = self.particles.mass[i] + dt * (trace + wall_trace) / self.dimension

    @ti.func
    def added(self, total, v: ti.template(), i, dt):
        v_i = v[i]
        for slot in range(self.pairs.count[i]):
            k = self.pairs.entry(i, slot)
            s = self.pair_vector[k]
            total += (dt * s.dot(v_i - v[self.pairs.index[k]])) * s
        if ti.static(self.no_slip):
            for slot in range(self.wall_pairs.count[i]):
                k = self.wall_pairs.entry(i, slot)
                s = self.wall_vector[k]
                total += (dt * s.dot(v_i)) * s
        return total


@ti.data_oriented
class LaplacianForm(ViscousForm):
    """Pair forces along the difference of velocities."""

    def __init__(self, solver, particles, liquids, no_slip: bool):
        super().__init__(solver, particles, liquids, no_slip)
        self.pair_coefficient = self.pairs.per_entry()  # force over v_ij, kg/s

    @ti.func
    def _pair(self, mu, volumes, x):
        return -2.0 * mu * volumes * self.kernel.gradient_factor(x.norm())

    @ti.kernel
    def assemble(self, dt: float):
        for i in range(self.count[None]):
            x, mu, volume = self.particles.position[i], self.particles.dynamic_viscosity[i], self.particles.volume[i]
            trace = 0.0
            friction = 0.0
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                j = self.pairs.index[k]
                x_ij = self.search.separation(x, self.particles.position[j])
                mean = harmonic_mean(mu, self.particles.dynamic_viscosity[j])
                c = self._pair(mean, volume * self.particles.volume[j], x_ij)
                self.pair_coefficient[k] = c
                trace += c
            if ti.static(self.no_slip):
                depth = self.liquids.depth(i)
                for slot in range(self.wall_pairs.count[i]):
                    k = self.wall_pairs.entry(i, slot)
                    b = self.wall_pairs.index[k]
                    beta = self.liquids.wall_factor(depth, b)
                    x_ib = self.search.separation(x, self.walls.position[b])
                    friction += self._pair(beta * mu, volume * self.walls.volume[b], x_ib)
            self.particles.wall_friction[i] = friction
            self.particles.viscous_diagonal[i] = self.particles.mass[i] + dt * (trace + friction)

    @ti.func
    def added(self, total, v: ti.template(), i, dt):
        v_i = v[i]
        total += (dt * self.particles.wall_friction[i]) * v_i
        for slot in range(self.pairs.count[i]):
            k = self.pairs.entry(i, slot)
            total += (dt * self.pair_coefficient[k]) * (v_i - v[self.pairs.index[k]])
        return total


@ti.data_oriented
class StrainForm(ViscousForm):
    """Stress of the corrected symmetric gradient, in two passes over the pairs, and a share of the central form.

    With G_ij = V_j grad_i W_ij over alike neighbors, w_i = sum of beta_ib V_b grad_i W_ib over the wall and L_i the
    inverse of the sum of -G_ij x_ij^T: D_i is the symmetric part of (sum of (v_j - v_i) G_ij^T - v_i w_i^T) L_i^T,
    T_i = 2 mu_i D_i L_i, and (K v)_i = -V_i (sum of (T_i + T_j) G_ij + T_i w_i).
    A particle with few alike neighbors, whose L_i is large, is left to the central form.
    """

    def __init__(self, solver, particles, liquids, no_slip: bool):
        super().__init__(solver, particles, liquids, no_slip)
        capacity, d = self.pairs.rows, self.dimension
        self.share = ti.field(real(), shape=capacity)
        self.correction = ti.Matrix.field(d, d, real(), shape=capacity)  # L_i
        self.stress = ti.Matrix.field(d, d, real(), shape=capacity)  # T_i, Pa
        self.wall_sum = ti.Vector.field(d, real(), shape=capacity)  # w_i, 1/m
        self.gradient_sum = ti.Vector.field(d, real(), shape=capacity)  # w_i + sum of G_ij, 1/m
        self.alike = self.pairs.per_entry(kind=ti.i8)
        self.central = CentralForm(solver, particles, liquids, no_slip, self.share)

    def assemble(self, dt: float) -> None:
        self._correct()
        self.central.assemble(dt)
        self._add_diagonal(dt)

    @ti.kernel
    def _correct(self):
        for i in range(self.count[None]):
            x, mu = self.particles.position[i], self.particles.dynamic_viscosity[i]
            moment = 0.0 * x.outer_product(x)
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                j = self.pairs.index[k]
                self.alike[k] = ti.cast(alike(mu, self.particles.dynamic_viscosity[j]), ti.i8)
                if self.alike[k] != 0:
                    x_ij = self.search.separation(x, self.particles.position[j])
                    moment -= self.pairs.gradient[k].outer_product(x_ij)
            wall_sum = x * 0.0
            if ti.static(self.no_slip):
                depth = self.liquids.depth(i)
                for slot in range(self.wall_pairs.count[i]):
                    k = self.wall_pairs.entry(i, slot)
                    b = self.wall_pairs.index[k]
                    x_ib = self.search.separation(x, self.walls.position[b])
                    moment -= self.wall_pairs.gradient[k].outer_product(x_ib)
                    wall_sum += self.liquids.wall_factor(depth, b) * self.wall_pairs.gradient[k]
            self.wall_sum[i] = wall_sum
            self.correction[i], self.share[i] = self._inverted(moment)

    @ti.func
    def _inverted(self, moment):
        """Inverse of the moment matrix, and the share of the strain form that it allows."""
        inverse = 0.0 * moment
        share = 0.0
        if moment.determinant() > FEW**3:
            inverse = moment.inverse()
            share = STRAIN_SHARE * ti.math.clamp((1.0 / inverse.norm() - FEW) / (ENOUGH - FEW), 0.0, 1.0)
        return inverse, share

    @ti.kernel
    def _add_diagonal(self, dt: float):
        """Trace of B^T diag(2 mu V) B at every particle, from its own strain and from that of its neighbors."""
        for i in range(self.count[None]):
            total = self.wall_sum[i]
            trace = 0.0
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                if self.alike[k] != 0:
                    j = self.pairs.index[k]
                    total += self.pairs.gradient[k]
                    trace += (self.share[j] * self.particles.dynamic_viscosity[j] / self.particles.volume[j]
                              * (self.correction[j] @ self.pairs.gradient[k]).norm_sqr())
            self.gradient_sum[i] = total
            volume = self.particles.volume[i]
            own = self.share[i] * self.particles.dynamic_viscosity[i] / volume
            trace += own * (self.correction[i] @ total).norm_sqr()
            factor = volume**2 * (1.0 + 1.0 / self.dimension)
            self.particles.viscous_diagonal[i] += dt * factor * trace
            self.particles.wall_friction[i] += factor * own * (self.correction[i] @ self.wall_sum[i]).norm_sqr()

    @ti.kernel
    def differentiate(self, v: ti.template()):
        for i in range(self.count[None]):
            v_i = v[i]
            gradient = -v_i.outer_product(self.wall_sum[i])
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                if self.alike[k] != 0:
                    gradient += (v[self.pairs.index[k]] - v_i).outer_product(self.pairs.gradient[k])
            correction = self.correction[i]
            gradient = gradient @ correction.transpose()
            twice = gradient + gradient.transpose()
            self.stress[i] = (self.share[i] * self.particles.dynamic_viscosity[i]) * (twice @ correction)

    @ti.func
    def added(self, total, v: ti.template(), i, dt):
        total = self.central.added(total, v, i, dt)
        force = self.stress[i] @ self.gradient_sum[i]
        for slot in range(self.pairs.count[i]):
            k = self.pairs.entry(i, slot)
            if self.alike[k] != 0:
                force += self.stress[self.pairs.index[k]] @ self.pairs.gradient[k]
        return total - dt * self.particles.volume[i] * force


FORMS = {"central": CentralForm, "laplacian": LaplacianForm, "strain": StrainForm}
