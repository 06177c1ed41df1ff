"""The joint posterior of what is fitted together: from the curvature of the fit to what a file holds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from tiago_mj.effects import EFFECTS
from tiago_mj.gap.analysis import outcome
from tiago_mj.gap.decision import verdict
from tiago_mj.gap.detectors.readings import Known
from tiago_mj.gap.inference.evidence import Responses, log_evidence
from tiago_mj.gap.inference.hypotheses import FORM_COMPENSATION, Candidate
from tiago_mj.gap.inference.noise_model import Data
from tiago_mj.gap.inference.points import Fitted, Point
from tiago_mj.gap.inference.whitening import Whitening
from tiago_mj.gap.search.beside_readings import with_readings

STIFF = Candidate("servo_stiffness", None, "factor", (), 1.0, 0.2, 4.0, (), "-")
RUBS = Candidate("coulomb_friction", ("elbow",), "force", (), 0.0, -0.5, 12.0, (), "N·m", tolerance=0.1)
TOGETHER = np.array([[1.0, -0.6], [-0.6, 1.0]])
FIT = Fitted(
    (STIFF, RUBS),
    np.array([2.0, 0.7]),
    np.array([0.02, 0.05]),
    np.array([0.3, -0.2, 0.1]),
    0.0,
    1.0,
    nuisance_deviations=np.array([0.5, 0.6, 0.9]),
    correlation=(TOGETHER, np.array([[1, 0.2, 0.1], [0.2, 1, 0.3], [0.1, 0.3, 1]])),
)


def test_two_magnitudes_that_do_nearly_the_same_are_known_together_and_not_each():
    zeros = np.zeros((1, 50, 2))
    data = Data(("position.a", "position.b"), np.arange(2), zeros, np.ones(2), zeros + 1.0, zeros)
    on = Whitening(data, np.ones(2))
    rng = np.random.default_rng(0)
    same, own, nuisance = (rng.normal(size=(100, 1)) for _ in range(3))
    columns = np.hstack([10 * same, 10 * same + 2 * own, nuisance])
    at = Point((STIFF, RUBS), np.array([2.0, 0.7]), np.array([0.0]))
    found = log_evidence(on, at, zeros, Responses(columns))
    ranges = [STIFF.high - STIFF.low, RUBS.high - RUBS.low]
    curvature = columns.T @ columns + np.diag([*(12 / np.square(ranges)), 1.0])
    covariance = np.linalg.inv(curvature)
    assert found.deviations == pytest.approx(np.sqrt(np.diag(covariance))[:2], rel=1e-6)
    of_magnitudes, of_nuisances = found.correlation
    assert of_magnitudes[0, 1] == pytest.approx(
        covariance[0, 1] / np.sqrt(covariance[0, 0] * covariance[1, 1]), rel=1e-6
    )
    assert of_magnitudes[0, 1] < -0.95
    assert [*np.diag(of_magnitudes), *np.diag(of_nuisances)] == pytest.approx([1.0] * 3)
    together = found.deviations[0] ** 2 + found.deviations[1] ** 2
    together += 2 * of_magnitudes[0, 1] * found.deviations[0] * found.deviations[1]
    assert np.sqrt(together) < 0.3 * found.deviations[0]  # their sum


def test_a_magnitude_is_known_no_better_than_beside_its_second_number():
    """The second number's prior is even over what its logarithm may range."""
    fading = replace(RUBS, effect="stribeck_friction", parameter="static", fixed=(("velocity", 0.02),))
    zeros = np.zeros((1, 50, 2))
    data = Data(("position.a", "position.b"), np.arange(2), zeros, np.ones(2), zeros + 1.0, zeros)
    on = Whitening(data, np.ones(2))
    rng = np.random.default_rng(1)
    same, own, nuisance = (rng.normal(size=(100, 1)) for _ in range(3))
    columns, seconds = np.hstack([10 * same, nuisance]), 3 * same + own
    at = Point((fading,), np.array([0.7]), np.array([0.0]))
    found = log_evidence(on, at, zeros, Responses(columns, seconds))
    alone = log_evidence(on, at, zeros, Responses(columns))
    (width,) = fading.second_numbers.values()
    both = np.hstack([columns, seconds])
    prior = [12 / (fading.high - fading.low) ** 2, 1.0, 12 / width**2]
    deviations = np.sqrt(np.diag(np.linalg.inv(both.T @ both + np.diag(prior))))
    assert found.marginal == pytest.approx(deviations[:1], rel=1e-6)
    assert found.second_deviations == pytest.approx(deviations[2:], rel=1e-6)
    assert found.deviations == pytest.approx(alone.deviations)
    assert found.marginal[0] > 2 * found.deviations[0]
    assert (found.log_likelihood, found.prior) == (alone.log_likelihood, alone.prior)


def test_covariance_is_as_wide_as_the_intervals_and_a_form_that_is_not_known_makes_numbers_independent():
    joint = outcome.joint(FIT)
    widens = verdict.calibration().widens
    fitted = FIT.deviations * widens
    known = [STIFF.known_to(2.0), RUBS.known_to(0.7)]
    assert known == pytest.approx(
        [FORM_COMPENSATION * 0.03 * 1.0, FORM_COMPENSATION * EFFECTS["coulomb_friction"].form_known_to * 0.7]
    )
    covariance = np.array(joint.covariance)
    assert np.sqrt(np.diag(covariance)) == pytest.approx(np.hypot(fitted, known))
    assert covariance[0, 1] == covariance[1, 0] == pytest.approx(-0.6 * fitted[0] * fitted[1])
    assert joint.logarithms == (False, False)


def test_draws_end_at_the_value_without_effect_and_at_what_is_possible():
    joint = outcome.joint(FIT)
    assert (joint.low, joint.high) == ((1.0, 0.0), (4.0, 12.0))
    weaker = outcome.joint(
        Fitted((STIFF,), np.array([0.5]), np.array([0.02]), np.zeros(0), 0, 1, correlation=(np.eye(1), np.eye(0)))
    )
    assert (weaker.low, weaker.high) == ((0.2,), (1.0,))


def test_without_effects_or_of_a_fit_that_does_not_say_there_is_none():
    assert outcome.joint(Fitted((), np.zeros(0), np.zeros(0), np.zeros(0), 0, 1)) is None
    assert outcome.joint(Fitted((STIFF,), np.ones(1), np.ones(1), np.zeros(0), 0, 1)) is None


def test_what_readings_say_alone_and_numbers_that_were_not_fitted_depend_on_nothing_else():
    noise = Candidate("force_noise", None, "factor", (), 1.0, 0.2, 20.0, (), "-", spread=0.1)
    sensitive = np.array([True, False, True, False])
    beside = with_readings(FIT, [Known(noise, 3.0, 0.1)], sensitive)
    magnitudes, nuisances = beside.correlation
    np.testing.assert_array_equal(magnitudes, [[1, -0.6, 0], [-0.6, 1, 0], [0, 0, 1]])
    # Two of four shared numbers were fitted, and one of a trial.
    np.testing.assert_array_equal(nuisances[1], [0, 1, 0, 0, 0])
    assert nuisances[0].tolist() == [1, 0, 0.2, 0, 0.1]
    assert beside.nuisance.tolist() == [0.3, 0, -0.2, 0, 0.1]
    assert beside.nuisance_deviations.tolist() == [0.5, 1, 0.6, 1, 0.9]
