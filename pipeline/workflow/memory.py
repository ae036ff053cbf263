"""How much memory a job needs, said before it runs to whoever gives out the computers of a cluster."""
import math

from pipeline.scenes.model import Scene
from pipeline.scenes.volume import expected_particles
from sim.memory import needed_bytes

# Before a stage has read a scene, MB: its libraries, of which VTK takes most, and 330 MB of the Snakemake around it.
LIBRARIES = {"render": 1400, "page": 1400}
OTHERS = 1000
# What the stages hold beside, as a multiple of what the solver needs: measured, 5,000 to 320,000 particles.
SHARE = 1.5
STEP = 100  # MB; rounded up to whole ones


def memory_of_stage(stage: str, scene: Scene) -> int:
    """Return the memory, MB, that a stage of a scene needs, on the safe side."""
    need = SHARE * needed_bytes(scene.settings(), expected_particles(scene)) / 1e6 + LIBRARIES.get(stage, OTHERS)
    return STEP * math.ceil(need / STEP)
