"""What the effects that mix liquids share: volume fractions, and the exchange of volume between pairs of particles.

A particle holds the share alpha_k of every liquid k [song, section III-C1], so that its density is sum alpha_k rho_k:
liquids do not shrink when they mix. Its viscosity is the product of mu_k^alpha_k
(``sim.effects.parts.liquid_viscosity``).
Its velocity v = sum alpha_k v_k is the volume average, whose divergence is zero.

Volume is exchanged between pairs alone: what i gains of a liquid j loses, and the gains of all liquids add up to zero,
so every liquid's volume, the sum of the fractions and each particle's volume are conserved. Nothing is clipped and
nothing normalized again ([song, eq. 13] does not say how its fractions stay in bounds). The moved volume carries the
mass and the momentum of its donor (to update the masses alone, as in [song, algorithm 1], makes momentum). Sub-steps,
in which no particle gives away more than a share of what it holds, keep the fractions in [0, 1] for any time step.

None of the liquids crosses the wall. The slip of the liquids within a particle carries no momentum of its own: the term
div(sum alpha_k rho_k v_k^d v_k^d) of [manninen1996] is left out. Equations: docs/methods/mixtures.md.
"""
import math

import numpy as np

from sim.backend import data_oriented, real, ti
from sim.effects.effect import MIXES, Effect
from sim.errors import RunError
from sim.fields import Field
from sim.reductions import blocks, first, largest_of, last, partial_results
from sim.smoothing_kernels import lattice_moment

LARGEST_SHARE = 0.5  # of a liquid that leaves a particle in one sub-step; 1 is the limit of the bounds
MOST_SUB_STEPS = 100_000


@data_oriented
class Mixing(Effect):
    """Base of the effects that exchange liquids between particles: they give `pair_flux` and `pair_rate`."""

    fields: tuple[Field, ...] = (
        Field("volume_fraction", "liquids", "1", "volume fraction of every liquid", carried=True),
        Field("volume_fraction_next", "liquids", "1", "volume fractions after the sub-step"),
        Field("velocity_next", "vector", "m/s", "velocity after the exchange of momentum"),
        Field("exchange_rate", "scalar", "1/s", "largest share of a liquid that leaves the particle, per time"),
    )
    uses = ("position", "velocity", "volume", "mass", "phase")
    does = frozenset({MIXES})

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        self.count, self.pairs, self.kernel = solver.count, solver.pairs, solver.kernel
        self.liquid_count = len(solver.liquids)
        self.density = ti.field(real(), shape=self.liquid_count)
        for k, liquid in enumerate(solver.liquids):
            self.density[k] = liquid.density
        self.largest_rate = ti.field(real(), shape=())
        self.partial = partial_results(1)
        self.sub_steps = 0  # of the last exchange
        # What pair fluxes along a gradient are multiplied with, to be right on a lattice.
        spacing = solver.rest_volume ** (1.0 / solver.dimension)
        self.lattice_factor = 1.0 / lattice_moment(self.kernel, spacing, solver.dimension)
        self.start({field.name for field in self.fields if field.carried})

    @staticmethod
    def nothing_mixes(settings, reason: str) -> str:
        """The reason to leave an effect out, unless the liquids may be mixed already: it then keeps them so."""
        return "" if settings.continued else reason

    def start(self, missing: set[str]) -> None:
        if "volume_fraction" in missing:
            phase = self.solver.particles.to_numpy("phase")
            self.solver.particles.from_numpy("volume_fraction", np.eye(self.liquid_count)[phase])

    @ti.func
    def pair_flux(self, i, j, x_ij):
        """Volume of every liquid that i gains from j per time, over 2 V_i V_j |W'|/r, m^2/s; opposite for j and i."""
        return ti.static(None)

    @ti.func
    def pair_rate(self, i, j, x_ij):
        """Largest share of any liquid that i loses to j per time, over 2 V_j |W'|/r, m^2/s."""
        return ti.static(None)

    @ti.func
    def _separation(self, i, j):
        return self.solver.search.separation(self.particles.position[i], self.particles.position[j])

    @ti.func
    def _weight(self, j, x_ij):
        """2 V_j |W'|/r, 1/m^2."""
        return -2.0 * self.particles.volume[j] * self.kernel.gradient_factor(x_ij.norm())

    @ti.kernel
    def _measure(self):
        n = self.count[None]
        for i in range(n):
            total = 0.0
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                j = self.pairs.index[k]
                x_ij = self._separation(i, j)
                total += self._weight(j, x_ij) * self.pair_rate(i, j, x_ij)
            self.particles.exchange_rate[i] = total
        for block in range(blocks(n)):
            largest = 0.0
            for i in range(first(block, n), last(block, n)):
                largest = ti.max(largest, self.particles.exchange_rate[i])
            self.partial[0, block] = largest
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.largest_rate[None] = largest_of(self.partial, 0, n)

    @ti.kernel
    def _exchange(self, dt: float):
        for i in range(self.count[None]):
            velocity = self.particles.velocity[i]
            change = self.particles.volume_fraction[i] * 0.0
            mass_change = 0.0
            momentum = velocity * 0.0  # relative to the particle's own velocity
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                j = self.pairs.index[k]
                x_ij = self._separation(i, j)
                flux = (dt * self._weight(j, x_ij)) * self.pair_flux(i, j, x_ij)
                change += flux
                arriving = 0.0
                for liquid in ti.static(range(self.liquid_count)):
                    moved = self.density[liquid] * flux[liquid]
                    mass_change += moved
                    arriving += ti.max(moved, 0.0)
                momentum += arriving * (self.particles.velocity[j] - velocity)
            volume = self.particles.volume[i]
            self.particles.volume_fraction_next[i] = self.particles.volume_fraction[i] + change
            mass = self.particles.mass[i] + volume * mass_change
            self.particles.velocity_next[i] = velocity + volume / mass * momentum  # (M2)
        for i in range(self.count[None]):
            self.particles.volume_fraction[i] = self.particles.volume_fraction_next[i]
            self.particles.velocity[i] = self.particles.velocity_next[i]
            self.particles.mass[i] = self.mixture_density(i) * self.particles.volume[i]

    @ti.func
    def mixture_density(self, i):
        """sum of alpha_k rho_k (M1), kg/m^3."""
        density = 0.0
        for liquid in ti.static(range(self.liquid_count)):
            density += self.density[liquid] * self.particles.volume_fraction[i][liquid]
        return density

    def mix(self, dt: float) -> None:
        """Exchange volume, mass and momentum over dt, in as many sub-steps as the bounds ask for.

        Raises
        ------
        RunError
            Where the liquids would have to be exchanged far faster than the flow moves.
        """
        self._measure()
        wanted = dt * self.largest_rate[None] / LARGEST_SHARE
        if not wanted <= MOST_SUB_STEPS:
            raise RunError(f"{self.name} needs {wanted:.3g} sub-steps in one time step of {dt:.3g} s, more than "
                           f"{MOST_SUB_STEPS}; lower effects.{self.name}.coefficient")
        self.sub_steps = max(1, math.ceil(wanted))
        for _ in range(self.sub_steps):
            self._exchange(dt / self.sub_steps)
