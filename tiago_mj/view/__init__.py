"""Robots in a browser: an environment live, recordings beside their simulators, and both as a file."""
