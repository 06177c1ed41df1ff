"""Detectors: quantization, ripples, swings, tones, offsets and executed set points, from readings without any fit."""
