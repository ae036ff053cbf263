"""Implicit viscosity: backward Euler with central pair forces (Weiler et al. 2018, volume form, with pairs across
liquids).

F_i = sum_j 2(d+2) mu_ij V_i V_j (v_ij.x_ij)/r^2 G_ij with the harmonic mean mu_ij = 2 mu_i mu_j/(mu_i + mu_j), which
keeps the shear stress continuous at a jump of 1:7000. The forces are central: they conserve momentum and spin.
(M - dt L) v = M v* is symmetric and positive definite; conjugate gradients with the diagonal as preconditioner.
"""
import dataclasses

import taichi as ti

from sim.effects.effect import Effect
from sim.effects.liquid_viscosity import LiquidViscosity
from sim.fields import Field
from sim.parameters import parameter
from sim.runtime import real


@dataclasses.dataclass(frozen=True)
class ViscosityImplicitParameters:
    """Shear stress within and between liquids by a backward Euler step: no limit on the time step."""

    wall: str = parameter("no_slip", choices=("no_slip", "free_slip"), meaning="friction at the wall")


@ti.data_oriented
class ViscosityImplicit(Effect):
    """Backward Euler step of the viscous forces."""

    name = "viscosity_implicit"
    Parameters = ViscosityImplicitParameters
    fields = (
        Field("dynamic_viscosity", "scalar", "Pa s", "viscosity of the particle's liquid or mixture"),
        Field("viscous_residual", "vector", "N s", "residual of the viscous solve"),
        Field("viscous_direction", "vector", "m/s", "search direction of the viscous solve"),
        Field("viscous_image", "vector", "N s", "matrix times search direction"),
        Field("viscous_diagonal", "scalar", "kg", "diagonal of the viscous matrix"),
    )
    uses = ("position", "velocity", "volume", "mass", "phase")

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        self.count = solver.count
        self.no_slip = parameters.wall == "no_slip"
        self.factor = 2.0 * (solver.dimension + 2.0)
        self.pairs, self.wall_pairs, self.walls = solver.pairs, solver.wall_pairs, solver.walls
        self.kernel, self.search = solver.kernel, solver.search
        # sqrt(2(d+2) mu_ij V_i V_j |W'|/r) e_ij: the pair force is -s (s.v_ij).
        self.pair_vector = ti.Vector.field(solver.dimension, real(), shape=self.pairs.rows * self.pairs.width,
                                           layout=ti.Layout.SOA)
        self.wall_vector = ti.Vector.field(solver.dimension, real(),
                                           shape=self.wall_pairs.rows * self.wall_pairs.width, layout=ti.Layout.SOA)
        self.product, self.product_2 = (ti.field(ti.f64, shape=solver.particles.capacity) for _ in range(2))
        self.rho, self.norm, self.scale = (ti.field(ti.f64, shape=()) for _ in range(3))
        self.alpha, self.beta = (ti.field(real(), shape=()) for _ in range(2))
        self.liquids = LiquidViscosity(solver)

    @ti.func
    def _pair(self, mu, volumes, x):
        r = ti.max(x.norm(), 1e-6 * self.kernel.support_radius)
        return ti.sqrt(-self.factor * mu * volumes * self.kernel.gradient_factor(r)) / r * x

    @ti.kernel
    def _assemble(self, dt: float):
        for i in range(self.count[None]):
            self.particles.dynamic_viscosity[i] = self.liquids.viscosity(i)
        for i in range(self.count[None]):
            x, mu, volume = self.particles.position[i], self.particles.dynamic_viscosity[i], self.particles.volume[i]
            trace = 0.0
            for k in range(i * self.pairs.width, i * self.pairs.width + self.pairs.count[i]):
                j = self.pairs.index[k]
                mu_j = self.particles.dynamic_viscosity[j]
                mean = 2.0 * mu * mu_j / ti.max(mu + mu_j, 1e-20)
                x_ij = self.search.separation(x, self.particles.position[j])
                s = self._pair(mean, volume * self.particles.volume[j], x_ij)
                self.pair_vector[k] = s
                trace += s.norm_sqr()
            if ti.static(self.no_slip):
                depth = self.liquids.depth(i)
                for k in range(i * self.wall_pairs.width, i * self.wall_pairs.width + self.wall_pairs.count[i]):
                    b = self.wall_pairs.index[k]
                    beta = self.liquids.wall_factor(depth, b)
                    x_ib = self.search.separation(x, self.walls.position[b])
                    s = self._pair(beta * mu, volume * self.walls.volume[b], x_ib)
                    self.wall_vector[k] = s
                    trace += s.norm_sqr()
            self.particles.viscous_diagonal[i] = self.particles.mass[i] + dt * trace / self.solver.dimension

    @ti.func
    def _applied(self, v: ti.template(), i, dt):
        """(M - dt L) v of particle i."""
        total = self.particles.mass[i] * v[i]
        for k in range(i * self.pairs.width, i * self.pairs.width + self.pairs.count[i]):
            s = self.pair_vector[k]
            total += (dt * s.dot(v[i] - v[self.pairs.index[k]])) * s
        if ti.static(self.no_slip):
            for k in range(i * self.wall_pairs.width, i * self.wall_pairs.width + self.wall_pairs.count[i]):
                s = self.wall_vector[k]
                total += (dt * s.dot(v[i])) * s
        return total

    @ti.kernel
    def _start(self, dt: float):
        for i in range(self.count[None]):
            momentum = self.particles.mass[i] * self.particles.velocity[i]
            self.particles.viscous_residual[i] = momentum - self._applied(self.particles.velocity, i, dt)
            self.product[i] = ti.cast(momentum.norm_sqr(), ti.f64) / self.particles.mass[i]
            self.particles.viscous_direction[i] = self.particles.velocity[i] * 0.0
        ti.loop_config(serialize=True)
        for _ in range(1):
            total = ti.cast(0.0, ti.f64)
            for i in range(self.count[None]):
                total += self.product[i]
            self.scale[None] = total
            self.rho[None] = 0.0

    @ti.kernel
    def _direct(self):
        """direction = residual / diagonal + beta direction; norm = |residual|^2 over mass."""
        for i in range(self.count[None]):
            r = ti.cast(self.particles.viscous_residual[i].norm_sqr(), ti.f64)
            self.product[i] = r / self.particles.viscous_diagonal[i]
            self.product_2[i] = r / self.particles.mass[i]
        ti.loop_config(serialize=True)
        for _ in range(1):
            rho = ti.cast(0.0, ti.f64)
            norm = ti.cast(0.0, ti.f64)
            for i in range(self.count[None]):
                rho += self.product[i]
                norm += self.product_2[i]
            self.beta[None] = ti.select(self.rho[None] > 0.0, rho / self.rho[None], 0.0)
            self.rho[None] = rho
            self.norm[None] = norm
        for i in range(self.count[None]):
            self.particles.viscous_direction[i] = (
                self.particles.viscous_residual[i] / self.particles.viscous_diagonal[i]
                + self.beta[None] * self.particles.viscous_direction[i])

    @ti.kernel
    def _advance(self, dt: float):
        for i in range(self.count[None]):
            image = self._applied(self.particles.viscous_direction, i, dt)
            self.particles.viscous_image[i] = image
            self.product[i] = ti.cast(image.dot(self.particles.viscous_direction[i]), ti.f64)
        ti.loop_config(serialize=True)
        for _ in range(1):
            total = ti.cast(0.0, ti.f64)
            for i in range(self.count[None]):
                total += self.product[i]
            self.alpha[None] = ti.select(total > 0.0, self.rho[None] / total, 0.0)
        for i in range(self.count[None]):
            alpha = self.alpha[None]
            self.particles.velocity[i] += alpha * self.particles.viscous_direction[i]
            self.particles.viscous_residual[i] -= alpha * self.particles.viscous_image[i]

    def correct_velocity(self, dt: float) -> dict[str, float]:
        numerics = self.solver.settings.numerics
        self._assemble(dt)
        self._start(dt)
        self._direct()
        iterations = 0
        while (self.norm[None] > numerics.viscosity_tolerance**2 * self.scale[None]
               and iterations < numerics.maximum_iterations):
            self._advance(dt)
            self._direct()
            iterations += 1
        return {"viscosity_iterations": iterations,
                "viscosity_limit_hit": float(iterations >= numerics.maximum_iterations)}
