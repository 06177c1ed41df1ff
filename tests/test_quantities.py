"""Amounts as people say them."""

import math

import pytest

from tiago_mj.io.quantities import number, quantity

SAID = {
    (0.0005, "m"): "0.5 mm",
    (0.03, "s"): "30 ms",
    (0.0015, "rad"): "1.5 mrad",
    (0.2, "rad"): "0.2 rad",
    (-0.0005, "m"): "−0.5 mm",
    (2.5, "s"): "2.5 s",
    (0.05, "kg"): "50 g",
    (0.5, "kg"): "0.5 kg",
    (15.0, "N·m"): "15 N·m",
    (1.052, "-"): "1.05",
    (0.0, "m"): "0 m",
    (-6.25e-9, "kg·m²"): "−6.25·10⁻⁹ kg·m²",
    (5e-7, "N"): "5·10⁻⁷ N",
    (-6e-17, "kg·m²"): "0 kg·m²",
    (math.inf, "N"): "∞ N",
}


@pytest.mark.parametrize(("amount", "said"), SAID.items(), ids=str)
def test_small_amounts_are_said_in_thousandths_of_the_unit(amount, said):
    assert quantity(*amount) == said


def test_what_is_not_known_is_a_dash():
    assert number(math.nan) == number(None) == "–"
