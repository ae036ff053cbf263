"""From the surface of the cavity to packed liquid particles, wall particles and a signed distance grid."""
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from pipeline.base.errors import UserError
from pipeline.base.threads import library_threads
from pipeline.cavity.initial_state import initial_arrays
from pipeline.cavity.lattice import deepest_points
from pipeline.cavity.signed_distance_grid import SignedDistance, distance_of_mesh, distance_to_triangles
from pipeline.cavity.wall_layers import wall_layers
from pipeline.scenes.memory_check import too_large
from pipeline.scenes.model import Scene
from sim.backend.runtime import initialize
from sim.effects import REGISTRY
from sim.packing import pack

if TYPE_CHECKING:
    import trimesh

FEWEST_PARTICLES = 200      # below, the cavity is 7 particles wide and a third of them touch the wall
PACKING_ITERATIONS = 80     # the compression rate has evened out; more lets single particles creep into the wall
SHALLOWEST = 0.2            # depth in spacings to which the few particles return that packing pushed into the wall


def voxelize(scene: Scene, mesh: "trimesh.Trimesh", source: str = "scene", shift: ArrayLike = (0.0, 0.0, 0.0)
             ) -> tuple[dict[str, np.ndarray], dict]:
    """Fill the cavity with packed liquid particles and line it with wall particles.

    Parameters
    ----------
    scene : gives particle spacing, layers of wall particles, support radius and the points that must lie inside.
    mesh : closed surface of the cavity, m.
    source : file that errors name.
    shift : (3,), particle spacings by which the lattice lies elsewhere: another start of the same scene.

    Returns
    -------
    arrays of ``initial.npz`` (see ``pipeline.cavity.shapes.shape_arrays``) and the report, both in SI units.

    Raises
    ------
    UserError : the cavity is too small for the spacing, or a cannula or drain lies outside it.
    """
    numerics, spacing = scene.numerics, scene.numerics.particle_spacing
    margin = (max(numerics.wall_layers, 3) + 1.5) * spacing
    too_many = too_large(scene.settings(), float(mesh.volume), float(np.prod(mesh.extents + 2.0 * margin)))
    if too_many:
        raise UserError(f"{source}: numerics.particle_spacing: {too_many}")
    distance = distance_of_mesh(mesh, 0.5 * spacing, margin=margin)
    volume = distance.volume_below()
    count = round(volume / spacing**3)
    if count < FEWEST_PARTICLES:
        raise UserError(f"{source}: numerics.particle_spacing: {1e3 * spacing:g} mm leaves {count} particles in a "
                        f"cavity of {1e6 * mesh.volume:.3g} mL, but at least {FEWEST_PARTICLES} are needed (at most "
                        f"{1e3 * np.cbrt(mesh.volume / FEWEST_PARTICLES):.3g} mm)")
    check_points_inside(scene, mesh, distance, source)
    walls = wall_layers(distance, spacing, numerics.wall_layers)
    lower, upper = mesh.bounds + spacing * np.asarray(shift, float)
    fluid = deepest_points(distance, lower, upper, count, spacing)
    initialize(numerics.precision, numerics.threads, numerics.device)
    try:
        fluid, compression = pack(fluid, np.full(count, volume / count), walls["wall_position"], walls["wall_volume"],
                                  spacing, numerics.support_ratio, PACKING_ITERATIONS)
    except OverflowError as error:
        raise UserError(f"{source}: numerics.particle_spacing: {1e3 * spacing:g} mm is too coarse to pack the cavity "
                        f"({error})") from error
    stray = distance.sample(fluid) > -SHALLOWEST * spacing
    fluid[stray] = distance.project(fluid[stray], -SHALLOWEST * spacing)
    arrays = initial_arrays(fluid, walls, distance, volume, spacing)
    return arrays, report_of(arrays, mesh, compression, int(stray.sum()))


def check_points_inside(scene: Scene, mesh: "trimesh.Trimesh", distance: SignedDistance, source: str) -> None:
    """Refuse a point of an effect, such as a cannula, outside the cavity."""
    for name, key in [(effect, point) for effect in scene.effects for point in REGISTRY[effect].inside]:
        point = np.array([getattr(scene.effects[name], key)])
        if distance.sample(point)[0] < 0.0:
            continue
        depth = distance_to_triangles(mesh, point, longest_edge=1e-3)[0]
        coordinates = ", ".join(f"{1e3 * value:g}" for value in point[0])
        raise UserError(f"{source}: effects.{name}.{key}: ({coordinates}) mm lies {1e3 * depth:.2g} mm outside the "
                        "eye, but must lie inside its cavity (origin = center of the globe, z forward)")


def report_of(arrays: dict[str, np.ndarray], mesh: "trimesh.Trimesh", compression: np.ndarray, strays: int) -> dict:
    """Report of the stage: counts, volumes in m3, and spacings as multiples of the particle spacing."""
    spacing = float(arrays["particle_spacing"])
    fluid, walls, depths = arrays["fluid_position"], arrays["wall_position"], arrays["wall_distance"]
    distance = SignedDistance(arrays["sdf_values"], arrays["sdf_origin"], float(arrays["sdf_cell"]))
    layers = []
    for layer in range(round(depths.max() / spacing + 0.5)):
        nearest = nearest_distances(walls[np.abs(depths / spacing - layer - 0.5) < 0.25]) / spacing
        layers.append({"count": len(nearest), "depth": layer + 0.5, "spacing_smallest": nearest.min(),
                       "spacing_1_percent": np.percentile(nearest, 1), "spacing_mean": nearest.mean()})
    liquid = float(arrays["fluid_volume"].sum())
    nearest = nearest_distances(fluid) / spacing
    to_wall = cKDTree(walls).query(fluid)[0] / spacing
    return {
        "particle_spacing": spacing, "fluid_particles": len(fluid), "wall_particles": len(walls),
        "wall_layers": layers, "mesh_volume": float(mesh.volume), "liquid_volume": liquid,
        "relative_volume_error": liquid / float(mesh.volume) - 1.0, "spacing_smallest": nearest.min(),
        "spacing_1_percent": np.percentile(nearest, 1), "spacing_mean": nearest.mean(),
        "spacing_to_wall_smallest": to_wall.min(), "shallowest_depth": -distance.sample(fluid).max() / spacing,
        "returned_from_wall": strays,
        "compression_mean": compression.mean(), "compression_spread": compression.std(),
        "compression_smallest": compression.min(), "compression_largest": compression.max(),
        "grid_nodes": list(arrays["sdf_values"].shape),
    }


def nearest_distances(points: np.ndarray) -> np.ndarray:
    """Distance (n,) from each point (n, D) to its nearest neighbor."""
    return cKDTree(points).query(points, k=2, workers=library_threads())[0][:, 1]
