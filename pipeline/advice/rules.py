"""Which effects of a scene are seen in its results, which are not, and which are missing.

Every rule is a function of the scene's scales and limits that yields advice of one sentence each: the number that
decides, and the threshold it is held against.
"""
import dataclasses
import math
from collections.abc import Callable, Iterator

from pipeline.advice.dimensionless_numbers import EARTH_GRAVITY, Scales, shown
from pipeline.advice.time_step_limits import Limit
from sim.effect_selection import cheapest
from sim.effects import REGISTRY
from sim.effects.contact_line_emulsification import shear_per_distance, volume_per_shear
from sim.effects.drift import rise_speed
from sim.effects.xsph import kinematic_viscosity

# In particle spacings: what moves, spreads or acts over less than one is lost between neighboring particles.
SEEN = 1.0
# The interface is curved within the capillary length L/sqrt(Bo) of the wall: above 100 a rim of less than a tenth of L,
# and flat elsewhere; below 10 a third of L or more, that is the shape as a whole.
FLAT_BOND, ROUND_BOND = 100.0, 10.0
# Waves of the interface lose a fraction of about 5 Oh of their height per radian (Lamb: damping 5 nu/R2 of a drop).
DAMPED_OHNESORGE = 0.1
# One order of magnitude: the liquids then answer visibly differently to the same stress.
VISCOSITY_RATIO = 10.0
# The implicit solve took an eighth of a step (oil of 1 Pa s, 600 particles) and takes more iterations in finer scenes;
# it is taken to double the cost of a step at most.
IMPLICIT_STEP_COST = 2.0
# Silicone oil in water (40 mN/m); water and other oils have 20 to 50.
TYPICAL_TENSION = 0.04
# At Re 1 the drag is 19 % above that of Stokes (Oseen: 3/16 Re), and beyond droplets are far slower.
STOKES_REYNOLDS = 1.0
# The inertial forces of a turn, which the solver leaves out, over the buoyancy, which it has.
INERTIA_OF_TURN = 1.0

ADVISED = {"gravity", "interface_tension", "cohesion", "curvature", "adhesion", "viscosity", "viscosity_implicit",
           "drift", "diffusion", "injection", "contact_line_emulsification", "eye_rotation",
           "collision", "viscoelastic", "xsph"}
SEEN_EFFECT, WARNING, NOTE = "matters", "warning", "note"


@dataclasses.dataclass(frozen=True)
class Advice:
    """One sentence about an effect; ``level`` is "matters", "warning" or "note"."""

    level: str
    effect: str
    sentence: str


Found = Iterator[Advice]
_RULES: list[Callable[[Scales, list[Limit]], Found]] = []


def _rule(function: Callable[[Scales, list[Limit]], Found]) -> Callable[[Scales, list[Limit]], Found]:
    _RULES.append(function)
    return function


def advice(scales: Scales, limits: list[Limit]) -> list[Advice]:
    """Return the advice of all rules: warnings first, then what matters, then notes."""
    found = [one for rule in _RULES for one in rule(scales, limits)]
    return sorted(found, key=lambda one: (WARNING, SEEN_EFFECT, NOTE).index(one.level))


def _times(reach: float, scales: Scales) -> str:
    """Return a length with its size in particle spacings and the threshold from which it is seen."""
    return f"{shown(reach, 'm')} ({reach / scales.spacing:.3g} particle spacings; seen from {SEEN:g})"


def _is_seen(reach: float, scales: Scales) -> bool:
    return reach >= SEEN * scales.spacing


@_rule
def _strength(scales: Scales, limits: list[Limit]) -> Found:
    for effect, key, unit in (("gravity", "magnitude", "m/s2"), ("interface_tension", "coefficient", "N/m"),
                              ("drift", "coefficient", "(a pure number)"), ("diffusion", "coefficient", "m2/s"),
                              ("cohesion", "gamma", "N m3/kg2"),
                              ("cohesion", "tension", "N/m"), ("curvature", "gamma", "m/s2"),
                              ("adhesion", "beta", "N m3/kg2"),
                              ("xsph", "coefficient", "(a pure number)")):
        parameters = scales.scene.effects.get(effect)
        jolted = effect == "gravity" and scales.jolts
        if parameters and getattr(parameters, key) == 0.0 and not jolted:
            yield Advice(WARNING, effect, f"does nothing: its {key} is 0 {unit}, not above 0")


