"""Whether a scene has come to rest at its end, by the covered share of the retina: what people read off."""
from collections.abc import Mapping

import numpy as np

WINDOW = 0.5  # s at the end over which the change is measured
RATE = 0.5  # points per second, up to which a scene is called at rest
PARTS = ("whole", "superior", "inferior")


def rest_in_words(table: Mapping[str, np.ndarray]) -> str:
    """Return one sentence on how fast the covered retina still changes; empty for tables without it, or too short.

    Parameters
    ----------
    table : metrics, column -> (frames,).
    """
    time = table.get("time [s]", np.zeros(0))
    late = time >= time[-1] - WINDOW - 1e-9 if len(time) else np.zeros(0, bool)
    columns = [f"retina_coverage_{part} [%]" for part in PARTS]
    if np.count_nonzero(late) < 3 or np.ptp(time[late]) < 0.9 * WINDOW or not all(name in table for name in columns):
        return ""
    rates = {part: float(np.polyfit(time[late], table[name][late], 1)[0])
             for part, name in zip(PARTS, columns, strict=True) if np.isfinite(table[name][late]).all()}
    if not rates:
        return ""
    part = max(rates, key=lambda name: abs(rates[name]))
    change = (f"in the last {WINDOW:g} s the covered share of the retina ({part}) changes by {rates[part]:+.2g} points "
              "per second")
    if abs(rates[part]) <= RATE:
        return f"at rest: {change}, less than {RATE:g}; oil that creeps along the wall may need minutes all the same"
    return f"not at rest: {change}, more than {RATE:g}; a longer output.duration shows where it ends"
