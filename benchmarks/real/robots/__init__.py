"""One module a robot: readers of its published files, nominal models, regressions, cases."""
