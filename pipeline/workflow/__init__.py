"""What the Snakefile asks: scenes, studies, and what a stage depends on."""