@_rule
def _two_liquids(scales: Scales, limits: list[Limit]) -> Found:
    for effect in ("interface_tension", "drift", "diffusion"):
        if effect in scales.scene.effects and len(scales.liquids) == 1:
            yield Advice(WARNING, effect, "cannot be seen: it acts between 2 liquids, but 1 is ever in the cavity, "
                                          f"{scales.liquids[0].name}")


@_rule
def _gravity(scales: Scales, limits: list[Limit]) -> Found:
    acceleration = scales.buoyancy(scales.gravity or EARTH_GRAVITY)
    speed = scales.buoyant_speed if scales.scene.closed else scales.falling_speed
    reach = scales.reach(acceleration, speed(scales.gravity or EARTH_GRAVITY))
    if not scales.gravity:
        if "gravity" not in scales.scene.effects and _is_seen(reach, scales):
            cause = (f"the liquids differ by {scales.density_difference:.3g} kg/m3" if scales.scene.closed else
                     "the liquid has a free surface")
            yield Advice(WARNING, "gravity", f"is missing and would be seen: {cause}, and 9.81 m/s2 would move them by "
                                             f"up to {_times(reach, scales)}")
    elif acceleration == 0.0:
        yield Advice(WARNING, "gravity", "cannot be seen: the liquids differ by 0 kg/m3, not by more than 0, and in a "
                                         "full cavity equal weights only shift the pressure")
    elif not _is_seen(reach, scales):
        yield Advice(WARNING, "gravity", f"cannot be seen: within the scene it moves liquid by {_times(reach, scales)}")
    else:
        yield Advice(SEEN_EFFECT, "gravity", f"within the scene it can move liquid by {_times(reach, scales)}")


@_rule
def _turns(scales: Scales, limits: list[Limit]) -> Found:
    events = [(f"the turn to {turn.to}", turn) for turn in scales.turns] + [("a jolt", jolt) for jolt in scales.jolts]
    for what, event in events:
        if event.start >= scales.duration:
            yield Advice(WARNING, "gravity", f"{what} is not reached: it starts at {shown(event.start, 's')}, but the "
                                             f"scene ends at {shown(scales.duration, 's')}")
    buoyancy, inertia = scales.buoyancy(scales.gravity), scales.turn_acceleration
    if buoyancy and inertia > INERTIA_OF_TURN * buoyancy:
        yield Advice(NOTE, "gravity", "the inertial forces of a turn are left out: the wall accelerates by up to "
                                      f"{shown(inertia, 'm/s2')}, {inertia / buoyancy:.2g} times the buoyancy "
                                      f"(small below {INERTIA_OF_TURN:g})")


@_rule
def _rotation(scales: Scales, limits: list[Limit]) -> Found:
    rotation = scales.rotation
    if not rotation:
        return
    for saccade in rotation.saccades:
        if saccade.end > scales.duration:
            yield Advice(WARNING, "eye_rotation", f"a saccade is not reached or not over: the last one ends at "
                                                  f"{shown(saccade.end, 's')}, but the scene at "
                                                  f"{shown(scales.duration, 's')}")
    way = max((movement.amplitude for movement in rotation.movements), default=0.0) * scales.length
    if not _is_seen(way, scales):
        yield Advice(WARNING, "eye_rotation", f"cannot be seen: the wall moves by {_times(way, scales)}")
        return
    yield Advice(SEEN_EFFECT, "eye_rotation", f"the wall moves by {_times(way, scales)}, at up to "
                                              f"{shown(rotation.peak * scales.length, 'm/s')}")
    if not scales.viscous:
        yield Advice(WARNING, "eye_rotation", "drags nothing along: the scene has no viscosity, so the liquid slips "
                                              "along a round wall")
        return
    for liquid in scales.liquids:
        layer = math.sqrt(2.0 * liquid.dynamic_viscosity / liquid.density * rotation.shortest / math.pi)
        if not _is_seen(layer, scales):
            yield Advice(NOTE, "eye_rotation", f"the layer of {liquid.name} that the wall drags along is not resolved: "
                                               f"{_times(layer, scales)}; its shear stress at the wall is too low")


