"""Curvature force: differences of normals shrink the surface of a liquid [akinci2013; song, eqs. 7, 8].

F_ij = -gamma K_ij m_ij s_ij (n_i - n_j) with n_i = h sum of V_j s_ij G_ij. s_ij is 1 within a liquid and 0 between two;
in mixtures sum alpha_k,i alpha_k,j, so that normals and force fade as the liquids mix. The mean mass
m_ij = 2 m_i m_j/(m_i + m_j) makes the pair force antisymmetric for unequal masses, which m_i of the paper does not.
Equations: docs/methods/cohesion.md.
"""
import dataclasses
import math
from types import MappingProxyType

from sim.advice import if_zero, without_unit
from sim.backend import data_oriented, ti
from sim.effects.effect import PULLS, Effect
from sim.effects.parts.same_liquid import Likeness
from sim.fields import Field
from sim.parameters import parameter


@dataclasses.dataclass(frozen=True)
class CurvatureParameters:
    """Area minimization by differences of normals (Akinci et al. 2013; Song et al., eqs. 7, 8)."""

    gamma: float = parameter(unit="m/s**2", minimum=0.0, maximum=1e6, meaning="curvature coefficient")


@data_oriented
class Curvature(Effect):
    """Attraction along differences of the color field's normals."""

    name = "curvature"
    Parameters = CurvatureParameters
    fields = (Field("interface_normal", "vector", "1", "n_i = h sum of V_j s_ij grad W_ij"),)
    uses = ("mass", "phase", "compression_rate")
    excludes = MappingProxyType({PULLS: "both pull the interface together"})

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        self.gamma = parameters.gamma
        self.likeness = Likeness(solver)
        self.support = solver.support_radius
        self.count, self.pairs = solver.count, solver.pairs

    @classmethod
    def idle(cls, parameters, settings) -> str:
        return "" if parameters.gamma else "its gamma is 0 m/s2"

    @classmethod
    def pulls(cls, parameters) -> bool:
        return bool(parameters.gamma)

    @classmethod
    def advice(cls, parameters, scales, limits):
        if parameters:
            yield from if_zero(cls.name, parameters, "gamma", "m/s2")
            yield from without_unit(cls.name, parameters, "gamma")

    @classmethod
    def wave_speeds(cls, parameters, scales):
        yield math.sqrt(parameters.gamma * (scales.settings.numerics.support_ratio * scales.spacing))

    def expected_speeds(self):
        yield math.sqrt(self.gamma * self.support)

    @ti.kernel
    def _normals(self):
        for i in range(self.count[None]):
            total = self.particles.interface_normal[i] * 0.0
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                total += self.likeness.of(i, self.pairs.index[k]) * self.pairs.gradient[k]
            self.particles.interface_normal[i] = self.support * total

    def prepare(self, dt: float) -> None:
        self._normals()

    @ti.func
    def pair_acceleration(self, i, j, x_ij, gradient, weight):
        correction = 2.0 / (self.particles.compression_rate[i] + self.particles.compression_rate[j])
        share = 2.0 * self.particles.mass[j] / (self.particles.mass[i] + self.particles.mass[j])
        return (-self.gamma * self.likeness.of(i, j) * correction * share) * (  # (C3)
            self.particles.interface_normal[i] - self.particles.interface_normal[j])
