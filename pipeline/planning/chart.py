"""Maps of the fundus for the page of a plan: what the oil of an answer touches, and the break."""
import io

import numpy as np
import pyvista

from pipeline.equilibrium.contact import Contact
from pipeline.equilibrium.rest import Liquids, at_rest
from pipeline.equilibrium.star_cavity import StarCavity
from pipeline.pictures.fundus_map import FundusMap
from pipeline.scenes.retina import Patch

SIZE = (560, 460)           # pixels
UNCERTAIN = 0.3e-3          # m, of the contact line, on either side: 2,562 directions against 10,242


class Charts:
    """Draws the answers of one eye.

    Parameters
    ----------
    cavity : of the eye. place : the break. right_eye : whether nasal is the patient's left.
    """

    def __init__(self, cavity: StarCavity, place: Patch, right_eye: bool):
        self._cavity = cavity
        self._map = FundusMap(cavity.wall, SIZE, right_eye=right_eye, outlines={"": place.outline()})

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
        file = io.BytesIO()
        image.save(file, "PNG")
        return file.getvalue()
