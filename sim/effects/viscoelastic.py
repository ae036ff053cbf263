"""Viscoelastic liquids: a Maxwell stress that turns with the liquid (docs/methods/collision.md).

[mao, section 6] names a shear modulus M_s without unit and leaves the model to [mao2005], which was not to be had; this
is the common one of these terms. The deviatoric stress T of a particle follows
dT/dt = Omega T - T Omega + 2 M_s dev D - T/lambda (H6), D and Omega the symmetric and the antisymmetric part of grad v:
elastic over times shorter than the relaxation time lambda, a liquid of the viscosity M_s lambda over longer ones. A
step turns T exactly (Cayley), so that no rotation, however fast, makes stress, and relaxes it exactly. Above the
yield stress T is scaled back (von Mises: sqrt(3/2 T:T) = sigma_y): what is strained further flows.

At a free surface the schemes know no pressure below zero, so that a liquid could expand for nothing and tear. With
`holds_together` the trace of D counts as well, as far as it makes tension; in a full cavity it is zero anyway.

Liquids meet each other with pressure, viscosity and collision only: grad v and the force see the own liquid. Velocity
gradients are corrected, exact for linear velocities at a free surface too, and the force is their adjoint,
F_i = sum of V_i V_j (T_i L_i + T_j L_j) G_ij: it takes from the motion just what the stress stores or relaxes, keeps
momentum, and spin, because a rotation has no D.
"""
import dataclasses

from sim.advice import SEEN_EFFECT, WARNING, Advice
from sim.backend import data_oriented, real, ti
from sim.effects.effect import REMEMBERS, Effect
from sim.fields import Field
from sim.parameters import parameter

SPRAY = 0.02  # no stress below this determinant of the moments of the kernel gradient (1 inside, 1/16 in a corner)
WAVE_COURANT = 0.3  # distance that a shear wave travels per step, in particle spacings


@dataclasses.dataclass(frozen=True)
class ElasticLiquid:
    """What makes one liquid viscoelastic."""

    liquid: str = parameter(liquid=True, meaning="the liquid")
    shear_modulus: float = parameter(unit="Pa", minimum=0.0, maximum=1e9, meaning="shear modulus M_s")
    relaxation_time: float | None = parameter(None, unit="s", exclusive_minimum=0.0,
                                              meaning="time in which stress relaxes; without it, never")
    yield_stress: float | None = parameter(None, unit="Pa", minimum=0.0,
                                           meaning="von Mises stress above which the liquid flows; without it, none")


@dataclasses.dataclass(frozen=True)
class ViscoelasticParameters:
    """Liquids that spring back and flow (Maxwell, with or without a yield stress)."""

    liquids: tuple[ElasticLiquid, ...] = parameter(meaning="the viscoelastic ones of the liquids")
    holds_together: bool = parameter(True, meaning="expansion is resisted as shear is: at a free surface, where no "
                                                   "pressure is below zero, nothing else would")


def _check_liquids(parameters):
    elastic = [one.liquid for one in parameters.liquids]
    for index, liquid in enumerate(elastic):
        if liquid in elastic[:index]:
            yield ("effects", "viscoelastic", "liquids", index), f"describes {liquid} again; remove one of the two"
    if not elastic:
        yield ("effects", "viscoelastic", "liquids"), "is empty, but must name one liquid at least"


