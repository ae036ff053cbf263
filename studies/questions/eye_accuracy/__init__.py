"""How far the numbers of the eye are from those of finer particles."""
