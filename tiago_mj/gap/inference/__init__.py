"""Noise, likelihood, priors and fits: how well an explanation predicts what was recorded."""
