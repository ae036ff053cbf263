"""Let Surface Evolver enter the two cases at rest, and set the reference of the eye.

    python benchmarks/tamponade-10/surface_evolver.py --keep evolver     all shapes: entries/surface_evolver.csv and
                                                                         eye_at_rest/codes.csv; minutes
    cd evolver/sphere_60 && evolver -x -f oil.cmd oil.fe                 one of them again, from the inputs kept

It needs the program `evolver` (Debian: evolver-nox). What it is told is in `tests/judges/surface_evolver.py`: the exact
wall as a formula, the tensions, the weight and the volume, and a level start. It moves the contact line along the wall
and mends its own triangles. The eye has no exact solution: codes.csv sets Surface Evolver beside the least energy that
`pipeline.equilibrium` finds with 10,242 directions, which shares no code and no approximation with it.
"""
import argparse
import csv
import importlib.util
import resource
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
_JUDGE = importlib.util.spec_from_file_location("judge", ROOT / "tests" / "judges" / "surface_evolver.py")
judge = importlib.util.module_from_spec(_JUDGE)
sys.modules["judge"] = judge  # dataclasses ask for it
_JUDGE.loader.exec_module(judge)

ANGLES = (18.2, 60.0, 120.0)
POSTURES = {"upright": (0.0, -1.0, 0.0), "supine": (0.0, 0.0, -1.0), "prone": (0.0, 0.0, 1.0)}
PARTS = ("retina", "inferior")
INPUTS = ("oil.fe", "oil.cmd")
CODES = ("code", "posture", "part", "value", "unit", "reference")


def sphere(angle: float):
    """Return the sphere at a contact angle, deg."""
    return judge.Case(None, 0.80, POSTURES["upright"], angle)


def eye(posture: str):
    """Return the eye in a posture."""
    return judge.Case(judge.eye_shape(), 0.85, POSTURES[posture])


def height_on_axis(free: np.ndarray) -> float:
    """Return where the interface crosses the vertical axis, m, of its triangles (n, 3, 3); y is up."""
    a, b, c = (free[:, corner][:, [0, 2]] for corner in range(3))
    turn = (b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0]
    second = (-a[:, 0] * (c - a)[:, 1] + a[:, 1] * (c - a)[:, 0]) / turn
    third = ((b - a)[:, 0] * -a[:, 1] + (b - a)[:, 1] * a[:, 0]) / turn
    inside = (second >= 0.0) & (third >= 0.0) & (second + third <= 1.0)
    heights = free[:, 0, 1] + second * (free[:, 1, 1] - free[:, 0, 1]) + third * (free[:, 2, 1] - free[:, 0, 1])
    return float(heights[inside].min())


def spheres(keep: Path) -> Iterator[tuple]:
    """Lines of the entry of the sphere."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    for angle in ANGLES:
        case = sphere(angle)
        wall, free = judge.triangles(case, keep / f"sphere_{angle:g}")
        share = judge.covered(case, wall)["wall"] / 100.0
        arc = 2.0 * np.degrees(np.arccos(1.0 - 2.0 * share))
        yield f"arc_{angle:g}_deg", "", f"{arc:.5g}", "deg"
        yield f"height_on_axis_{angle:g}_deg", "", f"{1e3 * height_on_axis(free):.5g}", "mm"
        if angle == ANGLES[0]:
            yield f"covered_share_{angle:g}_deg", "", f"{share:.5g}", "1"
    yield "processor_time", "", f"{resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before:.4g}", "s"


def eyes(keep: Path, rows: list[dict[str, str]]) -> Iterator[tuple]:
    """Lines of the entry of the eye; what both codes found goes to rows."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
    for posture in POSTURES:
        case = eye(posture)
        found = judge.covered(case, judge.triangles(case, keep / f"eye_{posture}")[0])
        energy, coarse = judge.by_energy(case)
        for part in PARTS:
            for code, value, counts in (("Surface Evolver", found[part], "yes"),
                                        ("least energy with 10,242 directions", energy[part], "yes"),
                                        ("least energy with 2,562 directions", coarse[part], "no")):
                rows.append(dict(zip(CODES, (code, posture, part, f"{value:.4g}", "%", counts), strict=True)))
            yield f"covered_{part}_{posture}", "", f"{found[part]:.4g}", "%"
    yield "processor_time", "", f"{resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before:.4g}", "s"


def main() -> None:
    """Run; see the head of the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path, required=True, help="folder for its inputs and logs")
    keep = parser.parse_args().keep.resolve()
    if shutil.which(judge.PROGRAM) is None:
        raise SystemExit(f"there is no program {judge.PROGRAM} (Debian: apt-get install evolver-nox)")
    rows: list[dict[str, str]] = []
    lines = [("sphere_at_rest", *line) for line in spheres(keep)]
    lines += [("eye_at_rest", *line) for line in eyes(keep, rows)]
    with (HERE / "entries" / "surface_evolver.csv").open("w", newline="") as file:
        csv.writer(file, lineterminator="\n").writerows([("case", "quantity", "time", "value", "unit"), *lines])
    with (HERE / "eye_at_rest" / "codes.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, CODES, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
