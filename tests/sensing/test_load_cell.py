"""From newtons to readings, and that the three sources feel the same grasp."""

import gymnasium
import numpy as np
import pytest

import tiago_mj  # noqa: F401
from tiago_mj.control.force_pi import ForcePI
from tiago_mj.sensing.load_cell import SENSING, TA11_NOISE, LoadCell, MovingAverage


def test_a_reading_is_scale_times_force_plus_the_papers_noise():
    cell = LoadCell(contact_unit=1.0)
    assert cell.sample(np.array([0.02, 0.0]), np.array([0.0, 1.0])) == pytest.approx([2.0, 0.0077])


def test_the_default_unit_gives_the_real_slope_through_the_servos_stiffness():
    assert LoadCell().units(2000.0) == pytest.approx(330.0)  # one metre of servo error


def test_every_preset_has_the_same_goal_in_newtons():
    goals = {
        name: gymnasium.make("tiago_mj/GripperTactile-v0", sensing=name).unwrapped.goal[0] / cell.units(1.0)
        for name, cell in SENSING.items()
    }
    assert goals["ta11"] == pytest.approx(6.06, abs=0.01)
    assert goals == pytest.approx(dict.fromkeys(goals, goals["ta11"]))


def test_noise_without_contact_is_the_sensors_and_independent_between_fingers():
    env = gymnasium.make("tiago_mj/GripperTactile-v0").unwrapped
    env.reset(seed=0)
    readings = np.array([env.step([0.0, 0.0])[4]["force_raw"] for _ in range(4000)])
    # standard error of a standard deviation: σ / √(2n) = 1.1 %; 4 of them
    assert readings.std(axis=0) == pytest.approx([TA11_NOISE] * 2, rel=0.045)
    assert np.abs(readings.mean(axis=0)).max() < 4 * TA11_NOISE / np.sqrt(4000)
    assert abs(np.corrcoef(readings.T)[0, 1]) < 4 / np.sqrt(4000)


def test_five_deviations_give_no_false_contact_where_three_do():
    rng = np.random.default_rng(0)
    raw = LoadCell().sample(np.zeros((100_000, 2)), rng.standard_normal((100_000, 2)))
    assert LoadCell().binary(raw).sum() == 0
    assert LoadCell(threshold=3 * TA11_NOISE).binary(raw).sum() > 100  # 270 expected


def test_each_finger_has_its_own_threshold():
    cell = LoadCell(threshold=(0.1, 0.3))
    np.testing.assert_array_equal(cell.binary(np.array([[0.2, 0.2], [0.05, 0.4]])), [[1, 0], [0, 1]])


def test_averaging_is_the_mean_of_the_last_samples_of_this_episode():
    average = MovingAverage(4)
    samples = [np.array([x, -x]) for x in (1.0, 2.0, 3.0, 4.0, 5.0)]
    means = [average(sample)[0] for sample in samples]
    assert means == [1.0, 1.5, 2.0, 2.5, 3.5]
    average.reset()
    assert average(np.array([9.0, 9.0]))[0] == 9.0


def test_averaging_in_the_environment_starts_afresh_with_an_episode():
    env = gymnasium.make("tiago_mj/GripperTactile-v0", sensing=LoadCell(average=4, noise=0.0), object_offset=0)
    for _ in range(2):
        _, info = env.reset(seed=0)
        np.testing.assert_array_equal(info["force_raw"], 0)
        for _ in range(110):
            _, _, _, _, info = env.step([-1.0, -1.0])
        assert (info["force_raw"] > 1).all()


@pytest.mark.parametrize("env_id", ["tiago_mj/GripperTactile-v0", "tiago_mj/TIAGoTactile-v0"])
def test_the_three_sources_agree_in_a_static_grasp(env_id):
    env = gymnasium.make(env_id, sensing=LoadCell(noise=0.0), object_offset=0)
    core = env.unwrapped
    controller = ForcePI.for_env(env)
    observation, info = env.reset(seed=0)
    at_rest = core.data.sensordata.copy()
    for _ in range(600):
        observation, _, _, _, info = core.step(controller(observation, info))
    data, truth = core.data, info["force_contact"]
    touch = [data.sensor(f"{side}_touch").data[0] for side in ("right", "left")]
    tare = [at_rest[core.model.sensor(f"{side}_load_cell_force").adr[0]] for side in ("right", "left")]
    cell = [data.sensor(f"{side}_load_cell_force").data[0] for side in ("right", "left")]
    # Straight on the gripper. TIAGo's hand is tilted by 0.6°: friction carries part of the force along the axis.
    tolerance = 0.005 if "Gripper" in env_id else 0.03
    assert touch == pytest.approx(truth, rel=tolerance)
    assert np.subtract(cell, tare) == pytest.approx(truth, rel=tolerance)


def test_only_the_force_source_feels_the_fingers_own_inertia():
    """A finger that starts and stops with nothing to touch: the cell carries 51.6 g of beam and tip."""
    felt = {}
    for source in ("contact", "touch", "force"):
        env = gymnasium.make(
            "tiago_mj/GripperTactile-v0",
            force_source=source,
            sensing=LoadCell(noise=0.0),
            object_width=0.02,
            servo="ideal",
        )
        env.reset(seed=0)
        felt[source] = max(np.abs(env.step([-1.0 + 2 * (k % 2)] * 2)[4]["force_raw"]).max() for k in range(20))
    assert felt["contact"] == 0
    assert felt["touch"] == 0
    assert felt["force"] > 5 * TA11_NOISE


@pytest.mark.parametrize(
    "arguments",
    [
        {"scale": 0},
        {"contact_unit": -1},
        {"noise": -1},
        {"noise": np.nan},
        {"average": 0},
        {"average": 2.5},
        {"threshold": (1, 2, 3)},
    ],
)
def test_an_impossible_load_cell_is_refused_by_name(arguments):
    with pytest.raises(ValueError, match=f"load cell {next(iter(arguments))}"):
        LoadCell(**arguments)
