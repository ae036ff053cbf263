"""Implicit viscosity: backward Euler, (M + dt K) v = M v* with one of three matrices K.

The matrices are those of ``sim.effects.parts.viscous_forms``.

Measured: error of the velocity of two layers in a channel, viscosities 1400:1, 20 and 40 spacings across each, in 2D,
support 3 dx, in brackets 2.5 dx and disordered (study `validation`, family `channel`); and time of the solve in the eye
at 0.4 mm, over that of the central form:

central    0.8, 0.5 % (6.1, 3.6 %); 1. The default: the cheaper one of the two that keep the spin of drops. In 3D, as in
           the eye, 0.6 % with 24 spacings and either support.
laplacian  1.4, 0.7 % (3.8, 1.5 %); 0.7. Brakes drops that turn, so not for oil in aqueous.
strain     1.8, 0.9 % (7.0, 4.0 %); 2.2. As many iterations, each twice as dear. Exact for shear in any direction, on
           lattices too, but stiff on scales of a few spacings: a drop of 6 creeps 10 % too slowly.

M + dt K is symmetric and positive definite; conjugate gradients with the diagonal as preconditioner, started from the
viscous acceleration of the last step. Equations: docs/methods/viscosity.md.
"""
import dataclasses
from types import MappingProxyType
from typing import ClassVar

from sim.advice import NOTE, WARNING, Advice
from sim.backend import data_oriented, real, ti
from sim.effects.effect import RESISTS, SHEARS, Effect
from sim.effects.parts.line_friction import LineFriction
from sim.effects.parts.liquid_viscosity import LiquidViscosity, explicit_limit, without_viscosity
from sim.effects.parts.viscous_advice import (
    IMPLICIT_STEP_COST,
    acting,
    explicit_steps,
    is_felt,
    missing,
    viscous_times,
)
from sim.effects.parts.viscous_forms import FORMS
from sim.effects.viscosity import Viscosity, ViscosityParameters
from sim.fields import Field
from sim.parameters import parameter
from sim.reductions import blocks, first, last, partial_results, total_of


@dataclasses.dataclass(frozen=True)
class ViscosityImplicitParameters:
    """Shear stress within and between liquids by a backward Euler step: no limit on the time step."""

    damps_any_step: ClassVar[bool] = True  # waves too short to follow fade in steps of any size

    wall: str = parameter("no_slip", choices=("no_slip", "free_slip"), meaning="friction at the wall")
    form: str = parameter("central", choices=tuple(FORMS),
                          meaning="central pair forces; strain: exact for shear in any direction, dearer; "
                                  "laplacian: cheap and exact, but it brakes the spin of drops")
    contact_line: str = parameter(
        "share", choices=("share", "corner"),
        meaning="what holds a contact line at walls without slip. share: a share of the wall's friction, chosen at one "
                "angle; corner: the friction of its corner after Cox, in which nothing is chosen")
    explicit_if_cheaper: bool = parameter(
        True, meaning="advanced explicitly, as by the effect viscosity, in a scene in which the limit of that is not "
                      "below the other limits of the time step, so that it costs no further step; not for form strain")


