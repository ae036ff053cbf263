"""Energy and volume of oil whose surface is a distance from a viewpoint in every direction, with all derivatives.

Lengths are in radii of a ball as large as the cavity, energies in tension times its square.
Equations: docs/methods/equilibrium.md.
"""
import dataclasses

import numpy as np
import scipy.sparse

from pipeline.equilibrium.star_cavity import StarCavity
from pipeline.equilibrium.wetting import TRANSITION, Wetting

NEXT, LAST = (1, 2, 0), (2, 0, 1)  # the other two corners of a triangle, counterclockwise


@dataclasses.dataclass(frozen=True)
class Derivatives:
    """Derivatives of energy and volume by the n distances.

    Attributes
    ----------
    energy, volume : (n,).
    energy_bend, volume_bend : second derivatives between the corners of every triangle, (m, 3, 3).
    """

    energy: np.ndarray
    volume: np.ndarray
    energy_bend: np.ndarray
    volume_bend: np.ndarray


class Energy:
    """Energy of oil in a cavity.

    Parameters
    ----------
    cavity : its wall.
    contact_angle : through the other liquid, rad.
    bond : (3,), density of the other liquid less that of the oil, times the vector of gravity and the square of the
        length, over the tension.
    """

    def __init__(self, cavity: StarCavity, contact_angle: float, bond: np.ndarray):
        self.cavity, self.faces, self.direction, self.solid = cavity, cavity.faces, cavity.direction, cavity.solid
        self.length = length_of(cavity)
        self.radius = cavity.radius / self.length
        self.wetting = Wetting(contact_angle, TRANSITION * cavity.edge / self.length)
        self.weight = self.direction @ bond  # of a unit volume, per distance
        self.size = len(self.radius)
        self.share = np.bincount(self.faces.ravel(), np.repeat(self.solid, 3), self.size) / 6.0
        self._rows, self._columns = np.repeat(self.faces, 3, axis=1).ravel(), np.tile(self.faces, (1, 3)).ravel()

    def gap(self, distance: np.ndarray) -> np.ndarray:
        """Distance of the oil to the wall next to it, (n,): along the normal of the wall, while it is small."""
        return (self.radius - distance) * self.cavity.slope

    def volume(self, distance: np.ndarray) -> float:
        """Volume of the oil."""
        return float(self.solid @ distance[self.faces].prod(axis=1)) / 6.0  # (R2)

    def value(self, distance: np.ndarray) -> float:
        """Energy of the oil."""
        r = distance[self.faces]
        point = r[..., None] * self.direction[self.faces]
        area = 0.5 * np.linalg.norm(np.cross(point[:, 1] - point[:, 0], point[:, 2] - point[:, 0]), axis=1)
        tension = self.wetting.tension(self.gap(distance))[0][self.faces].mean(axis=1)
        volume, weight = self.solid * r.prod(axis=1) / 6.0, 0.25 * (r * self.weight[self.faces]).sum(axis=1)
        return float(area @ tension + volume @ weight)  # (R1)

    def derivatives(self, distance: np.ndarray) -> Derivatives:
        """First and second derivatives of energy and volume."""
        r, direction = distance[self.faces], self.direction[self.faces]
        point = r[..., None] * direction
        normal = np.cross(point[:, 1] - point[:, 0], point[:, 2] - point[:, 0])
        double = np.linalg.norm(normal, axis=1)
        normal /= double[:, None]
        w, slope, bend = self.wetting.tension(self.gap(distance))
        steepness = self.cavity.slope
        tension = w[self.faces].mean(axis=1)
        tension_1, tension_2 = (-slope * steepness)[self.faces] / 3.0, (bend * steepness**2)[self.faces] / 3.0
        volume, weight = self.solid * r.prod(axis=1) / 6.0, 0.25 * (r * self.weight[self.faces]).sum(axis=1)
        weight_1 = 0.25 * self.weight[self.faces]
        # The normal is of first order in every distance, so its derivatives are short.
        turn = np.stack([np.cross(direction[:, k], point[:, NEXT[k]] - point[:, LAST[k]]) for k in range(3)], axis=1)
        along = np.einsum("mi,mki->mk", normal, turn)
        area, area_1 = 0.5 * double, 0.5 * along
        volume_1 = self.solid[:, None] / 6.0 * r[:, NEXT] * r[:, LAST]
        first = (area_1 * tension[:, None] + area[:, None] * tension_1
                 + volume_1 * weight[:, None] + volume[:, None] * weight_1)
        area_2 = (np.einsum("mki,mli->mkl", turn, turn) - along[:, :, None] * along[:, None]) / double[:, None, None]
        volume_2 = np.zeros_like(area_2)
        for k in range(3):
            j = NEXT[k]
            mixed = (normal * np.cross(direction[:, k], direction[:, j])).sum(axis=1)
            area_2[:, k, j] += mixed
            area_2[:, j, k] += mixed
            volume_2[:, k, j] = volume_2[:, j, k] = self.solid / 6.0 * r[:, LAST[k]]
        second = 0.5 * area_2 * tension[:, None, None] + volume_2 * weight[:, None, None]
        for one, other in ((area_1, tension_1), (volume_1, weight_1)):
            second += one[:, :, None] * other[:, None] + other[:, :, None] * one[:, None]
        second[:, range(3), range(3)] += area[:, None] * tension_2
        return Derivatives(self._gathered(first), self._gathered(volume_1), second, volume_2)

    def matrix(self, bends: np.ndarray) -> scipy.sparse.csr_matrix:
        """Sparse matrix (n, n) of second derivatives between corners, (m, 3, 3)."""
        return scipy.sparse.csr_matrix((bends.ravel(), (self._rows, self._columns)), shape=(self.size, self.size))

    def _gathered(self, corners: np.ndarray) -> np.ndarray:
        return np.bincount(self.faces.ravel(), corners.ravel(), self.size)


def length_of(cavity: StarCavity) -> float:
    """Radius of a ball as large as the cavity, m."""
    return float((0.75 * cavity.volume / np.pi) ** (1.0 / 3.0))
