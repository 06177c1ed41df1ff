"""Which explanations are fitted: screening, starts, combinations and refinement."""
