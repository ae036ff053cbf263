"""The solver beside exact solutions, and in cases that are hard on it."""
