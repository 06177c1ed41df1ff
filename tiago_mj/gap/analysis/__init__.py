"""Analysis of the gap: where it lies, how much of it is closed, what it costs on the task, and what is left."""
