"""What a fill touches in eyes of other shapes, those of patients among them."""
