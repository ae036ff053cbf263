"""Maps of the fundus for the page of a plan: what the oil of an answer touches, and the break."""
import io

import numpy as np
import pyvista
from PIL import ImageDraw

from pipeline.equilibrium.contact import Contact
from pipeline.equilibrium.rest import Liquids, at_rest
from pipeline.equilibrium.star_cavity import StarCavity
from pipeline.pictures.fundus_map import FundusMap
from pipeline.planning.breaks import Break, direction

SIZE = (560, 460)           # pixels
UNCERTAIN = 0.3e-3          # m, of the contact line, on either side: 2,562 directions against 10,242
BREAK_COLOR = (214, 39, 40)
POINTS = 60                 # of each side of the outline of a break


class Charts:
    """Draws the answers of one eye.

    Parameters
    ----------
    cavity : of the eye. place : of the break. right_eye : whether nasal is the patient's left.
    """

    def __init__(self, cavity: StarCavity, place: Break, right_eye: bool):
        self._cavity, self._break = cavity, place
        self._map = FundusMap(cavity.wall, SIZE, right_eye=right_eye)

    def png(self, liquids: Liquids, down: np.ndarray, fill: float) -> bytes:
        """Return the map of the shape with the least energy, as a file."""
        cavity = self._cavity
        rests = [at_rest(cavity, liquids, down, fill, start) for start in (None, cavity.radius)]
        least = min(rests, key=lambda rest: (not rest.settled, rest.energy))
        wall = pyvista.PolyData(cavity.wall)
        wall.point_data["contact_distance"] = Contact.of(least).margin
        wall.point_data["oil_fraction_covered"] = np.ones(len(cavity.wall))
        wall.point_data["oil_fraction_bare"] = np.zeros(len(cavity.wall))
        image = self._map.draw(wall, uncertain=UNCERTAIN)
        outline = [tuple(map(float, self._map.place(point))) for point in direction(*self._outline())]
        ImageDraw.Draw(image).line([*outline, outline[0]], fill=BREAK_COLOR, width=4, joint="curve")
        file = io.BytesIO()
        image.save(file, "PNG")
        return file.getvalue()

    def _outline(self) -> tuple[np.ndarray, np.ndarray]:
        """Meridians and latitudes around the break, degrees."""
        place, along = self._break, np.linspace(-0.5, 0.5, POINTS)
        low, high = max(place.latitude - 0.5 * place.height, 0.0), place.latitude + 0.5 * place.height
        meridian = place.meridian + place.width * np.concatenate([along, along[::-1]])
        return meridian, np.repeat([low, high], POINTS)
