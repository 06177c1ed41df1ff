"""How a change is sought: which set is the reference, and what the servos' motion tells of one set alone."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from made_hinge import recorded

from tiago_mj.change import lost, search
from tiago_mj.change.fitters import DifferenceFitter, JointFitter, differences
from tiago_mj.change.reference import Reference, better_explained
from tiago_mj.effects.spec import Entry
from tiago_mj.gap.detectors import set_points
from tiago_mj.gap.detectors.set_points import ServoMotion
from tiago_mj.gap.inference import hypotheses
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point, Start
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.search import lost_commands, set_point_starts
from tiago_mj.gap.search.state import State
from tiago_mj.gap.simulation.subset import Subset
from tiago_mj.io.deadline import Deadline

NONE = np.zeros(0)
NOTHING = Point((), NONE, NONE)
STEP = 0.0217


@pytest.fixture(scope="module")
def hinge(tmp_path_factory: pytest.TempPathFactory) -> tuple[Predictor, ServoMotion]:
    """Simulations of a hinge without effects and what its servo does."""
    predict, nominal = recorded(tmp_path_factory.mktemp("hinge"))
    seen = set_points.servo_motion(predict.plant, predict.on, predict.data, nominal)
    assert seen is not None
    return predict, seen


def candidates(predict: Predictor, *names: str) -> tuple[hypotheses.Candidate, ...]:
    return tuple(hypotheses.candidates(predict.plant, names))


def measured(predict: Predictor, effects: dict[int, tuple[Entry, ...]]) -> Predictor:
    """The same with what the simulator itself records with the effects of some trials, and noise."""
    value = predict([(t, effects.get(t, ())) for t in range(len(predict.on.trials))])
    value = value + predict.data.noise * np.random.default_rng(0).standard_normal(value.shape)
    return replace(predict, data=replace(predict.data, value=value))


def searching(fitter: Fitter, motion: ServoMotion) -> State:
    pool = candidates(fitter.predict, "command_quantization")
    return State(fitter, fitter, (), NONE, NOTHING, pool=pool, motion=motion)


def flat(predict: Predictor, trials: int) -> np.ndarray:
    return np.zeros((0, trials, *predict.data.value.shape[1:]))


def steps_found(state: State) -> list[float]:
    (nothing,) = state.full.fit_all([Start((), NONE)])
    found = set_point_starts.beside(state, nothing, least=20.0, drivers=False)
    return [float(values[-1]) for start in found for values, _ in ((start.values, None), *start.alternatives)]


def test_a_grid_of_one_set_is_found_in_both_sets_together(hinge: tuple[Predictor, ServoMotion]) -> None:
    predict, motion = hinge
    grid = (Entry("command_quantization", None, {"step": STEP}),)
    predict = measured(predict, {2: grid, 3: grid})
    ones = np.ones(len(predict.data.channels))
    both = JointFitter(
        predict, Subset((0, 1, 2, 3)), predict.data, ones, (), flat(predict, 4), changed=frozenset({2, 3})
    )
    assert both.acting_trials == (2, 3)
    tried = steps_found(searching(both, motion))
    assert min(abs(step - STEP) for step in tried) < 0.003 * STEP
    wrong = replace(both, changed=frozenset({0, 1}))
    assert all(abs(step - STEP) > 0.003 * STEP for step in steps_found(searching(wrong, motion)))


def test_a_grid_of_one_set_is_found_in_differences_whatever_both_have(hinge: tuple[Predictor, ServoMotion]) -> None:
    predict, motion = hinge
    grid, play = Entry("command_quantization", None, {"step": STEP}), Entry("backlash", None, {"width": 0.02})
    value = np.stack([predict([(t, (play, grid))])[0] - predict([(t, (play,))])[0] for t in (0, 1)])
    base = predict.all_trials([(play,)], [0, 1])[0]
    value = value + np.sqrt(2) * predict.data.noise * np.random.default_rng(0).standard_normal(value.shape)
    doubled = replace(predict.data, value=predict.data.value[[0, 1, 0, 1]])
    doubled = replace(doubled, sigma=predict.data.sigma[[0, 1, 0, 1]], common=predict.data.common[[0, 1, 0, 1]])
    apart = differences(doubled, np.concatenate([base, base]), [(2, 0), (3, 1)])
    ones = np.ones(len(predict.data.channels))
    fitter = DifferenceFitter(
        predict, Subset((0, 1)), replace(apart, value=value), ones, (), flat(predict, 2), (play,), partner={0: 0, 1: 1}
    )
    tried = steps_found(searching(fitter, motion))
    assert min(abs(step - STEP) for step in tried) < 0.003 * STEP


def test_which_commands_were_lost_costs_where_they_are_lost(hinge: tuple[Predictor, ServoMotion]) -> None:
    predict, _ = hinge
    (losing,) = candidates(predict, lost_commands.EFFECT)
    losing = replace(losing, selection_penalty=(1.0, 2.0, 4.0, 8.0))
    ones = np.ones(len(predict.data.channels))
    both = JointFitter(
        predict, Subset((0, 1, 2, 3)), predict.data, ones, (), flat(predict, 4), changed=frozenset({2, 3})
    )
    assert both.selection_penalty(losing) == 12.0
    assert both.of_both().selection_penalty(losing) == 15.0
    pairs = DifferenceFitter(predict, Subset((2, 3)), predict.data, ones, (), flat(predict, 2), partner={2: 0, 3: 1})
    assert pairs.selection_penalty(losing) == 12.0
    assert pairs.of_both().selection_penalty(losing) == 15.0


def side(left: float, prior: float, parts: tuple[Any, ...] = ()) -> Reference:
    fit = Fitted(parts, np.ones(len(parts)), np.ones(len(parts)), NONE, -100.0, left, prior=prior)
    return Reference(Subset((0,)), fit, (), (), SimpleNamespace())  # type: ignore[arg-type]


def test_where_only_noise_is_left_the_set_with_likelier_numbers_is_the_reference(
    hinge: tuple[Predictor, ServoMotion],
) -> None:
    assert better_explained([side(0.369, -0.1), side(0.353, -4.2)]) == 0
    assert better_explained([side(1.1, -4.2), side(1.0, -0.1)]) == 1
    assert better_explained([side(3.0, -0.1), side(1.0, -9.0)]) == 1
    friction = candidates(hinge[0], "coulomb_friction")
    assert better_explained([side(0.9, -4.0, friction), side(1.1, -6.0)]) == 1  # fewer effects explain it as well


def found(left: float, nothing: float) -> search.Found:
    part = SimpleNamespace(label=("friction", None))
    one = Fitted((part,), np.ones(1), np.ones(1), NONE, -10.0, left)  # type: ignore[arg-type]
    none = Fitted((), NONE, NONE, NONE, -1000.0, nothing)
    ranked = SimpleNamespace(fits=(one, none), predict=SimpleNamespace(replays=True))
    return search.Found(ranked, 0, SimpleNamespace())  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("left", "nothing", "reference"),
    [
        ((14.0, 1.0), 15.0, 1),
        ((1.0, 1.0), 15.0, 0),
        ((5.0, 1.0), 15.0, 0),  # a part, and the larger one
        ((14.0, 14.0), 15.0, 0),
        ((2.0, 1.0), 2.1, 0),  # no more than a verdict passes
    ],
)
def test_the_other_set_is_the_reference_where_a_change_of_the_first_explains_little(
    monkeypatch: pytest.MonkeyPatch, left: tuple[float, float], nothing: float, reference: int
) -> None:
    sides = [side(0.4, -0.1), side(0.4, -4.0)]
    monkeypatch.setattr(search, "nominal", lambda *_: list(sides))
    monkeypatch.setattr(
        search, "changes", lambda compared, known, *_, **__: found(left[0 if known is sides[0] else 1], nothing)
    )
    which, known, told = search.explained(SimpleNamespace(), [(0,), (1,)], Deadline())  # type: ignore[arg-type]
    assert which == reference
    assert known is sides[reference]
    assert told.ranked.fits[0].misfit == left[reference]


def test_the_share_of_lost_commands_is_counted_in_each_set(hinge: tuple[Predictor, ServoMotion]) -> None:
    predict, motion = hinge
    shares, losing = (0.1, 0.4), Entry(lost_commands.EFFECT, None, {"probability": 0.2})
    rng = np.random.default_rng(1)
    delivered = np.ones(predict.on.commands.shape)
    for trials, share in zip(((0, 1), (2, 3)), shares, strict=True):
        delivered[list(trials)] = rng.random(delivered[list(trials)].shape) > share
    value = predict.with_delivered(delivered).all_trials([(losing,)], range(4))[0]
    value = value + predict.data.noise * rng.standard_normal(value.shape)
    there = replace(predict, data=replace(predict.data, value=value))
    compared: Any = SimpleNamespace(
        predict=there,
        proposed=SimpleNamespace(servo_motion=motion, pool=candidates(predict, lost_commands.EFFECT)),
    )
    known = replace(side(0.4, -0.1), trials=Subset((0, 1)), common=(losing,), found=(losing,), delivered=delivered)
    (few,), (many,) = lost.counted(compared, known, [(0, 1), (2, 3)])
    assert few.value == pytest.approx(shares[0], abs=3 * few.deviation)
    assert many.value == pytest.approx(shares[1], abs=3 * many.deviation)
    assert many.value - few.value > 2 * np.hypot(few.deviation, many.deviation)
    assert lost.counted(compared, replace(known, delivered=None), [(0, 1), (2, 3)]) == [(), ()]


def test_recordings_that_lose_commands_do_not_repeat_each_other() -> None:
    time, sent = np.arange(5.0), {"hinge": np.arange(5.0)}
    trial = SimpleNamespace(time=time, commands=sent)
    compared: Any = SimpleNamespace(
        session=SimpleNamespace(trials=[trial, trial]), predict=SimpleNamespace(replays=True)
    )
    known = side(0.4, -0.1)
    assert search._paired(compared, known, (1,)) == [(1, 0)]
    assert search._paired(compared, replace(known, delivered=np.ones((2, 4, 1))), (1,)) == []
