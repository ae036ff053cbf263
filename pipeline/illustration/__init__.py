"""The illustration of an eye: whole, opened, with what is simulated in it, for readers who know no sections."""
