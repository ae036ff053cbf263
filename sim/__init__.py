"""Multiphase SPH solver: takes arrays and a validated scene, never paths or YAML."""
