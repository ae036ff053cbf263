"""Hard cases: starts and events at which solvers fail, and what a run has to keep through them.

Every case is judged by the same limits (``Limits``), each with its reason. Many cases share one solver, which is put
back to its start in between: compiling its kernels takes longer than most of the runs.
"""
import dataclasses
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from pipeline.studies.model import Row
from sim.effects.gravity import Jolt, Turn
from sim.errors import RunError
from sim.settings import Liquid
from sim.solver import Solver
from sim.time_step import SMALL_STEP, step_at_rest
from studies.validation.kit.tank import TankParameters, build, cavity

GRAVITY = 9.81  # m/s^2
HEADS = {"closed": "full cavity", "open": "free surface"}
SIDE = 0.02  # m: diameter of the round cavity, side of the open box
SPACING = 1e-3  # m
AQUEOUS, OIL = Liquid("aqueous", 1005.0, 1e-3), Liquid("oil", 970.0, 1.0)
MOST_STEPS = 6000  # a run that takes more is given up
LEAST_SPEED = 0.06  # m/s, a tenth of free fall through the cavity: noise, where nothing sets the liquid in motion
MAXIMUM_STEP = 0.05  # s: beyond the limits by speed and acceleration
LOOKS = 100  # times that a run is looked at
OUTCOMES = HELD, DEGRADED, REFUSED, FAILED = "held", "degraded", "refused", "failed"


@dataclasses.dataclass(frozen=True)
class Limits:
    """What every run is held to.

    Attributes
    ----------
    speed : largest speed over what the case can give: start, fall through the cavity, jolts, capillary waves; liquid
        that is thrown together in a corner is faster.
    volume : change of any liquid's volume, relative to the volume of all; only round-off is allowed.
    fraction : volume fractions below 0, above 1, or their sum off 1.
    outside : particles beyond the wall's surface.
    energy : mechanical energy above that of the start, over the weight of the liquid times the size of the cavity, or
        the kinetic energy at the start where that is more; only asked where nothing does work.
    momentum : change of the momentum over the sum of the momenta's sizes; only asked without wall and weight.
    compression : largest sum of V_j W_ij, about 1 in a liquid at rest.
    """

    speed: float = 3.0
    volume: float = 1e-12
    fraction: float = 1e-12
    outside: float = 0.0
    energy: float = 1e-2
    momentum: float = 1e-10
    compression: float = 2.0


LIMITS = Limits()


class Tank:
    """A solver and its start, to which it can be put back."""

    def __init__(self, solver: Solver):
        self.solver = solver
        self._state, self._settings = solver.state(), solver.settings
        effects = {effect.name: effect for effect in solver.effects}
        self.gravity, self.viscosity = effects.get("gravity"), effects.get("viscosity_implicit")
        self._gravity = self.gravity.parameters if self.gravity else None
        self.usual_step = step_at_rest(solver)

    def reset(self) -> None:
        """Back to the start, at rest, with the effects as they were built."""
        self.solver.restore(self._state)
        self.solver.seconds.clear()
        self.set_numerics()
        if self.gravity:
            self.gravity.parameters = dataclasses.replace(self._gravity, turns=(), jolts=())
        self.set_viscosities(*(liquid.dynamic_viscosity for liquid in self._settings.liquids))

    def set_numerics(self, **values: float) -> None:
        """Change numbers of the time step; without any, take the first ones again."""
        self.solver.settings = self._settings
        self.solver.set_time_steps(**values)

    def set_gravity(self, **values) -> None:
        """Change parameters of gravity."""
        self.gravity.parameters = dataclasses.replace(self.gravity.parameters, **values)

    def set_viscosities(self, *values: float) -> None:
        """Change the viscosity of every liquid, Pa s."""
        for k, value in enumerate(values if self.viscosity else ()):
            self.viscosity.liquids.of_liquid[k] = value

    def read(self, name: str) -> np.ndarray:
        """A field of the particles in double precision."""
        return self.solver.particles.to_numpy(name).astype(float)

    def change(self, **fields: np.ndarray) -> None:
        """Set fields of the particles and take them as the start."""
        for name, values in fields.items():
            self.solver.particles.from_numpy(name, values)
        self.solver.prepare_rest_state()

    def fill(self, share: float) -> None:
        """Make the uppermost share of the cavity oil, the rest aqueous; one particle at least where share is above 0.
        """
        height = self.read("position")[:, 1]
        count = math.ceil(share * len(height) - 1e-9)
        phase = np.zeros(len(height), int)
        phase[np.argsort(-height, kind="stable")[:count]] = 1
        self.set_phase(phase)

    def set_phase(self, phase: np.ndarray) -> None:
        """Choose the liquid of every particle."""
        density = np.array([liquid.density for liquid in self.solver.liquids])
        fields = {"phase": phase, "mass": self.read("volume") * density[phase]}
        if "volume_fraction" in self.solver.particles.arrays:
            fields["volume_fraction"] = np.eye(len(density))[phase]
        self.change(**fields)

    def spin(self, rate: float) -> None:
        """Let the liquid turn as a whole, rad/s, in a wall that stands still."""
        position = self.read("position")
        self.change(velocity=rate * position[:, ::-1] * [-1.0, 1.0])


