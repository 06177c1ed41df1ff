"""Which explanations are fitted: a first pass over all effects, then rounds of additions."""
