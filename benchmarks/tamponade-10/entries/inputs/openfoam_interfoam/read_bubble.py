"""Read the bubble of the case beside this file, and write its lines of an entry.

    python read_bubble.py CASE ENTRY.csv

CASE is a copy of this folder that interFoam has run. The contour at the volume fraction 0.5 tells the circularity.
"""
import csv
import re
import sys
from pathlib import Path

import numpy as np
from skimage.measure import find_contours


def values(path: Path, width: int) -> np.ndarray:
    """Return the values of the cells, (n,) or (n, 3), x running fastest."""
    text = path.read_text()
    count, body = re.search(r"internalField\s+nonuniform List<\w+>\s+(\d+)\s*\((.*?)\n\)\s*;", text, re.DOTALL).groups()
    found = np.array(body.replace("(", " ").replace(")", " ").split(), float).reshape(int(count), width)
    return found[:, 0] if width == 1 else found


def circularity(fraction: np.ndarray, cell: float) -> float:
    """Perimeter of the circle of the same area over the perimeter."""
    line = max(find_contours(fraction, 0.5), key=len) * cell
    x, y = line.T
    area = 0.5 * abs(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))
    return float(2.0 * np.sqrt(np.pi * area) / np.hypot(np.diff(x), np.diff(y)).sum())


def main() -> None:
    """Run; see the head of the file."""
    case, entry = Path(sys.argv[1]), Path(sys.argv[2])
    found, cells = [], None
    times = sorted((path.name for path in case.iterdir() if re.fullmatch(r"[\d.]+", path.name)), key=float)
    for folder in (case / name for name in times[1:]):
        fraction, velocity = values(folder / "alpha.bubble", 1), values(folder / "U", 3)
        cells = cells or round(np.sqrt(len(fraction) / 2))
        height = (np.arange(len(fraction)) // cells + 0.5) / cells
        weights = fraction / fraction.sum()
        found.append((float(folder.name), weights @ height, weights @ velocity[:, 1],
                      circularity(fraction.reshape(2 * cells, cells), 1.0 / cells)))
    time, height, speed, circular = np.array(found).T
    log = (case / "log.interFoam").read_text()
    spent = float(re.findall(r"ExecutionTime = ([\d.]+) s", log)[-1])
    with entry.open("w", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("case", "quantity", "time", "value", "unit"))
        writer.writerow(("rising_bubble", "smallest_circularity", "", f"{circular.min():.5g}", "1"))
        writer.writerow(("rising_bubble", "largest_speed", "", f"{speed.max():.5g}", "m/s"))
        writer.writerow(("rising_bubble", "height_of_center", f"{time[-1]:g}", f"{height[-1]:.5g}", "m"))
        writer.writerow(("rising_bubble", "processor_time", "", f"{spent:.4g}", "s"))


if __name__ == "__main__":
    main()
