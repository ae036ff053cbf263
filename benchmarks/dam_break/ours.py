"""The dam in this project."""
import argparse
from pathlib import Path

import dam
import numpy as np

from pipeline.cavity.shapes import shape_arrays
from sim import schemes
from sim.backend.runtime import initialize
from sim.effects import REGISTRY
from sim.settings import Liquid, Numerics, Settings
from sim.solver import Solver

BOX_CENTER = np.array([0.0, 1.0, 0.0])  # m; the arrays of a box are centered on the origin
# Parameters of the schemes that mean what the peer's mean.
TOLERANCES = {"dfsph": {"density_error": dam.DENSITY_ERROR, "divergence_error": dam.DIVERGENCE_ERROR,
                        "minimum_iterations": dam.LEAST_ITERATIONS}}


def build(scheme: str, n: int, time_step: float = dam.TIME_STEP, liquids: int = 1) -> Solver:
    """Return the solver with the cube of so many liquids in the left half of the box, and steps of `time_step`, s."""
    spacing = 1.0 / n
    arrays = shape_arrays("box", (2.0, 2.0, 1.0), spacing, dimension=3, wall_layers=2)
    position = arrays["fluid_position"]
    cube = (position[:, 0] < 0.0) & (position[:, 1] < 0.0)
    parameters = schemes.REGISTRY[scheme].Parameters(**TOLERANCES.get(scheme, {}))
    effects = [REGISTRY["gravity"].Parameters(magnitude=dam.GRAVITY),
               REGISTRY["viscosity"].Parameters(wall="free_slip")]
    if dam.TENSION[liquids]:
        effects += [REGISTRY[name].Parameters(gamma=dam.TENSION[liquids]) for name in ("cohesion", "curvature")]
    settings = Settings(
        dimension=3, liquids=tuple(Liquid(name, density, density * dam.KINEMATIC_VISCOSITY) for name, density in zip(
            ("water", "oil"), dam.DENSITIES[liquids], strict=False)), closed=False, effects=tuple(effects),
        scheme=parameters,
        numerics=Numerics(particle_spacing=spacing, scheme=scheme, kernel="cubic_spline", support_ratio=2.0,
                          precision="f32", time_step=time_step, maximum_time_step=time_step, courant_number=1.0,
                          pressure_tolerance=dam.DENSITY_ERROR))
    phase = (position[cube, 1] + BOX_CENTER[1] > dam.lower_layers(n) * spacing) & (liquids > 1)
    names = ("wall_position", "wall_volume", "sdf_values", "sdf_origin", "sdf_cell", "cavity_volume")
    return Solver(settings, fluid_position=position[cube], fluid_volume=arrays["fluid_volume"][cube],
                  fluid_phase=phase.astype(int), wall_depth=arrays["wall_distance"],
                  **{name: arrays[name] for name in names})


def run(scheme: str, n: int, steps: int, liquids: int) -> dict:
    """Run the dam and return its result."""
    solver = build(scheme, n, liquids=liquids)
    watch, iterations = dam.Stopwatch(), []
    for _ in range(steps):
        watch.start()
        solver.step(dam.TIME_STEP)
        watch.stop()
        statistics = solver.statistics
        iterations.append((statistics.get("density_iterations", statistics["pressure_iterations"]),
                           statistics.get("divergence_iterations", 0)))
    state = {name: solver.particles.to_numpy(name).astype(float) for name in ("position", "velocity")}
    state["position"] += BOX_CENTER
    return dam.result(f"this project, {scheme}", n, watch, iterations, liquid=solver.particles.to_numpy("phase"),
                      liquids=liquids, walls=int(solver.walls.count), simulated=solver.time, **state)


def main() -> None:
    """Command line: ``ours.py SCHEME FOLDER N STEPS LIQUIDS``; writes ``result.json`` into the folder."""
    p = argparse.ArgumentParser(description=__doc__)
    p.add_argument("scheme", choices=sorted(schemes.REGISTRY))
    p.add_argument("folder", type=Path)
    p.add_argument("n", type=int)
    p.add_argument("steps", type=int)
    p.add_argument("liquids", type=int, choices=sorted(dam.DENSITIES))
    p.add_argument("--threads", type=int, default=0)
    arguments = p.parse_args()
    initialize("f32", arguments.threads)
    dam.write(arguments.folder / "result.json", run(arguments.scheme, arguments.n, arguments.steps, arguments.liquids))


if __name__ == "__main__":
    main()
