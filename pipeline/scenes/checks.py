"""What has to hold between the parts of a scene, beyond the range of every single number.

Every check is a function whose arguments name the parts of the scene that it looks at, and which yields the key and the
message of every error. A check whose parts could not be read is left out: their errors are reported already. What must
hold where an effect acts is in the file of the effect.
"""
import contextlib
import dataclasses
import functools
import inspect
import itertools
import math
import re
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.base.words import printable
from pipeline.scenes import container_checks
from pipeline.scenes.effects import down_at_start, oil_of
from pipeline.scenes.eye_shape import globe_of, shape_of
from pipeline.scenes.model import (
    AT_REST,
    IMAGES,
    LARGEST_ANGLE,
    REST_WINDOW,
    SMALLEST_ANGLE,
    Block,
    Break,
    Container,
    Eye,
    Initial,
    Material,
    Output,
    Region,
    Scene,
    is_closed,
    is_image,
)
from pipeline.scenes.reader import Key, NotRead
from pipeline.scenes.retina import ORA
from sim.effects import REGISTRY
from sim.effects.effect import WEIGHS
from sim.settings import Numerics

Found = Iterator[tuple[Key, str]]

OF_WATER = {"aqueous": 0.7, "water": 0.8}  # mPa s
UNLIKE_ITS_NAME = 3.0  # factor between the viscosity of a liquid and the one that its name says
MOST_PLACES = 100  # each has several columns and lines in plots
MOST_SEGMENTS = 1000  # each has several jobs, which are planned in every call
LONGEST_NAME = 100
NAME = rf"[A-Za-z0-9_-]{{1,{LONGEST_NAME}}}"
TAKEN = ("studies", "measurements", "plans", "logs")  # folders beside those of the scenes
FEWEST_SPACINGS = 8  # per axial length: below, no particle has a full support inside the cavity


_CHECKS: list[Callable[..., Found]] = list(container_checks.CHECKS)


def _check(function: Callable[..., Found]) -> Callable[..., Found]:
    _CHECKS.append(function)
    return function


def check(parts: Mapping[str, Any], *, to_run: bool = True) -> Found:
    """Yield the errors of all checks whose parts (fields of a Scene, by name) are there.

    Parameters
    ----------
    to_run : ask this computer too whether it can run the scene.
    """
    for function in _CHECKS:
        if to_run or function not in container_checks.OF_COMPUTER:
            yield from _asked(function, parts)
    yield from _of_effects({**parts, "begins": True})


def doubts(scene: Scene) -> list[tuple[Key, str]]:
    """Return key and sentence of what a scene may say but hardly means, such as a physics that is the wrong way round.

    It is no error: it can be simulated, and somebody may want it.
    """
    parts = vars(scene) | {"oil": scene.liquids[oil_of(scene)].name, "down": down_at_start(scene)}
    found = [*_oils_float_and_heavy_ones_sink(scene.liquids), *_liquids_flow_as_their_names_say(scene.liquids),
             *_regions_have_limits(scene.regions)]
    for name, parameters in scene.effects.items():
        for function in REGISTRY[name].doubts:
            found += _asked(function, {**parts, "parameters": parameters})
    return found


def _oils_float_and_heavy_ones_sink(liquids: tuple[Material, ...]) -> Found:
    watery = [one for one in liquids if one.clear or "water" in one.name]
    for oil in liquids:
        words = oil.name.lower().split("_")
        for other in watery if "oil" in words and not oil.clear else ():
            heavy = "heavy" in words
            if (other.density - oil.density if heavy else oil.density - other.density) > 0.0:
                yield (("liquids", oil.name, "density"),
                       f"is {oil.density:g} kg/m3, so that it {'floats' if heavy else 'sinks'} in {other.name} "
                       f"({other.density:g} kg/m3), but " + (
                           "heavy oils have 1020 to 1060 kg/m3 and sink; name a silicone oil if a light one is meant"
                           if heavy else "silicone oils have 960 to 980 kg/m3 and float; name heavy_oil_densiron_68 "
                                         "if a heavy one is meant"))


def _liquids_flow_as_their_names_say(liquids: tuple[Material, ...]) -> Found:
    """The number in the name of a silicone oil is its viscosity in cSt, which is about that in mPa s."""
    for one in liquids:
        named = re.fullmatch(r"silicone_oil_([1-9]\d*)(_.*)?", one.name)
        usual = float(named[1]) if named else OF_WATER.get(one.name, 1e3 * one.dynamic_viscosity)
        if usual and not usual / UNLIKE_ITS_NAME <= 1e3 * one.dynamic_viscosity <= usual * UNLIKE_ITS_NAME:
            yield (("liquids", one.name, "dynamic_viscosity"),
                   f"is {1e3 * one.dynamic_viscosity:g} mPa s, but {one.name} has about {usual:g} mPa s (did you mean "
                   f"{usual:g} mPa s?)")


