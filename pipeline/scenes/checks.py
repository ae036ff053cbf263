"""What has to hold between the parts of a scene, beyond the range of every single number.

Every check is a function whose arguments name the parts of the scene that it looks at, and which yields the key and the
message of every error. A check whose parts could not be read is left out: their errors are reported already.
"""
import contextlib
import dataclasses
import functools
import inspect
import itertools
import math
import re
from collections.abc import Callable, Iterator, Mapping
from typing import Any

import numpy as np

from pipeline.scenes import container_checks
from pipeline.scenes.eye_shape import eye_shape
from pipeline.scenes.model import Block, Container, Eye, Initial, Material, Output, Scene
from pipeline.scenes.reader import Key, NotRead
from sim.effects import REGISTRY
from sim.effects.eye_rotation import LARGEST_PEAK, SMALLEST_PEAK
from sim.settings import Numerics

Found = Iterator[tuple[Key, str]]

# Two effects for one physics would act twice.
CONFLICTS = (
    ("viscosity", "viscosity_implicit", "both apply the shear stress"),
    ("viscosity", "xsph", "both apply the shear stress"),
    ("viscosity_implicit", "xsph", "both apply the shear stress"),
    ("interface_tension", "cohesion", "both pull the interface together"),
    ("interface_tension", "curvature", "both pull the interface together"),
    ("diffusion", "collision", "one mixes the liquids, the other keeps them apart"),
    ("drift", "collision", "one mixes the liquids, the other keeps them apart"),
    ("interface_tension", "adhesion", "its contact angle says how the wall is wetted"),
    ("injection", "viscoelastic", "particles that split or merge would not keep their stress"),
    ("injection", "diffusion", "the fill is counted in unmixed particles, so let another scene start from the end"),
    ("injection", "contact_line_emulsification",
     "the fill is counted in unmixed particles, so let another scene start from the end"),
    ("contact_line_emulsification", "collision", "one mixes the liquids, the other keeps them apart"),
    ("injection", "drift", "the fill is counted in unmixed particles, so let another scene start from the end"),
)
LEAST_LEFT = 0.005  # of the cavity, of the liquid that an injection drains: fewer particles cannot give way evenly
NEED_TWO_LIQUIDS = ("injection", "interface_tension", "drift", "diffusion", "collision")
MOST_FRAMES = 100_000
FEWEST_SPACINGS = 8  # per axial length: below, no particle has a full support inside the cavity


_CHECKS: list[Callable[..., Found]] = list(container_checks.CHECKS)


def _check(function: Callable[..., Found]) -> Callable[..., Found]:
    _CHECKS.append(function)
    return function


def check(parts: Mapping[str, object]) -> Found:
    """Yield the errors of all checks whose parts (fields of a Scene, by name) are there."""
    for function in _CHECKS:
        names = inspect.signature(function).parameters
        if names.keys() <= parts.keys():
            with contextlib.suppress(NotRead):
                yield from function(**{name: parts[name] for name in names})


def _of_eye(name: str, parts: Mapping) -> object:
    return getattr(parts["eye"], name, "no eye")


# What a scene must have in common with the one whose last checkpoint it starts from, as error messages show it.
_SAME_AS_START: dict[Key, Callable[[Mapping], object]] = {
    ("dimension",): lambda parts: parts["dimension"],
    ("liquids",): lambda parts: ", ".join(liquid.name for liquid in parts["liquids"]),
    ("numerics", "particle_spacing"): lambda parts: f"{1e3 * parts['numerics'].particle_spacing:.9g} mm",
    **{("eye", field.name): functools.partial(_of_eye, field.name) for field in dataclasses.fields(Eye)},
    ("container",): lambda parts: _box_in_words(parts["container"]),
}


def _box_in_words(container: Container | None) -> str:
    return "no container" if container is None else f"{' x '.join(f'{side:g}' for side in container.size)} m"


def check_start(parts: Mapping[str, Any], start: Scene, fill: Mapping[str, float] | None) -> Found:
    """Yield the errors of a scene that cannot start from the last checkpoint of ``start``.

    fill : share of the cavity that each liquid holds at the end of it, where that is known.
    """
    if fill is not None and "effects" in parts:
        with contextlib.suppress(NotRead):
            yield from _leaves_enough(parts["effects"], fill)
    for key, shown in _SAME_AS_START.items():
        with contextlib.suppress(NotRead, KeyError):
            found, expected = shown(parts), shown(vars(start))
            if found != expected:
                yield key, f"is {found}, but must be {expected} as in {start.name}, from which this scene starts"


