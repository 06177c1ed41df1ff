"""What the first pass cannot see is looked for beside what explains the rest: grids of the set point, others of a
class, and what the physics step gets wrong."""

from dataclasses import replace

import numpy as np
import pytest
from made_hinge import recorded

from tiago_mj.effects.spec import Entry
from tiago_mj.gap.detectors import set_points
from tiago_mj.gap.detectors.set_points import ServoMotion
from tiago_mj.gap.inference import hypotheses
from tiago_mj.gap.inference.fit import Fitter, Point, Start
from tiago_mj.gap.inference.hypotheses import Candidate
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.search import additions, set_point_starts, starts
from tiago_mj.gap.search.state import State
from tiago_mj.gap.simulation.subset import Subset


@pytest.fixture(scope="module")
def hinge(tmp_path_factory: pytest.TempPathFactory) -> tuple[Predictor, ServoMotion]:
    """Recordings of a hinge without effects, by the independent reality with the nominal model's own numbers."""
    predict, nominal = recorded(tmp_path_factory.mktemp("hinge"))
    seen = set_points.servo_motion(predict.plant, predict.on, predict.data, nominal)
    assert seen is not None
    return predict, seen


def with_effects(predict: Predictor, *effects: Entry) -> Predictor:
    """The same with what the simulator itself would record with effects, and noise."""
    value = predict.all_trials([effects], range(len(predict.on.trials)))[0]
    value = value + predict.data.noise * np.random.default_rng(0).standard_normal(value.shape)
    return replace(predict, data=replace(predict.data, value=value))


def candidate(predict: Predictor, name: str) -> Candidate:
    return hypotheses.candidates(predict.plant, (name,))[0]


def searching(predict: Predictor, motion: ServoMotion | None, *names: str) -> State:
    """A search for effects, by name, in all trials, that knows the nominal numbers."""
    data = predict.data
    flat = np.zeros((0, *data.value.shape))
    fitter = Fitter(predict, Subset.of(range(len(data.value))), data, np.ones(len(data.channels)), (), flat)
    pool = tuple(hypotheses.candidates(predict.plant, names))
    return State(fitter, fitter, (), np.zeros(0), Point((), np.zeros(0), np.zeros(0)), pool=pool, motion=motion)


def test_a_grid_is_found_beside_a_delay_that_hides_it(hinge: tuple[Predictor, ServoMotion]) -> None:
    predict, motion = hinge
    step, seconds = 0.0217, 0.04
    delay, grid = (
        Entry("command_delay", None, {"seconds": seconds}),
        Entry("command_quantization", None, {"step": step}),
    )
    measured = with_effects(predict, delay, grid)
    state = searching(measured, motion, "command_quantization")
    late = candidate(measured, "command_delay")
    (fit,) = state.full.fit_all([Start((late,), np.array([seconds]))])
    found, *by_driver = set_point_starts.beside(state, fit, least=5.0)
    assert all(dict(each.parts[-1].fixed)["period"] > 0 for each in by_driver)  # often: nearly the same
    tried = [values[-1] for values, _ in ((found.values, None), *found.alternatives)]
    assert min(abs(value - step) for value in tried) < 0.002 * step  # a line at 1 rad moves by a tenth of a step
    assert [part.effect for part in found.parts] == ["command_delay", "command_quantization"]


def test_a_drivers_dead_band_and_period_are_found_together(hinge: tuple[Predictor, ServoMotion]) -> None:
    predict, motion = hinge
    width, period = 0.019, 0.005
    measured = with_effects(predict, Entry("command_deadband", None, {"width": width, "period": period}))
    state = searching(measured, motion, "command_deadband")
    (fit,) = state.full.fit_all([Start((), np.zeros(0))])
    found = set_point_starts.beside(state, fit, least=5.0)
    best = state.with_fits(state.full.fit_all(found)).best
    assert dict(best.parts[0].fixed)["period"] == period
    assert best.values[0] == pytest.approx(width, rel=0.005)  # flat between two widths that set points tell apart


def test_what_shares_the_grid_of_the_best_is_fitted_with_it(hinge: tuple[Predictor, ServoMotion]) -> None:
    """A grid has no slope to follow: 2 % off, the right explanation stays far behind a wrong one that was looked for
    again."""
    predict, motion = hinge
    step, friction = 0.0217, 0.05
    grid = Entry("command_quantization", None, {"step": step})
    measured = with_effects(predict, Entry("coulomb_friction", None, {"force": friction}), grid)
    state = searching(measured, motion, "command_quantization")
    coulomb, uneven = (candidate(measured, name) for name in ("coulomb_friction", "asymmetric_friction"))
    rounds_off = candidate(measured, "command_quantization")
    held = replace(state.full, iterations=0)
    wrong = held.fit_all([Start((uneven, rounds_off), np.array([0.05, step]))])
    right = held.fit_all([Start((coulomb, rounds_off), np.array([friction, 0.98 * step]))])
    assert right[0].evidence < wrong[0].evidence
    again = set_point_starts.looked_for_again(state.with_fits([*wrong, *right]))
    assert [part.effect for part in again.best.parts] == ["coulomb_friction", "command_quantization"]
    assert again.best.values == pytest.approx([friction, step], rel=0.01)


