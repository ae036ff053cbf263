"""Weights of the pairs of implicit viscosity: more even than the gradient of a kernel, they need fewer iterations.

c_ij = 2 mu_ij V_i V_j w_ij/sqrt(M_i M_j), w = (1 - r^2/R^2)^(3/2), with M_i the second moment of w over the particles
around, sum of V_j w_ij r^2/d, as measured. Then c_ij v_ij and (d+2) c_ij (v_ij.x_ij) x_ij/r^2 are forces of the
viscosity mu. Those of the second kind need fourth moments too, which are not alike in all directions on a lattice, as
particles are at the start: with R = h shear along its axes would feel 0.95 mu in three dimensions at h 2.5 dx. R is
where it feels mu (`isotropic_reach`). With w = |W'|/r, which is steeper, conjugate gradients take 1.4 times the
iterations. Equations: docs/methods/viscosity.md.
"""
import itertools
import math

import numpy as np

from sim.backend import data_oriented, real, ti

EVEN = {2: 2.0 * math.pi / 35.0, 3: math.pi**2 / 64.0}  # integral of w r^2/d over R^(d+2)
LEAST_MOMENT = 0.7  # of it, at a free surface, where half is missing
LEAST_REACH = 0.9  # of the weights, in support radii: with a shorter one disorder costs more than the lattice does


def _lattice(dimension: int, reach: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Places (n, d) around one of a lattice, their squares (n,) and their weights (n,); reach in spacings."""
    ticks = range(-math.ceil(reach), math.ceil(reach) + 1)
    place = np.array([one for one in itertools.product(ticks, repeat=dimension) if any(one)], float)
    square = (place**2).sum(axis=1)
    return place, square, np.maximum(1.0 - square / reach**2, 0.0) ** 1.5


def lattice_excess(dimension: int, reach: float) -> float:
    """Viscosity that shear along the axes of a cubic lattice feels over that asked for, less 1; reach in spacings."""
    place, square, weight = _lattice(dimension, reach)
    shear = weight @ (place[:, 0] ** 2 * place[:, 1] ** 2 / square)
    return float(dimension * (dimension + 2) * shear / (weight @ square) - 1.0)


def isotropic_reach(dimension: int, support_ratio: float) -> float:
    """Reach R of the weights over the support radius, at which a cubic lattice is most alike in all directions."""
    reaches = np.linspace(LEAST_REACH, 1.0, 101)
    return float(min(reversed(reaches), key=lambda one: abs(lattice_excess(dimension, one * support_ratio))))


@ti.func
def harmonic_mean(mu_i, mu_j):
    """Harmonic mean of two viscosities, Pa s."""
    return 2.0 * mu_i * mu_j / ti.max(mu_i + mu_j, 1e-20)  # (V3)


@data_oriented
class ViscousWeights:
    """Coefficients c of pairs; particles : view with `volume` and `dynamic_viscosity`."""

    def __init__(self, solver, particles):
        self.count, self.dimension, self.particles = solver.count, solver.dimension, particles
        self.pairs, self.wall_pairs, self.walls = solver.pairs, solver.wall_pairs, solver.walls
        self.position, self.search = solver.position, solver.search
        support = solver.kernel.support_radius
        self.spacing = solver.spacing
        self.reach = isotropic_reach(self.dimension, support / solver.spacing) * support  # R, m
        self.scaled_volume = ti.field(real(), shape=solver.particles.capacity)  # V_i/sqrt(M_i), m^(d/2 - 1)
        self.least_moment = LEAST_MOMENT * EVEN[self.dimension] * self.reach ** (self.dimension + 2)

    def lattice_sums(self) -> tuple[float, float]:
        """Sum of w over that of w r^2, and sum of w^2 r^2 over the square of that of w r^2, on a lattice, 1/m^2."""
        _, square, weight = _lattice(self.dimension, self.reach / self.spacing)
        moment = weight @ square
        return (float(weight.sum() / moment) / self.spacing**2,
                float((weight**2) @ square / moment**2) / self.spacing**2)

    @ti.func
    def weight(self, r2):
        """w at the distance r."""
        rest = ti.max(1.0 - r2 / self.reach**2, 0.0)
        return rest * ti.sqrt(rest)

    @ti.kernel
    def measure(self):
        """Measure the moments at the present positions."""
        for i in range(self.count[None]):
            x = self.position[i]
            moment = 0.0
            for slot in range(self.pairs.count[i]):
                j = self.pairs.index[self.pairs.entry(i, slot)]
                r2 = self.search.separation(x, self.position[j]).norm_sqr()
                moment += self.particles.volume[j] * self.weight(r2) * r2
            for slot in range(self.wall_pairs.count[i]):
                b = self.wall_pairs.index[self.wall_pairs.entry(i, slot)]
                r2 = self.search.separation(x, self.walls.position[b]).norm_sqr()
                moment += self.walls.volume[b] * self.weight(r2) * r2
            moment = ti.max(moment / self.dimension, self.least_moment)
            self.scaled_volume[i] = self.particles.volume[i] / ti.sqrt(moment)

    @ti.func
    def scale(self, mu, scaled_volume, j):
        """c_ij/w_ij of a particle i with such a viscosity and scaled volume, kg/s."""
        return 2.0 * harmonic_mean(mu, self.particles.dynamic_viscosity[j]) * scaled_volume * self.scaled_volume[j]

    @ti.func
    def of_pair(self, i, j, r2):
        """c_ij, kg/s."""
        return self.scale(self.particles.dynamic_viscosity[i], self.scaled_volume[i], j) * self.weight(r2)  # (V6)

    @ti.func
    def of_wall(self, i, b, r2):
        """That of a wall particle with the viscosity and the moment of particle i, kg/s."""
        ratio = self.scaled_volume[i] ** 2 / self.particles.volume[i]
        return 2.0 * self.particles.dynamic_viscosity[i] * ratio * self.walls.volume[b] * self.weight(r2)

    @ti.func
    def central(self, c, r2):
        """(d+2) c/r^2: the central pair force is that times (v_ij.x_ij) x_ij, kg/(m^2 s)."""
        return (self.dimension + 2.0) * c / ti.max(r2, 1e-12 * self.reach**2)
