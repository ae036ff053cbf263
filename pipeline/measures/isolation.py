"""Which particles are alone in another liquid."""
import numpy as np
from scipy.spatial import cKDTree

ISOLATED = 0.9      # share of the neighbors in another liquid, above which a particle is alone there


def isolated(position: np.ndarray, phase: np.ndarray, liquids: int, support_radius: float, least_neighbors: float = 1.0
             ) -> np.ndarray:
    """Mask (n,) of the particles that are surrounded by one other liquid; particles (n, D) m, phases (n,).

    Those with fewer than ``least_neighbors`` do not count.
    """
    pairs = cKDTree(position).query_pairs(support_radius, output_type="ndarray")
    flat = np.concatenate([pairs[:, 0] * liquids + phase[pairs[:, 1]], pairs[:, 1] * liquids + phase[pairs[:, 0]]])
    neighbors = np.bincount(flat, minlength=len(position) * liquids).reshape(len(position), liquids)
    total = neighbors.sum(axis=1)
    neighbors[np.arange(len(position)), phase] = 0
    return (total >= least_neighbors) & (neighbors.max(axis=1, initial=0) > ISOLATED * total)
