"""How much of the wall the oil touches, and where."""
import dataclasses

import numpy as np
from scipy.spatial import cKDTree

RETINA_ANGLE = np.radians(115.0)  # from the posterior pole to the ora serrata
MACULA_RADIUS = 2.75e-3           # m, disc at the posterior pole


@dataclasses.dataclass(frozen=True)
class WallContact:
    """The inner layer of wall particles, each covered by the oil or not.

    A wall point is covered if the nearest fluid within one support radius is mostly oil. The origin is the center of
    the globe; x points to the patient's left, y up to the head, z forward along the optic axis.

    Attributes
    ----------
    position : (m, D) float, m, wall points in one layer.
    weight : (m,) float, in proportion to the area that a point stands for.
    covered : (m,) bool.
    particle_spacing : float, m.
    """

    position: np.ndarray
    weight: np.ndarray
    covered: np.ndarray
    particle_spacing: float

    @classmethod
    def of(cls, initial, position, oil_fraction, *, particle_spacing: float, support_radius: float) -> "WallContact":
        """Find the covered wall points.

        Parameters
        ----------
        initial : arrays of ``initial.npz``.
        position, oil_fraction : (n, D) in m and (n,), the fluid.
        """
        inner = initial["wall_distance"] < particle_spacing
        wall = initial["wall_position"][inner]
        covered = np.zeros(len(wall), bool)
        if len(position):
            distance, nearest = cKDTree(position).query(wall, distance_upper_bound=support_radius)
            near = np.isfinite(distance)
            covered[near] = oil_fraction[nearest[near]] > 0.5
        return cls(wall, initial["wall_volume"][inner], covered, particle_spacing)

    def covered_share(self, mask: np.ndarray | None = None) -> float:
        """Return the covered share of the wall, or of the part in ``mask`` (m,); NaN when that part has no points."""
        weight = self.weight if mask is None else self.weight * mask
        return float((weight * self.covered).sum() / weight.sum()) if weight.any() else np.nan

    def band_share(self) -> float:
        """Return the share of the wall within one particle spacing of the contact line."""
        if self.covered.all() or not self.covered.any():
            return 0.0
        reach = 1.5 * self.particle_spacing
        touching = np.zeros(len(self.covered), bool)
        for side in (self.covered, ~self.covered):
            distance = cKDTree(self.position[~side]).query(self.position[side], distance_upper_bound=reach)[0]
            touching[np.flatnonzero(side)[np.isfinite(distance)]] = True
        return float(self.weight[touching].sum() / self.weight.sum())

    def contact_arc(self) -> float:
        """Return the covered arc in the sagittal plane (in 2D: in the plane), in degrees around the center."""
        plane = self.position
        covered = self.covered
        if self.position.shape[1] == 3:
            near = np.abs(self.position[:, 0]) < self.particle_spacing
            plane, covered = self.position[near][:, 1:], covered[near]
        if not len(plane):
            return np.nan
        angle = np.arctan2(plane[:, 0], plane[:, 1])
        order = np.argsort(angle)
        # A point stands for the half of the gap on either side.
        gap = np.diff(angle[order], append=angle[order[0]] + 2 * np.pi)
        width = 0.5 * (gap + np.roll(gap, 1))
        return float(np.degrees(width[covered[order]].sum()))

    def retina_masks(self) -> dict[str, np.ndarray]:
        """Return the wall points of the retina and its parts, name -> (m,) bool; all empty in 2D."""
        if self.position.shape[1] == 2:
            return dict.fromkeys(("whole", "superior", "inferior", "macula"), np.zeros(len(self.position), bool))
        x, y, z = self.position.T
        retina = np.arccos(-z / np.linalg.norm(self.position, axis=1)) <= RETINA_ANGLE
        return {"whole": retina, "superior": retina & (y > 0), "inferior": retina & (y < 0),
                "macula": retina & (z < 0) & (np.hypot(x, y) <= MACULA_RADIUS)}

