"""Whether the particles of a scene fit into the memory of this computer, asked before any of it is allocated."""
import math
import os
from pathlib import Path

from sim.memory import needed_bytes
from sim.neighbor_rows import HEAD_ROOM
from sim.settings import Settings

FILLING = 120.0  # bytes per node of the grid of the signed distance while a cavity is filled
# bytes per cell of the grid on which surfaces are found: sharp ones look at cells near the interface only.
SURFACE = {"sharp": 7.0, "flying_edges": 110.0, "marching_cubes": 110.0}
NODES = 2.0  # nodes of that grid along a particle spacing
CGROUPS = Path("/sys/fs/cgroup")


def memory_of_computer() -> float:
    """Return the memory, bytes, that a process may have: all of the computer, or what its control groups allow."""
    limits = [float(os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE"))]
    try:
        groups = [line.split(":", 2)[1:] for line in Path("/proc/self/cgroup").read_text().splitlines()]
    except OSError:
        groups = []
    for controllers, path in groups:  # version 2 has no names of controllers
        if controllers in ("", "memory"):
            top, name = (CGROUPS / "memory", "memory.limit_in_bytes") if controllers else (CGROUPS, "memory.max")
            folder = top / path.lstrip("/")
            limits += [_number(one / name) for one in (folder, *folder.parents) if one.is_relative_to(top)]
    return min(limits)


def _number(path: Path) -> float:
    try:
        return float(path.read_text())  # "max" where there is no limit
    except (OSError, ValueError):
        return math.inf


def too_large(settings: Settings, volume: float, box: float | None = None, particles: int | None = None,
              head_room: float = HEAD_ROOM) -> str:
    """Return why a scene does not fit into memory, after the words "particle_spacing"; empty where it does.

    Parameters
    ----------
    volume : of liquid, m^3 (in two dimensions m^2). box : of the grid around it.
    particles : number of liquid particles, where it is known; else it follows from the volume.
    head_room : of the solver.
    """
    dimension, spacing = settings.dimension, settings.numerics.particle_spacing
    have = memory_of_computer()

    def spacings(size: float, width: float) -> float:
        return size / math.prod([width] * dimension)

    def needed(width: float, count: float) -> float:
        nodes = box and spacings(box, width / NODES)
        return max(needed_bytes(settings, count, nodes=nodes, head_room=head_room), FILLING * (nodes or 0.0))

    count = spacings(volume, spacing) if particles is None else particles
    need = needed(spacing, count)
    if need <= have:
        return ""
    fits, left = spacing, count
    while needed(fits, left) > have and left > 1.0:
        fits *= 1.01
        left = count * (spacing / fits) ** dimension
    digits = 10.0 ** (math.floor(math.log10(fits)) - 1)
    return (f"is {1e3 * spacing:g} mm, which makes {count:.2g} particles that need {_in_words(need)}, but must be at "
            f"least {1e3 * digits * math.ceil(fits / digits):.3g} mm for the {_in_words(have)} of this computer")


def too_fine(cell_ratio: float, method: str, box: float) -> str:
    """Return why the grid of the surfaces does not fit into memory, after the word "cell_ratio"; empty where it does.

    Parameters
    ----------
    method : ``output.contour``. box : around the cavity, in cubed particle spacings.
    """
    have, cells = memory_of_computer(), box / cell_ratio**3
    need = SURFACE[method] * cells
    if need <= have:
        return ""
    fits = math.ceil(100.0 * cell_ratio * math.cbrt(need / have)) / 100.0
    return (f"is {cell_ratio:g}, which makes {cells:.2g} cells that need {_in_words(need)}, but must be at least "
            f"{fits:g} for the {_in_words(have)} of this computer")


def _in_words(size: float) -> str:
    unit = max(0, min(4, math.floor(math.log(size, 1024.0)) - 2))
    return f"{size / 1024.0 ** (unit + 2):.3g} {('MiB', 'GiB', 'TiB', 'PiB', 'EiB')[unit]}"
