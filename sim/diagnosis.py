"""What went bad in a run: which particle, in which part of which step.

A run looks for numbers that are not finite once per step, which costs nothing, but is too late to say where they came
from: a pressure solve spreads one of them over all particles at once. Steps are the same bit by bit when they are
repeated from a state before, so a run that went bad is repeated with a look after every part (``Solver.replay``).
"""
import numpy as np

from sim.accelerations import HOOKS, Accelerations
from sim.backend import data_oriented, ti


def described(solver, row: int) -> str:
    """A particle in words: number, liquid, place."""
    read = solver.particles.to_numpy
    place = ", ".join(f"{value:.4g}" for value in read("position")[row])
    return f"particle {read('id')[row]} ({solver.liquids[read('phase')[row]].name}, at ({place}) m)"


def bad_number(solver) -> tuple[str, int, int] | None:
    """Field with numbers that are not finite, the first row of it, and how many rows; None where all is well."""
    for field in solver.particles.declared.values():
        if (field.carried or field.name == "acceleration") and field.kind != "integer":
            values = solver.particles.to_numpy(field.name)
            rows = np.flatnonzero(~np.isfinite(values.reshape(len(values), -1)).all(axis=1))
            if len(rows):
                return field.name, int(rows[0]), len(rows)
    return None


class Watcher:
    """Looks at all particles after every part of a step, and remembers which part sped one up most.

    Parameters
    ----------
    solver : the solver whose steps are repeated.
    """

    def __init__(self, solver):
        self.solver = solver
        self.alone = {effect.name: EffectAlone(solver, effect) for effect in solver.effects
                      if any(effect in getattr(solver, f"{hook}_effects") for hook in HOOKS)}
        self.largest_gain, self.gain_in_words = 0.0, ""
        self.speed = self._speeds()

    def _speeds(self) -> np.ndarray:
        """Speeds by number of particle."""
        velocity = self.solver.particles.to_numpy("velocity").astype(float)
        order = np.argsort(self.solver.particles.to_numpy("id"))
        return np.linalg.norm(velocity, axis=1)[order]

    def look(self, part: str) -> str:
        """Return what is bad after a part of the step, in words; empty where nothing is."""
        found = bad_number(self.solver)
        if found:
            name, row, count = found
            return (f"{part} makes the {name.replace('_', ' ')} of {described(self.solver, row)} not finite, and that "
                    f"of {count - 1} more particles")
        speed = self._speeds()
        if len(speed) == len(self.speed):
            which = int(np.argmax(speed - self.speed))
            gain = speed[which] - self.speed[which]
            if gain > self.largest_gain:
                self.largest_gain = gain
                row = int(np.argsort(self.solver.particles.to_numpy("id"))[which])
                self.gain_in_words = (f"most speed was gained in step {self.solver.step_count}, in which {part} took "
                                      f"{described(self.solver, row)} from {self.speed[which]:.3g} to "
                                      f"{speed[which]:.3g} m/s")
        self.speed = speed
        return ""

    def look_at_accelerations(self) -> str:
        """The same of the acceleration that every effect gives by itself."""
        for name, alone in self.alone.items():
            alone.accelerate()
            values = self.solver.particles.to_numpy("acceleration")
            rows = np.flatnonzero(~np.isfinite(values).all(axis=1))
            if len(rows):
                return (f"the effect {name} gives {described(self.solver, int(rows[0]))} an acceleration that is not "
                        f"finite, and {len(rows) - 1} more particles")
        return ""


@data_oriented
class EffectAlone:
    """The acceleration of one effect."""

    def __init__(self, solver, effect):
        self.solver, self.accelerations = solver, Accelerations(solver, [effect])

    @ti.kernel
    def accelerate(self):
        for i in range(self.solver.count[None]):
            self.solver.acceleration[i] = self.accelerations.of(i)
