"""The steady task: what is observed and rewarded, term by term, and what it makes of a bounced object."""

import pickle

import gymnasium
import numpy as np
import pytest

import tiago_mj  # noqa: F401
from tiago_mj.control.force_pi import ForcePI
from tiago_mj.envs.hold_steady import HoldForceSteady, SteadyWeights
from tiago_mj.models import names

ID = "tiago_mj/GripperTactileSteady-v0"
SPEED = 0.08


@pytest.fixture(scope="module")
def core():
    return HoldForceSteady(visual=False)


def terms(core, *, force=(1.0, 1.0), touching=(1, 1), velocity=(0.0, 0.0), moved=0.0, goal=1.0):
    achieved = np.array([*force, *touching, *velocity, moved], dtype=float)
    return core._reward_terms(achieved, np.full(2, goal))


def test_a_still_grasp_at_the_goal_costs_nothing(core):
    assert set(terms(core).values()) == {0.0}


@pytest.mark.parametrize(
    ("state", "cost"),
    [
        ({"force": (0.5, 1.0)}, {"force": 0.5}),
        ({"force": (1.5, 1.0)}, {"force": 0.5, "excess": 0.25}),
        ({"force": (1.0, 1.0), "goal": 2.0}, {"force": 1.0}),  # half of the goal is missing on both fingers
        # A finger that closes at the limit, stands still, opens at the limit before it touches.
        ({"force": (0, 1), "touching": (0, 1), "velocity": (-SPEED, 0)}, {"force": 1.0, "contact": 0.5}),
        ({"force": (0, 1), "touching": (0, 1)}, {"force": 1.0, "contact": 0.5, "approach": 0.5}),
        ({"force": (0, 0), "touching": (0, 0), "velocity": (SPEED, -SPEED / 2)},
         {"force": 2.0, "contact": 1.0, "approach": 1.25}),
        ({"velocity": (SPEED, -SPEED / 2)}, {"finger_motion": 0.25 * 1.5}),
        ({"moved": SPEED}, {"object_motion": 0.5}),
    ],
    ids=str,
)  # fmt: skip
def test_each_term_costs_what_its_description_says(core, state, cost):
    found = terms(core, **state)
    assert set(found) == {"force", "approach", "contact", "excess", "finger_motion", "object_motion"}
    for name, value in found.items():
        assert value == pytest.approx(-cost.get(name, 0.0), abs=1e-12), name


def test_with_an_exponent_small_errors_of_force_count_for_more():
    found = terms(HoldForceSteady(visual=False, exponent=0.5), force=(0.75, 1.04))
    assert found["force"] == pytest.approx(-(0.5 + 0.2))
    assert found["excess"] == pytest.approx(-0.5 * 0.04)
    with pytest.raises(ValueError, match="exponent is 0: give a number above 0"):
        HoldForceSteady(visual=False, exponent=0)


def test_the_agent_sees_velocities_goal_and_force_errors_in_goals():
    env = gymnasium.make(ID)
    observation, info = env.reset(seed=3)
    for _ in range(140):
        observation, _, _, _, info = env.step([-1.0, -0.8])
    joints = [env.unwrapped.data.joint(name) for name in env.unwrapped.joints]
    assert info["in_contact"].all()  # so that every entry is about something
    expected = [
        *[joint.qvel[0] / SPEED for joint in joints],
        *info["goal"],
        *(info["force_raw"] / info["goal"] - 1),
    ]
    np.testing.assert_allclose(observation, expected, atol=1e-12)


def test_finger_positions_are_seen_where_they_are_asked_for():
    env = gymnasium.make(ID, observe_fingers=True, force_type="none")
    env.reset(seed=0)
    observation, *_ = env.step([-1.0, -0.5])
    positions = [env.unwrapped.data.joint(name).qpos[0] / 0.045 for name in env.unwrapped.joints]
    assert observation.shape == (6,)
    assert env.observation_space.contains(observation)
    np.testing.assert_allclose(observation[:2], positions, atol=1e-12)


def test_the_whole_robot_sees_its_other_joints_first():
    env = gymnasium.make(ID, robot="tiago_ta11", joints=names.TIAGO_JOINTS, goal=1.0, visual=False)
    observation, _ = env.reset(seed=0)
    others = len(names.TIAGO_JOINTS) - 2
    assert observation.shape == (others + len(names.TIAGO_JOINTS) + 4,)
    assert env.observation_space.contains(observation)
    data = env.unwrapped.data
    np.testing.assert_allclose(observation[:others], [data.joint(n).qpos[0] for n in names.TIAGO_JOINTS[:-2]])
    _, _, _, _, info = env.step(np.zeros(len(names.TIAGO_JOINTS)))
    assert info["reward_terms"]["approach"] == pytest.approx(-1.0, abs=1e-6)  # both fingers stand still


