"""Efforts along a measured motion: another predictor for recordings without commands."""
