"""Maps of the fundus: what oil at rest touches, and breaks."""
from collections.abc import Mapping

import numpy as np
import pyvista
from PIL import Image

from pipeline.equilibrium.contact import Contact
from pipeline.equilibrium.rest import Rest
from pipeline.pictures.fundus_map import FundusMap
from pipeline.pictures.marks import OVERSAMPLING, reduce
from pipeline.scenes.retina import Patch
from pipeline.web.embedded import data_url, webp

SIZE = (560, 460)           # pixels
UNCERTAIN = 0.3e-3          # m, of the contact line, on either side: 2,562 directions against 10,242


class Charts:
    """Draws the answers of one eye.

    Parameters
    ----------
    wall : (n, 3) m, of its cavity. breaks : name -> where. right_eye : whether nasal is the patient's left.
    """

    def __init__(self, wall: np.ndarray, breaks: Mapping[str, Patch], right_eye: bool):
        self._map = FundusMap(wall, (OVERSAMPLING * SIZE[0], OVERSAMPLING * SIZE[1]), right_eye=right_eye,
                              outlines={name: one.outline() for name, one in breaks.items()})

    def address(self, rest: Rest) -> str:
        """Return the map of a shape at rest in this cavity as an address that holds it."""
        return data_url(webp(self.draw(rest)), "image/webp")

    def draw(self, rest: Rest) -> Image.Image:
        """Return the map of a shape at rest in this cavity."""
        wall = pyvista.PolyData(rest.cavity.wall)
        wall.point_data["contact_distance"] = Contact.of(rest).margin
        wall.point_data["oil_fraction_covered"] = np.ones(wall.n_points)
        wall.point_data["oil_fraction_bare"] = np.zeros(wall.n_points)
        return reduce(self._map.draw(wall, uncertain=UNCERTAIN))
