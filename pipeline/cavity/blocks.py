"""Where the blocks of liquid are that a container holds at the start."""
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from pipeline.scenes.model import Block


def contains(block: "Block", points: np.ndarray) -> np.ndarray:
    """Whether points (n, D), m, lie in a block, (n,): between its corners, and within the round shape they bound."""
    lower, upper = np.asarray(block.lower), np.asarray(block.upper)
    inside = np.logical_and.reduce((points > lower) & (points < upper), axis=1)
    scaled = (points - 0.5 * (lower + upper)) / (0.5 * (upper - lower))
    if block.shape.startswith("cylinder_"):
        scaled = np.delete(scaled, "xyz".index(block.shape[-1]), axis=1)
    if block.shape != "box":
        inside &= (scaled**2).sum(axis=1) < 1.0
    return inside
