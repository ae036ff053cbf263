"""From particles to the surfaces of the liquids, and their files."""
