"""Maps of the fundus: what oil at rest touches, and a break."""
import io

import numpy as np
import pyvista
from PIL import Image, ImageDraw

from pipeline.equilibrium.contact import Contact
from pipeline.equilibrium.rest import Liquids, Rest, least_at_rest
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
    cavity : of the eye. right_eye : whether nasal is the patient's left. place : of a break to draw.
    """

    def __init__(self, cavity: StarCavity, right_eye: bool, place: Break | None = None):
        self._cavity, self._break = cavity, place
        self._map = FundusMap(cavity.wall, SIZE, right_eye=right_eye)

    def png(self, liquids: Liquids, down: np.ndarray, fill: float) -> bytes:
        """Return the map of the shape with the least energy, as a file."""
        file = io.BytesIO()
        self.draw(least_at_rest(self._cavity, liquids, down, fill)).save(file, "PNG")
        return file.getvalue()

    def draw(self, rest: Rest) -> Image.Image:
        """Return the map of oil at rest in the cavity."""
        wall = pyvista.PolyData(self._cavity.wall)
        wall.point_data["contact_distance"] = Contact.of(rest).margin
        wall.point_data["oil_fraction_covered"] = np.ones(len(self._cavity.wall))
        wall.point_data["oil_fraction_bare"] = np.zeros(len(self._cavity.wall))
        image = self._map.draw(wall, uncertain=UNCERTAIN)
        if self._break is not None:
            outline = [tuple(map(float, self._map.place(point))) for point in direction(*self._outline(self._break))]
            ImageDraw.Draw(image).line([*outline, outline[0]], fill=BREAK_COLOR, width=4, joint="curve")
        return image

    @staticmethod
    def _outline(place: Break) -> tuple[np.ndarray, np.ndarray]:
        """Meridians and latitudes around a break, degrees."""
        along = np.linspace(-0.5, 0.5, POINTS)
        low, high = max(place.latitude - 0.5 * place.height, 0.0), place.latitude + 0.5 * place.height
        meridian = place.meridian + place.width * np.concatenate([along, along[::-1]])
        return meridian, np.repeat([low, high], POINTS)