@_rule
def _tension(scales: Scales, limits: list[Limit]) -> Found:
    if not scales.tension:
        return
    rounding = scales.tension / (scales.density * scales.length**2)
    reach = scales.reach(rounding, scales.capillary_speed(scales.tension))
    bond = scales.bond_number(scales.gravity, scales.tension)
    rim = scales.length / math.sqrt(bond) if bond else math.inf
    if not _is_seen(reach, scales):
        yield Advice(WARNING, "interface_tension", "cannot be seen: within the scene it moves the interface by "
                                                   f"{_times(reach, scales)}")
    elif bond > FLAT_BOND:
        seen = "can hardly be seen" if _is_seen(rim, scales) else "cannot be seen"
        own = next(limit.value for limit in limits if limit.source == "effects.interface_tension")
        yield Advice(WARNING, "interface_tension",
                     f"{seen}: Bo = {bond:.3g} is above {FLAT_BOND:g}, so the interface is flat but for a rim of "
                     f"{_times(rim, scales)}, and it limits the time step to {shown(own, 's')}")
    else:
        shape = (f"below {ROUND_BOND:g}, so it rounds the liquid as a whole" if bond < ROUND_BOND else
                 f"from {ROUND_BOND:g} to {FLAT_BOND:g}, so it curves a rim of {_times(rim, scales)}")
        yield Advice(SEEN_EFFECT, "interface_tension", f"Bo = {bond:.3g} is {shape}")
        yield _wetting(scales, min(rim, scales.length))


def _wetting(scales: Scales, rim: float) -> Advice:
    """Height sqrt(2(1 - sin theta)) capillary lengths of the meniscus at an upright flat wall (Young-Laplace)."""
    angle = scales.scene.effects["interface_tension"].contact_angle
    climb = rim * math.sqrt(max(2.0 * (1.0 - math.sin(angle)), 0.0))
    text = f"a contact angle of {math.degrees(angle):g} deg bends the interface at the wall by {_times(climb, scales)}"
    return Advice(SEEN_EFFECT if _is_seen(climb, scales) else NOTE, "interface_tension", text)


@_rule
def _missing_tension(scales: Scales, limits: list[Limit]) -> Found:
    effects = scales.scene.effects
    if effects.keys() & {"interface_tension", "drift", "diffusion"} or len(scales.scene.liquids) != 2:
        return  # mixing liquids have no tension, and the effect knows one interface
    if len(scales.liquids) != 2 or not scales.scene.closed:
        return
    if "cohesion" in effects and effects["cohesion"].tension:
        return
    if any(effects[name].gamma for name in effects.keys() & {"cohesion", "curvature"}):
        return
    bond = scales.bond_number(scales.gravity, TYPICAL_TENSION)
    reach = scales.reach(TYPICAL_TENSION / (scales.density * scales.length**2), scales.capillary_speed(TYPICAL_TENSION))
    if bond < ROUND_BOND and _is_seen(reach, scales):
        yield Advice(WARNING, "interface_tension",
                     f"is missing and would be seen: with {1e3 * TYPICAL_TENSION:g} mN/m, as oil in water has, "
                     f"Bo = {bond:.3g} is below {ROUND_BOND:g} (unless the two liquids have no interface)")
    else:
        yield Advice(NOTE, "interface_tension",
                     f"is rightly left out: with {1e3 * TYPICAL_TENSION:g} mN/m, as oil in water has, Bo = {bond:.3g} "
                     f"(it rounds the liquid below {ROUND_BOND:g}), and it moves the interface by "
                     f"{_times(reach, scales)}")


