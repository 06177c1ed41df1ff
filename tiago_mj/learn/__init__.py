"""Learning: ``tiago-mj train``, its settings, loop, checkpoints, curves and agents."""
