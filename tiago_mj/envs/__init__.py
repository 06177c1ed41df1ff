"""Environments: one base, one file a task."""

from tiago_mj.io import hushed

hushed.import_gymnasium_robotics()