@_check
def _name_fits_into_paths(name: str) -> Found:
    if not re.fullmatch(r"[A-Za-z0-9_-]+", name):
        yield (), f'a scene named "{name}" cannot name a folder, use letters, digits, "_" and "-"'


@_check
def _colors(liquids: tuple[Material, ...]) -> Found:
    for liquid in liquids:
        if not re.fullmatch(r"#[0-9a-fA-F]{6}", liquid.color):
            yield ("liquids", liquid.name, "color"), f'is "{liquid.color}", but must be of the form "#rrggbb"'


@_check
def _liquids_are_enough(liquids: tuple[Material, ...], effects: dict) -> Found:
    if not liquids:
        yield ("liquids",), "is empty, but must name one liquid at least"
    if len(liquids) == 1:
        for name in effects.keys() & set(NEED_TWO_LIQUIDS):
            yield ("effects", name), "needs two liquids at least, but the scene has one"
    # The oil in droplets is a part of the aqueous, a few millionths of it: it has no interface of its own here.
    bulk = len(liquids) - ("contact_line_emulsification" in effects)
    if bulk > 2 and "interface_tension" in effects:
        yield ("effects", "interface_tension"), f"knows one interface, but the scene has {len(liquids)} liquids"


@_check
def _effects_do_not_conflict(effects: dict) -> Found:
    for first, second, reason in CONFLICTS:
        if effects.keys() >= {first, second}:
            yield ("effects", second), f"cannot be used together with {first}: {reason}; remove one of them"


@_check
def _cohesion_has_one_strength(effects: dict) -> Found:
    cohesion = effects.get("cohesion")
    if cohesion and (cohesion.gamma is None) == (cohesion.tension is None):
        given = "neither gamma nor tension" if cohesion.gamma is None else "both gamma and tension"
        yield ("effects", "cohesion"), f"gives {given}, but needs one of the two"


@_check
def _effects_have_what_they_require(effects: dict) -> Found:
    for name in effects:
        for required in REGISTRY[name].requires:
            if required not in effects:
                yield ("effects", name), f"needs the effect {required} too; add {required} or remove {name}"


@_check
def _droplets_are_a_liquid(effects: dict, liquids: tuple[Material, ...]) -> Found:
    effect = effects.get("contact_line_emulsification")
    if not effect:
        return
    key = ("effects", "contact_line_emulsification")
    chosen = {name: getattr(effect, name) for name in ("oil", "aqueous", "droplets")}
    if len(liquids) < 3 or len(set(chosen.values())) < 3:
        given = ", ".join(f"{name} {value}" for name, value in chosen.items())
        yield key, ("needs three liquids: oil, aqueous, and the oil in droplets as a third liquid of the scene, but it "
                    f"has {given}")
        return
    densities = {liquid.name: liquid.density for liquid in liquids}
    if densities[effect.droplets] != densities[effect.oil]:
        yield (*key, "droplets"), (f"is {effect.droplets} of {densities[effect.droplets]:g} kg/m3, but must have the "
                                   f"density of {effect.oil}, {densities[effect.oil]:g} kg/m3, of which it consists")
    for name in ("oil", "aqueous"):
        if not next(liquid.dynamic_viscosity for liquid in liquids if liquid.name == chosen[name]):
            yield ("liquids", chosen[name], "dynamic_viscosity"), "is 0 Pa s, but must be above 0 to tear off droplets"
    if np.linalg.norm(effect.saccade_axis) == 0.0:
        yield (*key, "saccade_axis"), "is 0, 0, 0, but must have a direction"


@_check
def _drift_has_drag_and_a_way(effects: dict, liquids: tuple[Material, ...]) -> Found:
    drift = effects.get("drift")
    for liquid in liquids if drift and drift.coefficient > 0.0 else ():
        if liquid.dynamic_viscosity == 0.0:
            yield (("liquids", liquid.name, "dynamic_viscosity"),
                   "is 0 Pa s, but must be above 0, for the drag on its droplets (effect drift)")
    if drift and drift.dispersed is not None and drift.dispersed == drift.continuous:
        yield (("effects", "drift", "continuous"),
               f"is {drift.continuous}, the liquid of the droplets, but must be another one")