def test_the_papers_reward_of_the_same_step_is_told():
    env = gymnasium.make(ID)
    env.reset(seed=0)
    for _ in range(130):
        _, reward, _, _, info = env.step([-1.0, -1.0])
        assert info["paper_reward"] == pytest.approx(-np.abs(info["force_raw"] - info["goal"]).sum(), abs=1e-12)
        assert reward == pytest.approx(sum(info["reward_terms"].values()), abs=1e-12)


def test_letting_go_again_and_again_earns_less_than_holding_for_the_same_force_errors():
    """A finger pair that opens and closes on the object, against one that holds a wrong force as far from the goal."""

    def earned(policy):
        env = gymnasium.make(ID, goal=1.0, object_offset=0.0, object="cylinder", object_width=0.04)
        controller = ForcePI.for_env(env)
        _, info = env.reset(seed=0)
        ours, papers, lost = 0.0, 0.0, 0
        for step in range(300):
            action = controller(None, info)
            if step >= 120:
                action = policy(step, action)
            _, reward, _, _, info = env.step(action)
            if step >= 120:
                ours, papers = ours + reward, papers + info["paper_reward"]
                lost += not info["in_contact"].all()
        return ours, papers, lost

    bounced = earned(lambda step, action: np.full(2, 1.0 if step % 40 < 20 else -1.0))
    held = earned(lambda step, action: action)
    assert bounced[2] > 20
    assert held[2] == 0
    assert held[0] > bounced[0]
    # What letting go costs here beyond the force errors, which both rewards have.
    assert bounced[0] < bounced[1] - 0.5 * bounced[2]
    assert held[0] == pytest.approx(held[1], abs=6)  # noise alone: 0.5 · 0.003 · 2 a step, and slow fingers


def test_goals_and_objects_are_drawn_from_the_documented_ranges():
    env = gymnasium.make(ID)
    core = env.unwrapped
    goals, widths, masses, stiffnesses, offsets, shapes = [], [], [], [], [], set()
    for seed in range(40):
        env.reset(seed=seed)
        goals.append(core.goal[0])
        widths.append(core.item.width)
        masses.append(core.item.mass)
        stiffnesses.append(core.item.stiffness)
        offsets.append(core.offset)
        shapes.add(core.item.shape)
    for values, (low, high) in (
        (goals, HoldForceSteady.GOALS),
        (widths, HoldForceSteady.WIDTHS),
        (masses, HoldForceSteady.MASSES),
        (stiffnesses, HoldForceSteady.STIFFNESSES),
        (offsets, HoldForceSteady.OFFSETS),
    ):
        assert low <= min(values) < low + 0.2 * (high - low)
        assert high - 0.2 * (high - low) < max(values) <= high
    assert shapes == {"cylinder", "box"}


def test_weights_are_given_by_name_and_survive_pickling():
    env = gymnasium.make(ID, weights={"contact": 2.0}, goal=0.8)
    assert env.unwrapped.weights == SteadyWeights(contact=2.0)
    twin = pickle.loads(pickle.dumps(env))
    assert twin.unwrapped.weights == SteadyWeights(contact=2.0)
    twin.reset(seed=0)
    assert twin.unwrapped.goal[0] == 0.8


@pytest.mark.parametrize("servo", ["pal", "ideal"])
def test_the_force_controller_solves_it(servo):
    env = gymnasium.make(ID, servo=servo)
    controller = ForcePI.for_env(env)
    for seed in range(3):
        _, info = env.reset(seed=seed)
        controller.reset()
        for _ in range(300):
            _, _, _, _, info = env.step(controller(None, info))
        assert info["in_contact"].all()
        assert np.abs(info["force_raw"] - info["goal"]).max() < 0.15


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ({"weights": {"bounce": 1.0}}, "'bounce' is no term of the reward: use any of force, approach, contact"),
        ({"weights": {"contact": -1.0}}, "contact is -1.0"),
        ({"weights": {"contact": "much"}}, "contact is 'much'"),
        ({"weights": 3}, "weights is 3"),
        ({"reward_type": "sparse"}, "give weights"),
        ({"joints": ("torso_lift_joint",)}, "is of the fingers; give them last"),
        ({"goal": 3.0}, "goal 3 is out of range"),
    ],
    ids=str,
)
def test_a_bad_argument_gets_one_line(arguments, says):
    with pytest.raises(ValueError, match=says) as caught:
        HoldForceSteady(**arguments)
    assert "\n" not in str(caught.value)
