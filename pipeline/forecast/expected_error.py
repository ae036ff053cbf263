"""The error to expect of a scene: that of the accuracy study, carried over to its spacing by the observed order.

The study takes minutes and its errors are those of the method, not of the computer: until it is run here, those that
the project came with count. ``cp outputs/studies/accuracy/draft/orders.csv config/expected_errors.csv`` renews
these.
"""
import csv
import dataclasses
import math
from pathlib import Path

from pipeline.scenes.load import PROJECT_CONFIG
from pipeline.scenes.model import Scene

ORDERS = Path("outputs/studies/accuracy/draft/orders.csv")
SHIPPED = PROJECT_CONFIG / "expected_errors.csv"
LEAST_ORDER = 0.5  # below, the error scatters more than it falls
COLUMNS = ("case", "quantity", "unit", "effects", "per_width", "resolution", "error", "order")


@dataclasses.dataclass(frozen=True)
class ExpectedError:
    """An error to expect: of which quantity, how large, and where the number comes from."""

    quantity: str
    value: float
    unit: str
    source: str


def errors_file() -> Path:
    """What the accuracy study has written here, or else what it had for the authors."""
    return ORDERS if ORDERS.is_file() else SHIPPED


def expected_errors(scene: Scene, width: float, path: Path | None = None) -> list[ExpectedError]:
    """Return the errors to expect; empty where the study has no case with the scene's effects.

    Parameters
    ----------
    width : of the cavity in particle spacings. A case with a drop or a layer in it counts the spacings along that: the
        scene is taken to have a drop or a layer of the same share of its width (``per_width``).
    path : of the study's ``orders.csv``; :func:`errors_file` without it.
    """
    path = path or errors_file()
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    found = []
    for row in rows:
        needed, order = set(row["effects"].split()), float(row["order"] or "nan")
        error, resolution = float(row["error"]), float(row["resolution"])
        if not needed <= scene.effects.keys() or not math.isfinite(error):
            continue
        here = width * float(row["per_width"])
        known = order >= LEAST_ORDER
        value = error * (resolution / here) ** order if known else error
        words = f"order {order:.1f} from {resolution:g} to {here:.3g} spacings" if known else (
            f"at {resolution:g} spacings; it does not fall steadily")
        found.append(ExpectedError(f"{row['case']}: {row['quantity']}", value, row["unit"], f"{path.name}, {words}"))
    return found
