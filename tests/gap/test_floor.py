"""What a difference between recording and prediction is measured by."""

import numpy as np
import pytest

from tiago_mj.gap.inference import likelihood, noise_model, sensor_noise, step_tolerance
from tiago_mj.gap.inference.noise_model import Data

ROWS, NOISE = 60, 0.1


def flat(value=0.0) -> Data:
    """One channel of one trial at rest, in blocks of six rows."""
    values = np.full((1, ROWS, 1), value)
    noise = np.array([NOISE])
    sigma = np.full_like(values, NOISE)
    return Data(("position.hinge",), np.array([0]), values, noise, sigma, np.zeros_like(values), block=6)


def cost(data: Data, difference) -> float:
    return float((likelihood.whiten(data, difference, np.ones(1)) ** 2).sum())


def test_a_joint_that_chatters_in_the_simulator_alone_may_stand_still_in_another_explanation():
    """Half a deviation would be charged for each sample if the chatter were believed to err alike over a block."""
    chatter = 0.4 * (-1.0) ** np.arange(ROWS)[None, :, None]
    data = step_tolerance.with_step_tolerance(flat(), chatter, np.zeros_like(chatter))
    off = chatter * step_tolerance.STEP_REFINEMENT / (step_tolerance.STEP_REFINEMENT - 1)
    assert (data.common < 1e-9).all()
    assert cost(data, off) < ROWS


def test_what_a_step_shifts_for_good_is_one_error_and_not_many():
    shifted = np.full((1, ROWS, 1), 0.4)
    data = step_tolerance.with_step_tolerance(flat(), shifted, np.zeros_like(shifted))
    off = shifted * step_tolerance.STEP_REFINEMENT / (step_tolerance.STEP_REFINEMENT - 1)
    assert data.common == pytest.approx(np.abs(off))
    assert cost(data, off) < ROWS / data.block * 1.01  # of each block once
    assert cost(data, off * (-1.0) ** np.arange(ROWS)[None, :, None]) > 20 * ROWS / data.block


@pytest.mark.parametrize("rows", [150, 600])
def test_white_noise_is_its_own_floor(rows):
    values = 0.3 * np.random.default_rng(rows).standard_normal((10, rows))
    assert sensor_noise.floor(values, 0.0) == pytest.approx(0.3, rel=0.1)  # known to 5 % of so many rows


@pytest.mark.parametrize("rate", [25.0, 240.0])
def test_a_joint_that_never_rests_has_no_more_noise_than_one_at_rest(rate):
    """First differences of a swing of 1 rad in 1.6 s, at 25 Hz, are 0.16 rad."""
    rng, noise = np.random.default_rng(3), 5e-4
    time = np.arange(int(6 * rate)) / rate
    swing = [np.sin(4 * time + phase) + 0.2 * np.sin(7 * time) for phase in rng.uniform(0, 6, 8)]
    found = sensor_noise.floor(np.array(swing) + noise * rng.standard_normal((8, len(time))), 0.0)
    assert noise * 0.9 < found < noise * 1.6


def test_a_trial_in_which_an_error_lasts_stands_out():
    values = np.zeros((3, ROWS, 1))
    sigma = np.full_like(values, NOISE)
    data = Data(("force.left",), np.array([0]), values, np.array([NOISE]), sigma, np.zeros_like(values), block=6)
    error = np.random.default_rng(0).normal(0, NOISE, values.shape)
    error[1] += NOISE  # as large as the noise, but all along
    fails = likelihood.lasting_per_trial(data, error)
    assert fails[1] > 4
    assert fails[[0, 2]] == pytest.approx(1, abs=0.7)  # ten blocks: scatter of 0.45


@pytest.mark.parametrize(
    ("channel", "wrong", "said"),
    [
        ("position.hinge", [2], [2]),
        ("force.left", [2], []),  # a load cell errs wherever it is pressed as hard
        ("position.hinge", [2, 5], []),  # more than one in eight: an error of the model
    ],
    ids=["a motion", "a force", "two motions"],
)
def test_one_motion_may_go_another_way(channel, wrong, said):
    values = np.zeros((8, ROWS, 1))
    sigma = np.full_like(values, NOISE)
    data = Data((channel,), np.array([0]), values, np.array([NOISE]), sigma, np.zeros_like(values), block=6)
    error = np.random.default_rng(0).normal(0, NOISE, values.shape)
    error[wrong, 40:] += 10 * NOISE
    assert list(np.nonzero(likelihood.departing_trials(data, error))[0]) == said
    assert not likelihood.departing_trials(
        noise_model.select_trials(data, [0, 1, 2]), error[:3]
    ).any()  # of three trials none is the odd one


