"""Positions that are read early or late: how much is found, and that nothing else is taken for it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from tiago_mj.gap.analysis.outcome import late_readings
from tiago_mj.gap.inference import likelihood, noise_model, timing_noise
from tiago_mj.gap.simulation.plant import plant_of
from tiago_mj.recordings.imports import so101
from tiago_mj.recordings.recording import Sidecar, Trial

Array = NDArray[np.float64]
PERIOD = 0.01
NOISE = 1e-4


def swing(time: Array) -> Array:
    """A motion of up to 1.6 rad/s, of 0.4 and 1.1 Hz."""
    return np.asarray(0.4 * np.sin(2 * np.pi * 0.4 * time) + 0.09 * np.sin(2 * np.pi * 1.1 * time))


def strokes(time: Array) -> Array:
    """Triangles: corners, and nothing bent between them."""
    return np.asarray(0.4 * np.abs((time / 0.8) % 2 - 1))


def read(
    motion: Callable[[Array], Array], late: float, seed: int = 0, *, uneven: float = 0.0, n: int = 600
) -> tuple[list[Array], list[Array]]:
    """Three trials of readings that are ``late`` seconds early or late, and noisy."""
    rng = np.random.default_rng(seed)
    times = [PERIOD * np.arange(n) + uneven * rng.uniform(-1, 1, n) for _ in range(3)]
    return times, [motion(t + late * rng.standard_normal(n)) + NOISE * rng.standard_normal(n) for t in times]


@pytest.mark.parametrize("late", [5e-4, 1e-3, 2e-3])
@pytest.mark.parametrize("uneven", [0.0, 3e-3])
def test_lateness_is_found_within_a_tenth(late: float, uneven: float) -> None:
    # Some 900 rows in fast motion: a variance is known to 5 %, more at neighbours that differences share.
    times, values = read(swing, late, uneven=uneven)
    assert timing_noise.lateness(times, values, NOISE).seconds == pytest.approx(late, rel=0.1)


@pytest.mark.parametrize("motion", [swing, strokes])
@pytest.mark.parametrize("uneven", [0.0, 3e-3])
def test_nothing_is_found_where_readings_are_in_time(motion: Callable[[Array], Array], uneven: float) -> None:
    assert timing_noise.lateness(*read(motion, 0.0, uneven=uneven), NOISE).seconds == 0.0


def test_rounding_is_no_lateness() -> None:
    step = 2 * np.pi / 4096
    times, values = read(swing, 0.0)
    on_grid = [step * np.round(value / step) for value in values]
    assert timing_noise.lateness(times, on_grid, NOISE, step).seconds == 0.0
    # A coarse grid that noise hides, so that nobody knows of it, would be readings that are off by a row and more.
    coarse = [0.05 * np.round(value / 0.05) + NOISE * np.random.default_rng(1).standard_normal(600) for value in values]
    assert timing_noise.lateness(times, coarse, NOISE).seconds == 0.0


def test_lateness_is_found_on_a_grid() -> None:
    step = 2 * np.pi / 4096
    times, values = read(swing, 1e-3)
    on_grid = [step * np.round(value / step) for value in values]
    assert timing_noise.lateness(times, on_grid, NOISE, step).seconds == pytest.approx(1e-3, rel=0.15)


def test_rows_without_reading_are_passed_over() -> None:
    times, values = read(swing, 1e-3)
    for value in values:
        value[np.random.default_rng(2).random(600) < 0.3] = np.nan
    assert timing_noise.lateness(times, values, NOISE).seconds == pytest.approx(1e-3, rel=0.15)
    assert timing_noise.lateness(times, [np.full(600, np.nan)] * 3, NOISE).seconds == 0.0


def test_few_readings_tell_nothing() -> None:
    assert timing_noise.lateness(*read(swing, 1e-3, n=25), NOISE).seconds == 0.0


def test_variance_is_that_of_the_slope() -> None:
    time = PERIOD * np.arange(600)
    slope = 2 * np.pi * 0.4 * 0.4 * np.cos(2 * np.pi * 0.4 * time) + 2 * np.pi * 1.1 * 0.09 * np.cos(
        2 * np.pi * 1.1 * time
    )
    value = swing(time)
    value[100:110] = np.nan
    inner = slice(3, -3)  # ends: of the run nearest to them
    # A line through seven rows is the mean slope over 70 ms, of which bending takes less than 2 % of the largest.
    found = timing_noise.variance(time, value, 1e-3)
    assert np.isfinite(found).all()
    away = np.ones(600, bool)
    away[95:115] = False
    np.testing.assert_allclose(
        found[inner][away[inner]], (1e-3 * slope[inner][away[inner]]) ** 2, atol=0.04 * found.max()
    )
    assert not timing_noise.variance(time, value, 0.0).any()


@pytest.fixture(scope="module")
def late_data(tmp_path_factory: pytest.TempPathFactory) -> tuple[noise_model.Data, Array]:
    """Readings of a servo that are 1 ms early or late, and where they were read in time, (3, 600, 1)."""
    model = tmp_path_factory.mktemp("servo") / "servo.xml"
    model.write_text(so101.servo("hinge"))
    times, values = read(swing, 1e-3)
    trials = []
    for k, (time, value) in enumerate(zip(times, values, strict=True)):
        side = Sidecar("tiago_mj.recording/1", f"t{k}", str(model), 1 / PERIOD, "position", None, None, None, None)
        trials.append(Trial(f"t{k}", time, {"hinge": swing(time)}, {"hinge": value}, {}, {}, {}, side, f"t{k}.parquet"))
    return noise_model.collect(plant_of(trials), trials), np.stack([swing(time) for time in times])[..., None]


def test_readings_that_are_late_leave_noise_beside_the_truth(late_data: tuple[noise_model.Data, Array]) -> None:
    data, truth = late_data
    assert data.late is not None
    assert data.late[0] == pytest.approx(1e-3, rel=0.1)
    exact = replace(
        data, common=np.zeros_like(data.common), sigma=np.broadcast_to(data.reading_noise, data.value.shape)
    )
    # 1800 readings: the mean of their squares is known to 3 %, and lateness to 5 %; a fast one is as likely off as a
    # slow one.
    scaled = likelihood.scaled(exact, data.value - truth) ** 2
    fast = np.abs(np.gradient(truth, PERIOD, axis=1)) > 0.8
    assert scaled.mean() == pytest.approx(1.0, abs=0.15)
    assert scaled[fast].mean() == pytest.approx(1.0, abs=0.2)
    assert likelihood.lasting(exact, data.value - truth)[0] == pytest.approx(1.0, abs=0.35)  # of 72 blocks
    assert data.floor[0] == pytest.approx(float(np.sqrt(np.mean((data.value - truth) ** 2))), rel=0.1)
    assert data.floor[0] > 3 * data.noise[0]


def test_lateness_is_kept_by_trial_and_by_channel(late_data: tuple[noise_model.Data, Array]) -> None:
    data, _ = late_data
    assert data.timing is not None
    last = noise_model.select_trials(data, [2])
    np.testing.assert_array_equal(last.timing, data.timing[[2]])
    channel = noise_model.select_channel(data, 0)
    np.testing.assert_array_equal(channel.timing, data.timing)
    np.testing.assert_array_equal(channel.late, data.late)


def test_the_report_says_how_late_readings_are(late_data: tuple[noise_model.Data, Array]) -> None:
    data, _ = late_data
    (said,) = late_readings(data)
    assert said.startswith("position.hinge: read earlier or later than its stamps say, by ")
    assert " ms (root mean square)" in said
    assert late_readings(replace(data, late=None)) == []


def test_grasps_of_the_projects_gripper_are_taken_to_be_in_time(
    grasps: tuple[object, object, noise_model.Data],
) -> None:
    assert grasps[2].late is None
