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
import json
import resource
import shutil
import sys
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
CODES = ("Surface Evolver", "least energy with 10,242 directions", "least energy with 2,562 directions")
COLUMNS = ("code", "posture", "part", "value", "unit", "reference")
FOUND = "found.json"  # beside the inputs of a shape


def sphere(angle: float):
    """Return the sphere at a contact angle, deg; beyond 90 that of the water, upside down, in place of the oil.

    Wetted wall beyond 90 degrees has a negative tension, which crumples its triangles.
    """
    if angle > 90.0:
        return judge.Case(None, 0.20, POSTURES["upright"], 180.0 - angle)
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


def of_sphere(angle: float, folder: Path) -> dict[str, float]:
    """Return what Surface Evolver finds in the sphere: arc, deg, covered share, and height on the axis, mm."""
    case, before = sphere(angle), spent()
    wall, free = judge.triangles(case, folder)
    share, height = judge.covered(case, wall)["wall"] / 100.0, 1e3 * height_on_axis(free)
    if angle > 90.0:
        share, height = 1.0 - share, -height
    return {"arc": 2.0 * float(np.degrees(np.arccos(1.0 - 2.0 * share))), "share": share, "height": height,
            "seconds": spent() - before}


def of_eye(posture: str, folder: Path) -> dict[str, float]:
    """Return the covered shares of the eye, percent, by Surface Evolver and by the least energy of both grids."""
    case, before = eye(posture), spent()
    found = judge.covered(case, judge.triangles(case, folder)[0])
    seconds = spent() - before
    energy, coarse = judge.by_energy(case)
    return {f"{part} {code}": float(values[part]) for part in PARTS
            for code, values in zip(CODES, (found, energy, coarse), strict=True)} | {"seconds": seconds}


def spent() -> float:
    """Return the processor time of Surface Evolver so far, s."""
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime


SHAPES = {f"sphere_{angle:g}": (of_sphere, angle) for angle in ANGLES} | {
    f"eye_{posture}": (of_eye, posture) for posture in POSTURES}


def write_entry(found: dict[str, dict[str, float]]) -> None:
    """Write the entry, and what the codes found in the eye."""
    lines, rows = [("case", "quantity", "time", "value", "unit")], []
    for angle in ANGLES:
        one = found[f"sphere_{angle:g}"]
        lines += [("sphere_at_rest", f"arc_{angle:g}_deg", "", f"{one['arc']:.5g}", "deg"),
                  ("sphere_at_rest", f"height_on_axis_{angle:g}_deg", "", f"{one['height']:.5g}", "mm")]
        if angle == ANGLES[0]:
            lines.append(("sphere_at_rest", f"covered_share_{angle:g}_deg", "", f"{one['share']:.5g}", "1"))
    for posture in POSTURES:
        one = found[f"eye_{posture}"]
        lines += [("eye_at_rest", f"covered_{part}_{posture}", "", f"{one[f'{part} {CODES[0]}']:.4g}", "%")
                  for part in PARTS]
        rows += [(code, posture, part, f"{one[f'{part} {code}']:.4g}", "%", "no" if code == CODES[2] else "yes")
                 for part in PARTS for code in CODES]
    for case, kind in (("sphere_at_rest", "sphere"), ("eye_at_rest", "eye")):
        seconds = sum(one["seconds"] for name, one in found.items() if name.startswith(kind))
        lines.append((case, "processor_time", "", f"{seconds:.4g}", "s"))
    for path, table in ((HERE / "entries" / "surface_evolver.csv", lines),
                        (HERE / "eye_at_rest" / "codes.csv", [COLUMNS, *rows])):
        with path.open("w", newline="") as file:
            csv.writer(file, lineterminator="\n").writerows(table)


def main() -> None:
    """Run the command; see the head of the file."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--keep", type=Path, required=True, help="folder for inputs, logs and what was found")
    parser.add_argument("--shape", choices=SHAPES, help="one shape (default: all that are missing, then the tables)")
    options = parser.parse_args()
    if shutil.which(judge.PROGRAM) is None:
        raise SystemExit(f"there is no program {judge.PROGRAM} (Debian: apt-get install evolver-nox)")
    found = {}
    for name in [options.shape] if options.shape else SHAPES:
        path = options.keep.resolve() / name / FOUND
        if not path.is_file():
            run, what = SHAPES[name]
            done = run(what, path.parent)
            path.write_text(json.dumps(done, indent=1) + "\n")
        found[name] = json.loads(path.read_text())
        print(name, found[name], flush=True)
    if not options.shape:
        write_entry(found)


if __name__ == "__main__":
    main()
