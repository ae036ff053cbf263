"""The contract of an effect.

An effect is one file: a frozen dataclass of parameters (``sim.parameters.parameter``: the one source for validation,
schema and documentation) and a class that declares the particle fields it reads and adds, and overrides only the
hooks it uses. The solver collects, per hook, the effects that override it; a hook that none overrides is neither
compiled nor run.

All that is known of an effect is in its file: what a scene with it must be like (`checks`), what it makes of a scene
(`advice` and its numbers), of the time step, of memory, of the course of a run and of what is measured. Nothing else
knows it by name: what others must know of it, it declares in the words below.
"""
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from sim.advice import Advice, Limit, Quantity
from sim.backend import data_oriented, ti
from sim.fields import Field
from sim.measures import Measure

# What an effect can do that others, or a stage, must know of.
SHEARS = "applies the shear stress"
RESISTS = "resists with the viscosity of the liquids, by a force"
MIXES = "mixes liquids"
PULLS = "pulls the interface together as a whole"
REMEMBERS = "keeps a stress in particles"
WEIGHS = "gives liquids a weight"
GROWTH = "volumes that grow and shrink"  # what an effect can need of a scheme (`Effect.needs`)


@data_oriented
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
    does : what it does that others must know of, in the words above.
    excludes : what no other effect of a scene may do beside it, with the reason.
    needs : what a scheme must be able to do (`Scheme.lacks`).
    fewest_liquids : liquids that a scene must have for it.
    traces : liquids of it that have no interface of their own, for they are too little.
    inside : parameters that are points inside the cavity.
    turns_eye : whether the wall moves in the head.
    reference_density : whose weight it takes out of the solve, kg/m^3.
    solves : name of the iterative solve that it adds, in statistics; empty without one.
    checks : functions that yield the key and the message of what is wrong in a scene. Their arguments name what they
        look at: `parameters`, the fields of a scene, `closed`, `bulk_liquids`, and `fill` with `begins`
        (``pipeline.scenes.checks``).
    doubts : functions of the same kind that yield what a scene may say but hardly means; they can ask for all fields of
        a scene, for `oil`, the name of the liquid in the place of the oil, and for `down`, (3,) or None.
    measures : numbers of every frame that it knows.
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
    does: frozenset[str] = frozenset()
    excludes: Mapping[str, str] = MappingProxyType({})
    needs: frozenset[str] = frozenset()
    fewest_liquids: int = 1
    traces: int = 0
    inside: tuple[str, ...] = ()
    turns_eye: bool = False
    reference_density: float = 0.0
    solves: str = ""
    checks: tuple[Callable[..., Iterator[tuple[tuple, str]]], ...] = ()
    doubts: tuple[Callable[..., Iterator[tuple[tuple, str]]], ...] = ()
    measures: tuple[Measure, ...] = ()

    if TYPE_CHECKING:  # what single effects have beside
        def __getattr__(self, name: str) -> Any: ...

    def __init__(self, parameters, solver):
        self.parameters = parameters
        self.solver = solver
        self.particles = solver.particles.view(self.name, [f.name for f in self.fields] + list(self.uses))

    @classmethod
    def overrides(cls, hook: str) -> bool:
        """True where this effect has a hook of its own."""
        own, base = (getattr(one, hook) for one in (cls, Effect))
        return getattr(own, "__func__", own) is not getattr(base, "__func__", base)

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

    # What it says of a scene before it is run. `scales` are what is known of it then: lengths, speeds, liquids.

    @classmethod
    def advice(cls, parameters, scales, limits: Sequence[Limit]) -> Iterator[Advice]:
        """Whether it is seen in a scene; `parameters` is None in a scene without it, where it may be missing."""
        return iter(())

    @classmethod
    def speeds(cls, parameters, scales) -> Iterator[Quantity]:
        """Speeds that it can give the liquids, m/s, estimates from above."""
        return iter(())

    @classmethod
    def wall_speeds(cls, parameters, scales) -> Iterator[Quantity]:
        """Speeds of the wall that do not count as speeds of the liquids, m/s."""
        return iter(())

    @classmethod
    def omitted_acceleration(cls, parameters, scales) -> float:
        """Largest acceleration of the wall that it leaves out, m/s^2."""
        return 0.0

    @classmethod
    def numbers(cls, parameters, scales) -> Iterator[Quantity]:
        """Dimensionless numbers of it."""
        return iter(())

    @classmethod
    def time_scales(cls, parameters, scales) -> Iterator[Quantity]:
        """Times in which it acts, s."""
        return iter(())

    @classmethod
    def wave_speeds(cls, parameters, scales) -> Iterator[float]:
        """Speeds beside `speeds` that a compressible liquid has to be fast against, m/s: `expected_speeds` foretold."""
        return iter(())

    # Rules that need the parameters alone.

    @classmethod
    def weight_of(cls, parameters) -> float:
        """Acceleration of the whole scene by it, at rest, m/s^2."""
        return 0.0

    @classmethod
    def largest_weight_of(cls, parameters, dimension: int) -> float:
        """The same at its largest, m/s^2."""
        return 0.0

    @classmethod
    def down_at_start(cls, parameters) -> np.ndarray | None:
        """Direction (3,) of its weight at the start; None without one."""
        return None

    @classmethod
    def held(cls, parameters, duration: float) -> Iterable[tuple[float, float, np.ndarray, str]]:
        """Directions (3,) of its weight that are held within a duration, s: begin, end, direction and words for it."""
        return ()

    @classmethod
    def tension_of(cls, parameters) -> float:
        """Tension of the interface, N/m."""
        return 0.0

    @classmethod
    def contact_angle_of(cls, parameters) -> float | None:
        """Contact angle at the wall, measured through the first liquid, rad; None where it sets none."""
        return None

    @classmethod
    def pulls(cls, parameters) -> bool:
        """Whether it pulls an interface together."""
        return False

    @classmethod
    def into_eye(cls, parameters, vector: np.ndarray, time: float) -> np.ndarray:
        """A vector (3,) given in the axes of the head, in those of the eye."""
        return vector

    @classmethod
    def interface_oil(cls, parameters) -> str | None:
        """The liquid that is the oil; None where it does not know."""
        return None

    @classmethod
    def droplet_liquid(cls, parameters) -> str | None:
        """The liquid that is oil in droplets; None where it makes none."""
        return None

    @classmethod
    def transport_of_droplets(cls, parameters) -> float | None:
        """Factor by which it moves droplets through a liquid, 1 as they would; None where it does not."""
        return None

    @classmethod
    def brings(cls, parameters) -> tuple[str, ...]:
        """Liquids that it brings into the cavity."""
        return ()

    @classmethod
    def fill_at(cls, parameters, fill: dict[str, float], time: float = float("inf"), cavity_volume: float = 1.0
                ) -> dict[str, float]:
        """Share of the cavity that each liquid has at a time, s, after `fill` at the start; m^3."""
        return fill

    @classmethod
    def spans(cls, parameters, fill: dict[str, float] | None, cavity_volume: float
              ) -> Iterator[tuple[str, float, float]]:
        """Parts of a scene in which it makes steps differ: name, begin and end, s."""
        return iter(())

    @classmethod
    def events(cls, parameters, fill: dict[str, float], cavity_volume: float) -> Iterator[tuple[str, float, float]]:
        """What curves over time mark: words, begin and end, s, the same of a moment."""
        return cls.spans(parameters, fill, cavity_volume)

    # Memory.

    @classmethod
    def reals_per_node(cls, dimension: int) -> int:
        """Numbers per node of a grid that covers the cavity."""
        return 0

    @classmethod
    def reals_per_pair(cls, dimension: int) -> int:
        """Numbers per pair of neighbors."""
        return 0

    # Services of an effect to others, in any order of effects (``sim.solver.Solver``).

    def gravity_at(self, time: float) -> np.ndarray | None:
        """Acceleration (dimension,) of the whole scene at a time, m/s^2; None without one."""
        return None

    def weight_at(self, time: float) -> np.ndarray | None:
        """The same (3,) without jolts."""
        return None

    def down_at(self, time: float) -> np.ndarray | None:
        """Direction (3,) of that."""
        return None

    def largest_acceleration(self) -> float:
        """Largest acceleration that it gives any liquid before the first step, m/s^2."""
        return 0.0

    def expected_energy(self) -> float:
        """Energy that it can give liquid by a fall through the cavity, per mass, m^2/s^2."""
        return 0.0

    def expected_speeds(self) -> Iterator[float]:
        """Other speeds that it can give the liquids, m/s."""
        return iter(())

    def mix_ahead(self, seconds: float) -> None:
        """Act alone for so long, s, where that makes the start like a later moment; neighbor rows are there."""

    def state_at(self, time: float, volumes: dict[str, float], fill: dict[str, float]) -> dict:
        """State that it has at a time, s, at which each liquid has a volume, m^3, and `fill` was planned."""
        return {}

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

    def answer(self, push, answer, dt: float, tolerance: float) -> int:
        """Set `answer` to what implicit viscosity leaves of a change `push` of the velocity, both fields of vectors, at
        the positions of the last `correct_velocity`; return the iterations.
        """
        raise NotImplementedError

    def take_answer(self, push, answer, share: float, dt: float) -> None:
        """Take note that a share of an answer was added to the velocity."""

    def stiffness(self) -> tuple[float, float]:
        """Pressure over mu times the rate at which liquid is compressed, and K_ii over mu V on a lattice, 1/m^2, of the
        matrix M + dt K of `correct_velocity`.
        """
        raise NotImplementedError

    def finish(self, dt: float) -> dict[str, float] | None:
        """Change the state once the positions have moved; neighbor rows are those of the start of the step. May return
        statistics.
        """

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
    def viscous_mass(self, i):
        """Diagonal of the matrix M + dt K of particle i that `correct_velocity` has solved with, kg."""
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
