"""How much of the wall the oil touches, and where.

The label of the nearest liquid alone says too much: where the interface meets the wall at an angle theta, the wedge
between them is thinner than the depth h of that particle on a strip of width h / tan(theta), and is not seen. That
strip is taken off along the contact line. Particles labelled by the exact shape of oil in a sphere at 18.2 degrees,
85 %, R/dx 8, are read 7 points too high without it, and 0.4 too low with it.
Equations: docs/methods/measures.md.
"""
import dataclasses
import functools

import numpy as np
from scipy.spatial import cKDTree

from pipeline.cavity.regions import retina_parts
from pipeline.cavity.signed_distance_grid import SignedDistance

LINE_REACH = 4.0                  # particle spacings: the ragged line of labels is as long as that of the exact shape


@dataclasses.dataclass(frozen=True)
class WallContact:
    """The inner layer of wall particles, each above oil or not.

    A wall point is covered if the nearest fluid within one support radius is mostly oil; of what is covered, the shares
    below leave out the strip under a wedge that is too thin for a particle. The origin is the center of the globe; x
    points to the patient's left, y up to the head, z forward along the optic axis.

    Attributes
    ----------
    position : (m, D) float, m, wall points in one layer.
    weight : (m,) float, in proportion to the area that a point stands for.
    oil_fraction : (m,) float, volume fraction of the oil in the nearest fluid within one support radius, 0 without.
    depth : (m,) float, m, of the nearest fluid below the wall.
    particle_spacing : float, m.
    contact_angle : float, rad, through the other liquid; None where the scene has none, and nothing is left out.
    """

    position: np.ndarray
    weight: np.ndarray
    oil_fraction: np.ndarray
    depth: np.ndarray
    particle_spacing: float
    contact_angle: float | None

    @classmethod
    def of(cls, initial, position, oil_fraction, *, particle_spacing: float, support_radius: float,
           contact_angle: float | None) -> "WallContact":
        """Find the covered wall points.

        Parameters
        ----------
        initial : arrays of ``initial.npz``.
        position, oil_fraction : (n, D) in m and (n,), the fluid.
        contact_angle : rad, through the other liquid; None where the scene has none.
        """
        inner = initial["wall_distance"] < particle_spacing
        wall = initial["wall_position"][inner]
        nearest_fraction, depth = np.zeros(len(wall)), np.zeros(len(wall))
        if len(position):
            distance, nearest = cKDTree(position).query(wall, distance_upper_bound=support_radius)
            near = np.isfinite(distance)
            nearest_fraction[near] = oil_fraction[nearest[near]]
            signed = SignedDistance(initial["sdf_values"], initial["sdf_origin"], float(initial["sdf_cell"]))
            depth[near] = np.maximum(-signed.sample(position[nearest[near]]), 0.0)
        return cls(wall, initial["wall_volume"][inner], nearest_fraction, depth, particle_spacing, contact_angle)

    @functools.cached_property
    def covered(self) -> np.ndarray:
        """Whether the nearest fluid is mostly oil, (m,)."""
        return self.oil_fraction > 0.5

    @functools.cached_property
    def strip(self) -> np.ndarray:
        """Width of the strip under the wedge that is too thin for a particle, (m,), m, where a contact line is near."""
        reach = LINE_REACH * self.particle_spacing  # a wider strip is not known from its line
        return np.clip(self.depth / np.tan(max(self.contact_angle or 0.0, 1e-6)), -reach, reach)

    @functools.cached_property
    def line_density(self) -> np.ndarray:
        """Length of the contact line per area of the wall around every point, (m,), 1/m (in 2D: lines per length).

        From the share q of the wall within a radius H that is on the other side: around a straight line the integral of
        q is 4 H / (3 pi) of its length (2D: H / 2).
        """
        reach, count = LINE_REACH * self.particle_spacing, len(self.position)
        one, other = cKDTree(self.position).query_pairs(reach, output_type="ndarray").T
        apart = self.covered[one] != self.covered[other]
        across, around = np.zeros(count), self.weight.copy()
        for here, there in ((one, other), (other, one)):
            across += np.bincount(here, self.weight[there] * apart, count)
            around += np.bincount(here, self.weight[there], count)
        whole = {2: 0.5, 3: 4.0 / (3.0 * np.pi)}[self.position.shape[1]]
        return across / around / (whole * reach)  # (Q2)

    @functools.cached_property
    def touched(self) -> np.ndarray:
        """Share of the wall around every point that the oil touches, (m,): it counts in sums over several points."""
        if self.contact_angle is None:
            return self.covered.astype(float)
        return self.covered - self.strip * self.line_density  # (Q1)

    def covered_share(self, mask: np.ndarray | None = None) -> float:
        """Return the covered share of the wall, or of the part in ``mask`` (m,); NaN when that part has no points.

        Oil in patches smaller than the strip around them touches nothing.
        """
        weight = self.weight if mask is None else self.weight * mask
        return float(np.clip((weight * self.touched).sum() / weight.sum(), 0.0, 1.0)) if weight.any() else np.nan

    @functools.cached_property
    def near_line(self) -> np.ndarray:
        """The wall points within one particle spacing of the contact line, (m,) bool."""
        near = np.zeros(len(self.covered), bool)
        if self.covered.all() or not self.covered.any():
            return near
        reach = 1.5 * self.particle_spacing
        for side in (self.covered, ~self.covered):
            distance = cKDTree(self.position[~side]).query(self.position[side], distance_upper_bound=reach)[0]
            near[np.flatnonzero(side)[np.isfinite(distance)]] = True
        return near

    def band_share(self, mask: np.ndarray | None = None) -> float:
        """Return the share of the wall, or of the part in ``mask`` (m,), within one particle spacing of the line."""
        weight = self.weight if mask is None else self.weight * mask
        return float(weight[self.near_line].sum() / weight.sum()) if weight.any() else np.nan

    def contact_arc_band(self) -> float:
        """Return the arc of the sagittal plane within one particle spacing of the contact line, in degrees."""
        near = np.abs(self.position[:, 0]) < self.particle_spacing
        if not near.any():
            return np.nan
        touched, angle = self.near_line[near], np.arctan2(*self.position[near, 1:].T)
        order = np.argsort(angle)
        # A point stands for the half of the gap on either side.
        gap = np.diff(angle[order], append=angle[order[0]] + 2 * np.pi)
        width = 0.5 * (gap + np.roll(gap, 1))
        return float(np.degrees(np.clip(width @ touched[order], 0.0, 2 * np.pi)))

    def retina_masks(self) -> dict[str, np.ndarray]:
        """Return the wall points of the retina and its parts, name -> (m,) bool."""
        return retina_parts(self.position)

    def quadrant_masks(self, right_eye: bool = True) -> dict[str, np.ndarray]:
        """Return the wall points of the quadrants of the retina, name -> (m,) bool."""
        x, y = self.position[:, 0], self.position[:, 1]
        retina, temporal = self.retina_masks()["whole"], (x < 0.0) == right_eye
        return {f"{up}_{side}": retina & ((y > 0.0) == (up == "superior")) & (temporal == (side == "temporal"))
                for up in ("superior", "inferior") for side in ("temporal", "nasal")}
