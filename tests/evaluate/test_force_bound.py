"""The least cost of an episode: where it comes from, and that nothing stays below it."""

import json
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest

import tiago_mj  # noqa: F401
from tiago_mj.control.force_pi import ForcePI
from tiago_mj.evaluate.bound import expected_distance, free_travel, least_cost
from tiago_mj.sensing.load_cell import TA11_NOISE, LoadCell

SERVOS = ["pal", "ideal"]
ROOT = Path(__file__).parents[2]


def quiet(servo="pal", **arguments):
    arguments = {"object_offset": 0.0, "visual": False, "sensing": LoadCell(noise=0.0, threshold=0.04), **arguments}
    env = gymnasium.make("tiago_mj/GripperTactileGoal-v0", servo=servo, **arguments).unwrapped
    env.reset(seed=0)
    return env


def cost_of(env, actions):
    return sum(-env.step(action)[1] for action in actions)


@pytest.mark.parametrize("servo", SERVOS)
@pytest.mark.parametrize(
    "arguments",
    [{}, {"object_offset": 0.004}, {"object_offset": -0.006, "object": "box"}, {"object_width": 0.03, "goal": 0.6}],
    ids=str,
)
def test_the_first_contacts_are_where_the_simulator_has_them(servo, arguments):
    """Fingers that close at the limit touch in exactly the steps that the bound counts from."""
    env = quiet(servo, **arguments)
    bound = least_cost(env, 300)
    contact = []
    for _ in range(150):
        contact.append(env.step([-1.0, -1.0])[4]["in_contact"])
    contact = np.array(contact)
    assert bound.first_contact == np.argmax(contact.any(axis=1)) + 1
    if env.offset == 0:
        assert bound.both_contacts == np.argmax(contact.all(axis=1)) + 1
    else:  # the far finger may wait for an object that friction holds, but is never there sooner
        assert bound.first_contact < bound.both_contacts <= np.argmax(contact.all(axis=1)) + 1


def closed(env, actions):
    """Distance by which each finger has closed after every step."""
    env.reset(seed=0)
    begin = env.data.qpos[env.qpos_address].copy()
    rows = []
    for action in actions:
        env.step(action)
        rows.append(begin - env.data.qpos[env.qpos_address])
    return np.array(rows)


@pytest.mark.parametrize("servo", SERVOS)
def test_a_pulse_of_speed_moves_a_finger_to_one_side_at_all_times(servo):
    """The bound's first fact: with this response every command below the limit leaves the finger behind."""
    env = quiet(servo, object_width=0.01)
    actions = np.full((60, 2), -0.5)
    base = closed(env, actions)
    actions[0] = [-0.6, -0.5]
    response = closed(env, actions) - base
    # 0.1 · 0.08 m/s for 1/240 s are 33 µm in the end; a millionth of it is rounding.
    assert response[-1, 0] == pytest.approx(0.1 * 0.08 / 240, rel=0.01)
    assert (response[:, 0] > -1e-11).all()
    np.testing.assert_allclose(response[:, 1], 0, atol=1e-11)
    # It is linear: twice the pulse, twice the response.
    actions[0] = [-0.7, -0.5]
    np.testing.assert_allclose(closed(env, actions) - base, 2 * response, atol=1e-11)


@pytest.mark.parametrize("servo", SERVOS)
def test_no_finger_is_ever_ahead_of_one_that_closes_at_the_limit(servo):
    """Random commands, up to where the object is touched and beyond."""
    env = quiet(servo)
    limit = closed(quiet(servo, object_width=0.005), -np.ones((120, 2)))
    assert (free_travel(env, 120) < limit).all()  # it is of one physics step before
    rng = np.random.default_rng(0)
    for _ in range(30):
        actions = np.repeat(rng.choice([-1.0, -1.0, 1.0, 0.0], (120, 2)), rng.integers(1, 20), axis=0)[:120]
        assert (closed(env, actions) <= limit + 1e-9).all()


