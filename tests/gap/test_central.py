"""How well a magnitude is known at the end of a fit: responses by central differences."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from tiago_mj.gap.inference import central
from tiago_mj.gap.inference.fit import Fitted, Fitter
from tiago_mj.gap.inference.hypotheses import Candidate, Term
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.inference.points import NUISANCE_STEP, Point, Start
from tiago_mj.gap.simulation.subset import Subset

MOTOR = Candidate("torque_constant", None, "factor", (), 1.0, 0.1, 3.0, (), "-")
STIFF = Term("servo_stiffness", ("hinge",), "factor", 1.0, 0.04, False)
RUBS = Term("viscous_friction", ("hinge",), "damping", 0.0, 0.5, False, low=-0.1)
ROWS, SIZE = 200, 2000.0


def fitter(terms, predicted, measured):
    """A fitter of one channel whose simulator is a function of the entries of a trial, by their effects' names."""
    zeros = np.zeros((1, ROWS, 1))
    data = Data(("position.hinge",), np.arange(1), measured[None, :, None], np.ones(1), zeros + 1.0, zeros)
    predict = SimpleNamespace(journal=SimpleNamespace(path=None), replays=True, seed=0)
    made = Fitter(predict, Subset((0,)), data, np.ones(1), terms, np.zeros((len(terms), 1, ROWS, 1)))

    def predictions(points, *, keep=False):
        each = []
        for point in points:
            entries = made.effects(point.parts, point.values, point.nuisance, 0)
            each.append(predicted({e.name: next(iter(e.parameters.values())) for e in entries}))
        return np.asarray(each)[:, None, :, None]

    made.predictions = predictions
    return made


def test_a_motor_and_a_stiffness_that_are_one_product_are_known_as_well_as_the_stiffness_is():
    """Only their product shows: the motor's constant is known to what the stiffness is, 4 %, and not to what errors of
    two large responses look like."""
    shape = SIZE * np.sin(np.linspace(0, 9, ROWS))

    def predicted(numbers):
        return shape * numbers.get("torque_constant", 1.0) * numbers.get("servo_stiffness", 1.0)

    rng = np.random.default_rng(0)
    on = fitter((STIFF,), predicted, 0.55 * shape + rng.normal(size=ROWS))
    (found,) = on.settled([Fitted((MOTOR,), np.array([0.53]), np.array([1e-4]), np.array([0.6]), 0.0, 1.0)])
    assert found.deviations[0] == pytest.approx(0.04 * 0.55, rel=0.1)
    assert found.values[0] == pytest.approx(0.55, rel=0.01)
    assert found.nuisance[0] == pytest.approx(0.0, abs=0.1)
    (forward,) = on.fit_all([Start((MOTOR,), np.array([0.4]), np.array([0.1]))])
    assert forward.deviations[0] < 0.85 * found.deviations[0]


def test_a_side_that_a_bound_cuts_short_counts_as_far_as_it_went():
    """Friction cannot fall by more than the joint has: of that side a fifth is left, and its response is the same."""

    def predicted(numbers):
        return np.full(ROWS, 10.0 * numbers.get("viscous_friction", 0.0))

    on = fitter((RUBS,), predicted, np.zeros(ROWS))
    at = Point((), np.zeros(0), np.zeros(1))
    points = central.around(on, at, np.array([NUISANCE_STEP]))
    of_values, of_terms = central.responses(on, at, points, on.predictions(points))
    assert of_values.shape == (0, 1, ROWS, 1)
    assert of_terms == pytest.approx(5.0)


def test_a_magnitude_at_its_bound_moves_to_one_side_alone():
    def predicted(numbers):
        return np.full(ROWS, 7.0 * numbers.get("torque_constant", 1.0))

    on = fitter((), predicted, np.zeros(ROWS))
    at = Point((MOTOR,), np.array([3.0]), np.zeros(0))
    points = central.around(on, at, [0.1])
    assert [one.values[0] for one in points] == pytest.approx([3.0, 2.9])
    of_values, _ = central.responses(on, at, points, on.predictions(points))
    assert of_values == pytest.approx(7.0)


def test_a_model_whose_numbers_are_all_known_is_settled_as_it_is():
    on = fitter((), lambda numbers: np.zeros(ROWS), np.ones(ROWS))
    (found,) = on.settled([Fitted((), np.zeros(0), np.zeros(0), np.zeros(0), 0.0, 1.0)])
    assert found.misfit == pytest.approx(1.0)
    assert found.evidence == pytest.approx(-0.5 * ROWS)
