"""The contract of an effect.

An effect is one file: a frozen dataclass of parameters (``sim.parameters.parameter``: the one source for validation,
schema and documentation) and a class that declares the particle fields it reads and adds, and overrides only the
hooks it uses. The solver collects, per hook, the effects that override it; a hook that none overrides is neither
compiled nor run.
"""
from typing import TYPE_CHECKING, Any

import taichi as ti

from sim.fields import Field


@ti.data_oriented
class Effect:
    """Base of all effects.

    Class attributes
    ----------------
    name : key in the scene file.
    Parameters : frozen dataclass of the parameters.
    fields : particle fields that this effect adds.
    uses : names of the fields of others that it reads or writes.
    reads : limits of solves that it takes from the numerics (``sim.settings.Numerics``).
    requires : names of the effects that must be active too.
    unused_hooks : hooks that the parameters of this one effect switch off: neither compiled nor run.
    periodic : whether the effect works across the ends of periodic axes.
    planned : whether its state is that of a plan in time, which begins anew in a scene that starts from another one.
    """

    name: str
    Parameters: type
    fields: tuple[Field, ...] = ()
    uses: tuple[str, ...] = ()
    reads: tuple[str, ...] = ()
    requires: tuple[str, ...] = ()
    unused_hooks: tuple[str, ...] = ()
    periodic: bool = True
    planned: bool = False

    if TYPE_CHECKING:  # what single effects have beside
        def __getattr__(self, name: str) -> Any: ...

    def __init__(self, parameters, solver):
        self.parameters = parameters
        self.solver = solver
        self.particles = solver.particles.view(self.name, [f.name for f in self.fields] + list(self.uses))

    @classmethod
    def overrides(cls, hook: str) -> bool:
        """True where this effect has a hook of its own."""
        return getattr(cls, hook) is not getattr(Effect, hook)

    # Rules that need the settings alone (``sim.effect_selection``).

    @classmethod
    def idle(cls, parameters, settings) -> str:
        """Why this effect does nothing in a scene, so that it is left out; empty where it acts."""
        return ""

    @classmethod
    def instead(cls, parameters, settings, largest_step: float):
        """Parameters of another effect that does the same at less cost, and a clause that says why; None to keep it.

        `largest_step` is the time step that all else allows, s.
        """
        return None

    # Hooks on the host, in the order of a step.

    def start(self, missing: set[str]) -> None:
        """Set this effect's carried fields of these names from the particles: no checkpoint has them."""

    @classmethod
    def time_step_limit(cls, parameters, settings) -> float:
        """Part of `stable_time_step` that follows from the settings alone, known before anything is compiled, s."""
        return float("inf")

    def stable_time_step(self) -> float:
        """Largest stable time step at the present state, s."""
        return float("inf")

    def exchange(self, dt: float) -> None:
        """Add and remove particles, before they are sorted."""

    def prepare(self, dt: float) -> dict[str, float] | None:
        """Compute what the pair and body hooks need, once neighbors are known."""

    def correct_velocity(self, dt: float) -> dict[str, float]:
        """Change the velocity after the accelerations and before the pressure; return statistics."""
        return {}

    def finish(self, dt: float) -> None:
        """Change the state once the positions have moved; neighbor rows are those of the start of the step."""

    # Hooks on the device.

    @ti.func
    def body_acceleration(self, i):
        """Acceleration of particle i that needs no neighbors, m/s^2."""
        return ti.static(None)

    @ti.func
    def pair_acceleration(self, i, j, x_ij, gradient, weight):
        """Acceleration of i by its liquid neighbor j; gradient = V_j grad_i W_ij, weight = V_j W_ij."""
        return ti.static(None)

    @ti.func
    def wall_acceleration(self, i, b, x_ib, gradient, weight):
        """Acceleration of i by the wall particle b; gradient = V_b grad_i W_ib, weight = V_b W_ib."""
        return ti.static(None)

    @ti.func
    def friction(self, i):
        """Force of the wall on particle i over its velocity, that `correct_velocity` has counted with, kg/s."""
        return ti.static(None)

    @ti.func
    def implicit_viscosity(self, i):
        """Viscosity of particle i that `correct_velocity` has counted with, Pa s."""
        return ti.static(None)

    # State beside the particle fields, for checkpoints.

    def state(self) -> dict:
        """Arrays and numbers that a restart needs."""
        return {}

    def restore(self, state: dict) -> None:
        """Take up what `state` returned."""

    @ti.func
    def potential(self, i):
        """Pressure at particle i that this effect has taken out of the solve, Pa; added on output."""
        return ti.static(None)