def _regions_have_limits(regions: tuple[Region, ...]) -> Found:
    whole = Region("")
    for index, region in enumerate(regions):
        if dataclasses.replace(region, name="") == whole and not re.search(r"retina|whole|all", region.name.lower()):
            yield (("regions", index),
                   f'has a name, "{region.name}", and no limits, so that it is the whole retina: give its latitudes, '
                   "such as [0 deg, 15 deg] for the macula, its hours or its part")


def _asked(function: Callable[..., Any], parts: Mapping[str, Any]) -> Found:
    names = inspect.signature(function).parameters
    if names.keys() <= parts.keys():
        with contextlib.suppress(NotRead):
            yield from function(**{name: parts[name] for name in names})


def _of_effects(parts: Mapping[str, Any], about: str = "") -> Found:
    """Yield the errors of the checks of effects (`Effect.checks`), of those only that ask for a part, if named."""
    for name, function in _SERVICES.items():
        known = [] if name in parts else list(_asked(function, parts))
        if known:
            parts = {**parts, name: known[0]}
    for name, parameters in parts.get("effects", {}).items():
        for function in REGISTRY[name].checks:
            if not about or about in inspect.signature(function).parameters:
                yield from _asked(function, {**parts, "parameters": parameters})


# What checks of effects can ask for beside the parts of a scene; nothing is yielded where it is not known.

def _closed(container: Container | None, blocks: tuple[Block, ...]) -> Iterator[bool]:
    yield is_closed(container, blocks)


def _bulk_liquids(liquids: tuple[Material, ...], effects: dict) -> Iterator[int]:
    """Number of liquids that can have an interface."""
    yield len(liquids) - sum(REGISTRY[name].traces for name in effects)


def _fill(initial: Initial, start_from: str | None, container: Container | None, blocks: tuple[Block, ...]
          ) -> Iterator[dict[str, float]]:
    """Share of the cavity that each liquid holds at the start."""
    if start_from is not None or not (blocks or initial.fill or initial.liquid):
        return
    if not blocks:
        yield initial.fill or {initial.liquid: 1.0}
    elif container is not None and not any(block.replaces for block in blocks):  # what is left only particles tell
        fill = dict.fromkeys((block.liquid for block in blocks), 0.0)
        for block in blocks:
            fill[block.liquid] += block.volume / math.prod(container.size)
        yield fill


_SERVICES: dict[str, Callable[..., Any]] = {"closed": _closed, "bulk_liquids": _bulk_liquids, "fill": _fill}


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
    if fill is not None:
        yield from _of_effects({**parts, "fill": fill, "begins": False}, "fill")
    for key, shown in _SAME_AS_START.items():
        with contextlib.suppress(NotRead, KeyError):
            found, expected = shown(parts), shown(vars(start))
            if found != expected:
                yield key, f"is {found}, but must be {expected} as in {start.name}, from which this scene starts"


@_check
def _name_fits_into_paths(name: str) -> Found:
    if not re.fullmatch(NAME, name):
        yield (), (f'a scene named "{printable(name)}" cannot name a folder, use up to {LONGEST_NAME} letters, digits, '
                   '"_" and "-"')
    if name.lower() in TAKEN:
        yield (), f'a scene cannot be named "{name}": outputs/{name.lower()} holds other things'


@_check
def _names_are_names(liquids: tuple[Material, ...], accuracy: str, start_from: str | None) -> Found:
    # Only a resolved scene can have others; they are parts of the names of files.
    for key, name in (("accuracy", accuracy), ("start_from", start_from), *(("liquids", one.name) for one in liquids)):
        if name is not None and not re.fullmatch(NAME, name):
            yield (key,), f'names "{printable(name)}", but a name is made of letters, digits, "_" and "-"'


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
        for name in effects:
            if REGISTRY[name].fewest_liquids > 1:
                yield ("effects", name), "needs two liquids at least, but the scene has one"


@_check
def _effects_do_not_conflict(effects: dict) -> Found:
    present = [effect for name, effect in REGISTRY.items() if name in effects]
    for first, second in itertools.combinations(present, 2):
        for one, other in ((first, second), (second, first)):
            reason = next((one.excludes[what] for what in one.excludes if what in other.does), None)
            if reason:
                yield ("effects", second.name), (f"cannot be used together with {first.name}: {reason}; remove one of "
                                                 "them")
                break


@_check
def _effects_have_what_they_require(effects: dict) -> Found:
    for name in effects:
        for required in REGISTRY[name].requires:
            if required not in effects:
                yield ("effects", name), f"needs the effect {required} too; add {required} or remove {name}"