@dataclasses.dataclass(frozen=True)
class HardCase:
    """One case.

    Attributes
    ----------
    start : what it changes in a tank that was put back.
    duration : s.
    works : something does work on the liquid (a jolt, a turn, tension), so that its energy may rise.
    free : there is neither wall nor weight, so the momentum stays.
    exchanges : liquid enters and leaves, so that volumes change.
    refusal : part of the sentence with which the solver may refuse the case.
    """

    name: str
    start: Callable[[Tank], None] = lambda tank: None
    duration: float = 0.2
    works: bool = False
    free: bool = False
    exchanges: bool = False
    refusal: str = ""


@dataclasses.dataclass
class Verdict:
    """What came of a case: values by quantity, each with its limit, and a sentence where there is something to say."""

    name: str
    outcome: str
    sentence: str = ""
    values: dict[str, tuple[float, float | None]] = dataclasses.field(default_factory=dict)
    steps: int = 0
    smallest_step: float = math.nan

    def rows(self, wall_s: float) -> list[Row]:
        """Rows of a table: the outcome, 0 to 3 as in ``OUTCOMES``, and everything that was measured."""
        common: dict[str, Any] = {"at": f"[{self.name}]", "wall_s": wall_s}
        rows = [Row("verdict", float(OUTCOMES.index(self.outcome)), error=float(self.outcome == FAILED), tolerance=0.0,
                    **common)]
        for quantity, (value, limit) in self.values.items():
            rows.append(Row(quantity, value, error=None if limit is None else max(value, 0.0), tolerance=limit,
                            reference=None if limit is None else 0.0, **common))
        if self.steps:
            rows += [Row("time steps", float(self.steps), **common),
                     Row("smallest time step", self.smallest_step, "s", **common)]
        return rows


def closed_tank(scheme: str, *, liquids: Sequence[Liquid] = (AQUEOUS, OIL), spacing: float = SPACING,
                effects: dict | None = None, precision: str = "f64", **numerics) -> Tank:
    """A round cavity full of two liquids, oil on the left; gravity is built with all turns and jolts of the cases."""
    arrays = cavity("circle", 0.5 * SIDE, spacing, support_ratio=2.5)
    return Tank(build(TankParameters(scheme=scheme, support_ratio=2.5, precision=precision), arrays, liquids=liquids,
                      effects={"gravity": WORST_GRAVITY, "viscosity_implicit": {}} | (effects or {}),
                      phase=lambda x: x[:, 0] < 0.0, **numerics))


def open_tank(scheme: str, *, liquids: Sequence[Liquid] = (AQUEOUS, OIL), effects: dict | None = None,
              precision: str = "f64", **numerics) -> Tank:
    """A box with a column of two liquids in its lower left corner, under a free surface."""
    arrays = cavity("box", (SIDE, SIDE), SPACING, support_ratio=2.5)
    return Tank(build(TankParameters(scheme=scheme, support_ratio=2.5, precision=precision), arrays, liquids=liquids,
                      effects={"gravity": WORST_GRAVITY, "viscosity_implicit": {}} | (effects or {}),
                      phase=lambda x: x[:, 1] > -0.2 * SIDE,
                      filled=lambda x: (x[:, 0] < 0.0) & (x[:, 1] < 0.1 * SIDE), **numerics))


# Schemes that choose a speed of sound see at the start all that a case may bring.
WORST_GRAVITY = {"magnitude": GRAVITY, "posture": "upright",
                 "turns": (Turn(0.0, "left_side", duration=0.3), Turn(0.4, "right_side", duration=0.3))}


