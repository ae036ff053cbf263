"""The stages of the pipeline: scene, eye, voxelize, simulate, reconstruct, render, movie, metrics."""
import os

# Every stage prints only what its user asked for; taichi reads this when it is imported.
os.environ.setdefault("ENABLE_TAICHI_HEADER_PRINT", "0")