@_check
def _initial_is_full(initial: Initial) -> Found:
    if initial.fill is None:
        return
    if initial.liquid is not None:
        yield ("initial",), "gives both liquid and fill, but only one of them can fill the cavity"
    total = sum(initial.fill.values())
    if not math.isclose(total, 1.0, abs_tol=1e-6):
        largest = max(initial.fill.values())
        meant = f" (did you mean {1e4 * largest:g} % where {100 * largest:g} % is written?)" if math.isclose(
            total, 0.01, abs_tol=1e-6) else ""
        yield ("initial", "fill"), f"adds up to {100 * total:g} %, but a closed cavity must be filled to 100 %{meant}"


@_check
def _level_needs_weight(initial: Initial, effects: dict) -> Found:
    weighing = [name for name, effect in REGISTRY.items() if WEIGHS in effect.does]
    if initial.fill is not None and not effects.keys() & set(weighing):
        yield ("initial", "fill"), f"stacks liquids by weight, but the scene has no effect {' or '.join(weighing)}"


@_check
def _rest_can_be_found(initial: Initial, effects: dict, liquids: tuple[Material, ...], eye: Eye | None) -> Found:
    if initial.shape != AT_REST:
        return
    key, names = ("initial", "shape"), [liquid.name for liquid in liquids[:2]]
    angles = [angle for name, parameters in effects.items()
              if (angle := REGISTRY[name].contact_angle_of(parameters)) is not None]
    if eye is None:
        yield key, f"is {AT_REST}, which is known in an eye only; write level"
    elif not angles:
        yield key, f"is {AT_REST}, which takes a tension and a contact angle; add interface_tension, or write level"
    elif not SMALLEST_ANGLE <= angles[0] <= LARGEST_ANGLE:
        yield key, (f"is {AT_REST}, which is known for contact angles from {math.degrees(SMALLEST_ANGLE):g} to "
                    f"{math.degrees(LARGEST_ANGLE):g} deg, not {math.degrees(angles[0]):g} deg; write level")
    if set(initial.fill or ()) != set(names):
        yield ("initial", "fill"), f"must give a share to both {' and '.join(names)}, whose shape at rest is asked for"


@_check
def _points_are_in_the_eye(effects: dict, eye: Eye | None, dimension: int) -> Found:
    # The voxelize stage asks again, for a user's mesh too; here nothing is made, so nothing can be lost.
    if eye is None or eye.model != "parametric" or dimension != 3 or not any(REGISTRY[name].inside for name in effects):
        return
    shape = shape_of(eye)
    for name, parameters in effects.items():
        for key in REGISTRY[name].inside:
            point = np.array(getattr(parameters, key))
            if shape.level(point) >= 0.0:
                place = ", ".join(f"{1e3 * value:g}" for value in point)
                yield (("effects", name, key), f"is ({place}) mm, outside the eye, but must lie inside its cavity "
                                               "(origin = center of the globe, z forward)")


@_check
def _places_are_in_an_eye(breaks: tuple[Break, ...], regions: tuple[Region, ...], eye: Eye | None) -> Found:
    for key, places in (("breaks", breaks), ("regions", regions)):
        if places and eye is None:
            yield (key,), "are parts of the wall of an eye, but the scene has none; remove them"
        if len(places) > MOST_PLACES:
            yield (key,), f"has {len(places)} entries, but must have at most {MOST_PLACES}"
        names = [one.name for one in places]
        for index, name in enumerate(names):
            if not re.fullmatch(r"[A-Za-z0-9_]{1,60}", name) or name == "band" or name.startswith("band_"):
                yield ((key, index, "name"), f'is "{printable(name)}", but must be made of letters, digits and _, 60 '
                                             'at most, and not begin with "band_", for it names columns')
            if name in names[:index]:
                yield ((key, index, "name"), f'is "{printable(name)}", as another one is named already; give each its '
                                             'own name')


@_check
def _breaks_are_on_the_retina(breaks: tuple[Break, ...], eye: Eye | None) -> Found:
    for index, one in enumerate(breaks):
        if (one.width is None) == (one.diameter is None):
            given = "has neither width nor diameter" if one.width is None else "has both width and diameter"
            yield (("breaks", index), f"{given}, but must have one of them: a width in clock hours (with a height, if "
                                      "it is known), or a diameter in mm")
            continue
        if one.diameter is not None and one.height is not None:
            yield ("breaks", index), "has both diameter and height, but a diameter is both; remove one of them"
        patch = one.patch(globe_of(eye or Eye()))
        if patch.high > ORA + 1e-6:
            yield (("breaks", index), f"reaches from {patch.low:.4g} to {patch.high:.4g} deg from the posterior pole, "
                                      f"but the retina ends at {ORA:g} deg (ora serrata)")


