"""Solvers in small cavities, shared by the tests of the solver.

Run as a script it advances one of the same cases in a process of its own, with another precision or number of threads.
"""
import functools
import gc
import math
import sys

import numpy as np

from pipeline.cavity.shapes import shape_arrays
from sim.backend.runtime import has_fields, present_start, restart
from sim.effects import REGISTRY
from sim.neighbor_rows import HEAD_ROOM
from sim.packing import pack
from sim.settings import Liquid, Numerics, Settings
from sim.solver import Solver

SPACING = 1e-3
RADIUS = 10e-3
TANK_END = 0.02     # s
FILM_END = 0.3      # s; ends of its columns change places from 0.08 s on
INJECTION_END = 0.12  # s; from the droplet of some 8 % the fill is reached near 0.09 s
AQUEOUS = Liquid("aqueous", 1005.0, 1e-3)
OIL = Liquid("oil", 970.0, 1.0)


def parameters(name: str, **values):
    """Return the parameters of an effect."""
    return REGISTRY[name].Parameters(**values)


@functools.cache
def cavity(kind: str, size, dimension: int = 2, spacing: float = SPACING, periodic=()) -> dict[str, np.ndarray]:
    """Return the arrays of a cavity, packed where it is round."""
    arrays = shape_arrays(kind, size, spacing, dimension=dimension, periodic=periodic)
    if kind != "box":
        arrays["fluid_position"], _ = pack(arrays["fluid_position"], arrays["fluid_volume"], arrays["wall_position"],
                                           arrays["wall_volume"], spacing, 2.5, 150)
    return arrays


def build(arrays, *, effects=(), phase=None, liquids=(AQUEOUS, OIL), precision="f64", filled=None, velocity=None,
          scheme_parameters=None, continued=False, head_room=HEAD_ROOM, **numerics) -> Solver:
    """Return a solver in a cavity; functions of the positions give phase, velocity and, with a free surface, liquid.

    By default the upper half is oil, everything is at rest and the cavity is full; `filled` marks what is liquid.
    Taichi starts anew where no solver is left, so that kernels that were compiled before are found again.
    """
    if has_fields() and not any_solver():
        restart()
    position, volume = arrays["fluid_position"], arrays["fluid_volume"]
    if filled is not None:
        keep = filled(position)
        position, volume = position[keep], volume[keep]
    phase = (position[:, 1] > 0.0) if phase is None else phase(position)
    settings = Settings(
        dimension=position.shape[1], liquids=tuple(liquids), effects=tuple(effects), closed=filled is None,
        scheme=scheme_parameters, continued=continued, periods=tuple(arrays.get("periods", ())),
        numerics=Numerics(particle_spacing=float(arrays["particle_spacing"]), precision=precision, **numerics))
    return Solver(settings, fluid_position=position, fluid_volume=volume,
                  fluid_velocity=None if velocity is None else velocity(position),
                  fluid_phase=np.asarray(phase).astype(int), wall_position=arrays["wall_position"],
                  wall_volume=arrays["wall_volume"], wall_depth=arrays["wall_distance"],
                  sdf_values=arrays["sdf_values"], sdf_origin=arrays["sdf_origin"], sdf_cell=arrays["sdf_cell"],
                  cavity_volume=arrays["cavity_volume"], head_room=head_room)


def any_solver() -> bool:
    """Return whether a solver is in use, be it by an object that holds it."""
    for key in [key for key, (start, _) in _shared.items() if start is not present_start()]:
        del _shared[key]
    gc.collect()
    return any(isinstance(one, Solver) for one in gc.get_referrers(Solver))


_shared: dict = {}


def shared(built, *arguments):
    """Return what `built` builds; tests share it until Taichi starts anew, which makes it void."""
    key = (built, *arguments)
    if key not in _shared or _shared[key][0] is not present_start():
        made = built(*arguments)
        _shared[key] = present_start(), made
    return _shared[key][1]


def anew(built, *arguments, **changes):
    """Return what `built` builds once Taichi has started anew: a second solver like the first is not compiled again.

    Solvers built before are void.
    """
    restart()
    return built(*arguments, **changes)


def run(solver: Solver, until: float, watch=lambda solver: None) -> list:
    """Advance to a time; return what `watch` gives after every step."""
    return [watch(solver) for _ in solver.advance(until)]


def run_in_steps(solver: Solver, step: float, until: float, watch=lambda solver: None) -> list:
    """Advance to a time in steps of at most `step`; return what `watch` gives after every one."""
    seen = []
    while until - solver.time > 1e-6 * step:
        solver.step(step, until)
        seen.append(watch(solver))
    return seen


def read(solver: Solver, *names: str) -> list[np.ndarray]:
    """Return fields of the particles in double precision."""
    return [solver.particles.to_numpy(name).astype(float) for name in names]


