"""Judge of `pipeline.export --format usd`: what Blender makes of a run.

    python tests/judges/blender.py outputs/tamponade/draft --python /somewhere/bin/python

It needs a Python with Blender's module, which is no dependency of the pipeline and wants an environment of its own
(`pip install bpy`); without one the script says so and judges nothing. The file is opened there by Blender's own
import. Its playback has to end with the run, the wall has to be as large as that of the eye, in m and with Blender's z
up, and at every saved time every liquid has to have the volume of its surface file.
"""
import argparse
import importlib.util
import json
import math
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[2]
PYTHON = "BPY_PYTHON"       # variable of the environment that names the Python with Blender
VOLUME, SIZE = 1e-5, 1e-6   # relative, of a volume, and m, of the wall: Blender has single precision


def main() -> None:
    """Run; see the head of the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("run", type=Path, help="folder of a run: outputs/<scene>/<level>")
    parser.add_argument("--python", help=f"Python with the module bpy (default: that of {PYTHON}, else this one)")
    options = parser.parse_args()
    python = options.python or found_python()
    if python is None:
        print(f"not judged: no Python with Blender's module bpy; name one by --python or {PYTHON}")
        return
    sys.path.insert(0, str(ROOT))
    lines, wrong = judged(options.run, python)
    print("\n".join([*lines, *(f"wrong: {one}" for one in wrong)]))
    raise SystemExit(1 if wrong else 0)


def found_python() -> str | None:
    """Return the Python with Blender that this computer has; None without."""
    return os.environ.get(PYTHON) or (sys.executable if importlib.util.find_spec("bpy") else None)


def judged(run: Path, python: str) -> tuple[list[str], list[str]]:
    """Return what Blender shows of a run, line by line, and what of it is not as in the files of the run."""
    from pipeline import export
    from pipeline.exchange.usd_film import identifiers, time_codes_per_second
    from pipeline.runs.run_folder import RunFolder
    from pipeline.surfaces.surface_files import read_surface

    scene, frames = RunFolder(run).scene, RunFolder(run).ready_frames
    rate = time_codes_per_second(scene.output.frame_interval)
    # Blender counts whole frames: the first one that shows a saved time.
    shown = [math.ceil(round(rate * frame.time, 6)) for frame in frames]
    with tempfile.TemporaryDirectory() as folder:
        export.main([str(run), "--format", "usd", "--output", folder])
        seen = seen_by_blender(Path(folder) / "run.usdc", shown, python)
    lines = [f"Blender {seen['version']}: frames {seen['range'][0]} to {seen['range'][1]}"]
    wrong = [] if seen["range"] == [shown[0], shown[-1]] else [f"frames {seen['range']}, asked {[shown[0], shown[-1]]}"]
    x_low, x_high, y_low, y_high, z_low, z_high = read_surface(run / "eye.vtp").bounds
    asked = [[x_low, -z_high, y_low], [x_high, -z_low, y_high]]
    sizes = [f"{1e3 * (high - low):.2f}" for low, high in zip(*seen["wall"], strict=True)]
    lines.append(f"wall: {' x '.join(sizes)} mm")
    if any(abs(a - b) > SIZE for pair in zip(asked, seen["wall"], strict=True) for a, b in zip(*pair, strict=True)):
        wrong.append(f"the wall lies between {seen['wall']}, asked {asked}")
    liquids = [liquid.name for liquid in scene.liquids]
    for liquid, name in zip(liquids, identifiers(liquids), strict=True):
        volumes = [frame.surface(liquid).volume for frame in frames]
        found = seen["volumes"].get(name, [])
        off = [abs(a - b) / max(b, 1e-12) for a, b in zip(found, volumes, strict=True)] if found else [math.inf]
        lines.append(f"{liquid}: {len(set(found))} volumes at {len(frames)} times, at most {max(off):.1e} off")
        wrong += [f"{liquid} at frame {shown[off.index(max(off))]}"] if max(off) > VOLUME else []
    return lines, wrong


def seen_by_blender(path: Path, shown: list[int], python: str) -> dict:
    """Return what Blender shows at its frames: version, range, corners of the wall in m, volumes of meshes in m3."""
    result = path.with_suffix(".json")
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    done = subprocess.run([python, "-c", INSIDE, path, result, json.dumps(shown)], text=True, capture_output=True,
                          env=environment, check=False)
    if not result.is_file():
        raise SystemExit(f"{python} ended with {done.returncode}: {(done.stdout + done.stderr)[-1000:]}")
    return json.loads(result.read_text())


INSIDE = """
import json, sys
import bpy
import numpy as np

file, result, shown = sys.argv[1:]
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.ops.wm.usd_import(filepath=file)
scene = bpy.context.scene
meshes = [one for one in bpy.data.objects if one.type == "MESH"]

def points_and_triangles(one, graph):
    shape = one.evaluated_get(graph)
    mesh = shape.to_mesh()
    mesh.calc_loop_triangles()
    points, faces = np.zeros(3 * len(mesh.vertices), np.float32), np.zeros(3 * len(mesh.loop_triangles), np.int32)
    mesh.vertices.foreach_get("co", points)
    mesh.loop_triangles.foreach_get("vertices", faces)
    shape.to_mesh_clear()
    place = np.array(one.matrix_world)
    return points.reshape(-1, 3).astype(float) @ place[:3, :3].T + place[:3, 3], faces.reshape(-1, 3)

volumes, wall = {one.name: [] for one in meshes}, None
for frame in json.loads(shown):
    scene.frame_set(frame)
    graph = bpy.context.evaluated_depsgraph_get()
    for one in meshes:
        points, faces = points_and_triangles(one, graph)
        a, b, c = points[faces].transpose(1, 0, 2)
        volumes[one.name].append(float((np.cross(a, b) * c).sum() / 6.0))
        if one.name == "wall":
            wall = [points.min(axis=0).tolist(), points.max(axis=0).tolist()]
with open(result, "w") as out:
    json.dump({"version": bpy.app.version_string, "range": [scene.frame_start, scene.frame_end], "wall": wall,
               "volumes": volumes}, out)
"""


if __name__ == "__main__":
    main()
