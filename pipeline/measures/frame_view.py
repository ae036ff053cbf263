"""One frame together with its scene and cavity, as the metrics look at it."""
import dataclasses
import functools

import numpy as np

from pipeline.base.frame_files import FrameData
from pipeline.cavity.signed_distance_grid import SignedDistance
from pipeline.measures.coverage import WallContact
from pipeline.measures.film_course import FilmCourse, WallFilm
from pipeline.measures.places import Places
from pipeline.scenes.effects import contact_angle_of, droplets_of, oil_of
from pipeline.scenes.model import Scene

MIXED = (0.05, 0.95)    # volume fractions of oil between which liquid counts as mixed


@dataclasses.dataclass(frozen=True)
class Measured:
    """The state that a metric is a function of; what several metrics need is computed once.

    Attributes
    ----------
    scene : the resolved scene.
    initial : arrays of ``initial.npz``.
    frame : one frame.
    places : breaks and regions on the wall; None where nothing asks for them.
    film : what the oil lies on, which the frames before tell; None where they are not known (`after`).
    """

    scene: Scene
    initial: dict[str, np.ndarray]
    frame: FrameData
    places: Places | None = None
    film: WallFilm | None = None

    @functools.cached_property
    def oil(self) -> int:
        """Phase index of the oil, or of the gas in its place."""
        return oil_of(self.scene)

    @property
    def oil_fraction(self) -> np.ndarray:
        """Volume fraction of the oil, (n,)."""
        return self.frame.volume_fraction[:, self.oil]

    @property
    def right_eye(self) -> bool:
        """Whether temporal is the patient's right; also where nothing says which eye it is."""
        return self.scene.eye is None or self.scene.eye.side == "right"

    @functools.cached_property
    def droplets(self) -> int | None:
        """Phase index of the liquid that is oil in droplets; None in a scene that makes none."""
        return droplets_of(self.scene)

    @functools.cached_property
    def optic_axis_extent(self) -> tuple[float, float]:
        """Smallest and largest z of the cavity, m, to one cell of the signed distance."""
        layers = np.flatnonzero((self.distance.values < 0.0).any(axis=(0, 1)))
        return tuple(self.distance.origin[2] + self.distance.cell * layers[[0, -1]])

    @functools.cached_property
    def mass(self) -> np.ndarray:
        """Mass of every particle, (n,), kg."""
        density = np.array([liquid.density for liquid in self.scene.liquids])
        return self.frame.volume * (self.frame.volume_fraction @ density)

    @property
    def cavity_volume(self) -> float:
        """Volume of the cavity, m3 (m2 in 2D)."""
        return float(self.initial["cavity_volume"])

    @functools.cached_property
    def distance(self) -> SignedDistance:
        """Signed distance to the wall."""
        return SignedDistance(self.initial["sdf_values"], self.initial["sdf_origin"], float(self.initial["sdf_cell"]))

    @functools.cached_property
    def wall(self) -> WallContact:
        """Where the oil is at the wall."""
        if self.film is not None:
            return self.film.contact
        return WallContact.of(self.initial, self.frame.position, self.oil_fraction,
                              particle_spacing=self.frame.particle_spacing, support_radius=self.support_radius,
                              contact_angle=self.contact_angle)

    @functools.cached_property
    def contact_distance(self) -> np.ndarray:
        """Distance to the edge of what the oil touches at the vertices of the wall of ``places``, (v,), m."""
        return self.places.mapper.map(self.wall).contact_distance

    @property
    def contact_angle(self) -> float | None:
        """Contact angle at the wall, measured through the liquid that is not the oil, rad; None without tension."""
        return contact_angle_of(self.scene)

    @property
    def support_radius(self) -> float:
        """Distance up to which particles are neighbors, m."""
        return self.scene.numerics.support_ratio * self.frame.particle_spacing

    def statistic(self, name: str) -> float:
        """Return a number that the solver saved with the frame; NaN if there is none, as in a frame at the start."""
        return self.frame.statistics.get(name, np.nan)

    def after(self, films: FilmCourse | None) -> "Measured":
        """Return it with what the oil lies on, by the course of the frames before; as it is without one."""
        if films is None:
            return self
        return dataclasses.replace(self, film=films.advance(self.wall, float(self.frame.time), self.frame.gravity))
