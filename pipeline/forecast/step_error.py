"""How far the length of the time step may put slow motion off: what a scene asks for, and what was measured."""
from pipeline.forecast.expected_error import ExpectedError
from pipeline.scenes.effects import sum_of_effects
from pipeline.scenes.model import Scene

PAGE = "docs/results/step_size.md"


def step_errors(scene: Scene) -> list[ExpectedError]:
    """Return the error to expect of motion under tension by the time step; none where waves alone limit it."""
    damped = any(getattr(parameters, "damps_any_step", False) for parameters in scene.effects.values())
    if not damped or sum_of_effects(scene, "tension_of") == 0.0:
        return []
    error = scene.numerics.time_error
    return [ExpectedError("slow motion, by the length of the time step", error, "1", f"about {100.0 * error:g} %",
                          "numerics.time_error, as measured on oil that comes to rest in the eye against steps of a "
                          f"quarter; {PAGE}")]
