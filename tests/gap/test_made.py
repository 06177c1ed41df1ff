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


def steps(predict: Predictor) -> int:
    """Of one simulation."""
    return replay.physics_steps(predict.plant, predict.on)


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
    assert predict.tally["physics_steps"] == 9 * steps(predict)
    assert predict.physics_steps == 5 * steps(predict)


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
    for key in "abca":
        made.keep(key, simulation(1.0))
    made.keep("d", simulation(2.0))
    assert [key for key in "abcd" if key in made] == ["a", "c", "d"]
    assert [key for key in "abcd" if made.get(key) is not None] == ["a", "c", "d"]
    made.keep("e", (np.zeros(1000),))  # alone too large
    assert not any(key in made or made.get(key) is not None for key in "abcde")


def test_it_keeps_copies():
    made, batch = Made(), np.zeros((2, 5))
    made.keep("a", (batch[0],))
    batch[:] = 1.0
    assert not made.get("a")[0].any()
    assert made.get("a")[0].base is None


def test_what_an_earlier_run_asked_for_is_known_without_its_signals_and_forgotten_as_it_was():
    earlier, later = Made(largest=3 * SIZE), Made(largest=3 * SIZE)
    for key in "abcad":
        earlier.keep(key, simulation(1.0))
    later.replay(earlier.asked[:3])
    assert [key for key in "abc" if key in later] == ["a", "b", "c"]
    assert later.get("a") is None
    for key in "ad":
        later.keep(key, simulation(1.0))
    assert [key in later for key in "abcd"] == [key in earlier for key in "abcd"]
    assert later.get("a")[0][0] == 1.0
    assert later.asked == earlier.asked


def test_what_an_earlier_run_made_is_made_again_and_counts_as_it_would_have(hinge):
    wanted = [(trial, (LATE,)) for trial in range(3)]
    whole = asking(hinge)
    first = whole(wanted[:2])
    asked, counts = list(whole.made.asked), type(whole.tally)(whole.tally)
    goes_on = asking(hinge)
    goes_on.made.replay(asked)
    goes_on.tally.update(counts)
    np.testing.assert_array_equal(goes_on(wanted), whole(wanted))
    np.testing.assert_array_equal(goes_on(wanted)[:2], first)
    assert goes_on.tally == whole.tally + type(whole.tally)(
        simulations=3, repeated=3, physics_steps=3 * steps(whole), repeated_steps=3 * steps(whole)
    )
    assert goes_on.physics_steps == whole.physics_steps == 3 * steps(whole)
