"""What oil at rest touches: the contact line, covered shares of wall and retina, and how far points are from the line.

Equations: docs/methods/equilibrium.md.
"""
import dataclasses
import functools

import numpy as np
from scipy.spatial import cKDTree

from pipeline.cavity.rays import interpolation
from pipeline.cavity.regions import retina_parts
from pipeline.equilibrium.rest import Rest
from pipeline.equilibrium.star_cavity import StarCavity

NEAREST = 8             # segments of the contact line tried for a point
NO_LINE = 1.0           # m: the distance to the line where there is none
HIDDEN = 1e-3           # m, behind the wall that a point sees: it does not see what lies there


@dataclasses.dataclass(frozen=True)
class Contact:
    """The contact line on the triangles of a wall.

    Attributes
    ----------
    cavity : the wall.
    depth : (n,), m, of ``Rest``: its zero is the contact line.
    """

    cavity: StarCavity
    depth: np.ndarray

    @classmethod
    def of(cls, rest: Rest) -> "Contact":
        """Read oil at rest."""
        return cls(rest.cavity, rest.depth)

    def on(self, cavity: StarCavity) -> "Contact":
        """Return the same line on the wall as another point sees it; what this one does not see is bare."""
        if cavity is self.cavity:
            return self
        own = self.cavity
        arm = cavity.wall - own.viewpoint
        far = np.linalg.norm(arm, axis=1)
        corners, weights = interpolation(own.wall - own.viewpoint, own.faces, arm / far[:, None])
        depth, radius = ((values[corners] * weights).sum(axis=1) for values in (self.depth, own.radius))
        return Contact(cavity, np.where(far < radius + HIDDEN, depth, -NO_LINE))

    @functools.cached_property
    def touched(self) -> np.ndarray:
        """Share of every triangle of the wall that the oil touches, (m,): the depth is linear on a triangle."""
        return positive_share(self.depth[self.cavity.faces])

    def share(self, mask: np.ndarray | None = None) -> float:
        """Return the covered share of the wall, or of the triangles in a mask (m,)."""
        area = self.cavity.face_area if mask is None else self.cavity.face_area * mask
        return float(area @ self.touched / area.sum())

    @functools.cached_property
    def line(self) -> np.ndarray:
        """Segments of the contact line on the wall, (k, 2, 3), m."""
        faces, wall = self.cavity.faces, self.cavity.wall
        crossed = faces[(self.depth[faces].max(axis=1) > 0.0) & (self.depth[faces].min(axis=1) <= 0.0)]
        sides = []
        for start, end in ((0, 1), (1, 2), (2, 0)):
            a, b = crossed[:, start], crossed[:, end]
            crosses = (self.depth[a] > 0.0) != (self.depth[b] > 0.0)
            share = self.depth[a] / np.where(crosses, self.depth[a] - self.depth[b], 1.0)
            sides.append(np.where(crosses[:, None], wall[a] + share[:, None] * (wall[b] - wall[a]), np.nan))
        # Of every triangle two of the three edges are crossed.
        ends = np.stack(sides, axis=1)
        return ends[np.isfinite(ends[..., 0])].reshape(-1, 2, 3)

    @functools.cached_property
    def margin(self) -> np.ndarray:
        """Distance of the points of the wall to the contact line, (n,), m: positive where the oil touches. (R7)"""
        side = np.where(self.depth > 0.0, 1.0, -1.0)
        if not len(self.line):
            return NO_LINE * side
        wall, (start, end) = self.cavity.wall, np.moveaxis(self.line, 1, 0)
        count = min(NEAREST, len(start))
        near = cKDTree(0.5 * (start + end)).query(wall, k=count)[1].reshape(len(wall), count)
        edge, arm = (end - start)[near], wall[:, None] - start[near]
        along = np.clip((arm * edge).sum(-1) / np.maximum((edge**2).sum(-1), 1e-30), 0.0, 1.0)
        return side * np.sqrt(((arm - along[..., None] * edge) ** 2).sum(-1).min(axis=1))

    def arc(self) -> float:
        """Return the covered arc of the wall in the plane x = 0, in degrees around the origin."""
        faces, wall = self.cavity.faces, self.cavity.wall
        edges = np.unique(np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1),
                          axis=0)
        # Points in the plane itself belong to the side of positive x.
        a, b = edges[(wall[edges[:, 0], 0] < 0.0) != (wall[edges[:, 1], 0] < 0.0)].T
        share = wall[a, 0] / (wall[a, 0] - wall[b, 0])
        point = wall[a] + share[:, None] * (wall[b] - wall[a])
        angle, depth = np.arctan2(point[:, 1], point[:, 2]), self.depth[a] + share * (self.depth[b] - self.depth[a])
        order = np.argsort(angle)
        angle, depth = angle[order], depth[order]
        width, following = np.diff(angle, append=angle[0] + 2.0 * np.pi), np.roll(depth, -1)
        low, high = np.minimum(depth, following), np.maximum(depth, following)
        covered = np.where(low > 0.0, 1.0, np.where(high <= 0.0, 0.0, high / np.maximum(high - low, 1e-30)))
        return float(np.degrees(width @ covered))


def retina_masks(cavity: StarCavity) -> dict[str, np.ndarray]:
    """Triangles of the retina and its parts, name -> (m,) bool, as those of the wall particles of a run."""
    parts = retina_parts(cavity.wall[cavity.faces].mean(axis=1))
    return {"retina": parts.pop("whole")} | parts


def shares(contact: Contact) -> dict[str, float]:
    """Return the covered shares of the wall and of the parts of the retina."""
    masks = retina_masks(contact.cavity)
    return {"wall": contact.share()} | {name: contact.share(mask) for name, mask in masks.items()}


def positive_share(values: np.ndarray) -> np.ndarray:
    """Share of triangles in which a linear function is positive, (m,), from its values at the corners (m, 3)."""
    low, middle, high = np.sort(values, axis=1).T
    with np.errstate(divide="ignore", invalid="ignore"):
        tip = high**2 / ((high - low) * (high - middle))
        rest = 1.0 - low**2 / ((high - low) * (middle - low))
    return np.select([low > 0.0, high <= 0.0, middle <= 0.0], [1.0, 0.0, tip], rest)
