"""A solver that is built anew with more room where it is full."""
from collections.abc import Callable
from pathlib import Path

import numpy as np

from pipeline.base.errors import UserError

MORE_ROOM, MOST_ROOM = 1.5, 12.0  # growth of the room for neighbors where it is full; over that at rest, at most


class Average:
    """Statistics of the steps between two frames: means, and largest values of what ends in `_maximum`."""

    def __init__(self):
        self.values: dict[str, list[float]] = {}

    def add(self, statistics: dict[str, float]) -> None:
        """Take in the statistics of one step."""
        for name, value in statistics.items():
            self.values.setdefault(name, []).append(value)

    def summary(self) -> dict[str, float]:
        """Return one number for every statistic."""
        return {name: float(max(v) if name.endswith("_maximum") else np.mean(v)) for name, v in self.values.items()}


class Runner:
    """A solver that is built anew with more room where it is full. What it computes does not depend on the room.

    Parameters
    ----------
    solver : the present one; None builds it.
    rebuild : ``rebuild(head_room)`` returns the solver at t = 0; without it a full solver ends the run.
    too_large : ``too_large(head_room)`` returns why that does not fit into memory, empty where it does.

    Raises
    ------
    OutOfRoom
        The start does not fit into the largest room.
    """

    def __init__(self, solver=None, rebuild: Callable | None = None, too_large: Callable[[float], str] = lambda _: ""):
        from sim.errors import OutOfRoom
        from sim.neighbor_rows import HEAD_ROOM

        self.solver, self.rebuild, self.too_large = solver, rebuild, too_large
        self.head_room = getattr(solver, "head_room", HEAD_ROOM)
        if solver is None:
            try:
                self.solver = rebuild(self.head_room)
            except OutOfRoom as error:
                self.widen(None, error)

    def widen(self, state: dict | None, error: Exception) -> None:
        """Build the solver with more room, in a given state or at t = 0; what Taichi held before is void.

        Raises
        ------
        OutOfRoom
            `error` again, where nothing rebuilds, more room does not fit into memory, or liquid is compressed so far
            that it is no remedy.
        """
        from sim.backend.runtime import restart
        from sim.errors import OutOfRoom

        kept = {name: getattr(self.solver, name) for name in ("seconds", "cpu_seconds") if self.solver}
        while True:
            self.head_room *= MORE_ROOM
            if self.rebuild is None or self.head_room > MOST_ROOM:
                raise error
            if reason := self.too_large(self.head_room):
                raise OutOfRoom(f"{error}, and there is no memory for more: numerics.particle_spacing {reason}")
            print(f"{error}; going on from {float(state['time']) if state else 0.0:.4g} s with more room", flush=True)
            self.solver = None
            restart()
            try:
                self.solver = self.rebuild(self.head_room)
                vars(self.solver).update(kept)
                if state:
                    self.solver.restore(state)
            except OutOfRoom as again:
                error = again
            else:
                return

    def restore(self, state: dict) -> None:
        """Take up a state, with more room where it needs that."""
        from sim.errors import OutOfRoom

        try:
            self.solver.restore(state)
        except OutOfRoom as error:
            self.widen(state, error)

    def advance(self, good: dict, until: float, after_step: Callable) -> dict[str, float]:
        """Advance to the time `until`, s, and return the statistics of the steps (`Average`).

        Parameters
        ----------
        good : state at the start, which the steps are repeated from with more room where the solver runs out of it.
        after_step : called with the solver and the step taken, s, after every step.
        """
        from sim.errors import OutOfRoom

        while True:
            average = Average()
            try:
                for dt in self.solver.advance(until):
                    average.add(self.solver.statistics)
                    after_step(self.solver, dt)
                self.solver.check_finite()
            except OutOfRoom as error:
                self.widen(good, error)
            else:
                return average.summary()


def restore(runner: Runner, state: dict, path: Path, begins: bool) -> None:
    """Take up the state of a checkpoint, if it can be one of this scene.

    Parameters
    ----------
    begins : the end of another scene is the start of this one: its time is zero, and what is planned has not begun.

    Raises
    ------
    UserError
        When the file holds no state of such a solver.
    """
    if reason := unlike(state, runner.solver.state()):
        raise UserError(f"{path}: is no checkpoint that this scene can start from ({reason}); it must have the same "
                        "eye, particle spacing and liquids")
    if begins:
        planned = tuple(f"{effect.name}." for effect in runner.solver.effects if effect.planned)
        state = {key: value for key, value in state.items() if not key.startswith(planned)}
        state |= {"time": 0.0, "step_count": 0}
    try:
        runner.restore(state)
    except (KeyError, ValueError, OverflowError) as error:
        raise UserError(f"{path}: is no checkpoint that this scene can start from ({error}); it must have the same "
                        "eye, particle spacing and liquids") from error


def unlike(state: dict, sample: dict) -> str:
    """Return what no run can have left in a state, empty where all is well.

    Parameters
    ----------
    sample : a state of the solver that is to take it up, with any number of particles.
    """
    particles = "particles."
    count = len(np.atleast_1d(state.get("particles.id", ())))
    for name in sorted(state.keys() & sample.keys()):
        found, expected = np.asarray(state[name]), np.asarray(sample[name])
        shape = ((count,) if name.startswith(particles) else expected.shape[:1]) + expected.shape[1:]
        if found.shape != shape or (found.dtype.kind in "fiub") != (expected.dtype.kind in "fiub"):
            return f"{name} is {found.dtype} of the shape {found.shape}, but must have the shape {shape}"
        if found.ndim and not (finite := np.isfinite(found)).all():
            row = int(np.argmin(finite.reshape(len(found), -1).all(axis=1)))
            what = f"particle {state['particles.id'][row]}" if name.startswith(particles) else f"place {row}"
            return f"{name} is not finite at {what}"
    if "particles.position" in state and "particles.id" in state:
        for name, fault in (("id", "have one number"), ("position", "are at one place")):
            _, first, times = np.unique(state[particles + name], axis=0, return_index=True, return_counts=True)
            if len(first) < count:
                one = state[particles + name][first[times > 1][0]]
                same = np.flatnonzero((state[particles + name] == one).reshape(count, -1).all(axis=1))[:2]
                return f"particles {' and '.join(str(state['particles.id'][row]) for row in same)} {fault}"
    return ""
