"""Vector environments whose effects are drawn anew for every episode."""

from __future__ import annotations

import gymnasium
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from tiago_mj.effects import Entry, read_effects

GRIPPER = "tiago_mj/GripperTactile-v0"
OPTIONS = {"max_episode_steps": 15, "autoreset_mode": AutoresetMode.SAME_STEP, "object": ["cylinder", "box_soft"]}


def limits(rng):
    """Another speed in every episode."""
    return (Entry("velocity_limit", None, {"velocity": float(rng.uniform(0.004, 0.02))}),)


def kinds(rng):
    """Effects of different kinds, of which one draws numbers itself in every step."""
    if rng.random() < 0.5:
        return (Entry("dropped_commands", None, {"probability": 0.5}),)
    return (Entry("servo_stiffness", None, {"factor": float(rng.uniform(0.3, 3.0))}),)


def played(count, seed, steps=40, **arguments):
    """Observations of every step, (steps + 1, count, n), under the same actions for all."""
    env = gymnasium.make_vec(GRIPPER, num_envs=count, **OPTIONS, **arguments)
    rng = np.random.default_rng(1)
    seen = [env.reset(seed=seed)[0]]
    for _ in range(steps):
        seen.append(env.step(np.repeat(rng.uniform(-1, 1, (1, 2)), count, axis=0))[0])
    env.close()
    return np.array(seen)


def test_effects_that_are_drawn_act_as_those_that_an_environment_has():
    always = {"coulomb_friction": {"force": 2.0}, "force_lag": {"time_constant": 0.05}, "link_mass": {"factor": 1.5}}
    drawn = played(3, 5, draw_effects=lambda rng: read_effects(always))
    np.testing.assert_array_equal(drawn, played(3, 5, effects=always))


def test_every_episode_of_every_environment_has_its_own():
    env = gymnasium.make_vec(GRIPPER, num_envs=3, **OPTIONS, draw_effects=limits)
    env.reset(seed=3)
    ways = []
    for _ in range(3):
        begun = env.unwrapped.simulations.state.position[:, 0].copy()
        for _ in range(14):
            env.step(np.full((3, 2), -1.0))
        ways += (env.unwrapped.simulations.state.position[:, 0] - begun).tolist()
        env.step(np.full((3, 2), -1.0))  # the episode ends here
    env.close()
    assert len(np.unique(np.round(ways, 7))) == 9
    assert max(np.abs(ways)) > 1.5 * min(np.abs(ways))  # 4 to 20 mm/s


@pytest.mark.parametrize("draw", [limits, kinds])
def test_an_environment_depends_on_its_own_seed_alone(draw):
    together = played(4, 7, draw_effects=draw)
    for k in range(4):
        np.testing.assert_array_equal(together[:, k], played(1, 7 + k, draw_effects=draw)[:, 0])


def test_what_the_episode_before_had_does_not_remain():
    def once(rng, drawn=[]):  # noqa: B006
        drawn.append(1)
        return read_effects({"link_mass": {"factor": 2.5}, "clock_skew": {}}) if len(drawn) == 1 else ()

    env = gymnasium.make_vec(GRIPPER, num_envs=1, **OPTIONS, draw_effects=once)
    plain = gymnasium.make_vec(GRIPPER, num_envs=1, **OPTIONS)
    env.reset(seed=1)
    np.testing.assert_array_equal(env.reset(seed=2)[0], plain.reset(seed=2)[0])
    for _ in range(10):
        np.testing.assert_array_equal(env.step(np.full((1, 2), -1.0))[0], plain.step(np.full((1, 2), -1.0))[0])


def test_an_effect_on_a_part_that_the_robot_does_not_have_is_one_line():
    env = gymnasium.make_vec(
        GRIPPER, num_envs=2, draw_effects=lambda rng: (Entry("servo_stiffness", ("elbow",), {"factor": 2.0}),)
    )
    with pytest.raises(ValueError, match=r"^effect 'servo_stiffness' has target 'elbow'.*") as fault:
        env.reset(seed=0)
    assert "\n" not in str(fault.value)
