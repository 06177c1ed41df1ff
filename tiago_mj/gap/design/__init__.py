"""Which motion to record: what recordings can tell, and which motion would tell more."""
