"""Scenes: from YAML, checked, to one frozen record in SI units."""
