"""Tanks for studies: the solver in a simple cavity, run to an end while something is measured.

A run that goes bad is a measurement as well: it is reported with the time that it reached.
"""
import dataclasses
import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from pipeline.base.progress import progress
from pipeline.cavity.shapes import shape_arrays
from pipeline.studies.model import COMPUTING_TIME, WALL_TIME, Row
from sim import schemes
from sim.effects import REGISTRY
from sim.errors import RunError
from sim.packing import pack
from sim.parameters import parameter
from sim.settings import Liquid, Numerics, Settings
from sim.solver import Solver
from sim.time_step import known_limits

PACKING_STEPS = 150
# Disorder before packing, in particle spacings: a lattice by itself stays one. By the smaller one half of its order is
# left between flat walls in two dimensions, by the larger one nothing.
JITTER = {"packed": 0.3, "disordered": 1.0}
COMPILING = 3  # steps in which kernels are still compiled
FASTER = 50  # a run may take this many times the steps of the largest time step before it is given up
_NUMERICS = {field.name: field.metadata for field in dataclasses.fields(Numerics)}


@dataclasses.dataclass(frozen=True)
class TankParameters:
    """What every family of tanks has in common."""

    scheme: str = parameter(Numerics.scheme, choices=_NUMERICS["scheme"]["choices"],
                            meaning="pressure solve and time integration")
    kernel: str = parameter("wendland_c2", choices=_NUMERICS["kernel"]["choices"], meaning="smoothing kernel")
    support_ratio: float = parameter(3.0, minimum=2.0, maximum=4.0,
                                     meaning="support radius of the kernel in particle spacings")
    resolutions: tuple[int, ...] = parameter((16, 32, 64), minimum=4,
                                             meaning="particles along the length of the case, coarse to fine")
    largest_step: float = parameter(0.1, exclusive_minimum=0.0, meaning="largest time step in sqrt(spacing / g)")
    tolerance_factor: float = parameter(1.0, exclusive_minimum=0.0,
                                        meaning="tolerances of the solves, over those that the case takes")
    time_step_factor: float = parameter(1.0, exclusive_minimum=0.0, maximum=8.0,
                                        meaning="largest time step, over the one that the case takes; limits of the "
                                                "scheme and of effects hold all the same")
    precision: str = parameter("f64", choices=_NUMERICS["precision"]["choices"],
                               meaning="floating point format of the fields")


@dataclasses.dataclass(frozen=True)
class PackedParameters(TankParameters):
    """What tanks have in common whose particles are packed from disorder: another seed is another start."""

    seed: int = parameter(0, minimum=0, meaning="of the disorder before the packing of the start")


def cavity(kind: str, size: ArrayLike, spacing: float, *, start: str = "regular",
           support_ratio: float = 3.0, dimension: int = 2, seed: int = 0,
           periodic: Sequence[int] = ()) -> dict[str, np.ndarray]:
    """Return the arrays of a cavity.

    Parameters
    ----------
    start : "regular": a box is a perfect lattice and a circle is packed; "packed", "disordered": both are packed from
        disorder, which in the first leaves a box some order of the lattice.
    seed : of that disorder.
    periodic : axes along which a box has no walls but repeats itself.
    """
    arrays = shape_arrays(kind, size, spacing, dimension=dimension, periodic=periodic)
    return arrays if kind == "box" and start == "regular" else packed(arrays, start, support_ratio, seed)


def packed(arrays: dict[str, np.ndarray], start: str, support_ratio: float, seed: int) -> dict[str, np.ndarray]:
    """Return the arrays of a cavity with their particles packed, from the disorder of a start of :func:`cavity`."""
    position, spacing = arrays["fluid_position"], float(arrays["particle_spacing"])
    if start in JITTER:
        position = position + JITTER[start] * spacing * np.random.default_rng(seed).uniform(-1.0, 1.0, position.shape)
    position, _ = pack(position, arrays["fluid_volume"], arrays["wall_position"], arrays["wall_volume"], spacing,
                       support_ratio, PACKING_STEPS, tuple(arrays.get("periods", ())))
    return arrays | {"fluid_position": position}