@_check
def _regions_have_a_place(regions: tuple[Region, ...]) -> Found:
    for index, one in enumerate(regions):
        if one.hours is not None and one.part is not None:
            yield ("regions", index), "gives both hours and part, but only one of them can tell where it is"
        if one.latitudes[0] >= one.latitudes[1]:
            low, high = map(math.degrees, one.latitudes)
            yield (("regions", index, "latitudes"), f"is from {low:g} to {high:g} deg, but the first must be the "
                                                    "smaller one (posterior pole 0, ora serrata 115 deg)")


@_check
def _eye_is_one_model(eye: Eye | None) -> Found:
    if eye is None:
        return
    if eye.model == "mesh" and eye.path is None:
        yield ("eye", "path"), "is missing, but an eye of model mesh must name its mesh file"
    if eye.model == "parametric" and eye.path is not None:
        yield ("eye", "path"), "is given, but model is parametric; use model: mesh to read a mesh file"
    if eye.label is not None and eye.model == "parametric":
        yield ("eye", "label"), "is given, but model is parametric; use model: mesh to read a labelled image"
    elif eye.label is not None and eye.path is not None and not is_image(eye.path):
        yield ("eye", "label"), (f"is given, but {Path(eye.path).name} is no labelled image, which end in "
                                 f"{', '.join(IMAGES)}; leave it out")


@_check
def _eye_can_have_what_it_is_given(eye: Eye | None) -> Found:
    if eye is None:
        return
    for key in ("buckle", "staphyloma", "anterior_chamber"):
        if eye.model == "mesh" and getattr(eye, key):
            yield ("eye", key), "is given, but model is mesh, whose surface has its own shape; use model: parametric"
    if eye.model == "parametric" and eye.landmarks is not None:
        yield ("eye", "landmarks"), "are given, but model is parametric, which knows how it lies; use model: mesh"
    if eye.model == "parametric" and eye.anterior_chamber and eye.lens != "aphakic":
        yield ("eye", "anterior_chamber"), f"is filled, but lens is {eye.lens}; only an aphakic eye lets oil into it"
    if eye.buckle is not None and eye.buckle.clock_hours is not None:
        first, last = eye.buckle.clock_hours
        if (last - first) % 12.0 == 0.0:
            yield (("eye", "buckle", "clock_hours"), f"are {first:g} and {last:g}, but must be two different ones; "
                                                     "leave them out for a buckle all around")
    if eye.landmarks is not None and not any(eye.landmarks.superior):
        yield ("eye", "landmarks", "superior"), "is [0, 0, 0], but must be a direction, such as [0, 0, 1]"


@_check
def _wall_of_eye_is_seen(eye: Eye | None) -> Found:
    if eye is None or eye.model != "parametric" or (eye.anterior_chamber and eye.lens != "aphakic"):
        return
    shape = shape_of(eye)
    try:
        shape.viewpoint  # noqa: B018  its search is the check
    except ValueError as error:
        names = [name for name in ("buckle", "staphyloma") if getattr(eye, name) is not None] or ["anterior_chamber"]
        yield ("eye", names[0]), f"leads to a shape that cannot be filled: {error}; lower or widen it"


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
    if count >= output.allowed_frames:
        yield (("output", "frame_interval"),
               f"is {output.frame_interval:g} s, which gives {count:.6g} pictures, but at most {output.allowed_frames} "
               "are made; take a longer one, or allow more by output.allowed_frames")
    elif round(count) < 1 or not math.isclose(count, round(count), rel_tol=1e-9):
        yield (("output", "duration"),
               f"is {output.duration:g} s, but must be a whole multiple of frame_interval, {output.frame_interval:g} s")
    elif count > MOST_SEGMENTS * output.frames_per_segment:
        yield (("output", "frames_per_segment"),
               f"is {output.frames_per_segment}, but must be at least {math.ceil(count / MOST_SEGMENTS)}, which makes "
               f"{MOST_SEGMENTS} segments of {round(count)} frames")


@_check
def _rest_can_be_seen(eye: Eye | None, liquids: tuple[Material, ...], output: Output) -> Found:
    if not output.until_rest:
        return
    if eye is None or len(liquids) < 2:
        yield (("output", "until_rest"),
               "needs an eye with two liquids or more: the covered share of the retina tells whether they rest")
    elif output.frame_interval > REST_WINDOW / 3.0 + 1e-9:
        yield (("output", "frame_interval"),
               f"is {output.frame_interval:g} s, but must be at most {REST_WINDOW / 3.0:g} s with until_rest, which "
               f"looks at the last {REST_WINDOW:g} s")


@_check
def _movie_size_is_even(output: Output) -> Found:
    if any(size % 2 for size in output.image_size):
        yield ("output", "image_size"), f"is {list(output.image_size)}, but movies need even numbers"
