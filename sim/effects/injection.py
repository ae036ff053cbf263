"""Injection of a liquid through a cannula while another leaves through a drain at the same rate.

Particles grow at the cannula and shrink at the drain, and the pressure solve gets the matching source
sum_j (dV_j/dt) W_ij. What is added in a step is exactly what is taken, so the cavity stays full. Swapping particles
instead would tear holes into the packing (compression 0.6 to 1.8).
"""
import dataclasses
import math

import numpy as np
import taichi as ti

from sim.effects.effect import Effect
from sim.fields import Field
from sim.parameters import parameter

STEPS_TO_GROW = 20  # a particle takes at least about this many steps to grow or to vanish
FEWEST = 8  # particles that grow, and shrink, at a time
SEED_FRACTION = 0.02  # volume of a seed, and of a particle that is removed, in rest volumes
CANDIDATES = 100  # random points among which the one farthest from every particle becomes a seed


@dataclasses.dataclass(frozen=True)
class InjectionParameters:
    """Exchange of liquids in the closed cavity at a given flow, up to a given fill."""

    liquid: str = parameter(liquid=True, meaning="liquid that enters")
    drained_liquid: str = parameter(liquid=True, meaning="liquid that leaves")
    flow: float = parameter(unit="m**3/s", exclusive_minimum=0.0, maximum=1e-4, meaning="volume per time")
    fill: float = parameter(exclusive_minimum=0.0, maximum=1.0,
                            meaning="fraction of the cavity that the entering liquid holds at the end")
    cannula: tuple[float, float, float] = parameter(unit="m", meaning="tip of the cannula")
    drain: tuple[float, float, float] = parameter(unit="m", meaning="mouth of the drain")
    start: float = parameter(0.0, unit="s", minimum=0.0, meaning="time at which the injection begins")


