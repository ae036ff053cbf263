"""The same scene gives the same bits: with one thread and two, and from a checkpoint; single precision stays close.

All effects that a scheme runs act at once, in a state that means little and reaches all of their code. What is run with
two threads is repeated with one; the second half starts from the checkpoint that the two threads have made.
"""
import dataclasses
import time
from typing import Any

import numpy as np

from pipeline.studies.family import Family
from pipeline.studies.model import Outcome, Row, bounded
from sim.effects import REGISTRY
from sim.parameters import parameter
from sim.schemes import REGISTRY as SCHEMES
from sim.settings import Liquid, Settings
from studies.validation.kit import hard_cases as hard
from studies.validation.kit.tank import TankParameters, build, cavity

LIQUIDS = (Liquid("aqueous", 1005.0, 0.01), Liquid("oil", 970.0, 1.0), Liquid("droplets", 970.0, 1.0))
AREA = 3.14e-4  # m^2, of the round cavity
VALUES: dict[str, dict[str, Any]] = {
    "injection": {"liquid": "oil", "drained_liquid": "aqueous", "flow": 2.0 * AREA, "fill": 0.9,
                  "cannula": (-4e-3, 0.0, 0.0), "drain": (9e-3, 0.0, 0.0)},
    "gravity": {}, "interface_tension": {"coefficient": 0.04, "contact_angle": np.radians(60.0)},
    "cohesion": {"tension": 0.02}, "curvature": {"gamma": 5.0}, "adhesion": {"beta": 5.0},
    "viscosity": {}, "viscosity_implicit": {},
    "contact_line_emulsification": {"oil": "oil", "aqueous": "aqueous", "droplets": "droplets", "time_lapse": 1e7},
    "drift": {"droplet_diameter": 1e-4}, "diffusion": {"coefficient": 1e-6}, "collision": {},
    "viscoelastic": {"liquids": ({"liquid": "oil", "shear_modulus": 100.0, "relaxation_time": 0.1},)},
    "xsph": {},
}
NEEDS_FULL_CAVITY = ("injection", "interface_tension")
THREADS = 2     # of this family's runs, whatever there is: what it compares with one
DURATION = 0.1  # s, of the comparison of precisions


@dataclasses.dataclass(frozen=True)
class Parameters:
    """One scheme in a full cavity or under a free surface."""

    scheme: str = parameter(choices=tuple(SCHEMES), meaning="pressure solve and time integration")
    cavity: str = parameter("closed", choices=("closed", "open"), meaning="full cavity, or a free surface")
    steps: int = parameter(10, minimum=1, meaning="time steps before and after the checkpoint")


def run(case: Parameters) -> Outcome:
    """Run with two threads and with one, and in single precision."""
    cpu_begin = time.process_time()
    outcome, begin, at = Outcome(), time.perf_counter(), f"[%s, {hard.HEADS[case.cavity]}]"
    start_taichi("f64", THREADS)
    solver = everything(case)
    active = [effect.name for effect in solver.effects]
    middle, end = stepped(solver, case.steps), stepped(solver, case.steps)
    exact = measured(case)
    start_taichi("f64", 1)
    solver = everything(case)
    threads = different(stepped(solver, case.steps), middle)
    solver.restore(middle)
    restart = different(stepped(solver, case.steps), end)
    start_taichi("f32", 1)
    single = measured(case)
    start_taichi("f64", 0)
    wall: dict[str, Any] = {"wall_s": time.perf_counter() - begin}
    finite = all(np.isfinite(values).all() for values in end.values())
    for name, count in (("threads 1 and 2, all effects", threads), ("restart from a checkpoint, all effects", restart)):
        same = count == 0 and finite
        outcome.rows += [Row("verdict", 0.0 if same else 3.0, at=at % name, error=float(not same), tolerance=0.0,
                             **wall),
                         bounded("arrays of the state with other bits", float(count), 0.0, at=at % name, **wall)]
    rows = [bounded(name, value, limit, at=at % PRECISION, **wall) for name, (value, limit) in
            precision_errors(exact, single).items()]
    close = all(row.holds for row in rows)
    outcome.rows += [Row("verdict", 0.0 if close else 3.0, at=at % PRECISION, error=float(not close), tolerance=0.0,
                         **wall), *rows]
    outcome.rows.append(Row("processor time of all runs", time.process_time() - cpu_begin, "s"))
    outcome.remarks.append(f"{case.scheme}, {hard.HEADS[case.cavity]}: the same bits with 1 and 2 threads and from a "
                           f"checkpoint, with {', '.join(active)}: {'yes' if not threads + restart else 'no'}.")
    return outcome


