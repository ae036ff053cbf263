"""What the effects that apply the shear stress say of a scene: in which layer of which liquid they act."""
from collections.abc import Iterator, Sequence

from sim.advice import NOTE, SEEN_EFFECT, WARNING, Advice, Limit, Quantity, Sentences, is_seen, smallest, times
from sim.effects.parts.liquid_viscosity import explicit_limit

# Waves of the interface lose a fraction of about 5 Oh of their height per radian (Lamb: damping 5 nu/R2 of a drop).
DAMPED_OHNESORGE = 0.1
# One order of magnitude: the liquids then answer visibly differently to the same stress.
VISCOSITY_RATIO = 10.0
# The implicit solve took an eighth of a step (oil of 1 Pa s, 600 particles) and takes more iterations in finer scenes;
# it is taken to double the cost of a step at most.
IMPLICIT_STEP_COST = 2.0


def _thickest(scales) -> tuple[str, float]:
    layers = {liquid.name: scales.layer(liquid) for liquid in scales.liquids}
    return max(layers.items(), key=lambda item: item[1])


def nothing_moves(scales) -> bool:
    """Whether nothing sets the liquids in motion."""
    return scales.speed == 0.0 and not scales.settings.continued


def is_felt(scales) -> bool:
    """Whether the liquids move, and viscosity is seen in one of them."""
    return not nothing_moves(scales) and is_seen(_thickest(scales)[1], scales)


def acting(name: str, scales) -> Sentences:
    """Say in which layers an effect acts that a scene has."""
    liquid, layer = _thickest(scales)
    if nothing_moves(scales):
        yield Advice(WARNING, name, "cannot be seen: nothing sets the liquids in motion, U is 0 m/s, not above 0")
    elif not is_seen(layer, scales):
        yield Advice(WARNING, name, f"cannot be seen: it acts in a layer of {times(layer, scales)} of {liquid} at most")
    else:
        for one in scales.liquids:
            layer = scales.layer(one)
            if is_seen(layer, scales):
                yield Advice(SEEN_EFFECT, name, f"{one.name} feels it over {times(layer, scales)}")
            else:
                yield Advice(NOTE, name, f"the layer of {one.name} in which it acts is not resolved: "
                                         f"{times(layer, scales)}")


def rightly_missing(name: str, scales) -> Sentences:
    """Note that viscosity would not be seen in a scene without it."""
    liquid, layer = _thickest(scales)
    if not nothing_moves(scales) and not is_seen(layer, scales):
        yield Advice(NOTE, name, f"is not needed here: it would act in a layer of {times(layer, scales)} of {liquid} "
                                 "at most")


def missing(name: str, scales) -> Sentences:
    """Warn of the lack of an effect in a scene that would feel it."""
    if not is_felt(scales):
        return
    liquid, layer = _thickest(scales)
    reason = f"{liquid} would feel it over {times(layer, scales)}"
    thinnest = min(one.dynamic_viscosity for one in scales.liquids)
    ohnesorge = scales.ohnesorge_number(scales.stiffest) if scales.tension else 0.0
    if ohnesorge >= DAMPED_OHNESORGE:
        reason += f", and Oh = {ohnesorge:.3g} (damped from {DAMPED_OHNESORGE:g})"
    elif thinnest and scales.stiffest.dynamic_viscosity >= VISCOSITY_RATIO * thinnest:
        reason += (f", and is {scales.stiffest.dynamic_viscosity / thinnest:.3g} times as stiff as the thinnest liquid "
                   f"(they differ visibly from {VISCOSITY_RATIO:g})")
    yield Advice(WARNING, name, f"is missing and would be seen: {reason}")


def explicit_steps(explicit: str, scales, limits: Sequence[Limit]) -> float:
    """How many steps the explicit effect of that name needs for one that all else allows; at most 1: it limits none."""
    return smallest(limits, f"effects.{explicit}") / explicit_limit(scales.settings)


def viscous_times(scales) -> Iterator[Quantity]:
    """Yield the times in which viscosity stops or starts the flow of the liquids."""
    for liquid in scales.liquids:
        if liquid.dynamic_viscosity > 0.0:
            yield Quantity(f"viscous, {liquid.name}",
                           scales.length**2 * liquid.density / liquid.dynamic_viscosity, "s",
                           "rho L2/mu: viscosity stops or starts the flow of this liquid")