def momentum(solver: Solver) -> np.ndarray:
    """Return the momentum of the liquid, kg m/s."""
    mass, velocity = read(solver, "mass", "velocity")
    return mass @ velocity


def root_mean_square_speed(solver: Solver) -> float:
    """Return the root mean square of the speeds, m/s."""
    (velocity,) = read(solver, "velocity")
    return float(np.sqrt((velocity**2).sum(axis=1).mean()))


def tank(arrays, precision: str) -> Solver:
    """Return a tank that turns over: oil left, aqueous right, with tension and diffusion."""
    effects = (parameters("gravity"), parameters("viscosity_implicit"),
               parameters("interface_tension", coefficient=0.04, contact_angle=math.radians(60.0)),
               parameters("diffusion", coefficient=1e-6))
    return build(arrays, effects=effects, phase=lambda x: x[:, 0] < 0.0, precision=precision)


def film(arrays, precision: str) -> Solver:
    """Return a circle of oil over a pool of aqueous, with a layer of aqueous one particle thick on its sides."""
    effects = (parameters("gravity"), parameters("viscosity_implicit"), parameters("wall_film"),
               parameters("interface_tension", coefficient=0.04, contact_angle=math.radians(25.0)))
    def phase(x):
        in_film = (np.linalg.norm(x, axis=1) > RADIUS - SPACING) & (x[:, 1] < 0.6 * RADIUS)
        return (x[:, 1] > -0.7 * RADIUS) & ~in_film
    return build(arrays, effects=effects, phase=phase, precision=precision)


def injected(arrays, precision: str, more=(), **changes) -> Solver:
    """Return a cavity full of aqueous into which oil flows, with more effects."""
    volume = float(arrays["cavity_volume"])
    values = {"liquid": "oil", "drained_liquid": "aqueous", "flow": 2.0 * volume, "fill": 0.25,
              "cannula": (0.0, 4e-3, 0.0), "drain": (0.0, -9e-3, 0.0), "ramp": 0.01} | changes
    effects = (parameters("injection", **values), parameters("viscosity_implicit"), *more)
    return build(arrays, effects=effects, phase=lambda x: np.zeros(len(x)), precision=precision,
                 maximum_time_step=1e-3)


def watched(solver) -> dict[str, np.ndarray]:
    """Advance past the end of the flow; return the volumes and bounds after every step."""
    start = {"cavity": np.array(solver.cavity_volume)}

    def measure(solver):
        phase = solver.particles.to_numpy("phase")
        volume, position, compression = read(solver, "volume", "position", "compression_rate")
        return {"time": solver.time, "aqueous": math.fsum(volume[phase == 0]), "oil": math.fsum(volume[phase == 1]),
                "radius": np.linalg.norm(position, axis=1).max(), "smallest": volume.min() / solver.rest_volume,
                "largest": volume.max() / solver.rest_volume, "compression_minimum": compression.min(),
                "compression_maximum": compression.max(), "compression_low": np.percentile(compression, 2),
                "compression_high": np.percentile(compression, 98), "count": len(volume),
                "ids": len(set(solver.particles.to_numpy("id").tolist())),
                "speed": np.linalg.norm(read(solver, "velocity")[0], axis=1).max()}

    steps = run(solver, INJECTION_END, measure)
    return start | {name: np.array([step[name] for step in steps]) for name in steps[0]}


def part(arrays, name: str) -> dict[str, np.ndarray]:
    """Return the arrays whose names begin with `name` and a point, without that."""
    return {key.removeprefix(f"{name}."): values for key, values in arrays.items() if key.startswith(f"{name}.")}


def main(precision: str, threads: str, source: str, target: str, case: str) -> None:
    """Advance a case from the cavity in one file and write its results into another."""
    from sim.backend.runtime import initialize
    initialize(precision, int(threads))
    from helpers.kernel_samples import sample_kernels
    arrays = dict(np.load(source))
    results = {}
    if case == "tank":
        solver = tank(arrays, precision)
        run(solver, 0.5 * TANK_END)
        run(solver, TANK_END)
        results |= {f"tank.{name}": values for name, values in solver.state().items()}
    if case == "film":  # with a restart in between, by a solver that knows nothing but the state
        solver = film(arrays, precision)
        run(solver, 0.5 * FILM_END)
        middle = solver.state()
        solver = anew(film, arrays, precision)
        solver.restore(middle)
        run(solver, FILM_END)
        results |= {f"film.{name}": values for name, values in solver.state().items()}
    if case == "injection":
        results |= {f"injection.{name}": values for name, values in watched(injected(arrays, precision)).items()}
    if case == "kernels":
        results |= {f"kernels.{name}": values for name, values in sample_kernels().items()}
    np.savez(target, **results)


if __name__ == "__main__":
    main(*sys.argv[1:])
