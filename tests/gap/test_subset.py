"""Some recordings of a session: their indices in it, their rows among each other."""

from __future__ import annotations

import numpy as np
import pytest

from tiago_mj.gap.simulation.subset import Subset

SOME = Subset((1, 4, 6))


def test_rows_are_places_among_the_recordings_and_lead_back_to_them():
    assert SOME.rows_of((6, 1)) == [2, 0]
    assert SOME.at(SOME.rows_of((6, 1))) == Subset((6, 1))
    with pytest.raises(ValueError, match="not in"):
        SOME.rows_of((2,))


def test_it_indexes_recordings_of_arrays_and_not_their_dimensions():
    values = np.arange(24.0).reshape(8, 3)
    np.testing.assert_array_equal(values[SOME], values[[1, 4, 6]])
    np.testing.assert_array_equal(values[Subset((1, 2))], values[[1, 2]])


def test_parts_of_it():
    assert SOME.without({4}) == Subset((1, 6))
    assert SOME[np.int64(1)] == 4
    assert SOME[:2] == Subset.of(iter((1, 4)))
    assert SOME.holds((4, 6))
    assert not SOME.holds((4, 5))
    assert 6 in SOME
    assert list(SOME) == [1, 4, 6]
