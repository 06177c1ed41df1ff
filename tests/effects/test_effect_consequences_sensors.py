"""What encoders and load cells with an effect read, beside what is true, in a rollout.

An open loop: the motion of a rollout with an effect on its sensors is the nominal one to the last bit, so that readings
can be compared row by row.
"""

import numpy as np
import pytest
from effects_bench import (
    MIDDLE,
    PERIOD,
    UNITS_PER_NEWTON,
    crossing,
    entry,
    free,
    grasp,
    rollout,
    same_motion,
    shows,
    speeds,
)

#: Close on the object, hold it, squeeze more, hold, let go, wait: the pads touch from about 0.65 s to 2.7 s.
SQUEEZE = ((-0.04, 0.75), (0.0, 0.75), (-0.01, 0.3), (0.0, 0.5), (0.04, 0.5), (0.0, 0.4))
HELD, MORE, FREED = int(1.5 * 240), int(2.3 * 240), int(3.1 * 240)  # rows at the ends of the holds
TO_AND_FRO = ((-0.04, 0.7), (0.0, 0.3), (0.03, 0.5), (0.0, 0.3))


@pytest.fixture(scope="module")
def nominal():
    return grasp(None, *SQUEEZE)


def read(nominal, effects):
    """Readings with an effect; the motion is checked to be the nominal one."""
    r = grasp(effects, *SQUEEZE)
    assert same_motion(r, nominal)
    return r.reading


def area(before, after):
    """Between two signals, over time."""
    return (before - after).sum(axis=0) * PERIOD


# Encoders ------------------------------------------------------------------------------------------------------------


@shows("encoder_bias", "encoder_scale", "encoder_quantization", "velocity_filter")
@pytest.mark.parametrize("name", ["encoder_bias", "encoder_scale", "encoder_quantization", "velocity_filter"])
def test_an_encoder_does_not_move_the_joint(name):
    assert same_motion(free({name: {}}, *TO_AND_FRO), free(None, *TO_AND_FRO))


@shows("encoder_bias")
def test_an_encoders_bias_is_the_same_at_rest_and_in_motion_and_not_in_the_velocity():
    r = free(entry("encoder_bias", "gripper_left_finger_joint", offset=0.001), *TO_AND_FRO)
    error = r.position - r.true_position
    np.testing.assert_allclose(error[:, 1], 0.001, atol=1e-15)
    assert (error[:, 0] == 0).all()
    np.testing.assert_array_equal(r.velocity, r.true_velocity)


@shows("encoder_scale")
def test_an_encoders_scale_stretches_positions_about_zero_and_velocities():
    r = free({"encoder_scale": {"factor": 1.05}}, *TO_AND_FRO)
    np.testing.assert_allclose(r.position - r.true_position, 0.05 * r.true_position, atol=1e-15)
    # Readings remain consistent: what is said to be moved is the integral of the velocity, to a trapezoid's error.
    moved = ((r.velocity[1:] + r.velocity[:-1]) / 2).sum(axis=0) * PERIOD
    np.testing.assert_allclose(moved, r.position[-1] - r.position[0], atol=5e-5)


@shows("encoder_quantization")
def test_a_quantized_encoder_reads_the_nearest_mark():
    step = 5e-4
    r = free({"encoder_quantization": {"step": step}}, *TO_AND_FRO)
    marks = r.position / step
    np.testing.assert_allclose(marks, np.round(marks), atol=1e-9)
    error = r.position - r.true_position
    assert np.abs(error).max() <= step / 2 + 1e-12
    # Evenly spread over a step in motion: 150 rows, which cross 50 marks.
    assert error[20:170].std() == pytest.approx(step / np.sqrt(12), rel=0.1)


@shows("velocity_filter")
@pytest.mark.parametrize("time_constant", [0.04, 0.011])
def test_a_filtered_velocity_arrives_late_by_its_time_constant(time_constant):
    r = free({"velocity_filter": {"time_constant": time_constant}}, (-0.04, 0.9))
    # The area between a signal and its first-order lag is the time constant times the rise, whatever the shape; sums of
    # rows are exact, as both signals are equal at the ends.
    late = area(r.true_velocity, r.velocity) / (r.true_velocity[-1] - r.true_velocity[0])
    np.testing.assert_allclose(late, time_constant, rtol=0.002)
    np.testing.assert_allclose(r.velocity[-1], -0.04, rtol=1e-5)


