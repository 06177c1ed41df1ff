"""An effect is tried beside an explanation whose own magnitudes may move."""

from dataclasses import replace

import numpy as np
import pytest

from tiago_mj.gap.inference import hypotheses, likelihood
from tiago_mj.gap.inference.fit import Fitted, Fitter, Point
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.search.additions import _is_there
from tiago_mj.gap.search.screen import scored_beside
from tiago_mj.gap.simulation.subset import Subset

#: Of two effects, in units of their magnitudes: what the second does is half done by the first.
TRUE = (5.0, 3.0)


class Linear(Fitter):
    """Predictions that magnitudes and nominal numbers change in proportion."""

    def predictions(self, points, keep=False):
        rng = np.random.default_rng(7)
        shape = self.data.value.shape
        first = 8.0 * rng.normal(size=shape)
        each = {"viscous_friction": first, "coulomb_friction": 0.5 * first + 4.0 * rng.normal(size=shape)}
        return np.array(
            [
                sum((v * each[part.effect] for part, v in zip(p.parts, p.values, strict=True)), np.zeros(shape))
                + np.tensordot(p.nuisance, self.responses, 1)
                for p in points
            ]
        )


def linear(grasps, numbers: int) -> tuple[Fitter, Point, Point]:
    """Of readings with noise 1, the best of the first effect alone, and the second beside it at its true magnitude."""
    plant, on, data = grasps
    pool = hypotheses.candidates(plant, ["viscous_friction", "coulomb_friction"])
    first, second = (
        next(c for c in pool if c.target is None and c.effect == name)
        for name in ("viscous_friction", "coulomb_friction")
    )
    shape = (2, 80, len(data.channels))
    zeros, rng = np.zeros(shape), np.random.default_rng(3)
    made = Data(data.channels, data.part, zeros, np.ones(shape[-1]), zeros + 1, zeros)
    responses = 0.3 * rng.normal(size=(numbers, *shape))
    fitter = Linear(
        Predictor(plant, on, made),
        Subset((0, 1)),
        made,
        np.ones(shape[-1]),
        hypotheses.terms(plant)[:numbers],
        responses,
    )
    truth = Point((first, second), np.array(TRUE), np.zeros(numbers))
    made = replace(made, value=fitter.predictions([truth])[0] + rng.normal(size=shape))
    fitter = replace(fitter, data=made)
    unit = fitter.predictions([Point((first,), np.ones(1), np.zeros(numbers))])[0]
    alone = Point((first,), np.array([(made.value * unit).sum() / (unit**2).sum()]), np.zeros(numbers))
    return fitter, alone, alone.with_effect(second, TRUE[1])


@pytest.mark.parametrize("numbers", [0, 2])
def test_what_the_first_magnitude_stood_for_is_given_to_the_second_effect(grasps, numbers):
    fitter, alone, both = linear(grasps, numbers)
    base, more = fitter.predictions([alone, both])
    assert alone.values[0] > TRUE[0] + 1
    on = scored_beside(fitter, alone, base)
    gain = np.diff(likelihood.log_likelihood(on, np.stack([base, more])))[0]
    left = likelihood.soften(fitter.data.value - base)
    noise = 0.5 * base.size
    assert gain == pytest.approx(0.5 * (left**2).sum() - noise, rel=0.1)
    held = likelihood.frame(fitter.data, fitter.weight, fitter.responses, fitter.per_trial)
    assert np.diff(likelihood.log_likelihood(held, np.stack([base, more])))[0] < 0.5 * gain


def test_beside_nothing_the_nominal_numbers_alone_may_move(grasps):
    fitter, alone, _ = linear(grasps, 2)
    nothing = Point((), np.zeros(0), alone.nuisance)
    base = fitter.predictions([nothing])[0]
    on = scored_beside(fitter, nothing, base)
    plain = likelihood.frame(fitter.data, fitter.weight, fitter.responses, fitter.per_trial, alone.nuisance)
    assert likelihood.log_likelihood(on, base[None]) == likelihood.log_likelihood(plain, base[None])


def test_the_same_effect_on_all_joints_is_not_tried_beside_it_on_each(grasps):
    plant, _, _ = grasps
    targets = plant.wiring.targets
    pool = hypotheses.candidates(plant, ["coulomb_friction", "viscous_friction"])
    of = {c.label: c for c in pool}
    right, left = (of["coulomb_friction", (name,)] for name in plant.joints)
    everywhere = of["coulomb_friction", None]

    def there(candidate, *parts):
        return _is_there(
            candidate, Fitted(parts, np.ones(len(parts)), np.ones(len(parts)), np.zeros(0), 0.0, 1.0), targets
        )

    assert there(everywhere, right, left)
    assert there(right, right)
    assert there(everywhere, everywhere)
    assert not there(everywhere, right)
    assert not there(right, everywhere)  # more on one joint than on the others
    assert not there(of["viscous_friction", None], right, left)
