"""How a run came about, told with its results so that they can be checked elsewhere: an RO-Crate."""
