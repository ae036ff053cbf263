"""Diffusion of volume fractions by conservative pair fluxes: [song, eq. 13] with one coefficient for all liquids.

The volume of liquid k that moves from j to i in one step is q = 2 dt D V_i V_j (alpha_k,i - alpha_k,j)
(x_ij.G_ij)/r^2: antisymmetric, and its sum over k is zero. The factor 2 belongs to the Laplacian; what a lattice of
particles lacks of it (3 % at h = 2.5 dx) is put into D. Each new fraction is a convex combination of old ones.
Equations: docs/methods/mixtures.md.
"""
import dataclasses

import taichi as ti

from sim.effects.parts.mixture import Mixing
from sim.parameters import parameter


@dataclasses.dataclass(frozen=True)
class DiffusionParameters:
    """Mixing of the liquids by diffusion of their volume fractions (Song et al., eq. 13, corrected)."""

    coefficient: float = parameter(unit="m**2/s", minimum=0.0, maximum=1e-2, meaning="diffusion coefficient D_m")


@ti.data_oriented
class Diffusion(Mixing):
    """Volume fractions that diffuse between liquid particles; none crosses the wall."""

    name = "diffusion"
    Parameters = DiffusionParameters

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        self.coefficient = self.lattice_factor * parameters.coefficient

    @classmethod
    def idle(cls, parameters, settings) -> str:
        return "" if parameters.coefficient else cls.nothing_mixes(settings, "its coefficient is 0 m2/s")

    @ti.func
    def pair_flux(self, i, j, x_ij):
        return self.coefficient * (self.particles.volume_fraction[j] - self.particles.volume_fraction[i])  # (M3)

    @ti.func
    def pair_rate(self, i, j, x_ij):
        return self.coefficient

    def prepare(self, dt: float) -> None:
        if self.coefficient > 0.0 and dt > 0.0:
            self.mix(dt)
