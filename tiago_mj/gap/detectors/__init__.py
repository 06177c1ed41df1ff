"""What readings show by themselves: grids, ripples, hums, offsets, and the set points that servos executed."""
