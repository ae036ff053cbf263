"""What has to hold in a scene with a container, and between a scene and the scheme that solves it.

The checks are written as in ``pipeline.scenes.checks``, which runs them.
"""
import math
from collections.abc import Iterator

from pipeline.base.words import duration as in_words
from pipeline.scenes.eye_shape import SMALLEST_VOLUME, published_volume
from pipeline.scenes.memory_check import too_fine, too_large
from pipeline.scenes.model import Block, Container, Eye, Initial, Material, Output, is_closed
from pipeline.scenes.reader import Key
from sim.effects import REGISTRY
from sim.schemes import REGISTRY as SCHEMES
from sim.settings import Liquid, Numerics, Settings
from sim.time_step import known_limits

Found = Iterator[tuple[Key, str]]

FEWEST_SPACINGS = 4  # per side of a container: below, every particle touches both walls
LEAST_TIME = 2e-4  # s that a time step takes on any computer, be there hardly a particle
EYE_IN_BOX = 1.9  # volume of the box around an eye, over its own
MOST_BLOCKS = 1000  # every two of them are compared
FUNNEL_SPACINGS = 2.0  # thickness of the wall of a funnel
ROUNDING = 1e-9  # of lengths, relative to the container


def one_cavity(eye: Eye | None, container: Container | None) -> Found:
    if eye is not None and container is not None:
        yield ("container",), "is given beside eye, but a scene has one cavity; remove one of them"
    if eye is None and container is None:
        yield ("eye",), "is missing, and so is container, but a scene needs one of them"


def eye_is_in_space(eye: Eye | None, dimension: int) -> Found:
    if eye is not None and dimension != 3:
        yield ("dimension",), f"is {dimension}, but an eye has 3 dimensions; describe a container instead"


def container_has_the_dimension(container: Container | None, dimension: int) -> Found:
    if container is not None and len(container.size) != dimension:
        yield (("container", "size"),
               f"has {len(container.size)} entries, but must have {dimension}, one for each dimension of space")


def container_holds_particles(container: Container | None, numerics: Numerics, dimension: int) -> Found:
    if container is None or len(container.size) != dimension:
        return
    spacing, least = numerics.particle_spacing, min(container.size) / FEWEST_SPACINGS
    if spacing > least * (1.0 + ROUNDING):
        yield (("numerics", "particle_spacing"),
               f"is {spacing:g} m, but must be at most {least:g} m, a quarter of the shortest side of the container")


def container_has_liquid(container: Container | None, blocks: tuple[Block, ...], initial: Initial) -> Found:
    if container is None:
        if blocks:
            yield ("blocks",), "fill a container, but this scene has an eye, which `initial` fills"
    elif blocks and initial != Initial():
        yield ("initial",), "is given beside blocks, but only one of them can say where liquid is at the start"
    elif not blocks and initial == Initial():
        yield ("blocks",), "is missing, so the container holds no liquid; list blocks, or fill it all with `initial`"


def blocks_are_few(blocks: tuple[Block, ...], container: Container | None) -> Found:
    for key, found in ((("blocks",), blocks), (("container", "funnels"), container.funnels if container else ())):
        if len(found) > MOST_BLOCKS:
            yield key, f"has {len(found)} entries, but must have at most {MOST_BLOCKS}"


def blocks_are_in_the_container(container: Container | None, blocks: tuple[Block, ...], dimension: int) -> Found:
    if container is None or len(container.size) != dimension:
        return
    for index, block in enumerate(blocks):
        points = {"lower": block.lower, "upper": block.upper} | ({"velocity": block.velocity} if block.velocity else {})
        for name, point in points.items():
            if len(point) != dimension:
                yield (("blocks", index, name), f"has {len(point)} entries, but must have {dimension}, one for each "
                                                "dimension of space")
            elif name != "velocity":
                for axis, value, side in zip("xyz", point, container.size, strict=False):
                    if not -ROUNDING * side <= value <= (1.0 + ROUNDING) * side:
                        yield (("blocks", index, name),
                               f"has {axis} = {value:g} m, outside the container, which reaches from 0 to {side:g} m")


def blocks_have_room_for_particles(blocks: tuple[Block, ...], numerics: Numerics, dimension: int) -> Found:
    spacing = numerics.particle_spacing
    for index, block in enumerate(blocks):
        if len(block.lower) != dimension or len(block.upper) != dimension:
            continue
        for axis, side in zip("xyz", block.sides, strict=False):
            if side < spacing * (1.0 - ROUNDING):
                yield (("blocks", index, "upper"),
                       f"leaves {side:g} m along {axis}, but must be at least one particle spacing, {spacing:g} m, "
                       "above lower")


