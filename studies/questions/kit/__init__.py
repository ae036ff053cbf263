"""What several questions share: eyes at rest, their pictures, and the names in their tables."""
