"""Simulators drawn from what a diagnosis leaves possible: explanations, magnitudes and numbers of the model."""
