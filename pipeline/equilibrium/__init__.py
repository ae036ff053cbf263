"""The shape of the oil at rest in any cavity that can be seen from one point: the least energy at exact volume."""
