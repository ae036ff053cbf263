"""How near a scene of an eye with oil comes to the covered retina at rest: what one such scene has shown at its size.

The study is a night's work and its errors are those of the method: those that the project comes with count.
``cp outputs/studies/eye_accuracy_study/fine/eye_errors.csv config/eye_errors.csv`` renews them.
"""
import csv
import math
from pathlib import Path

from pipeline.base.errors import UserError
from pipeline.forecast.expected_error import ExpectedError
from pipeline.scenes.effects import known_by_an_effect
from pipeline.scenes.load import PROJECT_CONFIG
from pipeline.scenes.model import Scene
from sim.liquid import GAS_DENSITY

SHIPPED = PROJECT_CONFIG / "eye_errors.csv"
COLUMNS = ("scene", "particle_spacing", "starts", "minutes", "error", "least", "most")  # m, points of the retina
PAGE = "docs/results/accuracy.md"
UNIT = "points of the retina"
FARTHEST = 1.5  # a spacing that differs by more is another one


def has_oil_in_an_eye(scene: Scene) -> bool:
    """Tell whether a scene is one of an eye in which a liquid with a contact angle touches the retina; gas is none."""
    touches = known_by_an_effect(scene, "contact_angle_of") is not None
    return scene.container is None and touches and all(liquid.density > GAS_DENSITY for liquid in scene.liquids)


def retina_errors(scene: Scene, path: Path | None = None) -> list[ExpectedError]:
    """Return the error to expect of the covered retina at rest, by the nearest spacing; none where it is not known.

    Parameters
    ----------
    path : of the study's ``eye_errors.csv``; by default that with which the project comes.

    Raises
    ------
    UserError : the file has other columns.
    """
    path = path or SHIPPED
    with path.open(newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        if tuple(reader.fieldnames or ()) != COLUMNS:
            raise UserError(f"{path}: its columns are {', '.join(reader.fieldnames or ()) or 'none'}, but must be "
                            f"{', '.join(COLUMNS)}")
        rows = list(reader)
    if not rows or not has_oil_in_an_eye(scene):
        return []
    spacing = scene.numerics.particle_spacing
    nearest = min(rows, key=lambda row: abs(math.log(float(row["particle_spacing"]) / spacing)))
    there, starts, most = float(nearest["particle_spacing"]), int(nearest["starts"]), float(nearest["most"])
    if abs(math.log(there / spacing)) > math.log(FARTHEST):
        return []
    return [ExpectedError(
        "covered retina at rest", most, UNIT, f"within {math.ceil(10.0 * most - 1e-9) / 10.0:g} {UNIT}",
        f"measured on {nearest['scene']} with particles of {1e3 * there:g} mm, "
        f"{starts} start{'s' * (starts > 1)}; {PAGE}")]