def test_where_the_simulator_itself_cannot_tell_what_happens_little_is_held_against_an_explanation():
    """Predictions that nothing tells apart: in half of the rows an object sticks in some and slips in others."""
    rng = np.random.default_rng(0)
    alike = np.zeros((7, 1, ROWS, 1))
    alike[:, :, ROWS // 2 :] = rng.normal(0, 5 * NOISE, (7, 1, 1, 1))
    data = step_tolerance.with_scatter(flat(), alike)
    assert data.sigma[0, : ROWS // 2] == pytest.approx(NOISE)
    spread = float(alike[:, 0, -1, 0].std(ddof=1))
    assert data.sigma[0, ROWS // 2 :] == pytest.approx(np.hypot(NOISE, spread))
    other = np.zeros((1, ROWS, 1))
    other[:, ROWS // 2 :] = 5 * NOISE
    # One error a block, and not one a row; nothing is gained where the simulator is sure.
    assert cost(data, other) < 3 * ROWS / 2 / data.block
    assert cost(data, other[:, ::-1]) == cost(flat(), other[:, ::-1])


@pytest.mark.parametrize("rate", [25.0, 50.0, 240.0])
def test_a_swing_is_no_event_but_a_stop_is(rate):
    """A joint that swings at 1 Hz bends all the time; where it runs into a stop at 2 rad/s, two simulators that differ
    by a step of 2 ms are up to 4 mrad apart, in the mean half of that."""
    time = np.arange(round(4 * rate)) / rate
    swing = 0.5 * np.sin(2 * np.pi * time)
    stopped = np.where(time < 2, 2.0 * (time - 2), 0.0)
    values, noise = np.stack([swing, stopped])[..., None], np.array([1e-4])
    share = np.array([noise_model.SIZE_TOLERANCE["position"][1]])
    sigma, _ = noise_model.sigma(values, noise, noise_model.Tolerance(share), ("position.hinge",), 1 / rate)
    there = np.abs(time - 2) < 2 / rate
    assert 1.0 < sigma[1, there, 0].max() / noise_model.TIMING_TOLERANCE < 2.2
    assert np.median(sigma[0]) < 2.5 * noise[0] < 0.15 * sigma[1, there, 0].max()


def test_the_end_of_a_recording_is_no_event():
    """Two trials of a joint that moves evenly, one of them half as long: nothing happens in either."""
    time = np.arange(200) / 25.0
    values = np.stack([3 + 2.0 * time, np.where(time < 4, 3 + 2.0 * time, np.nan)])[..., None]
    noise = np.array([1e-4])
    sigma, _ = noise_model.sigma(values, noise, noise_model.Tolerance(np.array([0.0])), ("position.hinge",), 1 / 25.0)
    assert sigma[np.isfinite(values)] == pytest.approx(noise[0])


@pytest.mark.parametrize("rate", [25.0, 240.0])
def test_beside_what_explains_a_motion_the_noise_is_the_sensors_own(rate):
    """At 25 Hz the swing hides it: by the readings alone there is up to 1.6 times as much."""
    rng, noise = np.random.default_rng(4), 5e-4
    time = np.arange(int(6 * rate)) / rate
    swing = np.array([np.sin(4 * time + phase) + 0.4 * np.sin(9 * time) for phase in rng.uniform(0, 6, 8)])[..., None]
    values = swing + noise * rng.standard_normal(swing.shape)
    before = 3 * noise
    data = Data(
        ("position.hinge",),
        np.array([0]),
        values,
        np.array([before]),
        np.full_like(values, np.hypot(before, 2 * noise)),
        np.full_like(values, 2 * noise),
        least=np.array([1e-4]),
        assumed=(np.zeros_like(values), np.full_like(values, (2 * noise) ** 2)),
    )
    beside = step_tolerance.beside(data, swing, np.zeros_like(swing))
    assert beside.noise[0] == pytest.approx(noise, rel=0.1)
    assert beside.common == pytest.approx(2 * noise * step_tolerance.BESIDE)
    assert beside.sigma == pytest.approx(np.hypot(beside.noise[0], 2 * noise * step_tolerance.BESIDE))
    wrong = step_tolerance.beside(data, swing + 0.1 * np.sin(20 * time)[:, None], np.zeros_like(swing))
    assert wrong.noise[0] <= before  # what explains badly makes no noise
    assert step_tolerance.beside(beside, swing, np.zeros_like(swing)).sigma == pytest.approx(beside.sigma)


def test_noise_beside_an_explanation_is_at_least_what_is_believed():
    data = Data(
        ("position.hinge",),
        np.array([0]),
        np.zeros((2, ROWS, 1)),
        np.array([NOISE]),
        np.full((2, ROWS, 1), NOISE),
        np.zeros((2, ROWS, 1)),
        least=np.array([NOISE / 4]),
    )
    assert step_tolerance.beside(data, np.zeros_like(data.value), np.zeros_like(data.value)).noise[0] == NOISE / 4


def test_where_something_is_touched_two_simulators_may_differ_as_before():
    """A finger that closes on an object after half of the rows: its position's tolerance is what is assumed there."""
    values = np.zeros((2, ROWS, 2))
    values[0, ROWS // 2 :, 1] = 5.0
    predicted = values.copy()
    predicted[1, : ROWS // 3, 1] = 5.0  # in the prediction alone
    assumed = (np.full_like(values, 0.04), np.full_like(values, 0.09))
    sigma, common = np.sqrt(NOISE**2 + sum(assumed)), np.sqrt(assumed[1])
    names = ("position.finger", "force.finger")
    noise = np.full(2, NOISE)
    data = Data(names, np.zeros(2, dtype=int), values, noise, sigma, common, least=noise, assumed=assumed)
    beside = step_tolerance.beside(data, predicted, np.zeros_like(values), in_contact=False)
    rows = np.arange(ROWS)
    near = noise_model.EVENT_ROWS
    touched = np.stack([rows >= ROWS // 2 - near, rows < ROWS // 3 + near])
    assert (step_tolerance.touched(data, predicted)[..., 0] == touched).all()
    for mask, share in ((touched, 1.0), (~touched, step_tolerance.BESIDE)):
        assert beside.common[mask] == pytest.approx(share * common[mask])
        assert beside.sigma[mask] ** 2 == pytest.approx(NOISE**2 + share**2 * sum(assumed)[mask])
    everywhere = step_tolerance.beside(data, predicted, np.zeros_like(values))
    later = step_tolerance.beside(beside, predicted, np.zeros_like(values))  # once something explains them
    assert later.sigma == pytest.approx(everywhere.sigma)
    assert later.common == pytest.approx(everywhere.common)
    assert later.assumed is None
