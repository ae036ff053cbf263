"""The pipeline for notebooks: runs by the rules of the Snakefile, and their results as objects of Python."""
