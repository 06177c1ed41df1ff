"""One module for each target: how it holds what, and the text that it is given."""
