"""Draws from a posterior: their moments, shares and bounds."""

from __future__ import annotations

import json

import numpy as np
import pytest

from tiago_mj.effects.spec import Entry
from tiago_mj.io.quantities import NINETY
from tiago_mj.randomisation.posterior import Block, Left, Number, Posterior, Weighed, described

DRAWS = 4000
#: Standard error of a correlation near 0.8 of so many draws: (1 - 0.8²) / √4000 = 0.006; five of them.
OF_CORRELATION = 0.03
STIFF = Entry("servo_stiffness", None, {"factor": 2.0}, fitted=True)
RUBS = Entry("coulomb_friction", ("finger",), {"force": 1.0}, fitted=True)


def block(correlation=0.8, low=0.0):
    """A stiffness of 2.0 ± 0.1 and a friction of 1.0 ± 0.2 N that depend on each other."""
    covariance = ((0.01, correlation * 0.02), (correlation * 0.02, 0.04))
    numbers = (Number(0, "factor", False, 1.0, 4.0, "-"), Number(1, "force", False, low, 12.0, "N"))
    return Block((STIFF, RUBS), numbers, covariance)


def one(effect, key, value, deviation, *, logarithm=False, low=None, high=None, unit="-", left=1.0, target=None):
    entry = Entry(effect, target, {key: value}, fitted=True)
    return Left(Block((entry,), (Number(0, key, logarithm, low, high, unit),), ((deviation**2,),)), left)


def sampled(posterior, seed=0, count=DRAWS):
    rng = np.random.default_rng(seed)
    return [posterior.sample(rng) for _ in range(count)]


def of(draws, effect, key):
    return np.array([e.parameters[key] for entries in draws for e in entries if e.name == effect])


def test_magnitudes_keep_their_means_deviations_and_correlation():
    draws = sampled(Posterior("made", "", (Weighed(1.0, block()),)))
    factor, force = of(draws, "servo_stiffness", "factor"), of(draws, "coulomb_friction", "force")
    assert factor.mean() == pytest.approx(2.0, abs=5 * 0.1 / np.sqrt(DRAWS))
    assert force.mean() == pytest.approx(1.0, abs=5 * 0.2 / np.sqrt(DRAWS))
    # A standard deviation of n draws is known to 1 / √(2 n) of it, 1.1 %; five of them.
    assert factor.std() == pytest.approx(0.1, rel=0.056)
    assert force.std() == pytest.approx(0.2, rel=0.056)
    assert np.corrcoef(factor, force)[0, 1] == pytest.approx(0.8, abs=OF_CORRELATION)
    apart = sampled(Posterior("made", "", (Weighed(1.0, block(0.0)),)))
    assert abs(np.corrcoef(of(apart, "servo_stiffness", "factor"), of(apart, "coulomb_friction", "force"))[0, 1]) < 0.08


def test_explanations_are_drawn_by_their_share_of_the_reported_set():
    other = Block((Entry("torque_constant", None, {"factor": 3.0}, fitted=True),), (), ())
    posterior = Posterior("made", "", (Weighed(0.6, block()), Weighed(0.2, other)))
    assert posterior.remainder == pytest.approx(0.2)
    drawn = [entries[0].name for entries in sampled(posterior)]
    # Of 3/4 of 4000 draws the standard error is 0.7 %; five of them.
    assert drawn.count("servo_stiffness") / DRAWS == pytest.approx(0.75, abs=0.035)
    said = "\n".join(described(posterior))
    assert "75 % of the episodes: servo_stiffness" in said
    assert "probability 0.2 is on nothing that was reported" in said


def test_a_draw_beyond_a_bound_is_drawn_again_and_none_lies_on_it():
    draws = sampled(Posterior("made", "", (Weighed(1.0, block(low=1.0)),)))
    force, factor = of(draws, "coulomb_friction", "force"), of(draws, "servo_stiffness", "factor")
    assert force.min() >= 1.0
    assert np.count_nonzero(force == 1.0) == 0
    # Half of a normal: its mean is √(2/π) deviations above the bound; the other number's follows it by the correlation.
    assert force.mean() == pytest.approx(1.0 + 0.2 * np.sqrt(2 / np.pi), abs=0.01)
    assert factor.mean() == pytest.approx(2.0 + 0.8 * 0.1 * np.sqrt(2 / np.pi), abs=0.008)


def test_factors_of_the_models_own_numbers_are_drawn_by_ratio():
    posterior = Posterior(
        "made", "", (Weighed(1.0, block()),), open_numbers=(one("object_mass", "factor", 1.0, 0.3, logarithm=True),)
    )
    drawn = np.log(of(sampled(posterior), "object_mass", "factor"))
    assert drawn.mean() == pytest.approx(0.0, abs=5 * 0.3 / np.sqrt(DRAWS))
    assert drawn.std() == pytest.approx(0.3, rel=0.056)


def test_a_number_that_no_recording_speaks_of_is_said_to_be_the_priors():
    numbers = (
        one("object_mass", "factor", 1.0, 0.3, logarithm=True, left=0.2),
        one("force_limit", "limit", 16.0, 0.6, unit="N", target=("finger",)),
    )
    said = described(Posterior("made", "", (Weighed(1.0, block()),), open_numbers=numbers))
    spoken = next(line for line in said if "narrowed by the recordings" in line)
    silent = next(line for line in said if "no recording speaks of them" in line)
    assert "object_mass" in spoken
    assert "force_limit on finger limit 15 to 17 N" in silent
    assert "force_limit" not in spoken


def test_a_number_that_the_drawn_explanation_changes_is_not_drawn_beside_it():
    same = one("servo_stiffness", "factor", 1.0, 0.03, logarithm=True)
    elsewhere = one("coulomb_friction", "force", 0.0, 0.1, target=("thumb",))
    posterior = Posterior("made", "", (Weighed(1.0, block()),), open_numbers=(same, elsewhere))
    names = [entry.name for entry in posterior.sample(np.random.default_rng(0))]
    assert names == ["servo_stiffness", "coulomb_friction", "coulomb_friction"]
    # Nor does it count where it is looked whether a model has so much: twice it might be too much.
    lower, upper = posterior.extremes()
    assert [entry.name for entry in lower] == [entry.name for entry in upper] == names
    reach = NINETY * 0.1
    assert [entries[-1].parameters["force"] for entries in (lower, upper)] == pytest.approx([-reach, reach])


def test_as_data_and_back_it_draws_the_same():
    posterior = Posterior("made", "f00", (Weighed(0.9, block()),), block(), (one("payload", "mass", 0.0, 0.1),), ("n",))
    again = Posterior.of_data(json.loads(json.dumps(posterior.as_data())))
    assert again == posterior
    assert sampled(again, 3, 5) == sampled(posterior, 3, 5)


def test_data_of_another_form_is_one_line():
    with pytest.raises(ValueError, match=r"^a posterior's explanations .*") as fault:
        Posterior.of_data({"source": "x", "sha256": "", "explanations": 3})
    assert "\n" not in str(fault.value)
