"""The solver on Taichi and on its forks, in turns: seconds until all kernels are there, of a step, and the bits.

    python benchmarks/backends.py                     every library that is installed here; writes backends.csv
    python benchmarks/backends.py --turns 1 quadrants beside Taichi

Every turn is a process of its own with one thread. The first of a library finds no compiled kernels, the others those
of the first. Two cases: the dam of the other benchmarks with 8,000 particles, whose steps are long, and the scene
`tiny`, an eye of 633 particles with all effects of a tamponade, whose steps are launches of kernels.
"""
import argparse
import csv
import hashlib
import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from statistics import median

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE.parent), str(HERE / "dam_break")]

from pipeline.base.usage import run_stage  # noqa: E402
from sim.backend.choice import DEFAULT, LIBRARIES, VARIABLE, backend_version  # noqa: E402

SIDE, TIME_STEP = 20, 1e-3  # particles along the cube of the dam, and s
WARM_UP, STEPS = 10, 40     # steps in which kernels are compiled, and those that are timed
CASES = ("dam", "eye")
COLUMNS = ("case", "library", "cold_start_cpu_s", "warm_start_cpu_s", "step_cpu_ms", "turns", "state_sha256")


def solver_of(case: str, folder: Path):
    """Return the solver of a case."""
    from sim.backend.runtime import initialize

    initialize("f32", 1, "cpu", keep_to_core=True)
    if case == "dam":
        from ours import build

        return build("dfsph", SIDE, TIME_STEP)
    from pipeline.cavity.initial_state import load_initial
    from pipeline.scenes.load import load_resolved
    from pipeline.simulation.solver_setup import build_solver

    return build_solver(load_resolved(folder / "scene.json"), load_initial(folder / "initial.npz"))


def measure(case: str, folder: Path) -> dict:
    """Run a case in this process."""
    solver = solver_of(case, folder)
    for _ in range(WARM_UP):
        solver.step(TIME_STEP)
    started = time.process_time()
    for _ in range(STEPS):
        solver.step(TIME_STEP)
    step = (time.process_time() - started) / STEPS
    state = solver.state()
    digest = hashlib.sha256(b"".join(state[f"particles.{name}"].tobytes() for name in ("position", "velocity")))
    return {"version": backend_version(), "start": started, "step": step, "state": digest.hexdigest()[:16]}


def measured(case: str, library: str, folder: Path) -> dict:
    """Measure in a process of its own, with compiled kernels in the folder of the library."""
    cache = LIBRARIES[library].variable("offline_cache_file_path")
    done = subprocess.run([sys.executable, __file__, "--measure", case, "--folder", folder], check=True,
                          stdout=subprocess.PIPE, text=True,
                          env=os.environ | {VARIABLE: library, cache: str(folder / library)})
    return json.loads(done.stdout.splitlines()[-1])


def row(case: str, found: list[dict]) -> dict[str, object]:
    """Return the row of a library from all its turns."""
    states = {one["state"] for one in found}
    return {"case": case, "library": found[0]["version"], "cold_start_cpu_s": round(found[0]["start"], 1),
            "warm_start_cpu_s": round(median(one["start"] for one in found[1:] or found), 1),
            "step_cpu_ms": round(1e3 * median(one["step"] for one in found), 2), "turns": len(found),
            "state_sha256": " ".join(sorted(states))}


def main() -> None:
    """Command line."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("libraries", nargs="*", choices=[[], *LIBRARIES], default=[],
                   help="beside the default (default: all that are installed)")
    p.add_argument("--turns", type=int, default=3, help="turns with kernels that are there (default %(default)s)")
    p.add_argument("--output", type=Path, default=HERE / "backends.csv")
    p.add_argument("--measure", choices=CASES, help=argparse.SUPPRESS)
    p.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    arguments = p.parse_args()
    if arguments.measure:
        print(json.dumps(measure(arguments.measure, arguments.folder)))
        return
    names = arguments.libraries or [one.name for one in LIBRARIES.values() if one.is_installed()]
    names = list(dict.fromkeys((DEFAULT, *names)))
    with tempfile.TemporaryDirectory(prefix="backends_") as name:
        folder = Path(name)
        resolved, mesh = folder / "scene.json", folder / "eye.vtp"
        run_stage("scene", "tiny", "--accuracy", "draft", "--output", resolved)
        run_stage("eye", resolved, "--output", mesh, "--report", folder / "eye.json")
        run_stage("voxelize", resolved, mesh, "--output", folder / "initial.npz", "--report", folder / "voxelize.json")
        rows = []
        for case in CASES:
            found: dict[str, list[dict]] = {library: [] for library in names}
            for _ in range(1 + arguments.turns):
                for library, turns in found.items():
                    turns.append(measured(case, library, folder))
                    print(case, library, turns[-1], flush=True)
            rows += [row(case, turns) for turns in found.values()]
    with arguments.output.open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS)
        writer.writeheader()
        writer.writerows(rows)


if __name__ == "__main__":
    main()