def blocks_do_not_overlap(blocks: tuple[Block, ...], dimension: int) -> Found:
    for second, other in enumerate(blocks):
        for first, one in enumerate(blocks[:second]) if not other.replaces else ():
            corners = (one.lower, one.upper, other.lower, other.upper)
            if any(len(corner) != dimension for corner in corners):
                continue
            common = [min(one.upper[axis], other.upper[axis]) - max(one.lower[axis], other.lower[axis])
                      for axis in range(dimension)]
            if min(common) > ROUNDING * max(map(abs, (*one.upper, *other.upper))):
                size = " x ".join(f"{side:g}" for side in common)
                yield ("blocks", second), f"overlaps blocks[{first}] by {size} m, but a place can hold one liquid only"
                break  # each is told of once


def blocks_have_the_dimension(blocks: tuple[Block, ...], dimension: int) -> Found:
    for index, block in enumerate(blocks):
        if dimension == 2 and block.shape.startswith("cylinder"):
            yield ("blocks", index, "shape"), f"is {block.shape}, but a scene in two dimensions has no cylinders"
    if blocks and blocks[0].replaces:
        yield ("blocks", 0, "replaces"), "is true, but no block comes before it"


def funnels_are_in_the_container(container: Container | None, numerics: Numerics, dimension: int) -> Found:
    for index, funnel in enumerate(container.funnels if container else ()):
        key = ("container", "funnels", index)
        least = FUNNEL_SPACINGS * numerics.particle_spacing
        if len(funnel.center) != dimension:
            yield (*key, "center"), f"has {len(funnel.center)} entries, but must have {dimension}"
        elif funnel.thickness < least * (1.0 - ROUNDING):
            yield ((*key, "thickness"),
                   f"is {funnel.thickness:g} m, but must be at least {least:g} m, {FUNNEL_SPACINGS:g} particle "
                   "spacings, or liquids would feel each other through it")


def lines_have_no_triangles(output: Output, dimension: int) -> Found:
    if output.formats and dimension == 2:
        yield (("output", "formats"), f"names {', '.join(output.formats)}, but the surfaces of a scene in two "
                                      "dimensions are lines, which are written as .vtp only")


def points_are_in_the_container(container: Container | None, effects: dict) -> Found:
    for name, parameters in effects.items() if container is not None else ():
        for key in REGISTRY[name].inside:
            point = getattr(parameters, key)
            if not all(0.0 < value < side for value, side in zip(point, container.size, strict=False)):
                place = ", ".join(f"{value:g}" for value in point)
                yield (("effects", name, key), f"is ({place}) m, outside the container, but must lie inside it")


def scheme_can_fill_the_cavity(container: Container | None, blocks: tuple[Block, ...], numerics: Numerics) -> Found:
    needed = "closed" if is_closed(container, blocks) else "open"
    if needed in SCHEMES[numerics.scheme].fills:
        return
    others = [name for name, scheme in SCHEMES.items() if needed in scheme.fills]
    reason = {"open": "which cannot have a free surface, but the blocks do not fill the container",
              "closed": "which needs a free surface, but the cavity is full"}[needed]
    remedy = f"use {' or '.join(others)}" if others else "no scheme can do this yet"
    if needed == "open":
        remedy += ", or fill the container"
    yield ("numerics", "scheme"), f"is {numerics.scheme}, {reason}; {remedy}"


def scheme_can_run_the_effects(numerics: Numerics, effects: dict, liquids: tuple[Material, ...], dimension: int,
                               container: Container | None, blocks: tuple[Block, ...]) -> Found:
    if not liquids:
        return
    settings = Settings(dimension, liquids, numerics, (), closed=is_closed(container, blocks))
    for name, reason in SCHEMES[numerics.scheme].variant(settings).refuses.items():
        if name in effects:
            yield (("effects", name), f"cannot be used with the scheme {numerics.scheme}: {reason}; remove it or "
                                      "choose another numerics.scheme")


def scheme_can_solve_the_density_ratio(numerics: Numerics, liquids: tuple[Material, ...], schemes: dict,
                                       container: Container | None, blocks: tuple[Block, ...]) -> Found:
    densities, closed = [liquid.density for liquid in liquids], is_closed(container, blocks)
    limit = SCHEMES[numerics.scheme].density_ratio_limit(closed, schemes.get(numerics.scheme))
    if densities and max(densities) > limit * (1.0 + ROUNDING) * min(densities):
        yield (("liquids",), f"have densities from {min(densities):g} to {max(densities):g} kg/m3, a ratio of "
                             f"{max(densities) / min(densities):.3g}, but the scheme {numerics.scheme} was shown to "
                             f"work up to {limit:g} {'in a full cavity' if closed else 'under a free surface'}")


