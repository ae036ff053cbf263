"""How many iterations the solves of a scene take per step: relations measured on finished runs.

The implicit viscosity (conjugate gradients) takes about A sqrt(nu dt/dx^2) ln(1/tolerance) iterations with the largest
nu of the liquids: the condition number is 1 + C nu dt/dx^2. Measured in the first steps of `tamponade`:

    dx, mm                      2     1.4    1     0.7    1        0.7
    tolerance                   1e-3  1e-3   1e-3  1e-3   1e-4     1e-4
    iterations                  6     9      13    13     17       18
    the same over the rest, A   1.23  1.29   1.36  1.25   1.27     1.29

and 1.75 where oil fills most of the cavity (`still_eye`, `tamponade` as a whole), which is taken.

The pressure solve of a full cavity starts from the pressure of the step before, and its tolerance is a share of the
largest displacement per step: what counts is how fast the pressure changes. A liquid that grows at a cannula (18 at
draft), cohesion (17) and an interface with tension (7) change it in every step, weight alone does not (1); means of
`tamponade` before and after its injection, `s1_tamponade_gamma3` and `still_eye`. They follow dt/dx, and the power
-0.55 of the tolerance (`tamponade`, first steps: 20 and 16 at 1 and 0.7 mm with 3e-4; 35 and 31 with 1e-4). At a free
surface the solve ends at its smallest number of iterations nearly always: 5 at draft (`coupling_2d`), DFSPH 7.
"""
import math

from pipeline.dimensionless_numbers import Scales
from pipeline.scene_work import active_effects
from sim.schemes.position_based import PositionBasedParameters

VISCOUS = 1.75
DRAFT_TOLERANCE, DRAFT_COURANT = 3e-4, 2.0  # of the runs that were measured; dt over dx in s/m
TOLERANCE_POWER = -0.55
INJECTION, COHESION, TENSION, WEIGHT = 18.0, 17.0, 7.0, 1.0
FREE_SURFACE, DFSPH = 5.0, 7.0


def viscosity_iterations(scales: Scales, time_step: float) -> float:
    """Return iterations per step of the implicit viscosity; 0 without it."""
    numerics = scales.scene.numerics
    if "viscosity_implicit" not in active_effects(scales.scene):
        return 0.0
    kinematic = max(liquid.dynamic_viscosity / liquid.density for liquid in scales.liquids)
    number = math.sqrt(kinematic * time_step) / scales.spacing
    return min(numerics.maximum_iterations, max(1.0, VISCOUS * number * math.log(1.0 / numerics.viscosity_tolerance)))


def pressure_iterations(scales: Scales, time_step: float, variant: str) -> float:
    """Return iterations per step of the pressure solve, the mean over a scene.

    Parameters
    ----------
    variant : class that solves the scene (``pipeline.scene_work.variant``).
    """
    scene = scales.scene
    if variant == "PositionBased":
        return float((scene.schemes.get("position_based") or PositionBasedParameters()).iterations)
    at_draft = {"WCSPH": 0.0, "VolumeIncompressibleClamped": FREE_SURFACE, "DFSPH": DFSPH}.get(variant)
    if at_draft is not None:
        return at_draft
    effects = scene.effects
    at_draft = max(WEIGHT, TENSION * bool(scales.tension), COHESION * bool(effects.keys() & {"cohesion", "curvature"}))
    if "injection" in effects:
        share = min(1.0, scales.injected_volume / effects["injection"].flow / scales.duration)
        at_draft = share * max(INJECTION, at_draft) + (1.0 - share) * at_draft
    factor = (time_step / scales.spacing / DRAFT_COURANT
              * (scene.numerics.pressure_tolerance / DRAFT_TOLERANCE) ** TOLERANCE_POWER)
    return min(scene.numerics.maximum_iterations, max(WEIGHT, at_draft * factor))
