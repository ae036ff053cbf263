"""What the validation is made of: tanks, fits of interfaces, exact shapes, hard cases."""
