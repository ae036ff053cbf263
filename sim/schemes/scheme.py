"""The contract of a scheme: pressure and time integration, one file each.

A scheme is a frozen dataclass of its own parameters and a class that declares the particle fields it needs and
overrides the hooks below. The solver calls, in every step: `exchange` of the effects, the neighbor search, `measure`,
`prepare` of the effects, `step`, `finish` of the effects. Inside `step` the scheme calls `solver.accelerate(dt)`
(velocity += dt * accelerations of the effects) and `solver.correct_velocity(dt)` (implicit viscosity and the like)
where its algorithm has them, and moves the particles.
"""
import abc
import dataclasses
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from sim.backend import data_oriented, ti
from sim.effects import REGISTRY
from sim.fields import Field

if TYPE_CHECKING:  # the settings ask for the names of the schemes
    from sim.advice import Limit
    from sim.settings import Numerics, Settings


class _Refusals:
    """The effects that a scheme cannot run, with the reason: those that need what it lacks."""

    def __get__(self, _, scheme: type["Scheme"]) -> Mapping[str, str]:
        return MappingProxyType({effect.name: scheme.lacks[need] for effect in REGISTRY.values()
                                 for need in effect.needs & scheme.lacks.keys()})


@dataclasses.dataclass(frozen=True)
class NoParameters:
    """A scheme without parameters of its own."""


@data_oriented
class Scheme(abc.ABC):
    """Base of all schemes.

    Class attributes
    ----------------
    name : value of `numerics.scheme`.
    Parameters : frozen dataclass of the scheme's own parameters (``sim.parameters.parameter``).
    fields : particle fields of the scheme; `pressure` and `compression_rate` are two of them, for effects and frames.
    fills : what it can fill: "closed" a cavity without any free surface, "open" one with a free surface.
    lacks : what it cannot do that effects need (`Effect.needs`), with the reason.
    refuses : effects that it cannot run for that, with the reason.
    unread : fields of the numerics that it does not read -> what takes their place, in words.
    largest_density_ratio : of two liquids, up to which it was shown to work.
    largest_density_ratio_full : the same in a full cavity, where liquids cannot give way; None where it is the same.
    """

    name: str
    Parameters: type = NoParameters
    fields: tuple[Field, ...] = ()
    fills: tuple[str, ...] = ("closed", "open")
    lacks: Mapping[str, str] = MappingProxyType({})
    refuses = _Refusals()
    unread: Mapping[str, str] = MappingProxyType({})
    largest_density_ratio: float = float("inf")
    largest_density_ratio_full: float | None = None

    if TYPE_CHECKING:  # the fields are attributes
        def __getattr__(self, name: str) -> Any: ...

    def __init__(self, solver):
        self.solver = solver
        self.parameters = solver.settings.scheme or self.Parameters()
        self.spacing = solver.settings.numerics.particle_spacing
        self.search, self.walls = solver.search, solver.walls
        self.pairs, self.wall_pairs, self.wall_rows = self.search.pairs, self.search.wall_pairs, self.search.wall_rows
        self.count = solver.particles.count
        for name in ("position", "velocity", "velocity_at_start", "acceleration", "volume", "mass", "phase",
                     *(field.name for field in self.fields)):
            setattr(self, name, solver.particles.arrays[name])

    def meet(self, effects) -> None:
        """Take note of the effects, which the solver makes after the scheme."""

    @property
    def numerics(self) -> "Numerics":
        """The present numerics."""
        return self.solver.settings.numerics

    @classmethod
    def density_ratio_limit(cls, closed: bool, parameters: Any = None) -> float:
        """Largest ratio of densities that the scheme was shown to work with, in a full cavity or not, with its
        parameters, or with its defaults.
        """
        full = cls.largest_density_ratio_full
        return full if closed and full is not None else cls.largest_density_ratio

    @classmethod
    def time_step_limit(cls, settings) -> float:
        """Part of `stable_time_step` that follows from the settings alone, known before anything is compiled, s."""
        return float("inf")

    @classmethod
    def iteration_limit(cls, settings: "Settings") -> tuple[int, str]:
        """Most iterations of a pressure solve, and the key that sets them."""
        return settings.numerics.maximum_iterations, "numerics.maximum_iterations"

    @classmethod
    def expected_time_step_limit(cls, scales) -> "Limit | None":
        """The same where it follows from the speeds of a scene (``pipeline.advice``), an estimate."""
        return None

    @classmethod
    def with_longer_steps(cls, parameters, factor: float):
        """Parameters with a limit of the time step, known with the start only, times a factor; None: the defaults."""
        return parameters

    @classmethod
    def variant(cls, settings: "Settings") -> type["Scheme"]:
        """Class that runs a scene: a scheme may solve a full cavity and a free surface differently."""
        return cls

    @ti.func
    def kernel_sums(self, i):
        """Compression rate Gamma_i = sum of V_j W_ij, and S_i = sum of V_j grad_i W_ij, over liquid and wall: (K3) of
        docs/methods/kernels.md.
        """
        total = self.volume[i] * self.search.kernel.at_zero
        gradient = self.velocity[i] * 0.0
        for slot in range(self.pairs.count[i]):
            k = self.pairs.entry(i, slot)
            total += self.pairs.weight[k]
            gradient += self.pairs.gradient[k]
        for slot in range(self.wall_pairs.count[i]):
            k = self.wall_pairs.entry(i, slot)
            total += self.wall_pairs.weight[k]
            gradient += self.wall_pairs.gradient[k]
        return total, gradient

    @abc.abstractmethod
    def measure(self) -> None:
        """Compute what depends on positions only, once neighbor rows are known: at least `compression_rate`."""

    def set_rest_state(self) -> None:
        """Take what the start defines, after the first `measure`; who moves particles measures them again."""

    def stable_time_step(self) -> float:
        """Largest stable time step beside the limits by speed and acceleration, s."""
        return float("inf")

    @abc.abstractmethod
    def step(self, dt: float) -> dict[str, float]:
        """Advance velocity and position by dt; return statistics, with `pressure_iterations` among them."""

    def state(self) -> dict:
        """Arrays and numbers beside the carried fields that a restart needs."""
        return {}

    def restore(self, state: dict) -> None:
        """Take up what `state` returned."""
