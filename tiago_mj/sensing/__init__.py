"""From contact forces to load-cell readings."""
