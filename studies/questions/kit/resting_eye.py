"""An eye whose oil starts at rest: in the shape of least energy (`pipeline.equilibrium`), without waiting for it.

The particles that lie deepest in that shape are oil, as many as the fill asks for.
"""
import dataclasses

import numpy as np

from pipeline.cavity.surface import cavity_mesh
from pipeline.cavity.voxels import voxelize
from pipeline.equilibrium.of_scene import oil_at_rest
from pipeline.equilibrium.rest import Rest
from pipeline.measures.frame_view import Measured
from pipeline.scenes.model import Scene
from pipeline.simulation.solver_setup import build_solver, frame_of


@dataclasses.dataclass
class RestingEye:
    """A solver of an eye with its scene and cavity.

    Attributes
    ----------
    scene : two liquids, aqueous first.
    initial : arrays of ``initial.npz``.
    """

    scene: Scene
    initial: dict[str, np.ndarray]

    def __post_init__(self):
        self.solver = build_solver(self.scene, self.initial)

    @classmethod
    def of(cls, scene: Scene) -> "RestingEye":
        """Fill the eye of a scene with particles; Taichi must run already."""
        return cls(scene, voxelize(scene, cavity_mesh(scene.eye)[0])[0])

    def fill_as(self, rest: Rest) -> None:
        """Let the oil be where a shape at rest has it, and nothing move."""
        particles = self.solver.particles
        position, volume = (particles.to_numpy(name).astype(float) for name in ("position", "volume"))
        phase = oil_at_rest(rest, position).astype(int)
        density = np.array([liquid.density for liquid in self.scene.liquids])
        fields = {"phase": phase, "mass": volume * density[phase], "velocity": np.zeros_like(position)}
        if "volume_fraction" in particles.arrays:
            fields["volume_fraction"] = np.eye(len(density))[phase]
        for name, values in fields.items():
            particles.from_numpy(name, values)
        self.solver.prepare_rest_state()

    def measured(self) -> Measured:
        """Return the present state, as metrics look at it."""
        return Measured(self.scene, self.initial, frame_of(self.scene, self.solver, {}))