@_check
def _elastic_liquids_are_named_once(effects: dict) -> Found:
    elastic = [one.liquid for one in effects["viscoelastic"].liquids] if "viscoelastic" in effects else []
    for index, liquid in enumerate(elastic):
        if liquid in elastic[:index]:
            yield ("effects", "viscoelastic", "liquids", index), f"describes {liquid} again; remove one of the two"
    if "viscoelastic" in effects and not elastic:
        yield ("effects", "viscoelastic", "liquids"), "is empty, but must name one liquid at least"


@_check
def _turns_follow_each_other(effects: dict) -> Found:
    turns = effects["gravity"].turns if "gravity" in effects else ()
    for index, (turn, following) in enumerate(itertools.pairwise(turns)):
        end = turn.start + turn.duration
        if following.start < end - 1e-9:
            yield (("effects", "gravity", "turns", index + 1, "start"),
                   f"is {following.start:g} s, but the turn before ends at {end:g} s, and turns must not overlap")


@_check
def _rotation_is_one_movement(effects: dict, dimension: int) -> Found:
    rotation = effects.get("eye_rotation")
    if rotation is None:
        return
    key = ("effects", "eye_rotation")
    if rotation.saccades and rotation.oscillation:
        yield (*key, "oscillation"), "is given beside saccades, but an eye does one or the other"
    places: list[Key] = [(*key, "saccades", index) for index in range(len(rotation.saccades))]
    for place, saccade in zip(places, rotation.saccades, strict=True):
        if not SMALLEST_PEAK <= saccade.peak_over_mean <= LARGEST_PEAK:
            yield ((*place, "peak_rate"),
                   f"is {saccade.peak_over_mean:.3g} times the mean rate, but must be {SMALLEST_PEAK:.3g} to "
                   f"{LARGEST_PEAK:.3g} times it (amplitude over duration)")
        if saccade.count > 1 and saccade.interval < saccade.lasts - 1e-9:
            yield (*place, "interval"), (f"is {saccade.interval:g} s, but each of the saccades takes "
                                         f"{saccade.lasts:g} s, and they must not overlap")
    for place, (one, following) in zip(places[1:], itertools.pairwise(rotation.saccades), strict=True):
        if following.start < one.end - 1e-9:
            yield ((*place, "start"), f"is {following.start:g} s, but the saccade before ends at {one.end:g} s, and "
                                      "saccades must not overlap")
    movements: list[tuple[Key, Any]] = [(("oscillation",), rotation.oscillation)] if rotation.oscillation else []
    for place, movement in [*movements, *((place[2:], s) for place, s in zip(places, rotation.saccades, strict=True))]:
        if not any(movement.axis):
            yield (*key, *place, "axis"), "is (0, 0, 0), but must have a direction"
        elif dimension == 2 and any(movement.axis[:2]):
            yield (*key, *place, "axis"), "must be along z in two dimensions, as in [0, 0, 1]"


@_check
def _injection_exchanges(effects: dict) -> Found:
    injection = effects.get("injection")
    if injection and injection.liquid == injection.drained_liquid:
        yield (("effects", "injection", "drained_liquid"),
               f"is {injection.liquid}, the liquid that enters, but must be another one")
    if injection and injection.cannula == injection.drain:
        yield ("effects", "injection", "drain"), "is where the cannula is, but must be away from it"


@_check
def _injection_is_in_the_eye(effects: dict, eye: Eye | None, dimension: int) -> Found:
    # The voxelize stage asks again, for a user's mesh too; here nothing is made, so nothing can be lost.
    injection = effects.get("injection")
    if not injection or eye is None or eye.model != "parametric" or dimension != 3:
        return
    shape = eye_shape(eye.axial_length, lens=eye.lens, horizontal_diameter=eye.horizontal_diameter,
                      vertical_diameter=eye.vertical_diameter)
    for key in ("cannula", "drain"):
        point = np.array(getattr(injection, key))
        if shape.level(point) >= 0.0:
            place = ", ".join(f"{1e3 * value:g}" for value in point)
            yield (("effects", "injection", key), f"is ({place}) mm, outside the eye, but must lie inside its cavity "
                                                  "(origin = center of the globe, z forward)")


@_check
def _injection_starts_in_time(effects: dict, output: Output) -> Found:
    injection = effects.get("injection")
    if injection and injection.start >= output.duration:
        yield (("effects", "injection", "start"),
               f"is {injection.start:g} s, but the scene ends at {output.duration:g} s")


