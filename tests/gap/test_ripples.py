"""Periods of a ripple, read off the error of a position."""

from dataclasses import replace

import numpy as np
import pytest

from tiago_mj.gap.detectors.ripples import Trace, peaks

NOISE = 2.7e-5


def travelled(period, seed=0, trials=3, rows=240):
    """Strokes of 30 mm, there and back, each from elsewhere, with a ripple of 60 µm and errors that are none."""
    rng = np.random.default_rng(seed)
    out = []
    for _ in range(trials):
        phase = np.linspace(0, 2 * np.pi, rows)
        position = rng.uniform(0, 0.01) + 0.015 * (1 - np.cos(phase))
        ripple = 6e-5 * np.sin(2 * np.pi * position / period) if period else 0.0
        smooth = 2e-4 + 5e-3 * position + 0.1 * np.gradient(position)
        error = ripple + smooth + NOISE * rng.standard_normal(rows)
        out.append(Trace(position, error, np.ones(rows, dtype=bool)))
    return out


@pytest.mark.parametrize("period", [0.0033, 0.0071, 0.012])
def test_the_period_is_found_among_errors_that_grow_with_position_and_speed(period):
    first, *_ = peaks(travelled(period), 0.001, 0.02)
    # Over 40 mm of travel a period is out of step by a quarter of a turn where it is off by this much.
    assert first == pytest.approx(period, rel=0.25 * period / 0.04)


def test_the_period_is_found_of_a_joint_that_moves_by_more_than_it_from_row_to_row():
    """A ripple of 0.15 rad at 5 rad/s and 25 rows a second; the joint trails it as a servo of 60 ms does."""
    rng, fine, rows, period = np.random.default_rng(2), 40, 150, 0.15
    traces = []
    for _ in range(4):
        time = np.arange(rows * fine) / fine * 0.04
        position = rng.uniform(0.8, 1.2) * np.sin(rng.uniform(3.5, 4.5) * time) + 0.2 * np.sin(2 * time)
        trailing, share = np.zeros_like(position), 0.001 / 0.06
        for k in range(1, len(position)):
            trailing[k] = trailing[k - 1] + share * (np.sin(2 * np.pi * position[k] / period) - trailing[k - 1])
        error = 0.004 * trailing + 5e-4 * rng.standard_normal(len(position))
        follows = 1 - (1 - share) ** fine
        traces.append(Trace(position[::fine], error[::fine], np.ones(rows, dtype=bool), follows))
    first, *_ = peaks(traces, 0.001, 0.5)
    assert first == pytest.approx(period, rel=0.02)  # over 2.4 rad, a quarter of a turn


def test_onsets_and_what_is_not_counted_hide_no_ripple():
    traces = travelled(0.0071)
    for trace in traces:
        trace.error[100:104] += 2e-3
        trace.error[150:] += 1e-3 * np.sin(trace.position[150:] / 0.0004)
        trace.counts[150:] = False
    assert peaks(traces, 0.001, 0.02)[0] == pytest.approx(0.0071, rel=0.05)


def test_rows_that_were_not_measured_hide_no_ripple():
    holed = [
        replace(one, position=np.where(np.arange(240) % 50 < 3, np.nan, one.position)) for one in travelled(0.0071)
    ]
    first, *_ = peaks(holed, 0.001, 0.02)
    assert first == pytest.approx(0.0071, rel=0.05)


def test_an_encoder_that_is_read_in_every_fourth_row_shows_its_ripple():
    traces = []
    for one in travelled(0.005, rows=960):
        read = np.arange(960) % 4 == 0
        traces.append(Trace(*(np.where(read, x, np.nan) for x in (one.position, one.error)), one.counts))
    assert peaks(traces, 0.001, 0.02)[0] == pytest.approx(0.005, rel=0.05)


def test_a_joint_that_hardly_moves_tells_no_period():
    position = np.full(100, 0.03)
    assert peaks([Trace(position, np.zeros(100), np.ones(100, dtype=bool))], 0.001, 0.02) == []


@pytest.mark.parametrize("period", [0.0043, 0.006])
def test_a_servo_that_trails_a_ripple_by_a_quarter_of_it_and_more_does_not_move_its_period(period):
    """Strokes of 15 mm in 0.3 s each way at 240 Hz, through a servo of 40 ms."""
    share, traces = 1 - np.exp(-1 / 240 / 0.04), []
    for start in (0.011, 0.02, 0.026):
        position = start + 0.0075 * (1 - np.cos(np.linspace(0, 2 * np.pi, 145)))
        force, error = np.sin(2 * np.pi * position / period), np.zeros(145)
        for k in range(144):
            error[k + 1] = error[k] + share * (4e-4 * force[k] - error[k])
        noisy = error + NOISE * np.random.default_rng(1).standard_normal(145)
        traces.append(Trace(position, noisy, np.ones(145, dtype=bool), share))
    assert peaks(traces, 0.001, 0.02)[0] == pytest.approx(period, rel=0.25 * period / 0.04)


@pytest.mark.parametrize("period", [0.0071, 0.0095, 0.0125])
def test_a_period_is_found_of_strokes_that_are_short_beside_where_they_are(period):
    """Fingers that close by 10 mm some 35 mm from their zero, where a period that is 3 % off is out of step."""
    rng, traces = np.random.default_rng(4), []
    for _ in range(8):
        position = rng.uniform(0.032, 0.038) + 0.005 * (1 - np.cos(np.linspace(0, 2 * np.pi, 145)))
        error = 6e-5 * np.sin(2 * np.pi * position / period) + NOISE * rng.standard_normal(145)
        traces.append(Trace(position, error, np.ones(145, dtype=bool)))
    # Of another period, a turn more or less between zero and here, a stroke shows hardly anything else.
    assert pytest.approx(period, rel=0.25 * period / 0.047) in peaks(traces, 0.001, 0.02)[:2]
