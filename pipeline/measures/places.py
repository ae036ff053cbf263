"""Breaks and regions of a scene on the wall of its eye: what the oil touches of them in a frame.

A wall is known by the distance of its vertices to the edge of what the oil touches (``wall_map``), as the maps of the
fundus are, so that the numbers and the pictures say the same. Equations: docs/methods/measures.md.
"""
import dataclasses

import numpy as np

from pipeline.base.errors import UserError
from pipeline.cavity.rays import interpolation
from pipeline.measures.wall_map import WallMapper
from pipeline.scenes.model import Scene
from pipeline.scenes.retina import Patch, direction, globe_radius

STEP = 1.0          # degrees between the points of a place, at most: 0.2 mm
FARTHEST = 0.03     # m: a margin of a wall without a contact line; no two points of an eye are so far apart


@dataclasses.dataclass(frozen=True)
class Place:
    """A break or a region on a wall.

    Attributes
    ----------
    patch : where it is.
    position : (k, 3) m, points on it.
    share : (k,), of its area that they stand for.
    """

    patch: Patch
    position: np.ndarray
    share: np.ndarray
    _corners: np.ndarray
    _weights: np.ndarray

    @classmethod
    def of(cls, patch: Patch, wall: np.ndarray, faces: np.ndarray) -> "Place":
        """Find it on a wall of vertices (n, 3) m and triangles (m, 3)."""
        meridian, latitude, share = patch.grid(STEP)
        corners, weights = interpolation(wall, faces, direction(meridian, latitude))
        position = np.einsum("kc,kcx->kx", weights, wall[corners])
        share = share * (position**2).sum(axis=1)  # an area grows as the square of the distance
        return cls(patch, position, share / share.sum(), corners, weights)

    def at_points(self, values: np.ndarray) -> np.ndarray:
        """Values (n,) at the vertices of the wall, at the points of the place, (k,)."""
        return (values[self._corners] * self._weights).sum(axis=1)

    def margin(self, contact_distance: np.ndarray) -> float:
        """Smallest distance of its points to the edge of what the oil touches, m; negative where some are bare."""
        return float(np.clip(self.at_points(contact_distance).min(), -FARTHEST, FARTHEST))

    def covered_share(self, contact_distance: np.ndarray) -> float:
        """Share of it that the oil touches."""
        return min(float(self.share @ (self.at_points(contact_distance) > 0.0)), 1.0)

    def band_share(self, contact_distance: np.ndarray, particle_spacing: float) -> float:
        """Share of it within one particle spacing of the edge."""
        return min(float(self.share @ (np.abs(self.at_points(contact_distance)) < particle_spacing)), 1.0)


@dataclasses.dataclass(frozen=True)
class Places:
    """All breaks and regions of a scene, by name.

    Attributes
    ----------
    mapper : of the wall.
    """

    mapper: WallMapper
    breaks: dict[str, Place]
    regions: dict[str, Place]

    @classmethod
    def of(cls, scene: Scene, wall: np.ndarray, faces: np.ndarray) -> "Places":
        """Find them on the wall of an eye, vertices (n, 3) m and triangles (m, 3)."""
        wall = np.asarray(wall, float)
        places = {kind: {name: Place.of(patch, wall, faces) for name, patch in patches.items()}
                  for kind, patches in scene.patches(globe_radius(wall)).items()}
        return cls(WallMapper(wall, faces), **places)


def places_of(scene: Scene, eye) -> Places | None:
    """Return the places of a scene on the surface of its eye, pyvista.PolyData; None where it has none.

    Raises
    ------
    UserError : the surface is not there.
    """
    if not scene.breaks and not scene.regions:
        return None
    if eye is None:
        raise UserError(f"{scene.name}: has breaks or regions, which need the surface of the eye; add --eye eye.vtp")
    return Places.of(scene, eye.points, eye.regular_faces)
