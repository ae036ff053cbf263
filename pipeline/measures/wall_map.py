"""The covered part of the wall as a smooth field on the eye's surface, for maps and pictures.

The metrics count wall points, each covered or not; drawn as they are, their line is ragged by a particle. Here the
same points are averaged over some spacings, the line between covered and bare is found on the surface, and the strip
under the thin wedge is taken off as a distance from that line. So a map holds the share that the metrics state.
Equations: docs/methods/pictures.md.
"""
import dataclasses

import numpy as np
from scipy.sparse import csr_matrix
from scipy.spatial import cKDTree

from pipeline.measures.coverage import WallContact
from pipeline.measures.film_course import WallFilm

AVERAGED = 3.0          # particle spacings over which the labels of wall points are averaged
FAR = 1.0               # m, distance to an edge where there is none


@dataclasses.dataclass(frozen=True)
class WallMap:
    """What touches the wall, at the vertices of its surface.

    Attributes
    ----------
    contact_distance : (n,) float, m, to the edge of what the oil touches, positive where it does.
    oil_fraction : (n, 2) float, volume fraction of the oil in what touches the wall where oil does, and where not; each
        is known on both sides of the edge, so that colors do not mix across it.
    moved : float, m, by which the edge was moved evenly so that the map holds the measured share of the wall.
    film_distance : (n,) float, m, to the line between what the oil touches and films under it, positive over films, of
        which the map holds the measured share too; None where films are not known.
    """

    contact_distance: np.ndarray
    oil_fraction: np.ndarray
    moved: float
    film_distance: np.ndarray | None = None


class WallMapper:
    """Maps the frames of one eye; made once for its surface.

    Parameters
    ----------
    vertices, triangles : (n, 3) m and (k, 3), the surface of the cavity.
    """

    def __init__(self, vertices: np.ndarray, triangles: np.ndarray):
        self.vertices = np.asarray(vertices, float)
        corners = self.vertices[triangles]
        area = 0.5 * np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
        self.area = np.bincount(triangles.ravel(), np.repeat(area / 3.0, 3), len(self.vertices))
        self.edges = np.unique(np.sort(triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1), axis=0)
        self._tree = cKDTree(self.vertices)
        self._points, self._near = np.zeros((0, 3)), csr_matrix((len(self.vertices), 0))

    def map(self, contact: WallContact, film: WallFilm | None = None) -> WallMap:
        """Map the wall points of one frame, and the films on them where these are known."""
        if not np.array_equal(self._points, contact.position):     # they are the same in every frame of a run
            self._points, self._near = contact.position, self._weights(contact)
        near = self._near
        level = near @ contact.covered - 0.5  # (Z1)
        distance = self._distance_to_line(level)
        if contact.contact_angle is not None:
            line = near @ contact.line_density
            strip = near @ (contact.line_density * contact.strip)
            distance -= np.divide(strip, line, out=np.zeros_like(strip), where=line > 0.0)  # (Z2)
        distance -= (moved := self._even(distance, contact.covered_share()))
        fraction = np.stack([self._fraction(near, contact, side) for side in (True, False)], axis=-1)
        if film is None:
            return WallMap(distance, fraction, moved)
        to_film, under_oil = self._distance_to_line(near @ film.beside_film - 0.5), distance > 0.0
        return WallMap(distance, fraction, moved, to_film - self._even(to_film, film.film_share(), under_oil))

    def _weights(self, contact: WallContact) -> csr_matrix:
        """Shares (n, m) of the wall points in the average at every vertex; a lonely vertex has the nearest point."""
        reach = AVERAGED * contact.particle_spacing
        points = cKDTree(contact.position)
        pairs = self._tree.sparse_distance_matrix(points, reach, output_type="coo_matrix")
        weight = (1.0 - (pairs.data / reach) ** 2) ** 2 * contact.weight[pairs.col]
        total = np.bincount(pairs.row, weight, len(self.vertices))
        lonely = np.flatnonzero(total == 0.0)
        row, column = np.append(pairs.row, lonely), np.append(pairs.col, points.query(self.vertices[lonely])[1])
        total[lonely] = 1.0
        share = np.append(weight, np.ones(len(lonely))) / total[row]
        return csr_matrix((share, (row, column)), (len(self.vertices), len(contact.position)))

    def _distance_to_line(self, level: np.ndarray) -> np.ndarray:
        """Distance (n,) to the line where ``level`` (n,) is zero on the surface, with its sign."""
        one, other = self.edges[(level[self.edges] > 0.0).sum(axis=1) == 1].T
        if not len(one):
            return np.where(level > 0.0, FAR, -FAR)
        along = (level[one] / (level[one] - level[other]))[:, None]
        line = self.vertices[one] + along * (self.vertices[other] - self.vertices[one])
        return np.where(level > 0.0, 1.0, -1.0) * cKDTree(line).query(self.vertices)[0]

    def _even(self, distance: np.ndarray, share: float, part: np.ndarray | None = None) -> float:
        """Distance from the edge beyond which ``share`` of the wall lies, m: small where the wall is well resolved.

        With ``part`` (n,) bool, that share lies in it.
        """
        if np.ptp(distance) == 0.0 or (part is not None and not part.any()):
            return 0.0
        order = np.argsort(-distance)
        if part is not None:
            order = order[part[order]]
        beyond = np.cumsum(self.area[order]) / self.area.sum()
        return float(np.interp(share, np.append(0.0, beyond), np.append(distance[order[0]], distance[order])))

    def _fraction(self, near: csr_matrix, contact: WallContact, side: bool) -> np.ndarray:
        """Average (n,) of the oil's fraction over the wall points that are covered, or over those that are not.

        Where none is near, the nearest such point of the wall gives it.
        """
        there = contact.covered == side
        if not there.any():
            return np.full(len(self.vertices), float(side))
        share, total = near @ np.where(there, contact.oil_fraction, 0.0), near @ there
        far = np.flatnonzero(total == 0.0)
        share[far] = contact.oil_fraction[there][cKDTree(contact.position[there]).query(self.vertices[far])[1]]
        total[far] = 1.0
        return share / total
