"""Viscous forces as matrices K, symmetric and positive semidefinite, for `viscosity_implicit`: F = -K v.

central    pair forces along the line of two particles [weiler2018], -(d+2) c_ij (v_ij.x_ij) x_ij/r^2 with the
           weights c of ``sim.effects.parts.viscous_weights``.
laplacian  pair forces along the difference of velocities [morris1997]: 2 mu_ij V_i V_j W'/r v_ij.
strain     those of what two particles do beyond turning with their surroundings: twice the passes over the pairs.

mu_ij is the harmonic mean 2 mu_i mu_j/(mu_i + mu_j), which keeps the shear stress continuous at a jump of viscosity.
All conserve momentum; central and strain, which rigid rotations do not strain, conserve spin as well.
Equations: docs/methods/viscosity.md.
"""
import abc

from sim.backend import data_oriented, real, ti
from sim.effects.parts.viscous_weights import ViscousWeights, harmonic_mean
from sim.smoothing_kernels import LatticeGradients

ALIKE = 0.5  # smallest ratio of viscosities of particles that turn together, in the strain form
THIN = 1e-6  # determinant of a moment of inertia over its trace cubed, below which particles lie in a line


@data_oriented
class ViscousForm(abc.ABC):
    """Base of the forms.

    Parameters
    ----------
    particles : view of the particle fields, `dynamic_viscosity`, `viscous_diagonal` and `wall_friction` among them.
    liquids : friction at the wall; no_slip : whether there is any.

    Attributes
    ----------
    compression : stress over mu times the rate at which liquid is compressed along one axis, with many pairs.
    """

    compression: float

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

    @abc.abstractmethod
    def lattice_diagonal(self) -> float:
        """K_ii/(mu V_i) in one liquid on a lattice, 1/m^2."""

    def differentiate(self, v) -> None:
        """Compute what `added` needs of the field v."""

    @ti.func
    def added(self, total, v: ti.template(), i, dt):
        """total + dt (K v) of particle i, N s."""
        return ti.static(None)

    @ti.func
    def against_expansion(self, k, x_ij):
        """K v of pair k, where v_ij = x_ij times a rate, over that rate, kg m/s."""
        return ti.static(None)


@data_oriented
class CentralForm(ViscousForm):
    """Central pair forces, which resist compression too."""

    compression = 3.0

    def __init__(self, solver, particles, liquids, no_slip: bool):
        super().__init__(solver, particles, liquids, no_slip)
        self.weights = ViscousWeights(solver, particles)
        self.pair_vector = self.pairs.per_entry(self.dimension)  # s_ij: the pair force is -s (s.v_ij), sqrt(kg/s)
        self.pair_scale = self.pairs.per_entry()  # c_ij/w_ij, kg/s
        self.wall_vector = self.wall_pairs.per_entry(self.dimension)

    def assemble(self, dt: float) -> None:
        self.weights.measure()
        self._join(dt)

    def lattice_diagonal(self) -> float:
        return 2.0 * (self.dimension + 2) * self.weights.lattice_sums()[0]

    @ti.kernel
    def _join(self, dt: float):
        for i in range(self.count[None]):
            x, mu = self.particles.position[i], self.particles.dynamic_viscosity[i]
            scaled_volume = self.weights.scaled_volume[i]
            trace = 0.0
            begin, end = self.pairs.entry(i, 0), self.pairs.entry(i, self.pairs.count[i])
            for k in range(begin, end):
                j = self.pairs.index[k]
                self.pair_vector[k] = self.search.separation(x, self.particles.position[j])
                self.pair_scale[k] = self.weights.scale(mu, scaled_volume, j)
            for k in range(begin, end):  # done in vectors: all that it reads and writes lies one behind the other
                x_ij = self.pair_vector[k]
                r2 = x_ij.norm_sqr()
                s = ti.sqrt(self.weights.central(self.pair_scale[k] * self.weights.weight(r2), r2)) * x_ij
                self.pair_vector[k] = s
                trace += s.norm_sqr()
            wall_trace = 0.0
            if ti.static(self.no_slip):
                depth, grip = self.liquids.depth(i), self.liquids.grip(i)
                for slot in range(self.wall_pairs.count[i]):
                    k = self.wall_pairs.entry(i, slot)
                    b = self.wall_pairs.index[k]
                    x_ib = self.search.separation(x, self.walls.position[b])
                    r2 = x_ib.norm_sqr()
                    beta = grip * self.liquids.wall_factor(depth, b)
                    s = ti.sqrt(beta * self.weights.central(self.weights.of_wall(i, b, r2), r2)) * x_ib
                    self.wall_vector[k] = s
                    wall_trace += s.norm_sqr()
            self.particles.wall_friction[i] = wall_trace / self.dimension  # (V11)
            self.particles.viscous_diagonal[i] = self.particles.mass[i] + dt * (trace + wall_trace) / self.dimension

    @ti.func
    def added(self, total, v: ti.template(), i, dt):
        v_i = v[i]
        for slot in range(self.pairs.count[i]):
            k = self.pairs.entry(i, slot)
            s = self.pair_vector[k]
            total += (dt * s.dot(v_i - v[self.pairs.index[k]])) * s  # (V7)
        if ti.static(self.no_slip):
            for slot in range(self.wall_pairs.count[i]):
                k = self.wall_pairs.entry(i, slot)
                s = self.wall_vector[k]
                total += (dt * s.dot(v_i)) * s
        return total

    @ti.func
    def against_expansion(self, k, x_ij):
        s = self.pair_vector[k]
        return s.dot(x_ij) * s


