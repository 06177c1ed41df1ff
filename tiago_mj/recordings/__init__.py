"""Recordings: in memory, on disk, read from other formats, linted and cut into trials."""
