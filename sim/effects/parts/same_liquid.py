
from sim.backend import data_oriented, ti

"""How alike the liquids of two particles are: what holds an interface together pulls on unlike pairs only."""



@data_oriented
class Likeness:
    """s_ij = sum over k of alpha_k,i alpha_k,j: 1 for the same pure liquid, 0 for two pure ones.

    What pulls an interface together is the excess of like over unlike pairs, s_ii + s_jj - 2 s_ij, which is
    |alpha_i - alpha_j|^2: it fades with the square of the contrast as the liquids mix.
    """

    def __init__(self, solver):
        self.phase = solver.particles.arrays["phase"]
        self.mixes = "volume_fraction" in solver.particles.arrays
        self.fractions = solver.particles.arrays.get("volume_fraction")
        self.number = len(solver.liquids)

    @ti.func
    def of(self, i, j):
        """s_ij."""
        likeness = ti.select(self.phase[i] == self.phase[j], 1.0, 0.0)
        if ti.static(self.mixes):
            likeness = self.fractions[i].dot(self.fractions[j])
        return likeness

    @ti.func
    def weighted(self, i, j, strength: ti.template()):
        """sum over k of strength_k alpha_k,i alpha_k,j, of a strength per liquid."""
        total = ti.select(self.phase[i] == self.phase[j], strength[self.phase[i]], 0.0)
        if ti.static(self.mixes):
            total = 0.0
            for k in ti.static(range(self.number)):
                total += strength[k] * self.fractions[i][k] * self.fractions[j][k]
        return total

    @ti.func
    def share(self, i, liquid: ti.template()):
        """Share of a liquid in particle i."""
        held = ti.select(self.phase[i] == liquid, 1.0, 0.0)
        if ti.static(self.mixes):
            held = self.fractions[i][liquid]
        return held
