"""The dam in SPlisHSPlasH: runs in an environment of its own, which ``compare.py`` makes.

DFSPH with a cubic spline of support 2 dx, Akinci walls sampled once, 1.15 dx from the first layer of liquid.
"""
import argparse
import ctypes
import json
from pathlib import Path

import dam
import numpy as np

# The package crashes at import beside a system's own OpenGL library unless that one is opened for all first.
ctypes.CDLL("libGL.so.1", mode=ctypes.RTLD_GLOBAL)
import pysplishsplash as peer  # noqa: E402 - after the library

DFSPH = 4
AKINCI_WALLS = 0
STANDARD_VISCOSITY = 1
AKINCI_TENSION = 2
WALL_OFFSET = 0.65  # of the sampled box outwards, in dx
NEVER = 1e6


def write_scene(folder: Path, n: int, liquids: int) -> Path:
    """Write box and scene; return the scene's file."""
    spacing = 1.0 / n
    low = np.array([-1.0, 0.0, -0.5]) - WALL_OFFSET * spacing
    high = np.array([1.0, 2.0, 0.5]) + WALL_OFFSET * spacing
    corners = [[(low, high)[(index >> axis) & 1][axis] for axis in range(3)] for index in range(8)]
    faces = [(1, 3, 4), (1, 4, 2), (5, 6, 8), (5, 8, 7), (1, 2, 6), (1, 6, 5), (3, 7, 8), (3, 8, 4), (1, 5, 7),
             (1, 7, 3), (2, 4, 8), (2, 8, 6)]
    lines = [f"v {x} {y} {z}" for x, y, z in corners] + [f"f {a} {b} {c}" for a, b, c in faces]
    (folder / "box.obj").write_text("\n".join(lines) + "\n")
    half = 0.5 * spacing  # a block of the peer begins half a spacing outside its first particle's cell
    names = ("Water", "Oil")[:liquids]
    bounds = (0.0, 1.0) if liquids == 1 else (0.0, dam.lower_layers(n) * spacing, 1.0)
    tension = {"surfaceTensionMethod": AKINCI_TENSION,
               "Akinci et al. 2013": {"surfaceTension": dam.TENSION[liquids]}} if dam.TENSION[liquids] else {}
    scene = {
        "Configuration": {
            "particleRadius": half, "numberOfStepsPerRenderUpdate": 1, "density0": dam.DENSITIES[1][0],
            "simulationMethod": DFSPH, "gravitation": [0, -dam.GRAVITY, 0], "timeStepSize": dam.TIME_STEP,
            "cflMethod": 0, "boundaryHandlingMethod": AKINCI_WALLS, "enableZSort": True, "stopAt": NEVER,
            "DFSPH": {
                "minIterations": dam.LEAST_ITERATIONS, "maxIterations": 100, "maxError": 100.0 * dam.DENSITY_ERROR,
                "enableDivergenceSolver": True, "maxIterationsV": 100, "maxErrorV": 100.0 * dam.DIVERGENCE_ERROR}},
        "Materials": [{"id": name, "density0": density, "viscosityMethod": STANDARD_VISCOSITY,
                       "Standard viscosity": {"viscosity": dam.KINEMATIC_VISCOSITY}} | tension
                      for name, density in zip(names, dam.DENSITIES[liquids], strict=True)],
        "RigidBodies": [{"id": 1, "geometryFile": "box.obj", "translation": [0, 0, 0], "rotationAxis": [1, 0, 0],
                         "rotationAngle": 0, "scale": [1, 1, 1], "isDynamic": False, "isWall": True}],
        "FluidBlocks": [{"denseMode": 0, "id": name, "start": [-1 - half, bottom - half, -0.5 - half],
                         "end": [1.01 * half, top + 1.01 * half, 0.5 + 1.01 * half]}
                        for name, bottom, top in zip(names, bounds, bounds[1:], strict=False)]}
    path = folder / "scene.json"
    path.write_text(json.dumps(scene, indent=1))
    return path


def run(folder: Path, n: int, steps: int, liquids: int) -> dict:
    """Run the dam and return its result."""
    base = peer.Exec.SimulatorBase()
    base.init(useGui=False, sceneFile=str(write_scene(folder, n, liquids)), outputDir=str(folder / "out"))
    iterations, state = [], {}

    def after_step() -> None:
        watch.stop()
        solver = peer.Simulation.getCurrent().getTimeStep()
        iterations.append((solver.getValueUInt(solver.SOLVER_ITERATIONS),
                           solver.getValueUInt(solver.SOLVER_ITERATIONS_V)))
        if len(iterations) == steps:
            simulation = peer.Simulation.getCurrent()
            models = [simulation.getFluidModel(k) for k in range(liquids)]
            active = [(model, i) for model in models for i in range(model.numActiveParticles())]
            state.update(position=np.array([model.getPosition(i) for model, i in active], float),
                         velocity=np.array([model.getVelocity(i) for model, i in active], float),
                         liquid=np.repeat(range(liquids), [model.numActiveParticles() for model in models]),
                         walls=sum(simulation.getBoundaryModel(k).numberOfParticles()
                                   for k in range(simulation.numberOfBoundaryModels())),
                         simulated=peer.TimeManager.getCurrent().getTime())
            base.setValueFloat(base.STOP_AT, dam.TIME_STEP)
        watch.start()

    base.setTimeStepCB(after_step)
    base.initSimulation()
    watch = dam.Stopwatch()
    base.runSimulation()
    watch.wall, watch.cpu = watch.wall[:steps], watch.cpu[:steps]
    return dam.result("SPlisHSPlasH", n, watch, iterations[:steps], liquids=liquids, **state)


def main() -> None:
    """Command line: ``peer.py FOLDER N STEPS LIQUIDS``; writes ``result.json`` into the folder."""
    p = argparse.ArgumentParser(description=__doc__)
    p.add_argument("folder", type=Path)
    p.add_argument("n", type=int)
    p.add_argument("steps", type=int)
    p.add_argument("liquids", type=int, choices=sorted(dam.DENSITIES))
    arguments = p.parse_args()
    folder = arguments.folder.resolve()
    dam.write(folder / "result.json", run(folder, arguments.n, arguments.steps, arguments.liquids))


if __name__ == "__main__":
    main()
