"""An eye whose oil starts at rest: in the shape of least energy (`pipeline.equilibrium`), without waiting for it.

The particles that lie deepest in that shape are oil, as many as the fill asks for.
"""
import dataclasses

import numpy as np

from pipeline.base.errors import UserError
from pipeline.cavity.rays import interpolation
from pipeline.cavity.surface import cavity_mesh
from pipeline.cavity.voxels import voxelize
from pipeline.equilibrium.rest import Liquids, Rest, at_rest
from pipeline.equilibrium.star_cavity import cavity_of
from pipeline.measures.frame_view import Measured
from pipeline.planning.settings import postures
from pipeline.scenes.effects import known_by_an_effect
from pipeline.scenes.model import Scene
from pipeline.simulation.solver_setup import build_solver, frame_of
from sim.effects import REGISTRY

HIGHER = 0.5    # of what is missing to a full cavity: the other start of a search, since two shapes may be at rest
HIGHEST = 0.98  # fill of that start


def liquids_at_rest(scene: Scene) -> Liquids:
    """Return what decides where the oil of a scene of two liquids, aqueous first, rests."""
    aqueous, oil = scene.liquids[:2]
    effects = [(REGISTRY[name], parameters) for name, parameters in scene.effects.items()]
    tension = sum(effect.tension_of(parameters) for effect, parameters in effects)
    weight = sum(effect.weight_of(parameters) for effect, parameters in effects)
    return Liquids(aqueous.density - oil.density, tension, known_by_an_effect(scene, "contact_angle_of"), weight)


def rest_of(scene: Scene, posture: str, fill: float) -> Rest:
    """Return the shape of the oil of a scene at rest: of two that may be, the one with less energy.

    Raises
    ------
    UserError : no shape was found.
    """
    liquids, cavity, down = liquids_at_rest(scene), cavity_of(scene.eye), postures()[posture]
    first = at_rest(cavity, liquids, down, fill)
    above = at_rest(cavity, liquids, down, min(fill + HIGHER * (1.0 - fill), HIGHEST))
    second = at_rest(cavity, liquids, down, fill, above.distance)
    best = min((first, second), key=lambda rest: rest.energy if rest.settled else np.inf)
    if not best.settled:
        raise UserError(f"no shape of {100.0 * fill:g} % oil at rest was found for a patient who is "
                        f"{posture.replace('_', ' ')}, since one point must see all of its surface; try another fill")
    return best


def depth_in_oil(rest: Rest, position: np.ndarray) -> np.ndarray:
    """How far points (n, 3) lie in the oil, along the ray from the viewpoint, (n,), m; negative outside."""
    arm = position - rest.cavity.viewpoint
    distance = np.linalg.norm(arm, axis=1)
    wall = rest.cavity.wall - rest.cavity.viewpoint
    corners, weights = interpolation(wall, rest.cavity.faces, arm / np.maximum(distance, 1e-9)[:, None])
    return (rest.distance[corners] * weights).sum(axis=1) - distance


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
        count = round(rest.fill * len(position))
        phase = np.zeros(len(position), int)
        phase[np.argsort(-depth_in_oil(rest, position), kind="stable")[:count]] = 1
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