def build(case: TankParameters, arrays: dict[str, np.ndarray], *, liquids: Sequence[Liquid],
          effects: dict[str, dict[str, Any]], phase: Callable = lambda x: np.zeros(len(x)),
          velocity: Callable | None = None, filled: Callable | None = None, scheme_parameters: object = None,
          **numerics) -> Solver:
    """Return the solver of a case; functions of the positions, (n, 2) -> (n,) or (n, 2), describe the start.

    Parameters
    ----------
    effects : name -> parameters.
    filled : where there is liquid; without it the cavity is full, and has no free surface.
    scheme_parameters : of the scheme; its defaults without them.
    numerics : further keys of ``Numerics``.
    """
    position, volume = arrays["fluid_position"], arrays["fluid_volume"]
    if filled is not None:
        keep = filled(position)
        position, volume = position[keep], volume[keep]
    settings = changed(case, Settings(
        dimension=position.shape[1], liquids=tuple(liquids), closed=filled is None, scheme=scheme_parameters,
        periods=tuple(arrays.get("periods", ())),
        effects=tuple(REGISTRY[name].Parameters(**values) for name, values in effects.items()),
        numerics=Numerics(particle_spacing=float(arrays["particle_spacing"]), scheme=case.scheme, kernel=case.kernel,
                          support_ratio=case.support_ratio, precision=case.precision, **numerics)))
    return Solver(settings, fluid_position=position, fluid_volume=volume, fluid_phase=phase(position).astype(int),
                  fluid_velocity=None if velocity is None else velocity(position),
                  **{name: arrays[name] for name in ("wall_position", "wall_volume", "sdf_values", "sdf_origin",
                                                     "sdf_cell", "cavity_volume")}, wall_depth=arrays["wall_distance"])


def scene_solver(case: TankParameters, scene, spacing: float) -> Solver:
    """Return the solver of a scene of the eye with the numerics of a case and a particle spacing, m."""
    from pipeline.cavity.surface import cavity_mesh
    from pipeline.cavity.voxels import voxelize
    from pipeline.simulation.solver_setup import build_solver

    numerics = dataclasses.replace(scene.numerics, particle_spacing=spacing, support_ratio=case.support_ratio,
                                   scheme=case.scheme, kernel=case.kernel, precision=case.precision, threads=0)
    settings = changed(case, dataclasses.replace(scene, numerics=numerics).settings())
    scene = dataclasses.replace(scene, numerics=settings.numerics)
    return build_solver(scene, voxelize(scene, cavity_mesh(scene.eye)[0])[0])


def changed(case: TankParameters, settings: Settings) -> Settings:
    """The settings of a case with its factors on tolerances and time step.

    The time step is bounded by its smallest limit that is known before the run times the factor; a scheme that chooses
    a limit later has a factor of its own.
    """
    numerics, scheme = settings.numerics, settings.scheme
    step = numerics.maximum_time_step
    if case.time_step_factor != 1.0:
        step = case.time_step_factor * min(known_limits(settings).values())
        scheme = settings.scheme_class.with_longer_steps(scheme, case.time_step_factor)
    return dataclasses.replace(settings, scheme=scheme, numerics=dataclasses.replace(
        numerics, maximum_time_step=step, pressure_tolerance=case.tolerance_factor * numerics.pressure_tolerance,
        viscosity_tolerance=case.tolerance_factor * numerics.viscosity_tolerance))


