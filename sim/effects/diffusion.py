"""Diffusion of volume fractions by conservative pair fluxes: [song, eq. 13] with one coefficient for all liquids.

The volume of liquid k that moves from j to i in one step is q = 2 dt D V_i V_j (alpha_k,i - alpha_k,j)
(x_ij.G_ij)/r^2: antisymmetric, and its sum over k is zero. The factor 2 belongs to the Laplacian; what a lattice of
particles lacks of it (3 % at h = 2.5 dx) is put into D. Each new fraction is a convex combination of old ones.
Equations: docs/methods/mixtures.md.
"""
import dataclasses
import math

from sim.advice import SEEN_EFFECT, WARNING, Advice, Quantity, if_alone, if_zero, is_seen, shown, times
from sim.backend import data_oriented, ti
from sim.effects.parts.mixture import Mixing
from sim.parameters import parameter

MIXED = 10.0  # particle spacings over which liquids have mixed when more of it no longer matters to the solves


@dataclasses.dataclass(frozen=True)
class DiffusionParameters:
    """Mixing of the liquids by diffusion of their volume fractions (Song et al., eq. 13, corrected)."""

    coefficient: float = parameter(unit="m**2/s", minimum=0.0, maximum=1e-2, meaning="diffusion coefficient D_m")


@data_oriented
class Diffusion(Mixing):
    """Volume fractions that diffuse between liquid particles; none crosses the wall."""

    name = "diffusion"
    Parameters = DiffusionParameters
    fewest_liquids = 2

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        self.coefficient = self.lattice_factor * parameters.coefficient

    @classmethod
    def idle(cls, parameters, settings) -> str:
        return "" if parameters.coefficient else cls.nothing_mixes(settings, "its coefficient is 0 m2/s")

    @classmethod
    def advice(cls, parameters, scales, limits):
        if parameters is None:
            return
        yield from if_zero(cls.name, parameters, "coefficient", "m2/s")
        yield from if_alone(cls.name, scales)
        if not parameters.coefficient or len(scales.liquids) == 1:
            return
        spread = min(math.sqrt(2.0 * parameters.coefficient * scales.duration), scales.width)
        seen = is_seen(spread, scales)
        time = scales.length**2 / parameters.coefficient
        whole = f"; to mix all of them {'takes' if time <= scales.duration else 'would take'} {shown(time, 's')}"
        yield Advice(SEEN_EFFECT if seen else WARNING, cls.name,
                     f"{'' if seen else 'cannot be seen: '}within the {shown(scales.duration, 's')} of the scene the "
                     f"liquids mix over {times(spread, scales)}{whole}")

    @classmethod
    def numbers(cls, parameters, scales):
        if parameters.coefficient:
            yield Quantity("Pe", scales.speed * scales.length / parameters.coefficient, "",
                           "Peclet, U L/D: transport by flow over diffusion")

    @classmethod
    def time_scales(cls, parameters, scales):
        if parameters.coefficient:
            yield Quantity("diffusion", scales.length**2 / parameters.coefficient, "s",
                           "L2/D: the liquids are mixed all over")

    def mix_ahead(self, seconds: float) -> None:
        if self.parameters.coefficient:
            self.prepare(min(seconds, (MIXED * self.solver.spacing) ** 2 / self.parameters.coefficient))

    @ti.func
    def pair_flux(self, i, j, x_ij):
        return self.coefficient * (self.particles.volume_fraction[j] - self.particles.volume_fraction[i])  # (M3)

    @ti.func
    def pair_rate(self, i, j, x_ij):
        return self.coefficient

    def prepare(self, dt: float) -> None:
        if self.coefficient > 0.0 and dt > 0.0:
            self.mix(dt)