def flip_at_once(tank: Tank) -> None:
    """From lying on the right side to lying on the left, between two steps."""
    tank.set_gravity(posture="right_side", turns=(Turn(0.05, "left_side", duration=1e-6),))


def saccade(tank: Tank, degrees: float, duration: float) -> None:
    """The liquid turns at the peak speed of a minimum-jerk saccade (15/8 of the mean), and the wall has stopped."""
    tank.spin(1.875 * math.radians(degrees) / duration)


def saccade_on_the_side(tank: Tank) -> None:
    """90 degrees in 0.3 s, with gravity, which turns in the frame of the eye."""
    tank.set_gravity(turns=(Turn(0.0, "left_side", duration=0.3),))
    saccade(tank, 90.0, 0.3)


def head_jerk(tank: Tank) -> None:
    """5 g for 50 ms."""
    tank.set_gravity(jolts=(Jolt(0.02, (5.0 * GRAVITY, 0.0, 0.0), 0.05),))


def throw(tank: Tank) -> None:
    """Every particle at 10 m/s its own way: 10 cm in 10 ms, five times the cavity."""
    angle = np.random.default_rng(0).uniform(0.0, 2.0 * np.pi, len(tank.read("phase")))
    tank.change(velocity=10.0 * np.stack([np.cos(angle), np.sin(angle)], axis=-1))