@dataclasses.dataclass
class Run:
    """A run and what was watched: columns of ``history`` are what ``watch`` gave after every step, and ``time``.

    ``seconds`` are those of the steps without compilation, on the clock and of all cores.
    """

    solver: Solver
    until: float
    label: str
    history: dict[str, np.ndarray]
    iterations: float
    wall_s: float
    failure: str
    seconds: tuple[float, float] = (math.nan, math.nan)

    def rows(self) -> list[Row]:
        """Rows that every run has: whether it reached its end, steps and iterations."""
        common: dict[str, Any] = {"at": self.label, "wall_s": self.wall_s}
        missing = 0.0 if not self.failure else 1.0 - self.solver.time / self.until
        return [Row("time reached", self.solver.time, "s", reference=self.until, error=missing, tolerance=0.0,
                    relative=True, **common),
                Row("particles", float(self.solver.count[None]), **common),
                Row("time steps", float(self.solver.step_count), **common),
                Row("pressure iterations per step", self.iterations, **common), *time_rows(self.seconds, **common)]

    def remarks(self, case: str) -> list[str]:
        """Why the run ended early, if it did."""
        return [f"{case} {self.label} ended at {self.solver.time:.4g} s of {self.until:.4g} s: {self.failure}."
                ] if self.failure else []

    def values(self, name: str) -> np.ndarray:
        """What was watched under a name; nan alone when the run failed, so that no later number can hold."""
        return np.array([np.nan]) if self.failure else self.history[name]


def advance(solver: Solver, until: float, label: str, watch: Callable[[Solver], dict[str, float]]) -> Run:
    """Run to a time, s, and watch every step."""
    rows: list[dict[str, float]] = [{"time": 0.0, **watch(solver)}]
    iterations, failure, begin, stopwatch = [], "", time.perf_counter(), Stopwatch()
    most = FASTER * int(np.ceil(until / solver.settings.numerics.maximum_time_step)) + 10000
    with progress(until, label, unit="second") as bar:
        try:
            for dt in stopwatch.timed(solver.advance(until)):
                iterations.append(solver.statistics["pressure_iterations"])
                rows.append({"time": solver.time, **watch(solver)})
                bar.set_postfix_str(f"dt {dt:.3g} s")
                bar.update(dt)
                if solver.step_count > most:
                    failure = f"{most} steps were not enough"
                    break
        except (RunError, OverflowError) as error:
            failure = str(error)
    history = {name: np.array([row[name] for row in rows]) for name in rows[0]}
    return Run(solver, until, label, history, float(np.mean(iterations or [0.0])), time.perf_counter() - begin,
               failure, stopwatch.seconds())


class Stopwatch:
    """Seconds of repeated work, without those in which its kernels are compiled."""

    def __init__(self):
        self._taken: list[tuple[float, float]] = []

    def timed(self, steps: Iterable) -> Iterator:
        """Pass steps on; what is done between them does not count."""
        steps = iter(steps)
        while True:
            begin = time.perf_counter(), time.process_time()
            try:
                step = next(steps)
            except StopIteration:
                return
            self._taken.append((time.perf_counter() - begin[0], time.process_time() - begin[1]))
            yield step

    def seconds(self) -> tuple[float, float]:
        """Seconds on the clock and of all cores: the first steps count as the mean of the others."""
        later = self._taken[COMPILING:]
        if not later:
            return math.nan, math.nan
        wall, cpu = (len(self._taken) * float(np.mean(column)) for column in np.transpose(later))
        return wall, cpu


def time_rows(seconds: tuple[float, float], **common) -> list[Row]:
    """Rows of the time that the steps took."""
    return [Row(WALL_TIME, seconds[0], "s", **common), Row(COMPUTING_TIME, seconds[1], "s", **common)]


def field(solver: Solver, name: str) -> np.ndarray:
    """Return a field of the particles in double precision."""
    return solver.particles.to_numpy(name).astype(float)


def film_exchanges(solver: Solver) -> float:
    """Exchanges of places by which film slid in the last step; 0 before the first, and where none slides."""
    return solver.statistics.get("film_exchanges", 0.0)


def motion(solver: Solver) -> dict[str, float]:
    """Kinetic energy, J/m, root mean square speed, m/s, and height of the center of mass, m."""
    mass, velocity, position = (field(solver, name) for name in ("mass", "velocity", "position"))
    square = (velocity**2).sum(axis=1)
    return {"kinetic_energy": float(0.5 * mass @ square), "speed": float(np.sqrt(square.mean())),
            "height": float(mass @ position[:, 1] / mass.sum())}


def fills(scheme: str) -> tuple[str, ...]:
    """What a scheme can fill: "closed", "open" or both."""
    return schemes.REGISTRY[scheme].fills
