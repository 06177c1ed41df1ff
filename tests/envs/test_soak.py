"""The long random run of tests/long, in small: each effect at both bounds, random steps, and what it would find."""

import sys
from pathlib import Path

import numpy as np
import pytest
from gymnasium import spaces

sys.path.insert(0, str(Path(__file__).parents[1] / "long"))
import soak

import tiago_mj
from tiago_mj.effects import EFFECTS

FAST = "GripperTactile-v0"
SLOW = [pytest.param(name, marks=pytest.mark.slow) for name in tiago_mj.ENVIRONMENTS if name != FAST]


@pytest.mark.parametrize("name", [FAST, *SLOW])
def test_every_effect_at_both_bounds_gives_finite_numbers_in_their_spaces(name):
    faults = soak.Faults()
    made = soak.bounds(name, 6, faults)
    assert made["runs"] + len(made["refused"]) == 2 * len(EFFECTS)
    # A model without what an effect takes away refuses that.
    assert all(EFFECTS[words.split()[0]].takes_from for words in made["refused"])
    assert faults.found == {}


def test_random_steps_find_nothing():
    faults = soak.Faults()
    assert soak.scalar_steps("TIAGoReachTactile-v0", 60, faults)["steps"] == 60
    assert soak.vector_steps("TIAGoReachTactile-v0", 128, faults)["steps"] == 128
    assert {found for found in faults.found if "memory" not in found} == set()  # too short to tell of memory


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        ((np.array([np.nan]), 0.0, False, False, {}), ["x: not finite at /0", "x: observation outside its space"]),
        ((np.array([2.0]), 0.0, False, False, {}), ["x: observation outside its space"]),
        ((np.array([0.0]), np.inf, False, False, {}), ["x: not finite at /1"]),
        ((np.array([0.0]), 0.0, False, False, {"a": {"b": [np.nan]}}), ["x: not finite at /4/a/b/0"]),
    ],
    ids=["observation", "space", "reward", "info"],
)
def test_what_is_wrong_is_found(answer, said):
    faults = soak.Faults()
    faults.check(answer, spaces.Box(-1.0, 1.0, (1,), np.float64), "x")
    assert sorted(faults.found) == sorted(said)
