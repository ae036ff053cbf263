"""Read hundreds of meshes of six known eyes, as programs write them: each gives its eye, or one sentence that helps.

    python tests/fuzz/fuzz_meshes.py                    200 files
    python tests/fuzz/fuzz_meshes.py --count 20 --seed 3

An eye is turned to one of 24 axes, moved, scaled to a unit, cut into triangles in one of five ways, joined by other
bodies, and written in one of eleven dialects. It is read as the eye stage reads it; where a sentence says what to set,
that is set, as a user would. Volume and area of the retina must be within half a per cent of the eye's (the volume of
stairs within that of their own, since voxels may end up to half of one before a flat side); several bodies must be
refused. Kinds that fail are listed with what they were.
"""
import argparse
import collections
import itertools
import re
import sys
import tempfile
from pathlib import Path

import numpy as np
import pyvista
import trimesh

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from helpers.mesh_dialects import binary_stl, obj, ply_of_strips, text_stl  # noqa: E402
from skimage.measure import marching_cubes  # noqa: E402

from pipeline.base.errors import UserError  # noqa: E402
from pipeline.cavity.landmarks import laid  # noqa: E402
from pipeline.cavity.mesh_import import import_mesh  # noqa: E402
from pipeline.equilibrium.contact import positive_share  # noqa: E402
from pipeline.scenes.eye_shape import eye_mesh, shape_of  # noqa: E402
from pipeline.scenes.model import MESH_UNITS, Buckle, Eye, Staphyloma  # noqa: E402
from pipeline.scenes.retina import ORA  # noqa: E402

WITHIN = 5e-3           # of volume and area of the retina
EYES = {"usual": Eye(), "short": Eye(axial_length=0.021), "long": Eye(axial_length=0.030, lens="pseudophakic"),
        "aphakic": Eye(lens="aphakic"), "staphyloma": Eye(axial_length=0.028, staphyloma=Staphyloma(3e-3, 10e-3)),
        "buckle": Eye(buckle=Buckle(height=1.5e-3, width=4e-3, latitude=np.radians(95.0), clock_hours=(10.0, 2.0)))}
AXES = [matrix for order in itertools.permutations(range(3)) for signs in itertools.product((1, -1), repeat=3)
        if np.linalg.det(matrix := np.diag(signs) @ np.eye(3)[list(order)]) > 0.0]
UNITS = {"mm": 1e3, "m": 1.0, "in": 1e3 / 25.4, "cm": 1e2}
TRIANGLES = ("as made", "finer on one side", "reduced", "stairs", "soup")
BODIES = ("one",) * 5 + ("specks", "other eye", "wall")
ADVICE = {r"set eye\.unit: (\w+)": lambda word: {"unit": word}, r"set eye\.smooth: true": lambda word: {"smooth": True}}


def number(value: float) -> str:
    """A coordinate in full, in any unit."""
    return f"{value:.9g}"


DIALECTS = {
    "binary.stl": binary_stl,
    "tail.stl": lambda mesh: binary_stl(mesh, b"solid facet", tail=b"\0" * 40),
    "text.stl": lambda mesh: text_stl(mesh, number).encode(),
    "capitals.stl": lambda mesh: text_stl(mesh, number).upper().encode(),
    "comma.stl": lambda mesh: text_stl(mesh, lambda value: number(value).replace(".", ",")).encode("utf-16"),
    "eye.obj": lambda mesh: obj(mesh, number).encode(),
    "order.obj": lambda mesh: obj(mesh, number, "faces first").encode(),
    "strips.ply": ply_of_strips,
    "eye.ply": lambda mesh: mesh.export(file_type="ply"),
    "eye.vtk": None, "eye.vtp": None}


def cut(mesh: trimesh.Trimesh, kind: str, level, chance: np.random.Generator) -> trimesh.Trimesh:
    """The same surface in other triangles, m."""
    if kind == "finer on one side":
        way = chance.normal(size=3)
        for _ in range(2):      # every triangle there becomes three around its middle, so that no edge opens
            side = mesh.triangles_center @ way
            near = side > np.quantile(side, 0.7)
            middle = len(mesh.vertices) + np.arange(near.sum())
            a, b, c = mesh.faces[near].T
            faces = np.concatenate([mesh.faces[~near], *(np.column_stack([one, two, middle])
                                                         for one, two in ((a, b), (b, c), (c, a)))])
            mesh = trimesh.Trimesh(np.concatenate([mesh.vertices, mesh.triangles_center[near]]), faces, process=False)
        return mesh
    if kind == "reduced":
        data = pyvista.make_tri_mesh(np.asarray(mesh.vertices), mesh.faces).decimate_pro(0.5, preserve_topology=True)
        return trimesh.Trimesh(data.points, data.regular_faces, process=False)
    if kind == "stairs":
        size = chance.uniform(0.3e-3, 0.6e-3)
        low, high = mesh.bounds[0] - 3.3 * size, mesh.bounds[1] + 3.0 * size
        axes = [np.arange(one, other, size) for one, other in zip(low, high, strict=True)]
        inside = level(np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)) < 0.0
        vertices, faces, *_ = marching_cubes(inside.astype(np.float32), 0.5, spacing=(size,) * 3)
        found = trimesh.Trimesh(vertices + low, faces, process=False)
        if found.volume < 0.0:
            found.invert()
        return found
    if kind == "soup":
        return trimesh.Trimesh(mesh.triangles.reshape(-1, 3), np.arange(3 * len(mesh.faces)).reshape(-1, 3),
                               process=False)
    return mesh


