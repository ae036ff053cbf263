"""The pressure matrix A = E^T D M^-1 D^T E of liquids between walls, matrix-free.

(D v)_i = V_i sum_j V_j (v_i - v_j).G_ij is the volume rate of particle i, wall rows included, and E = [1; P]
extrapolates the pressure of the liquid to wall particles, P_bf = V_f W_bf / sum_f V_f W_bf. The transpose of E folds
the volume rate of the wall rows back onto the liquid, so that A is symmetric, momentum is exact between liquid and
wall, and a tangential slip feels no wall pressure (p_b = 0 and mirrored pressures leave 24-44 % hydrostatic error on
curved walls). Equations: docs/methods/pressure.md.
"""

from sim.backend import data_oriented, real, ti
from sim.fields import ParticleStore
from sim.neighbor_search import NeighborSearch


@data_oriented
class PressureOperators:
    """A, its diagonal and its factors; one instance serves velocity and position corrections.

    Fields of liquid particles: `kernel_gradient_sum` S_i = sum of V_j G_ij over all neighbors, `volume`, `mass`.
    The weight of the force is the `mobility` for velocities (weighted=True) and 1 for positions (weighted=False).

    Attributes
    ----------
    resisting : effects with a `friction` k of the wall, implicit in the velocity that the pressure changes: it resists
        what the pressure does, and the mobility is V/(m + dt k) instead of V/m. Without it a wall holds viscous liquid
        in the one solve and lets it slip in the other, and oil moves along the wall too fast.
    shared_by_density : pressures that change velocities count in a pair by the density of the other particle, and in
        means by the inverse of their own, so that gas beside water feels the pressure of gas (P13). As a plain mean it
        would feel that of the water, 1000 times as strong as its mass bears.
    """

    def __init__(self, particles: ParticleStore, search: NeighborSearch, gradient_sum, shared_by_density: bool):
        self.resisting: list = []
        self.shared_by_density = shared_by_density
        self.particles = particles
        self.count = particles.count
        self.volume = particles.arrays["volume"]
        self.mass = particles.arrays["mass"]
        self.gradient_sum = gradient_sum
        self.search, self.walls = search, search.walls
        self.pairs, self.wall_pairs, self.wall_rows = search.pairs, search.wall_pairs, search.wall_rows
        n, walls, dimension = particles.capacity, max(search.walls.count, 1), particles.dimension
        self.applied, self.mobility = (ti.field(real(), shape=n) for _ in range(2))
        self.diagonal = tuple(ti.field(real(), shape=n) for _ in range(2))  # without and with weight
        self.force = ti.Vector.field(dimension, real(), shape=n, layout=ti.Layout.SOA)  # per volume or per mass
        self.wall_weight, self.wall_value = (ti.field(real(), shape=walls) for _ in range(2))
        if shared_by_density:
            self.shared_gradient_sum = ti.Vector.field(dimension, real(), shape=n, layout=ti.Layout.SOA)
            self.shared_wall_weight = ti.field(real(), shape=walls)

    def update(self) -> None:
        """Compute what depends on positions only; `gradient_sum` must be that of the present rows."""
        self._update_wall_weights()
        if self.shared_by_density:
            self._share_by_density()

    @ti.kernel
    def _update_wall_weights(self):
        """sum_f V_f W_bf of every wall particle; 0 where no liquid is near."""
        for b in range(self.walls.count):
            total = 0.0
            for slot in range(self.wall_rows.count[b]):
                k = self.wall_rows.entry(b, slot)
                total += self.wall_rows.weight[k]
            self.wall_weight[b] = total

    @ti.kernel
    def _share_by_density(self):
        """The same weights, and the gradient sums, of pressures that are shared by density."""
        for b in range(self.walls.count):
            total = 0.0
            for slot in range(self.wall_rows.count[b]):
                k = self.wall_rows.entry(b, slot)
                total += self.wall_rows.weight[k] * self.lightness(self.wall_rows.index[k], True)
            self.shared_wall_weight[b] = total
        for i in range(self.count[None]):
            total = self.gradient_sum[i]
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                total += (self.share(i, self.pairs.index[k], True) - 1.0) * self.pairs.gradient[k]
            self.shared_gradient_sum[i] = total

    @ti.func
    def lightness(self, i, weighted: ti.template()):
        """1/rho of particle i, its weight in means of pressures that are shared by density; else 1 (P13)."""
        value = 1.0
        if ti.static(weighted and self.shared_by_density):
            value = self.volume[i] / self.mass[i]
        return value

    @ti.func
    def share(self, i, j, weighted: ti.template()):
        """Share of the pressure of particle i in its pair with j; those of both add up to 2 (P13)."""
        share = 1.0
        if ti.static(weighted and self.shared_by_density):
            own, other = self.mass[i] * self.volume[j], self.mass[j] * self.volume[i]
            share = 2.0 * other / (own + other)
        return share

    @ti.func
    def likeness(self, i, j):
        """1 for two particles of one density, 4 rho_i rho_j / (rho_i + rho_j)^2 for others (P13)."""
        return self.share(i, j, True) * self.share(j, i, True)

    @ti.func
    def _gradient_sum(self, i, weighted: ti.template()):
        total = self.gradient_sum[i]
        if ti.static(weighted and self.shared_by_density):
            total = self.shared_gradient_sum[i]
        return total

    @ti.func
    def over_wall_weight(self, b, value, weighted: ti.template()):
        weight = self.wall_weight[b]
        if ti.static(weighted and self.shared_by_density):
            weight = self.shared_wall_weight[b]
        return ti.select(weight > 0.0, value / ti.max(weight, 1e-20), 0.0)

    @ti.func
    def extrapolated(self, p: ti.template(), b, weighted: ti.template()):
        """Pressure of wall particle b: mean of the liquid neighbors (P2)."""
        total = 0.0
        for slot in range(self.wall_rows.count[b]):
            k = self.wall_rows.entry(b, slot)
            j = self.wall_rows.index[k]
            total += self.wall_rows.weight[k] * self.lightness(j, weighted) * p[j]
        return self.over_wall_weight(b, total, weighted)

    @ti.func
    def liquid_force(self, p: ti.template(), i, weighted: ti.template()):
        """Part of -(D^T E p)_i / V_i that the pressure of the liquid makes (P3)."""
        total = p[i] * self._gradient_sum(i, weighted)
        for slot in range(self.pairs.count[i]):
            k = self.pairs.entry(i, slot)
            j = self.pairs.index[k]
            total += self.share(j, i, weighted) * p[j] * self.pairs.gradient[k]
        return -total

    @ti.func
    def wall_force(self, i):
        """The other part, from the wall pressures in `wall_value`."""
        total = self.gradient_sum[i] * 0.0
        for slot in range(self.wall_pairs.count[i]):
            k = self.wall_pairs.entry(i, slot)
            total += self.wall_value[self.wall_pairs.index[k]] * self.wall_pairs.gradient[k]
        return -total

    @ti.func
    def pressure_force(self, p: ti.template(), i, weighted: ti.template()):
        """-(D^T E p)_i / V_i; `wall_value` must hold the wall pressures."""
        return self.liquid_force(p, i, weighted) + self.wall_force(i)

    @ti.func
    def wall_rate(self, v: ti.template(), b, weighted: ti.template()):
        """(D v)_b / (V_b sum_f V_f W_bf) of the static wall particle b."""
        total = 0.0
        for slot in range(self.wall_rows.count[b]):
            k = self.wall_rows.entry(b, slot)
            total -= v[self.wall_rows.index[k]].dot(self.wall_rows.gradient[k])
        return self.over_wall_weight(b, total, weighted)

    @ti.func
    def fold(self, i, weighted: ti.template()):
        """(P^T X)_i / V_i of the wall rows' X_b / (V_b sum_f V_f W_bf) in `wall_value`."""
        total = 0.0
        for slot in range(self.wall_pairs.count[i]):
            k = self.wall_pairs.entry(i, slot)
            total += self.wall_pairs.weight[k] * self.wall_value[self.wall_pairs.index[k]]
        return self.lightness(i, weighted) * total

    @ti.func
    def liquid_rate(self, v: ti.template(), i, weighted: ti.template()):
        """(D v)_i / V_i (P1)."""
        total = v[i].dot(self._gradient_sum(i, weighted))
        for slot in range(self.pairs.count[i]):
            k = self.pairs.entry(i, slot)
            j = self.pairs.index[k]
            total -= self.share(i, j, weighted) * v[j].dot(self.pairs.gradient[k])
        return total

    @ti.func
    def volume_rate(self, v: ti.template(), i):
        """(E^T D v)_i; `wall_value` must hold the wall rates."""
        return self.volume[i] * (self.liquid_rate(v, i, True) + self.fold(i, True))

    @ti.func
    def _weight(self, i, weighted: ti.template()):
        w = 1.0
        if ti.static(weighted):
            w = self.mobility[i]
        return w

    @ti.kernel
    def accelerate(self, p: ti.template(), v: ti.template(), factor: float, weighted: ti.template()):
        """v_i += factor * F_i(p) * mobility_i / V_i (or / V_i where not weighted)."""
        for b in range(self.walls.count):
            self.wall_value[b] = self.extrapolated(p, b, weighted)
        for i in range(self.count[None]):
            v[i] += factor * self._weight(i, weighted) * self.pressure_force(p, i, weighted)

    @ti.kernel
    def accelerate_freely(self, p: ti.template(), v: ti.template(), dt: float):
        """v_i += dt F_i(p) / m_i, which friction has yet to answer."""
        for b in range(self.walls.count):
            self.wall_value[b] = self.extrapolated(p, b, True)
        for i in range(self.count[None]):
            v[i] += dt * self.volume[i] / self.mass[i] * self.pressure_force(p, i, True)

    @ti.func
    def wall_hydrostatics(self, position: ti.template(), acceleration: ti.template(), b):
        """Part of the pressure of wall particle b that follows from the acceleration of the liquid around it (P6)."""
        total = 0.0
        for slot in range(self.wall_rows.count[b]):
            k = self.wall_rows.entry(b, slot)
            j = self.wall_rows.index[k]
            distance = self.search.separation(self.walls.position[b], position[j])
            weight = self.wall_rows.weight[k] * self.lightness(j, True)
            total += weight * self.mass[j] / self.volume[j] * acceleration[j].dot(distance)
        return self.over_wall_weight(b, total, True)

    @ti.func
    def push_from_wall(self, v: ti.template(), i, dt):
        """Velocity that particle i gains from the pressures in `wall_value`."""
        total = v[i] * 0.0
        for slot in range(self.wall_pairs.count[i]):
            k = self.wall_pairs.entry(i, slot)
            total -= self.wall_value[self.wall_pairs.index[k]] * self.wall_pairs.gradient[k]
        return dt * self.volume[i] / self.mass[i] * total

    @ti.kernel
    def push_from_walls(self, position: ti.template(), acceleration: ti.template(), v: ti.template(), dt: float):
        """Add the push of the walls by the part of their pressure that does not depend on that of the liquid."""
        for b in range(self.walls.count):
            self.wall_value[b] = self.wall_hydrostatics(position, acceleration, b)
        for i in range(self.count[None]):
            v[i] += self.push_from_wall(v, i, dt)

    @ti.kernel
    def push_from_walls_above_zero(self, p: ti.template(), position: ti.template(), acceleration: ti.template(),
                                   v: ti.template(), dt: float):
        """The same where no pressure is negative: not below that of the liquid, `p`, with its sign turned."""
        for b in range(self.walls.count):
            value = self.wall_hydrostatics(position, acceleration, b)
            self.wall_value[b] = ti.max(value, -self.extrapolated(p, b, True))
        for i in range(self.count[None]):
            v[i] += self.push_from_wall(v, i, dt)

    @ti.func
    def own_gradient(self, i, weighted: ti.template()):
        """Gradient of a unit pressure of particle i at its own place, that of the walls it extrapolates to included."""
        total = self._gradient_sum(i, weighted)
        for slot in range(self.wall_pairs.count[i]):
            k = self.wall_pairs.entry(i, slot)
            b = self.wall_pairs.index[k]
            share = self.volume[i] / self.walls.volume[b] * self.wall_pairs.weight[k] * self.lightness(i, weighted)
            total += self.over_wall_weight(b, share, weighted) * self.wall_pairs.gradient[k]
        return total

    @ti.kernel
    def update_diagonals(self, dt: float):
        """Mobilities in a step dt, and the diagonals of A, without and with weight (P5).

        The diagonals are less what one liquid particle does to another by way of the wall.
        """
        for i in range(self.count[None]):
            resistance = self.mass[i]
            for effect in ti.static(self.resisting):
                resistance += dt * effect.friction(i)
            self.mobility[i] = self.volume[i] / resistance
        for i in range(self.count[None]):
            own = self.own_gradient(i, False).norm_sqr()
            plain, weighted = own / self.volume[i], self._weight(i, True) * own / self.volume[i]
            if ti.static(self.shared_by_density):
                weighted = self._weight(i, True) * self.own_gradient(i, True).norm_sqr() / self.volume[i]
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                j = self.pairs.index[k]
                square = self.pairs.gradient[k].norm_sqr()
                plain += square / self.volume[j]
                weighted += self._weight(j, True) * self.share(i, j, True) ** 2 * square / self.volume[j]
            self.diagonal[0][i] = self.volume[i] ** 2 * plain
            self.diagonal[1][i] = self.volume[i] ** 2 * weighted

    @ti.kernel
    def apply(self, x: ti.template(), weighted: ti.template()):
        """applied = A x (P4)."""
        for b in range(self.walls.count):
            self.wall_value[b] = self.extrapolated(x, b, weighted)
        for i in range(self.count[None]):
            self.force[i] = self._weight(i, weighted) * self.liquid_force(x, i, weighted)
        for member in range(self.wall_pairs.member_count[None]):
            i = self.wall_pairs.member[member]
            self.force[i] += self._weight(i, weighted) * self.wall_force(i)
        for b in range(self.walls.count):
            self.wall_value[b] = self.wall_rate(self.force, b, weighted)
        for i in range(self.count[None]):
            self.applied[i] = -self.volume[i] * self.liquid_rate(self.force, i, weighted)
        for member in range(self.wall_pairs.member_count[None]):
            i = self.wall_pairs.member[member]
            self.applied[i] -= self.volume[i] * self.fold(i, weighted)
