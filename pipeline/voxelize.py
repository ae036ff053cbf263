"""Stage: from the closed surface of the cavity to liquid particles, wall particles and a signed distance grid."""
from pipeline.shapes import initial_arrays, shape_arrays

__all__ = ["initial_arrays", "shape_arrays"]
