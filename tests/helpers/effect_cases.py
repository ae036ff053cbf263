"""Parameters of every effect with which it acts, and with which it does nothing."""
import math

from helpers import cavities
from sim.effects.eye_rotation import Oscillation, Saccade
from sim.effects.viscoelastic import ElasticLiquid
from sim.settings import Liquid

RADIUS = 8.0 * cavities.SPACING
FLOW = {"liquid": "oil", "drained_liquid": "aqueous", "flow": 1e-6, "fill": 0.5, "cannula": (0.0, 0.0, 0.0),
        "drain": (0.0, 5e-3, 0.0)}
SHEDDING = {"oil": "oil", "aqueous": "aqueous", "droplets": "droplets"}
# Every effect with a coefficient that acts, and with one that does nothing.
ACTIVE = {
    "injection": FLOW,
    "gravity": {},
    "eye_rotation": {"oscillation": Oscillation(math.radians(10.0), 5.0, (0.0, 0.0, 1.0))},
    "interface_tension": {"coefficient": 0.04},
    "wall_film": {},
    "cohesion": {"gamma": 10.0},
    "curvature": {"gamma": 10.0},
    "adhesion": {"beta": 10.0},
    "viscosity": {"wall": "free_slip"},
    "viscosity_implicit": {"wall": "free_slip"},
    "contact_line_emulsification": SHEDDING,
    "drift": {"droplet_diameter": 1e-3},
    "diffusion": {"coefficient": 1e-5},
    "collision": {},
    "viscoelastic": {"liquids": (ElasticLiquid("oil", 500.0, 0.1),)},
    "xsph": {"coefficient": 0.1, "wall": "free_slip"},
}
ZERO = {
    "injection": FLOW | {"start": 1e9},
    "gravity": {"magnitude": 0.0},
    "eye_rotation": {"saccades": (Saccade(0.0, 0.0, (0.0, 0.0, 1.0)),)},
    "interface_tension": {"coefficient": 0.0},
    "wall_film": {"coefficient": 0.0},
    "cohesion": {"gamma": 0.0},
    "curvature": {"gamma": 0.0},
    "adhesion": {"beta": 0.0},
    "viscosity": {},
    "viscosity_implicit": {},
    "contact_line_emulsification": SHEDDING | {"efficiency": 0.0},
    "drift": {"droplet_diameter": 1e-3, "coefficient": 0.0},
    "diffusion": {"coefficient": 0.0},
    "collision": {"strength": 0.0},
    "viscoelastic": {"liquids": (ElasticLiquid("oil", 0.0),)},
    "xsph": {"coefficient": 0.0},
}
# What an effect needs beside it to act.
BESIDE = {"wall_film": ("gravity", "interface_tension")}
THIN, THICK, DROPLETS = Liquid("aqueous", 1005.0, 1.0), Liquid("oil", 970.0, 3.0), Liquid("droplets", 970.0, 3.0)
INVISCID = (Liquid("aqueous", 1005.0, 0.0), Liquid("oil", 970.0, 0.0), Liquid("droplets", 970.0, 0.0))
