"""Read spoiled meshes, frames and checkpoints: each must end in its content or in one sentence.

    python benchmarks/faults/flips.py                       500 of every kind
    python benchmarks/faults/flips.py flipped --count 50    frames and checkpoints with one bit flipped

A mesh is spoiled in one of seven ways: bits, bytes, pieces, numbers. Of frames and checkpoints one bit is flipped;
forged ones are spoiled as meshes are and get a new checksum, as if it had been done on purpose. Every file is read in
a process of its own, which is watched for tracebacks, crashes, time, memory, and for running code or opening the
network.
"""
import argparse
import collections
import os
import random
import re
import resource
import signal
import sys
import tempfile
import time
from pathlib import Path

import meshio
import nibabel
import nrrd
import numpy as np
import pyvista
import trimesh

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from helpers.synthetic_frames import make_frame  # noqa: E402

from pipeline.base.checksum import LENGTH, append_checksum  # noqa: E402
from pipeline.base.errors import UserError  # noqa: E402
from pipeline.base.frame_files import load_checkpoint, read_frame, save_checkpoint, write_frame  # noqa: E402
from pipeline.cavity import vtk_reader  # noqa: E402
from pipeline.cavity.mesh_import import import_mesh  # noqa: E402
from pipeline.scenes.model import is_image  # noqa: E402
from pipeline.simulation.runner import unlike  # noqa: E402

LONGEST, LARGEST = 60.0, 2**30  # s, bytes: what a file may take
FORBIDDEN = ("pickle.find_class", "os.system", "os.exec", "socket.connect")
VALUES = (b"-1", b"0", b"1e308", b"nan", b"4294967296", b"99999999999999999999", b"x")
STATE = {"particles.id": np.arange(50), "particles.position": np.random.default_rng(1).normal(size=(50, 3)),
         "particles.velocity": np.zeros((50, 3), np.float32), "time": 0.5, "scheme.eigenvalue": 1.5}


def spoiled(content: bytes, chance: random.Random) -> bytes:
    """A file with one thing wrong with it."""
    place = chance.randrange(len(content))
    size = chance.randrange(1, 200)
    way = chance.randrange(7)
    if way == 0:
        return content[:place] + bytes([content[place] ^ 1 << chance.randrange(8)]) + content[place + 1:]
    if way == 1:
        return content[:place] + chance.randbytes(size) + content[place + size:]
    if way == 2:
        return content[:place]
    if way == 3:
        return content[:place] + content[place + size:]
    if way == 4:
        return content[:place] + content[place:place + size] + content[place:]
    if way == 5:
        return content[:place] + chance.randbytes(size) + content[place:]
    numbers = list(re.finditer(rb"\d+", content[:4096] if chance.random() < 0.5 else content))
    one = chance.choice(numbers)
    return content[:one.start()] + chance.choice(VALUES) + content[one.end():]


def flipped(content: bytes, chance: random.Random) -> bytes:
    """A file with one bit flipped."""
    place = chance.randrange(len(content))
    return content[:place] + bytes([content[place] ^ 1 << chance.randrange(8)]) + content[place + 1:]


def meshes(folder: Path) -> list[Path]:
    """An eye in every format that is read."""
    ball = trimesh.creation.icosphere(3, 12.0)
    data = pyvista.make_tri_mesh(np.asarray(ball.vertices), ball.faces)
    plain = meshio.Mesh(ball.vertices, [("triangle", ball.faces)])
    paths = {name: folder / name for name in (
        "binary.stl", "text.stl", "eye.obj", "binary.ply", "text.ply", "eye.vtp", "eye.vtk", "eye.vtu", "binary.msh",
        "text.msh", "eye.nii", "packed.nii.gz", "eye.nrrd")}
    ball.export(paths["binary.stl"])
    ball.export(paths["text.stl"], file_type="stl_ascii")
    ball.export(paths["eye.obj"])
    ball.export(paths["binary.ply"])
    ball.export(paths["text.ply"], encoding="ascii")
    data.save(paths["eye.vtp"])
    data.save(paths["eye.vtk"])
    data.cast_to_unstructured_grid().save(paths["eye.vtu"])
    plain.write(paths["binary.msh"], file_format="gmsh")
    plain.write(paths["text.msh"], file_format="gmsh", binary=False)
    index = np.stack(np.meshgrid(*3 * [np.arange(-16.0, 17.0)], indexing="ij"), axis=-1)
    labels = (np.linalg.norm(index, axis=-1) < 12.0).astype(np.uint8)
    for name in ("eye.nii", "packed.nii.gz"):
        nibabel.Nifti1Image(labels, np.eye(4)).to_filename(paths[name])
    head = {"space": "RAS", "space directions": np.eye(3), "space units": ["mm"] * 3}
    nrrd.write(str(paths["eye.nrrd"]), labels, head)
    return list(paths.values())


