"""Write `docs/benchmarks.md` and `docs/tamponade_10.md` from the tables that the benchmarks have left beside them.

    python benchmarks/page.py           write the pages
    python benchmarks/page.py --check   exit code 1 where one is not that of the tables
"""
import argparse
import csv
import importlib.util
import json
import shutil
import sys
from pathlib import Path

from pipeline.base.markdown import settle, table

FOLDER = Path(__file__).resolve().parent
PAGE = FOLDER.parent / "docs" / "benchmarks.md"
PICTURE = PAGE.parent / "images" / "benchmark_sizes.png"
TEN, ENTRIES = FOLDER / "tamponade-10", FOLDER / "tamponade-10" / "entries"
TEN_PAGE = PAGE.parent / "tamponade_10.md"
GIB = 2**30


def rows(name: str) -> list[dict[str, str]]:
    """Read a table."""
    with (FOLDER / name).open(newline="") as file:
        return list(csv.DictReader(file))


def peer() -> str:
    """The dam beside SPlisHSPlasH."""
    body = [(row["program"], "one" if row["liquids"] == "1" else "two, with tension",
             f"{float(row['particles']):,.0f}", f"{1e3 * float(row['wall_s_per_step']):.1f}",
             f"{1e3 * float(row['cpu_s_per_step']):.1f}", f"{float(row['wall_ratio']):.2f}",
             f"{float(row['cpu_ratio']):.2f}", f"{float(row['density_iterations']):.1f}",
             f"{float(row['mean_compression']):.1e}") for row in rows("dam_break/results.csv")]
    return table(("program", "liquids", "particles", "ms on the clock per step", "ms of all cores",
                  "times as fast as the peer", "the same by all cores", "density iterations", "mean compression"), body)


def sizes() -> str:
    """Time and memory per particle."""
    body = [(row["scheme"], f"{float(row['particles']):,.0f}", f"{1e3 * float(row['wall_s_per_step']):.0f}",
             f"{float(row['wall_us_per_particle_step']):.2f}",
             f"{100.0 * float(row['spread']):.0f} %" if int(row["turns"]) > 1 else "one turn",
             f"{float(row['pressure_iterations']):.1f}", f"{float(row['field_bytes_per_particle']):.0f}",
             f"{float(row['peak_bytes']) / GIB:.2f}") for row in rows("dam_break/sizes.csv")]
    return table(("scheme", "particles", "ms on the clock per step", "us per particle and step", "spread of the turns",
                  "iterations", "bytes of fields per particle", "GiB of the process at most"), body)


def paper_scenes() -> str:
    """The scenes of the silicone-oil paper in two dimensions."""
    parts = ("pressure", "position correction", "neighbors")
    body = [(f"`{row['scene']}`", f"{float(row['particles']):,.0f}", f"{float(row['steps']):,.0f}",
             f"{float(row['pressure_iterations']):.1f}",
             f"{float(row['wall_s']) / 60.0 / float(row['simulated_s']):.2f}", row["paper_min_per_s"],
             *(f"{100.0 * float(row[part]) / float(row['wall_s']):.0f} %" for part in parts))
            for row in rows("paper_scenes.csv")]
    return table(("scene", "particles", "steps", "pressure iterations per step", "minutes per simulated second",
                  "minutes of the paper, on a GPU", *parts), body)


def backends() -> str:
    """The solver on the libraries that compile its kernels."""
    body = [({"dam": "dam of 8,000 particles", "eye": "`tiny`, an eye of 633 particles"}[row["case"]], row["library"],
             row["cold_start_cpu_s"], row["warm_start_cpu_s"], row["step_cpu_ms"], row["turns"],
             "the same" if " " not in row["state_sha256"] else "others") for row in rows("backends.csv")]
    return table(("case", "library", "s until all kernels are compiled", "s until they are loaded", "ms per step",
                  "turns", "bits of every turn"), body)


