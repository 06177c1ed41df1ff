"""How well the numbers of a user's own model are known."""

import pytest
from test_steps_with_rows import PERIOD, beside

from tiago_mj.gap.inference.hypotheses import terms


def test_the_inertia_of_a_users_slide_is_no_fingers(tmp_path):
    """10 kg are known to 3 %; a finger with its load cell is to 35 %."""
    plant = beside(tmp_path, PERIOD).plant
    (term,) = (term for term in terms(plant) if term.effect == "armature")
    assert term.deviation == pytest.approx(0.3)
