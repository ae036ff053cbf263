"""What a scene will cost, from a few of its own steps."""
