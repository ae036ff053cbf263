"""Hard cases in the eye itself, at the size of a real run: spacing and tolerances are those of the study's level.

A scene of the eye is run for a while with one thing changed, and held to the limits of
``studies.validation.kit.hard_cases``: turned face down and hit, ten times the interface tension, nearly no oil and
nearly nothing else, and the widest range of viscosities.
"""
import dataclasses
import time

from pipeline.base.errors import UserError
from pipeline.scenes.model import Scene
from pipeline.studies.family import Family
from pipeline.studies.model import Outcome, Row
from sim.parameters import parameter
from studies.validation.kit.hard_cases import FAILED, HardCase, Tank, judge
from studies.validation.kit.tank import TankParameters, scene_solver

OIL, AQUEOUS = "silicone_oil_1000", "aqueous"


@dataclasses.dataclass(frozen=True)
class Parameters(TankParameters):
    """A scene of the eye, and what is changed; ``resolutions`` and ``largest_step`` are not used."""

    scene: str = parameter("resting_eye", choices=("jolted_eye", "resting_eye"), meaning="scene of the eye")
    tension_factor: float = parameter(1.0, exclusive_minimum=0.0, meaning="interface tension over that of the scene")
    fill: float = parameter(0.85, exclusive_minimum=0.0, maximum=0.999, meaning="fraction of oil at the start")
    viscosity_ratio: float | None = parameter(None, exclusive_minimum=0.0, meaning="viscosity of the oil over that of "
                                              "the aqueous, else that of the liquids")
    duration: float = parameter(0.2, unit="s", exclusive_minimum=0.0, meaning="simulated time")


def solves(case: Parameters) -> str:
    """The scene of the eye."""
    return case.scene


def changed(case: Parameters, scene: Scene) -> Scene:
    """The scene with what the case changes."""
    effects = dict(scene.effects)
    if case.tension_factor != 1.0:
        if "interface_tension" not in effects:
            raise UserError(f"tension_factor is {case.tension_factor:g}, but {case.scene} has no interface tension")
        tension = effects["interface_tension"]
        effects["interface_tension"] = dataclasses.replace(tension,
                                                           coefficient=case.tension_factor * tension.coefficient)
    liquids = scene.liquids
    if case.viscosity_ratio is not None:
        thin = next(liquid.dynamic_viscosity for liquid in liquids if liquid.name == AQUEOUS)
        liquids = tuple(dataclasses.replace(liquid, dynamic_viscosity=case.viscosity_ratio * thin)
                        if liquid.name == OIL else liquid for liquid in liquids)
    initial = dataclasses.replace(scene.initial, fill={OIL: case.fill, AQUEOUS: 1.0 - case.fill})
    return dataclasses.replace(scene, effects=effects, liquids=liquids, initial=initial)


def run(case: Parameters, scene: Scene) -> Outcome:
    """Run the scene from its start and judge it."""
    scene = changed(case, scene)
    spacing = scene.numerics.particle_spacing
    tank = Tank(scene_solver(case, scene, spacing))
    gravity = scene.effects["gravity"]

    def start(tank: Tank) -> None:
        tank.set_gravity(turns=gravity.turns, jolts=gravity.jolts)

    begin, cpu_begin = time.perf_counter(), time.process_time()
    verdict = judge(tank, HardCase(f"{1e3 * spacing:g} mm", start, case.duration, works=True))
    outcome = Outcome(verdict.rows(time.perf_counter() - begin))
    at = f"[{verdict.name}]"
    outcome.rows += [Row("particles", float(tank.solver.count[None]), at=at),
                     Row("time reached", tank.solver.time, "s", at=at),
                     Row("processor time", time.process_time() - cpu_begin, "s", at=at)]
    if verdict.sentence:
        outcome.remarks.append(f"{case.scene} {at}: {'failed' if verdict.outcome == FAILED else verdict.outcome} "
                               f"({verdict.sentence}).")
    return outcome


FAMILY = Family(__name__, Parameters, run, solves=solves)