@_rule
def _forces_without_unit(scales: Scales, limits: list[Limit]) -> Found:
    for name, key in (("cohesion", "gamma"), ("curvature", "gamma"), ("adhesion", "beta")):
        value = getattr(scales.scene.effects.get(name), key, None)
        if value:
            yield Advice(NOTE, name, f"its {key} of {value:g} is above 0, but no tension in N/m: Bo, We, Ca and Oh are "
                                     "unknown")


@_rule
def _viscosity(scales: Scales, limits: list[Limit]) -> Found:
    name = next((name for name in ("viscosity", "viscosity_implicit", "xsph") if name in scales.scene.effects), None)
    if name == "xsph" and scales.scene.effects[name].coefficient is not None:
        return
    layers = {liquid.name: scales.layer(liquid) for liquid in scales.liquids}
    thickest = max(layers, key=layers.get)
    if scales.speed == 0.0 and scales.scene.start_from is None:
        if name:
            yield Advice(WARNING, name, "cannot be seen: nothing sets the liquids in motion, U is 0 m/s, not above 0")
    elif name is None:
        yield _missing_viscosity(scales, limits, thickest)
    elif not _is_seen(layers[thickest], scales):
        yield Advice(WARNING, name, f"cannot be seen: it acts in a layer of {_times(layers[thickest], scales)} of "
                                    f"{thickest} at most")
    else:
        for liquid, layer in layers.items():
            if _is_seen(layer, scales):
                yield Advice(SEEN_EFFECT, name, f"{liquid} feels it over {_times(layer, scales)}")
            else:
                yield Advice(NOTE, name, f"the layer of {liquid} in which it acts is not resolved: "
                                         f"{_times(layer, scales)}")
        yield from _cost_of_viscosity(scales, name, limits)


@_rule
def _xsph(scales: Scales, limits: list[Limit]) -> Found:
    coefficient = getattr(scales.scene.effects.get("xsph"), "coefficient", None)
    if coefficient:
        step = min(limit.value for limit in limits)
        nu = kinematic_viscosity(coefficient, step, scales.scene.numerics, scales.scene.dimension)
        yield Advice(NOTE, "xsph", f"its coefficient of {coefficient:g} is a kinematic viscosity of "
                                   f"{shown(nu, 'm2/s')} in steps of {shown(step, 's')}, more in shorter ones")


def _missing_viscosity(scales: Scales, limits: list[Limit], liquid: str) -> Advice:
    layer = max(map(scales.layer, scales.liquids))
    if not _is_seen(layer, scales):
        return Advice(NOTE, "viscosity", f"is rightly left out: it would act in a layer of {_times(layer, scales)} of "
                                         f"{liquid} at most")
    reason = f"{liquid} would feel it over {_times(layer, scales)}"
    thinnest = min(one.dynamic_viscosity for one in scales.liquids)
    ohnesorge = scales.ohnesorge_number(scales.stiffest) if scales.tension else 0.0
    if ohnesorge >= DAMPED_OHNESORGE:
        reason += f", and Oh = {ohnesorge:.3g} (damped from {DAMPED_OHNESORGE:g})"
    elif thinnest and scales.stiffest.dynamic_viscosity >= VISCOSITY_RATIO * thinnest:
        reason += (f", and is {scales.stiffest.dynamic_viscosity / thinnest:.3g} times as stiff as the thinnest liquid "
                   f"(they differ visibly from {VISCOSITY_RATIO:g})")
    name = "viscosity_implicit" if _steps_for_explicit(scales, limits) > IMPLICIT_STEP_COST else "viscosity"
    return Advice(WARNING, name, f"is missing and would be seen: {reason}")


def _steps_for_explicit(scales: Scales, limits: list[Limit]) -> float:
    """How many steps explicit viscosity needs for one step that everything else allows; at most 1 where it limits none.
    """
    explicit = REGISTRY["viscosity"]
    others = min(limit.value for limit in limits if limit.source != "effects.viscosity")
    return others / explicit.time_step_limit(explicit.Parameters(), scales.scene.settings())


