"""The real TA11 force curve, and its protocol replayed in simulation."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import numpy as np
import pytest

from tiago_mj.sensing import ta11_curve as curve
from tiago_mj.sensing.load_cell import SERVO_STIFFNESS, TA11_CONTACT_UNIT

ROOT = Path(__file__).resolve().parents[2]
TABLE = Path(os.environ.get("TIAGO_MJ_REALDATA", ROOT.parent / "shared" / "realdata")) / "force_vs_displacement.csv"
#: The two ends and the middle of the measured range.
FEW = [0.4e-3, 0.9e-3, 1.5e-3, 3.0e-3]


@pytest.fixture(scope="module")
def comparison() -> curve.Comparison:
    return curve.compare()


@pytest.mark.skipif(not TABLE.is_file(), reason=f"the table is not at {TABLE}")
def test_the_package_carries_the_68_measured_numbers_as_they_were_published():
    with TABLE.open() as file:
        published = {
            (row["series"], row["object"], float(row["dq_m"]), float(row["force_sensor_units"]))
            for row in csv.DictReader(file)
        }
    carried = {(s.session, s.object, dq, f) for s in curve.MEASURED for dq, f in zip(s.dq, s.force, strict=True)}
    assert carried == published
    assert len(carried) == 68


@pytest.mark.parametrize(
    ("session", "name", "slope", "dead_band_mm"),
    # Least-squares fits of the same series made before this package, to the digits that they were noted with.
    [
        ("A", "wood", 332.7, 0.29),
        ("A", "sponge", 255.5, 0.26),
        ("A", "glue", 271.0, 0.23),
        ("A", "pringles", 275.2, 0.09),
    ],
)
def test_lines_of_the_measured_series_are_those_found_before(session, name, slope, dead_band_mm):
    series = next(s for s in curve.MEASURED if (s.session, s.object) == (session, name))
    line = curve.fit_line(series.dq, series.force)
    assert line.slope == pytest.approx(slope, abs=0.05)
    assert 1e3 * line.dead_band == pytest.approx(dead_band_mm, abs=0.005)


def test_a_line_with_a_dead_band_is_found_again_and_what_was_not_sent_is_left_out():
    dq = np.array([0.1e-3, 0.3e-3, 0.5e-3, 1e-3, 2e-3])
    force = 300 * (dq - 0.2e-3)
    force[:2] = 7.0  # never commanded: must not count
    line = curve.fit_line(dq, force)
    assert (line.slope, line.dead_band, line.rms) == pytest.approx((300, 0.2e-3, 0), abs=1e-9)


def test_a_line_needs_two_commands():
    with pytest.raises(ValueError, match=r"two values of dq above 0\.3 mm"):
        curve.fit_line([0.2e-3, 0.5e-3], [0.0, 0.1])


def test_simulated_slopes_lie_within_the_spread_of_the_six_measured_series(comparison):
    low, high = comparison.slopes
    for replay in comparison.replays:
        assert low <= replay.line.slope <= high, replay.object
    assert comparison.slopes_agree


def test_the_held_servo_error_sets_the_force_whatever_the_object(comparison):
    # k · dq in sensor units. The noise of a mean of 20 readings is 0.0017: 5 of it are allowed, and 1 % for the sponge
    # at the least dq, which the fingers reach a second before the force is read: it has still 0.7 % to yield.
    for replay in comparison.replays:
        sent = curve.is_sent(replay.dq)
        expected = SERVO_STIFFNESS * replay.dq[sent] * 100 / TA11_CONTACT_UNIT
        np.testing.assert_allclose(replay.force[sent].mean(axis=1), expected, rtol=0.01, atol=5 * 0.0017)


def test_the_dead_band_of_the_real_gripper_is_what_remains(comparison):
    low, high = comparison.dead_bands
    assert 0.05e-3 < low < high < 0.35e-3
    for replay in comparison.replays:
        # 5 standard errors: 0.0017 of noise over a slope of 330 is 5 µm a point, and a dozen points share it.
        assert abs(replay.line.dead_band) < 0.01e-3, replay.object
    # The largest measured one costs about a tenth of a sensor unit, some 12 times the noise of a reading.
    assert comparison.unexplained_force == pytest.approx(332.7 * 0.29e-3, rel=0.02)


def test_at_exactly_the_least_change_nothing_is_sent_and_nothing_is_felt():
    replay = curve.replay_object("wood", [curve.SENT_ABOVE])
    assert np.abs(replay.force).max() < 5 * 0.0077 / np.sqrt(curve.STEADY_READINGS)
    assert np.abs(replay.drift).max() < 1e-6  # the finger stands where it started


def test_fingers_stand_when_the_force_is_read(comparison):
    # The protocol follows the measured position, so a creeping finger would never stop. What is left is a sponge that
    # still yields (35 µm/s at the least dq) and a can that rocks (8 µm/s). The servo error is held all the same.
    for replay in comparison.replays:
        limit = 60e-6 if replay.object == "sponge" else 20e-6
        assert np.abs(replay.drift).max() < limit, replay.object


@pytest.mark.parametrize(
    "change",
    [{"object_stiffness": 1e3}, {"object_mass": 0.05}, {"object_offset": 0.005}, {"finger_speed": 0.05}],
    ids=lambda change: next(iter(change)),
)
def test_neither_the_object_nor_its_place_nor_the_speed_limit_shows_in_the_curve(change):
    line = curve.replay_object("wood", FEW, **change).line
    assert line.slope == pytest.approx(100 * SERVO_STIFFNESS / TA11_CONTACT_UNIT, rel=0.01)
    assert abs(line.dead_band) < 0.02e-3  # a dozen points fewer than in the whole curve


def test_an_object_without_a_known_width_is_refused():
    with pytest.raises(ValueError, match=r"glue.*wood, pringles, sponge"):
        curve.replay_object("glue")
