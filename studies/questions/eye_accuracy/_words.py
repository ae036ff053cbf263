"""Names in the tables: cases write them, the page reads them, and a better page runs no case again."""
EYE_RUNS = ("scene", "level", "spacing [mm]", "start", "particles", "minutes", "covered [%]", "covered at rest [%]",
            "deepest aqueous [mm]", "deepest aqueous at rest [mm]", "to rest [s]")


def covered_at(time: float) -> str:
    """Return the name of the covered share of the retina at a time, s."""
    return f"covered at {time:g} s [%]"
