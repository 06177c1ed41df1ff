"""Input and output: bounded readers, atomic writers, quoting, schemas, progress, deadlines."""
