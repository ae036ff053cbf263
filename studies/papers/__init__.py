"""What others have published, repeated."""
