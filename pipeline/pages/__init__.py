"""What the page of a run is made of: numbers, events, curves, pictures to scrub through and a view that turns."""
