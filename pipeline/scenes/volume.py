"""How much liquid a scene holds, and in how many particles, before its cavity is made."""
import math

from pipeline.scenes.eye_shape import LARGEST_VOLUME, published_volume
from pipeline.scenes.model import Scene


def liquid_volume(scene: Scene) -> float:
    """Return the volume of the liquids of a scene, m^3 (in two dimensions m^2).

    A mesh is not read for that: it counts as the largest that is accepted unasked.
    """
    if scene.container is not None:
        return sum(block.volume for block in scene.blocks if not block.replaces) or math.prod(scene.container.size)
    return LARGEST_VOLUME if scene.eye.path else published_volume(scene.eye.axial_length)


def expected_particles(scene: Scene) -> float:
    """Return about how many particles the liquids of a scene have."""
    return liquid_volume(scene) / scene.numerics.particle_spacing**scene.dimension