@data_oriented
class LaplacianForm(ViscousForm):
    """Pair forces along the difference of velocities."""

    compression = 1.0

    def __init__(self, solver, particles, liquids, no_slip: bool):
        super().__init__(solver, particles, liquids, no_slip)
        self.pair_coefficient = self.pairs.per_entry()  # force over v_ij, kg/s
        self.lattice = LatticeGradients(self.kernel, solver.spacing, self.dimension)

    def lattice_diagonal(self) -> float:
        return 2.0 * self.lattice.stiffness()

    @ti.func
    def _pair(self, mu, volumes, x):
        return -2.0 * mu * volumes * self.kernel.gradient_factor(x.norm())  # (V8)

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
                depth, grip = self.liquids.depth(i), self.liquids.grip(i)
                for slot in range(self.wall_pairs.count[i]):
                    k = self.wall_pairs.entry(i, slot)
                    b = self.wall_pairs.index[k]
                    beta = grip * self.liquids.wall_factor(depth, b)
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

    @ti.func
    def against_expansion(self, k, x_ij):
        return self.pair_coefficient[k] * x_ij


@data_oriented
class StrainForm(ViscousForm):
    """Pair forces along what two alike particles do beyond turning with their surroundings; unlike ones: central.

    With c_ij of ``sim.effects.parts.viscous_weights`` and g_ij = c_ij x_ij, F_ij = -(2 c_ij v_ij - (s_i + s_j) x
    g_ij). The spin s_i is the rate of rotation that fits the neighbors best: it makes the sum of c_ij |v_ij - s_i x
    x_ij|^2 least, I_i s_i = sum of g_ij x v_ij. So K is what turning leaves of twice the dissipation of the
    differences of velocities, a Schur complement. It needs second moments of the particles around, no more, and these
    are alike in all directions on lattices too. A wall particle counts twice, as if it turned along, with the
    velocity (1 - beta_ib) v_i.
    """

    compression = 2.0

    def __init__(self, solver, particles, liquids, no_slip: bool):
        super().__init__(solver, particles, liquids, no_slip)
        capacity, d = self.pairs.rows, self.dimension
        self.weights = ViscousWeights(solver, particles)
        spins = 1 if d == 2 else 3  # components of a rate of rotation
        self.inverse = ti.Matrix.field(spins, spins, real(), shape=capacity)  # of I_i, 1/(kg m^2/s)
        self.spin = ti.Vector.field(spins, real(), shape=capacity, layout=ti.Layout.SOA)  # s_i, 1/s
        self.straight = ti.Vector.field(d, real(), shape=capacity, layout=ti.Layout.SOA)  # force without spins, N
        self.arm = ti.Vector.field(d, real(), shape=capacity)  # sum of g_ij, of liquid and wall, kg m/s
        self.wall_arm = ti.Vector.field(d, real(), shape=capacity)  # that of the wall
        self.friction = ti.field(real(), shape=capacity)  # of the wall on what does not turn, kg/s
        self.pair_coefficient = self.pairs.per_entry()  # c_ij, kg/s; 0 between unlike particles
        self.pair_vector = self.pairs.per_entry(d)  # g_ij; between unlike particles that of the central form

    @ti.func
    def _alike(self, i, j):
        mu_i, mu_j = self.particles.dynamic_viscosity[i], self.particles.dynamic_viscosity[j]
        return ti.min(mu_i, mu_j) >= ALIKE * ti.max(mu_i, mu_j)

    @ti.func
    def _cross(self, a, b):
        """a x b, as a rate of rotation."""
        if ti.static(self.dimension == 2):
            return ti.Vector([a[0] * b[1] - a[1] * b[0]])
        else:
            return a.cross(b)

    @ti.func
    def _turned(self, s, a):
        """s x a."""
        if ti.static(self.dimension == 2):
            return ti.Vector([-s[0] * a[1], s[0] * a[0]])
        else:
            return s.cross(a)

    @ti.func
    def _inertia(self, x):
        """|x|^2 - x x^T, or |x|^2 in the plane."""
        if ti.static(self.dimension == 2):
            return ti.Matrix([[x.norm_sqr()]])
        else:
            return x.norm_sqr() * ti.Matrix.identity(real(), 3) - x.outer_product(x)

    @ti.func
    def _inverted(self, inertia):
        """Inverse of a moment of inertia; that of particles in a line has none about it, and needs none."""
        inverse = 0.0 * inertia
        trace = inertia.trace()
        if trace > 0.0:
            if ti.static(self.dimension == 2):
                inverse[0, 0] = 1.0 / trace
            else:
                scaled = inertia / trace
                if scaled.determinant() < THIN:
                    scaled += THIN * ti.Matrix.identity(real(), 3)
                inverse = scaled.inverse() / trace
        return inverse

    @ti.func
    def _lost(self, inverse, arm):
        """Mean over all directions of the friction that turning along takes away, kg/s."""
        return (inverse @ self._inertia(arm)).trace() / self.dimension

    def assemble(self, dt: float) -> None:
        self.weights.measure()
        self._join()
        self._set_diagonal(dt)

    def lattice_diagonal(self) -> float:
        d = self.dimension
        straight, turned = self.weights.lattice_sums()
        return 4.0 * d * straight - d * (d - 1.0) * turned

    @ti.kernel
    def _join(self):
        for i in range(self.count[None]):
            x = self.particles.position[i]
            arm = x * 0.0
            inertia = self._inertia(arm)
            trace = 0.0
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                j = self.pairs.index[k]
                x_ij = self.search.separation(x, self.particles.position[j])
                r2 = x_ij.norm_sqr()
                c = self.weights.of_pair(i, j, r2)
                g = c * x_ij
                if self._alike(i, j):
                    inertia += c * self._inertia(x_ij)
                    arm += g
                    trace += 2.0 * self.dimension * c
                else:
                    g = ti.sqrt(self.weights.central(c, r2)) * x_ij
                    c = 0.0
                    trace += g.norm_sqr()
                self.pair_coefficient[k] = c
                self.pair_vector[k] = g
            friction = 0.0
            wall_arm = x * 0.0
            if ti.static(self.no_slip):
                depth, grip = self.liquids.depth(i), self.liquids.grip(i)
                for slot in range(self.wall_pairs.count[i]):
                    b = self.wall_pairs.index[self.wall_pairs.entry(i, slot)]
                    x_ib = self.search.separation(x, self.walls.position[b])
                    beta = self.liquids.wall_factor(depth, b)
                    c = 2.0 * grip * self.weights.of_wall(i, b, x_ib.norm_sqr())
                    friction += beta * c
                    wall_arm += c * x_ib
                    inertia += c / beta * self._inertia(x_ib)
            self.friction[i] = friction
            self.inverse[i] = self._inverted(inertia)
            self.wall_arm[i] = wall_arm
            self.arm[i] = arm + wall_arm
            self.particles.viscous_diagonal[i] = trace / self.dimension + friction
            self.particles.wall_friction[i] = friction - self._lost(self.inverse[i], wall_arm)

    @ti.kernel
    def _set_diagonal(self, dt: float):
        """Of M + dt K, from the spin of every particle and from those of its neighbors."""
        for i in range(self.count[None]):
            lost = self._lost(self.inverse[i], self.arm[i])
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                if self.pair_coefficient[k] > 0.0:
                    lost += self._lost(self.inverse[self.pairs.index[k]], self.pair_vector[k])
            self.particles.viscous_diagonal[i] = self.particles.mass[i] + dt * (
                self.particles.viscous_diagonal[i] - lost)

    @ti.kernel
    def differentiate(self, v: ti.template()):
        for i in range(self.count[None]):
            v_i = v[i]
            straight = self.friction[i] * v_i
            moment = self._cross(self.wall_arm[i], v_i)
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                v_ij = v_i - v[self.pairs.index[k]]
                c, g = self.pair_coefficient[k], self.pair_vector[k]
                if c > 0.0:
                    straight += (2.0 * c) * v_ij
                    moment += self._cross(g, v_ij)
                else:
                    straight += g.dot(v_ij) * g
            self.straight[i] = straight
            self.spin[i] = self.inverse[i] @ moment

    @ti.func
    def added(self, total, v: ti.template(), i, dt):
        turning = self._turned(self.spin[i], self.arm[i])
        for slot in range(self.pairs.count[i]):
            k = self.pairs.entry(i, slot)
            if self.pair_coefficient[k] > 0.0:
                turning += self._turned(self.spin[self.pairs.index[k]], self.pair_vector[k])
        return total + dt * (self.straight[i] - turning)  # (V9)

    @ti.func
    def against_expansion(self, k, x_ij):
        g = self.pair_vector[k]
        force = g.dot(x_ij) * g
        if self.pair_coefficient[k] > 0.0:
            force = 2.0 * g
        return force


FORMS = {"central": CentralForm, "laplacian": LaplacianForm, "strain": StrainForm}