def page() -> str:
    """The whole page."""
    machine = (FOLDER / "dam_break" / "machine.txt").read_text().strip()
    return f"""# Benchmarks

Made by `python benchmarks/page.py` from the tables in `benchmarks/`. Machines are virtual, and twice as fast on some
days as on others: compare within a table only.

## Dam break beside SPlisHSPlasH

`python benchmarks/dam_break/compare.py`; what is alike and what is not:
[benchmarks/dam_break](../benchmarks/dam_break). Steps from 150 on are timed; medians of turns. Machine:
{rows("dam_break/results.csv")[0]["machine"]}.

{peer()}

## Size

`python benchmarks/dam_break/sizes.py`: the same dam from 5,000 particles to a million, steps that shrink with the
spacing, 40 steps after the first 20. Medians of turns. Machine, here and below: {machine}.

![Time per particle and step](images/{PICTURE.name})

{sizes()}

## The paper's scenes in two dimensions

`python benchmarks/paper_scenes.py`: two blocks and a drop of ink at the size of Song et al. (Table I), all
3 s of them, in one turn. The paper ran them on an NVIDIA RTX 2080 SUPER. The last columns are shares of the time.

{paper_scenes()}

## Taichi and its forks

`python benchmarks/backends.py`: the solver on every library that can compile its kernels
([dependencies](dependencies.md)), in turns, each in a process of its own with one thread. Seconds of the processor;
starts include the first 10 steps, in which kernels are compiled or loaded; medians of 40 further steps.

{backends()}
"""


def scorer():
    """Return `tamponade-10/score.py` as a module."""
    specification = importlib.util.spec_from_file_location("tamponade_10_score", TEN / "score.py")
    module = importlib.util.module_from_spec(specification)
    sys.modules[specification.name] = module  # dataclasses ask for it
    specification.loader.exec_module(module)
    return module


def ten_page() -> str:
    """The scores of all entries of tamponade-10."""
    score = scorer()
    references = score.read_references()
    results = [score.score(path, references) for path in sorted(ENTRIES.glob("*.csv"))]
    about = json.loads((ENTRIES / "entries.json").read_text(encoding="utf-8"))
    words = {"processor_time": "", "wall_time": " by the clock"}
    costs = [[case, *(", ".join(f"{value:.3g} s{words[kind]}" for kind, value in result.costs.get(case, {}).items())
                      for result in results)] for case in references]
    costs = [line for line in costs if any(line[1:])]
    off = [(result.name, row.case, row.reference.name, f"{row.value:.4g}", f"{row.reference.value:.4g}",
            f"{row.error / row.reference.tolerance:.1f}", row.reference.unit)
           for result in results for row in result.rows if not row.holds]
    errors = [(case, *(f"{max(row.error / row.reference.tolerance for row in result.of(case)):.2f}"
                       if result.of(case) else "" for result in results)) for case in references]
    names = [result.name for result in results]
    return f"""# tamponade-10

Made by `python benchmarks/page.py` from the entries in [benchmarks/tamponade-10](../benchmarks/tamponade-10/README.md),
ten cases that any code for two liquids in an eye can enter. A line holds if it is within the tolerance of its
reference. A case counts by the share of its lines that hold; a dash marks a case that is not entered.

{score.summary(results, references)}

## How far off

The largest error of a case, over what is allowed: below 1 all lines hold.

{table(("case", *names), errors)}

## What does not hold

{table(("entry", "case", "line", "value", "reference", "error / allowed", "unit"), off)}

In this project the film on a plate is one particle thick. Wall and oil hold it a third as much as a film of that
thickness, so that it drains [too fast](methods/wall_film.md#what-differs-and-why); and it slides as a whole, where a
real film thins and its last third stays for long. The film that a front leaves is a fraction of a particle, which
particles cannot show.

The oil of `eye_at_rest` starts level and creeps, so that after the 3 s of draft the lower half is not at rest; the
scene of that name starts in the shape of least energy and keeps [more of it](results/eye.md#eyes-at-rest). References
differ as well: here it is the mean of two codes, there another minimizer.

## What it took

Processor time, in seconds.

{table(("case", *names), costs)}

## Who entered

{table(("entry", "code", "machine", "remark"), [(name, *about[name].values()) for name in names])}
"""


def main() -> None:
    """Command line."""
    p = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    p.add_argument("--check", action="store_true", help="compare only")
    check = p.parse_args().check
    if code := settle({PAGE: page(), TEN_PAGE: ten_page()}, check, "python benchmarks/page.py"):
        sys.exit(code)
    if not check:
        shutil.copy(FOLDER / "dam_break" / "sizes.png", PICTURE)


if __name__ == "__main__":
    main()