@ti.data_oriented
class Injection(Effect):
    """Growing and shrinking particles at the cannula and the drain."""

    name = "injection"
    Parameters = InjectionParameters
    fields = (Field("volume_rate", "scalar", "m3/s", "dV/dt of growing and shrinking particles"),)
    uses = ("id", "phase", "position", "velocity", "volume", "mass")

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        if "diffusion" in {e.name for e in solver.effects} or "volume_fraction" in solver.particles.arrays:
            raise ValueError("effect 'injection' cannot be active together with 'diffusion'")
        names = [liquid.name for liquid in solver.liquids]
        self.entering, self.leaving = names.index(parameters.liquid), names.index(parameters.drained_liquid)
        self.cannula = np.array(parameters.cannula[: solver.dimension])
        self.drain = np.array(parameters.drain[: solver.dimension])
        self.rest_volume, self.spacing, self.count = solver.rest_volume, solver.spacing, solver.count
        rate = parameters.flow * solver.settings.numerics.maximum_time_step / self.rest_volume
        self.number = max(FEWEST, math.ceil(STEPS_TO_GROW * rate))
        ball = {2: math.pi, 3: 4.0 / 3.0 * math.pi}[solver.dimension]
        self.seed_radius = max(2.0, (self.number / ball) ** (1.0 / solver.dimension)) * self.spacing
        self.target = parameters.fill * solver.cavity_volume
        self.growing, self.shrinking = np.zeros(0, int), np.zeros(0, int)  # ids
        self.finished = False

    def exchange(self, dt: float) -> None:
        """Seed and remove particles, and set the volume rates of this step."""
        self.particles.volume_rate.fill(0.0)
        if self.finished or self.solver.time < self.parameters.start:
            return
        read = self.solver.particles.to_numpy
        ids, phase, position = read("id"), read("phase"), read("position").astype(float)
        volume = dict(zip(ids.tolist(), read("volume").astype(float).tolist()))
        entered = sum(v for k, v, p in zip(ids.tolist(), volume.values(), phase) if p == self.entering)
        missing = self.target - entered
        if missing > 1e-6 * self.rest_volume:
            changes = self._inject(min(self.parameters.flow * dt, missing), volume, ids, phase, position)
        else:
            changes = self._consolidate(self.growing, volume)
            changes |= self._consolidate(self.shrinking, volume)
            self.finished = not changes
        self._apply_rates(changes, dt)

    def _inject(self, amount, volume, ids, phase, position) -> dict[int, float]:
        """Volume change per particle that adds `amount` at the cannula and takes as much at the drain."""
        whole, floor = self.rest_volume, SEED_FRACTION * self.rest_volume
        growing = [k for k in self.growing.tolist() if volume[k] < whole * (1.0 - 1e-5)]
        vanished = [k for k in self.shrinking.tolist() if volume[k] <= floor * (1.0 + 1e-5)][: int(amount / floor)]
        left = [k for k in self.shrinking.tolist() if k not in set(vanished)]
        leaving = np.flatnonzero((phase == self.leaving) & ~np.isin(ids, self.shrinking))
        nearest = leaving[np.argsort(np.linalg.norm(position[leaving] - self.drain, axis=1), kind="stable")]
        shrinking = left + ids[nearest[: max(0, self.number - len(left))]].tolist()
        # One seed at a time per whole particle injected: then growing particles have every size.
        seeds = min(self.number - len(growing), math.ceil(amount / whole), int(amount / floor))
        growth = share(amount - seeds * floor, {k: whole - volume[k] for k in growing})
        taken = sum(volume[k] for k in vanished)
        loss = share(seeds * floor + sum(growth.values()) - taken, {k: volume[k] - floor for k in shrinking})
        # Should the drained liquid run out, no more enters than can leave.
        balance = seeds * floor + sum(growth.values()) - taken - sum(loss.values())
        if balance > 0.0:
            growth = share(sum(growth.values()) - balance, growth)
        self.growing = np.array(growing + self._seed(seeds, position), int)
        self.shrinking = np.array(shrinking, int)
        self._remove(vanished)
        return growth | {k: -v for k, v in loss.items()}

    def _consolidate(self, group, volume) -> dict[int, float]:
        """After the injection: volume changes that make whole particles of the partial ones, sum unchanged."""
        group = [k for k in group.tolist() if k in volume]
        total = sum(volume[k] for k in group)
        kept = sorted(group, key=lambda k: (-volume[k], k))[: max(1, round(total / self.rest_volume))]
        floor, pace = SEED_FRACTION * self.rest_volume, self.rest_volume / STEPS_TO_GROW
        leaving = [k for k in group if k not in set(kept)]
        vanished = [k for k in leaving if volume[k] <= floor * (1.0 + 1e-5)]
        goal = total / max(len(kept), 1)
        if not leaving and all(abs(volume[k] - goal) < 1e-4 * self.rest_volume for k in group):
            return {}
        loss = {k: min(volume[k] - floor, pace) for k in leaving if k not in set(vanished)}
        loss |= {k: min(volume[k] - goal, pace) for k in kept if volume[k] > goal}
        amount = sum(loss.values()) + sum(volume[k] for k in vanished)
        gain = share(amount, {k: goal - volume[k] for k in kept if volume[k] < goal})
        surplus = amount - sum(gain.values())
        if surplus > 0.0:
            loss = share(max(sum(loss.values()) - surplus, 0.0), loss)
        self._remove(vanished)
        return gain | {k: -v for k, v in loss.items()}

    def _remove(self, ids) -> None:
        if ids:
            rows = np.flatnonzero(np.isin(self.solver.particles.to_numpy("id"), ids))
            self.solver.particles.remove(rows)

    def _apply_rates(self, changes: dict[int, float], dt: float) -> None:
        ids = self.solver.particles.to_numpy("id")
        rate = np.zeros(len(ids))
        rate[:] = [changes.get(k, 0.0) / dt for k in ids.tolist()]
        self.solver.particles.from_numpy("volume_rate", rate)

    def _seed(self, number: int, position) -> list[int]:
        """Add seeds in the largest gaps near the cannula; return their ids."""
        if number <= 0:
            return []
        solver = self.solver
        rng = np.random.default_rng((solver.settings.numerics.seed, solver.step_count))
        away = np.linalg.norm(position - self.cannula, axis=1)
        near = np.flatnonzero(away < self.seed_radius + 3.0 * self.spacing)
        direction = rng.normal(size=(CANDIDATES, solver.dimension))
        radius = self.seed_radius * rng.random((CANDIDATES, 1)) ** (1.0 / solver.dimension)
        points = self.cannula + radius * direction / np.linalg.norm(direction, axis=1, keepdims=True)
        points = points[solver.distance.at(points) < -0.5 * self.spacing]
        if len(points) < number:
            raise ValueError("effects.injection.cannula lies too close to the wall: no room for the entering liquid")
        gap = np.linalg.norm(points[:, None] - position[None, near], axis=2)
        nearest, gap = near[gap.argmin(1)], gap.min(1)
        velocity, pressure = solver.particles.to_numpy("velocity"), solver.particles.to_numpy("pressure")
        volume = SEED_FRACTION * self.rest_volume
        added = []
        for _ in range(number):
            best = int(gap.argmax())
            solver.particles.append({
                "id": solver.next_id, "phase": self.entering, "position": points[best], "volume": volume,
                "mass": volume * solver.liquids[self.entering].density, "velocity": velocity[nearest[best]],
                "pressure": pressure[nearest[best]]})
            added.append(solver.next_id)
            solver.next_id += 1
            gap = np.minimum(gap, np.linalg.norm(points - points[best], axis=1))
        return added

    @ti.kernel
    def _grow(self, dt: float):
        # What enters has the velocity of the liquid around it, so the velocity stays.
        for i in range(self.count[None]):
            if self.particles.volume_rate[i] != 0.0:
                density = self.particles.mass[i] / self.particles.volume[i]
                self.particles.volume[i] += dt * self.particles.volume_rate[i]
                self.particles.mass[i] = density * self.particles.volume[i]

    def finish(self, dt: float) -> None:
        if not self.finished:
            self._grow(dt)

    def state(self) -> dict:
        return {"growing": self.growing, "shrinking": self.shrinking, "finished": self.finished}

    def restore(self, state: dict) -> None:
        if state:
            self.growing, self.shrinking = state["growing"].astype(int), state["shrinking"].astype(int)
            self.finished = bool(state["finished"])


def share(amount: float, capacity: dict[int, float]) -> dict[int, float]:
    """Split `amount` into equal parts, none above its capacity; what does not fit is left out."""
    parts = {}
    rest = list(sorted(capacity.items(), key=lambda item: (item[1], item[0])))
    for index, (key, limit) in enumerate(rest):
        part = min(max(limit, 0.0), max(amount, 0.0) / (len(rest) - index))
        parts[key] = part
        amount -= part
    return parts
