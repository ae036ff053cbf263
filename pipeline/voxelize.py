"""Stage: from the surface of the cavity to liquid particles, wall particles and a signed distance grid."""
import dataclasses
import json
import time
from pathlib import Path

from pipeline.base.cli import run, stage_parser
from pipeline.base.files import replacing, write_text
from pipeline.cavity import container
from pipeline.cavity.initial_state import save_initial
from pipeline.cavity.surface import read_mesh
from pipeline.cavity.voxels import voxelize
from pipeline.scenes.devices import HELP, chosen_device
from pipeline.scenes.load import load_resolved
from pipeline.scenes.threads import chosen_threads

LARGEST_VOLUME_ERROR = 0.01


def main(arguments: list[str] | None = None) -> None:
    """Run the stage; see ``--help``."""
    parser = stage_parser("voxelize", __doc__)
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
        save_initial(temporary, arrays)
    write_text(options.report, json.dumps(report, indent=2) + "\n")
    print(f"{report['fluid_particles']} liquid and {report['wall_particles']} wall particles, liquid volume {filled}, "
          f"{time.perf_counter() - start:.1f} s")
    if abs(report.get("relative_volume_error", 0.0)) > LARGEST_VOLUME_ERROR:
        print(f"warning: the liquid volume is more than {100 * LARGEST_VOLUME_ERROR:.0f} % off, a smaller "
              "numerics.particle_spacing resolves the shape better")


if __name__ == "__main__":
    run(main)