@data_oriented
class ViscosityImplicit(Effect):
    """Backward Euler step of the viscous forces."""

    name = "viscosity_implicit"
    Parameters = ViscosityImplicitParameters
    fields = (
        *LiquidViscosity.fields,
        Field("viscous_acceleration", "vector", "m/s2", "acceleration by viscosity in the last step", carried=True),
        Field("velocity_given", "vector", "m/s", "velocity before the viscous solve"),
        Field("viscous_residual", "vector", "N s", "residual of the viscous solve"),
        Field("viscous_direction", "vector", "m/s", "search direction of the viscous solve"),
        Field("viscous_image", "vector", "N s", "matrix times search direction"),
        Field("viscous_diagonal", "scalar", "kg", "diagonal of the viscous matrix"),
        Field("wall_friction", "scalar", "kg/s", "viscous force of the wall over the velocity"),
    )
    uses = ("position", "velocity", "volume", "mass", "phase")
    does = frozenset({SHEARS, RESISTS})
    excludes = MappingProxyType({SHEARS: "both apply the shear stress"})
    solves = "viscosity"
    reads = ("maximum_iterations", "viscosity_tolerance")

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        self.count = solver.count
        no_slip, corner = parameters.wall == "no_slip", parameters.contact_line == "corner"
        self.liquids = LiquidViscosity(solver, corner)
        self.form = FORMS[parameters.form](solver, self.particles, self.liquids, no_slip)
        self.line = LineFriction(solver, self.liquids.tension) if no_slip and corner and self.liquids.has_line else None
        self.coupling = None  # with the pressure, in schemes that have one
        self.unused_hooks = () if no_slip else ("friction",)
        self.growth = solver.particles.arrays.get("growth")  # where liquid is injected
        self.partial = partial_results(2)
        self.rho, self.norm, self.momentum = (ti.field(ti.f64, shape=()) for _ in range(3))
        self.alpha, self.beta = (ti.field(real(), shape=()) for _ in range(2))

    @classmethod
    def idle(cls, parameters, settings) -> str:
        return without_viscosity(settings)

    @classmethod
    def instead(cls, parameters, settings, largest_step: float):
        limit = explicit_limit(settings)
        if not parameters.explicit_if_cheaper or parameters.form == "strain" or limit < largest_step:
            return None
        return ViscosityParameters(wall=parameters.wall, form=parameters.form), (
            f"is advanced explicitly: the limit of that, {1e3 * limit:.3g} ms, is not below the "
            f"{1e3 * largest_step:.3g} ms that all else allows (effects.viscosity_implicit.explicit_if_cheaper)")

    @classmethod
    def advice(cls, parameters, scales, limits):
        steps = explicit_steps(Viscosity.name, scales, limits)
        if parameters:
            yield from acting(cls.name, scales)
            replaced = [note for note in scales.replacements if note.startswith(cls.name)]
            if is_felt(scales) and replaced:
                yield Advice(NOTE, cls.name, replaced[0].removeprefix(f"{cls.name} "))
            elif is_felt(scales) and steps <= 1.0:
                yield Advice(WARNING, cls.name, "explicit viscosity would be cheaper: it needs no solve and "
                                                f"{steps:.2g} steps for one that everything else allows, so up to 1 it "
                                                "costs no further step")
        elif steps > IMPLICIT_STEP_COST and scales.has(Viscosity.name) and is_felt(scales):
            yield Advice(WARNING, Viscosity.name,
                         f"{cls.name} would be cheaper: explicit viscosity takes {steps:.3g} steps for one that "
                         f"everything else allows (cheaper up to {IMPLICIT_STEP_COST:g})")
        elif steps > IMPLICIT_STEP_COST and not scales.does(SHEARS):
            yield from missing(cls.name, scales)

    @classmethod
    def time_scales(cls, parameters, scales):
        return viscous_times(scales)

    @classmethod
    def reals_per_pair(cls, dimension: int) -> int:
        return dimension + 1  # the matrix, and what it is made of

    def prepare(self, dt: float) -> None:
        if self.line:
            self.line.measure()

    @ti.kernel
    def _guess(self, dt: float):
        """The velocity if viscosity does what it did in the last step (after [weiler2018])."""
        for i in range(self.count[None]):
            self.particles.velocity_given[i] = self.particles.velocity[i]
            self.particles.velocity[i] += dt * self.particles.viscous_acceleration[i]

    @ti.kernel
    def _keep_acceleration(self, dt: float):
        for i in range(self.count[None]):
            change = self.particles.velocity[i] - self.particles.velocity_given[i]
            self.particles.viscous_acceleration[i] = change / dt

    @ti.func
    def _applied(self, v: ti.template(), i, dt):
        """(M + dt K) v of particle i."""
        inert = self.particles.mass[i]
        if ti.static(bool(self.line)):
            inert += dt * self.line.friction[i]
        return self.form.added(inert * v[i], v, i, dt)  # (V5)

    @ti.kernel
    def _add_line(self, dt: float):
        """Add the friction of the contact line to that of the wall and to the diagonal."""
        for i in range(self.count[None]):
            self.particles.wall_friction[i] += self.line.friction[i]
            self.particles.viscous_diagonal[i] += dt * self.line.friction[i]

    @ti.kernel
    def _let_grow(self, dt: float):
        """Add what viscous forces would do against an even growth, which strains no liquid."""
        for i in range(self.count[None]):
            push = self.particles.velocity[i] * 0.0
            for slot in range(self.form.pairs.count[i]):
                k = self.form.pairs.entry(i, slot)
                j = self.form.pairs.index[k]
                rate = 0.5 * (self.growth[i] + self.growth[j]) / self.form.dimension
                if rate != 0.0:
                    x_ij = self.form.search.separation(self.particles.position[i], self.particles.position[j])
                    push += rate * self.form.against_expansion(k, x_ij)  # (V15)
            change = dt / self.particles.mass[i] * push
            self.particles.velocity_given[i] += change
            self.particles.velocity[i] += change

    @ti.kernel
    def _set_residual(self, v: ti.template(), given: ti.template(), dt: float):
        n = self.count[None]
        for i in range(n):
            momentum = self.particles.mass[i] * given[i]
            self.particles.viscous_residual[i] = momentum - self._applied(v, i, dt)
            self.particles.viscous_direction[i] = self.particles.velocity[i] * 0.0
        for block in range(blocks(n)):
            scale = ti.cast(0.0, ti.f64)
            for i in range(first(block, n), last(block, n)):
                momentum = self.particles.mass[i] * given[i]
                scale += ti.cast(momentum.norm_sqr(), ti.f64) / self.particles.mass[i]
            self.partial[0, block] = scale
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.momentum[None] = total_of(self.partial, 0, n)
            self.rho[None] = 0.0

    @ti.kernel
    def _direct(self):
        """direction = residual / diagonal + beta direction; norm = |residual|^2 over mass."""
        n = self.count[None]
        for block in range(blocks(n)):
            rho = ti.cast(0.0, ti.f64)
            norm = ti.cast(0.0, ti.f64)
            for i in range(first(block, n), last(block, n)):
                r = ti.cast(self.particles.viscous_residual[i].norm_sqr(), ti.f64)
                rho += r / self.particles.viscous_diagonal[i]
                norm += r / self.particles.mass[i]
            self.partial[0, block] = rho
            self.partial[1, block] = norm
        ti.loop_config(serialize=True)
        for _ in range(1):
            rho = total_of(self.partial, 0, n)
            self.beta[None] = ti.select(self.rho[None] > 0.0, rho / self.rho[None], 0.0)
            self.rho[None] = rho
            self.norm[None] = total_of(self.partial, 1, n)
        for i in range(self.count[None]):
            self.particles.viscous_direction[i] = (
                self.particles.viscous_residual[i] / self.particles.viscous_diagonal[i]
                + self.beta[None] * self.particles.viscous_direction[i])

    @ti.kernel
    def _advance(self, v: ti.template(), dt: float):
        n = self.count[None]
        for i in range(n):
            self.particles.viscous_image[i] = self._applied(self.particles.viscous_direction, i, dt)
        for block in range(blocks(n)):
            product = ti.cast(0.0, ti.f64)
            for i in range(first(block, n), last(block, n)):
                product += ti.cast(self.particles.viscous_image[i].dot(self.particles.viscous_direction[i]), ti.f64)
            self.partial[0, block] = product
        ti.loop_config(serialize=True)
        for _ in range(1):
            total = total_of(self.partial, 0, n)
            self.alpha[None] = ti.select(total > 0.0, self.rho[None] / total, 0.0)
        for i in range(self.count[None]):
            alpha = self.alpha[None]
            v[i] += alpha * self.particles.viscous_direction[i]
            self.particles.viscous_residual[i] -= alpha * self.particles.viscous_image[i]

    def correct_velocity(self, dt: float) -> dict[str, float]:
        """The viscous solve, started from the acceleration of the last step."""
        numerics = self.solver.settings.numerics
        self.liquids.measure(self.particles.own_viscosity, self.particles.dynamic_viscosity)
        self._guess(dt)
        self.form.assemble(dt)
        if self.line:
            self._add_line(dt)
        if self.growth is not None:
            self._let_grow(dt)
        iterations = self.solve(self.particles.velocity, self.particles.velocity_given, dt,
                                numerics.viscosity_tolerance)
        self._keep_acceleration(dt)
        return {"viscosity_iterations": iterations,
                "viscosity_limit_hit": float(iterations >= numerics.maximum_iterations)}

    def solve(self, v, given, dt: float, tolerance: float) -> int:
        """Find v of (M + dt K) v = M given by conjugate gradients that start from the present v; return the iterations.

        The norm of the residual over the mass falls to `tolerance` times that of M given.
        """
        most = self.solver.settings.numerics.maximum_iterations
        self.form.differentiate(v)
        self._set_residual(v, given, dt)
        self._direct()
        iterations = 0
        while self.norm[None] > tolerance**2 * self.momentum[None] and iterations < most:
            self.form.differentiate(self.particles.viscous_direction)
            self._advance(v, dt)
            self._direct()
            iterations += 1
        return iterations

    @ti.kernel
    def _guess_answer(self, push: ti.template(), answer: ti.template()):
        for i in range(self.count[None]):
            answer[i] = self.particles.mass[i] / self.particles.viscous_diagonal[i] * push[i]

    def answer(self, push, answer, dt: float, tolerance: float) -> int:
        self._guess_answer(push, answer)
        return self.solve(answer, push, dt, tolerance)

    @ti.kernel
    def take_answer(self, push: ti.template(), answer: ti.template(), share: float, dt: float):
        for i in range(self.count[None]):
            self.particles.viscous_acceleration[i] += share / dt * (answer[i] - push[i])

    @ti.func
    def friction(self, i):
        return self.particles.wall_friction[i]

    @ti.func
    def viscous_mass(self, i):
        return self.particles.viscous_diagonal[i]

    def stiffness(self) -> tuple[float, float]:
        return self.form.compression, self.form.lattice_diagonal()
