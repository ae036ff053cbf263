"""How oil of every viscosity moves in the eye, and how it drags at the retina."""
