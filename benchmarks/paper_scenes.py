"""Minutes per simulated second of the two-dimensional scenes whose cost the silicone-oil paper tells [song, table I].

    python benchmarks/paper_scenes.py                  at the paper's size, about three quarters of an hour
    python benchmarks/paper_scenes.py --level draft    a short trial, which writes nothing

The whole scene is run, since it is the splashes that cost; pictures are left out. Writes `paper_scenes.csv`, of which
`benchmarks/page.py` makes a page. It counts only on an otherwise idle machine.
"""
import argparse
import csv
import os
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "benchmarks" / "paper_scenes.csv"
PAPER_MINUTES = {"coupling_2d": 2.1, "ink_drop": 55.9}  # per simulated second, NVIDIA RTX 2080 SUPER
PARTS = ("pressure", "position correction", "neighbors")
COLUMNS = ("scene", "level", "particles", "simulated_s", "steps", "pressure_iterations", "wall_s", *PARTS,
           "paper_min_per_s")


def measure(name: str, level: str, threads: int) -> dict:
    """Run a scene in this process and return what it took, the parts in seconds by the clock."""
    from tqdm import tqdm

    from pipeline.cavity.container import container_arrays
    from pipeline.scenes.load import load_scene
    from pipeline.simulation.solver_setup import build_solver
    from sim.backend.runtime import initialize

    scene = load_scene(ROOT / "config" / "scenes" / f"{name}.yaml", level)
    initialize(scene.numerics.precision, threads)
    solver = build_solver(scene, container_arrays(scene))
    steps = iterations = 0
    begin = time.perf_counter()
    with tqdm(total=scene.output.duration, unit="s", desc=name) as bar:
        for _ in solver.advance(scene.output.duration):
            steps += 1
            iterations += solver.statistics["pressure_iterations"]
            bar.update(solver.time - bar.n)
    return {"scene": name, "level": level, "particles": int(solver.count[None]), "simulated_s": solver.time,
            "steps": steps, "pressure_iterations": iterations / steps, "wall_s": time.perf_counter() - begin,
            "paper_min_per_s": PAPER_MINUTES[name]} | {part: solver.seconds[part] for part in PARTS}


def main() -> None:
    """Command line."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--level", default="fine", help="level of accuracy (default fine, the paper's size)")
    p.add_argument("--threads", type=int, default=os.cpu_count(), help="threads (default all)")
    arguments = p.parse_args()
    sys.path.insert(0, str(ROOT))
    rows = []
    for name in PAPER_MINUTES:
        row = measure(name, arguments.level, arguments.threads)
        print(f"{name}: {row['particles']} particles, {row['steps']} steps, {row['pressure_iterations']:.1f} "
              f"iterations, {row['wall_s'] / 60 / row['simulated_s']:.2f} minutes per simulated second")
        rows.append({column: f"{value:.5g}" if isinstance(value, float) else value for column, value in row.items()})
    if arguments.level != "fine":
        return
    temporary = TABLE.with_suffix(".new")
    with temporary.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)
    temporary.replace(TABLE)


if __name__ == "__main__":
    main()
