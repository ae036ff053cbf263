"""The numbers that are published: tables in ``docs/results``, and what brings new numbers into them."""
