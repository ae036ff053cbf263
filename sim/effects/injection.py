"""Injection of a liquid through a cannula while another leaves through a drain at the same rate.

Particles of the entering liquid grow around the tip of the cannula and split; particles of the leaving liquid shrink
around the mouth of the drain and merge. The pressure solve gets the matching source sum_j (dV_j/dt) W_ij. What is added
in a step is exactly what is taken, so the cavity stays full. Volumes stay within a factor of about two: a particle far
below the rest volume has a volume equation that hardly acts on others and makes pressures run away, and moving whole
particles from the drain to the cannula tears the packing. Equations: docs/methods/injection.md.

The region in which particles grow or shrink is a ball of a given radius, whatever the spacing; it is wider only where
it would hold too few particles, or where they would double in too few steps. Nothing here depends on the order in which
particles lie in memory.
"""
import dataclasses
import math
from types import MappingProxyType

import numpy as np

from sim.advice import NOTE, SEEN_EFFECT, WARNING, Advice, Quantity, shown
from sim.backend import data_oriented, real, real_numpy, ti
from sim.effects.effect import GROWTH, MIXES, REMEMBERS, Effect
from sim.errors import RunError
from sim.fields import Field
from sim.liquid import UNLIKE, are_unlike
from sim.parameters import parameter
from sim.reductions import blocks, first, last, partial_results, running_total, total_of

STEPS_TO_DOUBLE = 12  # a particle takes at least about this many steps to double or to halve
WIDEST = 1.5  # radius of the regions over the one asked for: what the flow asks for beyond it, shorter steps give
FEWEST = 24  # particles that grow, and shrink, at a time
LARGEST, SMALLEST = 2.0, 0.5  # volumes at which a particle splits and wants to merge, in rest volumes
SPLIT_DISTANCE = 0.4  # distance of the two halves from the place of the whole, in particle spacings
DIRECTIONS = 24  # random directions, of which the one with most room is taken
NEAR = 1.5  # reach of a split and of a merger, in particle spacings: well inside neighbor rows that are a step old
FLOW_ROUNDING = 1e-6  # the target counts as met within this, in rest volumes
WHOLE = 0.02  # of the cavity by which the liquids of a start may miss their shares, since particles are whole
BINS_PER_SPACING = 4  # shells around cannula and drain in which particles are counted
MOST_CHANGES = 4096  # particles that split, or merge, in one step
VOLUME_BITS = 51  # of the cavity's volume to which single ones are summed: twice the cavity's has 52, doubles have 53
LEAST_LEFT = 0.005  # of the cavity, of the liquid that is drained: fewer particles cannot give way evenly
FILLED = 1e-3  # share of the cavity by which a fill may miss its target, and no more is injected
CANNULA, DRAIN, DROPLET = range(3)  # entering liquid at the cannula, leaving liquid at the drain and at the cannula


