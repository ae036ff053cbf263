"""Limits of the time step that follow from the settings alone, known before anything is compiled."""
from sim.effects import REGISTRY
from sim.schemes import REGISTRY as SCHEMES
from sim.settings import Settings

SMALL_STEP = 0.1  # of the step at rest: below, users are told


def known_limits(settings: Settings) -> dict[str, float]:
    """Return the limit (s, infinite where there is none) of the numerics, of the scheme and of every active effect.

    Limits by speeds and accelerations are not among them: those come with the run.
    """
    numerics = settings.numerics
    scheme = SCHEMES[numerics.scheme].variant(settings)
    limits = {"numerics.maximum_time_step": numerics.maximum_time_step,
              f"the scheme {numerics.scheme}": scheme.time_step_limit(settings)}
    effects = {effect.Parameters: effect for effect in REGISTRY.values()}
    for parameters in settings.effects:
        effect = effects[type(parameters)]
        limits[f"effects.{effect.name}"] = effect.time_step_limit(parameters, settings)
    return limits


def step_at_rest(solver) -> float:
    """The time step that a solver would take with its liquid at rest, s."""
    return min(solver.scheme.stable_time_step(), *known_limits(solver.settings).values())
