"""Effects of the blind check's reality, written from physics and from the contract's text alone."""
