"""All errors to expect of a scene, from tables: nothing is simulated for them."""
import math

from pipeline.forecast.expected_error import ExpectedError, expected_errors
from pipeline.forecast.retina_error import retina_errors
from pipeline.forecast.step_error import step_errors
from pipeline.scenes.model import Scene


def errors_of(scene: Scene, cavity_volume: float) -> tuple[ExpectedError, ...]:
    """Return the errors to expect, those of what a scene is run for first; empty where none is known.

    Parameters
    ----------
    cavity_volume : m3, in two dimensions m2.
    """
    round_share = {2: math.pi / 4.0, 3: math.pi / 6.0}[scene.dimension]
    width = (cavity_volume / round_share) ** (1.0 / scene.dimension) / scene.numerics.particle_spacing
    return (*retina_errors(scene), *step_errors(scene), *expected_errors(scene, width))
