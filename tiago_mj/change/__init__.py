"""What changed between two sets of recordings of one robot: the differences are fitted, not the recordings."""