@dataclasses.dataclass(frozen=True)
class InjectionParameters:
    """Exchange of liquids in the closed cavity at a given flow, up to a given fill."""

    liquid: str = parameter(liquid=True, meaning="liquid that enters")
    drained_liquid: str = parameter(liquid=True, meaning="liquid that leaves",
                                    reason="the closed cavity is full and liquids are incompressible, so as much must "
                                           "leave as enters")
    flow: float = parameter(unit="m**3/s", exclusive_minimum=0.0, maximum=1e-4, meaning="volume per time")
    fill: float = parameter(exclusive_minimum=0.0, maximum=1.0,
                            meaning="fraction of the cavity that the entering liquid holds at the end")
    cannula: tuple[float, float, float] = parameter(unit="m", meaning="tip of the cannula")
    drain: tuple[float, float, float] = parameter(unit="m", meaning="mouth of the drain",
                                                  reason="the closed cavity is full and liquids are incompressible, "
                                                         "so what enters needs an outlet")
    start: float = parameter(0.0, unit="s", minimum=0.0, meaning="time at which the injection begins")
    ramp: float = parameter(0.05, unit="s", minimum=0.0, meaning="time in which the flow rises to its full value")
    radius: float = parameter(1.5e-3, unit="m", exclusive_minimum=0.0, maximum=1e-2,
                              meaning="radius around cannula and drain in which liquid enters and leaves, at least")

    def flowed(self, time: float) -> float:
        """Volume that has flowed until a time, m^3."""
        since = max(0.0, time - self.start)
        rising = min(since, self.ramp)
        return self.flow * (0.5 * rising**2 / self.ramp if self.ramp else 0.0) + self.flow * (since - rising)  # (J1)

    def time_of(self, volume: float) -> float:
        """Time at which a volume, m^3, has flowed, s."""
        rising = 0.5 * self.flow * self.ramp
        return self.start + (math.sqrt(2.0 * volume * self.ramp / self.flow) if volume < rising
                             else 0.5 * self.ramp + volume / self.flow)

    def ball(self, dimension: int) -> float:
        """Volume of the region that is asked for, m^3 (m^2 in 2D)."""
        return math.pi * self.radius**2 if dimension == 2 else 4.0 / 3.0 * math.pi * self.radius**3

    def region_volume(self, rest_volume: float, dimension: int, time_step: float) -> float:
        """Volume of the region in which liquid enters, m^3 (m^2 in 2D)."""
        return max(FEWEST * rest_volume, self.ball(dimension), STEPS_TO_DOUBLE * self.flow * time_step)  # (J3)

    def longest_step(self, rest_volume: float, dimension: int) -> float:
        """Step that makes the region no wider than it may be, s: (A8) of docs/methods/time_step.md."""
        return max(FEWEST * rest_volume, WIDEST**dimension * self.ball(dimension)) / (STEPS_TO_DOUBLE * self.flow)


def _check_exchange(parameters):
    if parameters.liquid == parameters.drained_liquid:
        yield (("effects", "injection", "drained_liquid"),
               f"is {parameters.liquid}, the liquid that enters, but must be another one")
    if parameters.cannula == parameters.drain:
        yield ("effects", "injection", "drain"), "is where the cannula is, but must be away from it"


def _check_cavity(parameters, closed):
    if not closed:
        yield (("effects", "injection"), "exchanges liquids in a full cavity, but the blocks leave a free surface; "
                                         "fill the container or remove injection")


def _check_liquids(liquids):
    densities = [liquid.density for liquid in liquids]
    if are_unlike(densities):
        ratio = max(densities) / min(densities)
        yield (("effects", "injection"),
               f"cannot be used with liquids whose densities differ by a factor of {ratio:.4g}: it was shown to "
               f"work up to {UNLIKE:g}, and gas is blown apart where it streams in")


def _check_start(parameters, output):
    if parameters.start >= output.duration:
        yield (("effects", "injection", "start"),
               f"is {parameters.start:g} s, but the scene ends at {output.duration:g} s")


def _check_room(parameters, fill, begins):
    if begins and fill.get(parameters.liquid, 0.0) >= parameters.fill:
        yield (("effects", "injection", "fill"),
               f"is {100 * parameters.fill:g} %, but {parameters.liquid} holds {100 * fill[parameters.liquid]:g} % of "
               "the cavity at the start")
        return
    leaving = fill.get(parameters.drained_liquid, 0.0)
    most = fill.get(parameters.liquid, 0.0) + leaving - LEAST_LEFT
    if parameters.fill > most + 1e-9:
        yield (("effects", "injection", "fill"),
               f"is {100 * parameters.fill:g} %, which drains all {parameters.drained_liquid} ({100 * leaving:g} % of "
               f"the cavity at the start), but must be at most {100 * most:g} %")


