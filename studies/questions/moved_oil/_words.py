"""Names in the tables: cases write them, the page reads them, and a better page runs no case again."""
SACCADES, JOLT, STANDING_UP = "saccades", "jolt", "standing_up"
STRESS, HIGH_STRESS = "stress, mean of the retina", "stress that 1 % of the retina exceeds"
SHIFT = "shift of the interface"
EXACT_STRESS = "mean stress in a sphere full of oil, exact"
WAY_LEFT = "way made at the end"
MOVEMENTS = ("oil", "viscosity [mPa s]", "density [kg/m3]", "spacing [mm]", "movement", "quantity", "value", "spread",
             "at rest", "unit")
COURSES = ("oil", "viscosity [mPa s]", "density [kg/m3]", "spacing [mm]", "movement", "time [s]", "value", "exact")


def time_to_make(way: float) -> str:
    """Return the name of the time to make a share of a way."""
    return f"time to make {100.0 * way:g} % of the way"
