"""Which motion to record next: the one that most probably tells what recordings leave open."""
