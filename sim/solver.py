"""The solver: built from settings and arrays, advanced in time, exported and restored bit by bit."""
import dataclasses
import functools
import math
import time
from typing import TYPE_CHECKING, Any

import numpy as np

from sim import effects as effect_registry
from sim import schemes
from sim.accelerations import Accelerations
from sim.backend import data_oriented, device, real_numpy, sync, ti
from sim.diagnosis import Watcher, bad_number, described
from sim.effect_selection import without_idle
from sim.errors import OutOfRoom, RunError
from sim.fields import Field, ParticleStore
from sim.neighbor_rows import HEAD_ROOM
from sim.neighbor_search import NeighborSearch, corners
from sim.reductions import blocks, first, largest_of, last, partial_results, total_of
from sim.settings import Settings
from sim.signed_distance import SignedDistance
from sim.smoothing_kernels import KERNELS

BASE_FIELDS = (
    Field("id", "integer", "", "number of the particle, kept for life", carried=True),
    Field("phase", "integer", "", "index of the liquid", carried=True),
    Field("position", "vector", "m", "position", carried=True),
    Field("velocity", "vector", "m/s", "velocity", carried=True),
    Field("volume", "scalar", "m3", "rest volume V_i", carried=True),
    Field("mass", "scalar", "kg", "mass", carried=True),
    Field("acceleration", "vector", "m/s2", "sum of the accelerations other than pressure and implicit viscosity"),
    Field("velocity_at_start", "vector", "m/s", "velocity before the accelerations of the step"),
)

SPEED, ACCELERATION, SQUARES, CHANGE = range(4)  # what `Solver.largest` holds
STEP_NUMERICS = ("courant_number", "maximum_time_step", "minimum_time_step", "time_step")  # read before every step
COINCIDENT_SHIFT = 0.01  # of a particle that starts where another one is, in particle spacings


def capacity_for(count: int, head_room: float = HEAD_ROOM) -> int:
    """Particles that fit into a solver that starts with `count`: head room for those that an injection splits."""
    return int((1.0 + 0.4 * (head_room - 1.0)) * count) + 512


class Divergence(RunError):
    """The run went bad; the message names step, particle and quantity."""


