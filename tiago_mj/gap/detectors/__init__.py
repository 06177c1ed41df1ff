"""Detectors: quantization, ripples, tones, offsets and executed set points, from the readings without any fit."""
