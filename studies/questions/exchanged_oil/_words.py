"""Names in the tables: cases write them, the page reads them, and a better page runs no case again."""
CANNULAS = ("way", "direction", "inner diameter [mm]", "length [mm]", "pressure [mmHg]", "oil", "viscosity [mPa s]",
            "time [min]", "shortest [min]", "longest [min]", "published [min]", "spread [min]", "source")
EXCHANGES = ("exchange", "tip", "flow [mL/s]", "capillary number", "spacing [mm]", "quantity", "value", "unit")
LEFT, PIECES, LARGEST, LOST_AT = ("left where the tip loses it", "pieces of what is left", "largest piece",
                                  "time at which the tip loses it")
EXCHANGE_COURSES = ("exchange", "tip", "flow [mL/s]", "moved [mL]", "left [% of the cavity]", "distance [mm]")