@data_oriented
class Solver:
    """Multiphase SPH in a closed cavity.

    Parameters
    ----------
    settings : liquids, numerics and effects; of these, those that do nothing are left out, and `notes` says why.
    fluid_position, fluid_volume, fluid_phase : (n, d), (n,), (n,) arrays of the liquid particles, SI.
    wall_position, wall_volume, wall_depth : (m, d), (m,), (m,) arrays of the wall particles, SI.
    sdf_values, sdf_origin, sdf_cell : signed distance of the cavity, negative inside.
    cavity_volume : m^3 (m^2 in 2D).
    fluid_velocity : (n, d), m/s; at rest without it.
    head_room : neighbors that fit, over those at rest density everywhere; other arrays grow with it.
    """

    if TYPE_CHECKING:  # fields of the particles, and the effects that have a hook
        def __getattr__(self, name: str) -> Any: ...

    def __init__(self, settings: Settings, *, fluid_position, fluid_volume, fluid_phase, wall_position, wall_volume,
                 wall_depth, sdf_values, sdf_origin, sdf_cell, cavity_volume, fluid_velocity=None, head_room=HEAD_ROOM):
        given = {type(p) for p in settings.effects}
        settings, self.notes = without_idle(settings)
        self.settings = settings
        numerics = settings.numerics
        self.dimension = settings.dimension
        self.spacing = numerics.particle_spacing
        self.cavity_volume = float(cavity_volume)
        self.liquids = settings.liquids
        self.rest_volume = float(np.mean(fluid_volume))
        self.support_radius = numerics.support_ratio * self.spacing
        self.kernel = KERNELS[numerics.kernel](self.support_radius, self.dimension)
        self.distance = SignedDistance(np.asarray(sdf_values), sdf_origin, sdf_cell)
        self.head_room = head_room
        self.time, self.step_count, self.next_id = 0.0, 0, len(fluid_position)
        self.statistics: dict[str, float] = {}
        self.seconds: dict[str, float] = {}  # by the clock, of every timed part
        self.cpu_seconds: dict[str, float] = {}  # of all cores
        self.watcher: Watcher | None = None
        self.on_gpu = device() != "cpu"

        order = [type(p) for p in settings.effects]
        classes = [c for c in effect_registry.REGISTRY.values() if c.Parameters in order]
        present = {c.name for c in effect_registry.REGISTRY.values() if c.Parameters in given}
        for c in classes:
            for needed in c.requires:
                if needed not in present:
                    raise ValueError(f"effect '{c.name}' needs effect '{needed}', which is not active")
            if any(settings.periods) and not c.periodic:
                raise ValueError(f"effect '{c.name}' cannot cross the ends of a periodic axis (settings.periods)")
        scheme = schemes.REGISTRY[numerics.scheme].variant(settings)
        capacity = capacity_for(len(fluid_position), head_room)
        self.particles = ParticleStore(BASE_FIELDS, capacity, self.dimension, len(self.liquids))
        reach = np.asarray(wall_depth) < self.support_radius  # others never meet liquid
        walls = (np.asarray(wall_position)[reach], np.asarray(wall_volume)[reach], np.asarray(wall_depth)[reach])
        self.search = NeighborSearch(self.particles, walls, self.kernel, *corners(walls[0], settings.periods),
                                     self.spacing, head_room, settings.periods)
        self.pairs, self.wall_pairs, self.walls = self.search.pairs, self.search.wall_pairs, self.search.walls
        for name in ("position", "velocity", "velocity_at_start", "acceleration"):
            setattr(self, name, self.particles.arrays[name])
        self.count = self.particles.count
        self.largest = ti.field(ti.f64, shape=4)
        self.partial = partial_results(2)
        self._set_particles(fluid_position, fluid_volume, fluid_phase, fluid_velocity)
        # Taichi finds a compiled kernel again only where its fields have the numbers that they had. In this order, the
        # kernels above are those of every scheme, and those of a scheme the same whatever effects there are.
        self.particles.add(scheme.fields)
        self.scheme = scheme(self)
        sync()
        self.particles.add(f for c in classes for f in c.fields)
        parameters = {type(p): p for p in settings.effects}
        self.turning = [(c, parameters[c.Parameters]) for c in classes if c.overrides("into_eye")]
        self.effects = []
        for c in classes:
            self.effects.append(c(parameters[c.Parameters], self))
        self.scheme.meet(self.effects)
        for hook in ("body_acceleration", "pair_acceleration", "wall_acceleration", "potential"):
            setattr(self, f"{hook}_effects",
                    [e for e in self.effects if e.overrides(hook) and hook not in e.unused_hooks])
        self.accelerations = Accelerations(self, self.effects)
        self.prepare_rest_state()

    def _set_particles(self, position, volume, phase, velocity):
        n = len(position)
        self.count[None] = n
        density = np.array([liquid.density for liquid in self.liquids])
        for name, values in (("id", np.arange(n)), ("phase", phase), ("position", position), ("volume", volume),
                             ("mass", np.asarray(volume) * density[np.asarray(phase)]),
                             ("velocity", np.zeros_like(position) if velocity is None else velocity)):
            self.particles.from_numpy(name, values)

    def prepare_rest_state(self) -> None:
        """Take the present particles as the start: what the scheme measures at rest."""
        self._part_coincident()
        self.search.sort()
        self.search.build()
        self.scheme.measure()
        self.scheme.set_rest_state()

    def _part_coincident(self):
        """Move particles off the very place of another one: no force of a pair has a direction there."""
        position = self.particles.to_numpy("position")
        _, first = np.unique(position, axis=0, return_index=True)
        if len(first) == len(position):
            return
        again = np.setdiff1d(np.arange(len(position)), first)
        direction = np.random.default_rng(again).normal(size=(len(again), self.dimension))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        position[again] += COINCIDENT_SHIFT * self.spacing * direction
        self.particles.from_numpy("position", position)

    @ti.kernel
    def _largest_values(self):
        n = self.count[None]
        for block in range(blocks(n)):
            speed = ti.cast(0.0, ti.f64)
            total = ti.cast(0.0, ti.f64)
            for i in range(first(block, n), last(block, n)):
                v2 = ti.cast(self.velocity[i].norm_sqr(), ti.f64)
                speed = ti.max(speed, v2)
                total += v2
            self.partial[0, block] = speed
            self.partial[1, block] = total
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.largest[SPEED] = ti.sqrt(largest_of(self.partial, 0, n))
            self.largest[SQUARES] = total_of(self.partial, 1, n)

    @ti.kernel
    def _largest_accelerations(self, dt: float):
        """Of the effects, and of what particles have really done of it once pressure and viscosity have answered."""
        n = self.count[None]
        for block in range(blocks(n)):
            largest = ti.cast(0.0, ti.f64)
            done = ti.cast(0.0, ti.f64)
            for i in range(first(block, n), last(block, n)):
                a2 = ti.cast(self.acceleration[i].norm_sqr(), ti.f64)
                change = ti.cast((self.velocity[i] - self.velocity_at_start[i]).norm_sqr(), ti.f64) / (dt * dt)
                largest = ti.max(largest, a2)
                done = ti.max(done, ti.min(a2, change))
            self.partial[0, block] = largest
            self.partial[1, block] = done
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.largest[ACCELERATION] = ti.sqrt(largest_of(self.partial, 0, n))
            self.largest[CHANGE] = ti.sqrt(largest_of(self.partial, 1, n))

    @ti.kernel
    def _accelerate(self, dt: float):
        for i in range(self.count[None]):
            self.acceleration[i] = self.accelerations.of(i)
        for i in range(self.count[None]):
            self.velocity_at_start[i] = self.velocity[i]
            self.velocity[i] += dt * self.acceleration[i]

    def stable_time_step(self) -> float:
        """Smallest limit of the motion, of the scheme and of the active effects, s (docs/methods/time_step.md)."""
        return min(self.time_step_of_motion(), self.scheme.stable_time_step(),
                   *(effect.stable_time_step() for effect in self.effects if effect.overrides("stable_time_step")))

    def time_step_of_motion(self) -> float:
        """Limit by what the particles do, and the largest step, s."""
        numerics = self.settings.numerics
        speed, change = self.largest[SPEED], self.largest[CHANGE]
        limits = [numerics.maximum_time_step]
        if speed > 0.0:
            limits.append(numerics.courant_number * self.spacing / speed)  # (A1)
        if change > 0.0:
            limits.append(0.5 * (self.spacing / change) ** 0.5)  # (A2)
        if self.step_count == 0:  # no acceleration was measured yet
            limits += [0.5 * (self.spacing / e.largest_acceleration()) ** 0.5 for e in self.effects
                       if e.largest_acceleration() > 0.0]
        return min(limits)

    def set_time_steps(self, **values: Any) -> None:
        """Change numerics that are read before every step (`STEP_NUMERICS`); all others are compiled into kernels.

        Raises
        ------
        ValueError
            Another one is named.
        """
        if fixed := values.keys() - set(STEP_NUMERICS):
            raise ValueError(f"{', '.join(sorted(fixed))} cannot change once the solver is built, only "
                             f"{', '.join(STEP_NUMERICS)} can")
        self.settings = dataclasses.replace(self.settings, numerics=dataclasses.replace(self.settings.numerics,
                                                                                        **values))

    # What effects say of the scene as a whole, in whatever order they were made.

    def into_eye(self, vector: np.ndarray, time: float) -> np.ndarray:
        """A vector (3,) given in the axes of the head, in those of the eye."""
        for effect, parameters in self.turning:
            vector = effect.into_eye(parameters, vector, time)
        return vector

    def gravity(self, time: float | None = None) -> np.ndarray:
        """Acceleration (dimension,) of the whole scene, at the present time without another one, m/s^2."""
        return self._sum_of("gravity_at", self.time if time is None else time, self.dimension)

    def weight(self, time: float | None = None) -> np.ndarray:
        """The same (3,) without jolts."""
        return self._sum_of("weight_at", self.time if time is None else time, 3)

    def down(self, time: float) -> np.ndarray:
        """Direction (3,) of the weight; that of a head held upright without one."""
        directions = (effect.down_at(time) for effect in self.effects)
        return next((one for one in directions if one is not None), np.array([0.0, -1.0, 0.0]))

    @property
    def reference_density(self) -> float:
        """Density whose weight is taken out of the solve, kg/m^3."""
        return max((effect.reference_density for effect in self.effects), default=0.0)

    def _sum_of(self, hook: str, time: float, length: int) -> np.ndarray:
        found = [getattr(effect, hook)(time) for effect in self.effects if effect.overrides(hook)]
        return functools.reduce(np.add, found) if found else np.zeros(length)

    def _time_step(self) -> float:
        """The fixed time step or the largest stable one, s."""
        stable, fixed = self.stable_time_step(), self.settings.numerics.time_step
        if fixed is not None and fixed > (1.0 + 1e-6) * stable:
            raise Divergence(f"step {self.step_count}: the fixed time step of {fixed:.3g} s (numerics.time_step) is "
                             f"above the largest stable one, {stable:.3g} s; {self._largest_in_words()}")
        return stable if fixed is None else fixed

    def _largest_in_words(self) -> str:
        """Largest speed, with its particle, and largest acceleration."""
        speeds = np.linalg.norm(self.particles.to_numpy("velocity").astype(float), axis=1)
        words = f"largest speed {self.largest[SPEED]:.3g} m/s"
        if self.largest[SPEED] > 0.0:
            words += f" of {described(self, int(np.argmax(speeds)))}"
        words += f", largest acceleration {self.largest[ACCELERATION]:.3g} m/s2"
        return words + (f"; {self.watcher.gain_in_words}" if self.watcher and self.watcher.gain_in_words else "")

    def timed(self, name, function, *arguments):
        start, cpu_start = time.perf_counter(), time.process_time()
        result = function(*arguments)
        if self.on_gpu:  # else the time would count for the next part that waits
            sync()
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start
        self.cpu_seconds[name] = self.cpu_seconds.get(name, 0.0) + time.process_time() - cpu_start
        if self.watcher:
            self._stop_if(self.watcher.look(f"the part '{name}'"))
        return result or {}

    def _stop_if(self, found: str) -> None:
        if found:
            raise Divergence(f"step {self.step_count}, from {self.time:.6g} s on: {found}")

    def _run(self, hook: str, *arguments) -> dict:
        """Call a host hook of every effect that has it, each on its own timing row."""
        statistics = {}
        for effect in self.effects:
            if effect.overrides(hook):
                statistics |= self.timed(effect.name, getattr(effect, hook), *arguments)
        return statistics

    def step(self, largest_step: float = float("inf"), until: float = float("inf")) -> float:
        """Advance by one time step of at most `largest_step`; return the step taken, s.

        It is shortened to one of equal steps to the time `until`, s: no sliver of a step before a frame.

        Raises
        ------
        Divergence
            When a speed is no longer finite or the time step falls below the smallest allowed.
        """
        self.timed("time step", self._largest_values)
        self._check()
        dt, remaining = min(self._time_step(), largest_step), until - self.time
        if dt < self.settings.numerics.minimum_time_step and dt < min(largest_step, remaining):
            raise Divergence(f"step {self.step_count}: the time step fell to {dt:.3g} s, below "
                             f"{self.settings.numerics.minimum_time_step:.3g} s (numerics.minimum_time_step); "
                             f"{self._largest_in_words()}")
        if math.isfinite(remaining):
            dt = remaining / max(1, math.ceil(remaining / dt - 1e-9))
        try:
            statistics = self._step_by(dt)
        except (ValueError, ArithmeticError, IndexError) as error:  # what NumPy and Python make of a nan
            if not isinstance(error, OverflowError):
                self.check_finite()
            raise
        self.timed("time step", self._largest_accelerations, dt)
        self.time += dt
        self.step_count += 1
        self.statistics = {"time_step": dt, **statistics}
        return dt

    def _step_by(self, dt: float) -> dict[str, float]:
        self._run("exchange", dt)
        self.timed("neighbors", self.search.sort)
        self.timed("neighbors", self.search.build)
        self.timed("pressure", self.scheme.measure)
        self._run("prepare", dt)
        statistics = self.scheme.step(dt)
        return statistics | self._run("finish", dt)

    def accelerate(self, dt: float) -> None:
        """Add the accelerations of the effects to the velocity."""
        if self.watcher:
            self._stop_if(self.watcher.look_at_accelerations())
        self.timed("accelerations", self._accelerate, dt)

    def correct_velocity(self, dt: float) -> dict[str, float]:
        """Let effects change the velocity as a whole (implicit viscosity and the like); return their statistics."""
        return self._run("correct_velocity", dt)

    def largest_speed(self) -> float:
        """Largest speed of the present state, m/s."""
        self.timed("time step", self._largest_values)
        return self.largest[SPEED]

    def _check(self):
        if not np.isfinite(self.largest[SQUARES]):
            self.check_finite()

    def check_finite(self) -> None:
        """Look at every number that a checkpoint or frame would hold.

        Raises
        ------
        Divergence
            One of them is not finite; the message names the particle.
        """
        found = bad_number(self)
        if found:
            name, row, count = found
            raise Divergence(f"step {self.step_count}: the {name.replace('_', ' ')} of {described(self, row)} is not "
                             f"finite, and that of {count - 1} more particles")

    def replay(self, state: dict, until: float) -> None:
        """Repeat the steps from a state on, and look after every part of them; slow.

        Raises
        ------
        Divergence
            What goes bad, with the part of the step in which it does.
        """
        self.restore(state)
        self.watcher = Watcher(self)
        try:
            for _ in self.advance(until):
                pass
            self.check_finite()
        finally:
            self.watcher = None

    def advance(self, until: float):
        """Advance to the time `until`, s, exactly; yields after every step."""
        while self.time < until:
            dt = self.step(until=until)
            if until - self.time < 1e-9 * self.settings.numerics.maximum_time_step:
                self.time = until
            yield dt

    def prepare_output(self) -> None:
        """Compute what a snapshot before the first step needs: the potentials of the effects."""
        self._run("prepare", 0.0)

    def state(self) -> dict:
        """Everything a restart needs, bit by bit."""
        arrays = {f"particles.{f.name}": self.particles.to_numpy(f.name)
                  for f in self.particles.declared.values() if f.carried}
        state = {"time": self.time, "step_count": self.step_count, "next_id": self.next_id,
                 "largest_speed": self.largest[SPEED], "largest_acceleration": self.largest[ACCELERATION],
                 "largest_change": self.largest[CHANGE], **arrays}
        state |= {f"scheme.{key}": value for key, value in self.scheme.state().items()}
        for effect in self.effects:
            state |= {f"{effect.name}.{key}": value for key, value in effect.state().items()}
        return state

    def restore(self, state: dict) -> None:
        """Take up a state; an effect whose fields it lacks (new to this scene) starts from the particles.

        Raises
        ------
        ValueError
            The state holds a mixture, and no effect here keeps volume fractions.
        OutOfRoom
            It has more particles than fit.
        """
        fractions = state.get("particles.volume_fraction")
        if (fractions is not None and "volume_fraction" not in self.particles.arrays
                and ((fractions > 0.0) & (fractions < 1.0)).any()):
            raise ValueError("its liquids are mixed, so the scene needs an effect that keeps mixtures, such as "
                             "effects.diffusion with coefficient 0")
        self.time, self.step_count = float(state["time"]), int(state["step_count"])
        self.next_id = int(state["next_id"])
        if len(state["particles.id"]) > self.particles.capacity:
            raise OutOfRoom(f"the state has {len(state['particles.id'])} particles where {self.particles.capacity} fit")
        self.count[None] = len(state["particles.id"])
        for field in self.particles.declared.values():
            if f"particles.{field.name}" in state:
                self.particles.from_numpy(field.name, state[f"particles.{field.name}"])
        self.scheme.restore({k[7:]: v for k, v in state.items() if k.startswith("scheme.")})
        for effect in self.effects:
            missing = {f.name for f in effect.fields if f.carried and f"particles.{f.name}" not in state}
            if missing:
                effect.start(missing)
            prefix = f"{effect.name}."
            effect.restore({k[len(prefix):]: v for k, v in state.items() if k.startswith(prefix)})
        self.search.sort()  # as the next step would
        self.search.build()
        self.scheme.measure()
        self.acceleration.fill(0.0)  # what a run that went bad has left
        self._largest_values()
        # Those of the last step, which the next one is chosen by: not always the speeds that it has ended with.
        for place, name in ((SPEED, "speed"), (ACCELERATION, "acceleration"), (CHANGE, "change")):
            self.largest[place] = float(state[f"largest_{name}"])

    @ti.kernel
    def _total_pressure(self, total: ti.types.ndarray()):
        for i in range(self.count[None]):
            p = self.particles.arrays["pressure"][i]
            for effect in ti.static(self.potential_effects):
                p += effect.potential(i)
            total[i] = p

    def snapshot(self) -> dict[str, np.ndarray]:
        """Arrays of the present state, sorted by id, SI.

        id, phase, position, velocity, volume, mass, compression_rate as in the fields; pressure with the potentials
        that effects keep out of the solve; volume_fraction (n, liquids), 0 or 1 where nothing mixes.
        """
        names = ("id", "phase", "position", "velocity", "volume", "mass", "compression_rate")
        arrays = {name: self.particles.to_numpy(name) for name in names}
        arrays["pressure"] = np.zeros(self.count[None], dtype=real_numpy())
        self._total_pressure(arrays["pressure"])
        if "volume_fraction" in self.particles.arrays:
            arrays["volume_fraction"] = self.particles.to_numpy("volume_fraction")
        else:
            arrays["volume_fraction"] = np.eye(len(self.liquids), dtype=real_numpy())[arrays["phase"]]
        order = np.argsort(arrays["id"])
        return {name: values[order] for name, values in arrays.items()}

    def bytes(self) -> int:
        """Memory of particle fields and neighbor rows."""
        rows = (self.pairs, self.wall_pairs, self.search.wall_rows)
        return self.particles.bytes() + sum(r.bytes() for r in rows)
