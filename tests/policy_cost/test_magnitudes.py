"""Magnitudes: drawn from the intervals that a calibration has."""

import numpy as np
import pytest
from toy import BACKLASH, PAYLOAD

from tiago_mj.effects import EFFECTS
from tiago_mj.policy_cost.magnitudes import NUMBERS, draws, items_of

CALIBRATION = """\
schema: tiago_mj.calibration/1
robot: GripperTactile-v0
effects:
- {name: backlash, target: [gripper_right_finger_joint], parameters: {width: {value: 0.001}}}
- {name: payload, target: all, parameters: {mass: {value: 0.2, low: 0.1, high: 0.5, unit: kg}}}
numbers:
- {name: armature, target: all, parameters: {mass: {value: 0.2, low: 0.1, high: 0.3, unit: kg}}}
- {name: servo_stiffness, target: all, parameters: {factor: {value: 2.0, low: 1.0, high: 3.0, unit: '-'}}}
"""


def values(drawn, place, name):
    return np.array([items[place].entries[0].parameters[name] for items in drawn])


def test_a_calibrations_effects_are_items_each_and_its_numbers_are_one(tmp_path):
    (tmp_path / "calibration.yaml").write_text(CALIBRATION)
    items = items_of(tmp_path)
    assert [item.label for item in items] == ["backlash on gripper_right_finger_joint", "payload", NUMBERS]
    assert [item.uncertain for item in items] == [False, True, True]
    assert items[0].magnitude == "0.001"
    assert items[1].magnitude == "0.2 kg (0.1 kg to 0.5 kg)"
    assert items[2].magnitude == "2 of the model's own"
    assert [entry.name for entry in items[2].entries] == ["armature", "servo_stiffness"]
    assert len(items_of(tmp_path / "calibration.yaml", numbers=False)) == 2


def test_draws_have_the_interval_that_was_fitted():
    factor = {"name": "servo_stiffness", "parameters": {"factor": {"value": 1.5, "low": 1.2, "high": 1.8}}}
    drawn = draws(items_of([PAYLOAD, factor]), 2000, 0)
    mass, stiffness = values(drawn, 0, "mass"), values(drawn, 1, "factor")
    assert np.quantile(mass, [0.05, 0.5, 0.95]) == pytest.approx([1.9, 2.0, 2.1], abs=0.005)
    assert np.quantile(stiffness, [0.05, 0.5, 0.95]) == pytest.approx([1.2, 1.5, 1.8], abs=0.01)
    assert abs(np.corrcoef(mass, stiffness)[0, 1]) < 0.05


def test_few_draws_cover_a_magnitudes_whole_probability():
    mass = np.sort(values(draws(items_of([PAYLOAD]), 10, 5), 0, "mass"))
    deciles = 2.0 + 0.1 / 1.645 * np.array([-1.2816, -0.8416, -0.5244, -0.2533, 0, 0.2533, 0.5244, 0.8416, 1.2816])
    assert np.searchsorted(mass, deciles).tolist() == list(range(1, 10))  # one in each tenth


def test_no_draw_is_beyond_what_an_effect_may_be():
    near_zero = {"name": "backlash", "parameters": {"width": {"value": 0.001, "low": 0.0, "high": 0.01}}}
    width = values(draws(items_of([near_zero]), 200, 0), 0, "width")
    assert width.min() >= 0
    assert width.max() <= max(high for _, high in EFFECTS["backlash"].parameters["width"].bounds)


def test_without_an_interval_there_is_one_simulator_and_equal_seeds_draw_the_same():
    certain = [{"name": "payload", "parameters": {"mass": 2.0}}]
    assert draws(items_of(certain), 10, 0) == [items_of(certain)]
    again = [draws(items_of([PAYLOAD, BACKLASH]), 5, 7) for _ in range(2)]
    assert again[0] == again[1]
    assert draws(items_of([PAYLOAD, BACKLASH]), 5, 8) != again[0]