def joined(mesh: trimesh.Trimesh, kind: str) -> trimesh.Trimesh:
    """A surface with other bodies, m."""
    speck = trimesh.creation.icosphere(1, 0.3e-3)
    more = {"specks": [speck.copy().apply_translation([0.02, 0.01 * k, 0.0]) for k in range(3)],
            "other eye": [mesh.copy().apply_translation([0.062, 0.0, 0.0])],
            "wall": [mesh.copy().apply_scale(1.06)]}.get(kind, [])
    return trimesh.util.concatenate([mesh, *more]) if more else mesh


def written(mesh: trimesh.Trimesh, path: Path) -> None:
    """Write a mesh in the dialect of a name."""
    content = DIALECTS[path.name]
    if content is None:
        pyvista.make_tri_mesh(np.asarray(mesh.vertices), mesh.faces).save(path)
    else:
        path.write_bytes(content(mesh))


def read(path: Path) -> tuple[trimesh.Trimesh | None, list[str]]:
    """The eye as the stage lays it, or None, and the sentences on the way: what they say to set is set."""
    options: dict = {}
    said: list[str] = []
    for _ in range(4):
        try:
            found = import_mesh(path, **options)
            return laid(found.mesh, None, "right", str(path), found.space)[0], said
        except UserError as error:
            said.append(str(error))
            if "\n" in said[-1]:
                return None, said
            more = {key: value for pattern, answer in ADVICE.items() if (hit := re.search(pattern, said[-1]))
                    for key, value in answer(hit[1] if hit.groups() else "").items()}
            if not more or more.items() <= options.items():
                return None, said
            options |= more
    return None, said


def retina(mesh: trimesh.Trimesh) -> float:
    """Area of the retina, m2: what is within the ora serrata around the posterior pole."""
    points = mesh.vertices
    angle = np.degrees(np.arccos(np.clip(-points[:, 2] / np.linalg.norm(points, axis=1), -1.0, 1.0)))
    return float(mesh.area_faces @ positive_share((ORA - angle)[mesh.faces]))


def main() -> int:
    """Write, read, compare, count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200, help="files (default 200)")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    chance, ended, bad = np.random.default_rng(options.seed), collections.Counter(), []
    errors: dict[str, list[float]] = {"volume": [], "retina": []}
    with tempfile.TemporaryDirectory(prefix="meshes_") as folder:
        known = {}
        for name, eye in EYES.items():
            shape = shape_of(eye)
            path = Path(folder) / "binary.stl"
            mesh = eye_mesh(shape)
            written(mesh.copy().apply_scale(1e3), path)
            known[name] = mesh, shape.level, read(path)[0]
        for index in range(options.count):
            name, unit = chance.choice(list(EYES)), chance.choice(list(UNITS))
            triangles, bodies, dialect = (str(chance.choice(one)) for one in (TRIANGLES, BODIES, list(DIALECTS)))
            axes, place = AXES[index % len(AXES)], chance.uniform(-0.3, 0.3, 3)
            mesh, level, plain = known[name]
            mesh = cut(mesh, triangles, level, chance)
            volume = mesh.volume if triangles == "stairs" else plain.volume
            mesh = joined(mesh, bodies)
            mesh = trimesh.Trimesh(UNITS[unit] * (mesh.vertices @ axes.T + place), mesh.faces, process=False)
            path = Path(folder) / dialect
            written(mesh, path)
            found, said = read(path)
            path.unlink()
            what = f"{index}: {name}, {unit}, {triangles}, {bodies}, {dialect}, axes {axes.astype(int).tolist()}"
            if bodies in ("other eye", "wall"):
                good = found is None and "separate pieces" in said[-1] and "\n" not in said[-1]
                ended["refused"] += good
                if not good:
                    bad.append(f"{what}: {said[-1] if said else 'read'}")
            elif found is None:
                bad.append(f"{what}: {said[-1]}")
            else:
                off = found.volume / volume - 1.0, retina(found) / retina(plain) - 1.0
                for key, value in zip(errors, off, strict=True):
                    errors[key].append(abs(value))
                ended["read at once" if not said else "read as a sentence said"] += 1
                if max(map(abs, off)) > WITHIN:
                    bad.append(f"{what}: volume {100 * off[0]:+.2f} %, retina {100 * off[1]:+.2f} %")
    counts = ", ".join(f"{count} {how}" for how, count in sorted(ended.items()))
    most = {key: 100.0 * max(values, default=0.0) for key, values in errors.items()}
    print(f"meshes: {options.count}; {counts}; largest error of the volume {most['volume']:.2f} %, of the retina "
          f"{most['retina']:.2f} %; {len(bad)} failed")
    print("\n".join(bad))
    return int(bool(bad) or not all(units in MESH_UNITS for units in UNITS))


if __name__ == "__main__":
    sys.exit(main())
