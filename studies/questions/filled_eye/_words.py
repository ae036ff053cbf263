"""Names in the tables: cases write them, the page reads them, and a better page runs no case again."""
TAMPONADES = {"light_oil": "light oil", "heavy_oil": "heavy oil", "gas": "gas"}
SPHERE, WHOLE_SPHERE = "sphere", "wall"
TOUCHED_BY_FILL = ("tamponade", "axial length [mm]", "posture", "fill [%]", "part", "covered [%]", "low [%]",
                   "high [%]")
MODEL_ARC = "exact arc of contact of a model eye"