def _advice_on_exchanged_places(parameters, liquids, down):
    density = {liquid.name: liquid.density for liquid in liquids}
    enters, leaves = density[parameters.liquid], density[parameters.drained_liquid]
    if down is None or enters == leaves:
        return
    below = float(np.subtract(parameters.drain, parameters.cannula) @ down)  # the drain is below the cannula by, m
    if (below if enters < leaves else -below) < -parameters.radius:
        where, kind, collects = ("above", "heavier", "below") if enters < leaves else ("below", "lighter", "above")
        yield (("effects", "injection", "drain"),
               f"is {1e3 * abs(below):.3g} mm {where} the cannula at the start, but {parameters.drained_liquid}, which "
               f"leaves, is the {kind} liquid and collects {collects}: are cannula and drain exchanged?")


def _advice_on_small_fill(parameters):
    if parameters.fill <= 0.01:
        yield (("effects", "injection", "fill"),
               f"is {100 * parameters.fill:g} % of the cavity (did you mean {1e4 * parameters.fill:g} %?)")


@data_oriented
class Injection(Effect):
    """Growing and shrinking particles at the cannula and the drain.

    Where no entering liquid is at the tip of the cannula, it starts there as a droplet in place of the drained liquid.
    """

    name = "injection"
    Parameters = InjectionParameters
    fields = (
        Field("volume_rate", "scalar", "m3/s", "dV/dt of growing and shrinking particles", carried=True),
        Field("growth", "scalar", "1/s", "rate at which liquid grows: sum of dV_j/dt W_ij"),
        Field("merged", "integer", "", "1 for a particle that has gone into another one in this step"),
    )
    uses = ("id", "phase", "position", "velocity", "volume", "mass", "pressure")
    periodic = False
    planned = True
    excludes = MappingProxyType({
        MIXES: "the fill is counted in unmixed particles, so let another scene start from the end",
        REMEMBERS: "particles that split or merge would not keep their stress"})
    needs = frozenset({GROWTH})
    fewest_liquids = 2
    inside = ("cannula", "drain")
    checks = (_check_exchange, _check_cavity, _check_liquids, _check_start, _check_room)
    doubts = (_advice_on_exchanged_places, _advice_on_small_fill)

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        self.store, self.pairs, self.distance = solver.particles, solver.pairs, solver.distance
        self.dimension, self.rest_volume, self.spacing = solver.dimension, solver.rest_volume, solver.spacing
        self.count, self.kernel = solver.count, solver.kernel
        names = [liquid.name for liquid in solver.liquids]
        self.entering, self.leaving = names.index(parameters.liquid), names.index(parameters.drained_liquid)
        self.density = [liquid.density for liquid in solver.liquids]
        self.target = parameters.fill * solver.cavity_volume
        self.fractions = solver.particles.arrays.get("volume_fraction")  # where another effect mixes the liquids
        self.mixes = self.fractions is not None
        self.volume_before = math.nan  # volume of the entering liquid when the flow begins, m^3
        self.finished, self.flows = False, False
        self.liquid_of = (self.entering, self.leaving, self.leaving)
        points = [parameters.cannula, parameters.drain, parameters.cannula]
        self.point = [ti.Vector([float(v) for v in point[: self.dimension]]) for point in points]
        extent = float(np.linalg.norm((np.array(self.distance.shape) - 1) * self.distance.cell))
        self.bin_width = self.spacing / BINS_PER_SPACING
        self.bins = math.ceil(extent / self.bin_width) + 1
        self.histogram = ti.field(ti.i32, shape=(len(points), self.bins))
        self.partial = partial_results(3)
        self.volumes = ti.field(ti.f64, shape=3)  # of the entering liquid; of the regions at cannula and drain
        # Sums of whole numbers of it are exact, so that they do not depend on the order of the particles.
        self.volume_unit = 2.0 ** (math.ceil(math.log2(solver.cavity_volume)) - VOLUME_BITS)
        self.amount = ti.field(ti.f64, shape=())
        self.chosen, self.chosen_id = (ti.field(ti.i32, shape=MOST_CHANGES) for _ in range(2))
        self.chosen_volume = ti.field(ti.f64, shape=MOST_CHANGES)
        self.chosen_count = ti.field(ti.i32, shape=())
        self.direction = ti.Vector.field(self.dimension, real(), shape=DIRECTIONS)

    @classmethod
    def brings(cls, parameters) -> tuple[str, ...]:
        return (parameters.liquid,)

    @classmethod
    def fill_at(cls, parameters, fill, time=float("inf"), cavity_volume=1.0):
        present = fill.get(parameters.liquid, 0.0)
        missing = max(0.0, parameters.fill - present) * cavity_volume
        moved = min(parameters.flowed(time), missing) / cavity_volume
        return fill | {parameters.liquid: present + moved,
                       parameters.drained_liquid: fill.get(parameters.drained_liquid, 0.0) - moved}

    @classmethod
    def spans(cls, parameters, fill, cavity_volume):
        if fill:
            missing = max(0.0, parameters.fill - fill.get(parameters.liquid, 0.0)) * cavity_volume
            yield "injection", parameters.start, parameters.time_of(missing)

    @classmethod
    def events(cls, parameters, fill, cavity_volume):
        for _, begin, end in cls.spans(parameters, fill, cavity_volume):
            if end > begin:
                yield "injection", begin, begin
                yield "end of injection", end, end

    def state_at(self, time: float, volumes: dict[str, float], fill: dict[str, float]) -> dict:
        flown, liquid = self.parameters.flowed(time), self.parameters.liquid
        before = {"volume_before": volumes[liquid] - flown} if flown else {}
        return {"finished": fill[liquid] > self.parameters.fill - FILLED} | before

    @classmethod
    def _volume_to_inject(cls, parameters, scales) -> float:
        """Volume, m^3; what a scene starts from is taken as empty of that liquid."""
        present = scales.start.fill.get(parameters.liquid, 0.0)
        for block in scales.start.blocks:
            if block.liquid == parameters.liquid:
                present += block.volume / scales.cavity_volume
        return max(parameters.fill - present, 0.0) * scales.cavity_volume

    @classmethod
    def advice(cls, parameters, scales, limits):
        if parameters is None:
            return
        end = parameters.time_of(cls._volume_to_inject(parameters, scales))
        if end > scales.duration:
            but = f", but the scene ends at {shown(scales.duration, 's')}"
            if not scales.settings.continued:
                yield Advice(WARNING, cls.name, f"does not reach its fill: it would end at {shown(end, 's')}{but}")
            else:
                yield Advice(NOTE, cls.name, f"may not reach its fill: it would end at {shown(end, 's')} if the scene "
                                             f"before had left none of its liquid{but}")
        else:
            yield Advice(SEEN_EFFECT, cls.name, f"it ends at {shown(end, 's')}, within the "
                                                f"{shown(scales.duration, 's')} of the scene")

    @classmethod
    def speeds(cls, parameters, scales):
        dimension = scales.settings.dimension
        rest_volume = scales.spacing**dimension
        step = min(scales.settings.numerics.maximum_time_step, parameters.longest_step(rest_volume, dimension))
        volume = parameters.region_volume(rest_volume, dimension, step)
        yield Quantity("jet", parameters.flow * scales.radius(volume) / (dimension * volume), "m/s",
                       "flow through the surface of the droplet in which the liquid enters")

    @classmethod
    def time_scales(cls, parameters, scales):
        end = parameters.time_of(cls._volume_to_inject(parameters, scales))
        yield Quantity("injection", end - parameters.start, "s", "volume to inject over flow, which rises first")

    def stable_time_step(self) -> float:
        """What keeps the regions narrow while liquid flows, s."""
        longest = self.solver.settings.numerics.maximum_time_step
        if self.finished or self.solver.time < self.parameters.start - longest:
            return float("inf")
        return self.parameters.longest_step(self.rest_volume, self.dimension)

    def exchange(self, dt: float) -> None:
        """Split and merge particles, and set the volume rates of this step."""
        self.particles.volume_rate.fill(0.0)
        self.flows = False
        if self.finished or self.solver.time < self.parameters.start:
            return
        if math.isnan(self.volume_before):
            self._place_droplet(dt)
        self._split_large()
        self._merge_small()
        self._measure()
        missing = self.target - self.volumes[0]
        due = self.volume_before + self.parameters.flowed(self.solver.time + dt) - self.volumes[0]
        self.amount[None] = amount = max(0.0, min(due, missing))
        cannula, drain = (self._reach(which, dt) for which in (CANNULA, DRAIN))
        self._measure_regions(cannula, drain)
        if amount > 0.5 * self.volumes[1 + DRAIN]:
            name = self.solver.liquids[self.leaving].name
            raise RunError(f"{name} runs out at the drain before the fill is reached, lower effects.injection.fill or "
                           "effects.injection.flow")
        self._set_rates(cannula, drain, dt)
        self.flows = True
        self.finished = missing - amount <= FLOW_ROUNDING * self.rest_volume

    # Where.

    @ti.func
    def _bin(self, which: ti.template(), i):
        away = (self.particles.position[i] - self.point[which]).norm()
        return ti.min(ti.cast(away / self.bin_width, ti.i32), self.bins - 1)

    @ti.func
    def _volume(self, i):
        """Volume of a particle as a whole number of units, m^3; in single precision it is one already."""
        return ti.round(ti.cast(self.particles.volume[i], ti.f64) / self.volume_unit) * self.volume_unit

    @ti.kernel
    def _measure(self):
        """Volume of the entering liquid, and numbers of particles in shells around cannula and drain."""
        n = self.count[None]
        for which, k in self.histogram:
            self.histogram[which, k] = 0
        # Not within blocks: Mesa's Vulkan on the CPU (22.3) leaves a loop early that has an atomic operation in it.
        for i in range(n):
            for which in ti.static(range(3)):
                if self.particles.phase[i] == self.liquid_of[which]:
                    ti.atomic_add(self.histogram[which, self._bin(which, i)], 1)
        for block in range(blocks(n)):
            total = ti.cast(0.0, ti.f64)
            for i in range(first(block, n), last(block, n)):
                if self.particles.phase[i] == self.entering:
                    total += self._volume(i)
            self.partial[0, block] = total
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.volumes[0] = total_of(self.partial, 0, n)

    def _reach(self, which: int, dt: float) -> int:
        """Number of shells that make up the region of a step of dt s.

        Raises
        ------
        RunError
            When its liquid has run out.
        """
        number = math.ceil(self.parameters.region_volume(self.rest_volume, self.dimension, dt) / self.rest_volume)
        within = np.cumsum(self.histogram.to_numpy()[which])
        if not within[-1]:
            name = self.solver.liquids[self.liquid_of[which]].name
            raise RunError(f"no {name} is left to exchange, lower effects.injection.fill")
        return 1 + int(np.searchsorted(within, min(number, within[-1])))

    @ti.kernel
    def _measure_regions(self, cannula: int, drain: int):
        n = self.count[None]
        for block in range(blocks(n)):
            grown = ti.cast(0.0, ti.f64)
            shrunk = ti.cast(0.0, ti.f64)
            for i in range(first(block, n), last(block, n)):
                if self.particles.phase[i] == self.entering and self._bin(CANNULA, i) < cannula:
                    grown += self._volume(i)
                if self.particles.phase[i] == self.leaving and self._bin(DRAIN, i) < drain:
                    shrunk += self._volume(i)
            self.partial[1, block] = grown
            self.partial[2, block] = shrunk
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.volumes[1] = total_of(self.partial, 1, n)
            self.volumes[2] = total_of(self.partial, 2, n)

    @ti.kernel
    def _set_rates(self, cannula: int, drain: int, dt: float):
        """The flow, shared out by volume."""
        for i in range(self.count[None]):
            share = ti.cast(0.0, ti.f64)
            if self.particles.phase[i] == self.entering and self._bin(CANNULA, i) < cannula:
                share = self._volume(i) / self.volumes[1]
            if self.particles.phase[i] == self.leaving and self._bin(DRAIN, i) < drain:
                share = -self._volume(i) / self.volumes[2]
            self.particles.volume_rate[i] = share * self.amount[None] / dt  # (J2)

    def _check_liquids(self) -> None:
        """Refuse, before anything flows, a fill that the liquids of the start cannot give."""
        phase, volume = (self.solver.particles.to_numpy(name) for name in ("phase", "volume"))
        present, leaving = (float(volume[phase == one].sum(dtype=float)) for one in (self.entering, self.leaving))
        enters, leaves = (self.solver.liquids[one].name for one in (self.entering, self.leaving))
        if present > self.target + WHOLE * self.solver.cavity_volume:
            raise RunError(f"{enters} holds {100.0 * present / self.solver.cavity_volume:.3g} % of the cavity before "
                           f"anything flows, more than the {100.0 * self.parameters.fill:.3g} % of "
                           "effects.injection.fill, raise it or leave the effect out")
        if leaving and self.target - present > leaving:
            highest = (present + leaving) / self.solver.cavity_volume
            raise RunError(f"all {leaves} would have to leave before the fill is reached, lower effects.injection.fill "
                           f"below {100.0 * highest:.3g} %")

    def _place_droplet(self, dt: float) -> None:
        self._check_liquids()
        self._measure()
        enough = self.volumes[0] >= self.parameters.region_volume(self.rest_volume, self.dimension, dt)
        if not enough or self._reach(CANNULA, dt) > self._reach(DROPLET, dt):
            self._fill_droplet(self._reach(DROPLET, dt))
            self._measure()
        self.volume_before = self.volumes[0] - self.parameters.flowed(self.solver.time)

    @ti.kernel
    def _fill_droplet(self, shells: int):
        for i in range(self.count[None]):
            if self.particles.phase[i] == self.leaving and self._bin(DROPLET, i) < shells:
                self.particles.phase[i] = self.entering
                self.particles.mass[i] = self.particles.volume[i] * self.density[self.entering]
                if ti.static(self.mixes):
                    self.fractions[i] *= 0.0
                    self.fractions[i][self.entering] = 1.0

    # Which particles split or merge.

    @ti.kernel
    def _choose(self, liquid: int, sign: float, limit: float):
        """List the particles of a liquid whose volume, times the sign, is above a limit."""
        n = self.count[None]
        for block in range(blocks(n)):
            found = 0
            for i in range(first(block, n), last(block, n)):
                found += ti.cast(self.particles.phase[i] == liquid and sign * self.particles.volume[i] > limit, ti.i32)
            self.partial[0, block] = found
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.chosen_count[None] = ti.cast(running_total(self.partial, 0, n), ti.i32)
        for block in range(blocks(n)):
            k = ti.cast(self.partial[0, block], ti.i32)
            for i in range(first(block, n), last(block, n)):
                if self.particles.phase[i] == liquid and sign * self.particles.volume[i] > limit:
                    if k < MOST_CHANGES:
                        self.chosen[k] = i
                        self.chosen_id[k] = self.particles.id[i]
                        self.chosen_volume[k] = self.particles.volume[i]
                    k += 1

    def _chosen(self, liquid: int, sign: float, limit: float) -> np.ndarray:
        """Rows of the particles of a liquid whose volume, times the sign, is above a limit; small ones, old ones first.

        They are ``MOST_CHANGES`` at most; the others wait for the next step.
        """
        self._choose(liquid, sign, limit)
        number = min(self.chosen_count[None], MOST_CHANGES)
        if not number:
            return np.zeros(0, np.int32)
        rows, ids, volumes = (one.to_numpy()[:number] for one in (self.chosen, self.chosen_id, self.chosen_volume))
        rows = rows[np.lexsort((ids, volumes))]
        padded = np.zeros(MOST_CHANGES, np.int32)
        padded[:number] = rows
        self.chosen.from_numpy(padded)
        return rows

    def _split_large(self) -> None:
        """Split entering particles above the largest volume into two halves, where there is most room."""
        rows = self._chosen(self.entering, 1.0, LARGEST * self.rest_volume)
        if not len(rows):
            return
        rng = np.random.default_rng((self.solver.settings.numerics.seed, self.solver.step_count))
        direction = rng.normal(size=(DIRECTIONS, self.dimension))
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        self.direction.from_numpy(direction.astype(real_numpy()))
        first_new = self.store.duplicate(rows)
        self._split(first_new, len(rows), self.solver.next_id)
        self.solver.next_id += len(rows)

    @ti.kernel
    def _split(self, first_new: int, number: int, first_id: int):
        # One after the other: a later one looks at where the earlier ones have gone.
        ti.loop_config(serialize=True)
        for k in range(number):
            i, new = self.chosen[k], first_new + k
            x = self.particles.position[i]
            best = x * 0.0
            most = -1.0
            for d in range(DIRECTIONS):
                step = SPLIT_DISTANCE * self.spacing * self.direction[d]
                gap = 0.0
                if self.distance.value(x + step) < 0.0 and self.distance.value(x - step) < 0.0:
                    gap = self.spacing
                    for slot in range(self.pairs.count[i]):
                        x_j = self.particles.position[self.pairs.index[self.pairs.entry(i, slot)]]
                        gap = ti.min(gap, self._room(x, x_j, step))
                    for other in range(first_new, new):
                        gap = ti.min(gap, self._room(x, self.particles.position[other], step))
                if gap > most:
                    most = gap
                    best = step
            self.particles.position[i] = x + best
            self.particles.position[new] = x - best
            self.particles.id[new] = first_id + k
            self.particles.volume[i] *= 0.5
            self.particles.mass[i] *= 0.5
            self.particles.volume[new] = self.particles.volume[i]
            self.particles.mass[new] = self.particles.mass[i]

    @ti.func
    def _room(self, x, x_j, step):
        """Distance from x_j to the nearer of x + step and x - step; a spacing where x_j is far."""
        gap = self.spacing
        if (x_j - x).norm() < NEAR * self.spacing:
            gap = ti.min((x_j - x - step).norm(), (x_j - x + step).norm())
        return gap

    def _merge_small(self) -> None:
        """Merge leaving particles below the smallest volume with their nearest neighbor of the same liquid."""
        rows = self._chosen(self.leaving, -1.0, -SMALLEST * self.rest_volume)
        if not len(rows):
            return
        self._merge(len(rows))
        self.store.remove(rows[self._gone(len(rows))])

    @ti.func
    def _is_partner(self, i, j, hurry):
        """Whether i may go into j: not where a large particle would come of it, unless in a hurry."""
        small = self.particles.volume[i] + self.particles.volume[j] <= 0.75 * LARGEST * self.rest_volume
        away = (self.particles.position[i] - self.particles.position[j]).norm()
        return (j != i and self.particles.phase[j] == self.leaving and self.particles.merged[j] == 0
                and (hurry or (small and away < NEAR * self.spacing)))

    @ti.func
    def _nearer(self, i, j, least, best):
        """Squared distance and row of the nearer one of two partners, the older one where they are as near."""
        r2 = (self.particles.position[i] - self.particles.position[j]).norm_sqr()
        found, row = least, best
        if r2 < least or (r2 == least and self.particles.id[j] < self.particles.id[best]):
            found, row = r2, j
        return found, row

    @ti.kernel
    def _merge(self, number: int):
        for i in range(self.count[None]):
            self.particles.merged[i] = 0
        ti.loop_config(serialize=True)
        for k in range(number):
            i = self.chosen[k]
            # One that has shrunk to half once more takes the nearest there is.
            hurry = self.particles.volume[i] <= 0.5 * SMALLEST * self.rest_volume
            least, best = 1e30, -1
            for slot in range(self.pairs.count[i]):
                j = self.pairs.index[self.pairs.entry(i, slot)]
                if self._is_partner(i, j, hurry):
                    least, best = self._nearer(i, j, least, best)
            if best < 0 and hurry:
                for j in range(self.count[None]):
                    if self._is_partner(i, j, hurry):
                        least, best = self._nearer(i, j, least, best)
            if best >= 0:
                self._unite(i, best)

    @ti.func
    def _unite(self, i, j):
        """Put particle i into particle j."""
        v_i, v_j = self.particles.volume[i], self.particles.volume[j]
        m_i, m_j = self.particles.mass[i], self.particles.mass[j]
        share, weight = v_i / (v_i + v_j), m_i / (m_i + m_j)
        self.particles.position[j] += share * (self.particles.position[i] - self.particles.position[j])  # (J5)
        self.particles.velocity[j] += weight * (self.particles.velocity[i] - self.particles.velocity[j])
        if ti.static(self.mixes):
            self.fractions[j] += share * (self.fractions[i] - self.fractions[j])
        self.particles.volume[j] = v_i + v_j
        self.particles.mass[j] = m_i + m_j
        self.particles.merged[i] = 1

    def _gone(self, number: int) -> np.ndarray:
        """Which of the chosen particles have gone into another one, (number,) boolean."""
        self._read_merged(number)
        return self.chosen_id.to_numpy()[:number] == 1

    @ti.kernel
    def _read_merged(self, number: int):
        for k in range(number):
            self.chosen_id[k] = self.particles.merged[self.chosen[k]]

    @ti.kernel
    def _grow(self, dt: float):
        # What enters has the velocity of the liquid around it, so the velocity stays.
        for i in range(self.count[None]):
            if self.particles.volume_rate[i] != 0.0:
                before = self.particles.volume[i]
                density = self.particles.mass[i] / before
                self.particles.volume[i] += dt * self.particles.volume_rate[i]  # (J4)
                self.particles.mass[i] = density * self.particles.volume[i]
                if ti.static(self.mixes):  # noqa: SIM102 (a condition at compile time stands alone)
                    if self.particles.volume_rate[i] > 0.0:  # pure liquid enters; what leaves is the mixture there
                        kept = before / self.particles.volume[i]
                        self.fractions[i] *= kept
                        self.fractions[i][self.entering] += 1.0 - kept
                        self.particles.mass[i] = density * before + self.density[self.entering] * (
                            self.particles.volume[i] - before)

    def prepare(self, dt: float) -> None:
        if self.flows:
            self._measure_growth()
        else:
            self.particles.growth.fill(0.0)

    @ti.kernel
    def _measure_growth(self):
        for i in range(self.count[None]):
            total = self.particles.volume_rate[i] * self.kernel.at_zero
            for slot in range(self.pairs.count[i]):
                k = self.pairs.entry(i, slot)
                j = self.pairs.index[k]
                total += self.particles.volume_rate[j] / self.particles.volume[j] * self.pairs.weight[k]
            self.particles.growth[i] = total  # (J7)

    def finish(self, dt: float) -> None:
        self._grow(dt)

    def state(self) -> dict:
        return {"finished": self.finished, "volume_before": self.volume_before}

    def restore(self, state: dict) -> None:
        if state:
            self.finished, self.volume_before = bool(state["finished"]), float(state["volume_before"])