def _cost_of_viscosity(scales: Scales, name: str, limits: list[Limit]) -> Found:
    steps = _steps_for_explicit(scales, limits)
    if name == "viscosity" and steps > IMPLICIT_STEP_COST:
        yield Advice(WARNING, name, f"viscosity_implicit would be cheaper: explicit viscosity takes {steps:.3g} steps "
                                    f"for one that everything else allows (cheaper up to {IMPLICIT_STEP_COST:g})")
    replaced = [note for note in cheapest(scales.scene.settings())[1] if note.startswith(name)]
    if name == "viscosity_implicit" and replaced:
        yield Advice(NOTE, name, replaced[0].removeprefix(f"{name} "))
    elif name == "viscosity_implicit" and steps <= 1.0:
        yield Advice(WARNING, name, f"explicit viscosity would be cheaper: it needs no solve and {steps:.2g} steps for "
                                    "one that everything else allows, so up to 1 it costs no further step")


@_rule
def _diffusion(scales: Scales, limits: list[Limit]) -> Found:
    diffusion = scales.scene.effects.get("diffusion")
    if not diffusion or not diffusion.coefficient or len(scales.liquids) == 1:
        return
    spread = min(math.sqrt(2.0 * diffusion.coefficient * scales.duration), scales.width)
    seen = _is_seen(spread, scales)
    time = scales.length**2 / diffusion.coefficient
    whole = "; to mix all of them" + (" takes" if time <= scales.duration else " would take") + f" {shown(time, 's')}"
    yield Advice(SEEN_EFFECT if seen else WARNING, "diffusion",
                 f"{'' if seen else 'cannot be seen: '}within the {shown(scales.duration, 's')} of the scene the "
                 f"liquids mix over {_times(spread, scales)}{whole}")


@_rule
def _drift(scales: Scales, limits: list[Limit]) -> Found:
    drift = scales.scene.effects.get("drift")
    if not drift or not drift.coefficient or len(scales.liquids) == 1:
        return
    shedding = scales.scene.effects.get("contact_line_emulsification")
    shed = [liquid for liquid in scales.scene.liquids if shedding and liquid.name == shedding.droplets]
    ways = [(abs(rise_speed(droplet, around, drift.droplet_diameter, scales.gravity)), droplet, around)
            for droplet in (*scales.liquids, *shed) for around in scales.liquids
            if droplet is not around and drift.dispersed in (None, droplet.name)
            and drift.continuous in (None, around.name) and droplet.name != drift.continuous]
    speed, droplet, around = max(ways, key=lambda way: way[0], default=(0.0, None, None))
    if speed == 0.0:
        yield Advice(WARNING, "drift", "cannot be seen: droplets move at 0 m/s, for they need gravity and liquids of "
                                       "different densities")
        return
    reach = min(drift.coefficient * speed * scales.duration, scales.width)
    seen = _is_seen(reach, scales)
    yield Advice(SEEN_EFFECT if seen else WARNING, "drift",
                 f"{'' if seen else 'cannot be seen: '}single droplets of {droplet.name} move through {around.name} at "
                 f"{shown(speed, 'm/s')}, within the {shown(scales.duration, 's')} of the scene by "
                 f"{_times(reach, scales)}")
    reynolds = around.density * speed * drift.droplet_diameter / around.dynamic_viscosity
    if reynolds > STOKES_REYNOLDS:
        yield Advice(WARNING, "drift", f"is too fast: droplets of {droplet.name} in {around.name} have a Reynolds "
                                       f"number of {reynolds:.3g}, but the drag of Stokes holds below "
                                       f"{STOKES_REYNOLDS:g}")


@_rule
def _injection(scales: Scales, limits: list[Limit]) -> Found:
    injection = scales.scene.effects.get("injection")
    if not injection:
        return
    end = injection.time_of(scales.injected_volume)
    if end > scales.duration:
        but = f", but the scene ends at {shown(scales.duration, 's')}"
        if scales.scene.start_from is None:
            yield Advice(WARNING, "injection", f"does not reach its fill: it would end at {shown(end, 's')}{but}")
        else:
            yield Advice(NOTE, "injection", f"may not reach its fill: it would end at {shown(end, 's')} if the scene "
                                            f"before had left none of its liquid{but}")
    else:
        yield Advice(SEEN_EFFECT, "injection", f"it ends at {shown(end, 's')}, within the "
                                               f"{shown(scales.duration, 's')} of the scene")


