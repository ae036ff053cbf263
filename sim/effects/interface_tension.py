"""Interface tension in N/m with a contact angle at the wall, in potential form.

A grid level set gives the curvature kappa at points P of the interface. With b = (rho_1 - rho_0) g and the jump
function M_P = sigma kappa_P - b.x_P, extended smoothly off the interface,

    sigma kappa grad c + c b = grad(c (M + b.x)) - c grad M .

The first term on the right is a pressure: it is left out of the solve and added back on output. What remains, -H grad
M, vanishes at equilibrium for any disordered particle set, so spurious currents decay. The effect adds -V_i H_i (grad M
+ b) to the buoyancy c b that `gravity` gives. Its sum over a drop is zero as far as the points lie where the particles
change their color, and as M, extended, is still M_P there. So the points of the level set, which smoothing has drawn
in, are moved out; and they carry 2 M less the mean of M around them, since the mean that extends M flattens it
(twicing [tukey1977]).

Without a tension M is -b.x: the weight then acts at the interface, where the labels of particles alone would let layers
stir.

Where the liquids mix, sigma falls with the square of the contrast of the interface: the difference between the highest
and the lowest fraction within a support radius of it, 1 at a sharp one. H is then c at the interface alone, and the
level set's side elsewhere: a mixture off the interface keeps its buoyancy c b.
Equations: docs/methods/interface_tension.md.
"""
import dataclasses
import math

import numpy as np

from sim.advice import NOTE, SEEN_EFFECT, WARNING, Advice, Quantity, if_alone, if_zero, is_seen, shown, times
from sim.backend import data_oriented, real, ti
from sim.effects.effect import MIXES, PULLS, Effect
from sim.effects.parts.contact_line import fastest_retreat
from sim.effects.parts.level_set import LevelSet
from sim.errors import OutOfRoom
from sim.fields import Field
from sim.liquid import are_unlike
from sim.parameters import parameter
from sim.reductions import blocks, first, last, partial_results, running_total, total_of

DRAWN_IN = 0.36  # the zero of the level set is drawn in by 0.36 kappa dx^2 by splatting and smoothing: measured on
# packed spheres of 3 and 4 dx and circles of 4 to 10 dx; a drop of 4 dx looks 13 % too small in volume
EXTENSION_RADIUS = 4.0  # reach R of single points of the interface in the extension of M, in particle spacings
EXTENSION_POWER = 8  # their weight is (1 - r^2/R^2)^8
ON_WALL = 1e-3  # cells: what lies no further from the wall is on it, as round-off has it
SLICES = 4  # bins of points along R in rows of bins, which are as wide as R: few points beyond R are looked at
TAIL_LENGTH = 1.5  # beyond R, points count in groups, with 1/(1 + r^2/L^2)^d: a short reach would squeeze all the
# change of M into a thin shell, whose force the pressure of disordered particles cannot balance (a bubble then rises
# 30 % too slowly)
VISCOUS_SHARE = 8.0  # of (mu_0 + mu_1) dx / sigma in the time step, per numerics.time_error: 0.4 for 5 %, see the study
# step_size_study; the shortest wave is stable up to 4/pi
MOTION_SHARE = 0.2  # the same of (mu_0 + mu_1) L / sigma with the size L of the cavity, in which tension moves the oil
NODE = 6  # reals per node of the grid, beside the normal
# The interface is curved within the capillary length L/sqrt(Bo) of the wall: above 100 a rim of less than a tenth of L,
# and flat elsewhere; below 10 a third of L or more, that is the shape as a whole.
FLAT_BOND, ROUND_BOND = 100.0, 10.0
SHORT_STEPS = 1.5  # steps allowed over the largest step of the numerics, from which that is told
TYPICAL_TENSION = 0.04  # silicone oil in water, N/m; water and other oils have 20 to 50 mN/m
SEEN = 2.0  # a particle on the wrong side belongs to the interface if a point of it is this near, in spacings


@dataclasses.dataclass(frozen=True)
class InterfaceTensionParameters:
    """Tension of the interface between the first liquid and every other, from a grid level set."""

    coefficient: float = parameter(unit="N/m", minimum=0.0, maximum=1.0,
                                   meaning="interface tension; with 0 layers of unequal weight come to rest all the "
                                           "same")
    contact_angle: float = parameter(0.5 * math.pi, unit="rad", minimum=0.0, maximum=math.pi,
                                     meaning="contact angle at the wall, measured through the first liquid")

    @property
    def pulls_contact_line(self) -> bool:
        """Whether walls hold liquid less next to the contact line, as docs/methods/viscosity.md says."""
        return self.coefficient > 0.0


