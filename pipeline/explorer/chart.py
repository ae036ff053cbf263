"""The retina of an eye on the grid of a field: covered shares of a margin."""
import dataclasses
import functools

import numpy as np

from pipeline.cavity.rays import interpolation
from pipeline.cavity.regions import MACULA_RADIUS
from pipeline.equilibrium.contact import positive_share
from pipeline.equilibrium.star_cavity import StarCavity
from pipeline.explorer.cases import LATITUDES, MERIDIANS
from pipeline.scenes.retina import ORA, direction

STEP = LATITUDES[1] - LATITUDES[0]      # degrees, of latitudes and meridians
TRIED, FARTHEST = 0.5e-3, 3e-3          # m, by which a contact line is moved to see what its share does; at most


@dataclasses.dataclass(frozen=True)
class Chart:
    """The retina of an eye on the grid of a field, as triangles.

    Attributes
    ----------
    radius : (latitudes, meridians), m, distance of the wall from the center of the globe.
    """

    radius: np.ndarray

    @classmethod
    def of(cls, cavity: StarCavity) -> "Chart":
        """Read the wall of a cavity."""
        return cls(wall_radius(cavity, LATITUDES, MERIDIANS))

    def shares(self, margin: np.ndarray) -> np.ndarray:
        """Return the covered shares (4,) of the retina, its superior and inferior half, and the macula."""
        last = int(ORA / STEP)
        area, covered = self._bands(margin, LATITUDES[:last + 1])
        upper = np.cos(np.radians(MERIDIANS + 0.5 * STEP)) > 0.0
        around, touched = self._bands(margin, [*LATITUDES[self._macula > LATITUDES], self._macula])
        return np.array([covered.sum() / area.sum(), covered[:, upper].sum() / area[:, upper].sum(),
                         covered[:, ~upper].sum() / area[:, ~upper].sum(), touched.sum() / around.sum()])

    def shift(self, margin: np.ndarray, change: float) -> float:
        """Return how far the contact line must move, m, to change the covered share of the retina by so much."""
        share, moved = (self.shares(margin + one)[0] for one in (0.0, np.copysign(TRIED, change)))
        return min(TRIED * abs(change) / max(abs(moved - share), 1e-6), FARTHEST) if change else 0.0

    @functools.cached_property
    def _macula(self) -> float:
        return float(np.degrees(np.arcsin(MACULA_RADIUS / self.radius[0].mean())))

    def _bands(self, margin: np.ndarray, latitudes) -> tuple[np.ndarray, np.ndarray]:
        """Area and covered area of the cells between latitudes, (bands, meridians) each, m2."""
        rows, share = np.floor(np.array(latitudes) / STEP).astype(int), (np.array(latitudes) / STEP % 1.0)[:, None]
        around, down = np.meshgrid(MERIDIANS, latitudes)
        radius, margin = (one[rows] * (1.0 - share) + one[rows + 1] * share for one in (self.radius, margin))
        point = radius[..., None] * direction(around.ravel(), down.ravel()).reshape(*around.shape, 3)
        corner = [(one, np.roll(one, -1, axis=1)) for one in (point, margin)]
        (here, after), (value, next_value) = corner
        area, covered = np.zeros(here[1:].shape[:2]), np.zeros(here[1:].shape[:2])
        for triangle, values in (((here[:-1], here[1:], after[1:]), (value[:-1], value[1:], next_value[1:])),
                                 ((here[:-1], after[1:], after[:-1]), (value[:-1], next_value[1:], next_value[:-1]))):
            size = 0.5 * np.linalg.norm(np.cross(triangle[1] - triangle[0], triangle[2] - triangle[0]), axis=-1)
            touched = positive_share(np.stack(values, axis=-1).reshape(-1, 3)).reshape(size.shape)
            area, covered = area + size, covered + size * touched
        return area, covered


def wall_radius(cavity: StarCavity, latitudes: np.ndarray, meridians: np.ndarray) -> np.ndarray:
    """Distances (latitudes, meridians), m, of the wall from the center of the globe."""
    around, down = np.meshgrid(meridians, latitudes)
    corners, weights = interpolation(cavity.wall, cavity.faces, direction(around.ravel(), down.ravel()))
    return np.linalg.norm((cavity.wall[corners] * weights[..., None]).sum(axis=1), axis=1).reshape(around.shape)
