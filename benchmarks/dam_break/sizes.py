"""Seconds per particle and step, and memory per particle, of the dam from 5,000 particles to a million.

    python benchmarks/dam_break/sizes.py                    all sizes, three turns
    python benchmarks/dam_break/sizes.py --sizes 17 31 --turns 1    a short trial
    python benchmarks/dam_break/sizes.py --device cuda --sizes 17 45 67 100 171    on an NVIDIA GPU, to 5 million

Steps shrink with the spacing, as they do in a scene, so that every size computes the same number of spacings of fall.
Writes `sizes.csv`, `sizes.png` and `machine.txt`; `benchmarks/page.py` makes a page of them. Of a GPU it writes
`sizes_<device>.csv` and no more. It counts only on an otherwise idle machine.
"""
import argparse
import csv
import os
import platform
import resource
import subprocess
import sys
import time
from pathlib import Path
from statistics import median

FOLDER = Path(__file__).resolve().parent
ROOT = FOLDER.parents[1]
SIZES = (17, 22, 31, 45, 67, 100)  # particles along the side of the cube
SCHEMES = ("dfsph",)
COURANT_STEP = 0.031  # s, times the spacing in m: 1 ms at 31 particles, as in the comparison
WARM_UP, STEPS = 20, 40  # steps before the timed ones, and these
COLUMNS = ("scheme", "n", "particles", "wall_particles", "turns", "wall_s_per_step", "spread", "cpu_s_per_step",
           "wall_us_per_particle_step", "cpu_us_per_particle_step", "pressure_iterations", "field_bytes_per_particle",
           "peak_bytes")


def measure(scheme: str, n: int, threads: int, device: str) -> dict[str, float]:
    """Run the dam with n^3 particles in this process and return what it took."""
    from ours import build

    from sim.backend.accounting import allocated
    from sim.backend.runtime import initialize, sync

    initialize("f32", threads, device)
    solver = build(scheme, n, COURANT_STEP / n)
    wall, cpu, iterations = [], [], []
    for _ in range(WARM_UP + STEPS):
        begin, cpu_begin = time.perf_counter(), time.process_time()
        solver.step(COURANT_STEP / n)
        sync()  # a GPU goes on after the step has returned
        wall.append(time.perf_counter() - begin)
        cpu.append(time.process_time() - cpu_begin)
        iterations.append(solver.statistics["pressure_iterations"])
    particles = int(solver.count[None])
    return {"particles": particles, "wall_particles": int(solver.walls.count),
            "wall_s_per_step": median(wall[WARM_UP:]), "cpu_s_per_step": sum(cpu[WARM_UP:]) / STEPS,
            "pressure_iterations": sum(iterations[WARM_UP:]) / STEPS,
            "field_bytes_per_particle": allocated() / particles,
            "peak_bytes": 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss}


def run(scheme: str, n: int, threads: int, device: str) -> dict[str, float]:
    """Measure in a process of its own."""
    command = [sys.executable, __file__, "--measure", scheme, str(n), "--threads", str(threads), "--device", device]
    done = subprocess.run(command, env=os.environ | {"PYTHONPATH": str(ROOT)}, stdout=subprocess.PIPE, text=True)
    if done.returncode:
        sys.exit(f"error: {scheme} with n = {n} ended with code {done.returncode}")
    return {name: float(value) for name, value in (line.split() for line in done.stdout.splitlines())}


def together(scheme: str, n: int, turns: list[dict[str, float]]) -> dict:
    """Return the medians of several turns, and by how much their wall times differ."""
    row = {name: median(turn[name] for turn in turns) for name in turns[0]}
    wall = [turn["wall_s_per_step"] for turn in turns]
    return row | {"scheme": scheme, "n": n, "turns": len(turns), "spread": (max(wall) - min(wall)) / median(wall),
                  "wall_us_per_particle_step": 1e6 * row["wall_s_per_step"] / row["particles"],
                  "cpu_us_per_particle_step": 1e6 * row["cpu_s_per_step"] / row["particles"]}


def write(rows: list[dict], threads: int, device: str) -> None:
    """Write the table and, of the CPU, figure and machine."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    with (FOLDER / ("sizes.csv" if device == "cpu" else f"sizes_{device}.csv")).open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        writer.writerows({name: f"{value:.6g}" if isinstance(value, float) else value for name, value in row.items()}
                         for row in rows)
    if device != "cpu":
        return
    figure, axes = plt.subplots(figsize=(6.4, 4.0), layout="constrained")
    for scheme in dict.fromkeys(row["scheme"] for row in rows):
        own = [row for row in rows if row["scheme"] == scheme]
        axes.plot([row["particles"] for row in own], [row["wall_us_per_particle_step"] for row in own], "o-",
                  label=scheme)
    axes.set(xscale="log", xlabel="particles", ylabel="microseconds per particle and step", ylim=(0.0, None),
             title=f"Dam break, {threads} threads")
    axes.legend()
    figure.savefig(FOLDER / "sizes.png", dpi=110)
    (FOLDER / "machine.txt").write_text(machine() + "\n")


def machine() -> str:
    """The computer in words."""
    info = Path("/proc/cpuinfo")
    models = {line.partition(":")[2].strip() for line in (info.read_text().splitlines() if info.is_file() else ())
              if line.startswith("model name")}
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 2**30
    return f"{', '.join(sorted(models)) or platform.processor()}, {os.cpu_count()} cores, {memory:.0f} GiB"


def main() -> None:
    """Command line."""
    from sim.backend.devices import DEVICES, lack

    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--sizes", type=int, nargs="+", default=SIZES, metavar="N",
                   help="particles along the side of the cube (default %(default)s)")
    p.add_argument("--schemes", nargs="+", default=SCHEMES, help="schemes to time (default %(default)s)")
    p.add_argument("--turns", type=int, default=3, help="runs of every size, in turns (default 3)")
    p.add_argument("--threads", type=int, default=os.cpu_count(), help="threads (default all)")
    p.add_argument("--device", choices=DEVICES, default="cpu", help="device of the solver (default cpu)")
    p.add_argument("--measure", nargs=2, metavar=("SCHEME", "N"), help="one run in this process, printed")
    arguments = p.parse_args()
    if arguments.measure:
        for name, value in measure(arguments.measure[0], int(arguments.measure[1]), arguments.threads,
                                   arguments.device).items():
            print(name, value)
        return
    if arguments.turns < 1 or min(arguments.sizes) < 4:
        p.error("turns must be at least 1, sizes at least 4")
    if reason := lack(arguments.device):
        p.error(f"--device is {arguments.device}, but {reason}")
    pairs = [(scheme, n) for scheme in arguments.schemes for n in arguments.sizes]
    results: dict[tuple[str, int], list[dict]] = {pair: [] for pair in pairs}
    for turn in range(arguments.turns):
        for scheme, n in pairs:
            last = run(scheme, n, arguments.threads, arguments.device)
            results[scheme, n].append(last)
            print(f"turn {turn + 1}, {scheme}, {last['particles']:.0f} particles: {last['wall_s_per_step']:.4f} s wall "
                  f"per step, {1e6 * last['wall_s_per_step'] / last['particles']:.3f} us per particle, "
                  f"{last['pressure_iterations']:.1f} iterations, {last['peak_bytes'] / 2**30:.2f} GiB", flush=True)
    write([together(*pair, turns) for pair, turns in results.items()], arguments.threads, arguments.device)


if __name__ == "__main__":
    main()
