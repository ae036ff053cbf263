"""Injection of a liquid through a cannula while another leaves through a drain at the same rate.

Particles of the entering liquid grow at the cannula and split; particles of the leaving liquid shrink at the drain and
merge. The pressure solve gets the matching source sum_j (dV_j/dt) W_ij. What is added in a step is exactly what is
taken, so the cavity stays full. Volumes stay within a factor of about two: a particle far below the rest volume has a
volume equation that hardly acts on others and makes pressures run away, and moving whole particles from the drain to
the cannula tears the packing.
"""
import dataclasses
import math

import numpy as np
import taichi as ti

from sim.effects.effect import Effect
from sim.errors import RunError
from sim.fields import Field
from sim.parameters import parameter

STEPS_TO_DOUBLE = 12  # a particle takes at least about this many steps to double or to halve
FEWEST = 24  # particles that grow, and shrink, at a time
LARGEST, SMALLEST = 2.0, 0.5  # volumes at which a particle splits and wants to merge, in rest volumes
SPLIT_DISTANCE = 0.4  # distance of the two halves from the place of the whole, in particle spacings
DIRECTIONS = 24  # random directions, of which the one with most room is taken
FLOW_ROUNDING = 1e-6  # the target counts as met within this, in rest volumes


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
    """Growing and shrinking particles at the cannula and the drain.

    The entering liquid starts as a droplet at the tip of the cannula that takes the place of the drained liquid.
    """

    name = "injection"
    Parameters = InjectionParameters
    fields = (Field("volume_rate", "scalar", "m3/s", "dV/dt of growing and shrinking particles", carried=True),)
    uses = ("id", "phase", "position", "velocity", "volume", "mass", "pressure")
    periodic = False

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        names = [liquid.name for liquid in solver.liquids]
        self.entering, self.leaving = names.index(parameters.liquid), names.index(parameters.drained_liquid)
        self.density = [liquid.density for liquid in solver.liquids]
        self.cannula = np.array(parameters.cannula[: solver.dimension])
        self.drain = np.array(parameters.drain[: solver.dimension])
        self.rest_volume, self.spacing, self.count = solver.rest_volume, solver.spacing, solver.count
        per_step = parameters.flow * solver.settings.numerics.maximum_time_step / self.rest_volume
        self.number = max(FEWEST, math.ceil(STEPS_TO_DOUBLE * per_step))
        self.target = parameters.fill * solver.cavity_volume
        self.fractions = solver.particles.arrays.get("volume_fraction")  # where another effect mixes the liquids
        self.mixes = self.fractions is not None
        self.volume_before = math.nan  # volume of the entering liquid when the flow begins, m^3
        self.finished = False

    def exchange(self, dt: float) -> None:
        """Split and merge particles, and set the volume rates of this step."""
        self.particles.volume_rate.fill(0.0)
        if self.finished or self.solver.time < self.parameters.start:
            return
        if math.isnan(self.volume_before):
            self._place_droplet()
        self._split_large()
        self._merge_small()
        read = self.solver.particles.to_numpy
        phase, volume, position = read("phase"), read("volume").astype(float), read("position").astype(float)
        missing = self.target - volume[phase == self.entering].sum()
        due = self.volume_before + self.parameters.flow * (self.solver.time + dt - self.parameters.start) - (
            self.target - missing)
        amount = max(0.0, min(due, missing))
        rate = np.zeros(len(volume))
        for which, point, sign in ((self.entering, self.cannula, 1.0), (self.leaving, self.drain, -1.0)):
            rows = self._nearest(position, phase, which, point)
            if sign < 0.0 and amount > 0.5 * volume[rows].sum():
                raise RunError(f"{self.solver.liquids[which].name} runs out before the fill is reached, "
                               "lower effects.injection.fill")
            rate[rows] = sign * amount / dt * volume[rows] / volume[rows].sum()
        self.solver.particles.from_numpy("volume_rate", rate)
        self.finished = missing - amount <= FLOW_ROUNDING * self.rest_volume

    def _nearest(self, position, phase, which: int, point) -> np.ndarray:
        """Rows of the particles of one liquid nearest to a point.

        Raises
        ------
        RunError
            When that liquid has run out.
        """
        rows = np.flatnonzero(phase == which)
        if not len(rows):
            name = self.solver.liquids[which].name
            raise RunError(f"no {name} is left to exchange, lower effects.injection.fill")
        away = np.linalg.norm(position[rows] - point, axis=1)
        return rows[np.argsort(away, kind="stable")[: self.number]]

    def _place_droplet(self) -> None:
        read = self.solver.particles.to_numpy
        phase, volume, mass = read("phase"), read("volume"), read("mass")
        present = volume[phase == self.entering].sum(dtype=float)
        if present < self.number * self.rest_volume:
            rows = self._nearest(read("position").astype(float), phase, self.leaving, self.cannula)
            phase[rows] = self.entering
            mass[rows] = volume[rows] * self.density[self.entering]
            self.solver.particles.from_numpy("phase", phase)
            self.solver.particles.from_numpy("mass", mass)
            if self.mixes:
                fraction = read("volume_fraction")
                fraction[rows] = np.arange(fraction.shape[1]) == self.entering
                self.solver.particles.from_numpy("volume_fraction", fraction)
            present = volume[phase == self.entering].sum(dtype=float)
        self.volume_before = present

    def _split_large(self) -> None:
        """Split entering particles above the largest volume into two halves, where there is most room."""
        particles = self.solver.particles
        volume, phase = particles.to_numpy("volume"), particles.to_numpy("phase")
        rows = np.flatnonzero((volume > LARGEST * self.rest_volume) & (phase == self.entering))
        if not len(rows):
            return
        position = particles.to_numpy("position").astype(float)
        velocity, pressure, mass = (particles.to_numpy(name) for name in ("velocity", "pressure", "mass"))
        fraction = particles.to_numpy("volume_fraction") if self.mixes else None
        rng = np.random.default_rng((self.solver.settings.numerics.seed, self.solver.step_count))
        for row in rows:
            direction = rng.normal(size=(DIRECTIONS, self.solver.dimension))
            step = SPLIT_DISTANCE * self.spacing * direction / np.linalg.norm(direction, axis=1, keepdims=True)
            away = position - position[row]
            near = position[(np.linalg.norm(away, axis=1) < 2.0 * self.spacing) & (np.arange(len(position)) != row)]
            ends = position[row] + np.stack([step, -step])
            gap = np.linalg.norm(ends[:, :, None] - near, axis=3).min(axis=(0, 2)) if len(near) else np.ones(DIRECTIONS)
            inside = (self.solver.distance.at(ends.reshape(-1, step.shape[1])) < 0.0).reshape(2, -1).all(0)
            gap = np.where(inside, gap, 0.0)
            best = int(gap.argmax())
            half = {"phase": phase[row], "velocity": velocity[row], "pressure": pressure[row],
                    "volume": 0.5 * volume[row], "mass": 0.5 * mass[row]}
            half |= {"volume_fraction": fraction[row]} if self.mixes else {}
            particles.append(half | {"id": self.solver.next_id, "position": ends[1, best]})
            self.solver.next_id += 1
            particles.set_row(int(row), {"position": ends[0, best], "volume": half["volume"], "mass": half["mass"]})
            position[row] = ends[0, best]
            position = np.vstack([position, ends[1, best]])

    def _merge_small(self) -> None:
        """Merge leaving particles below the smallest volume with their nearest neighbor of the same liquid."""
        particles = self.solver.particles
        volume, phase = particles.to_numpy("volume").astype(float), particles.to_numpy("phase")
        small = np.flatnonzero((volume < SMALLEST * self.rest_volume) & (phase == self.leaving))
        if not len(small):
            return
        position = particles.to_numpy("position").astype(float)
        velocity, mass = particles.to_numpy("velocity").astype(float), particles.to_numpy("mass").astype(float)
        fraction = particles.to_numpy("volume_fraction").astype(float) if self.mixes else None
        same = np.flatnonzero(phase == self.leaving)
        gone = set()
        for row in small[np.argsort(volume[small], kind="stable")]:
            if int(row) in gone:
                continue
            others = same[(same != row) & ~np.isin(same, list(gone))]
            away = np.linalg.norm(position[others] - position[row], axis=1)
            # A near partner that makes no large particle; one that has shrunk to half once more takes the nearest.
            near = (away < 1.5 * self.spacing) & (volume[others] + volume[row] <= 0.75 * LARGEST * self.rest_volume)
            allowed = near if volume[row] > 0.5 * SMALLEST * self.rest_volume else np.ones(len(others), bool)
            if not allowed.any():
                continue
            partner = int(others[allowed][away[allowed].argmin()])
            total, weight = volume[row] + volume[partner], mass[row] + mass[partner]
            position[partner] = (volume[row] * position[row] + volume[partner] * position[partner]) / total
            velocity[partner] = (mass[row] * velocity[row] + mass[partner] * velocity[partner]) / weight
            if self.mixes:
                fraction[partner] = (volume[row] * fraction[row] + volume[partner] * fraction[partner]) / total
                particles.set_row(partner, {"volume_fraction": fraction[partner]})
            volume[partner], mass[partner] = total, weight
            particles.set_row(partner, {"position": position[partner], "velocity": velocity[partner],
                                        "volume": total, "mass": weight})
            gone.add(int(row))
        particles.remove(gone)

    @ti.kernel
    def _grow(self, dt: float):
        # What enters has the velocity of the liquid around it, so the velocity stays.
        for i in range(self.count[None]):
            if self.particles.volume_rate[i] != 0.0:
                before = self.particles.volume[i]
                density = self.particles.mass[i] / before
                self.particles.volume[i] += dt * self.particles.volume_rate[i]
                self.particles.mass[i] = density * self.particles.volume[i]
                if ti.static(self.mixes):  # noqa: SIM102 (a condition at compile time stands alone)
                    if self.particles.volume_rate[i] > 0.0:  # pure liquid enters; what leaves is the mixture there
                        kept = before / self.particles.volume[i]
                        self.fractions[i] *= kept
                        self.fractions[i][self.entering] += 1.0 - kept
                        self.particles.mass[i] = density * before + self.density[self.entering] * (
                            self.particles.volume[i] - before)

    def finish(self, dt: float) -> None:
        self._grow(dt)

    def state(self) -> dict:
        return {"finished": self.finished, "volume_before": self.volume_before}

    def restore(self, state: dict) -> None:
        if state:
            self.finished, self.volume_before = bool(state["finished"]), float(state["volume_before"])
