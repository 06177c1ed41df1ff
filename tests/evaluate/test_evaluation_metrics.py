"""Metrics of traces made by hand, whose answer is known."""

from dataclasses import fields, replace

import numpy as np
import pytest

from tiago_mj.evaluate.metrics import SHOWN, Metrics, Spread, bounces, contact_share, measure, summarise
from tiago_mj.rollout import Trace

NEWTONS = 6.0  # of one sensor unit, in these traces


def trace(force, *, contact=None, goal=1.0, place=None, dt=0.01):
    """An episode of two fingers with these readings, (T, 2), without noise."""
    force = np.asarray(force, dtype=float)
    steps = len(force)
    return Trace(
        time=dt * np.arange(1, steps + 1),
        reward=-np.abs(force - goal).sum(axis=1),
        success=np.zeros(steps, dtype=bool),
        goal=np.full(2, goal),
        force=force,
        force_contact=NEWTONS * force,
        in_contact=force > 0 if contact is None else np.asarray(contact, dtype=bool),
        position=np.zeros((steps, 2)),
        object_position=np.zeros((steps + 1, 3)) if place is None else np.asarray(place, dtype=float),
        goal_newtons=np.full(2, NEWTONS * goal),
        threshold=np.zeros(2),
    )


def test_a_grasp_that_is_held_has_no_bounce_and_all_of_the_contact():
    held = measure(trace([[0, 0], [0, 0.5], [0.5, 0.5], [1, 1], [1, 1]]))
    assert held.bounces == 0
    assert held.contact_share == 1.0
    assert held.both_contacts == pytest.approx(0.03)
    assert held.reward == held.paper_reward == pytest.approx(-(2 + 1.5 + 1))
    assert held.rest_error == 0
    assert held.overshoot == 0
    assert held.peak_force == pytest.approx(NEWTONS)


def test_every_loss_of_contact_of_either_finger_is_a_bounce():
    right = [0, 1, 0, 1, 1, 0, 0]  # lost twice
    left = [0, 0, 1, 1, 0, 1, 1]  # lost once
    contact = np.array([right, left], dtype=bool).T
    assert bounces(contact) == 3
    # both have touched by the third step; of the five from there on, both touch in one
    assert contact_share(contact) == pytest.approx(1 / 5)


def test_an_object_batted_to_and_fro_is_never_held():
    contact = np.array([[1, 0], [0, 0], [0, 1], [0, 0], [1, 0], [0, 0], [0, 1]], dtype=bool)
    batted = measure(trace(1.0 * contact))
    assert batted.bounces == 3
    assert batted.contact_share == 0.0
    assert batted.both_contacts is None


def test_the_approach_before_both_have_touched_is_no_loss_of_contact():
    assert contact_share(np.array([[0, 0], [1, 0], [1, 0], [1, 1]], dtype=bool)) == 1.0


def test_a_finger_that_never_touches_leaves_no_share():
    alone = measure(trace([[0, 0], [0, 0.5], [0, 0.5]]))
    assert alone.contact_share is None
    assert alone.both_contacts is None
    assert alone.bounces == 0


def test_contact_is_the_simulators_and_not_the_readings():
    noisy = trace(np.full((4, 2), 0.1), contact=np.zeros((4, 2)))
    assert measure(noisy).bounces is None  # there was no contact to lose
    assert measure(noisy).both_contacts is None


def test_the_error_at_rest_is_that_of_the_mean_of_the_last_tenth():
    force = np.full((20, 2), 5.0)
    force[18:] = [[1.3, 0.9], [1.1, 0.9]]  # means 1.2 and 0.9: 0.2 and 0.1 away
    assert measure(trace(force)).rest_error == pytest.approx(0.15)


def test_noise_around_the_goal_is_no_error_at_rest():
    force = np.ones((40, 2))
    force[36:] += np.array([[0.1], [-0.1], [0.1], [-0.1]])
    assert measure(trace(force)).rest_error == pytest.approx(0.0, abs=1e-12)


def test_overshoot_is_the_share_by_which_the_worse_finger_exceeds_its_goal():
    over = measure(trace([[0, 0], [1.0, 2.5], [2.0, 2.0]], goal=2.0))
    assert over.overshoot == pytest.approx(0.25)
    assert over.peak_force == pytest.approx(2.5 * NEWTONS)


def test_the_objects_way_counts_both_directions_and_its_shift_does_not():
    place = [[0, 0, 0.1], [0, 0.003, 0.1], [0, -0.001, 0.1], [0.003, 0.003, 0.1]]
    moved = measure(trace(np.zeros((3, 2)), place=place))
    assert moved.object_path == pytest.approx(0.003 + 0.004 + 0.005)
    assert moved.object_shift == pytest.approx(np.hypot(0.003, 0.003))


def test_an_object_that_sinks_into_the_table_has_not_moved():
    sunk = measure(trace(np.zeros((2, 2)), place=[[0, 0, 0.1], [0, 0, 0.0999], [0, 0, 0.0999]]))
    assert sunk.object_path == sunk.object_shift == 0


def test_what_an_environment_does_not_have_is_left_out():
    bare = replace(
        trace(np.zeros((3, 2))),
        force=np.zeros((3, 0)),
        force_contact=np.zeros((3, 0)),
        in_contact=np.zeros((3, 0), dtype=bool),
        object_position=np.zeros((4, 0)),
        goal_newtons=None,
        reward=np.array([-1.0, -2.0, -3.0]),
        success=np.array([False, False, True]),
    )
    found = measure(bare)
    assert (found.reward, found.success) == (-6.0, 1.0)
    others = {field.name for field in fields(Metrics)} - {"reward", "success"}
    assert {name for name in others if getattr(found, name) is None} == others


def test_a_summary_is_the_mean_and_the_samples_deviation_of_those_that_have_a_metric():
    one, two = measure(trace([[1, 1]])), measure(trace([[0, 1]]))
    summary = summarise([one, two, two])
    rewards = [0.0, -1.0, -1.0]
    assert summary["reward"] == Spread(pytest.approx(np.mean(rewards)), pytest.approx(np.std(rewards, ddof=1)), 3)
    assert summary["contact_share"] == Spread(1.0, None, 1)
    assert set(SHOWN) == set(summary)
