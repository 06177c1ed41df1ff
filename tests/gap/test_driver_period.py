"""How often a driver looks at its set point is found together with the width of its dead band."""

from dataclasses import replace

import numpy as np
import pytest
from made_hinge import recorded

from tiago_mj.effects.spec import Entry
from tiago_mj.gap.inference import hypotheses
from tiago_mj.gap.inference.fit import Fitter, Point, Start
from tiago_mj.gap.search import driver_period
from tiago_mj.gap.search.state import State
from tiago_mj.gap.simulation.subset import Subset

WIDTH = 0.017


@pytest.fixture(scope="module")
def searching(tmp_path_factory: pytest.TempPathFactory) -> State:
    """A search in recordings of the simulator itself, with a driver that looks at its set point every 5 ms."""
    predict, _ = recorded(tmp_path_factory.mktemp("hinge"))
    trials = predict.on.trials
    true = Entry("command_deadband", None, {"width": WIDTH, "period": 0.005})
    value = predict.all_trials([(true,)], range(len(trials)))[0]
    value = value + predict.data.noise * np.random.default_rng(0).standard_normal(value.shape)
    predict = replace(predict, data=replace(predict.data, value=value))
    flat = np.zeros((0, *value.shape))
    fitter = Fitter(predict, Subset.of(range(len(trials))), predict.data, np.ones(len(predict.data.channels)), (), flat)
    return State(fitter.part([0]), fitter, (), np.zeros(0), Point((), np.zeros(0), np.zeros(0)))


def test_a_driver_that_looks_now_and_then_is_found(searching: State) -> None:
    full = searching.full
    band = next(c for c in hypotheses.candidates(full.predict.plant, ("command_deadband",)))
    at_every_command = replace(band, fixed=(("period", 0.0),))
    begin = [Start((), np.zeros(0)), Start((at_every_command,), np.array([1.02 * WIDTH]))]
    state = replace(searching, fits=tuple(full.fit_all(begin)))
    after = driver_period.tried(state)
    found = after.best
    assert dict(found.parts[0].fixed)["period"] == pytest.approx(0.005, rel=0.01)
    assert found.values[0] == pytest.approx(WIDTH, rel=0.01)
    assert found.evidence > state.best.evidence + 20.0
    assert driver_period.tried(after) is after  # once for each set of effects


def test_a_driver_is_found_from_behind_another_explanation(searching: State) -> None:
    plant = searching.full.predict.plant
    band, rub = (hypotheses.candidates(plant, (name,))[0] for name in ("command_deadband", "coulomb_friction"))
    at_every_command = replace(band, fixed=(("period", 0.0),))
    begin = [Start((rub,), np.array([0.5])), Start((at_every_command,), np.array([1.02 * WIDTH]))]
    friction, behind = searching.full.fit_all(begin)
    state = replace(searching, fits=(replace(friction, evidence=behind.evidence + 10.0), behind))
    found = driver_period.tried(state).best
    assert [part.effect for part in found.parts] == ["command_deadband"]
    assert dict(found.parts[0].fixed)["period"] == pytest.approx(0.005, rel=0.01)


def test_a_driver_that_leaves_many_times_more_is_not_looked_at(searching: State) -> None:
    plant = searching.full.predict.plant
    band, rub = (hypotheses.candidates(plant, (name,))[0] for name in ("command_deadband", "coulomb_friction"))
    behind, best = searching.full.fit_all([Start((band,), np.array([WIDTH])), Start((rub,), np.array([0.5]))])
    far = driver_period.MAX_COST_RATIO * -1000.0 - driver_period.HOPELESS_DEFICIT_NATS
    best = replace(best, evidence=-1000.0)
    state = replace(searching, fits=(best, replace(behind, evidence=far - 1.0)))
    assert driver_period.tried(state) is state
    near = replace(searching, fits=(best, replace(behind, evidence=far + 1.0)))
    assert driver_period.tried(near) is not near


def test_what_has_no_driver_stays_as_it_is(searching: State) -> None:
    late = hypotheses.candidates(searching.full.predict.plant, ("command_delay",))[0]
    fits = searching.full.fit_all([Start((), np.zeros(0)), Start((late,), np.array([0.01]))])
    state = replace(searching, fits=tuple(fits))
    assert driver_period.tried(state) is state


def test_a_period_over_position_is_no_drivers(searching: State) -> None:
    ripple = hypotheses.candidates(searching.full.predict.plant, ("motor_cogging",))[0]
    fits = searching.full.fit_all([Start((), np.zeros(0)), Start((ripple,), np.array([0.1]))])
    best = replace(fits[1], evidence=fits[0].evidence + 100.0)
    state = replace(searching, fits=(fits[0], best))
    assert driver_period.tried(state) is state
