"""Fits and intervals where predictions scatter by more than small moves of a number change them."""

from __future__ import annotations

import numpy as np
import pytest
from test_central import MOTOR, ROWS, RUBS, SIZE, STIFF, fitter

from tiago_mj.gap.inference import central, hypotheses, scatter
from tiago_mj.gap.inference.fit import Fitted, Fitter
from tiago_mj.gap.inference.points import NUISANCE_STEP, Point, Start
from tiago_mj.gap.inference.predictor import Predictor
from tiago_mj.gap.inference.whitening import Whitening
from tiago_mj.gap.search import beginning
from tiago_mj.gap.simulation.subset import Subset

SHAPE = SIZE * np.sin(np.linspace(0, 9, ROWS))
#: Of a reading, in units of its noise: 200 rows scatter by a sum of squares of 50.
UNEVEN = 0.5


def predicted(numbers):
    """Only the product of both shows, and any other number is another draw of the scatter."""
    both = numbers.get("torque_constant", 1.0), numbers.get("servo_stiffness", 1.0)
    seed = [int(np.float64(one).view(np.uint64)) for one in both]
    return SHAPE * both[0] * both[1] + UNEVEN * np.random.default_rng(seed).normal(size=ROWS)


def uneven():
    """The fitter of a motor of 0.55, which knows that its predictions scatter."""
    on = fitter((STIFF,), predicted, 0.55 * SHAPE + np.random.default_rng(0).normal(size=ROWS))
    on.uneven = True
    return on


def test_scatter_is_the_expected_sum_of_squares_of_one_prediction():
    on = uneven()
    alike = on.predictions(scatter.alike(Point((MOTOR,), np.array([0.55]), np.zeros(1)), 0))
    there = Whitening(on.data, on.weight)
    # Of six draws of 200 rows: 4 %, thrice over.
    assert scatter.of(there, alike) == pytest.approx(ROWS * UNEVEN**2, rel=0.15)
    assert scatter.of(there, alike[:1]) == 0


def test_where_predictions_scatter_a_fit_still_ends_at_the_optimum_and_knows_how_well():
    """As without scatter (test_central): the motor is known to what the stiffness is, 4 %."""
    on = uneven()
    found = on.descended(Start((MOTOR,), np.array([0.4]), np.array([0.1])))
    assert found.values[0] == pytest.approx(0.55, abs=2 * 0.04 * 0.55)
    (told,) = on.settled([found])
    assert told.deviations[0] == pytest.approx(0.04 * 0.55, rel=0.2)


def test_a_fit_that_stays_far_behind_is_abandoned():
    on = uneven()
    start = Start((MOTOR,), np.array([0.4]), np.array([0.1]))
    assert on.descended(start, ahead=1e9).values[0] == 0.4
    assert on.descended(start, ahead=-1e9).values[0] != 0.4


def test_responses_serve_several_steps_and_what_shows_nothing_is_simulated_once(monkeypatch):
    """Friction changes nothing here: it is moved for the first responses and never again."""
    on = fitter((STIFF, RUBS), predicted, 0.55 * SHAPE + np.random.default_rng(0).normal(size=ROWS))
    on.uneven = True
    moves, steps = [], []
    around, points = central.around, Fitter.points

    def noted(fitter, at, moved):
        moves.append(moved.copy())
        return around(fitter, at, moved)

    def counted(*given):
        steps.append(given)
        return points(*given)

    monkeypatch.setattr(central, "around", noted)
    monkeypatch.setattr(Fitter, "points", counted)
    on.descended(Start((MOTOR,), np.array([0.4]), np.array([0.1, 0.0])))
    assert len(steps) > len(moves)
    assert moves[0].all()
    assert not any(one[2] for one in moves[1:])
    assert all(one[:2].all() for one in moves)


def weak(known):
    """Deviation that is told of a number that the recording does not show."""
    on = fitter((STIFF,), lambda n: predicted({k: 1e-9 * v for k, v in n.items()}), np.zeros(ROWS))
    on.uneven = known
    (told,) = on.settled([Fitted((), np.zeros(0), np.zeros(0), np.zeros(1), 0.0, 1.0)])
    return told.nuisance_deviations[0]


def test_scatter_is_not_taken_for_information():
    """Small moves of a number that changes nothing show scatter alone, which looks like knowing it to 0.06 deviations;
    what is known of it is its prior."""
    assert weak(known=False) < 0.1
    assert weak(known=True) > 0.5


def test_moves_are_as_long_as_scatter_asks_and_no_longer():
    usual, longest = np.full(3, NUISANCE_STEP), np.full(3, scatter.MAX_NUDGE)
    information = np.array([1.0, 4000.0, 1e6])
    moves = scatter.moves(usual, longest, information, 50.0)
    assert moves[0] == scatter.MAX_NUDGE
    assert moves[2] == NUISANCE_STEP
    assert 50.0 / (2 * moves[1] ** 2) == pytest.approx(scatter.MAX_SHARE * information[1])
    assert (scatter.moves(usual, longest, information, 0.1) == usual).all()  # smooth: as everywhere


def test_what_scatter_added_is_taken_off_and_nothing_becomes_less_than_unknown():
    curvature = np.array([[9.0, 3.0], [3.0, 2.0]])
    assert np.array_equal(scatter.taken_off(curvature, np.zeros(2)), curvature)
    assert scatter.taken_off(curvature, np.array([1.0, 0.5])) == pytest.approx(curvature - np.diag([1.0, 0.5]))
    least = np.linalg.eigvalsh(scatter.taken_off(curvature, np.array([8.5, 1.9])))
    assert least.min() > -1e-9


def test_predictions_of_grasps_scatter_and_a_fit_of_them_finds_the_numbers_all_the_same(grasps):
    """The recordings are the nominal simulator's own, so that each of its numbers is 0 deviations off."""
    plant, on, data = grasps
    names = ("servo_stiffness", "object_mass", "contact_stiffness")
    terms = tuple(term for term in hypotheses.terms(plant) if term.effect in names)
    empty = np.zeros((len(terms), *data.value.shape))
    full = Fitter(Predictor(plant, on, data), Subset((0, 1)), data, np.ones(len(data.channels)), terms, empty)
    begun = Start((), np.zeros(0), np.full(full.size, 1.0))
    full = beginning.with_unevenness(full.linearized_at(Point.of(begun)), full.fit_all([begun])[0])
    assert full.uneven
    assert np.abs(full.descended(begun).nuisance).max() < 0.3  # 0.12 measured
    assert np.abs(full.fit_all([begun])[0].nuisance).max() > 1.0  # by short moves it stays where it began
