"""From the evidence for explanations to a verdict."""
