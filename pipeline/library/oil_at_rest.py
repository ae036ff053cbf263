"""Oil at rest in an eye, as a function: its shape, what it touches, a map of the fundus. No particle is simulated."""
import dataclasses
import functools
import io
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup
from PIL import Image

from pipeline.base import page
from pipeline.base.errors import UserError
from pipeline.base.words import NO_ADVICE, nearest
from pipeline.equilibrium.contact import Contact, shares
from pipeline.equilibrium.least import Resting
from pipeline.equilibrium.rest import Liquids, Rest
from pipeline.equilibrium.star_cavity import FINE, cavity_of
from pipeline.planning.chart import Charts
from pipeline.planning.plan import read_eye, read_record
from pipeline.planning.report import percent
from pipeline.planning.settings import Settings, load_settings, postures
from pipeline.scenes.model import Eye
from sim.parameters import parameter

if TYPE_CHECKING:
    import pyvista


@dataclasses.dataclass(frozen=True)
class OilAtRest:
    """Oil at rest in an eye; a notebook shows what it touches, as map and table.

    Attributes
    ----------
    oil : name of the liquid.
    fill : share of the cavity that is oil, between 0 and 1.
    posture : name of the posture.
    eye : the eye, in SI units.
    rest : the minimum-energy shape, with its pressure and its contact line.
    """

    oil: str
    fill: float
    posture: str
    eye: Eye
    rest: Rest

    @property
    def shares(self) -> dict[str, float]:
        """Covered shares, between 0 and 1: "wall", "retina", its halves and quadrants, and "macula"."""
        return shares(Contact.of(self.rest))

    @property
    def surface(self) -> "pyvista.PolyData":
        """The closed surface of the oil, in m."""
        return self._mesh(self.rest.surface)

    @property
    def wall(self) -> "pyvista.PolyData":
        """The wall of the cavity, in m; ``contact_distance``, m, is positive where the oil touches."""
        wall = self._mesh(self.rest.cavity.wall)
        wall.point_data["contact_distance"] = Contact.of(self.rest).margin
        return wall

    @functools.cached_property
    def map(self) -> Image.Image:
        """What the oil touches, as a map of the fundus: ivory is touched."""
        return Charts(cavity_of(self.eye), {}, self.eye.side == "right").draw(Contact.of(self.rest))

    def _mesh(self, points: np.ndarray) -> "pyvista.PolyData":
        import pyvista

        return pyvista.PolyData.from_regular_faces(points, self.rest.cavity.faces)

    def _repr_html_(self) -> str:
        png = io.BytesIO()
        self.map.save(png, "png")
        title = f"{self.oil}, {percent(self.fill, 1)} of the cavity, {self.posture.replace('_', ' ')}"
        rows = [(name.replace("_", " "), percent(share)) for name, share in self.shares.items()]
        return str(Markup("\n").join([Markup("<h3>{}</h3>").format(title), page.picture(png.getvalue(), title),
                                      page.table(("part", "under oil"), rows), page.paragraph(NO_ADVICE)]))

    def __repr__(self) -> str:
        touched = ", ".join(f"{name} {percent(share)}" for name, share in self.shares.items())
        return f"<{self.oil}, {percent(self.fill, 1)}, {self.posture}: {touched}>"


def oil_at_rest(oil: str = "silicone_oil_1000", fill: str | float = 0.85, posture: str = "upright", *,
                eye: Mapping[str, Any] | None = None, tension: str | float | None = None,
                contact_angle: str | float | None = None) -> OilAtRest:
    """Find oil at rest in an eye: the shape of least energy at exact volume, within seconds.

    No particle is simulated. Gas is an oil here too. The method is that of docs/methods/equilibrium.md.

    Parameters
    ----------
    oil : liquid of ``config/materials.yaml``.
    fill : share of the cavity that is oil, a number between 0.05 and 0.999 or a text such as "85 %".
    posture : posture of the patient: "upright", "supine", "prone", "left_side", "right_side" and more.
    eye : keys of ``eye`` in a scene, such as ``{"axial_length": "26 mm"}``; by default the model eye.
    tension : interfacial tension, N/m or a text such as "40 mN/m"; by default that of ``config/plan.yaml``.
    contact_angle : contact angle through the aqueous, rad or a text such as "18 deg"; by default that of
        ``config/plan.yaml``, on retina [fawcett1994, abstract].

    Returns
    -------
    The shape, with what it touches.

    Raises
    ------
    UserError : an argument is wrong, one sentence for each; or no shape at rest was found.

    Examples
    --------
    >>> rest = oil_at_rest("silicone_oil_1000", "85 %", "upright")
    >>> f"{rest.shares['retina']:.2f}, of the lower half {rest.shares['inferior']:.2f}"
    '0.68, of the lower half 0.36'
    """
    settings, materials = load_settings()
    changed = {"tension": tension, "contact_angle": contact_angle}
    given = read_record(Settings, {name: value for name, value in changed.items() if value is not None}, settings)
    share = read_record(_Fill, {"fill": fill}).fill
    for what, name, known in (("oil", oil, materials), ("posture", posture, postures())):
        if name not in known:
            raise UserError(f'{what} is "{name}", but must be one of {", ".join(known)}{nearest(name, known)}')
    if oil == settings.other_liquid:
        raise UserError(f'oil is "{oil}", but must be another liquid than the one that it leaves room for, '
                        f"{settings.other_liquid}")
    shape = read_eye(eye or {})
    liquids = Liquids(materials[settings.other_liquid].density - materials[oil].density, given.tension,
                      given.contact_angle)
    least = Resting.of(shape).least(liquids, postures()[posture], share, FINE)
    if least is None:
        raise UserError(f"{percent(share, 1)} of {oil}, {posture}: no shape at rest was found; try another fill")
    return OilAtRest(oil, share, posture, shape, least.rest)


@dataclasses.dataclass(frozen=True)
class _Fill:
    """How much oil there is."""

    fill: float = parameter(minimum=0.01, maximum=0.999, meaning="share of the cavity that is oil")
