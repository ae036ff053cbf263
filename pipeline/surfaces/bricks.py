"""Bricks: the coarse cells of a grid near a surface, each divided into fine cells; only they have fine nodes.

A field is a cubic B-spline of coefficients at the coarse nodes. A spline lies between the least and the largest of the
4 x 4 x 4 coefficients around a coarse cell, so a brick in which these have one sign cannot hold any of the surface.
"""
import functools

import numpy as np

BLOCK = 2048            # bricks that are evaluated together: what they read stays in the processor's cache


@functools.cache
def spline_weights(split: int) -> np.ndarray:
    """Weights (split, 4) of the coefficients around a coarse cell at its fine nodes along one axis."""
    return cubic_weights(np.arange(split) / split)


def cubic_weights(part: np.ndarray) -> np.ndarray:
    """Weights (n, 4) of the coefficients around a cell at parts (n,) of it, 0 to 1, along one axis."""
    t = part[:, None]
    return np.hstack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, 1 + 3 * t + 3 * t**2 - 3 * t**3, t**3]) / 6.0


@functools.cache
def brick_weights(split: int) -> np.ndarray:
    """Weights (64, split**3), float32, of the coefficients around a brick at its fine nodes."""
    one = spline_weights(split)
    return np.einsum("ai,bj,ck->ijkabc", one, one, one).reshape(64, split**3).astype(np.float32)


def sliding(extreme: np.ufunc, values: np.ndarray, below: int, above: int) -> np.ndarray:
    """Least or largest value (``np.minimum``, ``np.maximum``) around every node, alike in shape.

    The window is a box from ``below`` nodes below the node to ``above`` above it; values at the border go on beyond it.
    """
    size = below + above + 1
    for axis in range(values.ndim):
        row = np.pad(values, [(below, above) if one == axis else (0, 0) for one in range(values.ndim)], mode="edge")
        reached = 1
        while reached < size:       # windows of 1, 2, 4, ... nodes, the last one of two that overlap
            step = min(reached, size - reached)
            ahead, here = ([slice(None)] * values.ndim for _ in range(2))
            ahead[axis], here[axis] = slice(step, None), slice(None, -step)
            row, reached = extreme(row[tuple(here)], row[tuple(ahead)]), reached + step
        values = row
    return values


def spline_range(coefficients: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Least and largest of the coefficients around every coarse cell, at its lowest node, alike in shape."""
    # The window reaches from one node below the cell to one above it.
    return sliding(np.minimum, coefficients, 1, 2), sliding(np.maximum, coefficients, 1, 2)


class Bricks:
    """Chosen bricks and, behind them, the neighbors that own the nodes on their far faces.

    Parameters
    ----------
    chosen : (nx, ny, nz) bool, at the lowest node of every coarse cell.
    split : fine cells along a coarse cell.

    Attributes
    ----------
    corner : (n, 3) coarse indices of all bricks, the ``count`` chosen ones first.
    number : (nx, ny, nz) number of each brick, -1 where there is none.
    """

    def __init__(self, chosen: np.ndarray, split: int):
        self.split, self.coarse_shape = split, chosen.shape
        wanted = chosen.copy()
        for axis in range(3):
            wanted[_slice(axis, 1, None)] |= wanted[_slice(axis, None, -1)]
        flat = np.concatenate([np.flatnonzero(chosen), np.flatnonzero(wanted & ~chosen)])
        self.count = int(chosen.sum())
        self.corner = np.stack(np.unravel_index(flat, chosen.shape), axis=1)
        self.number = np.full(chosen.shape, -1, np.int32)
        self.number.ravel()[flat] = np.arange(len(flat), dtype=np.int32)

    def nodes(self, chosen: np.ndarray) -> np.ndarray:
        """Nodes (split + 1, split + 1, split + 1, n) of chosen bricks (n,): owner * split**3 + place in it."""
        split, (i, j, k) = self.split, self.corner[chosen].T
        nodes = np.empty((*[split + 1] * 3, len(chosen)), np.int32)
        own = np.arange(split**3, dtype=np.int32).reshape([split] * 3)
        for far in np.ndindex(2, 2, 2):
            owner = self.number[i + far[0], j + far[1], k + far[2]]
            into = tuple(slice(split, None) if one else slice(0, split) for one in far)
            place = own[tuple(slice(0, 1) if one else slice(None) for one in far)]
            nodes[into] = owner * split**3 + place[..., None]
        return nodes

    def sample(self, coefficients: np.ndarray) -> np.ndarray:
        """Spline at the nodes of all bricks, (n * split**3,) float32."""
        padded = np.pad(coefficients.astype(np.float32, copy=False), (1, 2), mode="edge")
        windows = np.lib.stride_tricks.sliding_window_view(padded, (4, 4, 4))
        values = np.empty((len(self.corner), self.split**3), np.float32)
        for first in range(0, len(values), BLOCK):
            some = slice(first, first + BLOCK)
            values[some] = windows[tuple(self.corner[some].T)].reshape(-1, 64) @ brick_weights(self.split)
        return values.ravel()

    def fine_indices(self, nodes: np.ndarray) -> np.ndarray:
        """Indices (..., 3) of nodes in the fine grid over all."""
        owner, place = np.divmod(nodes, self.split**3)
        return self.corner[owner] * self.split + np.stack(np.unravel_index(place, [self.split] * 3), axis=-1)

    def find(self, fine: np.ndarray) -> np.ndarray:
        """Nodes (m,) with given indices (m, 3) in the fine grid, -1 where no brick has them."""
        corner, place = np.divmod(fine, self.split)
        owner = self.number[tuple(corner.T)].astype(np.int64)
        return np.where(owner < 0, -1, owner * self.split**3 + np.ravel_multi_index(tuple(place.T), [self.split] * 3))


def _slice(axis: int, start: int | None, stop: int | None) -> tuple[slice, ...]:
    parts = [slice(None)] * 3
    parts[axis] = slice(start, stop)
    return tuple(parts)
