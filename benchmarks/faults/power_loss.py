"""Cut the power of a disk while files are written to it, and look at what it holds.

    python benchmarks/faults/power_loss.py            needs root: mounts an ext4 in a file
    python benchmarks/faults/power_loss.py --without  the same without waiting for the disk

A process writes frames and folders through `pipeline.base.files`. At a random moment the file that is the disk is
copied, as a loss of power leaves it: what the system has not written is not in it. In the copy every file that has its
name must be whole. The time that waiting for the disk takes is measured on the disk of this folder.
"""
import argparse
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]

from helpers.synthetic_frames import make_frame  # noqa: E402

from pipeline.base import files  # noqa: E402
from pipeline.base.checksum import check  # noqa: E402
from pipeline.base.errors import UserError  # noqa: E402
from pipeline.base.frame_files import frame_path, save_checkpoint, write_frame  # noqa: E402

SIZE = 64  # MiB, of the disk
STAGES = "segment_{:03d}"


def write(folder: Path, segments: int) -> None:
    """Write segments of frames and their checkpoints, as a simulation does."""
    frame = make_frame(count=500)
    for segment in range(segments):
        with files.replacing_folder(folder / "frames" / STAGES.format(segment)) as temporary:
            for number in range(3):
                write_frame(frame_path(temporary, number), frame)
        save_checkpoint(folder / "checkpoints" / f"{STAGES.format(segment)}.npz", {"position": frame.position})


def mounted(image: Path, folder: Path, *options: str) -> None:
    """Mount a disk; it writes nothing by itself for ten minutes."""
    folder.mkdir(exist_ok=True)
    subprocess.run(["mount", "-o", ",".join(("loop", "commit=600", *options)), image, folder], check=True)


def loss(work: Path, after: float) -> tuple[int, list[str]]:
    """Lose power some seconds after the beginning; how many names there are, and which have no whole file."""
    image, disk = work / "disk", work / "mounted"
    image.write_bytes(bytes(SIZE * 2**20))
    subprocess.run(["mkfs.ext4", "-q", image], check=True)
    mounted(image, disk)
    writer = os.fork()
    if writer == 0:
        write(disk, 1000)
        os._exit(0)
    time.sleep(after)
    shutil.copy(image, work / "copy")
    os.kill(writer, 9)
    os.waitpid(writer, 0)
    subprocess.run(["umount", disk], check=True)
    mounted(work / "copy", disk)
    bad, names = [], 0
    for path in sorted(path for path in disk.rglob("*") if path.suffix in (".vtu", ".npz")):
        if any(part.startswith(".") for part in path.relative_to(disk).parts):
            continue
        names += 1
        try:
            check(path)
        except UserError:
            bad.append(str(path.relative_to(disk)))
    segments = [folder for folder in disk.glob("frames/segment_*") if len(list(folder.iterdir())) != 3]
    subprocess.run(["umount", disk], check=True)
    return names, bad + [str(folder) for folder in segments]


def main() -> int:
    """Lose power, and count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=20)
    parser.add_argument("--without", action="store_true", help="do not wait for the disk, to see what that loses")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    chance, names, bad = random.Random(options.seed), 0, []
    seconds = {}
    wait = files._to_disk
    with tempfile.TemporaryDirectory(prefix="power_", dir=ROOT) as work:
        for name, function in (("with", wait), ("without", lambda _: None)):
            files._to_disk = function
            begin = time.perf_counter()
            write(Path(work) / name, 10)
            seconds[name] = (time.perf_counter() - begin) / 40.0
        files._to_disk = (lambda _: None) if options.without else wait
        for _ in range(options.count):
            found, spoiled = loss(Path(work), chance.uniform(0.3, 3.0))
            names, bad = names + found, bad + spoiled
    how = "without" if options.without else "with"
    took = ", ".join(f"{1e3 * value:.1f} ms {name} waiting" for name, value in seconds.items())
    print(f"{options.count} losses of power, {how} waiting for the disk: {names} files had their names, {len(bad)} of "
          f"them were not whole; a file takes {took}")
    return int(bool(bad) and not options.without)


if __name__ == "__main__":
    sys.exit(main())
