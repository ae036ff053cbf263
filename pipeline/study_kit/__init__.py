"""What studies are made of: cases, tanks, hard cases, exact shapes, the figures of cost against accuracy."""
