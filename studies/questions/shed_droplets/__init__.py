"""How many droplets oil sheds, and where they gather."""
