"""Files that other programs open: an index of a run, a view of it for ParaView, and mesh formats."""
