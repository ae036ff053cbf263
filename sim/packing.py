"""Packing of a lattice into a curved cavity, before time starts (docs/methods/walls.md)."""
import numpy as np

from sim.backend import data_oriented, real, ti
from sim.fields import Field, ParticleStore
from sim.neighbor_search import NeighborSearch, corners
from sim.smoothing_kernels import WendlandC2

RELAXATION = 0.15  # x -= 0.15 dx h S_i per iteration
STEP_LIMIT = 0.1  # largest move per iteration, in particle spacings


@data_oriented
class _Packing:
    def __init__(self, particles, search, spacing, support):
        self.particles, self.search, self.spacing, self.support = particles, search, spacing, support
        self.pairs, self.wall_pairs = search.pairs, search.wall_pairs
        self.position, self.shift = particles.arrays["position"], particles.arrays["shift"]
        self.compression = ti.field(real(), shape=particles.capacity)

    @ti.kernel
    def step(self):
        for i in range(self.particles.count[None]):
            total = self.position[i] * 0.0
            weight = self.particles.arrays["volume"][i] * self.search.kernel.at_zero
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                total += self.pairs.gradient[k]
                weight += self.pairs.weight[k]
            for slot in range(self.wall_pairs.count[i]):
                k = self.wall_pairs.entry(i, slot)
                total += self.wall_pairs.gradient[k]
                weight += self.wall_pairs.weight[k]
            move = -RELAXATION * self.spacing * self.support * total  # (L4)
            self.shift[i] = move * ti.min(1.0, STEP_LIMIT * self.spacing / ti.max(move.norm(), 1e-30))
            self.compression[i] = weight
        for i in range(self.particles.count[None]):
            self.position[i] += self.shift[i]


def pack(fluid_position, fluid_volume, wall_position, wall_volume, particle_spacing, support_ratio, iterations,
         periods=()):
    """Relax liquid particles between walls until their compression rate is even.

    Parameters
    ----------
    fluid_position, fluid_volume : (n, d), (n,) start, m and m^3.
    wall_position, wall_volume : (m, d), (m,) static wall particles.
    particle_spacing, support_ratio : m and support radius over spacing.
    iterations : relaxation steps; some 80 serve, and many more press particles into gaps of the wall.
    periods : length after which an axis repeats, m, 0 where it does not; empty where none does.

    Returns
    -------
    (n, d) positions in the order of the input, and (n,) compression rates.
    """
    n, dimension = fluid_position.shape
    support = support_ratio * particle_spacing
    fields = [Field("id", "integer", "", "input order", carried=True),
              Field("position", "vector", "m", "position", carried=True),
              Field("volume", "scalar", "m3", "volume", carried=True), Field("shift", "vector", "m", "move")]
    particles = ParticleStore(fields, n, dimension, 1)
    near = (np.asarray(wall_position), np.asarray(wall_volume), np.zeros(len(wall_position)))
    search = NeighborSearch(particles, near, WendlandC2(support, dimension), *corners(near[0], periods),
                            particle_spacing, periods=periods)
    particles.count[None] = n
    for name, values in (("id", np.arange(n)), ("position", fluid_position), ("volume", fluid_volume)):
        particles.from_numpy(name, values)
    packing = _Packing(particles, search, particle_spacing, support)
    for _ in range(iterations):
        search.sort()
        search.build()
        packing.step()
    back = np.argsort(particles.to_numpy("id"))
    return particles.to_numpy("position")[back].astype(float), packing.compression.to_numpy()[:n][back].astype(float)
