"""The scripted experts of reach, push and pick-and-place, and the resolved rates that they run on."""

import gymnasium
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tiago_mj.control.scripted import ResolvedRates, Scripted
from tiago_mj.envs.pick_and_place import PickAndPlace
from tiago_mj.envs.push import Push
from tiago_mj.envs.reach import Reach
from tiago_mj.models import names
from tiago_mj.models.limits import joint_limits
from tiago_mj.rollout.episode import play

IDS = [f"TIAGo{task}{touch}-v0" for task in ("Reach", "Push", "PickAndPlace") for touch in ("", "Tactile")]


@pytest.mark.parametrize("name", IDS)
def test_the_expert_solves_the_registered_task_in_time(name):
    """The share over 1000 seeds is in benchmarks/results/scripted_experts.json; each of these is one that it solves."""
    env = gymnasium.make(f"tiago_mj/{name}")
    expert = Scripted.for_env(env)
    for seed in range(4):
        observation, info = env.reset(seed=seed)
        expert.reset()
        truncated = False
        while not truncated:
            action = expert(observation, info)
            assert action in env.action_space
            observation, reward, _, truncated, info = env.step(action)
        assert info["is_success"], seed
        assert reward == 0.0
    env.close()


@pytest.mark.parametrize(
    "given",
    [
        {"object_stiffness": 3000.0},
        {"object_stiffness": 40_000.0},
        {"object": "wood"},
        {"object": "sponge"},
        {"finger_speed": 0.03},
    ],
    ids=str,
)
def test_whatever_the_fingers_stand_on_is_carried(given):
    """Stiff and soft, narrow and wide, by slow fingers: how far they press into it says nothing of the grip."""
    env = gymnasium.make("tiago_mj/TIAGoPickAndPlace-v0", **given)
    expert = Scripted.for_env(env)
    assert all(play(env, expert, seed=seed).success[-1] for seed in range(3))


@pytest.mark.parametrize("direction", [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1)])
def test_resolved_rates_stop_at_soft_limits_and_never_ask_for_more_than_full_speed(direction):
    env = Push()
    env.reset(seed=0)
    rates = ResolvedRates(env)
    limits = [joint_limits(env.model, name) for name in names.TIAGO_JOINTS[:8]]
    low = np.array([limit.soft_lower for limit in limits])
    high = np.array([limit.soft_upper for limit in limits])
    for _ in range(120):
        action = np.zeros(10)
        action[:8] = rates(env.state.position, 0.4 * np.array(direction))
        assert np.abs(action).max() <= 1.0
        env.step(action)
        q = env.state.position[:8]
        assert (q > low - 0.02).all()  # the servos lag by 40 ms behind joints that brake
        assert (q < high + 0.02).all()


def test_resolved_rates_move_the_hand_as_asked_and_keep_its_orientation():
    env = Push()
    env.reset(seed=0)
    rates = ResolvedRates(env)
    start, upright = env.state.grasp_position, env.data.site(names.GRASP_SITE).xmat.copy()
    for _ in range(25):
        action = np.zeros(10)
        action[:8] = rates(env.state.position, np.array([0.05, -0.1, 0.02]))
        env.step(action)
    # One second, less the servos' lag of 40 to 60 ms at the start.
    np.testing.assert_allclose(env.state.grasp_position - start, 0.95 * np.array([0.05, -0.1, 0.02]), atol=0.006)
    turned = Rotation.from_matrix(env.data.site(names.GRASP_SITE).xmat.reshape(3, 3) @ upright.reshape(3, 3).T)
    assert turned.magnitude() < 0.05


def test_experts_refuse_what_they_cannot_control():
    with pytest.raises(ValueError, match="experts for TIAGoReach"):
        Scripted.for_env(gymnasium.make("tiago_mj/GripperClose-v0"))
    with pytest.raises(ValueError, match="control='velocity'"):
        Scripted.for_env(Reach(control="position"))


@pytest.mark.parametrize("task", [Push, PickAndPlace])
def test_the_experts_remember_nothing(task):
    """Any moment of an episode, shown to an expert that has seen no other, gets the same action."""
    env = task()
    expert = Scripted.for_env(env)
    observation, info = env.reset(seed=3)
    expert.reset()
    for _ in range(60):
        action = expert(observation, info)
        np.testing.assert_allclose(action, Scripted.for_env(env)(observation, info), atol=1e-6)
        observation, _, _, _, info = env.step(action)
    env.close()
