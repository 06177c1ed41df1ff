"""Environments: one base, one file a task."""
