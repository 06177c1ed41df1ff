"""Shares of the physics step's error that are put right are compared from the same physics, by linear responses."""

from dataclasses import replace

import numpy as np
import pytest
from made_hinge import recorded

from tiago_mj.effects.spec import Entry
from tiago_mj.gap.inference import hypotheses
from tiago_mj.gap.inference.fit import Fitter, Start
from tiago_mj.gap.inference.points import Point
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.inference.whitening import Whitening
from tiago_mj.gap.simulation.subset import Subset

SHARES = (0.0, 0.5, 0.6, 0.7, 1.0)
LATE = Entry("command_lag", None, {"time_constant": 0.02})


@pytest.fixture(scope="module")
def late(tmp_path_factory: pytest.TempPathFactory) -> Fitter:
    """Of a hinge whose commands lag, recorded at a third of the step; its damping and commands are known roughly."""
    predict: Predictor = recorded(tmp_path_factory.mktemp("hinge"))[0]
    finer = replace(predict, plant=replace(predict.plant, max_timestep=predict.plant.max_timestep / 3), off=None)
    value = finer.all_trials([(LATE,)], range(len(predict.on.trials)))[0]
    value = value + predict.data.noise * np.random.default_rng(0).standard_normal(value.shape)
    noise = np.broadcast_to(predict.data.noise, value.shape)
    data = replace(predict.data, value=value, sigma=noise, common=np.zeros_like(value))
    terms = tuple(one for one in hypotheses.terms(predict.plant) if not one.per_trial)
    flat = np.zeros((len(terms), *value.shape))
    trials = Subset.of(range(len(value)))
    return Fitter(replace(predict, data=data), trials, data, np.ones(len(data.channels)), terms, flat)


def test_predictions_of_all_shares_are_made_of_the_same_physics(late):
    wanted = [(trial, (LATE,)) for trial in late.trials]
    each = [replace(late.predict, corrected=share)(wanted) for share in SHARES]
    before = late.predict.tally["simulations"]
    together = late.predict.by_shares(wanted, SHARES)
    assert late.predict.tally["simulations"] == before + len(wanted)
    np.testing.assert_array_equal(together, np.array(each))
    again = late.predict.tally["simulations"]
    late.predict(wanted)  # nothing is remembered
    assert late.predict.tally["simulations"] == again + len(wanted)


def test_costs_are_those_of_fits_with_each_share(late):
    """A hinge in the air is smooth: near the likeliest share linear responses foretell a fit (of 1601 nats) to
    1 nat, farther off to a fifth of what the share costs more."""
    part = hypotheses.candidates(late.predict.plant, ("command_lag",))[0]
    start = Start((part,), np.array([0.02]), np.zeros(late.size))
    on = Whitening(late.data, late.weight)
    told, fitted = late.costs_by_shares(SHARES, start, on), []
    for share in SHARES:
        by = replace(late, predict=replace(late.predict, corrected=share)).linearized_at(Point.of(start))
        point = Point.of(by.fit_all([start])[0])
        fitted.append(on.cost(by.predictions([point])[0], point.nuisance))
    assert int(np.argmin(told)) == int(np.argmin(fitted)) == SHARES.index(0.6)
    for one, other in zip(told, fitted, strict=True):
        assert one == pytest.approx(other, abs=1.0 + (other - min(fitted)) / 5)
