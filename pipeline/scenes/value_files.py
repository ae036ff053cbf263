"""Files that a scene names in place of the values of a parameter (``sim.parameters.parameter``, `file`).

Equations: docs/methods/gravity.md.
"""
import csv
import math
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pipeline.base.errors import UserError
from pipeline.base.words import printable

MOST_LINES, MOST_BYTES = 10_000, 5_000_000
ANGLES, GRAVITY = ("pitch", "roll", "yaw"), ("gravity_x", "gravity_y", "gravity_z")
UNITS = {"time": {"s": 1.0, "min": 60.0, "h": 3600.0},
         **{name: {"deg": math.pi / 180.0, "rad": 1.0} for name in ANGLES},
         **{name: {"1": 1.0, "g": 1.0, "m/s2": 1.0 / 9.80665} for name in GRAVITY}}
LENGTH_ERROR = 0.05             # of a direction of gravity
LARGEST_TURN = math.radians(170.0)  # from a line to the next: beyond, the way of the turn is not told
GAP, TURN_IN_GAP = 10.0, math.radians(5.0)  # a gap is a step so many times the median one, in which the head turns
COLUMNS = ("time [s], [min] or [h], and either pitch [deg] and roll [deg] (yaw changes nothing) or gravity_x, "
           "gravity_y and gravity_z, each in [1], [g] or [m/s2]")


def head_orientation(path: Path) -> list[list[float]]:
    """Read the orientation of a head over time from a CSV file.

    The head is that of a patient who first looks ahead: yaw turns it to a side, pitch then raises the face (90 deg: on
    the back, -90 deg: face down), roll then lowers the right ear (90 deg: on the right side). Gravity is its direction
    in the head: x to the patient's left, y superior, z anterior; it points down, an accelerometer at rest shows the
    opposite.

    Returns
    -------
    list : of lines: time in s, and the direction of gravity in the head, a unit vector.

    Raises
    ------
    UserError : with a clause for what is wrong: columns, units, numbers, order, gaps, lengths.
    """
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise UserError(f"it has {size} bytes, but at most {MOST_BYTES} can be read; leave out some lines")
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.reader(file)
            lines = [(reader.line_num, line) for line in reader if any(cell.strip() for cell in line)]
    except (UnicodeDecodeError, csv.Error):
        raise UserError("it is no CSV file in UTF-8: a header and lines of numbers between commas") from None
    if len(lines) < 2:
        raise UserError(f"it has no lines of numbers below a header of {COLUMNS}")
    if len(lines) - 1 > MOST_LINES:
        raise UserError(f"it has {len(lines) - 1} lines, but at most {MOST_LINES} can be read; leave out some")
    columns = _columns(lines[0][1])
    table = {name: [] for name in columns}
    for number, line in lines[1:]:
        if len(line) != len(columns):
            raise UserError(f"its line {number} has {len(line)} cells, but must have {len(columns)} as the header has")
        for (name, factor), cell in zip(columns.items(), line, strict=True):
            table[name].append(factor * _number(name, cell, number))
    time = np.array(table["time"])
    numbers = [number for number, _ in lines[1:]]
    down = _from_gravity(table, numbers) if GRAVITY[0] in table else _from_angles(table)
    _check(time, down, numbers)
    return [[float(moment), *map(float, one)] for moment, one in zip(time, down, strict=True)]


READERS: dict[str, Callable[[Path], list[list[float]]]] = {"head_orientation": head_orientation}


def _columns(header: list[str]) -> dict[str, float]:
    """Name and factor to SI of every column."""
    columns = {}
    for cell in header:
        match = re.fullmatch(r"\s*(\w+)\s*(?:\[\s*(.*?)\s*\])?\s*", cell)
        name, unit = (match[1], match[2]) if match else (cell, None)
        if name not in UNITS or name in columns:
            said = "twice" if name in columns else "that is not known"
            raise UserError(f'it has the column "{printable(cell.strip())}" {said}; allowed are {COLUMNS}')
        if unit not in UNITS[name]:
            units = " or ".join(f"{name} [{one}]" for one in UNITS[name])
            raise UserError(f'its column "{printable(cell.strip())}" has {"no" if unit is None else "an unknown"} '
                            f"unit, but must be {units}")
        columns[name] = UNITS[name][unit]
    given = set(columns) - {"yaw"}
    if given not in ({"time", "pitch", "roll"}, {"time", *GRAVITY}) or ("yaw" in columns and GRAVITY[0] in columns):
        raise UserError(f"its columns are {', '.join(columns)}, but must be {COLUMNS}")
    return columns


def _number(name: str, cell: str, line: int) -> float:
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        said = f'is "{printable(cell.strip())}"' if cell.strip() else "is empty"
        raise UserError(f"its line {line} has a gap: {name} {said}, but must be a number in every line; leave out the "
                        "line, or fill it in")
    return value


def _from_gravity(table: dict[str, list[float]], numbers: list[int]) -> np.ndarray:
    down = np.array([table[name] for name in GRAVITY]).T
    length = np.linalg.norm(down, axis=1)
    wrong = np.flatnonzero(np.abs(length - 1.0) > LENGTH_ERROR)
    if len(wrong):
        raise UserError(f"its line {numbers[wrong[0]]} has a gravity of {length[wrong[0]]:.3g} g, but its length must "
                        f"be 1 g (within {100 * LENGTH_ERROR:g} %), for a head that rests or turns slowly")
    return down / length[:, None]


def down_in_head(pitch: np.ndarray, roll: np.ndarray) -> np.ndarray:
    """Directions of gravity (k, 3) in a head whose face was raised, and whose right ear was then lowered, rad. (G8)"""
    return np.stack([-np.cos(pitch) * np.sin(roll), -np.cos(pitch) * np.cos(roll), -np.sin(pitch)], axis=-1)


def _from_angles(table: dict[str, list[float]]) -> np.ndarray:
    return down_in_head(np.array(table["pitch"]), np.array(table["roll"]))


def _check(time: np.ndarray, down: np.ndarray, numbers: list[int]) -> None:
    """Refuse what no head does; ``numbers`` are those of the lines in the file."""
    if time[0] != 0.0:
        raise UserError(f"its first line is at {time[0]:g} s, but must be at 0, when the scene begins")
    step = np.diff(time)
    if (step <= 0.0).any():
        line = int(np.argmax(step <= 0.0))
        raise UserError(f"its line {numbers[line + 1]} is at {time[line + 1]:g} s, but must be later than the line "
                        f"before, at {time[line]:g} s")
    turn = np.arccos(np.clip((down[1:] * down[:-1]).sum(axis=1), -1.0, 1.0))
    if (turn > LARGEST_TURN).any():
        line = int(np.argmax(turn > LARGEST_TURN))
        raise UserError(f"its line {numbers[line + 1]} is turned by {math.degrees(turn[line]):.0f} deg from the line "
                        f"before, but at most {math.degrees(LARGEST_TURN):g} deg are allowed; add a line on the way")
    gap = (step > GAP * np.median(step)) & (turn > TURN_IN_GAP) if len(step) else np.zeros(0, bool)
    if gap.any():
        line = int(np.argmax(gap))
        raise UserError(f"it has a gap of {step[line]:g} s before its line {numbers[line + 1]}, in which the head "
                        f"turns by {math.degrees(turn[line]):.0f} deg, but at most {GAP * np.median(step):g} s (10 "
                        "steps) are allowed then; add a line where the turn begins")
