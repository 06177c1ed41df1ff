"""Ranks of true magnitudes in their posteriors, and the widths and tails that make them even."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import t

from benchmarks import magnitudes
from benchmarks.magnitudes import Magnitude, Shape


def drawn(count, shape, seed=0):
    """Errors as a posterior of that shape has them; every other effect's form is known."""
    rng = np.random.default_rng(seed)
    fits, forms = rng.uniform(0.5, 2.0, count), np.where(np.arange(count) % 2, rng.uniform(20, 60, count), 0.0)
    scale = np.hypot(fits * shape.widens, forms * shape.compensates) * magnitudes.NINETY / t.ppf(0.95, shape.freedom)
    errors = scale * rng.standard_t(shape.freedom, count)
    return [Magnitude("backlash", *row) for row in zip(errors, fits, forms, strict=True)]


def test_widths_that_errors_were_drawn_with_are_found_and_make_ranks_even():
    true = Shape(2.0, 0.2, 2.0)
    some = drawn(600, true)
    found = magnitudes.fitted(some)
    assert found.widens == pytest.approx(2.0, rel=0.25)
    assert found.compensates == pytest.approx(0.2, rel=0.5)
    assert found.freedom <= 4
    scores = magnitudes.scored(some, found)
    assert scores["p_of_even_ranks"] > 0.01
    assert scores["held"] == pytest.approx(0.9, abs=0.03)


@pytest.mark.parametrize(("widens", "held"), [(0.5, (0.3, 0.8)), (8.0, (0.97, 1.0))])
def test_posteriors_that_are_too_narrow_or_too_wide_have_uneven_ranks(widens, held):
    some = drawn(600, Shape(2.0, 0.2, 2.0))
    scores = magnitudes.scored(some, Shape(widens, 0.2 * widens / 2, 2.0))
    assert scores["p_of_even_ranks"] < 1e-6
    assert held[0] < scores["held"] < held[1] + 1e-9


def answer(name, parameter, **said):
    """What a diagnosis says of one effect."""
    return {"verdict": {"effects": [{"name": name, "target": "all", "parameters": {parameter: said}}]}}


def test_the_error_is_against_the_nominal_number_where_the_label_says_so():
    label = {
        "effects": [{"name": "servo_stiffness", "parameters": {"factor": 1.5}, "target": "all"}],
        "effective": {"factor": 1.56},
    }
    found = magnitudes.magnitude(label, answer("servo_stiffness", "factor", value=1.6, deviation=0.02))
    assert found.error == pytest.approx(0.04)
    assert found.fitted == 0.02
    assert found.form == pytest.approx(0.03 * 0.6)
    assert magnitudes.magnitude(label, answer("torque_constant", "factor", value=1.6, deviation=0.02)) is None
    assert magnitudes.magnitude(label, {"verdict": {"effects": []}}) is None


def test_masses_of_links_add_to_what_is_said_of_a_payload():
    label = {"effects": [{"name": "payload", "parameters": {"mass": 0.2}, "target": "all"}]}
    assert magnitudes.magnitude(label, answer("payload", "mass", value=0.2, deviation=0.01)) is None
