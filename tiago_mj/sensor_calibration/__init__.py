"""Noise, threshold and scale of a user's own load cells, from recordings of rest and of grasps.

As the TA11 was described (paper, section III-B): ``f_raw = scale · f_contact + noise``, ``f_binary = f_raw >
threshold``, with the noise taken from readings without contact, and the scale such that the simulator's readings have
the real range.
"""

from tiago_mj.sensor_calibration.rest import FALSE_CONTACTS, Rest, at_rest
from tiago_mj.sensor_calibration.scale import Scale, scales
from tiago_mj.sensor_calibration.sheet import Calibration, calibrate, text

__all__ = ["FALSE_CONTACTS", "Calibration", "Rest", "Scale", "at_rest", "calibrate", "scales", "text"]
