"""Stage: what every effect of a scene has cost: memory, kernels and time, as measured by the simulation.

Memory and kernels are those of one process; launches and times are added up over all segments. The time of the first
two steps of every segment, in which kernels are compiled, is left out.
"""
from collections.abc import Sequence
from pathlib import Path

from pipeline.base import page
from pipeline.base.cli import run, stage_parser
from pipeline.base.files import write_text
from pipeline.base.tables import csv_of
from pipeline.scenes.load import load_resolved
from pipeline.scenes.model import Scene
from pipeline.simulation.cost_files import read_costs

COLUMNS = {"part": "", "fields": "Taichi fields", "bytes": "memory of the fields", "kernels": "kernels compiled",
           "launches_per_step": "kernel launches per step", "cpu_seconds": "time of all cores, s",
           "seconds": "time by the clock, s", "cpu_share": "share of the time of all cores",
           "hooks": "what it adds to the loop of all effects, whose time counts for the solver"}


def add_up(segments: Sequence[dict]) -> list[dict]:
    """Return one row per part, with the keys of ``COLUMNS``, from what the segments of a scene have cost."""
    steps = max(sum(segment["steps"] for segment in segments), 1)
    rows: dict[str, dict] = {}
    for segment in segments:
        for part in segment["parts"]:
            row = rows.setdefault(part["part"], dict.fromkeys(
                ("fields", "bytes", "kernels", "launches", "seconds", "cpu_seconds"), 0) | {"hooks": ()})
            for name in ("fields", "bytes", "kernels"):
                row[name] = max(row[name], part[name])
            for name in ("launches", "seconds", "cpu_seconds"):
                row[name] += part[name]
            row["hooks"] = part["hooks"]
    total = sum(row["cpu_seconds"] for row in rows.values()) or 1.0
    return [{"part": name, **{key: row[key] for key in ("fields", "bytes", "kernels")},
             "launches_per_step": row["launches"] / steps, "cpu_seconds": row["cpu_seconds"],
             "seconds": row["seconds"], "cpu_share": row["cpu_seconds"] / total,
             "hooks": " ".join(row["hooks"])} for name, row in rows.items()]


def absent(scene: Scene) -> list[str]:
    """Names of the effects that a scene does not call for."""
    from sim.effects import REGISTRY

    return [name for name in REGISTRY if name not in scene.effects]


def page_of(scene: Scene, rows: Sequence[dict], segments: Sequence[dict], path: Path | None = None) -> str:
    """Return the table as a page, to be written to a file."""
    last = segments[-1]
    heads = ("part", "fields", "MiB", "kernels", "launches per step", "ms per step, all cores", "share",
             "in the loop of all effects")
    timed = max(sum(segment["timed_steps"] for segment in segments), 1)
    cells = [(row["part"], row["fields"], f"{row['bytes'] / 2**20:.3f}", row["kernels"],
              f"{row['launches_per_step']:.1f}", f"{1e3 * row['cpu_seconds'] / timed:.3f}",
              f"{100 * row['cpu_share']:.1f} %", row["hooks"].replace("_", " ")) for row in rows]
    title = scene.title or scene.name
    return page.page(f"{title}: effects", [page.filled(
        __file__, scene=scene, last=last, steps=sum(segment["steps"] for segment in segments),
        segments=len(segments), devices=list(dict.fromkeys(segment["device"] for segment in segments)),
        owned=f"{sum(row['bytes'] for row in rows) / 2**20:.2f}", allocated=f"{last['allocated_bytes'] / 2**20:.2f}",
        heads=heads, cells=cells, absent=absent(scene))], heading=f"{title}: what its effects cost", path=path)


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line: ``python -m pipeline.effect_costs scene.json COSTS.json... --page FILE.html --table FILE.csv``."""
    columns = "\n".join(f"  {name:18} {meaning}" for name, meaning in COLUMNS.items() if meaning)
    parser = stage_parser("effect_costs", __doc__, epilog=f"columns of the table:\n{columns}")
    parser.add_argument("scene", type=Path, metavar="scene.json", help="resolved scene")
    parser.add_argument("costs", type=Path, nargs="+", metavar="COSTS.json", help="what its segments have cost")
    parser.add_argument("--page", type=Path, required=True, metavar="FILE.html", help="page to write")
    parser.add_argument("--table", type=Path, required=True, metavar="FILE.csv", help="table to write")
    options = parser.parse_args(arguments)
    scene, segments = load_resolved(options.scene), [read_costs(path) for path in options.costs]
    rows = add_up(segments)
    write_text(options.table, csv_of(tuple(COLUMNS), rows))
    write_text(options.page, page_of(scene, rows, segments, options.page))


if __name__ == "__main__":
    run(main)
