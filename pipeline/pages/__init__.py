"""What the page of a run is made of: numbers, movie, timeline, maps of the fundus, surfaces over time."""
