"""Stage: from the surface of the cavity to liquid particles, wall particles and a signed distance grid."""
import argparse
import dataclasses
import json
import time
from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial import cKDTree

from pipeline import container
from pipeline.cli import run
from pipeline.devices import HELP, chosen_device
from pipeline.errors import UserError
from pipeline.eye import read_mesh
from pipeline.files import replacing, write_text
from pipeline.initial import initial_arrays
from pipeline.lattice import deepest_points
from pipeline.memory_check import too_large
from pipeline.scene import load_resolved
from pipeline.scene_model import Scene
from pipeline.signed_distance import SignedDistance, distance_of_mesh, distance_to_triangles
from pipeline.threads import chosen_threads, library_threads
from pipeline.wall_layers import wall_layers
from sim.packing import pack
from sim.runtime import initialize

FEWEST_PARTICLES = 200      # below, the cavity is 7 particles wide and a third of them touch the wall
PACKING_ITERATIONS = 80     # the compression rate has evened out; more lets single particles creep into the wall
SHALLOWEST = 0.2            # depth in spacings to which the few particles return that packing pushed into the wall
LARGEST_VOLUME_ERROR = 0.01


def voxelize(scene: Scene, mesh: trimesh.Trimesh, source: str = "scene") -> tuple[dict[str, np.ndarray], dict]:
    """Fill the cavity with packed liquid particles and line it with wall particles.

    Parameters
    ----------
    scene : gives particle spacing, layers of wall particles, support radius and the points that must lie inside.
    mesh : closed surface of the cavity, m.
    source : file that errors name.

    Returns
    -------
    arrays of ``initial.npz`` (see ``pipeline.shapes.shape_arrays``) and the report, both in SI units.

    Raises
    ------
    UserError : not in 3D, the cavity is too small for the spacing, or a cannula or drain lies outside it.
    """
    if scene.dimension != 3:
        raise UserError(f"{source}: dimension: is {scene.dimension}, but an eye is filled in 3 dimensions only")
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
    fluid = deepest_points(distance, *mesh.bounds, count, spacing)
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


def check_points_inside(scene: Scene, mesh: trimesh.Trimesh, distance: SignedDistance, source: str) -> None:
    """Refuse a cannula or a drain outside the cavity."""
    injection = scene.effects.get("injection")
    for key in ("cannula", "drain") if injection else ():
        point = np.array([getattr(injection, key)])
        if distance.sample(point)[0] < 0.0:
            continue
        depth = distance_to_triangles(mesh, point, longest_edge=1e-3)[0]
        coordinates = ", ".join(f"{1e3 * value:g}" for value in point[0])
        raise UserError(f"{source}: effects.injection.{key}: ({coordinates}) mm lies {1e3 * depth:.2g} mm outside the "
                        "eye, but must lie inside its cavity (origin = center of the globe, z forward)")


def report_of(arrays: dict[str, np.ndarray], mesh: trimesh.Trimesh, compression: np.ndarray, strays: int) -> dict:
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


def main(arguments: list[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    parser = argparse.ArgumentParser(prog="python -m pipeline.voxelize", description=__doc__)
    parser.add_argument("scene", type=Path, help="resolved scene (scene.json)")
    parser.add_argument("mesh", type=Path, help="surface of the cavity (eye.vtp); a container is known without it")
    parser.add_argument("--output", type=Path, required=True, help="arrays to write (initial.npz)")
    parser.add_argument("--report", type=Path, required=True, help="report to write (voxelize.json)")
    parser.add_argument("--threads", type=int, metavar="N", help="threads of the packing, 0 for as many as are useful "
                                                                 "(default: numerics.threads of the scene)")
    parser.add_argument("--device", help=f"{HELP} (default: numerics.device of the scene)")
    options = parser.parse_args(arguments)
    start = time.perf_counter()
    scene = load_resolved(options.scene)
    threads = chosen_threads(options.threads, scene, options.scene)
    device = chosen_device(options.device, scene, options.scene)
    scene = dataclasses.replace(scene, numerics=dataclasses.replace(scene.numerics, threads=threads, device=device))
    if scene.container is None:
        arrays, report = voxelize(scene, read_mesh(options.mesh), str(options.scene))
        filled = f"{100 * report['relative_volume_error']:+.2f} % of the mesh"
    else:
        arrays = container.container_arrays(scene)
        report = container.report_of(arrays)
        filled = f"{100 * report['filled']:.4g} % of the container"
    with replacing(options.output) as temporary:
        np.savez(temporary, **arrays)
    report["seconds"] = time.perf_counter() - start
    write_text(options.report, json.dumps(report, indent=2) + "\n")
    print(f"{report['fluid_particles']} liquid and {report['wall_particles']} wall particles, liquid volume {filled}, "
          f"{report['seconds']:.1f} s")
    if abs(report.get("relative_volume_error", 0.0)) > LARGEST_VOLUME_ERROR:
        print(f"warning: the liquid volume is more than {100 * LARGEST_VOLUME_ERROR:.0f} % off, a smaller "
              "numerics.particle_spacing resolves the shape better")


if __name__ == "__main__":
    run(main)
