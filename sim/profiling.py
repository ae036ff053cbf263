"""What the parts of a solver cost: fields and bytes allocated, kernels compiled and launched, time.

The parts are the particles, the neighbors, the solver with the loop that all effects share, the scheme, and every
effect. Whose a field is follows from who declares it or holds it; whose a kernel is, from the object that it was
compiled for, or where it sorts a field, from the field. All is read off afterwards: while the solver runs nothing is
counted but launches, one addition each, and only if asked for.
"""
import dataclasses
import weakref
from collections.abc import Mapping
from types import MappingProxyType

from sim.accelerations import HOOKS
from sim.backend.accounting import compiled_kernels, is_field, size_of

PARTICLES, NEIGHBORS, SOLVER = "particles", "neighbors", "solver"
# Rows of `solver.seconds` that belong to no effect and not to the scheme.
SHARED_TIMES = {"neighbors": NEIGHBORS, "accelerations": SOLVER, "time step": SOLVER}


@dataclasses.dataclass
class Cost:
    """What one part costs.

    Attributes
    ----------
    fields, bytes : fields that it holds, and their memory; a field belongs to the first part that declares it.
    kernels, launches : kernels compiled for it, and how often they were started.
    seconds, cpu_seconds : time in it, by the clock and of all cores.
    hooks : what it adds to the loop of all effects, whose time counts for the solver.
    """

    part: str
    fields: int = 0
    bytes: int = 0
    kernels: int = 0
    launches: int = 0
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    hooks: tuple[str, ...] = ()


class Owners:
    """Which part of a solver every field and every object of it belongs to.

    Parameters
    ----------
    solver : its parts, in the order in which they claim what they hold: a field that two effects share is the first's.
    """

    def __init__(self, solver):
        self.fields: dict[int, tuple[str, object]] = {}
        self.objects: dict[int, str] = {}
        self.parts = [PARTICLES, NEIGHBORS, SOLVER, solver.scheme.name, *(effect.name for effect in solver.effects)]
        particles = solver.particles
        self.objects[id(particles)] = PARTICLES
        declarers = [*((solver.scheme.name, f) for f in solver.scheme.fields),
                     *((effect.name, f) for effect in solver.effects for f in effect.fields)]
        own = {f.name for _, f in declarers}
        for part, field in [*((PARTICLES, f) for f in particles.declared.values() if f.name not in own), *declarers]:
            self._claim(part, particles.arrays[field.name])
            if field.carried:
                self._claim(part, particles.buffer_of[field.name])
        roots = {id(effect): effect.name for effect in solver.effects} | {
            id(solver.scheme): solver.scheme.name, id(solver): SOLVER}
        self.objects |= roots
        self._claim(PARTICLES, *vars(particles).values())
        self._claim(NEIGHBORS, solver.search, solver.walls, solver.distance, solver.kernel)
        for one in (solver, solver.scheme, *solver.effects):
            self._claim(roots[id(one)], *vars(one).values())

    def _claim(self, part: str, *values) -> None:
        """Give a part everything that can be reached from values and belongs to none yet."""
        waiting = list(values)
        while waiting:
            value = waiting.pop()
            if is_field(value):
                self.fields.setdefault(id(value), (part, value))
            elif isinstance(value, list | tuple):
                waiting += value
            elif isinstance(value, dict):
                waiting += value.values()
            elif type(value).__module__.startswith("sim.") and id(value) not in self.objects:
                self.objects[id(value)] = part
                waiting += getattr(value, "__dict__", {}).values()

    def of_kernel(self, features: tuple) -> str | None:
        """Part that a kernel was compiled for, from what its template arguments were; None for one of nobody here."""
        owner = features[0]() if features and isinstance(features[0], weakref.ref) else None
        part = self.objects.get(id(owner))
        if part == PARTICLES:  # one that copies a field
            part = next((self.fields[id(one)][0] for one in features[1:] if id(one) in self.fields), part)
        return part


def times(solver) -> dict[str, tuple[float, float]]:
    """Time by the clock and of all cores in every timed row of a solver so far, s."""
    return {name: (seconds, solver.cpu_seconds[name]) for name, seconds in solver.seconds.items()}


def costs(solver, launches: Mapping = MappingProxyType({}), before: Mapping = MappingProxyType({})) -> list[Cost]:
    """Return what every part of a solver has cost so far.

    Parameters
    ----------
    launches : what `sim.backend.launching.counted_launches` has counted.
    before : what :func:`times` gave earlier, to leave out the first steps, in which kernels are compiled.
    """
    owners = Owners(solver)
    found = {part: Cost(part) for part in owners.parts}
    for part, field in owners.fields.values():
        found[part].fields += 1
        found[part].bytes += size_of(field)
    for _, handle, features in compiled_kernels():
        part = owners.of_kernel(features)
        if part is not None:
            found[part].kernels += 1
            found[part].launches += launches.get(handle, 0)
    for name, (seconds, cpu_seconds) in times(solver).items():
        cost = found[SHARED_TIMES.get(name, name if name in found else solver.scheme.name)]
        cost.seconds += seconds - before.get(name, (0.0, 0.0))[0]
        cost.cpu_seconds += cpu_seconds - before.get(name, (0.0, 0.0))[1]
    for effect in solver.effects:
        found[effect.name].hooks = tuple(
            hook for hook in HOOKS if effect in getattr(solver, f"{hook}_effects"))
    return list(found.values())