@_rule
def _contact_line_emulsification(scales: Scales, limits: list[Limit]) -> Found:
    name, scene = "contact_line_emulsification", scales.scene
    effect = scene.effects.get(name)
    if not effect:
        return
    if effect.start >= scales.duration or effect.efficiency == 0.0 or effect.saccade_rate == 0.0:
        yield Advice(WARNING, name, "makes no droplets: it starts at "
                                    f"{shown(effect.start, 's')} of {shown(scales.duration, 's')}, with an efficiency "
                                    f"of {effect.efficiency:g} and {effect.saccade_rate:g} saccades per second")
        return
    liquids = {liquid.name: liquid for liquid in scene.liquids}
    oil, aqueous = liquids[effect.oil], liquids[effect.aqueous]
    shear = shear_per_distance(effect.saccade_amplitude, aqueous) * scales.length
    loss = volume_per_shear(effect, oil, aqueous) * shear * 2.0 * math.pi * scales.length
    lapse = (scales.duration - effect.start) * effect.time_lapse
    share = loss * (scales.duration - effect.start) / scales.cavity_volume
    source = "the flow of the scene shears the wall" if effect.shear == "flow" else (
        f"saccades shear the wall by {shear:.3g} 1/s; along an equator the oil would lose {share:.2g} of the cavity")
    yield Advice(SEEN_EFFECT, name, f"{source}; the scene shows {lapse / 86400.0:.3g} days of it")
    yield from _transport_of_droplets(scales, effect)


def _transport_of_droplets(scales: Scales, effect) -> Found:
    name, drift = "contact_line_emulsification", scales.scene.effects.get("drift")
    if drift is None:
        yield Advice(WARNING, name, "its droplets stay where the flow takes them: without the effect drift none rises")
    elif not math.isclose(drift.coefficient, effect.time_lapse, rel_tol=0.01):
        yield Advice(WARNING, name, f"one second shows {effect.time_lapse:.3g} s of its droplets, but "
                                    f"{drift.coefficient:.3g} s of their rise (effects.drift.coefficient)")
    if scales.scene.numerics.precision != "f64":
        yield Advice(WARNING, name, "a share of droplets of some 1e-6 is lost in numbers of seven digits: use "
                                    "numerics.precision f64")


@_rule
def _collision(scales: Scales, limits: list[Limit]) -> Found:
    collision = scales.scene.effects.get("collision")
    if not collision:
        return
    if collision.strength == 0.0:
        yield Advice(WARNING, "collision", "does nothing: its strength is 0, not above 0")
    elif len(scales.liquids) == 1:
        yield Advice(WARNING, "collision", "cannot be seen: it acts between 2 liquids, but 1 is ever in the cavity, "
                                           f"{scales.liquids[0].name}")
    else:
        yield Advice(SEEN_EFFECT, "collision", f"it keeps {len(scales.liquids)} liquids apart, particle by particle; "
                                               "every hit takes energy, and it is no surface tension")


@_rule
def _elasticity(scales: Scales, limits: list[Limit]) -> Found:
    effect = scales.scene.effects.get("viscoelastic")
    density = {liquid.name: liquid.density for liquid in scales.liquids}
    for one in effect.liquids if effect else ():
        if one.shear_modulus == 0.0:
            yield Advice(WARNING, "viscoelastic",
                         f"does nothing in {one.liquid}: its shear modulus is 0 Pa, not above 0")
        elif one.liquid in density:
            cauchy = density[one.liquid] * scales.speed**2 / one.shear_modulus
            does = "tears and flows" if cauchy > 1.0 else "springs"
            yield Advice(SEEN_EFFECT, "viscoelastic",
                         f"rho U2/M of {one.liquid} is {cauchy:.3g}: it {does} (springs below 1)")


@_rule
def _unknown(scales: Scales, limits: list[Limit]) -> Found:
    for name in sorted(scales.scene.effects.keys() - ADVISED):
        yield Advice(NOTE, name, f"there is no advice on it: it is none of the {len(ADVISED)} effects known here")
