"""Simulations that are asked for again are remembered: predictions stay the same, and less is simulated."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from made_hinge import recorded

from tiago_mj.effects.spec import Entry
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.simulation import replay
from tiago_mj.gap.simulation.made import Made

LATE = Entry("command_lag", None, {"time_constant": 0.02})
FILTERED = Entry("velocity_filter", None, {"time_constant": 0.02})
LOST = Entry("dropped_commands", None, {"probability": 0.2})
#: Bytes of each simulation below.
SIZE = 80


@pytest.fixture(scope="module")
def hinge(tmp_path_factory: pytest.TempPathFactory) -> Predictor:
    return recorded(tmp_path_factory.mktemp("hinge"))[0]


def asking(hinge: Predictor) -> Predictor:
    """The same with nothing remembered, and a tally of its own."""
    return replace(hinge, on=replace(hinge.on), tally=type(hinge.tally)(), _kept={}, _beside={})


def simulation(value: float) -> tuple[np.ndarray, ...]:
    return (np.full(SIZE // 8, value),)


def test_what_was_simulated_is_not_simulated_again(hinge, monkeypatch):
    predict, wanted, made = asking(hinge), [(trial, (LATE,)) for trial in range(4)], []
    simulate = replay.simulate
    monkeypatch.setattr(replay, "simulate", lambda *a: made.append(len(a[2])) or simulate(*a))
    first = predict(wanted)
    again = predict([*wanted, (0, ())])
    np.testing.assert_array_equal(again[:4], first)
    assert made == [4, 1]
    steps = replay.physics_steps(predict.plant, predict.on)
    assert predict.tally["physics_steps"] == 9 * steps
    assert predict.physics_steps == 5 * steps


def test_what_was_simulated_at_the_rows_is_not_taken_for_what_is_asked_between_them(hinge):
    predict = asking(hinge)
    rows = predict([(0, (LATE,))])
    parts = predict([(0, (LATE, FILTERED))])
    assert predict.tally["repeated"] == 0
    np.testing.assert_array_equal(predict([(0, (LATE,))]), rows)
    np.testing.assert_array_equal(predict([(0, (LATE, FILTERED))]), parts)
    assert predict.tally["repeated"] == 2


def test_a_step_error_is_found_beside_what_was_simulated(hinge):
    predict = asking(hinge)
    fresh = predict.corrected_beside([(0, (LATE,))])([(0, (LATE,))])
    again = asking(hinge)
    again([(0, (LATE, FILTERED))])  # in parts, as the step's error is found
    before = again.tally["repeated"]
    np.testing.assert_array_equal(again.corrected_beside([(0, (LATE,))])([(0, (LATE,))]), fresh)
    assert again.tally["repeated"] > before


def test_another_simulator_or_other_commands_share_no_memory(hinge):
    predict = asking(hinge)
    coarse = predict([(0, (LATE,))])
    finer = replace(predict, plant=replace(predict.plant, max_timestep=predict.plant.max_timestep / 3), off=None)
    assert not np.array_equal(finer([(0, (LATE,))]), coarse)
    everything = np.ones((len(predict.on.trials), *predict.on.commands.shape[1:]))
    everything[:, ::2] = 0.0
    assert not np.array_equal(predict.with_delivered(everything)([(0, (LATE, LOST))]), coarse)
    assert predict.tally["repeated"] == 0
    np.testing.assert_array_equal(predict([(0, (LATE,))]), coarse)
    assert predict.tally["repeated"] == 1


def test_what_is_drawn_at_random_is_not_remembered(hinge):
    predict = asking(hinge)
    predict([(0, (LOST,))])
    predict([(0, (LOST,))])
    assert predict.tally["repeated"] == 0


def test_the_longest_unasked_is_forgotten_where_there_is_no_room():
    made = Made(largest=3 * SIZE)
    for key in "abc":
        made.keep(key, simulation(1.0))
    assert made.get("a") is not None
    made.keep("d", simulation(2.0))
    assert [key for key in "abcd" if made.get(key) is not None] == ["a", "c", "d"]
    made.keep("d", simulation(3.0))
    assert [key for key in "acd" if made.get(key) is not None] == ["a", "c", "d"]
    assert made.get("d")[0][0] == 3.0
    made.keep("e", (np.zeros(1000),))  # alone too large
    assert [key for key in "acde" if made.get(key) is not None] == []


def test_it_keeps_copies():
    made, batch = Made(), np.zeros((2, 5))
    made.keep("a", (batch[0],))
    batch[:] = 1.0
    assert not made.get("a")[0].any()
    assert made.get("a")[0].base is None
