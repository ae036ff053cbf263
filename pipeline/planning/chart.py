"""Maps of the fundus: what oil at rest touches, and breaks."""
from collections.abc import Mapping

import numpy as np
import pyvista
from PIL import Image

from pipeline.equilibrium.contact import Contact
from pipeline.equilibrium.star_cavity import StarCavity
from pipeline.pictures.fundus_map import FundusMap, Uncertain
from pipeline.pictures.marks import OVERSAMPLING, reduce
from pipeline.scenes.retina import Patch
from pipeline.web.embedded import data_url, webp

AS_SEEN = "as an observer sees it who faces the patient (not the inverted view of indirect ophthalmoscopy)"
SIZE = (560, 460)           # pixels
UNCERTAIN = 0.3e-3          # m, of the contact line, on either side: 2,562 directions against 10,242


class Charts:
    """Draws the answers of one eye.

    Parameters
    ----------
    cavity : of which one point sees the whole wall. breaks : name -> where. right_eye : whether nasal is the patient's
        left.
    """

    def __init__(self, cavity: StarCavity, breaks: Mapping[str, Patch], right_eye: bool):
        self._cavity = cavity
        self._map = FundusMap(cavity.wall, (OVERSAMPLING * SIZE[0], OVERSAMPLING * SIZE[1]), right_eye=right_eye,
                              outlines={name: one.outline() for name, one in breaks.items()}, alone=True)

    def address(self, contact: Contact, uncertain: Uncertain = UNCERTAIN) -> str:
        """Return the map of what oil at rest touches as an address that holds it."""
        return data_url(webp(self.draw(contact, uncertain)), "image/webp")

    def draw(self, contact: Contact, uncertain: Uncertain = UNCERTAIN) -> Image.Image:
        """Return the map of what oil at rest touches.

        Parameters
        ----------
        uncertain : of the contact line, as ``FundusMap.draw`` takes it.
        """
        wall = pyvista.PolyData(self._cavity.wall)
        wall.point_data["contact_distance"] = contact.on(self._cavity).margin
        wall.point_data["oil_fraction_covered"] = np.ones(wall.n_points)
        wall.point_data["oil_fraction_bare"] = np.zeros(wall.n_points)
        return reduce(self._map.draw(wall, uncertain=uncertain))
