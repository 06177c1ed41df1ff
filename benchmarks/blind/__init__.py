"""The blind check: an independent reality, sealed labels, and the scores of a diagnosis that never saw them."""
