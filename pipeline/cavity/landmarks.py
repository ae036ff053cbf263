"""How a user's mesh lies: turned by its landmarks so that x is the patient's left, y superior and z anterior.

What is not given is found or assumed, and said. Equations: docs/methods/walls.md.
"""
import numpy as np
import trimesh

from pipeline.base.errors import UserError
from pipeline.cavity.globe import front_of, globe_center
from pipeline.cavity.mesh_files import SPACES
from pipeline.cavity.signed_distance_grid import distance_to_triangles
from pipeline.scenes.model import Landmarks
from pipeline.scenes.retina import DISC_RISE

FARTHEST = 4e-3                     # m, of fovea and disc from the surface
DISC_DISTANCES = (2e-3, 9e-3)       # m, of the disc from the fovea across the axis: 4.8 mm in most eyes
LEAST_ONE_SIDED = 0.5               # of what lies inside the globe: 1 where it is all in one direction
LARGEST_COSINE = np.cos(np.radians(20.0))   # between axis and superior: nearer, superior says nothing
AHEAD = np.cos(np.radians(35.0))            # of the front found from z: within, a mesh lies as its axes say
ALONG = np.cos(np.radians(25.0))            # of the front from an axis of the file that is taken for it


def laid(mesh: trimesh.Trimesh, landmarks: Landmarks | None, side: str, name: str, space: str = ""
         ) -> tuple[trimesh.Trimesh, list[str]]:
    """Return a mesh turned by its landmarks, its globe around the origin, and sentences on what was assumed.

    Without landmarks the head of the file tells how it lies, else the side on which the surface is flat.

    Parameters
    ----------
    mesh : m, in the coordinates of its file.
    side : which eye.
    name : file that errors name.
    space : "LPS" or "RAS" where the file names its axes.

    Raises
    ------
    UserError : landmarks that are off the surface, contradict each other or the side, or cannot be found.
    """
    if landmarks is None:
        return _laid_by_file(mesh, space)
    center, said = globe_center(mesh), []
    for key in ("fovea", "optic_disc"):
        point = getattr(landmarks, key)
        if point is not None:
            away = float(distance_to_triangles(mesh, np.array([point]), longest_edge=1e-3)[0])
            if away > FARTHEST:
                raise UserError(f"{name} (eye.landmarks.{key}): lies {1e3 * away:.2g} mm off the surface, but must be "
                                f"within {1e3 * FARTHEST:g} mm of it, in the coordinates of the file")
    axis = _axis(mesh, center, landmarks, name, said)
    superior = _unit(landmarks.superior)
    if abs(superior @ axis) > LARGEST_COSINE:
        raise UserError(f"{name} (eye.landmarks.superior): points along the axis of the eye, "
                        f"({', '.join(f'{value:.2f}' for value in axis)}), but must point to the top of the head, such "
                        "as [0, 0, 1]")
    if landmarks.optic_disc is None:
        up = _unit(superior - (superior @ axis) * axis)
        left = np.cross(up, axis)
        said.append("superior is the direction "
                    f"({', '.join(f'{value:g}' for value in landmarks.superior)}) of the file")
    else:
        left, up = _by_disc(center, axis, superior, landmarks, side, name)
    turned = mesh.copy()
    turned.vertices = (mesh.vertices - center) @ np.stack([left, up, axis], axis=1)
    return turned, said


def _laid_by_file(mesh: trimesh.Trimesh, space: str) -> tuple[trimesh.Trimesh, list[str]]:
    """Return a mesh with its globe around the origin as its file tells, or its flat side, and sentences on it."""
    front, one_sided = front_of(mesh, np.zeros(3))
    found = f"({', '.join(f'{value:.2f}' for value in front + 0.0)})"
    if space:
        axes = np.array(SPACES[space], float)
        said = [f"turned as the head of its file tells, whose axes are {space}"]
        if one_sided >= LEAST_ONE_SIDED and front @ axes[2] < AHEAD:
            said.append(f"its flat side, where the lens is, is toward {found} of the file, which would not be anterior"
                        ": give eye.landmarks if the head of the file is wrong")
    elif one_sided < LEAST_ONE_SIDED or front[2] >= AHEAD:
        return mesh, ["its axes were taken as they are: x to the patient's left, y superior, z anterior"]
    else:
        near = int(np.abs(front).argmax())
        ahead = np.sign(front[near]) * np.eye(3)[near] if abs(front[near]) > ALONG else front
        up = np.eye(3)[1 if near == 2 else 2]
        up = _unit(up - (up @ ahead) * ahead)
        axes = np.stack([np.cross(up, ahead), up, ahead])
        said = [f"its flat side, where the lens is, is toward {found} of the file, not toward z: it was turned to be "
                f"anterior, with {'y' if near == 2 else 'z'} of the file superior; give eye.landmarks if it lies "
                "otherwise"]
    turned = mesh.copy()
    turned.vertices = mesh.vertices @ axes.T
    return turned, said


def _axis(mesh: trimesh.Trimesh, center: np.ndarray, landmarks: Landmarks, name: str, said: list[str]) -> np.ndarray:
    """Direction (3,) forward along the axis of the eye."""
    apex, fovea = landmarks.corneal_apex, landmarks.fovea
    if apex is not None and fovea is not None:
        return _unit(np.subtract(apex, fovea))
    if apex is not None or fovea is not None:
        given = "corneal_apex" if fovea is None else "fovea"
        said.append(f"the axis goes through {given} and the center of the globe")
        return _unit(np.subtract(apex, center) if fovea is None else np.subtract(center, fovea))
    front, one_sided = front_of(mesh, center)
    if one_sided < LEAST_ONE_SIDED:
        raise UserError(f"{name} (eye.landmarks): the front cannot be found, for no side is clearly flatter than a "
                        "ball; give fovea or corneal_apex")
    said.append("the front was found: it is where the surface is flatter than the globe, for the lens is there")
    return front


def _by_disc(center: np.ndarray, axis: np.ndarray, superior: np.ndarray, landmarks: Landmarks, side: str,
             name: str) -> tuple[np.ndarray, np.ndarray]:
    """Directions (3,) to the patient's left and up: the disc is nasal of the fovea and a little higher. (L10)"""
    pole = center if landmarks.fovea is None else np.array(landmarks.fovea)
    arm = np.subtract(landmarks.optic_disc, pole)
    across = arm - (arm @ axis) * axis
    distance = float(np.linalg.norm(across))
    if not DISC_DISTANCES[0] <= distance <= DISC_DISTANCES[1]:
        raise UserError(f"{name} (eye.landmarks.optic_disc): lies {1e3 * distance:.2g} mm from the fovea, but must be "
                        f"{1e3 * DISC_DISTANCES[0]:g} to {1e3 * DISC_DISTANCES[1]:g} mm from it")
    along, beside = across / distance, np.cross(axis, across / distance)
    rise, nasal = np.radians(DISC_RISE), 1.0 if side == "right" else -1.0
    left = nasal * np.cos(rise) * along - np.sin(rise) * beside
    up = np.cross(axis, left)
    if up @ superior < 0.0:
        raise UserError(f"{name} (eye.landmarks.optic_disc): is temporal of the fovea in a {side} eye; give the other "
                        "eye.side, or eye.landmarks.superior, which is "
                        f"({', '.join(f'{value:g}' for value in landmarks.superior)})")
    return left, up


def _unit(vector) -> np.ndarray:
    vector = np.asarray(vector, float)
    return vector / max(float(np.linalg.norm(vector)), 1e-30)
