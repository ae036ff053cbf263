"""The cavity and what fills it at the start: surface, signed distance, wall particles, liquid particles."""