def fixed_time_step_is_stable(numerics: Numerics, liquids: tuple[Material, ...], effects: dict, schemes: dict,
                              dimension: int, container: Container | None, blocks: tuple[Block, ...]) -> Found:
    if numerics.time_step is None:
        return
    closed, spacing = is_closed(container, blocks), numerics.particle_spacing
    limits = known_limits(_settings(numerics, liquids, effects, schemes, dimension, closed))
    for name, parameters in effects.items() if not closed else ():
        # What falls freely; in a full cavity only the buoyancy accelerates.
        weight = REGISTRY[name].weight_of(parameters)
        if weight > 0.0:
            limits[f"effects.{name}"] = 0.5 * math.sqrt(spacing / weight)
    speed = max((math.hypot(*block.velocity) for block in blocks), default=0.0)
    if speed > 0.0:
        limits["the speed of the blocks and numerics.courant_number"] = numerics.courant_number * spacing / speed
    reason, limit = min(limits.items(), key=lambda item: item[1])
    if numerics.time_step > limit * (1.0 + ROUNDING):
        yield (("numerics", "time_step"), f"is {numerics.time_step:g} s, which is unstable, but must be at most "
                                          f"{limit:.3g} s because of {reason}")


def scene_fits_into_memory(numerics: Numerics, liquids: tuple[Material, ...], effects: dict, schemes: dict,
                           dimension: int, eye: Eye | None, container: Container | None, blocks: tuple[Block, ...],
                           output: Output) -> Found:
    if not liquids or (container is None and eye is None):
        return
    if container is None:
        # A user's mesh is not read here, the voxelize stage asks again: it has the volume of the smallest eye, or any.
        smallest = 0.0 if eye.force else SMALLEST_VOLUME
        volume, box = published_volume(eye.axial_length) if eye.model == "parametric" else smallest, None
    else:
        box = math.prod(container.size)
        volume = sum(block.volume for block in blocks if not block.replaces) or box
    if volume <= 0.0:  # blocks that are turned over are another error
        return
    settings = _settings(numerics, liquids, effects, schemes, dimension, is_closed(container, blocks))
    reason = too_large(settings, volume if box is None or volume < box else box, box)
    if reason:
        yield ("numerics", "particle_spacing"), reason
    elif dimension == 3:
        around = EYE_IN_BOX * volume if box is None else box
        reason = too_fine(output.cell_ratio, output.contour, around / numerics.particle_spacing**3)
        if reason:
            yield ("output", "cell_ratio"), reason


def cost_is_allowed(numerics: Numerics, liquids: tuple[Material, ...], effects: dict, schemes: dict, dimension: int,
                    container: Container | None, blocks: tuple[Block, ...], output: Output, allowed_time: float
                    ) -> Found:
    if not liquids:
        return
    limits = known_limits(_settings(numerics, liquids, effects, schemes, dimension, is_closed(container, blocks)))
    if numerics.time_step is not None:
        limits["numerics.time_step"] = numerics.time_step
    reason, step = min(limits.items(), key=lambda item: item[1])
    least = LEAST_TIME * output.duration / step if step > 0.0 else math.inf
    if least > allowed_time:
        yield (("output", "duration"),
               f"is {output.duration:g} s, in steps of at most {step:.3g} s because of {reason}, which takes "
               f"{in_words(least)} at least ({1e3 * LEAST_TIME:g} ms for a step), but allowed_time is "
               f"{in_words(allowed_time)}: take longer steps, or allow more")


def _settings(numerics: Numerics, liquids: tuple[Material, ...], effects: dict, schemes: dict, dimension: int,
              closed: bool) -> Settings:
    """What the solver would get; effects that could not be read are left out."""
    read = tuple(one for name, one in effects.items() if isinstance(one, REGISTRY[name].Parameters))
    return Settings(dimension, tuple(Liquid(one.name, one.density, one.dynamic_viscosity) for one in liquids),
                    numerics, read, closed, schemes.get(numerics.scheme))


def fixed_time_step_is_large_enough(numerics: Numerics) -> Found:
    if numerics.time_step is not None and numerics.time_step < numerics.minimum_time_step:
        yield (("numerics", "time_step"), f"is {numerics.time_step:g} s, but must be at least minimum_time_step, "
                                          f"{numerics.minimum_time_step:g} s")


CHECKS = (
    one_cavity, eye_is_in_space, container_has_the_dimension, container_holds_particles, container_has_liquid,
    funnels_are_in_the_container, blocks_are_few, blocks_have_the_dimension, blocks_are_in_the_container,
    blocks_have_room_for_particles, blocks_do_not_overlap,
    lines_have_no_triangles, points_are_in_the_container, scheme_can_fill_the_cavity,
    scheme_can_run_the_effects, scheme_can_solve_the_density_ratio,
    fixed_time_step_is_stable, fixed_time_step_is_large_enough, scene_fits_into_memory, cost_is_allowed,
)
OF_COMPUTER = (scene_fits_into_memory,)     # those whose answer is another one on another computer