@_check
def _injection_has_room(initial: Initial, effects: dict, start_from: str | None, container: Container | None,
                        blocks: tuple[Block, ...]) -> Found:
    if start_from is not None or not (blocks or initial.fill or initial.liquid):
        return
    fill = initial.fill or {initial.liquid: 1.0}
    if blocks:
        if container is None or any(block.replaces for block in blocks):  # what they leave only the particles tell
            return
        fill = dict.fromkeys((block.liquid for block in blocks), 0.0)
        for block in blocks:
            fill[block.liquid] += block.volume / math.prod(container.size)
    injection = effects.get("injection")
    if injection and fill.get(injection.liquid, 0.0) >= injection.fill:
        yield (("effects", "injection", "fill"),
               f"is {100 * injection.fill:g} %, but {injection.liquid} holds {100 * fill[injection.liquid]:g} % of the "
               "cavity at the start")
    else:
        yield from _leaves_enough(effects, fill)


def _leaves_enough(effects: Mapping, fill: Mapping[str, float]) -> Found:
    """What speaks against the fill of an injection where liquids hold these shares of the cavity at the start."""
    injection = effects.get("injection")
    if not injection:
        return
    leaving = fill.get(injection.drained_liquid, 0.0)
    most = fill.get(injection.liquid, 0.0) + leaving - LEAST_LEFT
    if injection.fill > most + 1e-9:
        yield (("effects", "injection", "fill"),
               f"is {100 * injection.fill:g} %, which drains all {injection.drained_liquid} ({100 * leaving:g} % of "
               f"the cavity at the start), but must be at most {100 * most:g} %")


@_check
def _initial_is_full(initial: Initial) -> Found:
    if initial.fill is None:
        return
    if initial.liquid is not None:
        yield ("initial",), "gives both liquid and fill, but only one of them can fill the cavity"
    total = sum(initial.fill.values())
    if not math.isclose(total, 1.0, abs_tol=1e-6):
        yield ("initial", "fill"), f"adds up to {100 * total:g} %, but a closed cavity must be filled to 100 %"


@_check
def _level_needs_gravity(initial: Initial, effects: dict) -> Found:
    if initial.fill is not None and "gravity" not in effects:
        yield ("initial", "fill"), "stacks liquids by weight, but the scene has no effect gravity"


@_check
def _eye_is_one_model(eye: Eye | None) -> Found:
    if eye is None:
        return
    if eye.model == "mesh" and eye.path is None:
        yield ("eye", "path"), "is missing, but an eye of model mesh must name its mesh file"
    if eye.model == "parametric" and eye.path is not None:
        yield ("eye", "path"), "is given, but model is parametric; use model: mesh to read a mesh file"


@_check
def _spacing_fits_eye(eye: Eye | None, numerics: Numerics) -> Found:
    if eye is None or eye.model != "parametric":
        return
    spacings = eye.axial_length / numerics.particle_spacing
    if spacings < FEWEST_SPACINGS:
        yield (("numerics", "particle_spacing"),
               f"is {1000 * numerics.particle_spacing:g} mm, but must be at most "
               f"{1000 * eye.axial_length / FEWEST_SPACINGS:.3g} mm, an eighth of the axial length")


@_check
def _time_steps_are_ordered(numerics: Numerics) -> Found:
    if numerics.minimum_time_step >= numerics.maximum_time_step:
        yield (("numerics", "minimum_time_step"),
               f"is {numerics.minimum_time_step:g} s, but must be below maximum_time_step, "
               f"{numerics.maximum_time_step:g} s")


@_check
def _frames_end_with_the_scene(output: Output) -> Found:
    count = output.duration / output.frame_interval
    if count >= MOST_FRAMES:
        yield ("output", "frame_interval"), f"gives {count:.6g} frames, but at most {MOST_FRAMES} can be saved"
    elif round(count) < 1 or not math.isclose(count, round(count), rel_tol=1e-9):
        yield (("output", "duration"),
               f"is {output.duration:g} s, but must be a whole multiple of frame_interval, {output.frame_interval:g} s")


@_check
def _movie_size_is_even(output: Output) -> Found:
    if any(size % 2 for size in output.image_size):
        yield ("output", "image_size"), f"is {list(output.image_size)}, but movies need even numbers"
