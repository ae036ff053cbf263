
from sim.backend import data_oriented, ti

"""The accelerations that effects give a particle, of all of them in one loop over its neighbors."""


HOOKS = ("body_acceleration", "pair_acceleration", "wall_acceleration")


@data_oriented
class Accelerations:
    """Sum of the accelerations by some of the effects of a solver."""

    def __init__(self, solver, effects):
        self.solver = solver
        self.body, self.pair, self.wall = (
            [effect for effect in getattr(solver, f"{hook}_effects") if effect in effects] for hook in HOOKS)

    @ti.func
    def of(self, i):
        """Acceleration of particle i, m/s^2."""
        a = self.solver.velocity[i] * 0.0
        for effect in ti.static(self.body):
            a += effect.body_acceleration(i)
        if ti.static(len(self.pair) > 0):
            for slot in range(self.solver.pairs.count[i]):
                k = self.solver.pairs.entry(i, slot)
                j = self.solver.pairs.index[k]
                x_ij = self.solver.search.separation(self.solver.position[i], self.solver.position[j])
                for effect in ti.static(self.pair):
                    a += effect.pair_acceleration(i, j, x_ij, self.solver.pairs.gradient[k],
                                                  self.solver.pairs.weight[k])
        if ti.static(len(self.wall) > 0):
            for slot in range(self.solver.wall_pairs.count[i]):
                k = self.solver.wall_pairs.entry(i, slot)
                b = self.solver.wall_pairs.index[k]
                x_ib = self.solver.search.separation(self.solver.position[i], self.solver.walls.position[b])
                for effect in ti.static(self.wall):
                    a += effect.wall_acceleration(i, b, x_ib, self.solver.wall_pairs.gradient[k],
                                                  self.solver.wall_pairs.weight[k])
        return a
