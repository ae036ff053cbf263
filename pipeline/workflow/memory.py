"""How much memory a job needs, said before it runs to whoever gives out the computers of a cluster."""
import math

from pipeline.scenes.eye_shape import published_volume
from pipeline.scenes.model import Scene
from sim.memory import needed_bytes

# Before a stage has read a scene, MB: its libraries, of which VTK takes most, and 330 MB of the Snakemake around it.
LIBRARIES = {"render": 1400, "page": 1400}
OTHERS = 1000
# What the stages hold beside, as a multiple of what the solver needs: measured, 5,000 to 320,000 particles.
SHARE = 1.5
STEP = 100  # MB; rounded up to whole ones


def memory_of_stage(stage: str, scene: Scene) -> int:
    """Return the memory, MB, that a stage of a scene needs, on the safe side."""
    volume = liquid_volume(scene)
    particles = volume / scene.numerics.particle_spacing**scene.dimension
    need = SHARE * needed_bytes(scene.settings(), particles) / 1e6 + LIBRARIES.get(stage, OTHERS)
    return STEP * math.ceil(need / STEP)


def liquid_volume(scene: Scene) -> float:
    """Return the volume of the liquids of a scene, m^3 (in two dimensions m^2), before its cavity is made.

    A mesh is not read for that: it counts as the largest that is accepted unasked.
    """
    if scene.container is not None:
        return sum(block.volume for block in scene.blocks if not block.replaces) or math.prod(scene.container.size)
    if scene.eye.path is None:
        return published_volume(scene.eye.axial_length)
    from pipeline.cavity.mesh_import import LARGEST_VOLUME  # imports VTK

    return LARGEST_VOLUME