@pytest.mark.slow
def test_where_no_grid_is_none_is_tried(hinge: tuple[Predictor, ServoMotion]) -> None:
    predict, motion = hinge
    measured = with_effects(predict, Entry("command_delay", None, {"seconds": 0.04}))
    state = searching(measured, motion, "command_quantization", "command_deadband")
    (fit,) = state.full.fit_all([Start((candidate(measured, "command_delay"),), np.array([0.04]))])
    assert set_point_starts.beside(state, fit, least=20.0) == []
    assert set_point_starts.beside(replace(state, motion=None), fit, least=0.0) == []


def test_an_effect_is_exchanged_for_another_of_its_class(hinge: tuple[Predictor, ServoMotion]) -> None:
    """A spring behind the gears looks like a weaker servo, which promises more beside what else is wrong."""
    predict, motion = hinge
    stiffness = 15.0
    spring, slow = Entry("joint_elasticity", None, {"stiffness": stiffness}), Entry("armature", None, {"mass": 0.02})
    measured = with_effects(predict, spring, slow)
    names = "torque_constant", "joint_elasticity", "armature"
    state = searching(measured, motion, *names)
    parts = candidate(measured, "torque_constant"), candidate(measured, "armature")
    (best,) = state.full.fit_all([Start(parts, np.array([0.6, 0.02]))])
    exchanged = additions.exchanged(state.full, best, 2, state.pool, gap=True)
    assert [[part.effect for part in start.parts] for start in exchanged] == [["joint_elasticity", "armature"]]
    (fit,) = state.full.fit_all(exchanged)
    assert fit.evidence > best.evidence + 20.0
    (again,) = state.full.fit_all([starts.restart(fit)])  # what yields and what is heavy change with each other
    assert again.values[0] == pytest.approx(stiffness, rel=0.1)


def test_a_twin_is_tried_in_its_place_even_where_no_gap_is_left(hinge: tuple[Predictor, ServoMotion]) -> None:
    """A lag is behind by as much as a delay at a constant speed."""
    predict, motion = hinge
    measured = with_effects(predict, Entry("command_delay", None, {"seconds": 0.04}))
    state = searching(measured, motion, "command_lag", "command_delay", "armature")
    (lag,) = state.full.fit_all([Start((candidate(measured, "command_lag"),), np.array([0.04]))])
    exchanged = additions.exchanged(state.full, lag, 2, state.pool, gap=False)
    assert [[part.effect for part in start.parts] for start in exchanged] == [["command_delay"]]
    (fit,) = state.full.fit_all(exchanged)
    assert fit.evidence > lag.evidence + 20.0
    assert fit.values[0] == pytest.approx(0.04, abs=1e-3)
    known = {frozenset(part.label for part in fit.parts)}
    assert additions.exchanged(state.full, lag, 2, state.pool, known, gap=False) == []


def test_a_stiffness_is_tried_over_all_its_decades(hinge: tuple[Predictor, ServoMotion]) -> None:
    spring = candidate(hinge[0], "joint_elasticity")
    assert spring.grid[0] == spring.high
    assert spring.grid[-1] == pytest.approx(spring.low)
    ratios = np.array(spring.grid[:-1]) / np.array(spring.grid[1:])
    assert (ratios < hypotheses.STIFFNESS_RATIO * 1.01).all()


def test_the_step_error_beside_an_explanation_is_its_own(hinge: tuple[Predictor, ServoMotion]) -> None:
    """Of friction that a joint sticks and slips with, the nominal model's step error says little."""
    predict, _ = hinge
    trials = range(len(predict.on.trials))
    effects = (Entry("coulomb_friction", None, {"force": 0.4}), Entry("command_delay", None, {"seconds": 0.03}))
    finest = replace(predict.plant, max_timestep=predict.plant.max_timestep / 16)
    true = replace(predict, plant=finest, corrected=False).all_trials([effects], trials)[0]
    there = replace(predict, corrected=True)
    beside = there.corrected_beside([(trial, effects) for trial in trials])

    def error(by: Predictor) -> float:
        return float(np.sqrt(np.mean(((by.all_trials([effects], trials)[0] - true) / predict.data.noise) ** 2)))

    assert error(beside) < 0.5 * error(there)
    assert error(beside) < 0.5 * error(replace(predict, corrected=False))
    drawn = [(trial, (Entry("dropped_commands", None, {"probability": 0.1}),)) for trial in trials]
    assert there.corrected_beside(drawn) is there
