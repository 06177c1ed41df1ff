"""Search over explanations: all effects are screened on a few trials, the best are fitted, further effects are
added."""
