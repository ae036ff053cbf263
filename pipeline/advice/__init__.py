"""What can be said of a scene before it is run: numbers, limits, advice on its effects."""