@data_oriented
class Viscoelastic(Effect):
    """Stress of a Maxwell liquid, advanced at the start of the step."""

    name = "viscoelastic"
    Parameters = ViscoelasticParameters
    fields = (
        Field("stress", "tensor", "Pa", "elastic stress T, deviatoric but for tension", carried=True),
        Field("stress_flux", "tensor", "Pa", "T L, stress times the correction of the kernel gradient"),
    )
    uses = ("position", "velocity", "volume", "mass", "phase")
    does = frozenset({REMEMBERS})
    checks = (_check_liquids,)

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        self.count, self.pairs, self.dimension = solver.count, solver.pairs, solver.dimension
        self.modulus, self.relaxation_rate, self.yield_stress = (
            ti.field(real(), shape=len(solver.liquids)) for _ in range(3))
        names = [liquid.name for liquid in solver.liquids]
        for one in parameters.liquids:
            phase = names.index(one.liquid)
            self.modulus[phase] = one.shear_modulus
            self.relaxation_rate[phase] = 1.0 / one.relaxation_time if one.relaxation_time else 0.0
            self.yield_stress[phase] = 1e30 if one.yield_stress is None else one.yield_stress
        self.holds = parameters.holds_together

    @classmethod
    def idle(cls, parameters, settings) -> str:
        return "" if any(one.shear_modulus for one in parameters.liquids) else "every shear modulus is 0 Pa"

    @classmethod
    def advice(cls, parameters, scales, limits):
        density = {liquid.name: liquid.density for liquid in scales.liquids}
        for one in parameters.liquids if parameters else ():
            if one.shear_modulus == 0.0:
                yield Advice(WARNING, cls.name, f"does nothing in {one.liquid}: its shear modulus is 0 Pa, not above 0")
            elif one.liquid in density:
                cauchy = density[one.liquid] * scales.speed**2 / one.shear_modulus
                moves = "tears and flows" if cauchy > 1.0 else "springs"
                yield Advice(SEEN_EFFECT, cls.name,
                             f"rho U2/M of {one.liquid} is {cauchy:.3g}: it {moves} (springs below 1)")

    @classmethod
    def time_step_limit(cls, parameters, settings) -> float:
        """0.3 dx / sqrt(M_s/rho) of the stiffest liquid, the pace of its shear waves.

        (A5) of docs/methods/time_step.md.
        """
        density = {liquid.name: liquid.density for liquid in settings.liquids}
        limits = [WAVE_COURANT * settings.numerics.particle_spacing * (density[one.liquid] / one.shear_modulus) ** 0.5
                  for one in parameters.liquids if one.shear_modulus > 0.0]
        return min(limits, default=float("inf"))

    def stable_time_step(self) -> float:
        return self.time_step_limit(self.parameters, self.solver.settings)

    @ti.func
    def _gradients(self, i):
        """Corrected velocity gradient (component, direction) within the own liquid, 1/s, and the correction L."""
        moments = self.particles.stress[i] * 0.0
        gradient = moments
        for slot in range(self.pairs.count[i]):
            k = self.pairs.entry(i, slot)
            j = self.pairs.index[k]
            if self.particles.phase[j] == self.particles.phase[i]:
                x_ji = self.solver.search.separation(self.particles.position[j], self.particles.position[i])
                moments += self.pairs.gradient[k].outer_product(x_ji)
                gradient += (self.particles.velocity[j] - self.particles.velocity[i]).outer_product(
                    self.pairs.gradient[k])
        correction = moments * 0.0
        if moments.determinant() > SPRAY:
            correction = moments.inverse()  # (H5)
        return gradient @ correction, correction

    @ti.func
    def _advanced(self, stress, gradient, phase, dt):
        """Stress after a step of a constant velocity gradient."""
        identity = stress * 0.0
        for d in ti.static(range(self.dimension)):
            identity[d, d] = 1.0
        spin = 0.25 * dt * (gradient - gradient.transpose())
        turn = (identity - spin).inverse() @ (identity + spin)
        rate = 0.5 * (gradient + gradient.transpose())
        if ti.static(not self.holds):
            rate -= rate.trace() / self.dimension * identity
        x = dt * self.relaxation_rate[phase]
        # (1 - exp(-x))/x, without the difference of two nearly equal numbers
        share = ti.select(x < 0.02, 1.0 - 0.5 * x + x * x / 6.0, (1.0 - ti.exp(-x)) / ti.max(x, 1e-10))
        new = ti.exp(-x) * (turn @ stress @ turn.transpose()) + 2.0 * self.modulus[phase] * dt * share * rate  # (H7)
        tension = ti.max(new.trace() / self.dimension, 0.0) * identity  # pressure takes what is compressed
        new -= new.trace() / self.dimension * identity
        mises = ti.sqrt(1.5 * (new * new).sum())
        limit = self.yield_stress[phase]
        return ti.select(mises > limit, limit / ti.max(mises, 1e-30), 1.0) * new + tension

    @ti.kernel
    def _advance(self, dt: float):
        for i in range(self.count[None]):
            gradient, correction = self._gradients(i)
            phase = self.particles.phase[i]
            stress = self.particles.stress[i] * 0.0
            if self.modulus[phase] > 0.0:
                stress = self._advanced(self.particles.stress[i], gradient, phase, dt)
            self.particles.stress[i] = stress
            self.particles.stress_flux[i] = stress @ correction

    def prepare(self, dt: float) -> None:
        self._advance(dt)

    @ti.func
    def pair_acceleration(self, i, j, x_ij, gradient, weight):
        same = ti.select(self.particles.phase[i] == self.particles.phase[j], 1.0, 0.0)
        flux = self.particles.stress_flux[i] + self.particles.stress_flux[j]
        return (same * self.particles.volume[i] / self.particles.mass[i]) * (flux @ gradient)  # (H8)