def capillary_limit(coefficient: float, settings) -> float:
    """Step in which the shortest wave between two liquids without viscosity is followed, s [brackbill1992]."""
    density = sum(liquid.density for liquid in settings.liquids[:2])
    return math.sqrt(density * settings.numerics.particle_spacing**3 / (4.0 * math.pi * coefficient))


def _check_liquids(parameters, bulk_liquids):
    if bulk_liquids > 2:
        yield ("effects", "interface_tension"), f"knows one interface, but the scene has {bulk_liquids} liquids"


def _check_cavity(parameters, closed):
    if not closed:
        yield (("effects", "interface_tension"),
               "keeps a part of the pressure out of the solve, which cannot vanish at a free surface then; fill the "
               "container, or use cohesion and curvature")


def _advice_on_reversed_wetting(parameters, eye, liquids, oil):
    names, angle = [liquid.name for liquid in liquids], parameters.contact_angle
    through_other = math.pi - angle if oil == names[0] else angle
    if eye is None or not parameters.coefficient or through_other <= 0.5 * math.pi + 1e-6 or len(names) < 2:
        return
    other = next(name for name in names if name != oil)
    yield (("effects", "interface_tension", "contact_angle"),
           f"is {math.degrees(angle):.4g} deg, measured through the first liquid, {names[0]}, so that {oil} would wet "
           f"the retina, but in an eye {other} does (18.2 deg through it for silicone oil, 38.8 deg for gas): with "
           f"this order of liquids did you mean {math.degrees(math.pi - angle):.4g} deg?")


def _advice_on_unusual_tension(parameters, eye):
    tension = parameters.coefficient
    if eye is None or not tension or 1e-3 <= tension <= 0.1:
        return
    likely = 1e3 * tension * 10.0 ** -math.floor(math.log10(tension / 0.01))
    yield (("effects", "interface_tension", "coefficient"),
           f"is {1e3 * tension:.4g} mN/m, but in an eye oil has some 5 to 50 mN/m and gas 72 mN/m (did you mean "
           f"{likely:.4g} mN/m?)")


