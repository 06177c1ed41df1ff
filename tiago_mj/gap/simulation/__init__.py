"""The nominal simulator of recordings, and what it predicts for every row."""
