"""Names in the tables of studies for surgeons: families of cases write them, pages read them.

They are apart from both, so that a better page runs no case again.
"""
OILS = ("silicone_oil_1000", "silicone_oil_2000", "silicone_oil_5000", "silicone_oil_5700", "heavy_oil_densiron_68")
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


CANNULAS = ("way", "direction", "inner diameter [mm]", "length [mm]", "pressure [mmHg]", "oil", "viscosity [mPa s]",
            "time [min]", "shortest [min]", "longest [min]", "published [min]", "spread [min]", "source")
EXCHANGES = ("exchange", "tip", "flow [mL/s]", "capillary number", "spacing [mm]", "quantity", "value", "unit")
LEFT, PIECES, LARGEST, LOST_AT = ("left where the tip loses it", "pieces of what is left", "largest piece",
                                  "time at which the tip loses it")
EXCHANGE_COURSES = ("exchange", "tip", "flow [mL/s]", "moved [mL]", "left [% of the cavity]", "distance [mm]")
BASE, OIL, TENSION, MOVEMENT, FILL, POSTURE = "base", "oil", "tension", "saccade", "fill", "posture"
SHED = ("factor", "setting", "contact line [mm]", "shed [ppm of the cavity per week]", "low", "high")
GATHERED = ("median x [mm]", "median y [mm]", "median z [mm]")
TRACERS = ("posture", "x [mm]", "y [mm]", "z [mm]")
LINE_BY_PARTICLES = "length of the contact line by particles"
TAMPONADES = {"light_oil": "light oil", "heavy_oil": "heavy oil", "gas": "gas"}
PARTS = {"retina": "retina", "superior": "superior half", "inferior": "inferior half",
         "superior_temporal": "superior temporal", "superior_nasal": "superior nasal",
         "inferior_temporal": "inferior temporal", "inferior_nasal": "inferior nasal", "macula": "macula",
         "behind_equator": "behind the equator", "before_equator": "before the equator"}
SPHERE, WHOLE_SPHERE, AQUEOUS = "sphere", "wall", "aqueous_before_equator"
TOUCHED_BY_FILL = ("tamponade", "axial length [mm]", "posture", "fill [%]", "part", "covered [%]", "low [%]",
                   "high [%]")
SHOWN = 85.0                # %, fill of the tables
MODEL_ARC = "exact arc of contact of a model eye"
GROUPS = {"length": "length", "lens": "lens", "wall": "buckle and staphyloma", "mesh": "a mesh from elsewhere"}
TOUCHED_BY_EYE = ("eye", "posture", "fill [%]", "part", "covered [%]", "low [%]", "high [%]")
VOLUME, ROW = "volume of the cavity", "eye_row"


def posture_words(posture: str) -> str:
    """Return a posture in words.

    >>> posture_words("left_side"), posture_words("head_up_45")
    ('left side', 'head up 45°')
    """
    return {"head_up_45": "head up 45°"}.get(posture, posture.replace("_", " "))
# A run of an eye at one particle spacing: covered shares in percent, whose columns end in the part or in a time.
EYE_RUNS = ("scene", "level", "spacing [mm]", "start", "particles", "minutes", "covered [%]", "covered at rest [%]",
            "deepest aqueous [mm]", "deepest aqueous at rest [mm]", "to rest [s]")


def covered_at(time: float) -> str:
    """Return the name of the covered share of the retina at a time, s."""
    return f"covered at {time:g} s [%]"
