"""Names in the tables: cases write them, the page reads them, and a better page runs no case again."""
BASE, OIL, TENSION, MOVEMENT, FILL, POSTURE = "base", "oil", "tension", "saccade", "fill", "posture"
SHED = ("factor", "setting", "contact line [mm]", "shed [ppm of the cavity per week]", "low", "high")
GATHERED = ("median x [mm]", "median y [mm]", "median z [mm]")
TRACERS = ("posture", "x [mm]", "y [mm]", "z [mm]")
LINE_BY_PARTICLES = "length of the contact line by particles"