@shows("velocity_filter")
def test_two_low_passes_in_a_row_are_as_late_as_one_but_begin_more_slowly():
    one, two = (free({"velocity_filter": {"time_constant": 0.08, "poles": n}}, (-0.04, 0.9)) for n in (1, 2))
    late = area(two.true_velocity, two.velocity) / (two.true_velocity[-1] - two.true_velocity[0])
    np.testing.assert_allclose(late, 0.08, rtol=0.002)  # the areas of both lags add up
    early, tail = slice(1, 10), slice(60, 120)
    assert (np.abs(two.velocity) < np.abs(one.velocity))[early].all()
    assert (np.abs(two.velocity) > np.abs(one.velocity))[tail].all()


# Load cells ----------------------------------------------------------------------------------------------------------


@shows("force_gain", "force_bias", "force_nonlinearity", "force_dead_zone", "force_saturation", "force_quantization")
@pytest.mark.parametrize(
    ("effects", "curve"),
    [
        ({"force_gain": {"factor": 1.3}}, lambda x: 1.3 * x),
        ({"force_bias": {"offset": 0.1}}, lambda x: x + 0.1),
        ({"force_nonlinearity": {"quadratic": 0.1}}, lambda x: x + 0.1 * x**2),
        ({"force_dead_zone": {"width": 0.08}}, lambda x: np.where(x > 0.08, x - 0.08, 0.0)),
        ({"force_saturation": {"limit": 0.8}}, lambda x: np.minimum(x, 0.8)),
        # Rapp's amplifier with p = 1.
        ({"force_saturation": {"limit": 0.8, "softness": 0.5}}, lambda x: x / np.sqrt(1 + (x / 0.8) ** 2)),
        ({"force_quantization": {"step": 0.05}}, lambda x: 0.05 * np.round(x / 0.05)),
    ],
    ids=lambda value: next(iter(value)) if isinstance(value, dict) else "",
)
def test_a_load_cell_reads_the_force_through_its_curve(nominal, effects, curve):
    force = nominal.force * UNITS_PER_NEWTON
    assert force.max() > 1.0
    np.testing.assert_allclose(read(nominal, effects), curve(force), atol=1e-12)


@shows("force_dead_zone")
def test_a_dead_zone_delays_a_gentle_touch():
    gently = ((-0.04, 0.58), (-0.002, 1.4))
    nominal, dead = grasp(None, *gently), grasp({"force_dead_zone": {"width": 0.08}}, *gently)
    seen = [crossing(r.time, r.reading[:, 0], 0.005) for r in (nominal, dead)]
    # 0.08 units are 0.48 N, to which servo and pad in series take 0.15 s at 2 mm/s; the pad's damper a little less.
    assert 0.1 < seen[1] - seen[0] < 0.15
    true = crossing(nominal.time, nominal.force[:, 0] * UNITS_PER_NEWTON, 0.085)
    assert seen[1] == pytest.approx(true, abs=1e-6)  # the force is straight between two rows


@shows("force_saturation")
def test_a_saturated_reading_is_a_plateau(nominal):
    reading = read(nominal, {"force_saturation": {"limit": 0.8}})
    over = nominal.reading[:, 0] > 0.8
    assert over.sum() > 100
    assert np.ptp(reading[over, 0]) == 0


@shows("force_drift")
def test_a_drifting_zero_is_a_ramp_with_and_without_contact(nominal):
    drift = read(nominal, {"force_drift": {"rate": 0.1}}) - nominal.reading
    np.testing.assert_allclose(drift, 0.1 * nominal.time[:, None] * np.ones(2), atol=1e-12)


@shows("force_crosstalk")
def test_crosstalk_lets_a_finger_read_what_the_other_one_touches():
    only_right = rollout({"force_crosstalk": {"ratio": 0.1}}, speeds(((-0.04, 0.0), 0.9), (0.0, 0.3)), **MIDDLE)
    assert (only_right.force[:, 1] == 0).all()
    assert only_right.reading[:, 0].max() > 0.1
    np.testing.assert_allclose(only_right.reading[:, 1], 0.1 * only_right.reading[:, 0], atol=1e-12)


@shows("force_hysteresis")
def test_a_reading_with_hysteresis_is_higher_by_its_width_when_the_force_came_from_above():
    width = 0.1
    there_and_back = ((-0.04, 0.75), (0.0, 0.5), (-0.01, 0.3), (0.01, 0.3))
    turn = int(1.55 * 240) + 5  # after some rows of trailing
    r = grasp({"force_hysteresis": {"width": width}}, *there_and_back)
    loading, unloading = slice(int(1.3 * 240), turn), slice(turn + 24, None)
    for finger in (0, 1):
        true, x = r.force[:, finger] * UNITS_PER_NEWTON, r.reading[:, finger]
        for level in (1.6, 1.8):
            came = np.interp(level, true[loading], x[loading])
            went = np.interp(-level, -true[unloading], x[unloading])
            assert went - came == pytest.approx(width, abs=1e-9)  # between rows both are straight


