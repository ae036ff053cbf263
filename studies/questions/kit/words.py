"""Names in the tables of several questions: families of cases write them, pages read them."""
OILS = ("silicone_oil_1000", "silicone_oil_2000", "silicone_oil_5000", "silicone_oil_5700", "heavy_oil_densiron_68")
PARTS = {"retina": "retina", "superior": "superior half", "inferior": "inferior half",
         "superior_temporal": "superior temporal", "superior_nasal": "superior nasal",
         "inferior_temporal": "inferior temporal", "inferior_nasal": "inferior nasal", "macula": "macula",
         "behind_equator": "behind the equator", "before_equator": "before the equator"}
AQUEOUS = "aqueous_before_equator"
SHOWN = 85.0                # %, fill of the tables


def posture_words(posture: str) -> str:
    """Return a posture in words.

    >>> posture_words("left_side"), posture_words("head_up_45")
    ('left side', 'head up 45°')
    """
    return {"head_up_45": "head up 45°"}.get(posture, posture.replace("_", " "))
