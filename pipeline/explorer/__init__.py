"""One page in which fill, posture and oil are moved, and what the oil at rest touches is seen at once."""