@shows("force_lag", "force_delay")
@pytest.mark.parametrize(("name", "parameter"), [("force_lag", "time_constant"), ("force_delay", "seconds")])
@pytest.mark.parametrize("late", [0.03, 0.0104])
def test_a_late_reading_is_right_while_a_force_is_held_and_late_when_it_changes(nominal, name, parameter, late):
    reading = read(nominal, {name: {parameter: late}})
    upto = slice(0, HELD + 1)
    # Late by the same area, whatever the shape; sums of rows leave out half of the first and last one.
    measured = area(nominal.reading[upto], reading[upto]) / nominal.reading[HELD]
    np.testing.assert_allclose(measured, late, rtol=0.002)
    # The object creeps between the fingers, and their forces by a thousandth in that time.
    np.testing.assert_allclose(reading[HELD], nominal.reading[HELD], rtol=1e-3)
    steepest = np.diff(reading[upto, 0]).max() / np.diff(nominal.reading[upto, 0]).max()
    if name == "force_delay":  # as steep as ever, but for what two rows' mean takes from a single steep one
        assert steepest > 0.7
        waits = int(late / PERIOD)
        touch = int(np.argmax(nominal.reading[:, 0] > 0))
        assert (reading[: touch + waits, 0] == 0).all()
    elif late > 0.02:  # rounded
        assert steepest < 0.6


@shows("pad_creep")
@pytest.mark.parametrize(("fraction", "time_constant"), [(0.2, 0.15), (0.4, 0.25)])
def test_a_creeping_pad_relaxes_by_its_fraction_with_its_time_constant(nominal, fraction, time_constant):
    effect = {"pad_creep": {"fraction": fraction, "time_constant": time_constant}}
    share = (read(nominal, effect) / np.where(nominal.reading > 0.01, nominal.reading, np.nan))[:, 0]
    hold = slice(int(1.1 * 240), int(1.45 * 240))  # the force itself is at rest to a thousandth
    relaxing = share[hold] - (1 - fraction)
    slope = np.polyfit(nominal.time[hold], np.log(relaxing), 1)[0]
    assert -1 / slope == pytest.approx(time_constant, rel=0.03)
    assert share[HELD] == pytest.approx(1 - fraction, abs=0.05 * fraction)
    # Let go, a pad that had given way pulls: less than nothing, and back to it.
    released = read(nominal, effect)[int(2.75 * 240) :, 0]
    assert released.min() < -0.05 * fraction
    assert (nominal.reading[int(2.75 * 240) :] < 1e-6).all()


# Noise and lost readings ---------------------------------------------------------------------------------------------


def scatter(effects, seed):
    """Readings of fingers that touch nothing, 2000 rows."""
    return rollout(effects, np.zeros((2000, 2)), seed=seed).reading


@shows("force_noise")
@pytest.mark.parametrize("factor", [3.0, 0.5])
def test_noise_is_larger_by_its_factor_about_the_same_mean(factor):
    nominal, noisy = scatter(None, 1), scatter({"force_noise": {"factor": factor}}, 2)
    # Of 4000 readings each: a standard deviation is known to 1.1 %; four standard errors of a ratio.
    assert noisy.std() / nominal.std() == pytest.approx(factor, rel=4 * np.sqrt(2) * 0.011)
    assert abs(noisy.mean()) < 4 * noisy.std() / np.sqrt(4000)


@shows("force_dropout")
@pytest.mark.parametrize("probability", [0.05, 0.4])
def test_missed_readings_repeat_the_one_before_as_often_as_said(probability):
    reading = scatter({"force_dropout": {"probability": probability}}, 3)
    repeats = np.diff(reading, axis=0) == 0
    # Noise never repeats by itself. Of 4000 readings: four standard errors.
    assert repeats.mean() == pytest.approx(probability, abs=4 * np.sqrt(probability * (1 - probability) / 4000))
    assert (repeats[:, 0] != repeats[:, 1]).any()  # each cell misses its own
    # No memory: a repeat after a repeat is as likely as any other.
    again = repeats[1:][repeats[:-1]]
    assert again.mean() == pytest.approx(probability, abs=4 * np.sqrt(probability * (1 - probability) / again.size))
