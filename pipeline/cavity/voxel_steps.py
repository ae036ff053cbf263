"""Steps of voxels in a surface, as segmentation leaves them: told, and smoothed at the same volume.

Liquids would feel the steps: a wall of them has up to half as much again of the area, and no contact angle.
"""
import numpy as np
import pyvista
import trimesh

FEWEST_FACES = 500
MOST_DIRECTIONS = 40    # normals of a surface of voxels: 6 of its cubes, 26 and less of marching cubes through a label
SHARE = 0.9             # of the area that has them
FOLD, FOLDED = np.radians(20.0), 0.1    # edges that are folded by more, and their share: a plane cut up has none
ROUNDS, PASS_BAND = 50, 0.03            # leaves a tenth of a voxel of a ball's steps, of 6 to 40 voxels in its radius


def step_size(mesh: trimesh.Trimesh) -> float:
    """Size of the steps in the unit of the mesh: the median edge; 0 where the surface has none."""
    if len(mesh.faces) < FEWEST_FACES:
        return 0.0
    _, kind = np.unique(np.round(mesh.face_normals, 2) + 0.0, axis=0, return_inverse=True)
    areas = np.sort(np.bincount(kind.ravel(), mesh.area_faces))[::-1].cumsum()
    if int((areas < SHARE * areas[-1]).sum()) >= MOST_DIRECTIONS or (mesh.face_adjacency_angles > FOLD).mean() < FOLDED:
        return 0.0
    return float(np.median(mesh.edges_unique_length))


def smoothed(mesh: trimesh.Trimesh, volume: float | None = None) -> trimesh.Trimesh:
    """Return a closed surface without its steps, with a volume or else its own (windowed sinc filter)."""
    surface = pyvista.make_tri_mesh(np.asarray(mesh.vertices), np.asarray(mesh.faces)).smooth_taubin(
        n_iter=ROUNDS, pass_band=PASS_BAND, normalize_coordinates=True)
    smooth = trimesh.Trimesh(np.asarray(surface.points, float), mesh.faces, process=False)
    center = smooth.center_mass
    smooth.vertices = center + (smooth.vertices - center) * ((volume or mesh.volume) / smooth.volume) ** (1.0 / 3.0)
    return smooth