def imported(path: Path) -> None:
    """Read an eye, of an image its label."""
    import_mesh(path, label=1 if is_image(path) else None)


def restart(path: Path) -> None:
    """Read a checkpoint and look at what it holds, as the simulate stage does."""
    if reason := unlike(load_checkpoint(path), STATE):
        raise UserError(f"{path}: {reason}")


def outcome(read, path: Path) -> tuple[str, float, int]:
    """How reading a file ended, in a process of its own; its time, s, and its memory, bytes."""
    begin = time.monotonic()
    child = os.fork()
    if child == 0:
        _read_and_exit(read, path)
    while True:
        found, status, used = os.wait4(child, os.WNOHANG)
        if found:
            break
        if time.monotonic() - begin > LONGEST:
            os.kill(child, signal.SIGKILL)
            os.wait4(child, 0)
            return "HANG", LONGEST, 0
        time.sleep(0.002)
    code = os.waitstatus_to_exitcode(status)
    names = {0: "read", 2: "sentence", 3: "TRACEBACK", 4: "CODE WAS RUN"}
    return names.get(code, f"CRASH {code}"), time.monotonic() - begin, 1024 * used.ru_maxrss


def _read_and_exit(read, path: Path) -> None:
    """Read a file; the exit code says how it ended."""
    def watch(event: str, arguments: tuple) -> None:
        if event in FORBIDDEN or (event == "subprocess.Popen" and vtk_reader.__file__ not in arguments[1]):
            os._exit(4)

    sys.addaudithook(watch)
    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    try:
        read(path)
    except UserError as error:
        os._exit(2 if len(error.messages) == 1 and "\n" not in error.messages[0] else 3)
    except BaseException as error:
        print(f"{path.name}: {type(error).__name__}: {error}", file=sys.stderr, flush=True)
        os._exit(3)
    os._exit(0)


def main() -> int:
    """Spoil, read, count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("kinds", nargs="*", metavar="KIND", help="which of meshes, flipped, forged (default: all)")
    parser.add_argument("--count", type=int, default=500, help="of every kind (default 500)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--keep", type=Path, help="folder for files that were not dealt with")
    options = parser.parse_args()
    chance, bad = random.Random(options.seed), 0
    with tempfile.TemporaryDirectory(prefix="flips_") as work:
        folder = Path(work)
        write_frame(folder / "frame_00000.vtu", make_frame(count=200))
        save_checkpoint(folder / "segment_000.npz", STATE)
        results = [(folder / "frame_00000.vtu", read_frame), (folder / "segment_000.npz", restart)]
        kinds = {
            "meshes": ([(path, imported) for path in meshes(folder)], spoiled, False),
            "flipped": (results, flipped, False),
            "forged": (results, spoiled, True),
        }
        for kind in options.kinds or kinds:
            files, spoil, seal = kinds[kind]
            ended, slowest, largest = collections.Counter(), 0.0, 0
            for number in range(options.count):
                path, read = files[number % len(files)]
                content = path.read_bytes()
                target = folder / f"{number}_{path.name}"
                target.write_bytes(spoil(content[:-LENGTH] if seal else content, chance))
                if seal:
                    append_checksum(target)
                how, took, memory = outcome(read, target)
                ended[how] += 1
                slowest, largest = max(slowest, took), max(largest, memory)
                if how not in ("read", "sentence") or memory > LARGEST:
                    bad += 1
                    if options.keep:
                        options.keep.mkdir(parents=True, exist_ok=True)
                        (options.keep / target.name).write_bytes(target.read_bytes())
                target.unlink()
            print(f"{kind}: {', '.join(f'{count} {how}' for how, count in sorted(ended.items()))}; at most "
                  f"{slowest:.1f} s and {largest / 2**20:.0f} MiB", flush=True)
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