@data_oriented
class InterfaceTension(Effect):
    """Tension and wetting of the interface between two liquids."""

    name = "interface_tension"
    Parameters = InterfaceTensionParameters
    fields = (
        Field("color", "scalar", "1", "fraction of the liquids other than the first"),
        Field("jump_weight", "scalar", "1", "H_i: color, or the level set's side where the two disagree"),
        Field("jump_force", "vector", "N/m3", "grad M + b at the particle"),
        Field("jump", "scalar", "Pa", "M at the particle"),
    )
    uses = ("position", "volume", "mass", "phase")
    periodic = False
    does = frozenset({PULLS})
    fewest_liquids = 2
    checks = (_check_liquids, _check_cavity)
    doubts = (_advice_on_reversed_wetting, _advice_on_unusual_tension)

    def __init__(self, parameters, solver):
        super().__init__(parameters, solver)
        self.coefficient = parameters.coefficient
        self.dimension, self.spacing, self.count = solver.dimension, solver.spacing, solver.count
        self.mixes = "volume_fraction" in solver.particles.arrays
        self.fractions = solver.particles.arrays.get("volume_fraction")
        self.level_set = LevelSet(solver, self.particles.color, parameters.contact_angle, self.mixes)
        self.grid = self.level_set.grid
        densities = [liquid.density for liquid in solver.liquids]
        self.density_difference = densities[1] - densities[0]
        # Phase of a liquid that is too light to bear the tension, -1 for none.
        self.light = int(densities[1] < densities[0]) if are_unlike(densities[:2]) else -1
        if self.light >= 0:
            self.stray_weight, self.borne = (ti.field(real(), shape=solver.particles.capacity) for _ in range(2))
        area = solver.cavity_volume ** ((self.dimension - 1) / self.dimension)
        capacity = int(30.0 * solver.head_room * area / self.grid.cell ** (self.dimension - 1)) + 1000
        self.capacity = capacity
        self.point, self.sorted_point = (
            ti.Vector.field(self.dimension, real(), shape=capacity, layout=ti.Layout.SOA) for _ in range(2))
        self.point_area, self.point_jump, self.sorted_area, self.sorted_jump = (
            ti.field(real(), shape=capacity) for _ in range(4))
        self.point_bin = ti.field(ti.i32, shape=capacity)
        self.point_count = ti.field(ti.i32, shape=())
        self.partial = partial_results(4)
        self.area, self.mean_jump = (ti.field(real(), shape=()) for _ in range(2))
        self.body_force = ti.Vector.field(self.dimension, real(), shape=())  # b, N/m^3
        self.radius = EXTENSION_RADIUS * self.spacing
        extent = (np.array(self.grid.shape) - 1) * self.grid.cell
        cubes = [int(n) for n in np.ceil(extent / self.radius) + 3]  # of slices: the points of one make a group
        self.bins = [SLICES * cubes[0], *cubes[1:]]
        self.slice = self.radius / SLICES
        self.bin_strides = [int(np.prod(self.bins[:d])) for d in range(self.dimension)]
        self.bin_start = ti.field(ti.i32, shape=int(np.prod(self.bins)) + 1)
        self.bin_fill = ti.field(ti.i32, shape=int(np.prod(self.bins)) + 1)
        self.bin_origin = ti.Vector([float(v) for v in self.grid.origin_numpy - self.radius])
        self.cube_count = int(np.prod(cubes))
        groups = min(capacity, self.cube_count)
        self.group_center = ti.Vector.field(self.dimension, real(), shape=groups, layout=ti.Layout.SOA)
        self.group_area, self.group_jump = (ti.field(real(), shape=groups) for _ in range(2))
        self.group_count = ti.field(ti.i32, shape=())

    @classmethod
    def idle(cls, parameters, settings) -> str:
        if parameters.coefficient:
            return ""
        if not any(getattr(effect, "weighs_liquids", False) for effect in settings.effects):
            return "its coefficient is 0 N/m, and nothing weighs on layers"
        if len({liquid.density for liquid in settings.liquids[:2]}) < 2:
            return "its coefficient is 0 N/m, and the liquids weigh the same"
        return ""

    @classmethod
    def tension_of(cls, parameters) -> float:
        return parameters.coefficient

    @classmethod
    def contact_angle_of(cls, parameters) -> float | None:
        return parameters.contact_angle if parameters.coefficient else None

    @classmethod
    def pulls(cls, parameters) -> bool:
        return parameters.pulls_contact_line

    @classmethod
    def reals_per_node(cls, dimension: int) -> int:
        return NODE + dimension

    @classmethod
    def advice(cls, parameters, scales, limits):
        if parameters is None:
            yield from cls._advice_on_its_lack(scales)
            return
        yield from if_alone(cls.name, scales)
        if not scales.tension:
            if scales.gravity * scales.density_difference > 0.0:
                yield Advice(NOTE, cls.name, "has no tension, but lets layers of unequal weight rest")
            else:
                yield from if_zero(cls.name, parameters, "coefficient", "N/m")
            return
        rounding = scales.tension / (scales.density * scales.length**2)
        reach = scales.reach(rounding, scales.capillary_speed(scales.tension))
        bond = scales.bond_number(scales.gravity, scales.tension)
        rim = scales.length / math.sqrt(bond) if bond else math.inf
        if not is_seen(reach, scales):
            flat = bond > FLAT_BOND
            yield Advice(NOTE if flat else WARNING, cls.name,
                         f"cannot be seen: within the scene it moves the interface by {times(reach, scales)}"
                         + (", but it lets layers of unequal weight rest" if flat else ""))
        elif bond > FLAT_BOND:
            seen = "can hardly be seen" if is_seen(rim, scales) else "cannot be seen"
            own = next(limit.value for limit in limits if limit.source == f"effects.{cls.name}")
            yield Advice(WARNING, cls.name,
                         f"{seen}: Bo = {bond:.3g} is above {FLAT_BOND:g}, so the interface is flat but for a rim of "
                         f"{times(rim, scales)}, and it limits the time step to {shown(own, 's')}")
        else:
            shape = (f"below {ROUND_BOND:g}, so it rounds the liquid as a whole" if bond < ROUND_BOND else
                     f"from {ROUND_BOND:g} to {FLAT_BOND:g}, so it curves a rim of {times(rim, scales)}")
            yield Advice(SEEN_EFFECT, cls.name, f"Bo = {bond:.3g} is {shape}")
            yield from cls._advice_on_short_steps(parameters, scales, limits)
            yield cls._advice_on_wetting(parameters.contact_angle, scales, min(rim, scales.length))
            yield from cls._advice_on_retreat(parameters.contact_angle, scales)

    @classmethod
    def _advice_on_short_steps(cls, parameters, scales, limits):
        """Tell of steps that viscosity allows and the numerics do not."""
        numerics = scales.settings.numerics
        size = scales.length * (4.0 * math.pi / 3.0) ** (1.0 / 3.0)
        allowed = min(cls._limit(parameters, scales.settings, MOTION_SHARE * size),
                      *(limit.value for limit in limits if limit.source != "numerics.maximum_time_step"))
        if numerics.time_step is None and allowed > SHORT_STEPS * numerics.maximum_time_step:
            yield Advice(NOTE, cls.name, f"allows steps of {shown(allowed, 's')}, and so does all else but "
                                         f"numerics.maximum_time_step, {shown(numerics.maximum_time_step, 's')}")

    @classmethod
    def _advice_on_wetting(cls, angle: float, scales, rim: float) -> Advice:
        """Height sqrt(2(1 - sin theta)) capillary lengths of the meniscus at an upright flat wall (Young-Laplace)."""
        climb = rim * math.sqrt(max(2.0 * (1.0 - math.sin(angle)), 0.0))
        text = (f"a contact angle of {math.degrees(angle):g} deg bends the interface at the wall by "
                f"{times(climb, scales)}")
        return Advice(SEEN_EFFECT if is_seen(climb, scales) else NOTE, cls.name, text)

    @classmethod
    def _retreats(cls, angle: float, scales) -> dict[str, float]:
        """Liquid -> speed at which it can leave the wall at most, m/s; none where viscosity does not hold it."""
        if not (scales.tension and scales.viscous and all(one.dynamic_viscosity > 0.0 for one in scales.liquids)):
            return {}
        first, second = scales.liquids
        return {one.name: fastest_retreat(own, scales.tension, one.dynamic_viscosity, other.dynamic_viscosity,
                                          scales.length)
                for one, other, own in ((first, second, angle), (second, first, math.pi - angle)) if own > 0.0}

    @classmethod
    def _advice_on_retreat(cls, angle: float, scales):
        for name, speed in cls._retreats(angle, scales).items():
            if speed * scales.duration < scales.length:
                yield Advice(NOTE, cls.name, f"{name} leaves the wall at {shown(speed, 'm/s')} at most (Cox 1986), so "
                                             f"within the scene by {times(speed * scales.duration, scales)}: what is "
                                             "wetted may not be at rest when it ends")

    @classmethod
    def _advice_on_its_lack(cls, scales):
        if scales.does(MIXES) or len(scales.settings.liquids) != 2:
            return  # mixing liquids have no tension, and the effect knows one interface
        if len(scales.liquids) != 2 or not scales.settings.closed or scales.pulled:
            return
        bond, size = scales.bond_number(scales.gravity, TYPICAL_TENSION), scales.density * scales.length**2
        reach = scales.reach(TYPICAL_TENSION / size, scales.capillary_speed(TYPICAL_TENSION))
        if bond < ROUND_BOND and is_seen(reach, scales):
            yield Advice(WARNING, cls.name,
                         f"is missing and would be seen: with {1e3 * TYPICAL_TENSION:g} mN/m, as oil in water has, "
                         f"Bo = {bond:.3g} is below {ROUND_BOND:g} (unless the two liquids have no interface)")
        else:
            layers = scales.gravity * scales.density_difference > 0.0
            yield Advice(NOTE, cls.name,
                         f"is not needed here: with {1e3 * TYPICAL_TENSION:g} mN/m, as oil in water has, "
                         f"Bo = {bond:.3g} (it rounds the liquid below {ROUND_BOND:g}), and it moves the interface by "
                         f"{times(reach, scales)}" + ("; with 0 N/m it lets layers of unequal weight rest"
                                                      if layers else ""))

    @classmethod
    def speeds(cls, parameters, scales):
        if scales.tension:
            yield Quantity("capillary", scales.capillary_speed(scales.tension), "m/s",
                           "the smaller of sqrt(sigma/(rho L)) and, with viscosity, sigma/mu of the stiffest liquid")

    @classmethod
    def numbers(cls, parameters, scales):
        tension, speed, length = scales.tension, scales.speed, scales.length
        if not tension:
            return
        yield Quantity("Bo", scales.bond_number(scales.gravity, tension), "",
                       "Bond, drho g L2/sigma: difference of weights over tension")
        yield Quantity("We", scales.density * speed**2 * length / tension, "",
                       "Weber, rho U2 L/sigma of the heaviest liquid: inertia over tension")
        yield Quantity("Ca", scales.stiffest.dynamic_viscosity * speed / tension, "",
                       "capillary, mu U/sigma of the stiffest liquid: viscosity over tension")
        for liquid in scales.liquids:
            if liquid.dynamic_viscosity > 0.0:
                yield Quantity(f"Oh {liquid.name}", scales.ohnesorge_number(liquid), "",
                               "Ohnesorge, mu/sqrt(rho sigma L) of this liquid: above 0.77 a drop of it does not ring")

    @classmethod
    def time_scales(cls, parameters, scales):
        tension, length, viscosity = scales.tension, scales.length, scales.stiffest.dynamic_viscosity
        if not tension:
            return
        yield Quantity("capillary", math.sqrt(scales.density * length**3 / tension), "s",
                       "sqrt(rho L3/sigma): tension against inertia")
        if scales.viscous and viscosity > 0.0:
            yield Quantity("capillary, viscous", viscosity * length / tension, "s",
                           "mu L/sigma of the stiffest liquid: tension against viscosity")
        for name, speed in cls._retreats(parameters.contact_angle, scales).items():
            yield Quantity(f"contact line, {name}", length / speed, "s",
                           f"L over the {shown(speed, 'm/s')} at which this liquid leaves the wall at most (Cox 1986)")

    @classmethod
    def wave_speeds(cls, parameters, scales):
        if scales.tension:
            yield math.sqrt(math.pi * scales.tension / (2.0 * scales.density * scales.spacing))

    def expected_speeds(self):
        density = self.solver.liquids[0].density + self.solver.liquids[1].density
        yield math.sqrt(self.coefficient * np.pi / (density * self.spacing))

    @classmethod
    def time_step_limit(cls, parameters, settings) -> float:
        """Capillary limit: (t_v + sqrt(t_v^2 + 4 t_c^2))/2 [galusinski2008]; the constants are ours.

        t_c = sqrt((rho_0 + rho_1) dx^3 / (4 pi sigma)) is the limit without viscosity [brackbill1992], and t_v, a share
        of (mu_0 + mu_1) dx / sigma, the part that viscosity allows beyond it, where it is implicit: it damps the
        shortest wave, which an explicit tension then drives in steps of up to (4/pi) (mu_0 + mu_1) dx / sigma.
        (A3) of docs/methods/time_step.md.
        """
        return cls._limit(parameters, settings, VISCOUS_SHARE * settings.numerics.particle_spacing)

    @classmethod
    def _limit(cls, parameters, settings, length: float) -> float:
        """Step in which viscosity allows a share `numerics.time_error` of (mu_0 + mu_1) length / sigma, s."""
        if parameters.coefficient == 0.0 or len(settings.liquids) < 2:
            return float("inf")
        capillary = capillary_limit(parameters.coefficient, settings)
        if not any(getattr(effect, "damps_any_step", False) for effect in settings.effects):
            return capillary
        viscosity = sum(liquid.dynamic_viscosity for liquid in settings.liquids[:2])
        viscous = settings.numerics.time_error * viscosity * length / parameters.coefficient
        return 0.5 * (viscous + math.sqrt(viscous**2 + 4.0 * capillary**2))

    def stable_time_step(self) -> float:
        """The capillary limit, and that of the motion of all of the interface, s: (A3) of docs/methods/time_step.md."""
        size = self.solver.cavity_volume ** (1.0 / self.solver.dimension)
        settings = self.solver.settings
        return min(self.time_step_limit(self.parameters, settings),
                   self._limit(self.parameters, settings, MOTION_SHARE * size))

    def prepare(self, dt: float) -> None:
        gravity = self.solver.gravity()
        self.body_force[None] = ti.Vector([float(v) for v in self.density_difference * gravity])
        self._color()
        self.level_set.update()
        self._find_points()
        if self.point_count[None] > self.capacity:
            raise OutOfRoom(f"the interface has {self.point_count[None]} grid crossings where {self.capacity} fit: "
                                "the liquids are mixed down to single particles")
        self._sort_points()
        self._group_points()
        self._sharpen()
        self._group_points()
        self._extend()
        if self.light >= 0:
            self._share_buoyancy()

    @ti.kernel
    def _color(self):
        for i in range(self.count[None]):
            c = 1.0 * ti.min(self.particles.phase[i], 1)
            if ti.static(self.mixes):
                c = 1.0 - self.fractions[i][0]
            self.particles.color[i] = c

    @ti.func
    def _slice(self, x):
        """Bin of a place along the first axis, never one of the outermost cubes."""
        c = ti.cast(ti.floor((x - self.bin_origin[0]) / self.slice), ti.i32)
        return ti.min(ti.max(c, SLICES), self.bins[0] - SLICES - 1)

    @ti.func
    def _row(self, x, d: ti.template()):
        """Bin of a place along another axis, never one of the outermost."""
        c = ti.cast(ti.floor((x - self.bin_origin[d]) / self.radius), ti.i32)
        return ti.min(ti.max(c, 1), self.bins[d] - 2)

    @ti.func
    def _bin(self, x):
        index = self._slice(x[0])
        for d in ti.static(range(1, self.dimension)):
            index += self._row(x[d], d) * self.bin_strides[d]
        return index

    @ti.func
    def _crossing(self, n, d: ti.template()):
        """Whether the interface crosses the edge from node n along axis d inside the cavity or on its wall, where along
        it, and the share of an edge that it stands for.

        Where a wall lies on nodes of the grid, as those of boxes do, a row of edges begins and ends with half a one.
        """
        m = n + self.level_set.steps[d]
        p, q = self.level_set.phi[n], self.level_set.phi[m]
        t = p / (p - q)
        wall, wall_next = self.grid.values[n], self.grid.values[m]
        depth = -(wall + t * (wall_next - wall)) / self.grid.cell
        return (p > 0.0) != (q > 0.0) and depth >= -ON_WALL, t, ti.select(depth <= ON_WALL, 0.5, 1.0)

    @ti.kernel
    def _find_points(self):
        """Points of the interface: zero crossings of phi on grid edges inside the cavity, moved out by `DRAWN_IN`.

        Position, area |n_a| cell^(d-1) of the surface moved out, M; their sums, and the mean slope of phi.
        """
        nodes = self.level_set.band_and_rim_count[None]
        for block in range(blocks(nodes)):
            found = 0
            for k in range(first(block, nodes), last(block, nodes)):
                for d in ti.static(range(self.dimension)):
                    crosses, _, _ = self._crossing(self.level_set.band[k], d)
                    found += ti.cast(crosses, ti.i32)
            self.partial[0, block] = found
        ti.loop_config(serialize=True)
        for _ in range(1):
            self.point_count[None] = ti.cast(running_total(self.partial, 0, nodes), ti.i32)
        for block in range(blocks(nodes)):
            place = ti.cast(self.partial[0, block], ti.i32)
            area = ti.cast(0.0, ti.f64)
            jump = ti.cast(0.0, ti.f64)
            slope = ti.cast(0.0, ti.f64)
            for k in range(first(block, nodes), last(block, nodes)):
                n = self.level_set.band[k]
                for d in ti.static(range(self.dimension)):
                    crosses, t, share = self._crossing(n, d)
                    if crosses:
                        m = n + self.level_set.steps[d]
                        g = (1.0 - t) * self.level_set.normal[n] + t * self.level_set.normal[m]
                        length = ti.max(g.norm(), 1e-6)
                        x = self.grid.origin + t * self.grid.cell * ti.Vector.unit(self.dimension, d)
                        rest = n
                        for e in ti.static(range(self.dimension)):
                            x[e] += (rest // self.level_set.steps[e]) * self.grid.cell
                            rest = rest % self.level_set.steps[e]
                        kappa = (1.0 - t) * self.level_set.curvature[n] + t * self.level_set.curvature[m]
                        # The surface parallel to this one, as far out as smoothing has drawn it in.
                        out = DRAWN_IN * self.spacing**2 * kappa  # (I6)
                        wider = 1.0 + out * kappa / (self.dimension - 1)
                        x -= out / length * g
                        kappa /= wider
                        if place < self.capacity:
                            a = ti.abs(g[d]) / length * (wider * self.grid.cell) ** (self.dimension - 1)
                            if ti.static(self.mixes):
                                near, far = self.level_set.contrast[n], self.level_set.contrast[m]
                                kappa *= near + t * (far - near)  # (I9): exactly 1 at a sharp interface
                            a *= share  # and not what the interface turns by
                            value = self.coefficient * kappa / share - self.body_force[None].dot(x)  # (I1)
                            self.point[place] = x
                            self.point_area[place] = a
                            self.point_jump[place] = value
                            self.point_bin[place] = self._bin(x)
                            area += a
                            jump += a * value
                            slope += a * length
                        place += 1
            self.partial[1, block] = area
            self.partial[2, block] = jump
            self.partial[3, block] = slope
        ti.loop_config(serialize=True)
        for _ in range(1):
            area = total_of(self.partial, 1, nodes)
            self.area[None] = area
            self.mean_jump[None] = total_of(self.partial, 2, nodes) / ti.max(area, 1e-30)
            if area > 0.0:
                relaxed = 0.9 * self.level_set.slope[None] + 0.1 * total_of(self.partial, 3, nodes) / area
                self.level_set.slope[None] = ti.min(ti.max(relaxed, 0.5), 1.5)

    @ti.kernel
    def _sort_points(self):
        for c in self.bin_fill:
            self.bin_fill[c] = 0
        ti.loop_config(serialize=True)
        for _ in range(1):
            for k in range(self.point_count[None]):
                self.bin_fill[self.point_bin[k]] += 1
            total = 0
            for c in range(self.bin_fill.shape[0]):
                size = self.bin_fill[c]
                self.bin_start[c] = total
                self.bin_fill[c] = total
                total += size
            for k in range(self.point_count[None]):
                c = self.point_bin[k]
                s = self.bin_fill[c]
                self.sorted_point[s] = self.point[k]
                self.sorted_area[s] = self.point_area[k]
                self.sorted_jump[s] = self.point_jump[k]
                self.bin_fill[c] += 1

    @ti.kernel
    def _group_points(self):
        """Area, center and mean M of the points in every cube of bins that has any."""
        ti.loop_config(serialize=True)
        for _ in range(1):
            groups = 0
            for cube in range(self.cube_count):
                area, jump, center = 0.0, 0.0, self.body_force[None] * 0.0
                for p in range(self.bin_start[SLICES * cube], self.bin_start[SLICES * (cube + 1)]):
                    area += self.sorted_area[p]
                    jump += self.sorted_area[p] * self.sorted_jump[p]
                    center += self.sorted_area[p] * self.sorted_point[p]
                if area > 0.0:
                    self.group_area[groups] = area
                    self.group_jump[groups] = jump / area
                    self.group_center[groups] = center / area
                    groups += 1
            self.group_count[None] = groups

    @ti.func
    def _near_points(self, x, k, reach):
        """First sorted point, and the one after the last, of those in the k-th row of bins around x that may lie within
        `reach`, R at most.
        """
        row, rest, square = 0, k, reach * reach
        for d in ti.static(range(1, self.dimension)):
            c = self._row(x[d], d) + rest % 3 - 1
            rest = rest // 3
            row += c * self.bin_strides[d]
            low = self.bin_origin[d] + c * self.radius
            square -= ti.max(low - x[d], x[d] - low - self.radius, 0.0) ** 2
        begin, end = 0, 0
        if square > 0.0:
            begin = self.bin_start[row + self._slice(x[0] - ti.sqrt(square))]
            end = self.bin_start[row + self._slice(x[0] + ti.sqrt(square)) + 1]
        return begin, end

    @ti.func
    def _near_interface(self, x):
        """True with a point of the interface within `SEEN` spacings of x."""
        near = False
        for k in range(3 ** (self.dimension - 1)):
            begin, end = self._near_points(x, k, SEEN * self.spacing)
            for p in range(begin, end):
                near = near or (x - self.sorted_point[p]).norm_sqr() < (SEEN * self.spacing) ** 2
        return near

    @ti.func
    def _extended(self, x):
        """M less its mean, and grad M: weighted mean of the interface points, the far ones in groups (I7)."""
        weight = 1e-12 * self.spacing ** (self.dimension - 1)  # of the mean M, for liquid without an interface
        value = 0.0
        weight_gradient = x * 0.0
        value_gradient = x * 0.0
        for k in range(3 ** (self.dimension - 1)):
            begin, end = self._near_points(x, k, self.radius)
            for p in range(begin, end):
                away = x - self.sorted_point[p]
                s = ti.max(1.0 - away.norm_sqr() / self.radius**2, 0.0)     # no branch: rows of points become vectors
                s2 = s * s
                s7 = s2 * s2 * s2 * s
                w = self.sorted_area[p] * s7 * s
                g = (-2.0 * EXTENSION_POWER / self.radius**2 * self.sorted_area[p] * s7) * away
                jump = self.sorted_jump[p] - self.mean_jump[None]
                weight += w
                value += w * jump
                weight_gradient += g
                value_gradient += g * jump
        tail = (TAIL_LENGTH * self.spacing) ** 2
        for p in range(self.group_count[None]):
            away = x - self.group_center[p]
            r2 = away.norm_sqr()
            s = ti.max(1.0 - r2 / self.radius**2, 0.0)
            u = tail / (tail + r2)
            far = self.group_area[p] * u**self.dimension
            w = far * (1.0 - s * s)
            slope = 4.0 / self.radius**2 * far * s - 2.0 * self.dimension / tail * u * w
            jump = self.group_jump[p] - self.mean_jump[None]
            weight += w
            value += w * jump
            weight_gradient += slope * away
            value_gradient += slope * jump * away
        value /= weight
        return value, (value_gradient - value * weight_gradient) / weight

    @ti.kernel
    def _sharpen(self):
        """Add to M at the sorted points what the extension would take from it: 7 % of the buoyancy of a drop of 4 dx.

        `point_jump`, no longer needed in its own order, holds what comes of it until all have been read.
        """
        for p in range(self.point_count[None]):
            value, _ = self._extended(self.sorted_point[p])
            self.point_jump[p] = 2.0 * self.sorted_jump[p] - (value + self.mean_jump[None])  # (I8)
        for p in range(self.point_count[None]):
            self.sorted_jump[p] = self.point_jump[p]

    @ti.kernel
    def _extend(self):
        """M and grad M at the particles."""
        for i in range(self.count[None]):
            x = self.particles.position[i]
            h = self.particles.color[i]
            unsure = self.level_set.mixed[i] == 1
            if ti.static(self.mixes):
                unsure = True
            if unsure:
                phi = self.grid.interpolate(self.level_set.phi, x)
                side = ti.select(phi > 0.0, 1.0, 0.0)
                # A label that the level set cannot see, as of a drop of one particle, gets gravity only.
                if side != h and (ti.abs(phi) > self.spacing or not self._near_interface(x)):
                    h = side
            # Gas, on the wrong side of the level set too, bears no force: it would be that on water, 1000 times what
            # the mass of gas bears. Where gas is the second liquid, that is a constant more of the pressure (I2).
            if ti.static(self.light >= 0):
                stray = self.particles.color[i] == self.light and h != self.light
                self.stray_weight[i] = ti.select(stray, 1.0, 0.0)
            if ti.static(self.light == 1):
                h = ti.max(h, self.particles.color[i]) - 1.0
            if ti.static(self.light == 0):
                h = ti.min(h, self.particles.color[i])
            self.particles.jump_weight[i] = h
            value, slope = 0.0, x * 0.0
            if h != 0.0:
                value, slope = self._extended(x)
            self.particles.jump[i] = value + self.mean_jump[None]
            self.particles.jump_force[i] = slope + self.body_force[None]

    @ti.kernel
    def _share_buoyancy(self):
        """Let the other liquid around gas that the level set cannot see bear its buoyancy (I12).

        The force of tension leaves the liquid around without a gradient of pressure, which would lift such gas.
        """
        pairs = self.solver.search.pairs
        for i in range(self.count[None]):
            if self.stray_weight[i] > 0.0:
                total = 0.0
                for slot in range(pairs.count[i]):
                    k = pairs.entry(i, slot)
                    if self.particles.color[pairs.index[k]] != self.light:
                        total += pairs.weight[k]
                self.stray_weight[i] = ti.select(total > 0.0, 1.0 / ti.max(total, 1e-20), 0.0)
        for i in range(self.count[None]):
            borne = 0.0
            if self.particles.color[i] != self.light:
                for slot in range(pairs.count[i]):
                    k = pairs.entry(i, slot)
                    borne += pairs.weight[k] * self.stray_weight[pairs.index[k]]
            self.borne[i] = borne

    @ti.func
    def body_acceleration(self, i):
        weight = self.particles.jump_weight[i]
        if ti.static(self.light >= 0):
            weight *= 1.0 + self.borne[i]
        return -weight * self.particles.volume[i] / self.particles.mass[i] * self.particles.jump_force[i]

    @ti.func
    def potential(self, i):
        """H (M + b.x): the pressure that this form keeps out of the solve (I2), Pa."""
        return self.particles.jump_weight[i] * (
            self.particles.jump[i] + self.body_force[None].dot(self.particles.position[i]))

    def state(self) -> dict:
        return {"phi": self.level_set.phi.to_numpy(), "slope": self.level_set.slope[None],
                "started": self.level_set.started[None]}

    def restore(self, state: dict) -> None:
        if state:
            self.level_set.restore(state["phi"], state["slope"], state["started"])
