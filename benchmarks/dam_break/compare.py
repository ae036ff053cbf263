"""Time the dam in this project beside SPlisHSPlasH, run in turns.

    python benchmarks/dam_break/compare.py                      30 K and 91 K particles, one liquid and two
    python benchmarks/dam_break/compare.py --sizes 16 --turns 1    a short trial

The peer is installed into `.venv` beside this file on first use. Writes `results.csv` and the tables of `README.md`. A
comparison counts only on an otherwise idle machine: the peer's threads burn CPU time while they wait for each other.
"""
import argparse
import csv
import json
import os
import subprocess
import sys
import tempfile
import venv
from pathlib import Path
from statistics import median

from sizes import machine

FOLDER = Path(__file__).resolve().parent
ROOT = FOLDER.parents[1]
PEER = "pySPlisHSPlasH==2.19.0"
PEER_PYTHON = FOLDER / ".venv" / "bin" / "python"
OURS = ("dfsph",)
COLUMNS = ("program", "n", "liquids", "particles", "wall_particles", "turns", "wall_s_per_step",
           "least_wall_s_per_step", "cpu_s_per_step", "density_iterations", "divergence_iterations", "top_speed",
           "kinetic_energy", "front", "mean_compression", "largest_compression", "wall_ratio", "cpu_ratio", "machine")
LARGEST = ("mean_compression", "largest_compression")
CLOSE = {"top_speed": 0.1, "kinetic_energy": 0.03}  # relative difference up to which both have computed the same dam
BEGIN, END = "<!-- results -->", "<!-- end of results -->"


def install_peer() -> None:
    """Make the peer's environment if it is not there yet."""
    ready = FOLDER / ".venv" / "ready"
    if ready.is_file() and ready.read_text() == PEER:
        return
    print(f"installing {PEER} into {PEER_PYTHON.parents[1]}", flush=True)
    venv.create(FOLDER / ".venv", with_pip=True, clear=True)
    subprocess.run([PEER_PYTHON, "-m", "pip", "install", "-q", "--disable-pip-version-check", PEER], check=True)
    ready.write_text(PEER)