@pytest.mark.parametrize("servo", SERVOS)
def test_a_controller_costs_more_than_the_bound_and_not_much_more(servo):
    env = quiet(servo)
    bound = least_cost(env, 300)
    controller = ForcePI.for_env(env)
    _, info = env.reset(seed=0)
    cost = 0.0
    for _ in range(300):
        _, reward, _, _, info = env.step(controller(None, info))
        cost -= reward
    assert bound.exact <= bound.pressed < cost < 1.1 * bound.exact


@pytest.mark.parametrize("servo", SERVOS)
def test_random_ways_of_closing_stay_above_the_bound(servo):
    """Off the middle, where the object can be pushed and batted, too."""
    env = quiet(servo, object_offset=0.005)
    bound = least_cost(env, 150)
    rng = np.random.default_rng(1)
    for _ in range(8):
        env.reset(seed=0)
        actions = -np.ones((150, 2))
        begin = int(rng.integers(60, 90))
        actions[begin:] = np.repeat(rng.uniform(-1, 0.6, (30, 2)), 5, axis=0)[: 150 - begin]
        assert cost_of(env, actions) > bound.exact


def test_the_bound_of_a_centred_object_is_both_goals_until_contact():
    env = quiet()
    bound = least_cost(env, 300)
    assert bound.exact == pytest.approx(2 * 1.0 * (bound.first_contact - 1))
    # 25.2 mm at 0.08 m/s and 40 ms of lag: 315 ms + 40 ms = 85.2 steps of 1/240 s
    assert bound.first_contact == pytest.approx(86, abs=1)


def test_an_episode_too_short_to_touch_costs_its_goals():
    assert least_cost(quiet(goal=0.5), 20).exact == pytest.approx(20 * 2 * 0.5)


def test_noise_costs_its_mean_magnitude_at_the_goal():
    draws = np.random.default_rng(0).normal(0, TA11_NOISE, 400_000)
    for distance in (0.0, 0.003, 0.02, 1.0):
        found = expected_distance(np.array([distance]), np.array(TA11_NOISE))[0]
        # The mean of 4e5 samples is known to 0.0077 / sqrt(4e5) = 1.2e-5; five of these.
        assert found == pytest.approx(np.abs(distance + draws).mean(), abs=6e-5)
    assert expected_distance(np.array([0.3]), np.zeros(1))[0] == 0.3
    noisy, silent = least_cost(quiet(sensing="ta11"), 300), least_cost(quiet(), 300)
    rest = 300 - (noisy.first_contact - 1)
    assert noisy.expected == pytest.approx(silent.exact + rest * 2 * TA11_NOISE * np.sqrt(2 / np.pi), rel=1e-6)


def test_the_benchmarks_committed_figures_are_those_of_this_simulator():
    found = json.loads((ROOT / "benchmarks/results/force_bound.json").read_text())["results"]
    for servo in SERVOS:
        bound = least_cost(quiet(servo), 300)
        row = found[servo]
        assert row["exact"]["reward"] == pytest.approx(-bound.exact, abs=1e-6)
        assert row["pressed"]["reward"] == pytest.approx(-bound.pressed, abs=1e-3)  # sums of 30 forces
        env = quiet(servo)
        begin = row["achieved"]["from_step"] - 1
        for _ in range(begin):
            env.step([-1.0, -1.0])
        forces = [env.step([action, action])[4]["force_raw"] for action in row["achieved"]["actions"]]
        np.testing.assert_allclose(forces, row["achieved"]["forces"], atol=1e-3)  # written to 4 digits
        assert -row["achieved"]["reward"] >= bound.exact


def test_the_benchmark_and_the_search_of_gains_run(tmp_path):
    pytest.importorskip("cma")
    import shutil

    shutil.copytree(ROOT / "benchmarks", tmp_path / "benchmarks", ignore=shutil.ignore_patterns("results", "blind"))
    for words in (
        ["force_bound.py", "--servos", "pal", "--evaluations", "30"],
        ["pi_search.py", "--servos", "pal", "--steps", "32000"],
    ):
        command = [sys.executable, f"benchmarks/{words[0]}", *words[1:]]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stderr[-2000:]
    row = json.loads((tmp_path / "benchmarks/results/pi_search.json").read_text())["results"]["pal"]
    assert 0 < row["steps"] <= 32000
    assert row["reward"]["mean"] >= row["documented"]["reward"]["mean"] - 1  # it begins there
