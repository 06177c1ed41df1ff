"""What readings betray by themselves."""

import numpy as np
import pytest

from tiago_mj.gap.detectors.readings import MIN_BIAS, tone, trace

PERIOD, NOISE = 1 / 240, 0.0077
ROWS = np.arange(200)


def readings(swing=0.0, frequency=54.0, drift=0.0, trials=4, seed=0):
    rng = np.random.default_rng(seed)
    phase = rng.uniform(0, 2 * np.pi, (trials, 1))
    hum = swing * np.sin(2 * np.pi * frequency * ROWS * PERIOD + phase)
    return hum + drift * ROWS / len(ROWS) + NOISE * rng.standard_normal((trials, len(ROWS)))


def found(values, free=None):
    return tone("force.left", values, np.ones(values.shape, dtype=bool) if free is None else free, PERIOD, NOISE)


@pytest.mark.parametrize("frequency", [40.0, 54.0, 60.0, 90.0])
def test_a_hum_is_found_with_its_frequency_and_size(frequency):
    seen = found(readings(0.03, frequency))
    assert seen.frequency == pytest.approx(frequency, abs=4)  # 32 rows resolve 7.5 Hz
    assert seen.amplitude == pytest.approx(0.03, rel=0.2)  # and some of it lies beside the three frequencies looked at


@pytest.mark.parametrize("seed", range(20))
def test_noise_and_drift_are_no_hum(seed):
    assert found(readings(seed=seed)) is None
    assert found(readings(drift=0.2, seed=seed)) is None


def test_a_hum_far_below_the_noise_is_left_to_it():
    assert found(readings(0.3 * NOISE)) is None


def test_only_what_is_read_while_nothing_is_touched_counts():
    values = readings(0.03)
    assert found(values, np.zeros(values.shape, dtype=bool)) is None


# Offsets of load cells ----------------------------------------------------------------------------------------------


def rest(values):
    everywhere = np.ones(values.shape, dtype=bool)
    return trace("force.left", values, everywhere, NOISE, everywhere).rest


@pytest.mark.parametrize("offset", [0.0, 0.012, -0.3])
def test_an_offset_is_read_off_before_anything_is_touched(offset):
    value, deviation = rest(readings() + offset)
    assert deviation == pytest.approx(NOISE / np.sqrt(4 * len(ROWS)), rel=0.1)  # the median deviation of 800 is 4 % off
    assert abs(value - offset) < 4 * deviation
    assert 4 * deviation < MIN_BIAS


@pytest.mark.parametrize("name", ["drift", "another offset in one trial"])
def test_what_changes_from_row_to_row_or_trial_to_trial_is_no_offset(name):
    values = readings(drift=0.01 if name == "drift" else 0.0) + 0.02
    if name != "drift":
        values[1] += 0.02
    assert rest(values) is None