PRECISION = "single against double precision"


def start_taichi(precision: str, threads: int) -> None:
    """Start Taichi anew, on the same device."""
    from sim.backend.runtime import restart

    restart(precision=precision, threads=threads)


def everything(case: Parameters):
    """A solver with all effects that the scheme runs, its liquid stirred."""
    closed = case.cavity == "closed"
    settings = Settings(2, LIQUIDS, None, (), closed=closed)
    refused = SCHEMES[case.scheme].variant(settings).refuses
    effects = {name: values for name, values in VALUES.items()
               if name not in refused and (closed or name not in NEEDS_FULL_CAVITY)}
    if "viscoelastic" in effects:
        elastic: Any = REGISTRY["viscoelastic"].Parameters
        one = elastic.__dataclass_fields__["liquids"].type.__args__[0]
        effects = effects | {"viscoelastic": {"liquids": tuple(
            one(**values) for values in effects["viscoelastic"]["liquids"])}}
    arrays = (cavity("circle", 0.5 * hard.SIDE, hard.SPACING, support_ratio=2.5) if closed else
              cavity("box", (hard.SIDE, hard.SIDE), hard.SPACING, support_ratio=2.5))
    return build(TankParameters(scheme=case.scheme, support_ratio=2.5), arrays, liquids=LIQUIDS, effects=effects,
                 phase=lambda x: ((x[:, 0] < 0.0) ^ (np.random.default_rng(1).random(len(x)) < 0.05)).astype(int),
                 velocity=lambda x: 5.0 * x[:, ::-1] * [-1.0, 1.0],
                 filled=None if closed else lambda x: x[:, 1] < 0.0)


def stepped(solver, count: int) -> dict:
    """The state after some steps."""
    for _ in range(count):
        solver.step()
    return solver.state()


def different(found: dict, expected: dict) -> int:
    """Number of entries of two states that differ in any bit."""
    names = found.keys() | expected.keys()
    return sum(name not in found or name not in expected
               or np.asarray(found[name]).tobytes() != np.asarray(expected[name]).tobytes() for name in names)


def measured(case: Parameters) -> dict[str, np.ndarray]:
    """What a run without the chaos of all effects comes to: two liquids that change places."""
    from sim.backend.runtime import real_numpy

    single = real_numpy() is np.float32
    tank = (hard.closed_tank if case.cavity == "closed" else hard.open_tank)(case.scheme,
                                                                           precision="f32" if single else "f64")
    tank.reset()
    for _ in tank.solver.advance(DURATION):
        pass
    mass, velocity, position, phase = (tank.read(name) for name in ("mass", "velocity", "position", "phase"))
    return {"center": np.array([position[phase == k].mean(axis=0) for k in (0, 1)]),
            "energy": 0.5 * mass @ (velocity**2).sum(axis=1),
            "volume": np.array([tank.read("volume")[phase == k].sum() for k in (0, 1)])}


def precision_errors(exact: dict, single: dict) -> dict[str, tuple[float, float]]:
    """How far single precision is off, and how far it may be: what round-off grows to in flow that is not chaotic."""
    center = float(np.abs(single["center"] - exact["center"]).max() / hard.SPACING)
    return {"center of any liquid off, over the spacing": (center, 0.005),
            "kinetic energy off": (float(abs(single["energy"] / exact["energy"] - 1.0)), 0.05),
            "volume of any liquid off": (float(np.abs(single["volume"] / exact["volume"] - 1.0).max()), 1e-6)}


FAMILY = Family(__name__, Parameters, run, effects=tuple(REGISTRY), threads=THREADS)
