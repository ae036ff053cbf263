"""Viscosity of the liquid or mixture at a particle, and its friction at a wall: shared by both viscosities."""
import taichi as ti

from sim.runtime import real

WALL_FACTOR_LIMIT = 3.0  # largest extrapolation of the liquid's velocity to a wall particle (no slip)


def without_viscosity(settings) -> str:
    """Why no viscous force acts in a scene; empty where some does."""
    return "" if any(liquid.dynamic_viscosity for liquid in settings.liquids) else (
        "the dynamic viscosity of every liquid is 0 Pa s")


@ti.data_oriented
class LiquidViscosity:
    """Dynamic viscosities of the particles of a solver."""

    def __init__(self, solver):
        self.phase, self.position = solver.particles.arrays["phase"], solver.position
        self.distance, self.walls, self.spacing = solver.distance, solver.walls, solver.spacing
        self.mixes = "volume_fraction" in solver.particles.arrays
        self.fractions = solver.particles.arrays.get("volume_fraction")
        self.number = len(solver.liquids)
        self.of_liquid = ti.field(real(), shape=self.number)
        for k, liquid in enumerate(solver.liquids):
            self.of_liquid[k] = liquid.dynamic_viscosity

    @ti.func
    def viscosity(self, i):
        """Viscosity of the liquid, or of the mixture: product of mu_k^alpha_k, Pa s."""
        mu = self.of_liquid[self.phase[i]]
        if ti.static(self.mixes):
            mu = 1.0
            for k in ti.static(range(self.number)):
                mu *= ti.pow(self.of_liquid[k], self.fractions[i][k])
        return mu

    @ti.func
    def depth(self, i):
        """Distance of particle i to the wall, at least 0.1 dx, m."""
        return ti.max(-self.distance.value(self.position[i]), 0.1 * self.spacing)

    @ti.func
    def wall_factor(self, depth, b):
        """Velocity of a particle at a depth less that of wall particle b, over the particle's own, for no slip.

        The velocity is taken to be linear and zero at the wall's surface (Morris et al. 1997).
        """
        return ti.min(WALL_FACTOR_LIMIT, 1.0 + self.walls.depth[b] / depth)
