"""The numbers of docs/scale.md, from measured sizes: `python benchmarks/scale.py`, `--write` puts them into the page.

Nothing is simulated. What was measured is in benchmarks/dam_break/sizes.csv and docs/results; all else follows from it.
"""
import argparse
import csv
import re
from pathlib import Path

import numpy as np

from pipeline.scenes.load import load_scene
from sim.memory import needed_bytes
from sim.neighbor_rows import HEAD_ROOM, entries_at_rest

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs" / "scale.md"
SIZES = ROOT / "benchmarks" / "dam_break" / "sizes.csv"
BEGIN, END = "<!-- numbers of benchmarks/scale.py -->\n", "<!-- end of the numbers -->"

EYE = 5.05e-6                   # m3, volume of the default cavity
EYE_STEP = 18.8 * 60 / (3074 * 78_979)   # s per particle and step, tamponade at standard (docs/results/costs.md)
TENSION, DENSITIES, VISCOSITIES = 0.04, 1005.0 + 970.0, 0.7e-3 + 1.0    # of tamponade: N/m, kg/m3, Pa s
DURATION = 10.0                 # s, of the scene tamponade
MACHINE = 27e9                  # B/s, a triad on the two cores that the times were measured on
GPU, GPU_MEMORY = 4.8e12, 141e9  # B/s and B of an NVIDIA H200 by its data sheet
SHARE = 0.5                     # of that bandwidth, for loops that gather; assumed
FRAME = 71                      # B per particle of a frame file
COUNTS = (1_000_000, 10_000_000, 100_000_000)


def measured() -> dict[str, np.ndarray]:
    """Return the columns of the measured sizes."""
    with SIZES.open() as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0] if name != "scheme"}


def growth(values: np.ndarray, particles: np.ndarray) -> np.ndarray:
    """Fit a + b N^(-1/3): what belongs to every particle, and to the walls, whose share falls as the surface does."""
    return np.linalg.lstsq(np.stack([np.ones(len(particles)), particles ** (-1 / 3)], axis=1), values, rcond=None)[0]


def step_limit(spacing: float) -> float:
    """Return the longest time step that interface tension allows, s: (A3) of docs/methods/time_step.md."""
    capillary = np.sqrt(DENSITIES * spacing**3 / (4.0 * np.pi * TENSION))
    viscous = 0.05 * 8.0 * VISCOSITIES * spacing / TENSION
    return float(0.5 * (viscous + np.sqrt(viscous**2 + 4.0 * capillary**2)))


def row(cells) -> str:
    """Return a line of a table."""
    return f"| {' | '.join(map(str, cells))} |\n"


def tables() -> str:
    """Return the numbers of the page."""
    sizes = measured()
    particles, per_particle = sizes["particles"], sizes["field_bytes_per_particle"]
    a, b = growth(per_particle, particles)
    worst = np.abs((a + b * particles ** (-1 / 3)) / per_particle - 1.0).max()
    large = particles > 50_000
    rate = sizes["wall_us_per_particle_step"][large]
    text = (f"Memory per particle, of the dam: {a:.0f} B + {b / 1e3:.1f} kB / N^(1/3), within {100 * worst:.0f} % of "
            f"the six sizes measured from 4,913 to a million particles. Time per particle and step: "
            f"{rate.min():.2f} to {rate.max():.2f} us from {particles[large].min():,.0f} particles on, without a "
            "trend.\n\n")
    text += row(("what", *(f"{count:,} particles" for count in COUNTS))) + row(["---"] * (1 + len(COUNTS)))
    scene = load_scene(ROOT / "config" / "scenes" / "tamponade.yaml", "standard")
    spacing = [(EYE / count) ** (1 / 3) for count in COUNTS]
    memory = [needed_bytes(scene.settings(), count) for count in COUNTS]
    steps = [DURATION / step_limit(dx) for dx in spacing]
    cpu = [EYE_STEP * count for count in COUNTS]
    gpu = [one * MACHINE / (SHARE * GPU) for one in cpu]
    entries = HEAD_ROOM * entries_at_rest(1, np.zeros(0), scene.numerics.support_ratio, 1.0, 3)[0]
    text += row(("particle spacing in the default eye, um", *(f"{1e6 * dx:.0f}" for dx in spacing)))
    text += row(("memory of the dam, by the growth above, GB", *(f"{count * (a + b * count ** (-1 / 3)) / 1e9:.1f}"
                                                                 for count in COUNTS)))
    text += row(("memory of `tamponade`, as the project foretells it, GB", *(f"{one / 1e9:.1f}" for one in memory)))
    text += row(("cards of 141 GB that hold it", *(f"{np.ceil(one / GPU_MEMORY):.0f}" for one in memory)))
    text += row(("entries of the neighbor rows, of 2,147 million that can be counted, millions",
                 *(f"{entries * count / 1e6:,.0f}" for count in COUNTS)))
    what = "steps of `tamponade`, 10 s, at the limit of the interface tension"
    text += row((what, *(f"{one:,.0f}" for one in steps)))
    text += row(("time of a step on the two measured cores, s", *(f"{one:.3g}" for one in cpu)))
    text += row(("time of a step on one H200, derived, s", *(f"{one:.2g}" for one in gpu)))
    text += row(("`tamponade` on the two cores", *(span(one * many) for one, many in zip(cpu, steps, strict=True))))
    text += row(("`tamponade` on one H200, derived, were there memory", *(
        span(one * many) for one, many in zip(gpu, steps, strict=True))))
    text += row(("one frame file, GB", *(f"{count * FRAME / 1e9:.2g}" for count in COUNTS)))
    return text


def span(seconds: float) -> str:
    """Return a time as people read it."""
    for unit, size in (("years", 365 * 86400.0), ("days", 86400.0), ("h", 3600.0)):
        if seconds > 2 * size:
            return f"{seconds / size:.{0 if seconds > 10 * size else 1}f} {unit}"
    return f"{seconds / 60.0:.{0 if seconds > 6000.0 else 1}f} min"


def main() -> None:
    """Print the numbers, or write them into the page."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--write", action="store_true", help="write them into docs/scale.md")
    if parser.parse_args().write:
        page = PAGE.read_text()
        PAGE.write_text(re.sub(f"{BEGIN}.*?{END}", lambda _: f"{BEGIN}{tables()}{END}", page, flags=re.DOTALL))
    else:
        print(tables(), end="")


if __name__ == "__main__":
    main()
