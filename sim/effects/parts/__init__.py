"""Parts that effects are made of; none is an effect by itself."""