def run(program: str, n: int, liquids: int, steps: int, threads: int) -> dict:
    """Run one program once in a process of its own and return its result."""
    environment = os.environ | {"PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": str(threads)}
    with tempfile.TemporaryDirectory() as folder:
        if program == "peer":
            command = [PEER_PYTHON, FOLDER / "peer.py", folder, str(n), str(steps), str(liquids)]
        else:
            command = [sys.executable, FOLDER / "ours.py", program, folder, str(n), str(steps), str(liquids),
                       "--threads", str(threads)]
        done = subprocess.run(command, env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        path = Path(folder) / "result.json"
        if done.returncode or not path.is_file():
            sys.exit(f"error: {program} with n = {n} and liquids = {liquids} ended with code {done.returncode}:\n"
                     f"{done.stdout[-2000:]}")
        return json.loads(path.read_text())


def together(results: list[dict], turns: int) -> dict:
    """Return the median of several turns; of what a program got wrong, the worst."""
    joined = {"turns": turns}
    for name, first in results[0].items():
        values = [result[name] for result in results]
        joined[name] = first if isinstance(first, str) else max(values) if name in LARGEST else (
            min(values) if name.startswith("least") else median(values))
    return joined


def compare(cases: list[tuple[int, int]], schemes: list[str], steps: int, turns: int, threads: int) -> list[dict]:
    """Run peer and schemes in turns; return one row per program and case, with the peer's time over its own.

    A case is the particles along a side and the number of liquids.
    """
    rows = []
    for n, liquids in cases:
        results: dict[str, list[dict]] = {program: [] for program in ("peer", *schemes)}
        for turn in range(turns):
            for program in results:
                results[program].append(run(program, n, liquids, steps, threads))
                last = results[program][-1]
                print(f"n {n}, liquids {liquids}, turn {turn + 1}: {last['program']}: "
                      f"{last['wall_s_per_step']:.4f} s wall, "
                      f"{last['cpu_s_per_step']:.4f} s CPU per step, {last['density_iterations']:.1f} + "
                      f"{last['divergence_iterations']:.1f} iterations, top speed {last['top_speed']:.2f} m/s, mean "
                      f"compression {last['mean_compression']:.1e}", flush=True)
        peer = together(results["peer"], turns)
        for program in results:
            row = together(results[program], turns)
            row |= {"machine": machine(), "wall_ratio": peer["wall_s_per_step"] / row["wall_s_per_step"],
                    "cpu_ratio": peer["cpu_s_per_step"] / row["cpu_s_per_step"]}
            rows.append(row)
            _check(row, peer)
    return rows


def _check(row: dict, peer: dict) -> None:
    """Say where a program has not computed the same dam: its time then says nothing."""
    warning = f"warning: n {row['n']:.0f}, liquids {row['liquids']:.0f}: {row['program']}"
    for name, allowed in CLOSE.items():
        if abs(row[name] / peer[name] - 1.0) > allowed:
            print(f"{warning} has {name} {row[name]:.4g}, the peer {peer[name]:.4g}")
    if row["mean_compression"] > 1.5 * max(peer["mean_compression"], 1e-4):
        print(f"{warning} is compressed by {row['mean_compression']:.2e}, the peer by "
              f"{peer['mean_compression']:.2e}")


def write(rows: list[dict], about: str) -> None:
    """Write the table, and its short form into the README."""
    with (FOLDER / "results.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, extrasaction="ignore", lineterminator="\n")
        writer.writeheader()
        writer.writerows({name: f"{value:.6g}" if isinstance(value, float) else value for name, value in row.items()}
                         for row in rows)
    lines = ["| program | liquids | particles + wall | iterations | wall s/step | CPU s/step | wall ratio | CPU ratio "
             "| top speed | mean / largest compression |", "|---|---|---|---|---|---|---|---|---|---|"]
    lines += [f"| {row['program']} | {row['liquids']:.0f} | {row['particles']:.0f} + {row['wall_particles']:.0f} | "
              f"{row['density_iterations']:.1f} + {row['divergence_iterations']:.1f} | {row['wall_s_per_step']:.4f} | "
              f"{row['cpu_s_per_step']:.4f} | {row['wall_ratio']:.2f} | {row['cpu_ratio']:.2f} | "
              f"{row['top_speed']:.2f} m/s | {row['mean_compression']:.1e} / {row['largest_compression']:.1e} |"
              for row in rows]
    readme = FOLDER / "README.md"
    head, _, rest = readme.read_text().partition(BEGIN)
    tail = rest.partition(END)[2]
    readme.write_text(f"{head}{BEGIN}\n{about}\n\n" + "\n".join(lines) + f"\n{END}{tail}")


def main() -> None:
    """Command line."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--sizes", type=int, nargs="+", default=[31, 45], metavar="N",
                   help="particles along the side of the cube (default 31 45)")
    p.add_argument("--liquids", type=int, nargs="+", choices=(1, 2), default=[1, 2], metavar="NUMBER",
                   help="one liquid, or two with tension (default 1 2)")
    p.add_argument("--schemes", nargs="+", default=list(OURS), help=f"schemes to time (default {' '.join(OURS)})")
    p.add_argument("--steps", type=int, default=200, help="steps of 1 ms; those after 150 are timed (default 200)")
    p.add_argument("--turns", type=int, default=3, help="runs of every program, in turns (default 3)")
    p.add_argument("--threads", type=int, default=os.cpu_count(), help="threads of every program (default all)")
    p.add_argument("--dry", action="store_true", help="print only, leave results.csv and README.md as they are")
    arguments = p.parse_args()
    if arguments.steps < 1 or arguments.turns < 1 or min(arguments.sizes) < 4:
        p.error("steps and turns must be at least 1, sizes at least 4")
    install_peer()
    cases = [(n, liquids) for liquids in arguments.liquids for n in arguments.sizes]
    rows = compare(cases, arguments.schemes, arguments.steps, arguments.turns, arguments.threads)
    for row in rows:
        print(f"n {row['n']:.0f}, liquids {row['liquids']:.0f}: {row['program']}: {row['wall_ratio']:.2f} times as "
              f"fast by wall time, {row['cpu_ratio']:.2f} by CPU time")
    if not arguments.dry:
        write(rows, f"{arguments.turns} turns of {arguments.steps} steps, {arguments.threads} threads; {machine()}.")


if __name__ == "__main__":
    main()
