"""What is measured of a frame, and the plots and pages of it."""