def lone_particle(tank: Tank) -> None:
    """One particle far away from all others, in the air."""
    position = tank.read("position")
    position[len(position) // 2] = (0.3 * SIDE, 0.3 * SIDE)
    tank.change(position=position)


def lone_oil(tank: Tank) -> None:
    """One particle of oil amid aqueous."""
    phase = np.zeros(len(tank.read("phase")), int)
    phase[np.argmin((tank.read("position") ** 2).sum(axis=1))] = 1
    tank.set_phase(phase)


def meet_in_the_air(tank: Tank) -> None:
    """Without weight: the upper part of the column, amid the box, hits the lower one."""
    tank.set_gravity(magnitude=0.0)
    tank.set_viscosities(0.0, 0.0)
    position = tank.read("position") + np.array([0.25, 0.2]) * SIDE
    upper = position[:, 1] > 0.0
    tank.change(position=position, velocity=np.where(upper[:, None], (0.02, -0.05), (0.0, 0.03)))


def checkerboard(tank: Tank) -> None:
    """Liquids that change from particle to particle."""
    cell = np.floor(tank.read("position") / tank.solver.spacing).astype(int)
    tank.set_phase(cell.sum(axis=1) % 2)


def together(tank: Tank) -> None:
    """Two particles of one liquid at one point."""
    position = tank.read("position")
    first, second = np.argsort(((position - position.mean(axis=0)) ** 2).sum(axis=1))[:2]
    position[second] = position[first]
    tank.change(position=position)


CLOSED = (
    HardCase("cavity full, no free surface"),
    HardCase("viscosity 1:7000", lambda tank: tank.set_viscosities(0.7e-3, 4.9)),
    HardCase("viscosity 0", lambda tank: tank.set_viscosities(0.0, 0.0)),
    HardCase("fill 0 % (a liquid without particles)", lambda tank: tank.fill(0.0)),
    HardCase("fill 1 %", lambda tank: tank.fill(0.01)),
    HardCase("fill 50 %", lambda tank: tank.fill(0.5)),
    HardCase("fill 99 %", lambda tank: tank.fill(0.99)),
    HardCase("fill 100 %", lambda tank: tank.fill(1.0)),
    HardCase("one particle of oil in aqueous", lone_oil),
    HardCase("two particles at one point", together, works=True),  # an overlap is work stored
    HardCase("gravity flips at once", flip_at_once, works=True),
    HardCase("saccade of 90 degrees in 0.3 s", saccade_on_the_side, duration=0.3, works=True),
    HardCase("saccade of 50 degrees in 0.137 s", lambda tank: saccade(tank, 50.0, 0.137)),
    HardCase("head jerk of 5 g", head_jerk, works=True),
    HardCase("every particle at 10 m/s its own way", throw, duration=0.02),
)
OPEN = (
    HardCase("column falls, free surface"),
    HardCase("one particle far from all others", lone_particle),
    HardCase("two particles at one point", together, works=True),  # an overlap is work stored
    HardCase("two bodies meet, no wall, weight, viscosity", meet_in_the_air, duration=0.03, free=True),
    HardCase("gravity flips at once", flip_at_once, works=True),
    HardCase("head jerk of 5 g", head_jerk, works=True),
    HardCase("every particle at 10 m/s its own way", throw, duration=0.02),
)


TENSION = (
    HardCase("full cavity", duration=0.1, works=True),
    HardCase("fill 0 % (no interface)", lambda tank: tank.fill(0.0), duration=0.1),
    HardCase("fill 1 %", lambda tank: tank.fill(0.01), duration=0.1, works=True),
    HardCase("fill 99 %", lambda tank: tank.fill(0.99), duration=0.1, works=True),
    HardCase("fill 100 % (no interface)", lambda tank: tank.fill(1.0), duration=0.1),
    HardCase("one particle of oil in aqueous", lone_oil, duration=0.1, works=True),
)
MIXING = (
    HardCase("checkerboard of liquids", checkerboard, duration=0.1, works=True),
    HardCase("D dt/h2 = 10", lambda tank: tank.set_gravity(magnitude=0.0), duration=0.02, works=True),
)
FACTORS = (0.5, 1.0, 2.0, 5.0)  # of the largest stable time step


def fixed_steps(tank: Tank, base: HardCase) -> list[HardCase]:
    """Cases with fixed time steps: multiples of the smallest step that a run with the scheme's own steps takes.

    Less 10 %: no two runs reach quite the same speeds.
    """
    free = dataclasses.replace(base, start=lambda tank: tank.set_numerics(maximum_time_step=MAXIMUM_STEP))
    limit = 0.9 * judge(tank, free).smallest_step

    def fix(factor: float) -> Callable[[Tank], None]:
        return lambda tank: tank.set_numerics(maximum_time_step=MAXIMUM_STEP, time_step=factor * limit)
    return [dataclasses.replace(base, name=f"fixed time step, {factor:g} of the limit", start=fix(factor),
                                refusal="fixed time step") for factor in FACTORS]


class Watch:
    """The extremes of a run, and the energy and momentum of its start."""

    def __init__(self, tank: Tank, case: HardCase):
        self.tank, self.case = tank, case
        self.volume = self._volumes()
        self.worst = {"speed / expected": 0.0, "change of a liquid's volume": 0.0, "fraction out of bounds": 0.0,
                      "particles outside": 0.0, "energy gained": -math.inf, "momentum changed": 0.0,
                      "compression rate": 0.0}
        self.finite = True
        self.energy, self.momentum = self._energy(), self._momentum()
        velocity, mass = tank.read("velocity"), tank.read("mass")
        kinetic = 0.5 * float(mass @ (velocity**2).sum(axis=1))
        self.energy_scale = max(kinetic, self._share_of_weight() * mass.sum() * GRAVITY * SIDE)
        self.momentum_scale = max(float(mass @ np.linalg.norm(velocity, axis=1)), 1e-300)
        self.expected = self._expected_speed(float(np.linalg.norm(velocity, axis=1).max()))

    def _expected_speed(self, start: float) -> float:
        """Start, fall through the cavity, jolts and capillary waves of one spacing, m/s."""
        solver, gravity, share = self.tank.solver, self.tank.gravity, self._share_of_weight()
        fall, jolts = start, 0.0
        if gravity:  # it is left out where all liquids weigh the same
            fall = math.sqrt(start**2 + 2.0 * share * gravity.parameters.magnitude * SIDE)
            jolts = share * sum(math.hypot(*jolt.acceleration) * jolt.duration * 2.0 / math.pi
                                for jolt in gravity.parameters.jolts)
        tension = next((effect.coefficient for effect in solver.effects if effect.name == "interface_tension"), 0.0)
        density = sum(liquid.density for liquid in solver.liquids[:2])
        return max(fall + jolts + math.sqrt(tension * math.pi / (density * solver.spacing)), LEAST_SPEED)

    def _share_of_weight(self) -> float:
        """What of the weight sets liquid in motion: all of it under a free surface, else the difference of densities.

        One percent at least, for liquids of the same density.
        """
        densities = [liquid.density for liquid in self.tank.solver.liquids]
        return 1.0 if not self.tank.solver.settings.closed else max(1.0 - min(densities) / max(densities), 0.01)

    def _fractions(self) -> np.ndarray:
        if "volume_fraction" in self.tank.solver.particles.arrays:
            return self.tank.read("volume_fraction")
        return np.eye(len(self.tank.solver.liquids))[self.tank.solver.particles.to_numpy("phase")]

    def _volumes(self) -> np.ndarray:
        return self.tank.read("volume") @ self._fractions()

    def _energy(self) -> float:
        mass, velocity, position = (self.tank.read(name) for name in ("mass", "velocity", "position"))
        kinetic, gravity = 0.5 * mass @ (velocity**2).sum(axis=1), self.tank.gravity
        if gravity is None:
            return float(kinetic)
        # In a full cavity the weight of the reference density is pressure alone, and moves nothing.
        heavy = mass - gravity.reference_density * self.tank.read("volume")
        return float(kinetic - heavy @ (position @ gravity.at(self.tank.solver.time)))

    def _momentum(self) -> np.ndarray:
        return self.tank.read("mass") @ self.tank.read("velocity")

    def look(self) -> None:
        """Take in the present state."""
        tank, worst = self.tank, self.worst
        velocity, position = tank.read("velocity"), tank.read("position")
        self.finite &= all(np.isfinite(tank.read(field.name)).all()
                           for field in tank.solver.particles.declared.values() if field.carried)
        fractions = self._fractions()
        found = {
            "speed / expected": float(np.linalg.norm(velocity, axis=1).max()) / self.expected,
            "change of a liquid's volume": float(np.abs(self._volumes() - self.volume).max() / self.volume.sum()),
            "fraction out of bounds": max(-fractions.min(), fractions.max() - 1.0,
                                          float(np.abs(fractions.sum(axis=1) - 1.0).max())),
            "particles outside": float((tank.solver.distance.at(position) > 0.0).sum()),
            "energy gained": (self._energy() - self.energy) / self.energy_scale,
            "momentum changed": float(np.abs(self._momentum() - self.momentum).max()) / self.momentum_scale,
            "compression rate": float(tank.read("compression_rate").max())}
        for name, value in found.items():
            worst[name] = max(worst[name], value)

    def values(self, limits: Limits) -> dict[str, tuple[float, float | None]]:
        """Value and limit of every quantity."""
        asked = {"speed / expected": limits.speed,
                 "change of a liquid's volume": None if self.case.exchanges else limits.volume,
                 "fraction out of bounds": limits.fraction, "particles outside": limits.outside,
                 "energy gained": None if self.case.works else limits.energy,
                 "momentum changed": limits.momentum if self.case.free else None,
                 "compression rate": limits.compression}
        values = {name: (value, asked[name]) for name, value in self.worst.items()
                  if name != "momentum changed" or self.case.free}
        return {"numbers that are not finite": (float(not self.finite), 0.0)} | values


def judge(tank: Tank, case: HardCase, limits: Limits = LIMITS) -> Verdict:
    """Run a case and judge it."""
    tank.reset()
    case.start(tank)
    solver, watch, smallest, hits, seen = tank.solver, Watch(tank, case), math.inf, 0, 0.0
    try:
        while solver.time < case.duration - 1e-12 and solver.step_count < MOST_STEPS:
            left = case.duration - solver.time
            dt = solver.step(left)
            if dt < left:
                smallest = min(smallest, dt)
            hits += bool(solver.statistics.get("pressure_limit_hit", 0.0))
            if solver.time >= seen + case.duration / LOOKS or dt == left:
                watch.look()
                seen = solver.time
    except (RunError, OverflowError) as error:
        outcome = REFUSED if case.refusal and case.refusal in str(error) and watch.finite else FAILED
        return Verdict(case.name, outcome, str(error), watch.values(limits) if solver.step_count else {},
                       solver.step_count, smallest)
    values = watch.values(limits)
    verdict = Verdict(case.name, HELD, "", values, solver.step_count, smallest)
    broken = [f"{name} is {value:.3g}, above {limit:g}" for name, (value, limit) in values.items()
              if limit is not None and not value <= limit]
    if solver.step_count >= MOST_STEPS:
        broken.append(f"{MOST_STEPS} steps reach {solver.time:.3g} s of {case.duration:g} s only")
    if broken:
        verdict.outcome, verdict.sentence = FAILED, "; ".join(broken)
    elif smallest < SMALL_STEP * tank.usual_step and solver.settings.numerics.time_step is None:
        verdict.outcome = DEGRADED
        verdict.sentence = f"steps down to {smallest:.2g} s where {tank.usual_step:.2g} s do at rest"
    elif hits > 0.5 * solver.step_count:
        verdict.outcome = DEGRADED
        verdict.sentence = f"the pressure solve ended at its limit of iterations in {hits} of {solver.step_count} steps"
    return verdict
