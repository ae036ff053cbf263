"""Whether the particles of a scene fit into the memory of this computer, asked before any of it is allocated."""
import math

from pipeline.base.memory import in_words, memory_of_computer
from sim.memory import needed_bytes
from sim.neighbor_rows import HEAD_ROOM
from sim.settings import Settings

FOR_DIGESTS = "no influence"
FILLING = 120.0  # bytes per node of the grid of the signed distance while a cavity is filled
# bytes per cell of the grid on which surfaces are found: sharp ones look at cells near the interface only.
SURFACE = {"sharp": 7.0, "flying_edges": 110.0, "marching_cubes": 110.0}
NODES = 2.0  # nodes of that grid along a particle spacing


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
    return (f"is {1e3 * spacing:g} mm, which makes {count:.2g} particles that need {in_words(need)}, but must be at "
            f"least {1e3 * digits * math.ceil(fits / digits):.3g} mm for the {in_words(have)} of this computer")


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
    return (f"is {cell_ratio:g}, which makes {cells:.2g} cells that need {in_words(need)}, but must be at least "
            f"{fits:g} for the {in_words(have)} of this computer")
